"""Pictures of a hand and what it touches, before and after."""

from __future__ import annotations

import numpy as np

from ...hands.shapes import Capsules
from ...motion.rotations import Array, rotate
from ..tracing import View, traced
from .scenes import Scene

SIZE = 200  # pixels of one picture
WIDTH = 0.24  # metres that it shows


def before_and_after(scene: Scene, angles: Array, frame: int) -> np.ndarray:
    """uint8 [SIZE, 2 SIZE, 3]: the wanted fingers at the left, these at the right."""
    return np.concatenate([_drawn(scene, pose, frame) for pose in (scene.wanted, angles)], 1)


def _drawn(scene: Scene, angles: Array, frame: int) -> np.ndarray:
    hand, here = scene.hand, slice(frame, frame + 1)
    position, rotation = scene.wrists[0][frame], scene.wrists[1][frame]
    starts, ends, radii = hand.capsules(angles[here], scene.wrists[0][here], scene.wrists[1][here])
    along, across, out = rotate(rotation, hand.palm.T)
    toward = across * 0.75 - out * 0.15 + along * 0.35  # from the hand to the eye
    right = np.cross(out, toward)
    upright = np.sign(np.cross(toward, right)[2])
    return traced(Capsules(starts[0], ends[0], radii), scene.obstacles(frame), View(position + along * 0.11 + out * 0.02, toward, upright * out, WIDTH, SIZE))
