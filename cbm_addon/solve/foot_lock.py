"""Foot locks: paths that stand still while there is contact and move as predicted otherwise, solved once over the take."""

from __future__ import annotations

import numpy as np

from ..motion.rotations import Array

VELOCITY = 20.0  # weight of the predicted steps against the predicted positions, at 30 frames per second
CONTACT = 30_000.0  # weight of standing still in contact, likewise
ON, OFF = 0.5, 0.4  # contact begins above ON and ends below OFF
SHORTEST = 3  # frames; shorter contacts and shorter gaps are noise


def contact_states(probabilities: Array) -> np.ndarray:
    """Contacts bool [T, N] from probabilities [T, N], with hysteresis."""
    state = np.zeros(probabilities.shape, dtype=bool)
    current = probabilities[0] > 0.5 if len(probabilities) else np.zeros(probabilities.shape[1], bool)
    for t, values in enumerate(probabilities):
        current = np.where(values > ON, True, np.where(values < OFF, False, current))
        state[t] = current
    return state


def without_blips(state: np.ndarray) -> np.ndarray:
    """Contacts bool [T, N] with gaps, then contacts, shorter than SHORTEST frames removed (this looks ahead)."""
    state = state.copy()
    for column in state.T:
        for value in (False, True):
            edges = np.flatnonzero(np.diff(column)) + 1
            starts, ends = np.concatenate(([0], edges)), np.concatenate((edges, [len(column)]))
            for start, end in zip(starts, ends, strict=True):
                inside = start > 0 and end < len(column)
                if inside and column[start] == value and end - start < SHORTEST:
                    column[start:end] = not value
    return state


def solve_paths(positions: Array, velocities: Array, locked: np.ndarray, rate: float) -> Array:
    """Paths [T, N, 3] by least squares: near `positions`, moving at `velocities` per second, and not at all where `locked` bool [T, N].

    The normal equations are tridiagonal and the same for x, y and z: one forward and one backward sweep (Thomas) solves all paths.
    """
    count = len(positions)
    if count < 2:
        return positions.copy()
    still = locked[1:] & locked[:-1]
    weight = np.where(still, CONTACT, VELOCITY)[..., None] * (rate / 30) ** 2  # a step shrinks with the frame: its square must not
    wanted = np.where(still[..., None], 0.0, velocities[1:] / rate)
    diagonal = np.ones((count, positions.shape[1], 1))
    diagonal[1:] += weight
    diagonal[:-1] += weight
    right = positions.astype(np.float64)
    right[1:] += weight * wanted
    right[:-1] -= weight * wanted
    for t in range(1, count):
        factor = weight[t - 1] / diagonal[t - 1]
        diagonal[t] -= factor * weight[t - 1]
        right[t] += factor * right[t - 1]
    solved = np.empty_like(right)
    solved[-1] = right[-1] / diagonal[-1]
    for t in range(count - 2, -1, -1):
        solved[t] = (right[t] + weight[t] * solved[t + 1]) / diagonal[t]
    return solved.astype(np.float32)


def lock_causally(positions: Array, locked: np.ndarray, halving: float, limit: float) -> Array:
    """Paths [T, N, 3] without looking ahead: a locked point stays where the lock began; released, it returns to its path, its distance
    halving every `halving` frames. A lock that is farther than `limit` from its path was wrong and is let go until it has come back.
    """
    path = positions.copy()
    offset = np.zeros_like(positions[0])
    broken = np.zeros((positions.shape[1], 1), dtype=bool)
    decay = np.float32(0.5 ** (1 / halving))
    for t in range(1, len(positions)):
        held = path[t - 1] - positions[t]
        distance = np.linalg.norm(held, axis=-1, keepdims=True)
        broken = np.where(broken, distance > limit / 4, distance > limit)
        still = (locked[t] & locked[t - 1])[:, None] & ~broken
        offset = np.where(still, held, offset * decay)
        path[t] = positions[t] + offset
    return path
