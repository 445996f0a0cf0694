"""Filling in what was not tracked."""

from __future__ import annotations

import numpy as np

from ..motion.resample import lerp_samples, slerp_samples
from ..motion.rotations import Array, continuous, inverse, multiply, quat_from_yaw, rotate, slerp, yaw_from_quat
from .take import HANDS, HEAD, LEFT

SHORT_GAP = 0.25
"""Seconds. Shorter gaps of a hand are bridged; over longer ones it is held, and comes back in this time at the end."""

HANGING_WRIST = (0.115, -0.03, -0.36)
"""The left wrist of an arm that hangs, from the head joint, seen from the head's heading, as shares of stature."""
HANGING_ROTATION = (0.5**0.5, 0.0, 0.5**0.5, 0.0)
"""Its rotation from the T-pose: a quarter turn about Y, palm inward."""


def fill(times: np.ndarray, positions: Array, rotations: Array, tracked: np.ndarray, stature: float) -> tuple[Array, Array]:
    """Joint poses with every sample filled: positions [T, 3, 3], rotations [T, 3, 4], tracked bool [T, 3] (the head at least once).

    The head is interpolated. A hand is interpolated over short gaps and held still relative to the head and its heading over long ones. A
    hand that is never tracked hangs beside the body.
    """
    positions, rotations = positions.copy(), rotations.copy()
    seen = tracked[:, HEAD]
    positions[:, HEAD] = lerp_samples(times[seen], positions[seen, HEAD], times)
    rotations[:, HEAD] = slerp_samples(times[seen], rotations[seen, HEAD], times)
    head, heading = positions[:, HEAD], quat_from_yaw(yaw_from_quat(rotations[:, HEAD]))
    for hand in HANDS:
        seen = tracked[:, hand]
        from_head = rotate(inverse(heading), positions[:, hand] - head)
        turned = multiply(inverse(heading), rotations[:, hand])
        if seen.any():
            from_head, turned = _held(times, from_head, turned, seen)
        else:
            side = 1 if hand == LEFT else -1
            from_head[:] = np.array(HANGING_WRIST) * [side, 1, 1] * stature
            turned[:] = np.array(HANGING_ROTATION) * [1, 1, side, 1]
        bridged = _bridged(times, seen)
        carried = ~seen & ~bridged
        if bridged.any():
            positions[bridged, hand] = lerp_samples(times[seen], positions[seen, hand], times[bridged])
            rotations[bridged, hand] = slerp_samples(times[seen], rotations[seen, hand], times[bridged])
        positions[carried, hand] = (head + rotate(heading, from_head))[carried]
        rotations[carried, hand] = multiply(heading, turned)[carried]
    return positions, continuous(rotations)


def _neighbours(tracked: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For each sample the indices of the tracked samples before and after it (itself if tracked; the only one there is at the ends)."""
    seen = np.flatnonzero(tracked)
    rank = np.cumsum(tracked)
    before = seen[np.maximum(rank - 1, 0)]
    after = np.where(tracked, before, seen[np.minimum(rank, len(seen) - 1)])
    return before, after


def _bridged(times: np.ndarray, tracked: np.ndarray) -> np.ndarray:
    """Bool [T]: not tracked, in a short gap between two tracked samples."""
    if not tracked.any():
        return np.zeros(len(times), dtype=bool)
    before, after = _neighbours(tracked)
    return (before != after) & (times[after] - times[before] <= SHORT_GAP)


def _held(times: np.ndarray, positions: Array, rotations: Array, tracked: np.ndarray) -> tuple[Array, Array]:
    """A hand's poses seen from the head, [T, 3] and [T, 4]: each gap holds the pose before it and moves to the pose after it at its end."""
    before, after = _neighbours(tracked)
    share = np.clip((times - times[after]) / SHORT_GAP + 1, 0, 1)
    share = share * share * (3 - 2 * share)
    return positions[before] + (positions[after] - positions[before]) * share[:, None], slerp(rotations[before], rotations[after], share)
