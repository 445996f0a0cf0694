"""Idle stays idle: while head and wrists rest, the body rests too, however the head turns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..features import RATE
from ..motion.rotations import Array, continuous, normalize
from ..takes.take import Take
from .performance import Performance
from .tridiagonal import follow

REST, MOVE = 0.015, 0.04  # head heights per second: slower than REST is at rest, faster than MOVE is not
SPAN = 0.5  # seconds over which the speed is judged
STIFFNESS = 1e5  # how much a step at rest costs, against staying near the prediction
GAIN = 0.002  # what is taken over of a new frame at rest, without looking ahead


def settle(performance: Performance, take: Take) -> Performance:
    """The performance [T] with hips and torso held where the trackers of the take (at the same times) rest. Looking ahead, feet are not touched: their
    contacts hold them. Causally the legs are held too, since a foot's lock creeps after its path."""
    rest = at_rest(take.positions / np.float32(performance.head_height), performance.causal)
    hold = _hold_causally if performance.causal else _hold
    positions, lower = performance.lower_positions.copy(), performance.lower_rotations.copy()
    held = slice(None) if performance.causal else slice(1)
    positions[:, held] = hold(positions[:, held], rest)
    lower[:, held] = normalize(hold(continuous(lower[:, held]), rest))
    upper = continuous(performance.upper_rotations)
    return replace(performance, lower_positions=positions, lower_rotations=lower, upper_rotations=normalize(hold(upper, rest)))


def at_rest(positions: Array, causal: bool) -> Array:
    """How much the trackers [T, 3, 3] rest at each frame, 0 to 1, by the fastest of them."""
    if len(positions) < 2:
        return np.zeros(len(positions), np.float32)
    steps = np.diff(positions, axis=0, prepend=positions[:1])
    span = round(SPAN * RATE)
    window = np.ones(span) / span
    pad = (span - 1, 0) if causal else (span // 2, span - 1 - span // 2)
    mean = np.stack([np.convolve(np.pad(column, pad, mode="edge"), window, "valid") for column in steps.reshape(len(steps), -1).T], axis=-1)
    speed = RATE * np.linalg.norm(mean.reshape(steps.shape), axis=-1).max(-1)
    return np.clip((MOVE - speed) / (MOVE - REST), 0, 1).astype(np.float32)


def _hold(values: Array, rest: Array) -> Array:
    """Least squares over the take: values [T, ...] near their own, steps small where there is rest."""
    stiffness = STIFFNESS * np.square(np.minimum(rest[1:], rest[:-1]))
    return follow(values, np.ones(len(values)), stiffness).astype(np.float32)


def _hold_causally(values: Array, rest: Array) -> Array:
    """Values [T, ...] that follow their own the slower the more rest there is."""
    held = values.copy()
    for t in range(1, len(values)):
        held[t] = held[t - 1] + GAIN ** rest[t] * (values[t] - held[t - 1])
    return held
