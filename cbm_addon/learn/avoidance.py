"""Codebook matching for collision avoidance, of hands and of bodies: from what is sensed to a pose that is free of it (Starke et al. 2024, section 6.5)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from .. import __version__
from ..errors import InputError
from ..hands.codebook import DECODER, ESTIMATOR
from ..model_folder import write_model
from ..progress import Job, Progress
from .avoidance_config import AvoidanceConfig
from .networks import CodebookMatching, sample_codes, trunk
from .onnx_graph import Graph
from .statistics import Statistics
from .training import load_checkpoint, save_checkpoint


@dataclass
class AvoidanceNetworks:
    """A trunk over what is sensed, and codebook matching over its features."""

    trunk: nn.Sequential
    matching: CodebookMatching
    sensed: Statistics
    answers: Statistics

    def modules(self) -> nn.ModuleDict:
        return nn.ModuleDict({"trunk": self.trunk, "matching": self.matching})


@dataclass(frozen=True)
class Pool:
    """Samples kept small: occupancy [N, C] as uint8 of 255, places [N, P] and answers [N, A] as they are."""

    occupancy: np.ndarray
    places: np.ndarray
    answers: np.ndarray

    def __len__(self) -> int:
        return len(self.answers)

    def batch(self, chosen: np.ndarray) -> tuple[Tensor, Tensor]:
        """What is sensed [N, C + P] and the answers [N, A]."""
        sensed = np.concatenate((self.occupancy[chosen].astype(np.float32) / 255, self.places[chosen]), -1)
        return torch.from_numpy(sensed), torch.from_numpy(self.answers[chosen])


def checked_folder(folder: Path, checkpoint: str, resume: bool, overwrite: bool) -> Path:
    """The folder; InputError if it holds a model or a checkpoint and neither `resume` nor `overwrite` says that it may."""
    if not overwrite and (folder / "card.json").exists():
        raise InputError(folder, "holds a model; pass --overwrite to replace it, or choose another folder")
    if not (overwrite or resume) and (folder / checkpoint).exists():
        raise InputError(folder, "holds a checkpoint; pass --resume to continue it or --overwrite to begin anew")
    return folder


def require_samples(samples: int, group: int, config: AvoidanceConfig) -> None:
    """InputError if the samples of a configuration do not fill a group that is made at once, or a batch."""
    least = max(group, config.batch)
    if samples < least:
        raise InputError("samples", f"is {samples}; at least {least} are needed for a batch")


def build(pool: Pool, config: AvoidanceConfig) -> AvoidanceNetworks:
    """Fresh networks, initialised from the configuration's seed, with the statistics of a share of the pool."""
    torch.manual_seed(config.seed)
    chosen = np.random.default_rng(config.seed).choice(len(pool), size=min(len(pool), 8192), replace=False)
    found = []
    for values in pool.batch(chosen):
        deviation = values.std(0)
        found.append(Statistics(values.mean(0), torch.maximum(deviation, deviation.median() / 5).clamp(min=1e-3)))
    inputs, answers = (len(statistics.mean) for statistics in found)
    net = CodebookMatching(config.hidden, answers, config.channels, config.classes, config.hidden, config.dropout, config.code_blocks, linear=True)
    return AvoidanceNetworks(trunk(inputs, config.hidden, config.blocks, config.dropout), net, *found)


def fit(pool: Pool, validation: Pool, config: AvoidanceConfig, checkpoint: Path, resume: bool) -> Job[tuple[AvoidanceNetworks, list[dict[str, float]]]]:
    """AdamW with a warm-up and a cosine schedule; a checkpoint after each epoch. Same pool, configuration and seed: same networks."""
    networks = build(pool, config)
    modules = networks.modules()
    optimiser = torch.optim.AdamW(modules.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay)
    history = load_checkpoint(checkpoint, modules, optimiser, config) if resume else []
    weight = config.matching_weight / (1 if config.matching == "paper" else pool.answers.shape[1])
    steps = len(pool) // config.batch
    for epoch in range(len(history), config.epochs):
        torch.manual_seed(config.seed * 1000 + epoch)
        order = np.random.default_rng([config.seed, epoch]).permutation(len(pool))
        losses = torch.zeros(2)
        for step in range(steps):
            now = (epoch * steps + step) / (config.epochs * steps)
            for group in optimiser.param_groups:
                group["lr"] = config.learning_rate * min(1.0, (epoch * steps + step + 1) / 200) * 0.5 * (1 + math.cos(math.pi * now))
            sensed, answers = pool.batch(order[step * config.batch : (step + 1) * config.batch])
            features = networks.trunk(networks.sensed.normalise(sensed))
            reconstruction, matched = networks.matching.losses(features, networks.answers.normalise(answers), config.matching)
            optimiser.zero_grad(set_to_none=True)
            (reconstruction + weight * matched).backward()
            optimiser.step()
            losses += torch.stack((reconstruction.detach(), matched.detach()))
            if step % 20 == 0:
                yield Progress(now, f"{config.name}: epoch {epoch + 1} of {config.epochs}")
        said = dict(zip(("reconstruction", "matching"), (losses / steps).tolist(), strict=True)) | validate(networks, validation)
        history.append({name: round(value, 4) for name, value in said.items()})
        save_checkpoint(checkpoint, modules, optimiser, config, history)
        yield Progress((epoch + 1) / config.epochs, f"{config.name}: epoch {epoch + 1}: " + ", ".join(f"{name} {value:.3g}" for name, value in said.items()))
    modules.eval()
    return networks, history


@torch.no_grad()
def validate(networks: AvoidanceNetworks, pool: Pool) -> dict[str, float]:
    """Root mean square between the numbers of held-out answers and those decoded from drawn codes, and from the best of 8 draws."""
    modules = networks.modules().eval()
    sensed, answers = pool.batch(np.arange(len(pool)))
    features = networks.trunk(networks.sensed.normalise(sensed))
    logits = networks.matching.logits(networks.matching.estimator, features)
    drawn = torch.stack([networks.answers.restore(networks.matching.decode(sample_codes(logits), features)) for _ in range(8)])
    errors = (drawn - answers).square().mean(-1).sqrt()
    modules.train()
    return {"sample": float(errors.mean()), "best_of_8": float(errors.min(0).values.mean())}


def card_of(kind: str, config: AvoidanceConfig, training: dict, history: list[dict[str, float]], features: dict) -> dict:
    """The card of a model of the format `kind`, without its files: what it was trained on (`training`), how that went, and its features."""
    return {
        "format": kind,
        "name": config.name,
        "version": __version__,
        "licence": config.licence,
        "credits": list(config.credits),
        "training": {**training, "configuration": config.as_dict(), "torch": torch.__version__, "history": history},
        "features": features,
    }


def export(networks: AvoidanceNetworks, folder: Path, card: dict, output: str) -> Path:
    """Writes the ONNX files, whose decoder's output has a name, and the card, which it completes; returns the card's path."""
    net = networks.matching
    codes, hidden = net.channels * net.classes, networks.trunk[0].out_features
    with torch.no_grad():
        estimator, decoder = Graph(), Graph()
        features = estimator.layer(networks.trunk, estimator.normalised("sensed", networks.sensed))
        estimator.node("Identity", estimator.layer(net.estimator, features), output="logits")
        estimator.node("Identity", features, output="features")
        decoder.restored(decoder.layer(net.decoder_of_codes(), decoder.node("Concat", "codes", "features", axis=-1)), networks.answers, output)
        prefix = card["format"].split()[0].removeprefix("cbm-")
        files = {
            ESTIMATOR: estimator.model("estimator", {"sensed": len(networks.sensed.mean)}, {"logits": codes, "features": hidden}),
            DECODER: decoder.model("decoder", {"codes": codes, "features": hidden}, {output: len(networks.answers.mean)}),
        }
    card = card | {"channels": net.channels, "classes": net.classes}
    return write_model(folder, {f"{prefix}.{name}": model.SerializeToString() for name, model in files.items()}, card)
