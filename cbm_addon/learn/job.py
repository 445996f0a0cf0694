"""A training run from clips to a model folder, as one job."""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path

import torch

from .. import __version__
from ..errors import InputError
from ..progress import Progress, part
from .config import TrainConfig
from .dataset import find_clips, read_datasets
from .export import export
from .split import read_split
from .training import train

CHECKPOINTS = "checkpoints"


def train_model(sources: list[Path], folder: Path, config: TrainConfig, resume: bool, overwrite: bool) -> Generator[Progress, None, dict]:
    """Trains on the clips of `sources` and writes a model folder; returns what the card says of the training.

    Checkpoints stay in a sub-folder, so that a killed run is continued with `resume`. InputError if the folder holds a model or
    checkpoints and neither `resume` nor `overwrite` is given.
    """
    folder = Path(folder)
    checkpoints = folder / CHECKPOINTS
    if not overwrite and (folder / "card.json").exists():
        raise InputError(folder, "holds a model; pass --overwrite to replace it, or choose another folder")
    if not (overwrite or resume) and any(checkpoints.glob("*.npz")):
        raise InputError(folder, "holds checkpoints; pass --resume to continue them or --overwrite to begin anew")
    clips = find_clips(sources)
    data = yield from part(read_datasets(clips, read_split()), 0, 0.03)
    trained = yield from part(train(data, config, checkpoints, resume), 0.03, 0.99)
    facts = {
        "name": config.name,
        "version": __version__,
        "licence": config.licence,
        "credits": list(config.credits),
        "training": {
            "clips": {name: len(set(found.stems)) for name, found in data.items()},
            "frames": {name: len(found) for name, found in data.items()},
            "mirrored": True,
            "configuration": config.as_dict(),
            "torch": torch.__version__,
        },
    }
    yield Progress(0.99, "exporting")
    export(trained, folder, facts)
    return facts | {"validation": {networks.mode.name: networks.history[-1] for networks in trained}}
