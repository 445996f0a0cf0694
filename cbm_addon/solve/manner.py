"""Manner: how a performer stands and moves all through a take, which three points do not tell. Variations differ by it.

A model's manners are the directions in which its answers to whole clips were off, on clips that it never trained on (learn/manner.py): for the
shipped one, hips and legs farther forward or back, one foot before the other, weight to one side, and sitting back on a wider stance.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..features import LOWER_JOINTS
from ..motion.rotations import Array
from .performance import Performance

SIDES = LOWER_JOINTS.index("LeftUpLeg"), LOWER_JOINTS.index("RightUpLeg")


def draw_manner(manners: Array, seed: int, variation: int) -> Array:
    """Offsets float32 [9, 3] of LOWER_JOINTS in the body's frame, head heights, from manners [M, 9, 3] of one deviation each; none for variation 0."""
    if variation == 0:
        return np.zeros((len(LOWER_JOINTS), 3), np.float32)
    return np.tensordot(np.random.default_rng([seed, variation]).standard_normal(len(manners)), manners, 1).astype(np.float32)


def with_manner(performance: Performance) -> Performance:
    """The performance with its lower joints moved by its manner, which turns with the body. What stands is planted anew by stage 3."""
    positions = performance.lower_positions
    return replace(performance, lower_positions=positions + out_of_body(positions, performance.manner))


def out_of_body(positions: Array, offsets: Array) -> Array:
    """Vectors [T, N, 3] or [N, 3] from the frame of the body (+X its left, -Y where the hips face) of positions [T, 9, 3] into the one of the positions."""
    return _turned(positions, offsets, 1)


def into_body(positions: Array, offsets: Array) -> Array:
    """The inverse."""
    return _turned(positions, offsets, -1)


def _turned(positions: Array, offsets: Array, sign: int) -> Array:
    left = (positions[:, SIDES[0]] - positions[:, SIDES[1]])[:, None, :2]
    cosine, sine = np.moveaxis(left / np.maximum(np.linalg.norm(left, axis=-1, keepdims=True), 1e-6), -1, 0)
    x, y, z = np.moveaxis(np.broadcast_to(offsets, (len(positions), *offsets.shape[-2:])), -1, 0)
    return np.stack((cosine * x - sign * sine * y, sign * sine * x + cosine * y, z), axis=-1)
