"""What a hand must not enter: anything that can say how far points are from its surface."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from ..motion.rotations import Array

FAR = 1e3  # metres: the distance to nothing


class Obstacle(Protocol):
    def nearest(self, points: Array) -> tuple[Array, Array]:
        """World points [N, 3] in metres -> signed distances [N], negative inside, and the unit normals [N, 3] along which they grow."""
        ...


class Nothing:
    """No obstacle: far away everywhere."""

    def nearest(self, points: Array) -> tuple[Array, Array]:
        normals = np.zeros((len(points), 3), np.float32)
        normals[:, 2] = 1
        return np.full(len(points), FAR, np.float32), normals


def empty() -> Obstacle:
    """The obstacle of an empty scene."""
    return Nothing()
