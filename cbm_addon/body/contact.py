"""What holds and what pushes a body that keeps clear: how deep it is inside, how far its head, hands and feet are from where they were."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np

from ..motion.contacts import contact_labels
from ..motion.motion import Motion
from ..motion.rotations import Array
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


class Surroundings:
    """A body with its freedom among solids; T frames.

    hold  how strongly head and wrists stay with their trackers, 1 by default
    """

    def __init__(self, freedom: Freedom, shape: BodyShape, nearest: Nearest, hold: float) -> None:
        self.freedom, self.shape, self.nearest = freedom, shape, nearest
        planted = planted_feet(freedom.motion)
        self._standing = np.zeros_like(planted)  # also where a foot is about to stand, or has just stood: it may be on a floor that is an obstacle
        self._places = freedom.positions[:, freedom.held]
        self._centres = self._centre(shape.lumps.world(freedom.world, freedom.positions))
        strength = np.full(self._places.shape[:2], hold / TRACKER)
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

    def _centre(self, lumps: Array) -> Array:
        """Where the centre of mass is over the floor, [T, 2], from the places of the lumps [T, L, 3]."""
        return self.shape.masses @ lumps[..., :2]

    def pull(self, frames: np.ndarray, changes: Array, curved: bool = True) -> Pull:
        """What rows of changes [R, n] at frames int [R] cost, without what the changes themselves cost, and, if it is to be `curved`, which way is down."""
        starts = range(0, len(frames), TOGETHER)
        parts = [self._pull(frames[start : start + TOGETHER], changes[start : start + TOGETHER], curved) for start in starts]
        return Pull(*(np.concatenate([getattr(part, field.name) for part in parts]) for field in fields(Pull)))

    def _pull(self, frames: np.ndarray, changes: Array, curved: bool) -> Pull:
        freedom, joints = self.freedom, self.shape.axes.joints
        posed = freedom.posed(frames, changes)
        depths, points, normals = self._touch(frames, posed)
        inside = depths > -CLEARANCE
        apart = posed.positions[:, freedom.held] - self._places[frames]
        lumps = self.shape.lumps.world(posed.rotations, posed.positions)
        swayed = (self._centre(lumps) - self._centres[frames]) / BALANCE
        beyond = np.clip(posed.bends, LEAST, MOST) - posed.bends
        strength = self._strength[frames]
        pushed = np.where(inside, depths + CLEARANCE, 0) / TOUCH
        held = apart * strength[..., None]
        cost = (pushed**2).sum(-1) + (held**2).sum((-1, -2)) + (swayed**2).sum(-1) + ((beyond / BEND) ** 2).sum(-1)
        if not curved:
            return Pull(np.empty(0), np.empty(0), cost, depths.max(-1))
        some = np.flatnonzero(inside.any(0))
        outward = freedom.slopes(posed, joints[some], points[:, some], normals[:, some].astype(np.float64))
        rows = [np.where(inside[:, some, None], outward, 0) / TOUCH]
        right = [pushed[:, some]]
        for axis in np.eye(3):
            along = np.broadcast_to(axis, apart.shape)
            rows.append(freedom.slopes(posed, freedom.held, posed.positions[:, freedom.held], along) * strength[..., None])
            right.append(-held @ axis)
        for axis in range(2):
            along = np.broadcast_to(np.eye(3)[axis], lumps.shape)
            rows.append(self.shape.masses[None, None] @ freedom.slopes(posed, self.shape.lumps.joints, lumps, along) / BALANCE)
            right.append(-swayed[:, axis : axis + 1])
        hinges = np.zeros((len(frames), len(freedom.hinges), len(freedom)))
        hinges[:, np.arange(len(freedom.hinges)), freedom.hinges] = (beyond != 0) / BEND
        rows.append(hinges)
        right.append(beyond / BEND)
        jacobian, residual = np.concatenate(rows, 1), np.concatenate(right, 1)
        transposed = np.swapaxes(jacobian, -1, -2)
        return Pull((transposed @ residual[..., None])[..., 0], transposed @ jacobian, cost, depths.max(-1))


def planted_feet(motion: Motion) -> np.ndarray:
    """bool [T, 2]: where the left and the right foot stand, on the ankle or on the toes."""
    positions, body = motion.positions(), motion.skeleton
    joints = [[name for name in (f"{side}Foot", f"{side}Toe") if name in body] for side in SIDES]
    return np.stack([contact_labels(body, positions, motion.rate, names).any(-1) for names in joints], -1)
