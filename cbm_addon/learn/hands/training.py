"""Training codebook matching for hands, and writing the model folder."""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path

import numpy as np

from ...hands.model import CARD_FORMAT, signature
from ...hands.sensor import Grid, reachable_grid
from ...progress import Job, Progress, part
from ..avoidance import Pool, card_of, checked_folder, export, fit, require_samples
from .config import HandConfig
from .free_poses import held_out, read_free_poses
from .geometry import Samples, noise_samples, shape_samples
from .pose_bank import make_bank

CHECKPOINT = "checkpoints/hands.checkpoint.npz"
GROUP = 256  # samples that are made together
VALIDATION = 8  # groups


def train_hands(source: Path, folder: Path, config: HandConfig, resume: bool, overwrite: bool) -> Generator[Progress, None, dict]:
    """Trains on the free poses in the folder `source` and writes a model folder; returns what the card says of the training.

    InputError if the folder holds a model or a checkpoint and neither `resume` nor `overwrite` is given.
    """
    require_samples(config.samples, GROUP, config)
    folder = checked_folder(Path(folder), CHECKPOINT, resume, overwrite)
    poses, measured = held_out(read_free_poses(source))
    grid = reachable_grid(config.cell)
    training = yield from part(make_pool(poses.angles, grid, config, config.samples // GROUP, config.seed), 0, 0.3)
    validation = yield from part(make_pool(measured.angles, grid, config, VALIDATION, config.seed + 1), 0.3, 0.32)
    networks, history = yield from part(fit(training, validation, config, folder / CHECKPOINT, resume), 0.32, 0.99)
    card = card_of(CARD_FORMAT, config, {"poses": len(poses), "held_out": sorted(set(measured.names))}, history, signature(grid))
    yield Progress(0.99, "exporting")
    export(networks, folder, card, "angles")
    return card


def make_pool(poses: np.ndarray, grid: Grid, config: HandConfig, groups: int, seed: int) -> Job[Pool]:
    """Groups of samples around interpolated poses [P, 20], solid shapes and noise in the shares of the configuration."""
    yield Progress(0, "hands: interpolating poses")
    banks = make_bank(poses, grid, min(config.poses, 4 * groups * GROUP), config.hands, seed)
    made: list[Samples] = []
    for group in range(groups):
        random = np.random.default_rng([seed, group])
        bank, solid, other_hand = banks[group % len(banks)], random.random() < config.shapes, random.random() < config.other_hands
        samples = shape_samples(bank, grid, GROUP, random, other_hand) if solid else noise_samples(bank, grid, GROUP, random)
        made.append(Samples(np.round(samples.occupancy * 255).astype(np.uint8), samples.places, samples.angles))
        if group % 10 == 0:
            yield Progress((group + 1) / groups, f"hands: surroundings {group + 1} of {groups}")
    return Pool(*(np.concatenate([getattr(samples, name) for samples in made]) for name in ("occupancy", "places", "angles")))
