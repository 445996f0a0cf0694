"""What is measured of fingers over time, and how it is summed up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...hands.avoid import PALM_INSIDE
from ...hands.contact import finger_depths, palm_depths
from ...hands.hand import LIMITS
from ...hands.obstacle import over_time
from ...motion.rotations import Array
from .scenes import RATE, Scene

PIERCED = 0.001  # metres from which a finger counts as inside


@dataclass(frozen=True)
class Manifold:
    """Poses [N, 20] that the networks trained on; how far other poses are from the nearest of them."""

    poses: Array

    def distances(self, angles: Array) -> Array:
        """Degrees [T], rms over the angles of the hand."""
        squares = (self.poses**2).sum(-1)
        found = [((pose**2).sum() + (squares - 2 * self.poses @ pose).min()) for pose in angles.astype(np.float32)]
        return np.degrees(np.sqrt(np.maximum(found, 0) / angles.shape[-1]))


@dataclass(frozen=True)
class Measured:
    """One scene, one method, by frame: depth [T] of the deepest finger, where the palm is outside [T]; how far fingertips moved from where they
    were wanted [T, 5]; whether the input was free [T]; tip steps [T - 1, 5]; speeds of angles [T - 1, 20] in degrees per second; whether the
    solid is smooth; degrees from the manifold [T'] where the input pierced; degrees by which limits are broken."""

    depths: Array
    palm_outside: np.ndarray
    moved: Array
    was_free: np.ndarray
    steps: Array
    speeds: Array
    smooth: bool
    strangeness: Array
    beyond: float


@dataclass(frozen=True)
class Before:
    """What holds of a scene whatever the method: depth [T] of the wanted fingers, and where the palm is outside [T]."""

    depths: Array
    palm_outside: np.ndarray


def before(scene: Scene) -> Before:
    nearest = over_time(scene.obstacles)
    return Before(finger_depths(scene.hand, scene.wrists, nearest, scene.wanted).max(-1), palm_depths(scene.hand, scene.wrists, nearest) <= PALM_INSIDE)


def measured(scene: Scene, start: Before, angles: Array, manifold: Manifold | None) -> Measured:
    nearest = over_time(scene.obstacles)
    tips, wanted = scene.hand.positions(angles)[:, 15:], scene.hand.positions(scene.wanted)[:, 15:]
    limits = np.stack((np.minimum(LIMITS[:, 0], scene.hand.limits[:, 0]), np.maximum(LIMITS[:, 1], scene.hand.limits[:, 1])))
    return Measured(
        depths=finger_depths(scene.hand, scene.wrists, nearest, angles).max(-1),
        palm_outside=start.palm_outside,
        moved=np.linalg.norm(tips - wanted, axis=-1),
        was_free=start.depths <= 0,
        steps=np.linalg.norm(np.diff(tips, axis=0), axis=-1),
        speeds=np.degrees(np.abs(np.diff(angles, axis=0)) * RATE),
        smooth=scene.smooth,
        strangeness=manifold.distances(angles[start.depths > PIERCED]) if manifold else np.zeros(0),
        beyond=float(np.degrees(np.maximum(limits[0] - angles, angles - limits[1]).max())),
    )


def summed(rows: list[Measured], fastest: float | None) -> dict[str, float | None]:
    """The figures of the report over several scenes; `fastest` is the speed of real fingers, degrees per second."""
    depth = np.concatenate([np.maximum(row.depths, 0)[row.palm_outside] for row in rows]) * 1000
    free = np.concatenate([row.moved[row.was_free].reshape(-1) for row in rows]) * 1000
    speeds = np.concatenate([row.speeds.reshape(-1) for row in rows])
    smooth = [row.steps for row in rows if row.smooth]
    strangeness = np.concatenate([row.strangeness for row in rows])
    return {
        "frames": sum(len(row.depths) for row in rows),
        "palm_inside": int(sum((~row.palm_outside).sum() for row in rows)),
        "pierced_percent": float((depth > PIERCED * 1000).mean() * 100),
        "mean_depth_mm": float(depth.mean()),
        "max_depth_mm": float(depth.max()),
        "free_moved_mm": float(free.mean()) if free.size else None,
        "moved_mm": float(np.concatenate([row.moved.reshape(-1) for row in rows]).mean() * 1000),
        "smooth_step_mm": float(max(steps.max() for steps in smooth) * 1000) if smooth else None,
        "smooth_step_over_25_percent": float((np.concatenate(smooth).max(-1) > 0.025).mean() * 100) if smooth else None,
        "speed_p995": float(np.percentile(speeds, 99.5)),
        "too_fast_percent": float((speeds > fastest).mean() * 100) if fastest else None,
        "manifold_deg": float(strangeness.mean()) if strangeness.size else None,
        "beyond_limits_deg": max(0.0, *(row.beyond for row in rows)),
    }
