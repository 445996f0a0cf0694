"""Fingers that touch without piercing: from wanted angles over time to the nearest ones that are free, both smooth and exact.

The networks propose free poses from what the voxels show, several to a frame; for each finger the cheapest path through the proposals
is chosen (path.py), and the exact step moves it along the true distances (project.py). Frames in which nothing touches stay as they are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..motion.rotations import Array
from ..progress import Job, Progress
from .contact import Probe, every_row, finger_depths, palm_depths
from .hand import ANGLES, FINGERS, Hand, finger_angles
from .model import HandModel
from .obstacle import Obstacle, over_time
from .path import cheapest_path
from .poses import POSES
from .project import EASE, SPEED, may_touch, projected, pushed_out
from .sensor import sense, wanted_places
from .sweep import wrapped

CANDIDATES = 4  # of the networks
STOCK = ("flat", "spread", "relaxed", "fist")  # poses that are always candidates too
SETTLING = 6  # iterations of the exact step for each candidate, before one is chosen
DETOURS = 30  # times that the path is sought again
LEAP = 0.35  # radians between two frames
FINISHING = 12  # iterations for the one that was chosen
PERSISTENCE = 1.0  # how much dearer a step is in the choice than in the exact step
ALLOWED = 0.0004  # metres of depth that do not count in the choice
DEAR = 0.0002  # metres of more depth that cost as much as EASE
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
    wrists = tuple(np.asarray(part, np.float32) for part in wrists)  # type: ignore[assignment]
    nearest = over_time(obstacles)
    probe = Probe(hand, wrists, nearest)
    yield Progress(0, "measuring")
    palm_inside = palm_depths(hand, wrists, nearest) > PALM_INSIDE
    before = finger_depths(hand, wrists, nearest, wanted).max(-1)
    aim = np.clip(wanted, *hand.limits.T)
    if options.grasp:
        yield Progress(0.1, "closing the fingers")
        aim = _grasped(probe, aim)
    yield Progress(0.2, "looking for ways out")
    near = may_touch(probe, aim)
    start = _chosen(probe, near, aim, rate, model, options)
    if options.exact:
        yield Progress(0.6, "moving the fingers out")
        angles = projected(probe, near, start, aim, rate)
        frames, fingers = np.nonzero(near)
        rows, depths = pushed_out(probe, frames, fingers, finger_angles(angles)[frames, fingers], FINISHING)
        finger_angles(angles)[frames, fingers] = rows
        stuck = depths > ALLOWED
        _rescue(probe, frames[stuck], fingers[stuck], angles)
    else:
        angles = np.clip(aim + _smoothed(start - aim, rate), *hand.limits.T)
    angles = (aim + np.float32(options.strength) * (angles - aim)).astype(np.float32)
    yield Progress(0.95, "measuring")
    return FingerResult(angles, before, finger_depths(hand, wrists, nearest, angles).max(-1), palm_inside)


def _grasped(probe: Probe, aim: Array) -> Array:
    frames, fingers = every_row(len(aim))
    closed = np.clip(POSES["fist"], *probe.hand.limits.T)
    rows, _ = wrapped(probe, frames, fingers, finger_angles(aim)[frames, fingers], finger_angles(closed)[fingers])
    return rows.reshape(aim.shape)


def _chosen(probe: Probe, near: np.ndarray, aim: Array, rate: float, model: HandModel | None, options: FingerOptions) -> Array:
    """Angles [T, 20]: what each finger wants where that is free, and elsewhere the cheapest path through the candidates."""
    by_finger = finger_angles(aim)
    frames, fingers = np.nonzero(near)
    if not len(frames):
        return aim
    poses = np.array([POSES[name] for name in STOCK])
    candidates = [by_finger[frames, fingers], *(finger_angles(pose)[fingers] for pose in np.clip(poses, *probe.hand.limits.T))]
    if model:
        needed, places = np.unique(frames, return_inverse=True)
        occupancy = sense(model.grid, probe.hand, probe.wrists, probe.nearest, needed)
        proposals = model.propose(occupancy, wanted_places(probe.hand, probe.hand.positions(aim[needed])), CANDIDATES, options.seed)
        candidates += list(finger_angles(np.clip(proposals, *probe.hand.limits.T))[:, places, fingers])
        if not options.exact:
            del candidates[1 : 1 + len(STOCK)]
    count = len(candidates)
    rows = np.concatenate(candidates).astype(np.float32)
    rows, depths = pushed_out(probe, np.tile(frames, count), np.tile(fingers, count), rows, SETTLING if options.exact else 0)
    options_of_row = rows.reshape(count, len(frames), -1)
    change = ((options_of_row - by_finger[frames, fingers]) ** 2).sum(-1) / EASE**2
    costs = np.full((len(aim), len(FINGERS), count), np.inf, np.float32)
    costs[..., 0] = 0
    costs[frames, fingers] = (_cost_of_depth(depths).reshape(count, -1) + change).T
    places = np.repeat(by_finger[:, :, None], count, 2)
    places[frames, fingers] = np.swapaxes(options_of_row, 0, 1)
    detours = DETOURS if options.exact else 1
    return _shortest(probe, costs, places, by_finger, PERSISTENCE * (rate / SPEED) ** 2, detours).reshape(aim.shape)


def _shortest(probe: Probe, costs: Array, places: Array, by_finger: Array, stiffness: float, detours: int) -> Array:
    """The angles [T, 5, 4] on the cheapest path through candidates [T, 5, C, 4]. Where it leaps between two of them, what is half-way is looked
    at, and if that is inside, the leap costs accordingly and another path is sought: one that waits until the way is clear."""
    steps = (places - by_finger[:, :, None]).astype(np.float32)
    transitions = ((steps[1:, :, None] - steps[:-1, :, :, None]) ** 2).sum(-1) * np.float32(stiffness)
    seen, path = np.zeros(transitions.shape, bool), by_finger
    for _ in range(detours):
        chosen = cheapest_path(costs, transitions)
        path = np.take_along_axis(places, chosen[..., None, None], 2)[:, :, 0]
        frames, fingers = np.nonzero(np.abs(np.diff(path, axis=0)).max(-1) > LEAP)
        leaps = frames, fingers, chosen[frames, fingers], chosen[frames + 1, fingers]
        new = ~seen[leaps]
        if not new.any():
            break
        frames, fingers, *_ = leaps = tuple(index[new] for index in leaps)
        start, end = path[frames, fingers], path[frames + 1, fingers]
        between = np.concatenate([start + share * (end - start) for share in (0.1, 0.3, 0.5, 0.7, 0.9)] * 2).astype(np.float32)
        at = np.concatenate([np.tile(frames, 5), np.tile(frames + 1, 5)])
        depths = probe.depths(at, np.tile(fingers, 10), between).max(-1).reshape(10, -1).max(0)
        transitions[leaps] += _cost_of_depth(depths)
        seen[leaps] = True
    return path


def _rescue(probe: Probe, frames: np.ndarray, fingers: np.ndarray, angles: Array) -> None:
    """Gives fingers that stay inside what frees them best and leaps least: the poses of the frames around, or a stock pose."""
    if not len(frames):
        return
    by_finger = finger_angles(angles)
    around = [by_finger[np.clip(frames + shift, 0, len(angles) - 1), fingers] for shift in (0, -1, 1, -2, 2, -4, 4)]
    starts = [*around, *(finger_angles(POSES[name])[fingers] for name in STOCK)]
    rows, depths = pushed_out(probe, np.tile(frames, len(starts)), np.tile(fingers, len(starts)), np.concatenate(starts), FINISHING)
    rows = rows.reshape(len(starts), len(frames), -1)
    leaps = sum(((rows - beside) ** 2).sum(-1) for beside in around[1:3])  # from the frame before and to the one after
    costs = _cost_of_depth(depths).reshape(len(starts), -1) + leaps / EASE**2
    by_finger[frames, fingers] = rows[costs.argmin(0), np.arange(len(frames))]


def _cost_of_depth(depths: Array) -> Array:
    return np.minimum((np.maximum(depths - ALLOWED, 0) / DEAR) ** 2, 1e4)


def _smoothed(correction: Array, rate: float) -> Array:
    """A correction [T, 20] without its jumps: the mean over a tenth of a second with falling weights."""
    reach = max(1, round(0.1 * rate))
    weights = np.hanning(2 * reach + 3)[1:-1].astype(np.float32)
    padded = np.concatenate((correction[:1].repeat(reach, 0), correction, correction[-1:].repeat(reach, 0)))
    return sum(weight * padded[i : i + len(correction)] for i, weight in enumerate(weights / weights.sum()))  # type: ignore[return-value]
