"""Frames on the ground: a point on the floor and a heading. The root of a body, and the head's shadow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .rotations import Array, quat_from_yaw, yaw_from_quat
from .skeleton import Skeleton


@dataclass(frozen=True)
class GroundFrame:
    """origin float32 [..., 3] with z = 0; rotation float32 [..., 4] about Z. The identity faces -Y."""

    origin: Array
    rotation: Array

    def __getitem__(self, index) -> GroundFrame:
        return GroundFrame(self.origin[index], self.rotation[index])


def ground_frame(positions: Array, rotations: Array) -> GroundFrame:
    """The shadow of poses: positions [..., 3] dropped to the floor, rotations [..., 4] reduced to their turn about Z."""
    origin = positions * np.array([1, 1, 0], dtype=positions.dtype)
    return GroundFrame(origin, quat_from_yaw(yaw_from_quat(rotations)))


def root_frame(skeleton: Skeleton, positions: Array) -> GroundFrame:
    """The body's root from joint positions [..., J, 3]: under the hips, facing where hips and shoulders face on average."""
    left = positions[..., skeleton.indices(["LeftUpLeg", "LeftArm"]), :]
    right = positions[..., skeleton.indices(["RightUpLeg", "RightArm"]), :]
    across = np.mean(left - right, axis=-2)
    yaw = np.arctan2(across[..., 1], across[..., 0])
    hips = positions[..., skeleton.index("Hips"), :]
    return GroundFrame(hips * np.array([1, 1, 0], dtype=positions.dtype), quat_from_yaw(yaw))
