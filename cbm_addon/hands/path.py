"""The choice among candidates through time: for each finger the cheapest path, so that it does not jump between ways out."""

from __future__ import annotations

import numpy as np

from ..motion.rotations import Array


def cheapest_path(costs: Array, places: Array, stiffness: float, barriers: Array) -> np.ndarray:
    """Of candidates in each frame, costs [T, N, C] and places [T, N, C, D], the one [T, N] on the path that is cheapest in the sum of costs and
    of `stiffness` times the squared steps between frames, and of `barriers` [T - 1, N, C, C] from one to the next (Viterbi). N are independent chains."""
    count = len(costs)
    best, came_from = costs[0], np.empty(costs.shape, np.int64)
    for t in range(1, count):
        steps = ((places[t, :, None] - places[t - 1, :, :, None]) ** 2).sum(-1) * stiffness  # [N, from, to]
        total = best[..., None] + steps + barriers[t - 1]
        came_from[t] = total.argmin(1)
        best = np.take_along_axis(total, came_from[t][:, None], 1)[:, 0] + costs[t]
    chosen = np.empty(costs.shape[:2], np.int64)
    chosen[-1] = best.argmin(-1)
    for t in range(count - 1, 0, -1):
        chosen[t - 1] = np.take_along_axis(came_from[t], chosen[t][:, None], -1)[:, 0]
    return chosen
