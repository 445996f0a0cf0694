"""Pictures of a body and what is in its way, before and after."""

from __future__ import annotations

import numpy as np

from ...hands.shapes import Spheres
from ...motion.motion import Motion
from ...motion.rotations import matrix_from_quat
from ..tracing import View, traced
from .measures import measured
from .scenes import Scene

SIZE = 300  # pixels of one picture
WIDTH = 2.4  # metres that it shows
ACROSS = 3


def sheet(answers: list[tuple[Scene, Motion]]) -> np.ndarray:
    """uint8 [H, W, 3]: before and after for one scene of each kind, in the frame in which most of the body is inside; ACROSS in a row."""
    first: dict[str, tuple[Scene, Motion]] = {}
    for scene, freed in answers:
        first.setdefault(scene.name.split(":")[0], (scene, freed))
    pairs = [before_and_after(scene, freed, int(measured(scene, scene.motion).volume.argmax())) for scene, freed in first.values()]
    pairs += [np.full_like(pairs[0], 250)] * (-len(pairs) % ACROSS)
    return np.concatenate([np.concatenate(pairs[i : i + ACROSS], 1) for i in range(0, len(pairs), ACROSS)])


def before_and_after(scene: Scene, freed: Motion, frame: int) -> np.ndarray:
    """uint8 [SIZE, 2 SIZE, 3]: the body as it was at the left, freed at the right, seen across the direction in which it was moved."""
    moved = (freed.positions()[frame] - scene.motion.positions()[frame]).mean(0) * [1, 1, 0]
    aside = np.cross([0, 0, 1.0], moved) if np.linalg.norm(moved) > 0.01 else np.array([1.0, -1, 0])
    toward = aside / np.linalg.norm(aside) + [0, 0, 0.25]
    middle = scene.motion.root[frame] * [1, 1, 0] + [0, 0, 0.9]
    return np.concatenate([_drawn(scene, motion, frame, View(middle, toward, np.array([0, 0, 1.0]), WIDTH, SIZE)) for motion in (scene.motion, freed)], 1)


def _drawn(scene: Scene, motion: Motion, frame: int, view: View) -> np.ndarray:
    rotations, positions = (values[frame : frame + 1].astype(np.float64) for values in motion.forward())
    points = scene.shape.axes.world(matrix_from_quat(rotations), positions)[0].astype(np.float32)
    return traced(Spheres(points, scene.shape.radii.astype(np.float32)), scene.obstacles(frame), view)
