"""A cache of the distances to an obstacle that keeps its shape: bricks of a grid, each filled when it is first asked for.

Nodes hold the distance and the normal. Between them the distance is the mean of two interpolations, of the values and of the planes that
the nodes see, whose errors cancel where the surface is smooth. Where the two differ near the surface, as at creases, a finer grid is
asked.
"""

from __future__ import annotations

import numpy as np

from ..motion.rotations import Array, normalize
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
_SUMS = np.zeros((8, 4, 5), np.float32)  # over the corners: distance, normal, and how far away corners are along their normals
_SUMS[:, range(4), range(4)] = 1
_SUMS[:, 1:, 4] = _CORNERS
_SUMS = _SUMS.reshape(32, 5)
_KEYS = 1 << 20  # bricks along an axis that a key can tell apart


class CachedDistances:
    """An Obstacle that remembers what another one, of whose surface `low` and `high` [3] are the bounds, said."""

    def __init__(self, obstacle: Obstacle, low: Array, high: Array, cells: tuple[float, ...] = CELLS) -> None:
        self._obstacle, self._cell = obstacle, np.float32(cells[0])
        self._finer = CachedDistances(obstacle, low, high, cells[1:]) if len(cells) > 1 else None
        self._low, self._high = np.asarray(low, np.float32), np.asarray(high, np.float32)
        self._keys = np.empty(0, np.int64)
        self._starts = np.empty(0, np.int64)
        self._nodes = np.empty((0, 4), np.float32)  # distance and normal, brick by brick

    def nearest(self, points: Array) -> tuple[Array, Array]:
        if len(points) > TOGETHER:
            parts = [self.nearest(points[start : start + TOGETHER]) for start in range(0, len(points), TOGETHER)]
            return np.concatenate([distances for distances, _ in parts]), np.concatenate([normals for _, normals in parts])
        beyond = points - np.clip(points, self._low, self._high)
        distances = np.linalg.norm(beyond, axis=-1)
        normals = beyond / np.maximum(distances, 1e-9)[:, None]
        within = distances < REACH
        if within.all():
            return self._interpolated(points)
        if within.any():
            distances[within], normals[within] = self._interpolated(points[within])
        return distances.astype(np.float32), normals.astype(np.float32)

    def _interpolated(self, points: Array) -> tuple[Array, Array]:
        places = (points - self._low) / self._cell
        cells = np.floor(places).astype(np.int64)
        bricks = cells // SIDE
        first = self._bricks(bricks) + (cells - bricks * SIDE) @ _STRIDE
        nodes = np.take(self._nodes, first[:, None] + _CORNERS @ _STRIDE, axis=0)
        share = (places - cells).astype(np.float32)
        x, y, z = np.stack((1 - share, share), axis=-1).swapaxes(0, 1)
        weights = (x[:, :, None, None] * y[:, None, :, None] * z[:, None, None, :]).reshape(-1, 8, 1)
        sums = (weights * nodes).reshape(-1, 32) @ _SUMS
        slopes = (np.einsum("ni,ni->n", share, sums[:, 1:4]) - sums[:, 4]) * self._cell
        distances, normals = sums[:, 0] + slopes / 2, normalize(sums[:, 1:4])
        if self._finer:
            doubtful = (np.abs(slopes) > DIFFERENT) & (np.abs(distances) < NEAR)
            if doubtful.any():
                distances[doubtful], normals[doubtful] = self._finer.nearest(points[doubtful])
        return distances, normals

    def _bricks(self, bricks: np.ndarray) -> np.ndarray:
        """Where in `_nodes` bricks [N, 3] begin, [N]; they are filled where they are new."""
        keys = ((bricks[:, 0] + _KEYS // 2) * _KEYS + bricks[:, 1] + _KEYS // 2) * _KEYS + bricks[:, 2] + _KEYS // 2
        places = np.searchsorted(self._keys, keys)
        known = places < len(self._keys)
        known[known] = self._keys[places[known]] == keys[known]
        if not known.all():
            new, first = np.unique(keys[~known], return_index=True)
            self._fill(new, bricks[~known][first])
            places = np.searchsorted(self._keys, keys)
        return self._starts[places]

    def _fill(self, keys: np.ndarray, bricks: np.ndarray) -> None:
        """Adds bricks. Of those that are far from the surface only the middle is asked, and the rest follows from the plane that it sees."""
        middles = self._low + (bricks + 0.5) * SIDE * self._cell
        distances, normals = self._obstacle.nearest(middles.astype(np.float32))
        offsets = (_NODES - SIDE / 2) * self._cell
        nodes = np.empty((len(keys), len(_NODES), 4), np.float32)
        nodes[..., 0] = distances[:, None] + normals @ offsets.T
        nodes[..., 1:] = normals[:, None]
        near = np.abs(distances) < NEAR + np.sqrt(3) / 2 * SIDE * self._cell
        points = (middles[near, None] + offsets).reshape(-1, 3).astype(np.float32)
        if len(points):
            distances, normals = self._obstacle.nearest(points)
            nodes[near] = np.concatenate((distances[:, None], normals), axis=-1).reshape(-1, len(_NODES), 4)
        merged = np.concatenate((self._keys, keys))
        order = np.argsort(merged)
        self._starts = np.concatenate((self._starts, len(self._nodes) + len(_NODES) * np.arange(len(keys))))[order]
        self._keys, self._nodes = merged[order], np.concatenate((self._nodes, nodes.reshape(-1, 4)))
