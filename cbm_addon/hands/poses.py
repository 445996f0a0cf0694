"""Named poses of the fingers, and the pose that a controller's trigger and grip ask for.

The angles are rounded means of both hands of the free poses that stewdio/handy.js recorded with hand tracking (MIT).
"""

from __future__ import annotations

import numpy as np

from ..motion.rotations import Array
from .hand import ANGLES, FINGERS, finger_angles

_DEGREES = {
    "relaxed": [[-4, 27, 5, 10], [25, 28, 8, -2], [26, 29, 13, -2], [28, 29, 18, 0], [32, 31, 10, 6]],
    "flat": [[-5, 20, 5, -5], [5, 3, 0, -8], [5, 2, 0, -3], [5, 2, 0, -3], [5, 1, 0, -5]],
    "spread": [[-25, 5, -10, 5], [-9, 0, 0, 14], [-11, 0, 0, 6], [-14, 0, 0, 0], [-15, 0, 0, 10]],
    "fist": [[3, 57, 42, 12], [66, 104, 62, -6], [77, 100, 60, -4], [84, 96, 62, 1], [88, 88, 58, 3]],
    "point": [[4, 50, 20, 10], [8, 12, 0, 0], [74, 100, 50, -4], [86, 92, 48, 2], [92, 80, 46, 2]],
    "pinch": [[6, 21, 5, 27], [62, 30, 5, 3], [30, 30, 12, 0], [22, 28, 12, 0], [18, 26, 10, 4]],
    "thumb up": [[-22, 5, -10, -10], [78, 106, 56, -3], [84, 97, 60, -2], [88, 95, 62, 1], [88, 92, 62, 2]],
    "cup": [[-6, 28, 24, 30], [20, 50, 20, -8], [20, 52, 24, -4], [20, 52, 26, 0], [22, 50, 18, 3]],
}  # fmt: skip
POSES = {name: np.radians(np.array(degrees, np.float32).reshape(-1)) for name, degrees in _DEGREES.items()}


def controller_pose(trigger: Array, grip: Array) -> Array:
    """Wanted angles [T, 20] for trigger and grip values [T] from 0 to 1: the trigger bends the index, the grip the other fingers, and the
    thumb closes with whichever is pressed more."""
    trigger, grip = (np.clip(np.asarray(values, np.float32), 0, 1) for values in (trigger, grip))
    shares = np.stack((np.maximum(trigger, grip), trigger, grip, grip, grip), -1)
    relaxed, fist = finger_angles(POSES["relaxed"]), finger_angles(POSES["fist"])
    return (relaxed + shares.reshape(-1, len(FINGERS), 1) * (fist - relaxed)).reshape(-1, len(ANGLES)).astype(np.float32)
