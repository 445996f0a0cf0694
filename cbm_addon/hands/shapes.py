"""Solid shapes with exact signed distances, in world metres (Quilez, "distance functions", gives the formulas).

Where the nearest point of the surface is not unique, the normal is that of one of them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ..motion.rotations import IDENTITY, Array, matrix_from_quat, normalize
from .obstacle import Obstacle, empty

_TINY = 1e-9


def _directions(vectors: Array, lengths: Array) -> Array:
    """Unit vectors [N, 3]; +Z where the length is zero."""
    safe = lengths > _TINY
    return np.where(safe[:, None], vectors / np.where(safe, lengths, 1)[:, None], np.array([0, 0, 1], vectors.dtype)).astype(np.float32)


@dataclass(frozen=True)
class Sphere:
    centre: Array
    radius: float

    def nearest(self, points: Array) -> tuple[Array, Array]:
        offset = points - self.centre
        length = np.linalg.norm(offset, axis=-1)
        return (length - self.radius).astype(np.float32), _directions(offset, length)


@dataclass(frozen=True)
class Spheres:
    """Many spheres: `centres` [C, 3], as large as `radii` [C]."""

    centres: Array
    radii: Array

    def nearest(self, points: Array) -> tuple[Array, Array]:
        squares = (points * points).sum(-1)[:, None] - 2 * points @ self.centres.T + (self.centres * self.centres).sum(-1)
        chosen = (np.sqrt(np.maximum(squares, 0)) - self.radii).argmin(-1)
        offset = points - self.centres[chosen]
        length = np.linalg.norm(offset, axis=-1)
        return (length - self.radii[chosen]).astype(np.float32), _directions(offset, length)


@dataclass(frozen=True)
class HalfSpace:
    """Everything behind the plane through `point`, whose unit `normal` points out of it."""

    point: Array
    normal: Array

    def nearest(self, points: Array) -> tuple[Array, Array]:
        normal = np.asarray(self.normal, np.float32)
        return ((points - self.point) @ normal).astype(np.float32), np.broadcast_to(normal, points.shape).copy()


@dataclass(frozen=True)
class Box:
    """`half` [3] are its half sizes along its own axes."""

    centre: Array
    half: Array
    rotation: Array = field(default_factory=lambda: IDENTITY)

    @cached_property
    def _matrix(self) -> Array:
        return matrix_from_quat(np.asarray(self.rotation, np.float32))

    def nearest(self, points: Array) -> tuple[Array, Array]:
        local = (points - self.centre) @ self._matrix
        sign = np.where(local < 0, -1, 1).astype(np.float32)
        beyond = np.abs(local) - self.half
        outside = np.maximum(beyond, 0)
        length = np.linalg.norm(outside, axis=-1)
        depth = beyond.max(-1)
        face = np.eye(3, dtype=np.float32)[beyond.argmax(-1)]
        normals = np.where((depth > 0)[:, None], normalize(outside), face) * sign
        return np.where(depth > 0, length, depth).astype(np.float32), (normals @ self._matrix.T).astype(np.float32)


@dataclass(frozen=True)
class Cylinder:
    """A closed cylinder about its own Z axis."""

    centre: Array
    radius: float
    half_height: float
    rotation: Array = field(default_factory=lambda: IDENTITY)

    @cached_property
    def _matrix(self) -> Array:
        return matrix_from_quat(np.asarray(self.rotation, np.float32))

    def nearest(self, points: Array) -> tuple[Array, Array]:
        local = (points - self.centre) @ self._matrix
        radial = np.linalg.norm(local[:, :2], axis=-1)
        side = radial - self.radius
        cap = np.abs(local[:, 2]) - self.half_height
        outwards = np.zeros_like(local)
        outwards[:, :2] = local[:, :2] / np.maximum(radial, _TINY)[:, None]
        outwards[radial <= _TINY, 0] = 1
        upwards = np.zeros_like(local)
        upwards[:, 2] = np.where(local[:, 2] < 0, -1, 1)
        beyond = np.stack((side, cap), -1)
        depth = beyond.max(-1)
        weights = np.where((depth > 0)[:, None], normalize(np.maximum(beyond, 0)), np.eye(2)[beyond.argmax(-1)])
        normals = weights[:, :1] * outwards + weights[:, 1:] * upwards
        distance = np.where(depth > 0, np.linalg.norm(np.maximum(beyond, 0), axis=-1), depth)
        return distance.astype(np.float32), (normals @ self._matrix.T).astype(np.float32)


@dataclass(frozen=True)
class Capsules:
    """Lines `starts` to `ends` [C, 3], as thick as `radii` [C]: a limb, a handle, another hand."""

    starts: Array
    ends: Array
    radii: Array

    def nearest(self, points: Array) -> tuple[Array, Array]:
        along = self.ends - self.starts
        share = np.einsum("nci,ci->nc", points[:, None] - self.starts, along) / np.maximum((along * along).sum(-1), _TINY)
        offset = points[:, None] - (self.starts + np.clip(share, 0, 1)[..., None] * along)
        length = np.linalg.norm(offset, axis=-1)
        distance = length - self.radii
        chosen = np.arange(len(points)), distance.argmin(-1)
        return distance[chosen].astype(np.float32), _directions(offset[chosen], length[chosen])


def together(capsules: list[Capsules]) -> Capsules:
    """Several lists of capsules, at least one, as one."""
    return Capsules(*(np.concatenate(values) for values in zip(*((each.starts, each.ends, each.radii) for each in capsules), strict=True)))


def capsule(start: Array, end: Array, radius: float) -> Capsules:
    """One capsule."""
    return Capsules(np.asarray(start, np.float32)[None], np.asarray(end, np.float32)[None], np.array([radius], np.float32))


@dataclass(frozen=True)
class Union:
    """Several obstacles as one: the least distance. Inside more than one of them it is a bound, not the exact depth."""

    parts: tuple[Obstacle, ...]

    def nearest(self, points: Array) -> tuple[Array, Array]:
        distance, normals = empty().nearest(points)
        for part in self.parts:
            other, other_normals = part.nearest(points)
            closer = other < distance
            distance = np.where(closer, other, distance)
            normals = np.where(closer[:, None], other_normals, normals)
        return distance, normals


@dataclass(frozen=True)
class Moved:
    """An obstacle that was turned by `rotation` [4] about the origin and then shifted by `position` [3]."""

    obstacle: Obstacle
    position: Array
    rotation: Array = field(default_factory=lambda: IDENTITY)

    @cached_property
    def _matrix(self) -> Array:
        return matrix_from_quat(np.asarray(self.rotation, np.float32))

    def nearest(self, points: Array) -> tuple[Array, Array]:
        distance, normals = self.obstacle.nearest(((points - self.position) @ self._matrix).astype(np.float32))
        return distance, (normals @ self._matrix.T).astype(np.float32)


@dataclass(frozen=True)
class Scaled:
    """An obstacle `factor` times as large, about the origin."""

    obstacle: Obstacle
    factor: float

    def nearest(self, points: Array) -> tuple[Array, Array]:
        distance, normals = self.obstacle.nearest((points / np.float32(self.factor)).astype(np.float32))
        return distance * np.float32(self.factor), normals
