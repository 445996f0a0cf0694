"""Fingers that touch without piercing: from wanted angles over time to the nearest ones that are free, both smooth and exact.

The networks propose free poses from what the voxels show; for each finger a path through the proposals is chosen (choice.py), which goes around
where it would leap (detour.py), and the exact step moves it along the true distances (project.py). Frames in which nothing touches stay as they are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError
from ..motion.rotations import Array
from ..progress import Job, Progress, blocks, part
from .choice import ALLOWED, chosen, cost_of_depth
from .contact import MEASURING, Probe, every_row, finger_depths, palm_depths
from .hand import ANGLES, FINGERS, Hand, finger_angles
from .model import HandModel
from .obstacle import Obstacle, over_time
from .poses import POSES
from .project import EASE, fastest_steps, held_back, may_touch, projected, pushed_out
from .sweep import wrapped

FINISHING = 12  # iterations of the last push
PUSHED = 0.0002  # metres of depth that are not left
TOLERATED = 0.0009  # metres of depth that are better than a leap
SPARE = ("flat", "spread", "relaxed", "fist")  # poses for fingers that stay inside
TOGETHER = 256  # frames that are measured between two events
PALM_INSIDE = 0.001  # metres from which the palm is called inside


@dataclass(frozen=True)
class FingerOptions:
    """`strength` 0 keeps the wanted angles, 1 is free of the obstacle. `grasp` closes fingers until they rest on it. Without `exact` the answer is
    that of the networks alone, smoothed. The same `seed` gives the same fingers."""

    strength: float = 1.0
    grasp: bool = False
    seed: int = 0
    exact: bool = True


@dataclass(frozen=True)
class FingerResult:
    """Angles [T, 20]; the depth [T] in metres of the deepest finger before and after, negative where all are free; and in which frames [T] the
    palm itself is inside, so that no finger can mend it."""

    angles: Array
    before: Array
    after: Array
    palm_inside: np.ndarray


def avoiding(
    hand: Hand,
    wrists: tuple[Array, Array],
    wanted: Array,
    obstacles: Callable[[int], Obstacle],
    rate: float,
    model: HandModel | None,
    options: FingerOptions,
) -> Job[FingerResult]:
    """Frees the fingers of one hand over time.

    wrists     world positions [T, 3] in metres and rotations [T, 4] of the wrist
    wanted     angles [T, 20]; what is beyond the hand's limits is brought within them
    obstacles  what must not be entered in each frame; asked once for a frame
    rate       frames per second
    model      the networks; without them only the stock poses and the exact step are used
    """
    wanted = np.asarray(wanted, np.float32)
    if wanted.shape != (len(wrists[0]), len(ANGLES)):
        raise InputError("wanted angles", f"have the shape {wanted.shape}; {(len(wrists[0]), len(ANGLES))} is expected, one row for each frame")
    positions, rotations = (np.asarray(values, np.float32) for values in wrists)
    probe = Probe(hand, (positions, rotations), over_time(obstacles))
    before, palm_inside = yield from part(_measured(probe, wanted), 0, 0.1)
    aim = np.clip(wanted, *hand.limits.T)
    if options.grasp:
        aim = yield from part(_grasped(probe, aim), 0.1, 0.2)
    near, blocked = may_touch(probe, aim)
    start = yield from part(chosen(probe, near, blocked, aim, rate, model, options.seed, options.exact), 0.2, 0.6)
    if options.exact:
        angles = yield from part(projected(probe, near, start, aim, rate), 0.6, 0.85)
        yield from part(_finished(probe, near, angles, aim, rate, palm_inside), 0.85, 0.95)
    else:
        angles = np.clip(aim + _smoothed(start - aim, rate), *hand.limits.T)
    angles = (aim + np.float32(options.strength) * (angles - aim)).astype(np.float32)
    after, _ = yield from part(_measured(probe, angles), 0.95, 1)
    return FingerResult(angles, before, after, palm_inside)


def _measured(probe: Probe, angles: Array) -> Job[tuple[Array, np.ndarray]]:
    """How deep the deepest finger is inside [T], and whether the palm is [T]."""
    depths, palm_inside = np.empty(len(angles), np.float32), np.empty(len(angles), bool)
    for block in blocks(len(angles), TOGETHER):
        yield Progress(block.start / len(angles), "measuring")
        wrists = probe.wrists[0][block], probe.wrists[1][block]

        def nearest(frames: np.ndarray, points: Array, first: int = block.start) -> tuple[Array, Array]:
            return probe.nearest(frames + first, points)

        depths[block] = finger_depths(probe.hand, wrists, nearest, angles[block]).max(-1)
        palm_inside[block] = palm_depths(probe.hand, wrists, nearest) > PALM_INSIDE
    return depths, palm_inside


def _grasped(probe: Probe, aim: Array) -> Job[Array]:
    closed, grasped = finger_angles(np.clip(POSES["fist"], *probe.hand.limits.T)), finger_angles(aim.copy())
    for block in blocks(len(aim), TOGETHER):
        yield Progress(block.start / len(aim), "closing the fingers")
        frames, fingers = every_row(len(aim[block]))
        frames += block.start
        grasped[frames, fingers], _ = wrapped(probe, frames, fingers, grasped[frames, fingers], closed[fingers])
    return grasped.reshape(aim.shape)


def _finished(probe: Probe, near: np.ndarray, angles: Array, aim: Array, rate: float, palm_inside: np.ndarray) -> Job[None]:
    """Pushes out what is left inside, but for what would leap and is hardly inside, or hangs on a palm that is inside."""
    probe = replace(probe, shares=MEASURING)
    frames, fingers = np.nonzero(near)
    by_finger = finger_angles(angles)
    pushed, stuck = by_finger.copy(), np.zeros(near.shape, bool)
    for block in blocks(len(frames), TOGETHER * len(FINGERS)):
        yield Progress(block.start / len(frames), "pushing out what is left")
        rows = frames[block], fingers[block]
        deep = probe.depths(*rows, by_finger[rows]).max(-1) > PUSHED
        rows = rows[0][deep], rows[1][deep]
        pushed[rows], depths = pushed_out(probe, *rows, by_finger[rows], FINISHING)
        stuck[rows] = depths > ALLOWED
    waits = held_back(probe.hand, by_finger, pushed, np.zeros(near.shape, bool), fastest_steps(probe.hand, finger_angles(aim), 1 / rate))
    by_finger[~waits] = pushed[~waits]
    held = np.nonzero(waits)
    stuck[held] = (probe.depths(*held, by_finger[held]).max(-1) > TOLERATED) & ~palm_inside[held[0]]
    _rescue(probe, *np.nonzero(stuck), angles)


def _rescue(probe: Probe, frames: np.ndarray, fingers: np.ndarray, angles: Array) -> None:
    """Gives fingers that stay inside what frees them best and leaps least: the poses of the frames around, or a stock pose."""
    if not len(frames):
        return
    by_finger = finger_angles(angles)
    around = [by_finger[np.clip(frames + shift, 0, len(angles) - 1), fingers] for shift in (0, -1, 1, -2, 2, -4, 4)]
    starts = [*around, *(finger_angles(POSES[name])[fingers] for name in SPARE)]
    rows, depths = pushed_out(probe, np.tile(frames, len(starts)), np.tile(fingers, len(starts)), np.concatenate(starts), FINISHING)
    rows = rows.reshape(len(starts), len(frames), -1)
    leaps = sum(((rows - beside) ** 2).sum(-1) for beside in around[1:3])  # from the frame before and to the one after
    costs = cost_of_depth(depths).reshape(len(starts), -1) + leaps / EASE**2
    by_finger[frames, fingers] = rows[costs.argmin(0), np.arange(len(frames))]


def _smoothed(correction: Array, rate: float) -> Array:
    """A correction [T, 20] without its jumps: the mean over a tenth of a second with falling weights."""
    reach = max(1, round(0.1 * rate))
    weights = np.hanning(2 * reach + 3)[1:-1].astype(np.float32)
    padded = np.concatenate((correction[:1].repeat(reach, 0), correction, correction[-1:].repeat(reach, 0)))
    return sum(weight * padded[i : i + len(correction)] for i, weight in enumerate(weights / weights.sum()))  # type: ignore[return-value]
