"""Training codebook matching for body avoidance, and writing the model folder."""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path

import numpy as np

from ...body.model import CARD_FORMAT, signature
from ...hands.sensor import Grid
from ...progress import Job, Progress, part
from ..avoidance import Pool, card_of, checked_folder, export, fit, require_samples
from ..dataset import find_clips
from ..split import read_split, split_of
from .config import BodyConfig
from .geometry import noise_samples, shape_samples
from .pose_bank import PoseBank, read_poses

CHECKPOINT = "checkpoints/body.checkpoint.npz"
GROUP = 128  # samples that are made together
VALIDATION = 16  # groups
VALIDATION_POSES = 1_000


def train_body(sources: list[Path], folder: Path, config: BodyConfig, resume: bool, overwrite: bool) -> Generator[Progress, None, dict]:
    """Trains on poses of the clips that the split names for training, and writes a model folder; returns its card without the files.

    InputError if the folder holds a model or a checkpoint and neither `resume` nor `overwrite` is given, or if there are no poses.
    """
    require_samples(config.samples, GROUP, config)
    folder = checked_folder(Path(folder), CHECKPOINT, resume, overwrite)
    split, clips = read_split(), find_clips(sources)
    parts = {name: [path for path in clips if split_of(path.stem, split) == name] for name in ("train", "validation")}
    poses = yield from part(read_poses(parts["train"], config.poses, config.seed), 0, 0.15)
    measured = yield from part(read_poses(parts["validation"] or parts["train"], VALIDATION_POSES, config.seed), 0.15, 0.2)
    grid = poses.grid(config.cell)
    training = yield from part(make_pool(poses, grid, config, config.samples // GROUP, config.seed), 0.2, 0.4)
    validation = yield from part(make_pool(measured, grid, config, VALIDATION, config.seed + 1), 0.4, 0.42)
    networks, history = yield from part(fit(training, validation, config, folder / CHECKPOINT, resume), 0.42, 0.99)
    card = card_of(CARD_FORMAT, config, {"poses": len(poses), "clips": {name: len(paths) for name, paths in parts.items()}}, history, signature(grid))
    yield Progress(0.99, "exporting")
    export(networks, folder, card, "pose")
    return card


def make_pool(bank: PoseBank, grid: Grid, config: BodyConfig, groups: int, seed: int) -> Job[Pool]:
    """Groups of samples around poses, solid shapes and noise in the shares of the configuration."""
    yield Progress(0, "body: measuring poses")
    distances, made = bank.cell_distances(grid), []
    for group in range(groups):
        random = np.random.default_rng([seed, group])
        solid = random.random() < config.shapes
        samples = shape_samples(bank, grid, GROUP, random) if solid else noise_samples(bank, distances, grid, GROUP, random)
        made.append((np.round(samples.occupancy * 255).astype(np.uint8), samples.places, samples.answers))
        if group % 10 == 0:
            yield Progress((group + 1) / groups, f"body: surroundings {group + 1} of {groups}")
    return Pool(*(np.concatenate(values) for values in zip(*made, strict=True)))
