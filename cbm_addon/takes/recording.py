"""From the rows of a file to a take: decides the constants, converts once, and finds, repairs or reports what is wrong."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ..errors import InputError
from ..motion.rotations import Array, continuous, normalize
from .cleaning import FASTEST_HAND, joined, spikes, teleports
from .frames import AXES, METRES, to_engine
from .measure import hands_swapped, head_tilted, measure_axes, measure_unit
from .take import DEVICES, HANDS, HEAD, Constant, Defect, Take, TakeReport

FARTHEST_HAND = 1.5  # metres from the headset: beyond it a controller is no longer in a hand
RATES = (15.0, 150.0)  # samples per second of the headsets that exist
GAP = 0.25  # seconds without a sample
LONGEST = 24 * 3600.0  # seconds
SURE = 0.5  # confidence in measured axes, below which the user is told
TILTED = 0.1  # share of samples with the head leant to its side, above which its rotations are not believed
HEADSET_HEIGHT = (0.5, 2.5)  # metres, median, when the origin is on the floor


ROTATION_ORDERS = ("XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX")


@dataclass(frozen=True)
class TakeOverrides:
    """What the user knows better than the measurements. None: measure.

    unit            a key of METRES
    axes            a key of AXES
    swap_hands      True: the file's left is the right hand; False: it is not, whatever is measured
    rate            samples per second (median): the times are stretched to it
    rotation_order  of Euler angles, one of ROTATION_ORDERS (intrinsic)
    keep_outliers   True: samples that no hand or head can have reached stay
    join_teleports  True: after a jump of the whole tracking space the take goes on where it was
    head, left, right  names of the objects, bones or joints, in files that hold many
    """

    unit: str | None = None
    axes: str | None = None
    swap_hands: bool | None = None
    rate: float | None = None
    rotation_order: str | None = None
    keep_outliers: bool = False
    join_teleports: bool = False
    head: str | None = None
    left: str | None = None
    right: str | None = None


@dataclass(frozen=True)
class Recording:
    """The rows of a file as they stand there, in its own axes and unit; NaN where the file says nothing.

    times      float64 [T], seconds from any origin
    positions  float64 [T, 3, 3], rotations float64 [T, 3, 4] w x y z of any length
    axes, unit set by the format, or None: to be measured
    likely_axes  what to measure among
    usual_axes  what the format nearly always has: anything else is told
    constants  what the reader itself decided, for example the meaning of a time column
    defects    what the reader itself found
    """

    format: str
    times: np.ndarray
    positions: Array
    rotations: Array
    kind: Literal["device", "joint"] = "device"
    extras: dict[str, Array] = field(default_factory=dict)
    axes: str | None = None
    unit: str | None = None
    likely_axes: tuple[str, ...] = ("openxr", "unity", "zup", "unreal", "engine")
    usual_axes: str | None = None
    origin: dict[str, str] = field(default_factory=dict)
    constants: dict[str, Constant[Any]] = field(default_factory=dict)
    defects: tuple[Defect, ...] = ()


class _Defects(list[Defect]):
    def note(self, kind: str, count: int | np.integer, message: str) -> None:
        """Notes a defect of `count` samples, if any; `message` may name {count}."""
        if count:
            self.append(Defect(kind, int(count), message.format(count=int(count))))


def take_from(recording: Recording, path: Path, overrides: TakeOverrides) -> Take:
    """The take in a recording; InputError when no take can be made of it."""
    defects = _Defects(recording.defects)
    tracked = _tracked(recording, defects)
    rows = _usable_rows(recording.times, tracked[:, HEAD], path, defects)
    times, tracked = recording.times[rows] - recording.times[rows[0]], tracked[rows]
    constants = dict(recording.constants)
    if overrides.rate is not None:
        times = times / np.median(np.diff(times)) / overrides.rate
        constants["time"] = Constant(f"{overrides.rate:g} samples a second", "given")
    _check_length(times, path)
    positions = np.where(tracked[..., None], recording.positions[rows], np.nan)
    rotations = np.where(tracked[..., None], normalize(recording.rotations[rows]), np.nan)
    _count_flips(rotations, tracked, defects)

    unit = _unit(recording, positions, overrides, path)
    positions = positions * METRES[unit.value]
    axes = _axes(recording, positions, rotations, overrides, defects)
    positions, rotations = to_engine(positions, rotations, axes.value)
    _doubt_rotations(positions, rotations, axes, path, defects)
    swapped = _swap(positions, rotations, overrides, defects)
    if swapped.value:
        order = [0, 2, 1]
        positions, rotations, tracked = positions[:, order], rotations[:, order], tracked[:, order]

    if not overrides.keep_outliers:
        tracked = _without_outliers(times, positions, rotations, tracked, defects)
    positions, rotations = (np.where(tracked[..., None], values, np.nan) for values in (positions, rotations))
    positions, rotations = _teleports(times, positions, rotations, tracked, overrides, defects)
    rotations = _continuous(rotations, tracked)
    _notice(times, positions, tracked, defects)

    return Take(
        name=path.stem,
        times=times,
        positions=positions.astype(np.float32),
        rotations=rotations.astype(np.float32),
        tracked=tracked,
        kind=recording.kind,
        extras={name: values[rows].astype(np.float32) for name, values in recording.extras.items()},
        report=TakeReport(
            recording.format, len(recording.times), recording.origin, {"axes": axes, "unit": unit, "swap_hands": swapped, **constants}, tuple(defects)
        ),
    )


def _tracked(recording: Recording, defects: _Defects) -> np.ndarray:
    """Bool [T, 3]: position and rotation are there and the rotation is one."""
    length = np.linalg.norm(recording.rotations, axis=-1)
    finite = np.isfinite(recording.positions).all(-1) & np.isfinite(length)
    zero = finite & (length < 1e-6)
    defects.note("zero_quaternion", zero.sum(), "poses whose quaternion is zero, taken as not tracked: {count}")
    off = finite & ~zero & (np.abs(length - 1) > 0.05)
    defects.note("quaternion_length", off.sum(), "quaternions more than 5 % away from unit length, normalised: {count}")
    return finite & ~zero


def _usable_rows(times: np.ndarray, head_tracked: np.ndarray, path: Path, defects: _Defects) -> np.ndarray:
    """Indices of rows whose times increase, from the first to the last where the head is tracked."""
    if not head_tracked.any():
        raise InputError(path, "the headset is tracked in no row; a take needs at least the head")
    first, last = np.flatnonzero(head_tracked)[[0, -1]]
    rows = np.arange(first, last + 1)
    defects.note("no_head_at_ends", len(times) - len(rows), "rows before the first or after the last pose of the head, left out: {count}")

    timed = np.isfinite(times[rows])
    defects.note("no_time", (~timed).sum(), "rows without a time, left out: {count}")
    rows = rows[timed]
    latest = np.maximum.accumulate(times[rows])
    backward = times[rows] < latest
    if backward.sum() > len(rows) / 2:
        raise InputError(path, f"times run backward in {backward.sum()} of {len(rows)} rows; they must be seconds or milliseconds since the start")
    defects.note("backward_time", backward.sum(), "rows with a time before that of an earlier row, left out: {count}")
    rows = rows[~backward]
    repeated = np.zeros(len(rows), dtype=bool)
    repeated[:-1] = np.diff(times[rows]) == 0
    defects.note("duplicate_time", repeated.sum(), "rows with the time of the next row, left out: {count}")
    rows = rows[~repeated]
    if len(rows) < 2:
        raise InputError(path, f"has {len(rows)} usable samples; a take needs at least 2")
    return rows


def _check_length(times: np.ndarray, path: Path) -> None:
    if times[-1] > LONGEST:
        raise InputError(path, f"lasts {times[-1] / 3600:.0f} hours; are its times in the unit that they claim? Give the rate (--rate)")


def check_rate(times: np.ndarray, path: Path) -> None:
    """InputError if samples come faster than from any headset: for formats whose times are known to be wrong at times."""
    rate = 1 / np.nanmedian(np.diff(times)) if len(times) > 1 else 0.0
    if rate > RATES[1]:
        raise InputError(path, f"{rate:.0f} samples a second are more than any headset gives: is its unit of time another one? Give the rate (--rate)")


def _unit(recording: Recording, positions: Array, overrides: TakeOverrides, path: Path) -> Constant[str]:
    if overrides.unit:
        return Constant(overrides.unit, "given")
    if recording.unit:
        return Constant(recording.unit, "format")
    unit = measure_unit(positions, up=int(np.argmax(AXES[overrides.axes or recording.axes or recording.likely_axes[0]][2])))
    if unit is None:
        distance = np.nanmedian(np.linalg.norm(positions[:, HANDS] - positions[:, [HEAD]], axis=-1))
        raise InputError(path, f"no unit fits a human: the hands are {distance:.4g} from the head; give the unit (--unit m, cm or mm)")
    return unit


def _axes(recording: Recording, positions: Array, rotations: Array, overrides: TakeOverrides, defects: _Defects) -> Constant[str]:
    if overrides.axes:
        return Constant(overrides.axes, "given")
    if recording.axes == "engine":
        return Constant("engine", "format")
    measured = measure_axes(positions, rotations, ("openxr", "unity") if recording.axes else recording.likely_axes)
    sure = (measured.confidence or 0) > SURE
    if recording.axes is None:
        defects.note("axes_uncertain", len(positions) * (not sure), f"axes are uncertain ({measured.why}): look at the result, or give the axes (--axes)")
        unusual = sure and recording.usual_axes not in (None, measured.value)
        message = f"{measured.value} axes, where {recording.usual_axes} is usual: converted from what was measured; if that is wrong, give the axes (--axes)"
        defects.note("axes_unusual", len(positions) * unusual, message)
        return measured
    doubt = sure and measured.value != recording.axes
    defects.note("axes_unlikely", len(positions) * doubt, f"{recording.axes} axes are unlikely; in {measured.value} axes: {measured.why}")
    return Constant(recording.axes, "format")


def _doubt_rotations(positions: Array, rotations: Array, axes: Constant[str], path: Path, defects: _Defects) -> None:
    """InputError if the head leans as no head does, unless somebody vouches for the axes: then it is only noted."""
    tilted = head_tilted(positions, rotations)
    message = f"the head leans far to its side in {tilted:.0%} of samples: components of its rotations are exchanged, or Euler angles in another order"
    if tilted > TILTED and axes.source == "measured":
        raise InputError(path, f"{message}; export it again, or vouch for it by giving its axes (--axes)")
    defects.note("head_tilted", len(positions) * (tilted > TILTED), message)


def _swap(positions: Array, rotations: Array, overrides: TakeOverrides, defects: _Defects) -> Constant[bool]:
    if overrides.swap_hands is not None:
        return Constant(overrides.swap_hands, "given")
    swapped = hands_swapped(positions, rotations)
    if swapped.value:
        defects.note("hands_swapped", len(positions), f"{swapped.why}: hands exchanged; to keep them, say so (--no-swap-hands)")
    return swapped


def _without_outliers(times: np.ndarray, positions: Array, rotations: Array, tracked: np.ndarray, defects: _Defects) -> np.ndarray:
    """Bool [T, 3]: tracked, and where a hand or head can be."""
    out_of_reach = np.linalg.norm(positions - positions[:, [HEAD]], axis=-1) > FARTHEST_HAND
    defects.note("out_of_reach", out_of_reach.sum(), f"hand samples over {FARTHEST_HAND} m from the headset, taken as not tracked: {{count}}")
    tracked = tracked & ~out_of_reach
    sudden = spikes(times, positions, rotations, tracked)
    defects.note("spike", sudden.sum(), "samples that jump away and back faster than anybody can, taken as not tracked: {count}")
    return tracked & ~sudden


def _teleports(times: np.ndarray, positions: Array, rotations: Array, tracked: np.ndarray, overrides: TakeOverrides, defects: _Defects) -> tuple[Array, Array]:
    jumps = teleports(times, positions, rotations, tracked)
    what = "joined" if overrides.join_teleports else "kept; to go on where the head was, join them (--join-teleports)"
    defects.note("teleport", len(jumps), f"sudden jumps or turns of the head that stay: {{count}}, {what}")
    return joined(positions, rotations, tracked, jumps) if overrides.join_teleports else (positions, rotations)


def _count_flips(rotations: Array, tracked: np.ndarray, defects: _Defects) -> None:
    seen = [rotations[tracked[:, device], device] for device in range(len(DEVICES))]
    flips = sum(int(np.sum(np.sum(q[1:] * q[:-1], axis=-1) < 0)) for q in seen)
    defects.note("sign_flip", flips, "quaternion sign flips, made continuous: {count}")


def _continuous(rotations: Array, tracked: np.ndarray) -> Array:
    """Signs chosen along each device's own tracked samples."""
    rotations = rotations.copy()
    for device in range(len(DEVICES)):
        rotations[tracked[:, device], device] = continuous(rotations[tracked[:, device], device])
    return rotations


def _notice(times: np.ndarray, positions: Array, tracked: np.ndarray, defects: _Defects) -> None:
    """What is worth knowing but is left as it is."""
    steps = np.diff(times)
    rate = 1 / np.median(steps)
    unusual = not RATES[0] <= rate <= RATES[1]
    defects.note("implausible_rate", len(times) * unusual, f"{rate:.0f} samples a second are unusual: is the time unit right? If not, give the rate (--rate)")
    defects.note("gap", (steps > GAP).sum(), f"gaps without samples: {{count}}, the longest {steps.max():.2f} s")
    for device, name in enumerate(DEVICES):
        defects.note(f"{name}_lost", (~tracked[:, device]).sum(), f"{name} not tracked in {np.mean(~tracked[:, device]):.1%} of samples")
    speed = np.linalg.norm(np.diff(positions, axis=0), axis=-1) / steps[:, None]
    fastest = np.nanmax(speed, initial=0)
    defects.note("hand_jump", (speed > FASTEST_HAND).sum(), f"steps faster than {FASTEST_HAND:.0f} m/s: {{count}}, the fastest {fastest:.0f} m/s")
    height = np.nanmedian(positions[:, HEAD, 2])
    off_floor = not HEADSET_HEIGHT[0] <= height <= HEADSET_HEIGHT[1]
    defects.note("origin_off_floor", len(times) * off_floor, f"median head height {height:.2f} m: the origin is not on the floor")
