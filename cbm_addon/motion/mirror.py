"""Mirroring across the plane X = 0: left becomes right."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .motion import Motion
from .rotations import Array
from .skeleton import Skeleton

SIDES = {"Left": "Right", "Right": "Left", "left": "right", "right": "left"}


def twin(name: str) -> str:
    """The name on the other side (the same if it begins with no side)."""
    for side, other in SIDES.items():
        if name.startswith(side):
            return other + name[len(side) :]
    return name


def mirrored_joints(skeleton: Skeleton) -> np.ndarray:
    """For each joint the index of its twin on the other side (itself if it has none)."""
    return np.array([skeleton.index(twin(name)) if twin(name) in skeleton else i for i, name in enumerate(skeleton.names)])


def mirror_positions(positions: Array) -> Array:
    return positions * np.array([-1, 1, 1], dtype=positions.dtype)


def mirror_rotations(quaternions: Array) -> Array:
    return quaternions * np.array([1, 1, -1, -1], dtype=quaternions.dtype)


def mirror_skeleton(skeleton: Skeleton) -> Skeleton:
    """The body with its sides exchanged; the same body if it is symmetric."""
    twins = mirrored_joints(skeleton)
    return replace(skeleton, offsets=mirror_positions(skeleton.offsets[twins]), tips=mirror_positions(skeleton.tips[twins]))


def mirror(motion: Motion) -> Motion:
    """The mirrored motion; twice gives the original."""
    twins = mirrored_joints(motion.skeleton)
    return replace(
        motion,
        skeleton=mirror_skeleton(motion.skeleton),
        root=mirror_positions(motion.root),
        rotations=mirror_rotations(motion.rotations[:, twins]),
        offsets=None if motion.offsets is None else mirror_positions(motion.offsets[:, twins]),
    )
