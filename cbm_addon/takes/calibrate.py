"""Calibration: from device poses to joint poses over a floor at z = 0. Everything it decides is a constant of the take."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from ..errors import InputError
from ..motion.rotations import Array, matrix_from_quat
from .arms import FARTHEST_PERCENTILE, arm_warnings, measure_arms
from .cleaning import hold_gaps
from .devices import CONTROLLERS, DEFAULT_DEVICE, EYE_SHARE, HEAD_JOINT_SHARE, NO_DEVICE, head_offset, held, mounting
from .gaps import fill
from .t_pose import t_pose
from .take import HEAD, Constant, Take

STANDING_PERCENTILE = 95
"""The head joint's height over a take, at this percentile, is its standing height: over the 481 clips of mocap that the engine is trained
on its ratio to the rest height has the median 1.00 and is between 0.98 and 1.11 in nine of ten (lower percentiles see more crouching, higher
ones more jumping)."""

EYE_HEIGHTS = (1.0, 2.05)  # metres: what is believed of a measurement
ADULT_STATURE = 1.70  # metres: assumed where nothing can be measured
SEATED_SHARE = 0.70  # seated eye height above the floor, as a share of stature
EYE_LEVEL_ORIGIN = 0.5  # metres: an origin with the head lower than this over it is not on the floor
LOW_EYE_HEIGHT = 1.4  # metres: worth a word

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class CalibrationOptions:
    """What the user knows better than the measurements. None: measure or assume.

    eye_height    metres above the floor, standing
    floor         metres: the height of the floor in the take
    device        a key of CONTROLLERS, or NO_DEVICE: the poses are those of the joints
    head_offset   metres from the headset to the head joint, in the headset's frame (left, back, up)
    wrist_offset  metres from the left controller to the left wrist, in the controller's frame; mirrored for the right
    seated        the performer sits throughout: standing eye height cannot be measured
    """

    eye_height: float | None = None
    floor: float | None = None
    device: str | None = None
    head_offset: Vector | None = None
    wrist_offset: Vector | None = None
    seated: bool = False


@dataclass(frozen=True)
class Calibration:
    """What calibration decided, in metres.

    floor        height of the floor in the take as it was read
    eye_height   standing height of the eyes above the floor
    head_height  standing height of the head joint above the floor
    stature      of the standard body whose head joint stands at that height
    constants    these and what was decided about the devices, by name, each with its source
    reach        share of tracked hand samples whose wrist an arm of this stature can reach from the shoulder that is estimated from the head
    warnings     one sentence each
    """

    floor: float
    eye_height: float
    head_height: float
    stature: float
    constants: dict[str, Constant[Any]]
    reach: float
    warnings: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """For a report: everything, every constant with value, source, reason and confidence."""
        return asdict(self)


@dataclass(frozen=True)
class Calibrated:
    """A take of kind "joint", floor at z = 0, every sample filled (`tracked` still tells what was tracked), and how it came to be."""

    take: Take
    calibration: Calibration


MEASURE = CalibrationOptions()


def calibrate(take: Take, options: CalibrationOptions = MEASURE) -> Calibrated:
    """Joint poses from a take of either kind. InputError if an option is out of this world or the head is never tracked."""
    _check(take, options)
    if options.device == NO_DEVICE:
        take = replace(take, kind="joint")
    pose = t_pose(take)
    sizes = _sizes(take, options, pose)
    stature = sizes["stature"].value
    constants: dict[str, Constant[Any]] = dict(sizes)
    if pose:
        constants["t_pose"] = Constant(f"{take.times[pose.start]:.1f} to {take.times[pose.stop - 1]:.1f} s", "measured", "standing still, arms to the sides")
    if take.kind == "device":
        device, offset = _device(take, options), _head_offset(options, stature)
        controller = held(CONTROLLERS[device.value], options.wrist_offset)
        constants["device"] = device
        constants["head_offset"] = Constant(offset, "given" if options.head_offset else "assumed")
        constants["wrist_offset"] = Constant(controller.wrist, "given" if options.wrist_offset else "assumed")
    posed = _joint_poses(take, constants)[1][pose] if pose else None
    take = hold_gaps(take)
    positions, rotations = fill(take.times, *_joint_poses(take, constants), take.tracked, stature)
    joints = replace(take, kind="joint", positions=positions.astype(np.float32), rotations=rotations.astype(np.float32))
    arms = measure_arms(positions, rotations, take.tracked, stature)
    if arms.share == arms.share:
        why = f"from shoulder to wrist, percentile {FARTHEST_PERCENTILE}; an arm of this stature is {arms.length:.2f} m"
        constants["arm_reach"] = Constant(arms.farthest, "measured", why)
    warnings = (*_warnings(sizes), *arm_warnings(arms, positions, take.tracked, posed))
    heights = {name: constant.value for name, constant in sizes.items()}
    return Calibrated(joints, Calibration(**heights, constants=constants, reach=arms.share, warnings=warnings))


def joint_poses(take: Take, calibration: Calibration) -> Take:
    """The take as poses of joints over a floor at z = 0, by a calibration of it, with nothing filled: NaN where it was not tracked."""
    positions, rotations = _joint_poses(take, calibration.constants)
    return replace(take, kind="joint", positions=positions.astype(np.float32), rotations=rotations.astype(np.float32))


def _joint_poses(take: Take, constants: dict[str, Constant[Any]]) -> tuple[Array, Array]:
    positions, rotations = take.positions.astype(np.float64), take.rotations.astype(np.float64)
    if "device" in constants:
        controller = held(CONTROLLERS[constants["device"].value], constants["wrist_offset"].value)
        positions, rotations = mounting(controller, constants["head_offset"].value).joints(positions, rotations)
    positions[..., 2] -= constants["floor"].value
    return positions, rotations


def _check(take: Take, options: CalibrationOptions) -> None:
    if not take.tracked[:, HEAD].any():
        raise InputError(take.name, "the headset is tracked in no sample; a take needs at least the head")
    if options.eye_height is not None and not 0.5 <= options.eye_height <= 2.5:
        raise InputError("--eye-height", f"{options.eye_height:g} is not the eye height of a person in metres; 0.5 to 2.5 would be")
    if options.floor is not None and not np.isfinite(options.floor):
        raise InputError("--floor", f"{options.floor:g} is not a height in metres")
    for name, offset in (("--head-offset", options.head_offset), ("--wrist-offset", options.wrist_offset)):
        if offset and not np.linalg.norm(offset) < 0.5:
            raise InputError(name, f"{offset} is not in metres from a device to the joint beside it; under 0.5 would be")
    if options.device not in (None, NO_DEVICE, *CONTROLLERS):
        raise InputError("--device", f"{options.device!r} is not known; {', '.join(CONTROLLERS)} and {NO_DEVICE} are")


def _device(take: Take, options: CalibrationOptions) -> Constant[str]:
    if options.device:
        return Constant(options.device, "given")
    assumed = Constant(DEFAULT_DEVICE, "assumed", "OpenXR grip poses")
    return take.report.constants.get("device", assumed) if take.report else assumed


def _head_offset(options: CalibrationOptions, stature: float) -> Vector:
    return options.head_offset or head_offset(stature)


def _sizes(take: Take, options: CalibrationOptions, pose: slice | None) -> dict[str, Constant[float]]:
    """Floor, eye height, head height and stature; `pose` are the samples of a T-pose, if there is one."""
    seen = take.tracked[:, HEAD]
    posed = np.zeros(len(take), dtype=bool)
    posed[pose or slice(0)] = True
    posed = posed[seen]
    height = take.positions[seen, HEAD, 2].astype(np.float64)
    up = matrix_from_quat(take.rotations[seen, HEAD].astype(np.float64))[:, 2]

    def standing(stature: float) -> float:
        """The head joint's standing height in the take, if the performer has that stature."""
        offset = np.array(_head_offset(options, stature) if take.kind == "device" else (0, 0, 0))
        joint = height + up @ offset
        return float(np.median(joint[posed]) if pose else np.percentile(joint, STANDING_PERCENTILE))

    def eyes(stature: float) -> float:
        return HEAD_JOINT_SHARE * stature - _head_offset(options, stature)[2]

    measured = ADULT_STATURE
    for _ in range(4):  # the offset from headset to joint depends a little on the stature that it gives
        measured = (standing(measured) - (options.floor or 0.0)) / HEAD_JOINT_SHARE
    where = "in the T-pose" if pose else f"percentile {STANDING_PERCENTILE} over the take"
    seen_at = f"the eyes are at {eyes(measured):.2f} m, {where}"
    on_floor = options.floor is not None or EYE_LEVEL_ORIGIN <= eyes(measured) <= EYE_HEIGHTS[1]
    believable = on_floor and EYE_HEIGHTS[0] <= eyes(measured) <= EYE_HEIGHTS[1] and not options.seated
    if options.eye_height is not None:
        offset = options.head_offset
        stature = (options.eye_height + offset[2]) / HEAD_JOINT_SHARE if offset else options.eye_height / EYE_SHARE
        size = Constant(stature, "given")
    elif believable:
        size = Constant(measured, "measured", seen_at)
    else:
        size = Constant(ADULT_STATURE, "assumed", f"an adult; {'seated' if options.seated else seen_at}")
    stature = size.value
    if options.floor is not None:
        floor = Constant(options.floor, "given")
    elif on_floor:
        floor = Constant(0.0, "assumed", "the origin of the recording")
    else:
        above = (SEATED_SHARE + HEAD_JOINT_SHARE - EYE_SHARE if options.seated else HEAD_JOINT_SHARE) * stature
        floor = Constant(standing(stature) - above, "measured", f"{seen_at}: the origin is not on the floor")
    derived = replace(size, why="from the eye height")
    return {
        "floor": floor,
        "eye_height": replace(size, value=eyes(stature)),
        "head_height": replace(derived, value=HEAD_JOINT_SHARE * stature),
        "stature": derived,
    }


def _warnings(sizes: dict[str, Constant[float]]) -> list[str]:
    warnings = []
    eye, floor = sizes["eye_height"], sizes["floor"]
    if eye.source == "assumed":
        warnings.append(f"eye height {eye.value:.2f} m is assumed ({eye.why}); give the eye height (--eye-height)")
    elif eye.source == "measured" and eye.value < LOW_EYE_HEIGHT:
        warnings.append(f"eye height {eye.value:.2f} m is a child's, or nobody stands in this take; give it (--eye-height) or say that they sit (--seated)")
    if floor.source == "measured":
        warnings.append(f"{floor.why}; the floor is put at {floor.value:.2f} m; give another one (--floor) if it is not there")
    return warnings
