"""Recorded poses in numbers: what a body may do where nothing is in its way, and how far from it every cell of the sensor is."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...body.model import TURNING
from ...body.sensor import PLACES
from ...body.shape import BodyShape, body_shape
from ...errors import InputError
from ...hands.sensor import Grid, visited_grid
from ...motion.mirror import mirror
from ...motion.motion import Motion
from ...motion.rotations import Array, inverse, matrix_from_quat, multiply, quat_from_yaw, sixd_from_quat, yaw_from_quat
from ...motion.skeleton import BODY_JOINTS, STANDARD_BODY
from ...progress import Progress
from ..dataset import faces_one_way, read_body_motion, stands_on_a_floor

STEP = 0.004  # of a stored distance, in standing heights
EVERY = 6  # frames between two poses of a clip
FEET = ("LeftFoot", "RightFoot")


@dataclass(frozen=True)
class PoseBank:
    """N poses of the standard body, seen from the root (the hips and their heading), in standing heights of the head joint.

    places     [N, P, 3] of PLACES
    rotations  [N, R, 6] of TURNING
    axes       [N, M, 3]: points on the axes of the body's capsules, `radii` [M] thick
    feet       [N, 3]: between the ankles
    """

    places: Array
    rotations: Array
    axes: Array
    radii: Array
    feet: Array

    def __len__(self) -> int:
        return len(self.places)

    def part(self, chosen: np.ndarray) -> PoseBank:
        return PoseBank(self.places[chosen], self.rotations[chosen], self.axes[chosen], self.radii, self.feet[chosen])

    def grid(self, cell: float) -> Grid:
        """The cells, whose edges are so long, that these poses reach."""
        return visited_grid(cell, self.axes)

    def cell_distances(self, grid: Grid) -> np.ndarray:
        """uint8 [N, C]: from the cells of a grid to the surface of the body, in STEPs, 0 inside and 255 for far away."""
        centres = grid.centres()
        squares, found = (centres * centres).sum(-1)[:, None], np.empty((len(self), len(centres)), np.uint8)
        for row, axes in enumerate(self.axes):
            apart = np.sqrt(np.maximum(squares - 2 * centres @ axes.T + (axes * axes).sum(-1), 0)) - self.radii
            found[row] = np.clip(np.round(apart.min(-1) / STEP), 0, 255)
        return found


def read_poses(clips: list[Path], count: int, seed: int) -> Generator[Progress, None, PoseBank]:
    """`count` poses of clips and of their mirror images; those whose head is rarely as high as it is are drawn more often."""
    shape, found = body_shape(STANDARD_BODY), []
    for i, path in enumerate(clips):
        yield Progress(i / len(clips), f"reading poses of {path.stem}")
        motion = read_body_motion(path)
        if stands_on_a_floor(motion) and faces_one_way(motion):
            found += [_poses(kept, shape) for kept in (motion, mirror(motion))]
    if not found:
        raise InputError(clips[0] if clips else "the data", "holds no poses to train on; clips with the engine's joints are needed")
    places, rotations, axes, feet = (np.concatenate([getattr(poses, name) for poses in found]) for name in ("places", "rotations", "axes", "feet"))
    every = PoseBank(places, rotations, axes, found[0].radii, feet)
    height = every.places[:, PLACES.index("Head"), 2] - every.feet[:, 2]
    common, edges = np.histogram(height, 30)
    rarity = 1 / np.sqrt(common[np.clip(np.digitize(height, edges[1:-1]), 0, 29)])
    random = np.random.default_rng(seed)
    return every.part(random.choice(len(every), size=min(count, len(every)), replace=False, p=rarity / rarity.sum()))


def _poses(motion: Motion, shape: BodyShape) -> PoseBank:
    kept = slice(None, None, EVERY)
    rotations = motion.rotations[kept][:, motion.skeleton.indices(BODY_JOINTS)].copy()
    heading = quat_from_yaw(yaw_from_quat(rotations[:, 0]))
    rotations[:, 0] = multiply(inverse(heading), rotations[:, 0])
    world, positions = Motion(STANDARD_BODY, motion.times[kept], np.zeros((len(rotations), 3), np.float32), rotations).forward()
    unit, body = np.float32(shape.unit), STANDARD_BODY
    axes = shape.axes.world(matrix_from_quat(world).astype(np.float64), positions.astype(np.float64)) / unit
    feet = positions[:, body.indices(FEET)].mean(1) / unit
    turns = sixd_from_quat(world[:, body.indices(TURNING)])
    return PoseBank(positions[:, body.indices(PLACES)] / unit, turns, axes.astype(np.float32), (shape.radii / unit).astype(np.float32), feet)
