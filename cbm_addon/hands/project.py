"""The exact step: angles moved along the true distances until nothing is inside, as little as possible and smoothly over time.

Gauss-Newton on all frames at once. The fingers do not know each other, so the equations of a finger are 4 x 4 blocks on a chain through
time, which is solved exactly in one sweep forth and back.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..motion.rotations import Array
from .contact import Probe, every_row
from .hand import FINGERS, PHALANGES, finger_angles

CLEARANCE = 0.0003  # metres that are left between finger and surface
TOUCH = 0.001  # metres of depth that cost as much as EASE
EASE = 0.5  # radians of correction
SPEED = 3.0  # radians per second of correction that cost as much as EASE
LONGEST_STEP = 0.35  # radians in one iteration
NEAR = 0.03  # metres: fingers farther than this from everything are not asked again
BOUNDING = 3  # rounds in which steps are brought within the limits
STIFF = 1e9  # what stands for an angle that is not free
STIFFNESS = (0.3, 0.3, 0.3, 1, 1, 1, 3, 3, 3, 10, 10, 10)  # of contacts, by iteration

_COUNT = PHALANGES + 1
_DIAGONAL = np.arange(_COUNT)


def projected(probe: Probe, start: Array, wanted: Array, rate: float, weights: Array | None = None) -> Array:
    """Angles [T, 20] within the limits, from `start`, that stay near `wanted` and out of the obstacle, with a correction that is smooth over
    time. What depth remains is left to `pushed_out`."""
    limits = finger_angles(probe.hand.limits.T).astype(np.float64)
    angles, wanted = finger_angles(start.astype(np.float64)), finger_angles(wanted.astype(np.float64))
    frames, fingers = every_row(len(angles))
    speed = (rate / SPEED) ** 2
    for iteration, stiffness in enumerate(STIFFNESS):
        correction = angles - wanted
        blocks, slope = np.zeros((*angles.shape, _COUNT)), correction / EASE**2
        kept, pull, curvature = contact_terms(probe, frames, fingers, angles[frames, fingers], stiffness)
        if iteration == 0:
            frames, fingers, pull, curvature = frames[kept], fingers[kept], pull[kept], curvature[kept]
        slope[frames, fingers] += pull
        blocks[frames, fingers] += curvature
        steps = np.diff(correction, axis=0) * speed
        slope[1:] += steps
        slope[:-1] -= steps
        links = np.zeros((len(angles), 1, 1))
        links[1:] += speed
        links[:-1] += speed
        blocks[..., _DIAGONAL, _DIAGONAL] += 1 / EASE**2 + links
        angles += _bounded(lambda b, r: _chain_solve(b, r, speed), blocks, -slope, limits[:, None] - angles)
    return angles.reshape(len(angles), -1).astype(np.float32)


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
        slope, blocks = _terms(depths[inside], slopes[inside], 1.0)
        blocks[..., _DIAGONAL, _DIAGONAL] += 0.3
        angles[rows] += _bounded(lambda b, r: np.linalg.solve(b, r[..., None])[..., 0], blocks, -slope, limits[:, rows] - angles[rows])
    return angles.astype(np.float32), deepest.astype(np.float32)


def contact_terms(probe: Probe, frames: np.ndarray, fingers: np.ndarray, angles: Array, stiffness: float) -> tuple[np.ndarray, Array, Array]:
    """Which rows are near something [R], and slope [R, 4] and curvature [R, 4, 4] of half the stiffness times the squared depths."""
    depths, slopes = probe.contacts(frames, fingers, angles.astype(np.float32))
    return depths.max(-1) > -NEAR, *_terms(depths, slopes, stiffness)


def _terms(depths: Array, slopes: Array, stiffness: float) -> tuple[Array, Array]:
    inside = np.maximum(depths + CLEARANCE, 0) / TOUCH
    slopes = np.where((inside > 0)[..., None], slopes, 0).astype(np.float64) / TOUCH
    transposed = np.swapaxes(slopes, -1, -2) * stiffness
    return -(transposed @ inside[..., None])[..., 0], transposed @ slopes


def _bounded(solve: Callable[[Array, Array], Array], blocks: Array, right: Array, room: Array) -> Array:
    """The step that solves blocks @ step = right within `room` (least and greatest step): what would leave the room is set to its edge, and the
    others solved for again. Steps are at most LONGEST_STEP."""
    least, greatest = np.clip(room, -LONGEST_STEP, LONGEST_STEP)
    fixed = np.zeros(right.shape, bool)
    step = np.zeros_like(right)
    for _ in range(BOUNDING):
        known = np.where(fixed, step, 0)
        free = ~fixed
        reduced = np.where(free[..., :, None] & free[..., None, :], blocks, np.eye(_COUNT) * STIFF)
        rest = right - (blocks @ known[..., None])[..., 0]
        step = np.where(fixed, step, solve(reduced, np.where(fixed, STIFF * step, rest)))
        beyond = (step < least) | (step > greatest)
        step = np.clip(step, least, greatest)
        if not beyond.any():
            break
        fixed |= beyond
    return step


def _chain_solve(blocks: Array, right: Array, link: float) -> Array:
    """x [T, 5, 4] with blocks[t] x[t] - link (x[t-1] + x[t+1]) = right[t]: block elimination forth and back."""
    inverses, carried = np.empty_like(blocks), np.empty_like(right)
    inverse, value = np.zeros((len(FINGERS), _COUNT, _COUNT)), np.zeros((len(FINGERS), _COUNT))
    for t in range(len(blocks)):
        value = right[t] + link * (inverse @ value[..., None])[..., 0]
        inverse = np.linalg.inv(blocks[t] - link**2 * inverse)
        inverses[t], carried[t] = inverse, value
    solved, later = np.empty_like(right), np.zeros_like(value)
    for t in range(len(blocks) - 1, -1, -1):
        later = (inverses[t] @ (carried[t] + link * later)[..., None])[..., 0]
        solved[t] = later
    return solved
