"""What the networks see of a body's surroundings: a voxel grid about its hips, and where its joints are wanted (Starke et al. 2024, section 6.5).

Everything is seen from the root: the wanted hips and their heading, in standing heights of the head joint, so that all bodies look the same.
"""

from __future__ import annotations

import numpy as np

from ..hands.sensor import Grid
from ..motion.rotations import Array, matrix_from_quat, quat_from_yaw, yaw_from_quat
from .contact import Nearest
from .freedom import Freedom

PLACES = ("Head", *(f"{side}{name}" for side in ("Left", "Right") for name in ("Arm", "ForeArm", "Hand", "UpLeg", "Leg", "Foot")))


def roots(freedom: Freedom, frames: np.ndarray) -> tuple[Array, Array]:
    """Where the wanted body's root is at `frames` [R]: positions [R, 3] and rotation matrices [R, 3, 3] about Z."""
    yaw = yaw_from_quat(freedom.motion.rotations[frames, 0].astype(np.float64))
    return freedom.positions[frames, 0], matrix_from_quat(quat_from_yaw(yaw))


def sense(grid: Grid, freedom: Freedom, unit: float, nearest: Nearest, frames: np.ndarray) -> Array:
    """What the networks take [R, C + 3 P]: occupancy of the grid's C cells around the body at `frames` [R], and the PLACES."""
    positions, rotations = roots(freedom, frames)
    points = unit * grid.centres() @ np.swapaxes(rotations, -1, -2) + positions[:, None]
    occupancy = grid.occupancy(nearest(frames, points.astype(np.float32))[0] / unit)
    joints = freedom.positions[frames][:, freedom.body.indices(PLACES)]
    places = (joints - positions[:, None]) @ rotations / unit
    return np.concatenate((occupancy, places.reshape(len(frames), -1)), -1).astype(np.float32)
