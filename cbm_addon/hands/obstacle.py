"""What a hand must not enter: anything that can say how far points are from its surface."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

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

    `obstacles(frame)` is asked once for each frame.
    """
    known: dict[int, Obstacle] = {}

    def nearest(frames: Array, points: Array) -> tuple[Array, Array]:
        asked, which = np.unique(frames, return_inverse=True)
        for frame in asked.tolist():
            if frame not in known:
                known[frame] = obstacles(frame)
        found = nearest_of([known[frame] for frame in asked.tolist()], np.repeat(which, points.shape[1]), points.reshape(-1, 3))
        return found[0].reshape(points.shape[:-1]), found[1].reshape(points.shape)

    return nearest


def nearest_of(obstacles: Sequence[Obstacle], which: np.ndarray, points: Array) -> tuple[Array, Array]:
    """As `Obstacle.nearest`, where each of the points [N, 3] has an obstacle of its own: that of index `which` int [N].

    Obstacles of one kind are answered together. A class says with `kind` which of its obstacles are, and answers with `nearest_of_alike`.
    """
    numbers: dict[object, int] = {}
    kinds = np.array([numbers.setdefault(getattr(obstacle, "kind", id(obstacle)), len(numbers)) for obstacle in obstacles])
    if len(numbers) == 1:
        return _nearest_of_alike(obstacles, which, points)
    distances, normals = np.empty(len(points), np.float32), np.empty(points.shape, np.float32)
    order = np.argsort(kinds[which], kind="stable")
    for rows in np.split(order, np.searchsorted(kinds[which[order]], np.arange(1, len(numbers)))):
        if len(rows):
            of_kind, places = np.unique(which[rows], return_inverse=True)
            distances[rows], normals[rows] = _nearest_of_alike([obstacles[index] for index in of_kind], places, points[rows])
    return distances, normals


def _nearest_of_alike(obstacles: Sequence[Any], which: np.ndarray, points: Array) -> tuple[Array, Array]:
    first = obstacles[0]
    return first.nearest_of_alike(obstacles, which, points) if hasattr(first, "kind") else first.nearest(points)
