"""A cache of the distances to an obstacle that keeps its shape: bricks of a grid, each filled when it is first asked for.

Nodes hold the distance and the normal. Between them the distance is the mean of two interpolations, of the values and of the planes that
the nodes see, whose errors cancel where the surface is smooth. Where the two differ near the surface, as at creases, a finer grid is
asked.
"""

from __future__ import annotations

import numpy as np

from ..motion.rotations import Array
from .obstacle import Obstacle

CELLS = 0.006, 0.002  # metres: edges of the cells of the grid and of the finer one
SIDE = 4  # cells of a brick along each side
DIFFERENT = 4e-4  # metres by which the two interpolations may differ
NEAR = 0.02  # metres from the surface within which distances are accurate; further away they are within a brick's size
TOGETHER = 4096  # points that are looked up at a time: what they need then stays in the processor's own memory
REACH = 0.06  # metres around the obstacle's box that bricks cover; the distance to the box follows

_CORNERS = np.stack(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij"), axis=-1).reshape(-1, 3)
_NODES = np.stack(np.meshgrid(*[np.arange(SIDE + 1)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
_STRIDE = np.array([(SIDE + 1) ** 2, SIDE + 1, 1])
_KEYS = 1 << 20  # bricks along an axis that a key can tell apart
_NEARBY = 1 << 15  # bricks of a box small enough to list all of them


class CachedDistances:
    """An Obstacle that remembers what another one, of whose surface `low` and `high` [3] are the bounds, said."""

    def __init__(self, obstacle: Obstacle, low: Array, high: Array, cells: tuple[float, ...] = CELLS) -> None:
        self._obstacle, self._cell = obstacle, np.float32(cells[0])
        self._finer = CachedDistances(obstacle, low, high, cells[1:]) if len(cells) > 1 else None
        self._low, self._high = np.asarray(low, np.float32), np.asarray(high, np.float32)
        self._keys = np.empty(0, np.int64)
        self._starts = np.empty(0, np.int64)
        self._nodes = np.empty((0, 5), np.float32)  # distance, normal, and how far along the normal the node is; brick by brick

    def nearest(self, points: Array) -> tuple[Array, Array]:
        if len(points) > TOGETHER:
            parts = [self.nearest(points[start : start + TOGETHER]) for start in range(0, len(points), TOGETHER)]
            return np.concatenate([distances for distances, _ in parts]), np.concatenate([normals for _, normals in parts])
        low, high = (np.asarray(edge)[:, None] for edge in (self._low - REACH, self._high + REACH))
        columns = np.ascontiguousarray(points.T)
        within = ((columns > low) & (columns < high)).all(axis=0)
        if within.all():
            return self._interpolated(points)
        beyond = points - np.clip(points, self._low, self._high)
        distances = np.linalg.norm(beyond, axis=-1)
        normals = beyond / np.maximum(distances, 1e-9)[:, None]
        if within.any():
            distances[within], normals[within] = self._interpolated(points[within])
        return distances.astype(np.float32), normals.astype(np.float32)

    def _interpolated(self, points: Array) -> tuple[Array, Array]:
        places = np.ascontiguousarray(((points - self._low) / self._cell).T, np.float32)
        cells = np.floor(places)
        x, y, z = places - cells
        cells = cells.astype(np.int64)
        bricks = cells // SIDE
        first = self._bricks(bricks) + _STRIDE @ (cells - bricks * SIDE)
        sums = np.zeros((len(points), 5), np.float32)
        for i, j, k in _CORNERS:
            weights = (x if i else 1 - x) * (y if j else 1 - y) * (z if k else 1 - z)
            sums += weights[:, None] * np.take(self._nodes, first + (i * _STRIDE[0] + j * _STRIDE[1] + k), axis=0)
        distances, normals = sums[:, 0], sums[:, 1:4]
        slopes = np.einsum("in,ni->n", places, normals) * self._cell - sums[:, 4]
        distances = distances + slopes / 2
        normals = normals / np.maximum(np.sqrt(np.einsum("ni,ni->n", normals, normals)), 1e-9)[:, None]
        if self._finer:
            doubtful = (np.abs(slopes) > DIFFERENT) & (np.abs(distances) < NEAR)
            if doubtful.any():
                distances[doubtful], normals[doubtful] = self._finer.nearest(points[doubtful])
        return distances, normals

    def _bricks(self, bricks: np.ndarray) -> np.ndarray:
        """Where in `_nodes` bricks [3, N] begin, [N]; they are filled where they are new. Of bricks that are close together each is looked up once."""
        low, size = bricks.min(axis=1), np.ptp(bricks, axis=1) + 1
        if size.prod() > _NEARBY:
            return self._found(bricks)
        place = np.array([size[1] * size[2], size[2], 1]) @ (bricks - low[:, None])
        starts = np.zeros(size.prod(), np.int64)
        starts[place] = 1
        there = np.flatnonzero(starts)
        starts[there] = self._found(np.stack(np.unravel_index(there, size)) + low[:, None])
        return starts[place]

    def _found(self, bricks: np.ndarray) -> np.ndarray:
        keys = ((bricks[0] + _KEYS // 2) * _KEYS + bricks[1] + _KEYS // 2) * _KEYS + bricks[2] + _KEYS // 2
        places = np.searchsorted(self._keys, keys)
        known = places < len(self._keys)
        known[known] = self._keys[places[known]] == keys[known]
        if not known.all():
            new, first = np.unique(keys[~known], return_index=True)
            self._fill(new, bricks[:, ~known][:, first].T)
            places = np.searchsorted(self._keys, keys)
        return self._starts[places]

    def _fill(self, keys: np.ndarray, bricks: np.ndarray) -> None:
        """Adds bricks. Of those that are far from the surface only the middle is asked, and the rest follows from the plane that it sees."""
        middles = self._low + (bricks + 0.5) * SIDE * self._cell
        distances, normals = self._obstacle.nearest(middles.astype(np.float32))
        offsets = (_NODES - SIDE / 2) * self._cell
        nodes = np.empty((len(keys), len(_NODES), 5), np.float32)
        nodes[..., 0] = distances[:, None] + normals @ offsets.T
        nodes[..., 1:4] = normals[:, None]
        near = np.abs(distances) < NEAR + np.sqrt(3) / 2 * SIDE * self._cell
        points = (middles[near, None] + offsets).reshape(-1, 3).astype(np.float32)
        if len(points):
            distances, normals = self._obstacle.nearest(points)
            nodes[near, :, :4] = np.concatenate((distances[:, None], normals), axis=-1).reshape(-1, len(_NODES), 4)
        nodes[..., 4] = (nodes[..., 1:4] * ((bricks[:, None] * SIDE + _NODES) * self._cell)).sum(axis=-1)
        merged = np.concatenate((self._keys, keys))
        order = np.argsort(merged)
        self._starts = np.concatenate((self._starts, len(self._nodes) + len(_NODES) * np.arange(len(keys))))[order]
        self._keys, self._nodes = merged[order], np.concatenate((self._nodes, nodes.reshape(-1, 5)))
