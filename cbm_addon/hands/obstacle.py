"""What a hand must not enter: anything that can say how far points are from its surface."""

from __future__ import annotations

from collections.abc import Callable
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


def over_time(obstacles: Callable[[int], Obstacle]) -> Callable[[Array, Array], tuple[Array, Array]]:
    """One question for many frames: (frames int [F], points [F, M, 3]) -> distances [F, M], normals [F, M, 3].

    `obstacles(frame)` is asked once for each frame; frames that share one obstacle are answered together.
    """
    known: dict[int, Obstacle] = {}

    def nearest(frames: Array, points: Array) -> tuple[Array, Array]:
        distances, normals = np.empty(points.shape[:-1], np.float32), np.empty(points.shape, np.float32)
        shared: dict[int, list[int]] = {}
        for row, frame in enumerate(frames.tolist()):
            if frame not in known:
                known[frame] = obstacles(frame)
            shared.setdefault(id(known[frame]), []).append(row)
        for rows in shared.values():
            obstacle = known[int(frames[rows[0]])]
            found = obstacle.nearest(points[rows].reshape(-1, 3))
            distances[rows], normals[rows] = found[0].reshape(len(rows), -1), found[1].reshape(len(rows), -1, 3)
        return distances, normals

    return nearest
