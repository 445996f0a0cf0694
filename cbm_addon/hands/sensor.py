"""What the network sees of its surroundings: a voxel grid in the frame of the palm, and where the joints are wanted.

Everything is measured in lengths of the hand and in the palm's own axes, so that a child's left hand and a giant's right hand look the
same to it.
"""

from __future__ import annotations

import base64
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from ..motion.rotations import Array, matrix_from_quat
from .hand import LIMITS, Hand
from .standard import standard_hand

HAND_LENGTH = 0.19  # metres: the hand that sizes are named for
CELL = 0.01  # metres, at that length of hand


@dataclass(frozen=True)
class Grid:
    """The cells that fingers can reach.

    cell     edge of a cell, in lengths of the hand
    corner   int [3] of the first cell of the box that holds them all
    inside   bool [X, Y, Z], which cells of the box belong to the grid
    """

    cell: float
    corner: Array
    inside: Array

    @property
    def count(self) -> int:
        return int(self.inside.sum())

    def centres(self) -> Array:
        """Centres [C, 3] in the palm's frame, in lengths of the hand."""
        return ((np.argwhere(self.inside) + self.corner + 0.5) * self.cell).astype(np.float32)

    def occupancy(self, distances: Array) -> Array:
        """How full cells are, 0 to 1, from signed distances of their centres in lengths of the hand: 1 inside, falling to 0 one cell away
        (Starke et al. 2019, with the sign in place of the overlap test)."""
        return np.clip(1 - distances / self.cell, 0, 1).astype(np.float32)

    def as_dict(self) -> dict[str, Any]:
        """For a card."""
        bits = base64.b64encode(np.packbits(self.inside)).decode()
        return {"cell": self.cell, "corner": self.corner.tolist(), "shape": list(self.inside.shape), "inside": bits}

    @classmethod
    def from_dict(cls, stored: dict[str, Any]) -> Grid:
        shape = tuple(stored["shape"])
        bits = np.unpackbits(np.frombuffer(base64.b64decode(stored["inside"]), np.uint8), count=int(np.prod(shape)))
        return cls(float(stored["cell"]), np.array(stored["corner"]), bits.reshape(shape).astype(bool))


@lru_cache
def reachable_grid(cell: float = CELL, seed: int = 0) -> Grid:
    """The cells that phalanges of the standard hand reach anywhere within its limits, and those beside them."""
    hand, size = standard_hand(), cell / HAND_LENGTH
    angles = np.random.default_rng(seed).uniform(*LIMITS.T, size=(5_000, len(LIMITS))).astype(np.float32)
    unmoved = np.zeros((len(angles), 3), np.float32), np.tile(np.array([1, 0, 0, 0], np.float32), (len(angles), 1))
    starts, ends, _ = hand.capsules(angles, *unmoved, palm=False)
    points = np.concatenate([starts + (ends - starts) * share for share in (0.25, 0.5, 0.75, 1)], 1) @ hand.palm / hand.length
    return visited_grid(size, points)


def visited_grid(cell: float, points: Array) -> Grid:
    """The cells in which several of the points [..., 3] are, and those beside them."""
    reached, often = np.unique(np.floor(points.reshape(-1, 3) / cell).astype(int), axis=0, return_counts=True)
    reached = reached[often > 5]
    corner = reached.min(0) - 1
    inside = np.zeros(reached.max(0) - corner + 2, bool)
    for step in np.concatenate((np.zeros((1, 3), int), np.eye(3, dtype=int), -np.eye(3, dtype=int))):
        inside[tuple((reached - corner + step).T)] = True
    return Grid(cell, corner, inside)


def surroundings(
    grid: Grid, hand: Hand, wrists: tuple[Array, Array], nearest: Callable[[Array, Array], tuple[Array, Array]], frames: Array
) -> tuple[Array, Array]:
    """Distances [F, C] of the cells around the hand, metres, and normals [F, C, 3] in the palm's axes, at `frames` int [F] of wrists (positions
    [T, 3], rotations [T, 4]).

    `nearest(frames, points [F, M, 3])` gives distances [F, M] and normals, as obstacle.over_time makes it.
    """
    in_wrist = grid.centres() @ hand.palm.T * hand.length
    rotations = matrix_from_quat(wrists[1][frames])
    points = in_wrist @ np.swapaxes(rotations, -1, -2) + wrists[0][frames, None]
    distances, normals = nearest(frames, points.astype(np.float32))
    return distances, normals @ (rotations @ hand.palm)


def sense(grid: Grid, hand: Hand, wrists: tuple[Array, Array], nearest: Callable[[Array, Array], tuple[Array, Array]], frames: Array) -> Array:
    """Occupancy [F, C] of those cells."""
    return grid.occupancy(surroundings(grid, hand, wrists, nearest, frames)[0] / hand.length)


def wanted_places(hand: Hand, positions: Array) -> Array:
    """Where the joints are wanted [F, 60], as the network takes it, from positions [F, 20, 3] in the wrist's frame."""
    return (positions @ hand.palm / hand.length).reshape(len(positions), -1).astype(np.float32)
