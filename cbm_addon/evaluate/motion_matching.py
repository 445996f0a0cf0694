"""Motion matching, the classical baseline: the clip of the training set whose trackers were most alike is played for a while, then the next."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, replace

import numpy as np

from ..features import CONTROL, LOWER_BODY, MODES, Frames, Mode, tracker_frames
from ..learn.dataset import Dataset
from ..motion.rotations import Array
from ..progress import Progress
from ..solve.perform import Join, at_rate, join_performance
from ..solve.performance import Performance
from ..takes.take import Take

HOP = 10  # frames from one search to the next
FADE = 5  # frames in which a causal match takes over from the one before
DIMENSIONS = 64  # of the tracker windows that are compared
SAMPLE = 20_000  # windows from which the reduction is learned
BLOCK = 8192  # windows handled at a time

# What is played of a match: looking ahead the frames around it, causally those after it.
PLAYED = {
    "lookahead": replace(MODES["lookahead"], sequence=tuple(range(1 - HOP, HOP))),
    "causal": replace(MODES["causal"], sequence=tuple(range(HOP + FADE))),
}


@dataclass(frozen=True)
class Database:
    """Clips and the reduced tracker window of each of their frames.

    mode     the window that is compared and the sequence that is played
    dataset  N frames of clips
    mean     float32 [W] of the windows
    basis    float32 [W, DIMENSIONS]: the directions in which windows vary most, every feature counted in its own spread
    keys     float32 [N, DIMENSIONS]: the windows in that basis
    """

    mode: Mode
    dataset: Dataset
    mean: Array
    basis: Array
    keys: Array

    def nearest(self, windows: Array) -> np.ndarray:
        """The frames int [Q] whose windows are most like the windows [Q, O, .]."""
        queries = _reduced(windows, self.mean, self.basis)
        best, found = np.full(len(queries), np.inf, np.float32), np.zeros(len(queries), int)
        for start in range(0, len(self.keys), BLOCK):
            keys = self.keys[start : start + BLOCK]
            distance = np.sum(keys * keys, axis=-1) - 2 * queries @ keys.T  # but for the query's own square
            frame = np.argmin(distance, axis=1)
            closest = np.take_along_axis(distance, frame[:, None], axis=1)[:, 0]
            found = np.where(closest < best, start + frame, found)
            best = np.minimum(best, closest)
        return found


def index_database(dataset: Dataset, mode: str) -> Generator[Progress, None, Database]:
    """The clips of a data set made ready for the search in one mode."""
    played = PLAYED[mode]
    yield Progress(0, "reducing tracker windows")
    sample = np.linspace(0, len(dataset) - 1, min(SAMPLE, len(dataset))).astype(int)
    mean, basis = _principal_directions(dataset.batch(sample, played)[0])
    parts = []
    for start in range(0, len(dataset), BLOCK):
        yield Progress(start / len(dataset), "indexing the motion database")
        frames = np.arange(start, min(start + BLOCK, len(dataset)))
        parts.append(_reduced(dataset.batch(frames, played)[0], mean, basis))
    return Database(played, dataset, mean, basis, np.concatenate(parts))


def match_motion(take: Take, head_height: float, database: Database) -> Performance:
    """A calibrated take answered with what the database did when its trackers moved alike."""
    take, mode = at_rate(take), database.mode
    trackers, anchors = tracker_frames(take, head_height)
    frames = np.arange(0, len(take.times), HOP)
    anchors = anchors[frames]
    matches = database.nearest(trackers.seen_from(anchors, frames[:, None] + np.array(mode.window)))
    _, control, lower_body = database.dataset.batch(matches, mode)
    control, _ = Frames.to_world(CONTROL, control, anchors)
    vectors, contacts = Frames.to_world(LOWER_BODY, lower_body, anchors)
    join = Join(len(take.times), frames, mode.sequence, _weights(mode))
    return join_performance(take.times, join, control, vectors, contacts, head_height, mode.name == "causal")


def _weights(mode: Mode) -> Array:
    """How much each frame of a sequence counts: neighbouring matches fade into each other in straight lines."""
    offsets = np.array(mode.sequence)
    if mode.name == "causal":
        return (np.minimum(np.minimum(offsets + 1, HOP + FADE - offsets), FADE + 1) / (FADE + 1)).astype(np.float32)
    return (1 - np.abs(offsets) / HOP).astype(np.float32)


def _principal_directions(windows: Array) -> tuple[Array, Array]:
    """Mean [W] and basis [W, DIMENSIONS] of windows [N, O, .] by principal component analysis, every feature scaled by its spread.

    The spread is over all frames of the window, so that a feature is not blown up where it hardly varies (the head's place at the anchor).
    """
    spread = np.maximum(windows.reshape(-1, windows.shape[-1]).std(axis=0), 1e-3)
    scale = np.tile(spread, windows.shape[1])[:, None]
    flat = windows.reshape(len(windows), -1)
    mean = flat.mean(axis=0)
    _, vectors = np.linalg.eigh(np.cov((flat - mean) / scale[:, 0], rowvar=False))  # eigenvalues in rising order
    return mean, (vectors[:, ::-1][:, :DIMENSIONS] / scale).astype(np.float32)


def _reduced(windows: Array, mean: Array, basis: Array) -> Array:
    return (windows.reshape(len(windows), -1) - mean) @ basis
