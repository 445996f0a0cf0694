"""Triangle meshes as obstacles with exact signed distances.

The side of the surface on which a point is comes from the angle-weighted pseudonormal at the nearest place (Baerentzen and Aanaes 2005, "Signed
distance computation using the angle weighted pseudonormal"), after every triangle was wound so that its normal points to free space
(mesh_sides.py). An open sheet has no inside: distances to it are positive on both sides.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ..motion.rotations import Array, normalize
from .mesh_sides import BACK_FREE, BURIED, SHEET, free_sides, weld

Closest = Callable[[Array], tuple[Array, np.ndarray]]
"""Points [N, 3] -> the nearest places on some triangles [N, 3], and on which of them they are, int [N]."""
Search = Callable[[Array, np.ndarray], Closest]
"""Makes such a search for vertices [V, 3] and triangles int [F, 3], of which there is at least one."""

ON_SIDE = 1e-4  # barycentric coordinate below which a place is on a side of its triangle
TOUCHING = 1e-7  # metres within which the direction to the nearest place says nothing


@dataclass(frozen=True)
class Topology:
    """What of a mesh stays when it bends.

    triangles  int [F, 3]: those that free space can touch, wound so that their normals point to it
    sheet      bool [F]: free space is on both sides
    welded     int [F, 3]: the triangles with one index for all vertices at one place
    """

    triangles: np.ndarray
    sheet: np.ndarray
    welded: np.ndarray

    @classmethod
    def of(cls, vertices: Array, triangles: np.ndarray, free: Array | None = None) -> Topology:
        """For vertices [V, 3] and triangles int [F, 3]; `free` [N, 3] are places that are known to be outside."""
        sides = free_sides(vertices, triangles, free)
        wound = np.where((sides == BACK_FREE)[:, None], triangles[:, ::-1], triangles)[sides != BURIED]
        return cls(wound, sides[sides != BURIED] == SHEET, weld(vertices, wound))

    def only(self, chosen: np.ndarray) -> Topology:
        """Some of the triangles: bool or int [N]."""
        return replace(self, triangles=self.triangles[chosen], sheet=self.sheet[chosen], welded=self.welded[chosen])


class Mesh:
    """The triangles of a topology at vertices [V, 3], metres, as an Obstacle. `search` finds nearest places: the engine has no tree of its own."""

    def __init__(self, vertices: Array, topology: Topology, search: Search) -> None:
        self._corners = np.asarray(vertices, np.float64)[topology.triangles]
        self._sheet = topology.sheet
        self._normals, self._side_normals, self._corner_normals = _pseudonormals(self._corners, topology.welded)
        self._closest = search(vertices, topology.triangles)

    def nearest(self, points: Array) -> tuple[Array, Array]:
        places, found = self._closest(points)
        offsets = points - places
        distances = np.linalg.norm(offsets, axis=-1)
        normals = self._normals_at(places, found)
        signs = np.where(self._sheet[found] | (np.sum(offsets * normals, axis=-1) >= 0), 1.0, -1.0)
        away = offsets / np.maximum(distances, TOUCHING)[:, None] * signs[:, None]
        normals = np.where((distances > TOUCHING)[:, None], away, normals)
        return (signs * distances).astype(np.float32), normals.astype(np.float32)

    def _normals_at(self, places: Array, found: np.ndarray) -> Array:
        """Pseudonormals [N, 3] at places on triangles."""
        weights = _barycentric(places, self._corners[found])
        on_sides = weights < ON_SIDE
        count = on_sides.sum(axis=-1)
        normals = self._normals[found]
        on_side, on_corner = count == 1, count >= 2
        normals[on_side] = self._side_normals[found[on_side], np.argmin(weights[on_side], axis=-1)]
        normals[on_corner] = self._corner_normals[found[on_corner], np.argmax(weights[on_corner], axis=-1)]
        return normals


def _pseudonormals(corners: Array, welded: np.ndarray) -> tuple[Array, Array, Array]:
    """Of triangles [F, 3, 3]: unit normals [F, 3], and those of their sides, each opposite to a corner, and of their corners [F, 3, 3]."""
    sides = np.roll(corners, -1, axis=1) - corners  # from each corner to the next
    normals = normalize(np.cross(sides[:, 0], sides[:, 1]))
    directions = normalize(sides)
    angles = np.arccos(np.clip(-np.sum(directions * np.roll(directions, 1, axis=1), axis=-1), -1, 1))
    at_corners = _summed(welded.ravel(), np.repeat(normals, 3, axis=0) * angles.reshape(-1, 1))
    starts, ends = np.roll(welded, -1, axis=1).ravel(), np.roll(welded, -2, axis=1).ravel()
    pairs = np.minimum(starts, ends) * (int(welded.max(initial=0)) + 1) + np.maximum(starts, ends)
    at_sides = _summed(np.unique(pairs, return_inverse=True)[1].ravel(), np.repeat(normals, 3, axis=0))
    return normals, normalize(at_sides).reshape(-1, 3, 3), normalize(at_corners).reshape(-1, 3, 3)


def _summed(groups: np.ndarray, vectors: Array) -> Array:
    """For each of the vectors [N, 3] the sum over its group, int [N]."""
    return np.stack([np.bincount(groups, column).astype(np.float64) for column in vectors.T], axis=-1)[groups]


def _barycentric(places: Array, corners: Array) -> Array:
    """Barycentric coordinates [N, 3] of places on triangles [N, 3, 3]."""
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(a, b)
    beside = places - corners[:, 0]
    area = np.maximum(np.sum(normal * normal, axis=-1), 1e-30)
    second = np.sum(np.cross(beside, b) * normal, axis=-1) / area
    third = np.sum(np.cross(a, beside) * normal, axis=-1) / area
    return np.stack((1 - second - third, second, third), axis=-1)
