"""The exact step: angles moved along the true distances until nothing is inside, as little as possible and smoothly over time.

Gauss-Newton on all frames at once. The fingers do not know each other, so the equations of a finger are 4 x 4 blocks on a chain through
time, which is solved exactly in one sweep forth and back.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from ..motion.rotations import Array
from .contact import Probe, every_row
from .hand import PHALANGES, finger_angles

CLEARANCE = 0.0003  # metres that are left between finger and surface
TOUCH = 0.001  # metres of depth that cost as much as EASE
EASE = 0.5  # radians of correction
SPEED = 3.0  # radians per second of correction that cost as much as EASE
FASTEST = 2.5  # radians per second: faster angles are held back
HASTE = 12.0  # how much more they are held together for each time they are faster
LONGEST_STEP = 0.15  # radians in one iteration of the smooth projection, so that no finger gets through a thin thing
LONGEST_PUSH = 0.35  # radians in one iteration of the last push
NEAR = 0.005  # metres: fingers that are wanted farther than this from everything, and stay so for a while, are not asked again
ITERATIONS = 12  # of the smooth projection
ROUNDS = 3  # of each, to find which angles stop at their limits and which points come to touch
OVERSHOOT = 0.001  # metres of depth to which one iteration may bring a finger
STIFFNESS = 20.0  # of contacts in the smooth projection
DAMPING = 0.3  # of the last push
STIFF = 1e9  # what stands for an angle that is not free
WINDOW, MARGIN = 24, 12  # frames of time that are solved together, and by which they overlap

_COUNT = PHALANGES + 1
_DIAGONAL = np.arange(_COUNT)


def projected(probe: Probe, near: np.ndarray, start: Array, wanted: Array, rate: float) -> Array:
    """Angles [T, 20] within the limits, from a `start` that is all but free, that stay near `wanted` and out of the obstacle, with a correction
    that is smooth over time. What depth remains is left to `pushed_out`.

    near  bool [T, 5]: which fingers may touch; the others are not looked at
    """
    limits = finger_angles(probe.hand.limits.T).astype(np.float64)
    angles, wanted = finger_angles(start.astype(np.float64)), finger_angles(wanted.astype(np.float64))
    frames, fingers = np.nonzero(near)
    depths, slopes = probe.contacts(frames, fingers, angles[frames, fingers].astype(np.float32))
    reach = np.full(angles.shape[:2], LONGEST_STEP)
    for _ in range(ITERATIONS):
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
        new_depths, new_slopes = probe.contacts(frames, fingers, moved[frames, fingers].astype(np.float32))
        # A finger that a step brings deeper than it was waits for a shorter one: what was free does not tunnel through to the other side.
        deeper = new_depths.max(-1) > np.maximum(depths.max(-1), OVERSHOOT)
        moved[frames[deeper], fingers[deeper]] = angles[frames[deeper], fingers[deeper]]
        reach[frames, fingers] = np.where(deeper, reach[frames, fingers] * 0.4, np.minimum(reach[frames, fingers] * 1.5, LONGEST_STEP))
        depths = np.where(deeper[:, None], depths, new_depths)
        slopes = np.where(deeper[:, None, None], slopes, new_slopes)
        angles = moved
    return angles.reshape(len(angles), -1).astype(np.float32)


def may_touch(probe: Probe, angles: Array) -> np.ndarray:
    """bool [T, 5]: which fingers are NEAR something at these angles [T, 20], or are so within MARGIN frames."""
    frames, fingers = every_row(len(angles))
    near = probe.depths(frames, fingers, finger_angles(angles)[frames, fingers]).max(-1).reshape(len(angles), -1) > -NEAR
    padded = np.concatenate((np.zeros((MARGIN + 1, near.shape[1]), int), np.cumsum(near, 0)), 0)
    padded = np.concatenate((padded, padded[-1:].repeat(MARGIN, 0)))
    return padded[2 * MARGIN + 1 :] > padded[: -2 * MARGIN - 1]


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
        for _ in range(ROUNDS):
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
