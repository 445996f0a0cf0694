"""The exact step: angles moved along the true distances until nothing is inside, as little as possible and smoothly over time.

Gauss-Newton on all frames at once. The fingers do not know each other, so the equations of a finger are 4 x 4 blocks on a chain through
time, which is solved exactly in one sweep forth and back.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from ..motion.rotations import Array
from ..progress import Job, Progress
from .contact import Probe, every_row
from .hand import PHALANGES, Hand, finger_angles

CLEARANCE = 0.0003  # metres that are left between finger and surface
TOUCH = 0.001  # metres of depth that cost as much as EASE
EASE = 0.5  # radians of correction
SPEED = 3.0  # radians per second of correction that cost as much as EASE
FASTEST = 2.5  # radians per second: faster angles are held back
FASTEST_TIP = 2.8  # lengths of the hand per second, 22 mm in a frame of film: fingers that want no more do not leap further
HASTE = 12.0  # how much more they are held together for each time they are faster
LONGEST_STEP = 0.15  # radians in one iteration of the smooth projection, so that no finger gets through a thin thing
LONGEST_PUSH = 0.35  # radians in one iteration of the last push
NEAR = 0.005  # metres: fingers that are wanted farther than this from everything, and stay so for a while, are not asked again
ITERATIONS = 12  # of the smooth projection
SETTLING = 6  # iterations of the last push for what is only a candidate
ROUNDS = 2  # of each, to find which angles stop at their limits and which points come to touch
PUSH_ROUNDS = 3  # the same for the last push
OVERSHOOT = 0.0005  # metres of depth to which one iteration may bring a finger
STIFFNESS = 10.0  # of contacts in the smooth projection
DAMPING = 0.3  # of the last push
STIFF = 1e9  # what stands for an angle that is not free
STILL = 1e-4  # metres: fingers whose points moved less are where they were
WINDOW, MARGIN = 24, 12  # frames of time that are solved together, and by which they overlap

_COUNT = PHALANGES + 1
_DIAGONAL = np.arange(_COUNT)


def projected(probe: Probe, near: np.ndarray, start: Array, wanted: Array, rate: float) -> Job[Array]:
    """Angles [T, 20] within the limits, from a `start` that is all but free, that stay near `wanted` and out of the obstacle, with a correction
    that is smooth over time. What depth remains is left to `pushed_out`.

    near  bool [T, 5]: which fingers may touch; the others are not looked at
    """
    limits = finger_angles(probe.hand.limits.T).astype(np.float64)
    angles, wanted = finger_angles(start.astype(np.float64)), finger_angles(wanted.astype(np.float64))
    frames, fingers = np.nonzero(near)
    depths, slopes = probe.contacts(frames, fingers, angles[frames, fingers].astype(np.float32))
    reach = np.full(angles.shape[:2], LONGEST_STEP)
    fastest = fastest_steps(probe.hand, wanted, 1 / rate)
    levers = _levers(probe.hand)
    for iteration in range(ITERATIONS):
        yield Progress(iteration / ITERATIONS, "moving the fingers out")
        links = _links(angles, rate)
        correction = angles - wanted
        steps = np.diff(correction, axis=0) * links[..., None]
        slope, weights = correction / EASE**2, np.full((*angles.shape[:2], 1), 1 / EASE**2)
        slope[1:] += steps
        slope[:-1] -= steps
        weights[1:, :, 0] += links
        weights[:-1, :, 0] += links
        least, greatest = np.clip(limits[:, None] - angles, -reach[..., None], reach[..., None])
        counted, fixed, step = depths > 0, np.zeros(angles.shape, bool), np.zeros_like(angles)
        for _ in range(ROUNDS):
            blocks, pull = np.zeros((*angles.shape, _COUNT)), -slope
            blocks[..., _DIAGONAL, _DIAGONAL] += weights
            push, curvature = _terms(depths, slopes, counted, STIFFNESS)
            blocks[frames, fingers] += curvature
            pull[frames, fingers] += push
            step = _within(partial(_chain_solve, links=links), blocks, pull, fixed, step)
            beyond = (step < least) | (step > greatest)
            step = np.clip(step, least, greatest)
            ahead = depths + CLEARANCE > (slopes @ step[frames, fingers][..., None])[..., 0]
            if not (beyond & ~fixed).any() and not (ahead & ~counted).any():
                break
            fixed |= beyond
            counted = counted | ahead
        moved = angles + step
        yield Progress((iteration + 0.5) / ITERATIONS, "moving the fingers out")
        # Only those are asked again that moved, and that may have come to touch.
        way = (np.abs(step) * levers).sum(-1)[frames, fingers]
        asked = np.flatnonzero((way > STILL) & (depths.max(-1) + way > -CLEARANCE))
        new_depths, new_slopes = depths + way[:, None], slopes.copy()
        new_depths[asked], new_slopes[asked] = probe.contacts(frames[asked], fingers[asked], moved[frames[asked], fingers[asked]].astype(np.float32))
        # A finger that a step brings deeper than it was, or from which it leaps, waits for a shorter one: what was free does not tunnel through
        # to the other side, neither in one frame nor between two.
        waits = np.zeros(near.shape, bool)
        waits[frames, fingers] = new_depths.max(-1) > np.maximum(depths.max(-1), OVERSHOOT)
        waits = held_back(probe.hand, angles, moved, waits, fastest)
        moved[waits] = angles[waits]
        waiting = waits[frames, fingers]
        reach[frames, fingers] = np.where(waiting, reach[frames, fingers] * 0.4, np.minimum(reach[frames, fingers] * 1.5, LONGEST_STEP))
        depths = np.where(waiting[:, None], depths, new_depths)
        slopes = np.where(waiting[:, None, None], slopes, new_slopes)
        angles = moved
    return angles.reshape(len(angles), -1).astype(np.float32)


def _levers(hand: Hand) -> Array:
    """How far away from each joint of a finger its points are at most [5, 4], metres; the last is the spread's."""
    lengths = np.linalg.norm(np.diff(hand.chains(finger_angles(hand.rest_angles)), axis=-2), axis=-1)
    reach = np.cumsum(lengths[:, ::-1], -1)[:, ::-1]
    return np.concatenate((reach, reach[:, :1]), -1)


def _tips(hand: Hand, angles: Array) -> Array:
    return hand.chains(angles)[..., -1, :]


def _apart(tips: Array) -> Array:
    return np.linalg.norm(np.diff(tips, axis=0), axis=-1)


def tip_steps(hand: Hand, angles: Array) -> Array:
    """How far fingertips move in the palm [T - 1, 5], metres, at angles [T, 5, 4]."""
    return _apart(_tips(hand, angles))


def fastest_steps(hand: Hand, wanted: Array, seconds: float) -> Array:
    """How far tips may move [T - 1, 5] from one to the next of wanted angles [T, 5, 4], which are some seconds apart."""
    return np.maximum(FASTEST_TIP * hand.length * seconds, tip_steps(hand, wanted))


def held_back(hand: Hand, angles: Array, moved: Array, waits: np.ndarray, fastest: Array) -> np.ndarray:
    """Which fingers [T, 5] must wait besides those that do: those that go from angles [T, 5, 4] to others where they leap more than they did."""
    before, after = _tips(hand, angles), _tips(hand, moved)
    limits = np.maximum(fastest, _apart(before)) + 1e-6
    while True:
        fast = _apart(np.where(waits[..., None], before, after)) > limits
        more = waits.copy()
        more[1:] |= fast
        more[:-1] |= fast
        if (more == waits).all():
            return waits
        waits = more


def may_touch(probe: Probe, angles: Array) -> tuple[np.ndarray, np.ndarray]:
    """Two times bool [T, 5]: which fingers are NEAR something at these angles [T, 20], or are so within MARGIN frames; and which of them have to
    move, or have to within half of that."""
    frames, fingers = every_row(len(angles))
    depths = probe.depths(frames, fingers, finger_angles(angles)[frames, fingers]).max(-1).reshape(len(angles), -1)
    return _widened(depths > -NEAR, MARGIN), _widened(depths > -CLEARANCE, MARGIN // 2)


def _widened(mask: np.ndarray, reach: int) -> np.ndarray:
    """Where [T, 5] a mask is set within `reach` frames."""
    padded = np.concatenate((np.zeros((reach + 1, mask.shape[1]), int), np.cumsum(mask, 0)), 0)
    padded = np.concatenate((padded, padded[-1:].repeat(reach, 0)))
    return padded[2 * reach + 1 :] > padded[: -2 * reach - 1]


def pushed_out(probe: Probe, frames: np.ndarray, fingers: np.ndarray, start: Array, iterations: int) -> tuple[Array, Array]:
    """Rows of angles [R, 4] from `start`, each moved by the least turns that leave nothing inside, as far as the limits allow, and how deep
    their deepest points then are [R] (of rows that were never inside, a bound)."""
    limits = finger_angles(probe.hand.limits.T).astype(np.float64)[:, fingers]
    angles, rows = np.clip(start.astype(np.float64), *limits), np.arange(len(start))
    deepest = np.full(len(start), -CLEARANCE)
    for iteration in range(iterations + 1):
        depths, slopes = probe.contacts(frames[rows], fingers[rows], angles[rows].astype(np.float32))
        deepest[rows] = depths.max(-1)
        inside = deepest[rows] > -CLEARANCE / 2
        rows = rows[inside]
        if not len(rows) or iteration == iterations:
            break
        push, blocks = _terms(depths[inside], slopes[inside], depths[inside] > -CLEARANCE, 1.0)
        blocks[..., _DIAGONAL, _DIAGONAL] += DAMPING
        room = np.clip(limits[:, rows] - angles[rows], -LONGEST_PUSH, LONGEST_PUSH)
        step, fixed = np.zeros_like(push), np.zeros(push.shape, bool)
        for _ in range(PUSH_ROUNDS):
            step = _within(_solve, blocks, push, fixed, step)
            beyond = (step < room[0]) | (step > room[1])
            step = np.clip(step, *room)
            if not beyond.any():
                break
            fixed |= beyond
        angles[rows] += step
    return angles.astype(np.float32), deepest.astype(np.float32)


def _terms(depths: Array, slopes: Array, counted: np.ndarray, stiffness: float) -> tuple[Array, Array]:
    """Push [R, 4] and curvature [R, 4, 4] of half the stiffness times the squared depths (in TOUCHes) of the points that are counted."""
    slopes = np.where(counted[..., None], slopes, 0).astype(np.float64) / TOUCH
    transposed = np.swapaxes(slopes, -1, -2) * stiffness
    return (transposed @ ((depths + CLEARANCE) / TOUCH)[..., None])[..., 0], transposed @ slopes


def _within(solve: Callable[[Array, Array], Array], blocks: Array, pull: Array, fixed: np.ndarray, step: Array) -> Array:
    """The step that solves blocks @ step = pull, but for the angles whose step is `fixed`."""
    free = ~fixed
    known = np.where(fixed, step, 0)
    reduced = np.where(free[..., :, None] & free[..., None, :], blocks, np.eye(_COUNT) * STIFF)
    return solve(reduced, np.where(fixed, STIFF * step, pull - (blocks @ known[..., None])[..., 0]))


def _solve(blocks: Array, pull: Array) -> Array:
    return np.linalg.solve(blocks, pull[..., None])[..., 0]


def _links(angles: Array, rate: float) -> Array:
    """How stiffly the corrections of neighbouring frames are held together [T - 1, 5]: more where a finger is faster than a hand can be."""
    fastest = np.abs(np.diff(angles, axis=0)).max(-1) * rate
    return (rate / SPEED) ** 2 * (1 + HASTE * np.maximum(fastest / FASTEST - 1, 0))


def _chain_solve(blocks: Array, right: Array, links: Array) -> Array:
    """x [T, 5, 4] with blocks[t] x[t] - links[t-1] x[t-1] - links[t] x[t+1] = right[t].

    Block elimination forth and back, on windows of time that overlap by MARGIN and are solved side by side: what is farther away than that
    hardly counts, and the next Gauss-Newton iteration corrects it.
    """
    count = len(blocks)
    starts = np.arange(0, count, WINDOW)
    windows = starts + np.arange(-MARGIN, WINDOW + MARGIN)[:, None]  # [L, W], time first
    outside = (windows < 0) | (windows >= count)
    windows = np.clip(windows, 0, count - 1)
    padded = np.concatenate((links, np.zeros((1, *links.shape[1:]))))
    ahead = np.where((outside[:-1] | outside[1:])[..., None], 0, padded[windows[:-1]])
    solved = _eliminate(blocks[windows], right[windows], ahead)
    return solved[MARGIN : MARGIN + WINDOW].swapaxes(0, 1).reshape(-1, *right.shape[1:])[:count]


def _eliminate(blocks: Array, right: Array, links: Array) -> Array:
    """The same for chains side by side: blocks [L, ..., 4, 4], right [L, ..., 4], links [L - 1, ...]."""
    inverses, carried = np.empty_like(blocks), np.empty_like(right)
    inverses[0], carried[0] = np.linalg.inv(blocks[0]), right[0]
    for t in range(1, len(blocks)):
        link = links[t - 1][..., None]
        carried[t] = right[t] + link * (inverses[t - 1] @ carried[t - 1][..., None])[..., 0]
        inverses[t] = np.linalg.inv(blocks[t] - (link**2)[..., None] * inverses[t - 1])
    solved = np.empty_like(right)
    solved[-1] = (inverses[-1] @ carried[-1][..., None])[..., 0]
    for t in range(len(blocks) - 2, -1, -1):
        solved[t] = (inverses[t] @ (carried[t] + links[t][..., None] * solved[t + 1])[..., None])[..., 0]
    return solved
