"""What the hands of a calibrated take say of its calibration: how far the arms reach, how the hands sit on them, where the floor cannot be."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..motion.rotations import Array, inverse, quat_from_yaw, rotate, yaw_from_quat
from ..motion.skeleton import STANDARD_BODY, STANDARD_STATURE
from .take import HANDS, HEAD

REACH_SLACK = 0.05  # of stature: the shoulder is only estimated, and itself moves
FARTHEST_PERCENTILE = 99  # of the distances from shoulder to wrist
LOW_REACH = 0.8  # share of samples in reach: worth a word
UNDER_FLOOR = 0.05  # metres: worth a word
HANDS_OFF_ARMS = np.radians(40)  # in a T-pose: worth a word


@dataclass(frozen=True)
class Arms:
    """share     of tracked hand samples whose wrist is within an arm of its shoulder; NaN if no hand is tracked
    farthest  distance from shoulder to wrist, percentile FARTHEST_PERCENTILE of the tracked samples; NaN too
    length    of an arm of the standard body of that stature; all metres
    """

    share: float
    farthest: float
    length: float


def measure_arms(positions: Array, rotations: Array, tracked: np.ndarray, stature: float) -> Arms:
    """Of joint poses [T, 3, 3] and [T, 3, 4], tracked bool [T, 3]. The shoulder is taken to hang below the head joint as at rest, turned
    with the head's heading."""
    rest = STANDARD_BODY.rest_positions() * stature / STANDARD_STATURE
    joint = {name: rest[STANDARD_BODY.index(name)] for name in ("Head", "LeftArm", "LeftForeArm", "LeftHand", "RightArm")}
    arm = float(np.linalg.norm(joint["LeftForeArm"] - joint["LeftArm"]) + np.linalg.norm(joint["LeftHand"] - joint["LeftForeArm"]))
    heading = quat_from_yaw(yaw_from_quat(rotations[:, HEAD]))
    from_head = np.stack((joint["LeftArm"], joint["RightArm"])) - joint["Head"]
    shoulders = positions[:, [HEAD]] + rotate(heading[:, None], from_head)
    distance = np.linalg.norm(positions[:, HANDS] - shoulders, axis=-1)[tracked[:, HANDS]]
    if not len(distance):
        return Arms(float("nan"), float("nan"), arm)
    return Arms(float(np.mean(distance <= arm + REACH_SLACK * stature)), float(np.percentile(distance, FARTHEST_PERCENTILE)), arm)


def arm_warnings(arms: Arms, positions: Array, tracked: np.ndarray, posed: Array | None) -> list[str]:
    """What is odd about the hands of joint positions [T, 3, 3] over a floor at z = 0; `posed` are the joints' rotations [N, 3, 4] in a T-pose,
    if there is one."""
    warnings = []
    if arms.share < LOW_REACH:
        warnings.append(f"an arm reaches the wrist in only {arms.share:.0%} of samples; check --device, --wrist-offset and --eye-height")
    lowest = float(np.min(positions[:, HANDS, 2], where=tracked[:, HANDS], initial=0.0))
    if lowest < -UNDER_FLOOR:
        warnings.append(f"a hand is {-lowest:.2f} m under the floor; give another floor (--floor) if it is not there")
    if posed is not None and (off := _hands_off_arms(posed)) > HANDS_OFF_ARMS:
        warnings.append(f"in the T-pose the hands point {np.degrees(off):.0f}° away from the arms; check which controllers they are (--device)")
    return warnings


def _hands_off_arms(rotations: Array) -> float:
    """The angle from the arms' direction to the fingers' in a T-pose, radians: the mean of both hands and all samples."""
    facing = quat_from_yaw(yaw_from_quat(rotations[:, HEAD]))
    fingers = rotate(inverse(facing)[:, None], rotate(rotations[:, HANDS], np.array([[1.0, 0, 0], [-1, 0, 0]])))
    return float(np.mean(np.arccos(np.clip(fingers[..., 0] * [1, -1], -1, 1))))
