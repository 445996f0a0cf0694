"""Devices that were recorded each at its own times, brought to the headset's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..motion.resample import brackets, lerp_samples, slerp_samples
from ..motion.rotations import Array, continuous, normalize
from .recording import GAP
from .take import DEVICES


@dataclass(frozen=True)
class Track:
    """What one device did: times float64 [N], strictly increasing; positions [N, 3]; rotations [N, 4]."""

    times: np.ndarray
    positions: Array
    rotations: Array


def track(times: np.ndarray, positions: Array, rotations: Array) -> Track:
    """A track from samples in any order; of samples at one time the last counts."""
    order = np.argsort(times, kind="stable")
    order = order[np.append(np.diff(times[order]) > 0, True)]
    return Track(times[order], positions[order], rotations[order])


def at_head_times(tracks: dict[int, Track]) -> tuple[np.ndarray, Array, Array]:
    """The times of the head's track, and positions [T, 3, 3] and rotations [T, 3, 4] at them of head, left and right, by index in `tracks`.

    Between its samples a device moves straight and turns evenly; NaN before its first one, after its last one, and where it has none for
    longer than GAP.
    """
    times = tracks[0].times
    positions, rotations = np.full((len(times), len(DEVICES), 3), np.nan), np.full((len(times), len(DEVICES), 4), np.nan)
    for device, own in tracks.items():
        before, share = brackets(own.times, times)
        after = np.minimum(before + 1, len(own.times) - 1)
        there = (times >= own.times[0]) & (times <= own.times[-1])
        there &= (own.times[after] - own.times[before] <= GAP) | (share == 0) | (share == 1)
        positions[there, device] = lerp_samples(own.times, own.positions, times)[there]
        rotations[there, device] = slerp_samples(own.times, continuous(normalize(own.rotations)), times)[there]
    return times, positions, rotations
