"""What holds and what pushes a body that keeps clear: how deep it is inside, how far its head, hands and feet are from where they were."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np

from ..motion.contacts import contact_labels
from ..motion.motion import Motion
from ..motion.rotations import Array, normalize
from .freedom import LEAST, MOST, Freedom, Posed
from .shape import SIDES, BodyShape

Nearest = Callable[[np.ndarray, Array], tuple[Array, Array]]
"""(frames int [R], world points [R, M, 3]) -> distances [R, M], normals [R, M, 3]; hands/obstacle.over_time makes it."""

CLEARANCE = 0.004  # metres that are left between body and surface
TOUCH = 0.003  # metres of depth that cost as much as a change of EASE
TRACKER = 0.015  # metres of head and wrists from their places
PLANTED = 0.001  # metres of a planted ankle
SWINGING = 0.06  # metres of an ankle in the air
BALANCE = 0.03  # metres by which the centre of mass is displaced over the floor
BEND = 0.03  # radians of a hinge beyond its range
TOGETHER = 1000  # rows that are looked at in one go, for the memory that they take
SETTLING = 0.1  # seconds over which a foot's hold comes and goes


@dataclass(frozen=True)
class Pull:
    """Half the gradient, downhill [R, n], and the Gauss-Newton curvature [R, n, n] of the cost [R] of rows of changes, and the deepest depth [R]."""

    slope: Array
    curvature: Array
    cost: Array
    depth: Array


@dataclass(frozen=True)
class _Term:
    """What is squared in a part of the cost, [R, k], and how fast it grows with each change, [R, k, n], when that is asked for."""

    residual: Array
    slopes: Callable[[], Array]


class Surroundings:
    """A body with its freedom among solids; T frames.

    hold  how strongly head and wrists stay with their trackers, 1 by default
    """

    def __init__(self, freedom: Freedom, shape: BodyShape, nearest: Nearest, hold: float) -> None:
        self.freedom, self.shape, self.nearest = freedom, shape, nearest
        planted = planted_feet(freedom.motion)
        self._standing = np.zeros_like(planted)  # also where a foot is about to stand, or has just stood: it may be on a floor that is an obstacle
        self._places = freedom.positions[:, freedom.held]
        wanted = shape.axes.world(freedom.world, freedom.positions)
        self._met = np.concatenate([self._meeting(wanted[start : start + TOGETHER])[0] for start in range(0, len(wanted), TOGETHER)])
        self._met = np.maximum(self._met, -CLEARANCE)
        self._centres = self._centre(shape.lumps.world(freedom.world, freedom.positions))
        strength = np.full(self._places.shape[:2], hold / TRACKER)
        own = self._own_depths(wanted)
        strength[:, : own.shape[1]] /= 1 + np.maximum(own, 0) / TRACKER  # what is itself inside cannot stay
        reach = max(1, round(SETTLING * freedom.motion.rate))
        window = np.hanning(2 * reach + 3)[1:-1]
        for i in range(len(SIDES)):
            padded = np.pad(planted[:, i], reach)
            near = np.max([padded[shift : shift + len(planted)] for shift in range(2 * reach + 1)], axis=0)
            eased = np.convolve(np.pad(near.astype(float), reach, mode="edge"), window / window.sum(), "valid")
            strength[:, 3 + i] = np.where(planted[:, i], 1 / PLANTED, np.exp(np.log(1 / SWINGING) + eased * np.log(SWINGING / PLANTED)))
            self._standing[:, i] = near
        self._strength = strength

    def depths(self, frames: np.ndarray, changes: Array) -> Array:
        """How deep the points of the body [R, M] are inside, metres, negative outside; feet that stand never are."""
        return self._touch(frames, self.freedom.posed(frames, changes))[0]

    def _touch(self, frames: np.ndarray, posed: Posed) -> tuple[Array, Array, Array]:
        points = self.shape.axes.world(posed.rotations, posed.positions)
        distances, normals = self.nearest(frames, points.astype(np.float32))
        depths = self.shape.radii - distances
        standing = (self._standing[frames][:, :, None] & self.shape.feet).any(1)
        return np.where(standing, -1.0, depths), points, normals

    def _own_depths(self, points: Array) -> Array:
        """How deep head and hands themselves are inside, [T, 3], of points of the body [T, M, 3]."""
        parts = [np.flatnonzero(self.shape.axes.joints == joint) for joint in self.freedom.held[:3]]
        frames = np.arange(len(points))
        return np.stack([(self.shape.radii[part] - self.nearest(frames, points[:, part].astype(np.float32))[0]).max(-1) for part in parts], -1)

    def _meeting(self, points: Array) -> tuple[Array, np.ndarray]:
        """How deep the points of forearms and hands [T, A] are in the rest of the body, and which of its points is nearest int [T, A]; of points [T, M, 3]."""
        arms, rest = points[:, self.shape.arms], points[:, self.shape.beside_arms]
        squares = (arms * arms).sum(-1)[..., None] + (rest * rest).sum(-1)[:, None] - 2 * arms @ np.swapaxes(rest, -1, -2)
        gaps = np.sqrt(np.maximum(squares, 1e-12)) - self.shape.radii[self.shape.beside_arms]
        nearest = gaps.argmin(-1)
        return self.shape.radii[self.shape.arms] - np.take_along_axis(gaps, nearest[..., None], -1)[..., 0], self.shape.beside_arms[nearest]

    def _centre(self, lumps: Array) -> Array:
        """Where the centre of mass is over the floor, [T, 2], from the places of the lumps [T, L, 3]."""
        return self.shape.masses @ lumps[..., :2]

    def pull(self, frames: np.ndarray, changes: Array, curved: bool = True) -> Pull:
        """What rows of changes [R, n] at frames int [R] cost, without what the changes themselves cost, and, if it is to be `curved`, which way is down."""
        starts = range(0, len(frames), TOGETHER)
        parts = [self._pull(frames[start : start + TOGETHER], changes[start : start + TOGETHER], curved) for start in starts]
        return Pull(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Pull)))

    def _pull(self, frames: np.ndarray, changes: Array, curved: bool) -> Pull:
        posed = self.freedom.posed(frames, changes)
        depths, points, normals = self._touch(frames, posed)
        terms = [
            self._solids(posed, depths, points, normals),
            self._itself(frames, posed, points),
            self._places_held(frames, posed),
            self._balance(frames, posed),
            self._hinges(posed),
        ]
        cost = sum((term.residual**2).sum(-1) for term in terms)
        if not curved:
            return Pull(np.empty(0), np.empty(0), cost, depths.max(-1))
        slopes, residual = np.concatenate([term.slopes() for term in terms], 1), np.concatenate([term.residual for term in terms], 1)
        transposed = np.swapaxes(slopes, -1, -2)
        return Pull(-(transposed @ residual[..., None])[..., 0], transposed @ slopes, cost, depths.max(-1))

    def _solids(self, posed: Posed, depths: Array, points: Array, normals: Array) -> _Term:
        """Nothing is inside of what is around."""
        some = np.flatnonzero((depths > -CLEARANCE).any(0))
        inside = depths[:, some] > -CLEARANCE

        def slopes() -> Array:
            out = self.freedom.slopes(posed, self.shape.axes.joints[some], points[:, some], normals[:, some].astype(np.float64))
            return np.where(inside[..., None], out, 0) / -TOUCH

        return _Term(np.where(inside, depths[:, some] + CLEARANCE, 0) / TOUCH, slopes)

    def _itself(self, frames: np.ndarray, posed: Posed, points: Array) -> _Term:
        """Forearms and hands are no deeper in the rest of the body than they were wanted."""
        joints = self.shape.axes.joints
        meeting, others = self._meeting(points)
        entered = np.maximum(meeting - self._met[frames], 0)
        some = np.flatnonzero((entered > 0).any(0))
        arms, others, entered = self.shape.arms[some], others[:, some], entered[:, some]

        def slopes() -> Array:
            reaching, met = points[:, arms], points[np.arange(len(frames))[:, None], others]
            out = normalize(reaching - met)
            apart = self.freedom.slopes(posed, joints[arms], reaching, out) - self.freedom.slopes(posed, joints[others], met, out)
            return np.where(entered[..., None] > 0, apart, 0) / -TOUCH

        return _Term(entered / TOUCH, slopes)

    def _places_held(self, frames: np.ndarray, posed: Posed) -> _Term:
        """Head, wrists and ankles are where they were wanted."""
        places, strength = posed.positions[:, self.freedom.held], self._strength[frames]

        def slopes() -> Array:
            along = (self.freedom.slopes(posed, self.freedom.held, places, np.broadcast_to(axis, places.shape)) for axis in np.eye(3))
            return np.concatenate([rows * strength[..., None] for rows in along], 1)

        return _Term(np.concatenate(np.moveaxis((places - self._places[frames]) * strength[..., None], -1, 0), -1), slopes)

    def _balance(self, frames: np.ndarray, posed: Posed) -> _Term:
        """The centre of mass is over where it was."""
        lumps = self.shape.lumps.world(posed.rotations, posed.positions)

        def slopes() -> Array:
            along = (self.freedom.slopes(posed, self.shape.lumps.joints, lumps, np.broadcast_to(axis, lumps.shape)) for axis in np.eye(3)[:2])
            return np.concatenate([self.shape.masses[None, None] @ rows for rows in along], 1) / BALANCE

        return _Term((self._centre(lumps) - self._centres[frames]) / BALANCE, slopes)

    def _hinges(self, posed: Posed) -> _Term:
        """Elbows and knees are within their range."""
        beyond, hinges = posed.bends - np.clip(posed.bends, LEAST, MOST), self.freedom.hinges

        def slopes() -> Array:
            rows = np.zeros((*beyond.shape, len(self.freedom)))
            rows[:, np.arange(len(hinges)), hinges] = (beyond != 0) / BEND
            return rows

        return _Term(beyond / BEND, slopes)


def planted_feet(motion: Motion) -> np.ndarray:
    """bool [T, 2]: where the left and the right foot stand, on the ankle or on the toes."""
    positions, body = motion.positions(), motion.skeleton
    joints = [[name for name in (f"{side}Foot", f"{side}Toe") if name in body] for side in SIDES]
    return np.stack([contact_labels(body, positions, motion.rate, names).any(-1) for names in joints], -1)
