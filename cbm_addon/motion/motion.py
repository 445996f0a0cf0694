"""Motion: a skeleton, timestamps, and what every joint does at each of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .rotations import Array, inverse, multiply, rotate
from .skeleton import Skeleton


@dataclass(frozen=True)
class Motion:
    """What a skeleton does over time.

    times      float64 [T], seconds, increasing
    root       float32 [T, 3], metres: position of the root joint (joint 0) in the world
    rotations  float32 [T, J, 4]: local unit quaternions, relative to the parent
    offsets    float32 [T, J, 3] or None: animated offsets, for files whose joints also translate; they replace the skeleton's
    """

    skeleton: Skeleton
    times: np.ndarray
    root: Array
    rotations: Array
    offsets: Array | None = None

    def __len__(self) -> int:
        return len(self.times)

    @property
    def seconds(self) -> float:
        return float(self.times[-1] - self.times[0]) if len(self) else 0.0

    @property
    def rate(self) -> float:
        """Median samples per second; 0 for a single pose."""
        return float(1 / np.median(np.diff(self.times))) if len(self) > 1 else 0.0

    def forward(self) -> tuple[Array, Array]:
        """World rotations [T, J, 4] and positions [T, J, 3] of all joints."""
        return forward_kinematics(self.skeleton, self.root, self.rotations, self.offsets)

    def positions(self) -> Array:
        """World positions [T, J, 3]."""
        return self.forward()[1]


def forward_kinematics(skeleton: Skeleton, root: Array, rotations: Array, offsets: Array | None = None) -> tuple[Array, Array]:
    """World rotations [..., J, 4] and positions [..., J, 3] from the root position [..., 3] and local rotations [..., J, 4]."""
    world = np.empty_like(rotations)
    positions = np.empty((*rotations.shape[:-1], 3), dtype=rotations.dtype)
    for joint, parent in enumerate(skeleton.parents):
        offset = skeleton.offsets[joint] if offsets is None else offsets[..., joint, :]
        if parent < 0:
            world[..., joint, :] = rotations[..., joint, :]
            positions[..., joint, :] = root if joint == 0 else offset
        else:
            world[..., joint, :] = multiply(world[..., parent, :], rotations[..., joint, :])
            positions[..., joint, :] = positions[..., parent, :] + rotate(world[..., parent, :], offset)
    return world, positions


def local_rotations(skeleton: Skeleton, world: Array) -> Array:
    """The inverse of forward kinematics: local rotations [..., J, 4] from world rotations [..., J, 4]."""
    parents = skeleton.parents
    has_parent = parents >= 0
    local = world.copy()
    local[..., has_parent, :] = multiply(inverse(world[..., parents[has_parent], :]), world[..., has_parent, :])
    return local
