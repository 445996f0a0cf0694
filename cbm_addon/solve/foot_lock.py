"""Foot locks: paths that stand still while there is contact and move as predicted otherwise, solved once over the take."""

from __future__ import annotations

import numpy as np

from ..motion.rotations import Array
from .tridiagonal import follow

VELOCITY = 20.0  # weight of the predicted steps against the predicted positions, at 30 frames per second
CONTACT = 30_000.0  # weight of standing still in contact, likewise
ON, OFF = 0.5, 0.4  # contact begins above ON and ends below OFF
CAUSAL_ON, CAUSAL_OFF = 0.35, 0.2  # likewise without looking ahead, where contacts are told late and less surely
SHORTEST = 3  # frames; shorter contacts and shorter gaps are noise
LOWERED = 0.6  # the share of its height over the floor that a point in contact loses
RELEASE, CREEP = 0.1, 0.4  # seconds in which a causal lock that is let go, or that is beyond its slack, comes half-way to its path
LIFT, RISE = 0.012, 0.03  # the same for heights
SLACK, LEASH = 0.055, 0.1  # head heights from its path up to which a causal lock stands still, and that it never exceeds


def contact_states(probabilities: Array, on: float = ON, off: float = OFF) -> np.ndarray:
    """Contacts bool [T, N] from probabilities [T, N], with hysteresis."""
    state = np.zeros(probabilities.shape, dtype=bool)
    current = probabilities[0] > 0.5 if len(probabilities) else np.zeros(probabilities.shape[1], bool)
    for t, values in enumerate(probabilities):
        current = np.where(values > on, True, np.where(values < off, False, current))
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
    """Paths [T, N, 3] by least squares: near `positions`, moving at `velocities` per second, and not at all where `locked` bool [T, N]."""
    count = len(positions)
    if count < 2:
        return positions.copy()
    still = locked[1:] & locked[:-1]
    weight = np.where(still, CONTACT, VELOCITY) * (rate / 30) ** 2  # a step shrinks with the frame: its square must not
    wanted = np.where(still[..., None], 0.0, velocities[1:] / rate)
    return follow(positions, np.ones(count), weight, wanted).astype(np.float32)


def lowered(positions: Array, contacts: Array, rest: Array) -> Array:
    """Points [T, N, 3] nearer to the heights `rest` [N] at which they stand, the likelier contact [T, N] is; none is raised."""
    points = positions.copy()
    points[..., 2] -= LOWERED * np.clip(contacts, 0, 1) * np.maximum(points[..., 2] - rest, 0)
    return points


def lock_causally(positions: Array, locked: np.ndarray, rate: float, unit: float) -> Array:
    """Paths [T, N, 3] without looking ahead. A locked point stays where the lock began while its path is within SLACK of it over the floor, and within
    LIFT in height; it creeps after a path that goes farther, and is never farther than LEASH and RISE from it. Released, it returns to its path.

    unit  metres in a head height
    """
    path = positions.copy()
    for axes, slack, leash in ((slice(0, 2), SLACK, LEASH), (slice(2, 3), LIFT, RISE)):
        _hold(path[..., axes], positions[..., axes], locked, rate, np.float32(slack * unit), np.float32(leash * unit))
    return path


def _hold(path: Array, positions: Array, locked: np.ndarray, rate: float, slack: np.float32, leash: np.float32) -> None:
    """The same for some of the axes [T, N, A], in place."""
    offset = np.zeros_like(positions[0])
    release, creep = (np.float32(0.5 ** (1 / (seconds * rate))) for seconds in (RELEASE, CREEP))
    for t in range(1, len(positions)):
        held = path[t - 1] - positions[t]
        distance = np.linalg.norm(held, axis=-1, keepdims=True)
        beyond = np.maximum(distance - slack, 0)
        kept = np.minimum(distance - beyond + creep * beyond, leash)
        still = (locked[t] & locked[t - 1])[:, None]
        offset = np.where(still, held * (kept / np.maximum(distance, 1e-9)), offset * release)
        path[t] += offset
