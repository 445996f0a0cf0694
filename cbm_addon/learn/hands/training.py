"""Training codebook matching for hands, and writing the model folder."""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from ... import __version__
from ...errors import InputError
from ...hands.hand import ANGLES
from ...hands.model import CARD_FORMAT, DECODER, ESTIMATOR, signature
from ...hands.sensor import Grid, reachable_grid
from ...model_folder import write_model
from ...progress import Job, Progress, part
from ..networks import CodebookMatching, sample_codes, trunk
from ..onnx_graph import Graph
from ..statistics import Statistics
from ..training import load_checkpoint, save_checkpoint
from .config import HandConfig
from .free_poses import held_out, read_free_poses
from .geometry import Samples, noise_samples, shape_samples
from .pose_bank import make_bank

CHECKPOINT = "checkpoints/hands.checkpoint.npz"
GROUP = 256  # samples that are made together
VALIDATION = 8  # groups


@dataclass
class HandNetworks:
    """A trunk over what is sensed, and codebook matching over its features."""

    trunk: nn.Sequential
    matching: CodebookMatching
    sensed: Statistics
    angles: Statistics

    def modules(self) -> nn.ModuleDict:
        return nn.ModuleDict({"trunk": self.trunk, "matching": self.matching})


@dataclass(frozen=True)
class Pool:
    """Samples kept small: occupancy as uint8 of 255, places and angles as they are."""

    occupancy: np.ndarray
    places: np.ndarray
    angles: np.ndarray

    def __len__(self) -> int:
        return len(self.angles)

    def batch(self, chosen: np.ndarray) -> tuple[Tensor, Tensor]:
        """What is sensed [N, C + 60] and the angles [N, 20]."""
        sensed = np.concatenate((self.occupancy[chosen].astype(np.float32) / 255, self.places[chosen]), -1)
        return torch.from_numpy(sensed), torch.from_numpy(self.angles[chosen])


def train_hands(source: Path, folder: Path, config: HandConfig, resume: bool, overwrite: bool) -> Generator[Progress, None, dict]:
    """Trains on the free poses in the folder `source` and writes a model folder; returns what the card says of the training.

    InputError if the folder holds a model or a checkpoint and neither `resume` nor `overwrite` is given.
    """
    folder = Path(folder)
    if not overwrite and (folder / "card.json").exists():
        raise InputError(folder, "holds a model; pass --overwrite to replace it, or choose another folder")
    if not (overwrite or resume) and (folder / CHECKPOINT).exists():
        raise InputError(folder, "holds a checkpoint; pass --resume to continue it or --overwrite to begin anew")
    poses, measured = held_out(read_free_poses(source))
    grid = reachable_grid()
    training = yield from part(make_pool(poses.angles, grid, config, config.samples // GROUP, config.seed), 0, 0.3)
    validation = yield from part(make_pool(measured.angles, grid, config, VALIDATION, config.seed + 1), 0.3, 0.32)
    networks, history = yield from part(fit(training, validation, config, folder / CHECKPOINT, resume), 0.32, 0.99)
    facts = {
        "name": config.name,
        "version": __version__,
        "licence": config.licence,
        "credits": list(config.credits),
        "training": {
            "poses": len(poses),
            "held_out": sorted(set(measured.names)),
            "configuration": config.as_dict(),
            "torch": torch.__version__,
            "history": history,
        },
    }
    yield Progress(0.99, "exporting")
    export(networks, grid, folder, facts)
    return facts


def make_pool(poses: np.ndarray, grid: Grid, config: HandConfig, groups: int, seed: int) -> Job[Pool]:
    """Groups of samples around interpolated poses [P, 20], solid shapes and noise in the shares of the configuration."""
    yield Progress(0, "hands: interpolating poses")
    banks = make_bank(poses, grid, min(config.poses, 4 * groups * GROUP), config.hands, seed)
    made: list[Samples] = []
    for group in range(groups):
        random = np.random.default_rng([seed, group])
        sampled = shape_samples if random.random() < config.shapes else noise_samples
        samples = sampled(banks[group % len(banks)], grid, GROUP, random)
        made.append(Samples(np.round(samples.occupancy * 255).astype(np.uint8), samples.places, samples.angles))
        if group % 10 == 0:
            yield Progress((group + 1) / groups, f"hands: surroundings {group + 1} of {groups}")
    return Pool(*(np.concatenate([getattr(samples, name) for samples in made]) for name in ("occupancy", "places", "angles")))


def build(pool: Pool, config: HandConfig) -> HandNetworks:
    """Fresh networks, initialised from the configuration's seed, with the statistics of a share of the pool."""
    torch.manual_seed(config.seed)
    chosen = np.random.default_rng(config.seed).choice(len(pool), size=min(len(pool), 8192), replace=False)
    found = []
    for values in pool.batch(chosen):
        deviation = values.std(0)
        found.append(Statistics(values.mean(0), torch.maximum(deviation, deviation.median() / 5).clamp(min=1e-3)))
    inputs = len(found[0].mean)
    net = CodebookMatching(config.hidden, len(ANGLES), config.channels, config.classes, config.hidden, config.dropout, config.code_blocks, linear=True)
    return HandNetworks(trunk(inputs, config.hidden, config.blocks, config.dropout), net, *found)


def fit(pool: Pool, validation: Pool, config: HandConfig, checkpoint: Path, resume: bool) -> Job[tuple[HandNetworks, list[dict[str, float]]]]:
    """AdamW with a warm-up and a cosine schedule; a checkpoint after each epoch. Same poses, configuration and seed: same networks."""
    networks = build(pool, config)
    modules = networks.modules()
    optimiser = torch.optim.AdamW(modules.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay)
    history = load_checkpoint(checkpoint, modules, optimiser, config) if resume else []
    weight = config.matching_weight / (1 if config.matching == "paper" else len(ANGLES))
    steps = len(pool) // config.batch
    for epoch in range(len(history), config.epochs):
        torch.manual_seed(config.seed * 1000 + epoch)
        order = np.random.default_rng([config.seed, epoch]).permutation(len(pool))
        losses = torch.zeros(2)
        for step in range(steps):
            now = (epoch * steps + step) / (config.epochs * steps)
            for group in optimiser.param_groups:
                group["lr"] = config.learning_rate * min(1.0, (epoch * steps + step + 1) / 200) * 0.5 * (1 + math.cos(math.pi * now))
            sensed, angles = pool.batch(order[step * config.batch : (step + 1) * config.batch])
            features = networks.trunk(networks.sensed.normalise(sensed))
            reconstruction, matched = networks.matching.losses(features, networks.angles.normalise(angles), config.matching)
            optimiser.zero_grad(set_to_none=True)
            (reconstruction + weight * matched).backward()
            optimiser.step()
            losses += torch.stack((reconstruction.detach(), matched.detach()))
            if step % 20 == 0:
                yield Progress(now, f"hands: epoch {epoch + 1} of {config.epochs}")
        said = dict(zip(("reconstruction", "matching"), (losses / steps).tolist(), strict=True)) | validate(networks, validation)
        history.append({name: round(value, 4) for name, value in said.items()})
        save_checkpoint(checkpoint, modules, optimiser, config, history)
        yield Progress((epoch + 1) / config.epochs, f"hands: epoch {epoch + 1}: " + ", ".join(f"{name} {value:.3g}" for name, value in said.items()))
    modules.eval()
    return networks, history


@torch.no_grad()
def validate(networks: HandNetworks, pool: Pool) -> dict[str, float]:
    """Degrees (rms) between the angles of held-out poses and those decoded from drawn codes, and from the best of 8 draws."""
    modules = networks.modules().eval()
    sensed, angles = pool.batch(np.arange(len(pool)))
    features = networks.trunk(networks.sensed.normalise(sensed))
    logits = networks.matching.logits(networks.matching.estimator, features)
    drawn = torch.stack([networks.angles.restore(networks.matching.decode(sample_codes(logits), features)) for _ in range(8)])
    errors = torch.rad2deg((drawn - angles).square().mean(-1).sqrt())
    modules.train()
    return {"sample_deg": float(errors.mean()), "best_of_8_deg": float(errors.min(0).values.mean())}


def export(networks: HandNetworks, grid: Grid, folder: Path, facts: dict) -> Path:
    """Writes the ONNX files and the card; returns the card's path."""
    net = networks.matching
    codes, hidden = net.channels * net.classes, networks.trunk[0].out_features
    with torch.no_grad():
        estimator, decoder = Graph(), Graph()
        features = estimator.layer(networks.trunk, estimator.normalised("sensed", networks.sensed))
        estimator.node("Identity", estimator.layer(net.estimator, features), output="logits")
        estimator.node("Identity", features, output="features")
        decoder.restored(decoder.layer(net.decoder_of_codes(), decoder.node("Concat", "codes", "features", axis=-1)), networks.angles, "angles")
        files = {
            ESTIMATOR: estimator.model("estimator", {"sensed": len(networks.sensed.mean)}, {"logits": codes, "features": hidden}),
            DECODER: decoder.model("decoder", {"codes": codes, "features": hidden}, {"angles": len(ANGLES)}),
        }
    card = {"format": CARD_FORMAT, **facts, "features": signature(grid), "channels": net.channels, "classes": net.classes}
    return write_model(folder, {name: model.SerializeToString() for name, model in files.items()}, card)
