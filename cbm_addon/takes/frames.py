"""Frames of reference of recordings: the matrices to engine axes, and measuring which axes and which unit a recording has.

A matrix C takes points by p' = C p and rotations by R' = C R Cᵀ. Working with matrices handles left-handed sources (det C = -1) without
a sign recipe per quaternion.
"""

from __future__ import annotations

import numpy as np

from ..motion.rotations import Array, matrix_from_quat, quat_from_matrix
from .take import HANDS, HEAD, Constant

AXES = {
    "engine": np.eye(3),
    # right-handed, X right, Y up, looking along -Z: OpenXR, OpenVR, WebXR, glTF
    "openxr": np.array([[-1.0, 0, 0], [0, 0, 1], [0, 1, 0]]),
    # left-handed, X right, Y up, looking along +Z: Unity, .bsor
    "unity": np.array([[-1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
    # left-handed, X forward, Y right, Z up: Unreal
    "unreal": np.array([[0, -1.0, 0], [-1, 0, 0], [0, 0, 1]]),
}
METRES = {"m": 1.0, "cm": 0.01, "mm": 0.001}

HANDS_AHEAD = 0.1  # metres before the face,
GAZE_DOWN = 0.2  # sine of the pitch, and
WALK_FORWARD = 1.0  # metres that speak equally loudly for the side of the face

HAND_DISTANCE = (0.25, 1.2)
"""Metres from the headset to a hand, median over a take: from hands held up before the chest to arms stretched with long controllers."""
HEAD_HEIGHT = (1.0, 2.2)
"""Metres above the floor, where no hand is tracked."""


def to_engine(positions: Array, rotations: Array, axes: str) -> tuple[Array, Array]:
    """Positions [..., 3] and rotations [..., 4] from axes named in AXES to engine axes; NaN stays NaN."""
    c = AXES[axes]
    return positions @ c.T, quat_from_matrix(c @ matrix_from_quat(rotations) @ c.T)


def measure_axes(positions: Array, rotations: Array) -> Constant[str]:
    """Axes "openxr" or "unity" for a recording with Y up, told by which side of the head is the face.

    positions [T, 3, 3] in metres, rotations [T, 3, 4] in the recording's own axes; NaN where not tracked. People hold their hands
    before them, look down rather than up, and walk forward; each says it more or less loudly. The hands alone are wrong for people who walk
    (arms hang behind the face); the three together are right for 93 % of 481 clips of mocap, 96 % of those with a confidence over 0.5.
    Cannot see swapped components of quaternions or a wrong order of Euler angles.
    """
    face = matrix_from_quat(rotations[:, HEAD])[:, :, 2]
    level = face * [1, 0, 1]
    ahead = np.sum((positions[:, HANDS] - positions[:, [HEAD]]) * level[:, None], axis=-1)
    steps = np.diff(positions[:, HEAD], axis=0) * level[1:]
    hands, gaze, walk = _mean(ahead), -_mean(face[:, 1]), float(np.nansum(steps))
    score = hands / HANDS_AHEAD + gaze / GAZE_DOWN + walk / WALK_FORWARD
    side = 1 if score > 0 else -1
    pitch = np.degrees(np.arcsin(side * gaze))
    why = f"hands {side * hands:+.2f} m before the face, gaze {pitch:+.0f}° down, {side * walk:+.1f} m walked forward"
    return Constant("unity" if side > 0 else "openxr", "measured", why, confidence=float(np.tanh(abs(score) / 2)))


def measure_unit(positions: Array, up: int) -> Constant[str] | None:
    """Unit "m", "cm" or "mm" of positions [T, 3, 3], by the distance from head to hands, else by the head's height along the axis `up`.

    None if no unit gives a human size.
    """
    distance = np.linalg.norm(positions[:, HANDS] - positions[:, [HEAD]], axis=-1)
    if np.isfinite(distance).any():
        size, (low, high), what = float(np.nanmedian(distance)), HAND_DISTANCE, "median distance from head to hands"
    else:
        size, (low, high), what = float(np.nanmedian(positions[:, HEAD, up])), HEAD_HEIGHT, "median head height"
    for unit, metres in METRES.items():
        if low <= size * metres <= high:
            return Constant(unit, "measured", f"{what}: {size:.4g} in the file, {size * metres:.2f} m")
    return None


def _mean(values: Array) -> float:
    """Of the finite values; 0 without any."""
    values = values[np.isfinite(values)]
    return float(np.mean(values)) if len(values) else 0.0


def hands_swapped(positions: Array, rotations: Array) -> Constant[bool]:
    """Whether "left" is the right hand, seen from the head: positions [T, 3, 3] in metres and rotations [T, 3, 4] in engine axes."""
    leftward = matrix_from_quat(rotations[:, HEAD])[:, :, 0] * [1, 1, 0]
    apart = np.sum((positions[:, 1] - positions[:, 2]) * leftward, axis=-1)
    apart = apart[np.isfinite(apart)]
    if not len(apart):
        return Constant(False, "assumed", "no samples with both hands to measure by")
    crossed = float(np.mean(apart < 0))
    swapped = crossed > 0.8 and float(np.mean(apart)) < -0.05
    why = f"the left hand is on the left in {1 - crossed:.0%} of samples"
    return Constant(swapped, "measured", why, confidence=abs(2 * crossed - 1))
