"""The choice among candidates through time: for each finger the cheapest path, so that it does not jump between ways out."""

from __future__ import annotations

import numpy as np

from ..motion.rotations import Array


def cheapest_path(costs: Array, transitions: Array) -> np.ndarray:
    """Of candidates in each frame the one [T, N] on the path whose costs [T, N, C] and transitions [T - 1, N, C, C], from one candidate to one of
    the next frame, have the least sum (Viterbi). N are independent chains."""
    best, came_from = costs[0], np.empty(costs.shape, np.int64)
    for t in range(1, len(costs)):
        total = best[..., None] + transitions[t - 1]
        came_from[t] = total.argmin(1)
        best = total.min(1) + costs[t]
    chosen, chains = np.empty(costs.shape[:2], np.int64), np.arange(costs.shape[1])
    chosen[-1] = best.argmin(-1)
    for t in range(len(costs) - 1, 0, -1):
        chosen[t - 1] = came_from[t][chains, chosen[t]]
    return chosen
