"""What is measured of a body among solids."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...body.contact import planted_feet
from ...motion.motion import Motion
from ...motion.rotations import Array, matrix_from_quat
from .scenes import Scene

NEAR_TRACKER = 0.05  # metres
TRACKED = ("Head", "LeftHand", "RightHand")


@dataclass(frozen=True)
class Measured:
    """One method on one scene; T frames, S samples.

    volume    [T]: how much of the body is inside, litres
    depth     [T]: of the deepest point of its surface, metres, 0 where it is free
    planted   [S]: how far feet that stood were moved, metres
    trackers  [S]: how far head and wrists were moved, where their own parts were free at their places
    jitter    third difference of all joints over that of the recorded motion
    """

    volume: Array
    depth: Array
    planted: Array
    trackers: Array
    jitter: float


def measured(scene: Scene, motion: Motion) -> Measured:
    """Measures a motion in a scene against the recorded one."""
    body, shape = motion.skeleton, scene.shape
    rotations, positions = motion.forward()
    world = matrix_from_quat(rotations).astype(np.float64)
    volume, depth = np.empty(len(motion)), np.empty(len(motion))
    for frame in range(len(motion)):
        posed = world[frame : frame + 1], positions[frame : frame + 1].astype(np.float64)
        volume[frame] = 1000 * shape.volumes[scene.obstacles(frame).nearest(shape.cloud.world(*posed)[0].astype(np.float32))[0] < 0].sum()
        distances = scene.obstacles(frame).nearest(shape.axes.world(*posed)[0].astype(np.float32))[0]
        depth[frame] = max(0.0, float((shape.radii - distances).max()))
    recorded = scene.motion.positions()
    moved = np.linalg.norm(positions - recorded, axis=-1)
    planted = planted_feet(scene.motion)
    feet = [moved[planted[:, i]][:, body.indices([f"{side}Foot", f"{side}Toe"])].ravel() for i, side in enumerate(("Left", "Right"))]
    free = _free_trackers(scene)
    trackers = [moved[free[:, i], body.index(name)] for i, name in enumerate(TRACKED)]
    jerk, before = (np.abs(np.diff(values, 3, axis=0)).mean() for values in (positions, recorded))
    return Measured(volume, depth, np.concatenate(feet), np.concatenate(trackers), float(jerk / before))


def _free_trackers(scene: Scene) -> np.ndarray:
    """bool [T, 3]: where the head itself and each hand itself are free at their places, so that they need not move for their own sake."""
    rotations, positions = scene.motion.forward()
    points = scene.shape.axes.world(matrix_from_quat(rotations).astype(np.float64), positions.astype(np.float64)).astype(np.float32)
    free = np.empty((len(points), len(TRACKED)), bool)
    parts = [scene.shape.axes.joints == scene.motion.skeleton.index(name) for name in TRACKED]
    for frame, axes in enumerate(points):
        distances = scene.obstacles(frame).nearest(axes)[0]
        free[frame] = [(distances[part] > scene.shape.radii[part]).all() for part in parts]
    return free


def summed(rows: list[Measured], before: list[Measured]) -> dict[str, Any]:
    """The figures of a method over its scenes, against the recorded motion."""
    volume, volume_before = (float(np.concatenate([row.volume for row in some]).sum()) for some in (rows, before))
    depth, planted, trackers = (np.concatenate([getattr(row, name) for row in rows]) for name in ("depth", "planted", "trackers"))
    return {
        "frames": len(depth),
        "pierced_percent": float(100 * (depth > 0.01).mean()),
        "volume_litres": volume / len(depth),
        "reduced_percent": float(100 * (1 - volume / volume_before)),
        "max_depth_cm": float(100 * depth.max()),
        "planted_p99_cm": float(100 * np.percentile(planted, 99)) if len(planted) else None,
        "planted_max_cm": float(100 * planted.max()) if len(planted) else None,
        "near_tracker_percent": float(100 * (trackers < NEAR_TRACKER).mean()),
        "tracker_p95_cm": float(100 * np.percentile(trackers, 95)),
        "jitter_ratio": float(np.mean([row.jitter for row in rows])),
    }
