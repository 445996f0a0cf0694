"""Geometry that is made around a pose which it leaves free: independent noise as in the paper, and solid shapes.

All in the palm's frame and in lengths of the hand.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...hands.contact import SOLVING, axis_points, palm_points, point_radii
from ...hands.hand import FINGERS, Hand, finger_angles
from ...hands.sensor import Grid, wanted_places
from ...motion.rotations import Array, matrix_from_quat, multiply, normalize, quat_between, quat_from_axis_angle
from .pose_bank import HandBank

SECOND = 0.35  # share of the samples that see a second shape
LARGE = 5.0  # half sizes of a half space


@dataclass(frozen=True)
class Samples:
    """What the network takes and what it is to give: occupancy [N, C], places [N, 60], angles [N, 20]."""

    occupancy: Array
    places: Array
    angles: Array


def noise_samples(bank: HandBank, grid: Grid, count: int, random: np.random.Generator) -> Samples:
    """Eq. 9: cells of the hand are empty, all others random. Eq. 10: each joint is wanted somewhere between where it is and the nearest
    cell that is not empty."""
    chosen = random.integers(len(bank.angles), size=count)
    angles, free = bank.angles[chosen], bank.hand_distances(chosen) >= grid.cell
    occupancy = np.where(free, random.random(free.shape), 0).astype(np.float32)
    centres = grid.centres()
    places = wanted_places(bank.hand, bank.hand.positions(angles)).reshape(count, -1, 3)
    apart = (places * places).sum(-1, keepdims=True) - 2 * places @ centres.T + (centres * centres).sum(-1)
    closest = centres[np.where(free[:, None], apart, np.inf).argmin(-1)]
    share = random.random((*places.shape[:2], 1)).astype(np.float32)
    return Samples(occupancy, (places + share * (closest - places)).reshape(count, -1), angles)


@dataclass(frozen=True)
class Solids:
    """One rounded box for each sample: what spheres, boxes, capsules, sheets and half spaces are. `offset` moves their surface inwards.

    centres [N, 3], rotations [N, 3, 3] (columns are its axes), halves [N, 3], rounding [N], offset [N]
    """

    centres: Array
    rotations: Array
    halves: Array
    rounding: Array
    offset: Array

    def part(self, chosen: np.ndarray) -> Solids:
        return Solids(*(getattr(self, name)[chosen] for name in ("centres", "rotations", "halves", "rounding", "offset")))

    def distances(self, points: Array) -> Array:
        """Signed distances [N, M] of points [N, M, 3] or [M, 3]."""
        turned = points @ self.rotations - (self.centres[:, None] @ self.rotations)
        local = np.abs(turned, out=turned)
        local -= self.halves[:, None]
        inside = np.minimum(np.maximum(np.maximum(local[..., 0], local[..., 1]), local[..., 2]), 0)
        outside = np.maximum(local, 0, out=local)
        return np.sqrt(np.einsum("nmi,nmi->nm", outside, outside)) + inside - (self.rounding - self.offset)[:, None]


def random_solids(near: Array, normals: Array, random: np.random.Generator) -> Solids:
    """Solids [N] of every kind whose surfaces pass through the points `near` [N, 3], where they face along `normals` [N, 3]."""
    count = len(near)
    kind = random.choice(5, size=count, p=(0.2, 0.25, 0.2, 0.2, 0.15))
    size = np.exp(random.uniform(np.log(0.06), np.log(0.6), size=(count, 3)))
    zero = np.zeros(count)
    halves = np.select(
        [(kind == k)[:, None] for k in range(5)],
        [
            np.zeros((count, 3)),  # sphere
            size,  # box
            np.stack((zero, zero, 0.1 + size[:, 0]), -1),  # capsule
            np.stack((0.2 + size[:, 0], 0.2 + size[:, 1], zero), -1),  # sheet
            np.full((count, 3), LARGE),  # half space
        ],
    )
    rounding = np.select([kind == k for k in range(5)], [0.06 + 0.5 * size[:, 0], zero + 0.01, 0.03 + 0.3 * size[:, 1] ** 1.5, 0.01 + 0.03 * size[:, 2], zero])
    axis = np.where(kind == 3, 2, random.integers(3, size=count))
    face = np.eye(3)[axis] * random.choice([-1, 1], size=(count, 1))
    turn = matrix_from_quat(multiply(quat_between(face, normals), quat_from_axis_angle(face, random.uniform(0, 2 * np.pi, size=count))))
    on_face = random.uniform(-0.9, 0.9, size=(count, 3)) * halves * np.where(kind == 4, 0, 1)[:, None] * (1 - np.abs(face))
    on_face += face * (halves + rounding[:, None])
    centres = near - (turn @ on_face[..., None])[..., 0]
    return Solids(*(values.astype(np.float32) for values in (centres, turn, halves, rounding, zero)))


def fitted_solids(solid: Solids, outwards: Array, points: Array, radii: Array, gap: Array, there: np.ndarray) -> Solids:
    """Solids [N] moved along `outwards` [N, 3] until they leave a `gap` [N] to points [N, M, 3] that are `radii` [M] thick; what is left of them then
    gives way. Those that are not `there` [N] are far away."""
    for _ in range(3):
        shift = np.where(there, gap - (solid.distances(points) - radii).min(-1), 2 * LARGE)
        solid = replace(solid, centres=(solid.centres + outwards * np.maximum(shift, 0)[:, None]).astype(np.float32))
    offset = np.where(there, gap - (solid.distances(points) - radii).min(-1), 0)
    return replace(solid, offset=offset.astype(np.float32))


def shape_samples(bank: HandBank, grid: Grid, count: int, random: np.random.Generator) -> Samples:
    """Solid shapes whose surface gives way until it touches a free pose, or leaves a gap, and a wanted pose some fingers of which are bent into
    them."""
    chosen = random.integers(len(bank.angles), size=count)
    hand, angles = bank.hand, bank.angles[chosen]
    points, radii = _touching(hand, angles)
    fingers = point_radii(hand, SOLVING).size
    distances, solids = np.full((count, grid.count), np.inf, np.float32), []
    for share in (1.0, SECOND):
        near = points[np.arange(count), random.integers(fingers, size=count)] + random.normal(scale=0.02, size=(count, 3))
        outwards = normalize(random.normal(scale=0.6, size=(count, 3)) + [0, 0, 1])
        solid = random_solids(near, -outwards, random)
        gap = np.where(random.random(count) < 0.7, 0, random.exponential(0.04, size=count))
        there = random.random(count) < share
        solid = fitted_solids(solid, outwards, points, radii, gap, there)
        distances[there] = np.minimum(distances[there], solid.part(there).distances(grid.centres()))
        solids.append(solid)
    wanted = _bent_into(hand, angles, solids, random)
    return Samples(grid.occupancy(distances), wanted_places(hand, hand.positions(wanted)), angles)


def _touching(hand: Hand, angles: Array) -> tuple[Array, Array]:
    """Points of fingers and then of the palm [N, M, 3], and their radii [M]."""
    points = axis_points(hand, hand.chains(finger_angles(angles)), SOLVING).reshape(len(angles), -1, 3)
    palm, palm_radii = palm_points(hand)
    everything = np.concatenate((points, np.broadcast_to(palm, (len(angles), *palm.shape))), 1)
    radii = np.concatenate((point_radii(hand, SOLVING).reshape(-1), palm_radii))
    return (everything @ hand.palm / hand.length).astype(np.float32), (radii / hand.length).astype(np.float32)


def _bent_into(hand: Hand, angles: Array, solids: list[Solids], random: np.random.Generator) -> Array:
    """Wanted angles [N, 20]: each finger bent or straightened until it is inside a shape, by no more than it takes plus a random excess;
    fingers that meet none stay, but for a little noise."""
    count, radii = len(angles), point_radii(hand, SOLVING)
    direction = random.choice([-1, 1], size=(count, len(FINGERS), 1)) * random.uniform(0.3, 1, size=(count, len(FINGERS), 4)) * [1.0, 1.0, 0.6, 0.0]
    direction[..., 3] = random.normal(scale=0.15, size=(count, len(FINGERS)))
    wanted = (finger_angles(angles) + random.normal(scale=0.03, size=(count, len(FINGERS), 4))).astype(np.float32)
    undecided = np.ones((count, len(FINGERS)), bool)
    excess = random.uniform(0, 0.5, size=(count, len(FINGERS)))
    for amount in (0.2, 0.45, 0.75, 1.1):
        tried = np.clip(finger_angles(angles) + (amount + excess[..., None]) * direction, *finger_angles(hand.limits.T)).astype(np.float32)
        points = axis_points(hand, hand.chains(tried), SOLVING)
        depth = radii / hand.length - np.minimum(
            *(solid.distances(points.reshape(count, -1, 3) @ hand.palm / hand.length).reshape(points.shape[:-1]) for solid in solids)
        )
        meets = undecided & (depth.max(-1) > 0.01)
        wanted = np.where(meets[..., None], tried, wanted)
        undecided &= ~meets
    return wanted.reshape(count, -1)
