"""Winning detail back: the mean of many answers is where the error is least, and moves too softly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..features import LOWER_JOINTS
from ..motion.rotations import Array, continuous, normalize
from .performance import Performance

NARROW, WIDE = 0.7, 4.0  # frames (deviations of Gaussians): movements slower than the first and faster than the second are raised
RAISED = 0.5  # how much of them is added to a body that moves fast, of the ways of its legs
HIPS, FEET = 6.0, 2.5  # and of how its hips turn, and its feet and toes
FAST = 1.0  # head heights per second, the mean of the lower joints at which half of that is added
CALM, CALMED = 0.1, 10.0  # head heights per second, likewise, below which a body stands, and the frames (of a Gaussian) that it is blurred by then
TRAIL, AHEAD = 3.0, 1.7  # frames of the past that a turn is compared with, and how much of the difference is added, without looking ahead
# Thighs and shins turn as hips and ankles make them; what is predicted of them only says to which side a knee points, and would make it wobble.
TURNED = [i for i, name in enumerate(LOWER_JOINTS) if not name.endswith("Leg")]
TURNS = np.array([HIPS if LOWER_JOINTS[i] == "Hips" else FEET for i in TURNED], np.float32)[:, None]


def sharpened(performance: Performance) -> Performance:
    """The performance [T] with its lower body moving as much as before answers were averaged.

    Looking ahead, the middle of the spectrum is raised, the more the body moves, and what trembles above it is taken off; the way of the hips stays,
    since the head tells it. A body that hardly moves is blurred: what networks see in the arms of somebody who stands and waves is not in the legs.
    Causally only turns are raised: positions would tremble. In both modes those of TURNED.
    """
    turns = continuous(performance.lower_rotations)
    if performance.causal:
        turns[:, TURNED] += np.float32(AHEAD) * (turns[:, TURNED] - _trailing(turns[:, TURNED]))
        return replace(performance, lower_rotations=normalize(turns))
    speed = _blurred(np.linalg.norm(performance.lower_velocities, axis=-1).mean(axis=-1), 2 * WIDE)
    fast = (speed / (speed + FAST))[:, None, None].astype(np.float32)
    calm = (CALM**4 / (CALM**4 + speed**4))[:, None, None].astype(np.float32)

    def sharp(values: Array, share: Array | float) -> Array:
        narrow = _blurred(values, NARROW)
        return narrow + np.float32(share) * fast * (narrow - _blurred(values, WIDE))

    def calmed(values: Array, before: Array) -> Array:
        return values + calm * (_blurred(before, CALMED) - values)

    moved = {name: sharp(getattr(performance, name), RAISED) for name in ("lower_positions", "lower_velocities")}
    for name, values in moved.items():
        values[:, 0] = getattr(performance, name)[:, 0]
    moved = {name: calmed(values, getattr(performance, name)) for name, values in moved.items()}
    sharp_turns = turns.copy()
    sharp_turns[:, TURNED] = sharp(turns[:, TURNED], TURNS)
    return replace(performance, lower_rotations=normalize(calmed(sharp_turns, turns)), **moved)


def _blurred(values: Array, deviation: float) -> Array:
    """Values [T, ...] under a Gaussian, frames."""
    reach = round(3 * deviation)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / deviation) ** 2)
    padded = np.pad(values.reshape(len(values), -1), ((reach, reach), (0, 0)), mode="edge")
    columns = [np.convolve(column, weights / weights.sum(), mode="valid") for column in padded.T]
    return np.stack(columns, axis=-1).reshape(values.shape).astype(np.float32)


def _trailing(values: Array) -> Array:
    """Values [T, ...] that follow their own, about TRAIL frames behind."""
    trail = values.copy()
    for t in range(1, len(values)):
        trail[t] = trail[t - 1] + (values[t] - trail[t - 1]) / np.float32(TRAIL)
    return trail
