"""Solid shapes with exact signed distances, in world metres (Quilez, "distance functions", gives the formulas).

Where the nearest point of the surface is not unique, the normal is that of one of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ..motion.rotations import IDENTITY, Array, matrix_from_quat, normalize
from .obstacle import Obstacle, empty, nearest_of

TOGETHER = 1024  # points that are looked up at a time: what they need then stays in the processor's own memory
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
        beyond = np.abs(local) - self.half
        outside = np.maximum(beyond, 0)
        length, depth = np.sqrt(np.einsum("ni,ni->n", outside, outside)), np.maximum(np.maximum(beyond[:, 0], beyond[:, 1]), beyond[:, 2])
        normals = outside / np.maximum(length, _TINY)[:, None]
        inside = np.flatnonzero(depth <= 0)
        normals[inside] = np.eye(3)[beyond[inside].argmax(-1)]
        distance = np.where(depth > 0, length, depth)
        return distance.astype(np.float32), (np.copysign(normals, local) @ self._matrix.T).astype(np.float32)


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

    @property
    def kind(self) -> object:
        return Capsules, len(self.radii)

    def nearest(self, points: Array) -> tuple[Array, Array]:
        return self.nearest_of_alike([self], np.zeros(len(points), int), points)

    @staticmethod
    def nearest_of_alike(obstacles: Sequence[Capsules], which: np.ndarray, points: Array) -> tuple[Array, Array]:
        starts, ends, radii = (np.stack(values) for values in zip(*((each.starts, each.ends, each.radii) for each in obstacles), strict=True))
        distances, normals = np.empty(len(points), np.float32), np.empty((len(points), 3), np.float32)
        along = ends - starts
        shares = along / np.maximum((along * along).sum(-1, keepdims=True), _TINY)
        for first in range(0, len(points), TOGETHER):
            here = slice(first, first + TOGETHER)
            of = which[here] if len(obstacles) > 1 else slice(None)
            beside = points[here, None] - starts[of]
            share = np.clip(np.einsum("nci,nci->nc", beside, np.broadcast_to(shares[of], beside.shape)), 0, 1)
            offset = beside - share[..., None] * along[of]
            length = np.sqrt(np.einsum("nci,nci->nc", offset, offset))
            distance = length - radii[of]
            chosen = np.arange(len(distance)), distance.argmin(-1)
            distances[here], normals[here] = distance[chosen], _directions(offset[chosen], length[chosen])
        return distances, normals


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

    @property
    def kind(self) -> object:
        return Union, len(self.parts)

    def nearest(self, points: Array) -> tuple[Array, Array]:
        return self.nearest_of_alike([self], np.zeros(len(points), int), points)

    @staticmethod
    def nearest_of_alike(obstacles: Sequence[Union], which: np.ndarray, points: Array) -> tuple[Array, Array]:
        distance, normals = empty().nearest(points)
        for parts in zip(*(each.parts for each in obstacles), strict=True):
            other, other_normals = nearest_of(parts, which, points)
            closer = other < distance
            distance[closer], normals[closer] = other[closer], other_normals[closer]
        return distance, normals


@dataclass(frozen=True)
class Moved:
    """An obstacle that was turned by `rotation` [4] about the origin and then shifted by `position` [3]."""

    obstacle: Obstacle
    position: Array
    rotation: Array = field(default_factory=lambda: IDENTITY)

    @property
    def kind(self) -> object:
        return Moved

    def nearest(self, points: Array) -> tuple[Array, Array]:
        return self.nearest_of_alike([self], np.zeros(len(points), int), points)

    @staticmethod
    def nearest_of_alike(obstacles: Sequence[Moved], which: np.ndarray, points: Array) -> tuple[Array, Array]:
        positions = np.stack([each.position for each in obstacles]).astype(np.float32)
        matrices = matrix_from_quat(np.stack([each.rotation for each in obstacles]).astype(np.float32))[which]
        local = ((points - positions[which])[:, None] @ matrices)[:, 0]
        distance, normals = nearest_of([each.obstacle for each in obstacles], which, local.astype(np.float32))
        return distance, (matrices @ normals[..., None])[..., 0].astype(np.float32)


@dataclass(frozen=True)
class Scaled:
    """An obstacle `factor` times as large, about the origin."""

    obstacle: Obstacle
    factor: float

    @property
    def kind(self) -> object:
        return Scaled, self.factor

    def nearest(self, points: Array) -> tuple[Array, Array]:
        return self.nearest_of_alike([self], np.zeros(len(points), int), points)

    @staticmethod
    def nearest_of_alike(obstacles: Sequence[Scaled], which: np.ndarray, points: Array) -> tuple[Array, Array]:
        factor = np.float32(obstacles[0].factor)
        distance, normals = nearest_of([each.obstacle for each in obstacles], which, (points / factor).astype(np.float32))
        return distance * factor, normals
