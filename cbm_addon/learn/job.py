"""A training run from clips to a model folder, as one job."""

from __future__ import annotations

from collections.abc import Generator
from functools import partial
from pathlib import Path

import numpy as np
import torch

from .. import __version__
from ..errors import InputError
from ..features import MODES
from ..progress import Progress, part
from ..solve.models import read_card
from .config import TrainConfig
from .dataset import Dataset, find_clips, read_datasets
from .export import export
from .manner import manners
from .miscalibration import learn_miscalibration
from .split import read_split
from .start import keep_some, start_from
from .training import Networks, build, train

CHECKPOINTS = "checkpoints"


def train_model(
    sources: list[Path], folder: Path, config: TrainConfig, resume: bool, overwrite: bool, start: Path | None = None
) -> Generator[Progress, None, dict]:
    """Trains on the clips of `sources`, from nothing or on from the model in `start`, and writes a model folder; returns what the card says of the
    training. Modes of `start` that are not trained are taken over.

    Checkpoints stay in a sub-folder, so that a killed run is continued with `resume`. InputError if the folder holds a model or
    checkpoints and neither `resume` nor `overwrite` is given.
    """
    folder = Path(folder)
    checkpoints = folder / CHECKPOINTS
    if not overwrite and (folder / "card.json").exists():
        raise InputError(folder, "holds a model; pass --overwrite to replace it, or choose another folder")
    if not (overwrite or resume) and any(checkpoints.glob("*.npz")):
        raise InputError(folder, "holds checkpoints; pass --resume to continue them or --overwrite to begin anew")
    before = read_card(start) if start else None
    clips = find_clips(sources)
    data = yield from part(read_datasets(clips, read_split(), variants=config.variants), 0, 0.03)
    trained = yield from part(train(data, config, checkpoints, resume, partial(start_from, start) if start else None), 0.03, 0.95)
    if start and before:
        for networks in trained:
            keep_some(start, networks, config.keep)
            networks.history = before["modes"][networks.mode.name]["history"] + networks.history
    for networks in trained:
        networks.modules().eval()
        networks.manners = manners(data["validation"], networks)
    if start and before:
        trained += _taken_over(start, config, data)
    for networks in trained:
        if config.miscalibration and networks.mode.looks_ahead:
            networks.miscalibration = yield from part(learn_miscalibration(clips, read_split(), networks, config.seed), 0.95, 0.99)
    facts = {
        "name": config.name,
        "version": __version__,
        "licence": config.licence,
        "credits": list(config.credits),
        "training": {
            **({"from": {key: before[key] for key in ("name", "version", "training")}} if before else {}),
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


def _taken_over(folder: Path, config: TrainConfig, data: dict[str, Dataset]) -> list[Networks]:
    """The networks of a model for the modes that the configuration does not train."""
    found = []
    for name, entry in read_card(folder)["modes"].items():
        if name not in config.modes:
            networks = build(data["train"], MODES[name], config)
            start_from(folder, networks)
            networks.modules().eval()
            networks.history = entry["history"]
            networks.proportions, networks.manners = (np.array(entry[key], np.float32) for key in ("proportions_range", "manners"))
            found.append(networks)
    return found
