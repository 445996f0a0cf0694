"""The shape of a body: capsules around its bones, as points that its joints carry."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from ..motion.rotations import Array, normalize
from ..motion.skeleton import Skeleton
from ..motion.thickness import FIST, FOOT, HAND, HEAD, LIMBS, NECK, NEXT, SKULL, TRUNK

SIDES = ("Left", "Right")
SOLE = 0.015  # of the joint of the toes above the floor, in standing heights of the head joint
SPACING = 0.035  # between points on the axis of a capsule, in standing heights
FILLING = 300  # points in the cylinder around a capsule, of which those count that are in the capsule


@dataclass(frozen=True)
class Part:
    """A tapered capsule that a joint carries, or two side by side, in the joint's frame (world axes in the T-pose), in the units of the skeleton.

    start, end  [3]
    radii       at the start and at the end
    beside      [3]: from the middle to one of two capsules; zeros if there is one
    """

    joint: str
    start: Array
    end: Array
    radii: tuple[float, float]
    beside: Array


def standard_parts(body: Skeleton) -> list[Part]:
    """The parts of a body in the T-pose that faces -Y, as thick as its height says."""
    unit, rest = body.height_above_toes(), body.rest_positions()
    left, up, front, zero = (np.array(axis, np.float64) for axis in ((1, 0, 0), (0, 0, 1), (0, -1, 0), (0, 0, 0)))

    def part(joint: str, end: Array, sizes: tuple[float, float, float], start: Array = zero, beside: Array = left) -> Part:
        begins, ends, apart = (unit * size for size in sizes)
        return Part(joint, np.asarray(start, np.float64), np.asarray(end, np.float64), (begins, ends), apart * beside)

    spine = [body.names[joint] for joint in body.chain("Hips", "Head")]
    parts = [part("Head", unit * SKULL[1] * up, HEAD, unit * SKULL[0] * up)]
    for lower, upper in pairwise(spine):
        slim = lower == "Neck" or (upper == "Head" and "Neck" not in body)
        parts.append(part(lower, rest[body.index(upper)] - rest[body.index(lower)], NECK if slim else TRUNK))
    for side, outward in zip(SIDES, (left, -left), strict=True):
        for limb, sizes in LIMBS.items():
            following = side + NEXT[limb]
            end = body.offsets[body.index(following)] if following in body else FOOT * unit * front
            parts.append(part(side + limb, end, sizes))
        parts.append(part(f"{side}Hand", FIST * unit * outward, HAND, beside=front))
    return parts


@dataclass(frozen=True)
class Points:
    """M points that joints carry: `joints` int [M], `offsets` float64 [M, 3] in their frames."""

    joints: np.ndarray
    offsets: Array

    def world(self, rotations: Array, positions: Array) -> Array:
        """[T, M, 3] from world rotation matrices [T, J, 3, 3] and positions [T, J, 3] of the joints."""
        return (rotations[:, self.joints] @ self.offsets[..., None])[..., 0] + positions[:, self.joints]


@dataclass(frozen=True)
class BodyShape:
    """A body that has room.

    unit   standing height of its head joint
    axes   points on the axes of its capsules, M of them, `radii` [M] thick
    cloud  points that fill it, each of which stands for `volumes` [V]
    lumps  the middle of what each joint carries, and `masses` [L], which sum to 1: flesh is equally heavy everywhere
    """

    body: Skeleton
    unit: float
    axes: Points
    radii: Array
    cloud: Points
    volumes: Array
    lumps: Points
    masses: Array

    @cached_property
    def feet(self) -> np.ndarray:
        """bool [2, M]: which points are of the left and of the right foot."""
        return np.stack([np.isin(self.axes.joints, [self.body.index(name) for name in (f"{side}Foot", f"{side}Toe") if name in self.body]) for side in SIDES])

    @cached_property
    def arms(self) -> np.ndarray:
        """int [A]: the points of forearms and hands."""
        return np.flatnonzero(np.isin(self.axes.joints, [self.body.index(side + name) for side in SIDES for name in ("ForeArm", "Hand")]))

    @cached_property
    def beside_arms(self) -> np.ndarray:
        """int [B]: the points of what those may meet: head, trunk and legs."""
        whole = [side + name for side in SIDES for name in ("Shoulder", "Arm", "ForeArm", "Hand")]
        return np.flatnonzero(~np.isin(self.axes.joints, [self.body.index(name) for name in whole if name in self.body]))


def body_shape(body: Skeleton, parts: list[Part] | None = None, sole: float | None = None) -> BodyShape:
    """The shape of a body from its parts, by default the standard ones. `sole` is how high its lowest foot joint is above the floor: feet are no
    thicker than that allows, so that a floor is nothing that they must avoid."""
    unit, axes, cloud = body.height_above_toes(), [], []
    floor = min(body.rest_positions()[joint, 2] for joint in _foot_joints(body)) - (SOLE * unit if sole is None else sole)
    for part in standard_parts(body) if parts is None else parts:
        lines = (part.beside, -part.beside) if np.any(part.beside) else (part.beside,)
        for beside in lines:
            line = replace(part, start=part.start + beside, end=part.end + beside)
            axes.append(_on_axis(body, line, SPACING * unit))
            cloud.append(_within(body, line, len(lines)))
    joints, offsets, radii = (np.concatenate(values) for values in zip(*axes, strict=True))
    above = body.rest_positions()[joints, 2] + offsets[:, 2] - floor
    radii = np.where(np.isin(joints, _foot_joints(body)), np.minimum(radii, above), radii)
    carriers, filled, volumes = (np.concatenate(values) for values in zip(*cloud, strict=True))
    heavy, owner = np.unique(carriers, return_inverse=True)
    masses = np.bincount(owner, volumes)
    middles = np.stack([np.bincount(owner, volumes * column) for column in filled.T], -1) / masses[:, None]
    lumps = Points(heavy, middles)
    return BodyShape(body, unit, Points(joints, offsets), radii, Points(carriers, filled), volumes, lumps, masses / masses.sum())


def _foot_joints(body: Skeleton) -> list[int]:
    return [body.index(name) for side in SIDES for name in (f"{side}Foot", f"{side}Toe") if name in body]


def _on_axis(body: Skeleton, line: Part, spacing: float) -> tuple[np.ndarray, Array, Array]:
    count = 1 + max(1, int(np.ceil(np.linalg.norm(line.end - line.start) / spacing)))
    shares = np.linspace(0, 1, count)[:, None]
    return np.full(count, body.index(line.joint)), line.start + shares * (line.end - line.start), np.interp(shares[:, 0], (0, 1), line.radii)


def _within(body: Skeleton, line: Part, lines: int) -> tuple[np.ndarray, Array, Array]:
    """Points that fill a capsule evenly, its round ends included; the volume of two that lie side by side is shared."""
    along, wide = line.end - line.start, max(line.radii)
    length = np.linalg.norm(along)
    across = normalize(np.cross(along, np.eye(3)[np.argmin(np.abs(along))]))
    other = normalize(np.cross(along, across))
    u, v, w = (_spread(FILLING, base) for base in (2, 3, 5))
    height = -wide + u * (length + 2 * wide)
    radius, turn = wide * np.sqrt(v), 2 * np.pi * w
    share = np.clip(height / max(length, 1e-9), 0, 1)
    kept = np.hypot(radius, height - share * length) < np.interp(share, (0, 1), line.radii)
    sides = radius[:, None] * (np.cos(turn)[:, None] * across + np.sin(turn)[:, None] * other)
    offsets = (line.start + height[:, None] * normalize(along) + sides)[kept]
    each = np.pi * wide**2 * (length + 2 * wide) / FILLING / lines
    return np.full(len(offsets), body.index(line.joint)), offsets, np.full(len(offsets), each)


def _spread(count: int, base: int) -> Array:
    """Numbers between 0 and 1 that fill it evenly, however many are taken (van der Corput)."""
    values, digits, scale = np.zeros(count), np.arange(1, count + 1), 1.0
    while digits.any():
        scale /= base
        digits, digit = np.divmod(digits, base)
        values += scale * digit
    return values
