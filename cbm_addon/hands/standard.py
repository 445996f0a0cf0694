"""The hand that networks are trained and measured on: average sizes, nobody's rig."""

from __future__ import annotations

import numpy as np

from ..motion.rotations import Array
from .hand import JOINTS, TIPS, ZERO, Hand, Side

# Of a right hand with its palm down, fingers along +Y, thumb toward -X; metres. Knuckles and lengths are those of WebXR hand tracking.
KNUCKLES = np.array([[-0.024, 0.036, -0.019], [-0.024, 0.096, -0.007], [-0.002, 0.096, -0.003], [0.017, 0.089, -0.007], [0.035, 0.078, -0.014]])
LENGTHS = np.array([[0.033, 0.034, 0.025], [0.038, 0.024, 0.023], [0.042, 0.028, 0.025], [0.038, 0.027, 0.024], [0.030, 0.020, 0.022]])


def standard_positions(side: Side, finger_scale: Array | float = 1.0, palm_scale: Array | float = 1.0) -> Array:
    """Rest positions [20, 3] with straight fingers; scales, one or per axis, of the finger lengths ([5, 3]) and of the knuckles ([3])."""
    palm = np.array([[0, -1, 0], [1, 0, 0], [0, 0, -1.0]])  # columns: along, thumb's side, out of the palm
    directions = np.array(ZERO) @ palm.T
    bases = KNUCKLES * palm_scale
    ends = bases[:, None] + directions[:, None] * np.cumsum(LENGTHS * finger_scale, -1)[..., None]
    chain = np.concatenate((bases[:, None], ends), 1)
    positions = np.concatenate((chain[:, :3].reshape(len(JOINTS), 3), chain[:, 3].reshape(len(TIPS), 3)))
    return (positions * ([1, 1, 1] if side == "right" else [-1, 1, 1])).astype(np.float32)


def standard_hand(side: Side = "right", scale: float = 1.0) -> Hand:
    """The standard hand, 190 mm long times `scale`."""
    return Hand.from_rest(side, standard_positions(side) * np.float32(scale))
