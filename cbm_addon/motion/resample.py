"""Resampling by timestamps: linear for positions, spherical for rotations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .motion import Motion
from .rotations import Array, slerp


def brackets(times: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For each time in `at`: the index of the sample before it and the share 0..1 of the way to the next; clamped to the ends."""
    if len(times) == 1:
        return np.zeros(len(at), dtype=int), np.zeros(len(at))
    before = np.clip(np.searchsorted(times, at, side="right") - 1, 0, len(times) - 2)
    share = (at - times[before]) / (times[before + 1] - times[before])
    return before, np.clip(share, 0, 1)


def lerp_samples(times: np.ndarray, values: Array, at: np.ndarray) -> Array:
    """Values [T, ...] at other times, linear."""
    before, share = brackets(times, at)
    share = share.reshape(-1, *[1] * (values.ndim - 1)).astype(values.dtype)
    after = np.minimum(before + 1, len(times) - 1)
    return values[before] * (1 - share) + values[after] * share


def slerp_samples(times: np.ndarray, quaternions: Array, at: np.ndarray) -> Array:
    """Rotations [T, ..., 4] at other times, along the shorter arc."""
    before, share = brackets(times, at)
    share = share.reshape(-1, *[1] * (quaternions.ndim - 2)).astype(quaternions.dtype)
    after = np.minimum(before + 1, len(times) - 1)
    return slerp(quaternions[before], quaternions[after], np.broadcast_to(share, quaternions[before].shape[:-1]))


def frame_times(start: float, end: float, rate: float) -> np.ndarray:
    """Times at a steady rate from `start`, the last one not after `end`."""
    return start + np.arange(int(np.floor((end - start) * rate + 1e-6)) + 1) / rate


def resample(motion: Motion, times: np.ndarray) -> Motion:
    """The same motion at other times (clamped to its own)."""
    return replace(
        motion,
        times=np.asarray(times, dtype=np.float64),
        root=lerp_samples(motion.times, motion.root, times),
        rotations=slerp_samples(motion.times, motion.rotations, times),
        offsets=None if motion.offsets is None else lerp_samples(motion.times, motion.offsets, times),
    )
