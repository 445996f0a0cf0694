"""Least squares over a take in which only neighbouring frames know each other: their normal equations are tridiagonal."""

from __future__ import annotations

import numpy as np

from ..motion.rotations import Array


def follow(values: Array, trust: Array, stiffness: Array, steps: Array | float = 0.0) -> Array:
    """The path x [T, ...] that minimises sum trust (x - values)² + sum stiffness (x[t+1] - x[t] - steps[t])², float64.

    trust [T, ...] and stiffness [T - 1, ...], at least 0 and broadcast over what is right of them; `steps` [T - 1, ...]. One forward and one backward
    sweep (Thomas) solve every column.
    """
    trust, stiffness = (np.asarray(weights, np.float64).reshape(*weights.shape, *[1] * (values.ndim - weights.ndim)) for weights in (trust, stiffness))
    diagonal = trust + np.zeros((len(values), *stiffness.shape[1:]))
    diagonal[1:] += stiffness
    diagonal[:-1] += stiffness
    solved = trust * values.astype(np.float64)
    pull = stiffness * steps
    solved[1:] += pull
    solved[:-1] -= pull
    for t in range(1, len(values)):
        factor = stiffness[t - 1] / diagonal[t - 1]
        diagonal[t] -= factor * stiffness[t - 1]
        solved[t] += factor * solved[t - 1]
    solved[-1] /= diagonal[-1]
    for t in range(len(values) - 2, -1, -1):
        solved[t] = (solved[t] + stiffness[t] * solved[t + 1]) / diagonal[t]
    return solved
