"""Which way out fingers take: among several candidates in each frame, for each finger by itself, the cheapest path through time; and where that
leaps, a way around (detour.py).

The choice is made some times in a second. The correction in the frames between is interpolated.
"""

from __future__ import annotations

import numpy as np

from ..motion.rotations import Array
from ..progress import Job, Progress, blocks, part
from .contact import Probe
from .detour import Detours, Rough, around, leaping
from .hand import FINGERS, finger_angles
from .model import HandModel
from .path import cheapest_path
from .poses import POSES
from .project import EASE, SETTLING, SPEED, pushed_out
from .sensor import reachable_grid, wanted_places

CHOICES = 12  # times in a second that a way out is chosen
CANDIDATES = 4  # of the networks
STOCK = ("flat", "fist")  # poses that are always candidates too
PERSISTENCE = 1.0  # how much dearer a step is in the choice than in the exact step
ALLOWED = 0.0004  # metres of depth that do not count in the choice
DEAR = 0.0002  # metres of more depth that cost as much as EASE
TOGETHER = 16  # choices that are prepared between two events


def chosen(probe: Probe, near: np.ndarray, blocked: np.ndarray, aim: Array, rate: float, model: HandModel | None, seed: int, exact: bool) -> Job[Array]:
    """Angles [T, 20]: what each finger wants where that is free, and elsewhere a path that is all but free.

    near     bool [T, 5]: which fingers may touch; the others stay
    blocked  bool [T, 5]: which fingers may have to move; only for them are there candidates
    exact    whether candidates are moved along the true distances; without, they are the wanted pose and what the networks say
    """
    every = max(1, round(rate / CHOICES))
    ticks = np.append(np.arange(0, len(aim) - 1, every), len(aim) - 1)
    by_finger = finger_angles(aim[ticks])
    count = 1 + CANDIDATES * (model is not None) + len(STOCK) * exact
    costs = np.full((len(ticks), len(FINGERS), count), np.inf, np.float32)
    costs[..., 0] = 0
    places = np.repeat(by_finger[:, :, None], count, 2)
    rough = Rough(probe, model.grid if model else reachable_grid())
    touching = np.flatnonzero(blocked[ticks].any(1))
    for block in blocks(len(touching), TOGETHER):
        yield Progress(0.6 * block.start / len(touching), "looking for ways out")
        rows, fingers = np.nonzero(blocked[ticks[touching[block]]])
        rows = touching[block][rows]
        found = np.stack(_candidates(rough, ticks[rows], fingers, aim, model, seed, exact))
        moved, depths = pushed_out(probe, np.tile(ticks[rows], count), np.tile(fingers, count), found.reshape(-1, found.shape[-1]), SETTLING if exact else 0)
        places[rows, fingers] = np.swapaxes(moved.reshape(found.shape), 0, 1)
        away = ((places[rows, fingers] - by_finger[rows, fingers, None]) ** 2).sum(-1) / EASE**2
        costs[rows, fingers] = cost_of_depth(depths).reshape(count, -1).T + away
    seconds = every / rate
    stiffness = PERSISTENCE / (seconds * SPEED) ** 2
    steps = places - by_finger[:, :, None]
    best = cheapest_path(costs, ((steps[1:, :, None] - steps[:-1, :, :, None]) ** 2).sum(-1) * np.float32(stiffness))
    path = np.take_along_axis(places, best[..., None, None], 2)[:, :, 0]
    if exact:
        leaps = leaping(probe, ticks, path, by_finger, seconds)
        for finger in np.flatnonzero(leaps.any(0)).tolist():
            detours = Detours(rough, finger, seconds, stiffness)
            job = around(detours, ticks, path[:, finger], by_finger[:, finger], leaps[:, finger])
            path[:, finger] = yield from part(job, 0.6 + 0.08 * finger, 0.68 + 0.08 * finger)
    corrected = aim + _interpolated(path - by_finger, ticks, len(aim)).reshape(aim.shape)
    return np.where(np.repeat(near, aim.shape[1] // len(FINGERS), 1), corrected, aim).astype(np.float32)


def _candidates(rough: Rough, frames: np.ndarray, fingers: np.ndarray, aim: Array, model: HandModel | None, seed: int, exact: bool) -> list[Array]:
    """Poses [R, 4] of fingers at frames int [R]: the wanted ones, stock poses, and what the networks say."""
    hand = rough.probe.hand
    found = [finger_angles(aim)[frames, fingers]]
    if exact:
        found += [finger_angles(np.clip(POSES[name], *hand.limits.T))[fingers] for name in STOCK]
    if model:
        needed, places = np.unique(frames, return_inverse=True)
        occupancy = rough.grid.occupancy(rough.values(needed)[..., 0] / hand.length)
        proposals = model.propose(occupancy, wanted_places(hand, hand.positions(aim[needed])), CANDIDATES, seed)
        found += list(finger_angles(np.clip(proposals, *hand.limits.T))[:, places, fingers])
    return found


def cost_of_depth(depths: Array) -> Array:
    """What it costs to stay inside."""
    return np.minimum((np.maximum(depths - ALLOWED, 0) / DEAR) ** 2, 1e4)


def _interpolated(values: Array, ticks: np.ndarray, count: int) -> Array:
    """Values [K, ...] at frames int [K] for all frames [count, ...]."""
    frames = np.arange(count)
    before = np.searchsorted(ticks[:-1], frames, side="right") - 1
    share = (frames - ticks[before]) / np.maximum(ticks[before + 1] - ticks[before], 1)
    return values[before] + share.reshape(-1, *[1] * (values.ndim - 1)) * (values[before + 1] - values[before])
