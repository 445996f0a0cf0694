"""Geometry that is made around a pose which it leaves free, and another pose that wants to be where it is. All in standing heights of the head joint."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...hands.sensor import Grid
from ...motion.rotations import Array, normalize
from ..hands.geometry import SECOND, fitted_solids, random_solids
from .pose_bank import STEP, PoseBank

CONSIDERED, NEAREST = 48, 6  # poses that are drawn to be wanted in the place of a free one, and of how many of the nearest one is taken
AWAY = 0.02  # how far a wanted point must be from the free body to be where a solid is


@dataclass(frozen=True)
class Samples:
    """What the networks take and what they are to give: occupancy [N, C], places [N, 3 P], answers [N, A] as body/model.py takes them."""

    occupancy: Array
    places: Array
    answers: Array


def noise_samples(bank: PoseBank, distances: np.ndarray, grid: Grid, count: int, random: np.random.Generator) -> Samples:
    """Eq. 9: cells of the body are empty, all others random. Eq. 10: each joint is wanted somewhere between where it is and the nearest cell that
    is not empty."""
    chosen = random.integers(len(bank), size=count)
    free = distances[chosen] * np.float32(STEP) >= grid.cell
    occupancy = np.where(free, random.random(free.shape), 0).astype(np.float32)
    centres, places = grid.centres(), bank.places[chosen]
    apart = (places * places).sum(-1, keepdims=True) - 2 * places @ centres.T + (centres * centres).sum(-1)
    closest = centres[np.where(free[:, None], apart, np.inf).argmin(-1)]
    share = random.random((*places.shape[:2], 1)).astype(np.float32)
    return Samples(occupancy, (places + share * (closest - places)).reshape(count, -1), _answers(bank, chosen, np.zeros((count, 3), np.float32)))


def shape_samples(bank: PoseBank, grid: Grid, count: int, random: np.random.Generator) -> Samples:
    """Solid shapes that touch a free pose, or leave a gap, where another pose wants to be that stands on the same place."""
    free, wanted, shift = _pairs(bank, count, random)
    points = bank.axes[free] + shift[:, None]  # the free body as the wanted root sees it
    other = bank.axes[wanted]
    beyond = _apart(other, points, bank.radii)
    weight = np.where(beyond > AWAY, beyond, 0) + 1e-6
    distances, fitted = np.full((count, grid.count), np.inf, np.float32), np.arange(count)
    for share in (1.0, SECOND):
        pick = (np.cumsum(weight, -1) / weight.sum(-1, keepdims=True) > random.random((count, 1))).argmax(-1)
        near = other[fitted, pick]
        nearest = points[fitted, np.linalg.norm(points - near[:, None], axis=-1).argmin(-1)]
        outwards = normalize(near - nearest + random.normal(scale=0.03, size=(count, 3)))
        gap = np.where(random.random(count) < 0.7, 0, random.exponential(0.03, size=count))
        there = random.random(count) < share
        solid = fitted_solids(random_solids(near, -outwards, random), outwards, points, bank.radii, gap, there)
        distances[there] = np.minimum(distances[there], solid.part(there).distances(grid.centres()))
    return Samples(grid.occupancy(distances), bank.places[wanted].reshape(count, -1), _answers(bank, free, shift))


def _pairs(bank: PoseBank, count: int, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray, Array]:
    """Free and wanted poses int [N], alike but not the same, and where the hips of the free ones are for the wanted ones [N, 3]: feet are together."""
    free = random.integers(len(bank), size=count)
    drawn = random.integers(len(bank), size=(count, CONSIDERED))
    own, others = bank.places[free] - bank.feet[free, None], bank.places[drawn] - bank.feet[drawn][:, :, None]
    apart = np.linalg.norm(others - own[:, None], axis=-1).mean(-1)
    ranked = np.take_along_axis(drawn, apart.argsort(-1), -1)
    wanted = ranked[np.arange(count), random.integers(NEAREST, size=count)]
    return free, wanted, bank.feet[wanted] - bank.feet[free]


def _apart(points: Array, body: Array, radii: Array) -> Array:
    """How far points [N, M, 3] are from the surface of bodies, points [N, M, 3] with radii [M]: [N, M]."""
    squares = (points * points).sum(-1)[:, :, None] + (body * body).sum(-1)[:, None] - 2 * points @ np.swapaxes(body, -1, -2)
    return (np.sqrt(np.maximum(squares, 0)) - radii).min(-1)


def _answers(bank: PoseBank, chosen: np.ndarray, shift: Array) -> Array:
    return np.concatenate((shift, bank.rotations[chosen].reshape(len(chosen), -1)), -1).astype(np.float32)
