"""Fingers that close until they touch: bends swept from an open to a closed pose, and stopped at the first contact."""

from __future__ import annotations

import numpy as np

from ..motion.rotations import Array
from .contact import Probe
from .hand import PHALANGES

STEPS = 12  # of a sweep, before the last one is halved
HALVINGS = 5


def swept(probe: Probe, frames: np.ndarray, fingers: np.ndarray, start: Array, end: Array) -> tuple[Array, np.ndarray]:
    """Rows of angles [R, 4] as far from `start` toward `end` [R, 4] as they go without touching, and whether [R] they met anything.

    A row that touches at its start stays there.
    """
    reached, rows = np.zeros(len(start), np.float32), np.arange(len(start))
    met = np.zeros(len(start), bool)
    for step in range(STEPS + 1):
        share = np.float32(step / STEPS)
        touches = _touches(probe, frames, fingers, start, end, rows, share)
        met[rows[touches]] = True
        rows = rows[~touches]
        reached[rows] = share
    rows = np.flatnonzero(met & (reached < 1))
    size = np.float32(1 / STEPS)
    for _ in range(HALVINGS):
        size /= 2
        free = ~_touches(probe, frames, fingers, start, end, rows, (reached[rows] + size)[:, None])
        reached[rows[free]] += size
    return start + reached[:, None] * (end - start), met


def _touches(probe: Probe, frames: np.ndarray, fingers: np.ndarray, start: Array, end: Array, rows: np.ndarray, share: Array) -> np.ndarray:
    angles = start[rows] + share * (end[rows] - start[rows])
    return probe.depths(frames[rows], fingers[rows], angles.astype(np.float32)).max(-1) > 0


def wrapped(probe: Probe, frames: np.ndarray, fingers: np.ndarray, start: Array, closed: Array) -> tuple[Array, np.ndarray]:
    """A grasp: all joints of a finger close together; where one rests, those beyond it go on. Rows that meet nothing stay at `start`."""
    angles, met = swept(probe, frames, fingers, start, closed)
    for joint in range(1, PHALANGES):
        beyond = np.arange(PHALANGES + 1) >= joint
        beyond[PHALANGES] = False
        on = np.flatnonzero(met)
        angles[on], _ = swept(probe, frames[on], fingers[on], angles[on], np.where(beyond, closed[on], angles[on]))
    return np.where(met[:, None], angles, start).astype(np.float32), met
