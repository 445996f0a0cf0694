"""The training loop: both stages of each mode, resumable, with checkpoints that hold arrays only."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as F

from ..errors import InputError
from ..features import LOWER_BODY, LOWER_JOINTS, MODES, Mode
from ..progress import Progress, part
from .config import TrainConfig
from .dataset import Dataset
from .networks import CodebookMatching, mlp, sample_codes


@dataclass(frozen=True)
class Statistics:
    """Mean and deviation of each number of a feature vector; constant numbers get a deviation of 1."""

    mean: Tensor
    deviation: Tensor

    def normalise(self, values: Tensor) -> Tensor:
        return (values - self.mean) / self.deviation

    def restore(self, values: Tensor) -> Tensor:
        return values * self.deviation + self.mean


@dataclass
class Networks:
    """What is trained for one mode: stage 1 (`control`) and stage 2 (`lower_body`), with the statistics of their inputs and outputs."""

    mode: Mode
    control: nn.Sequential
    lower_body: CodebookMatching
    statistics: dict[str, Statistics]
    score: dict[str, float]

    def modules(self) -> nn.ModuleDict:
        return nn.ModuleDict({"control": self.control, "lower_body": self.lower_body})


def statistics(data: Dataset, mode: Mode, seed: int) -> dict[str, Statistics]:
    """Mean and deviation of the three feature vectors over a sample of the training set."""
    chosen = np.random.default_rng(seed).choice(len(data), size=min(len(data), 8192), replace=False)
    found = {}
    for name, values in zip(("window", "control", "lower_body"), data.batch(chosen, mode), strict=True):
        flat = torch.from_numpy(values.reshape(len(values), -1))
        deviation = flat.std(0)
        # A number that hardly varies must not be blown up: no deviation below a fifth of the typical one.
        found[name] = Statistics(flat.mean(0), torch.maximum(deviation, deviation.median() / 5).clamp(min=1e-4))
    return found


def build(data: Dataset, mode: Mode, config: TrainConfig) -> Networks:
    """Fresh networks for one mode, initialised from the configuration's seed."""
    torch.manual_seed(config.seed)
    stats = statistics(data, mode, config.seed)
    inputs, control, lower = (len(stats[name].mean) for name in ("window", "control", "lower_body"))
    return Networks(
        mode,
        mlp(inputs, config.hidden, control, config.dropout),
        CodebookMatching(inputs, lower, config.channels, config.classes, config.hidden, config.dropout),
        stats,
        {},
    )


def tensors(data: Dataset, frames: np.ndarray, networks: Networks) -> tuple[Tensor, Tensor, Tensor]:
    """Normalised window, control and lower body of a batch of frames."""
    names = ("window", "control", "lower_body")
    return tuple(
        networks.statistics[name].normalise(torch.from_numpy(values.reshape(len(values), -1)))
        for name, values in zip(names, data.batch(frames, networks.mode), strict=True)
    )  # type: ignore[return-value]


def disturb(window: Tensor, offsets: int, noise: float) -> Tensor:
    """A tracker window with an error that is constant over it, as a wrong calibration makes: N(0, noise) deviations times ten per number
    of one frame, and N(0, noise) per sample."""
    per_frame = window.shape[1] // offsets
    constant = torch.randn(len(window), 1, per_frame) * (10 * noise)
    return window + (constant + torch.randn(len(window), offsets, per_frame) * noise).flatten(1)


@torch.no_grad()
def validate(data: Dataset, networks: Networks, limit: int = 4096) -> dict[str, float]:
    """Normalised errors on clips that never trained, and the position error of lower joints from sampled codes (cm at a head height of 1.6 m)."""
    modules = networks.modules().eval()
    frames = np.linspace(0, len(data) - 1, min(limit, len(data))).astype(int)
    window, control, lower = tensors(data, frames, networks)
    net = networks.lower_body
    reconstruction, _ = net.losses(window, lower, "kl")
    estimate = net.logits(net.estimator, window)
    restore = networks.statistics["lower_body"].restore
    truth = positions(restore(lower))
    drawn = torch.stack([positions(restore(net.decode(sample_codes(estimate), window))) for _ in range(8)])
    errors = (drawn - truth).norm(dim=-1).mean((-1, -2)) * 160
    mean_error = (drawn.mean(0) - truth).norm(dim=-1).mean() * 160
    score = {
        "control_mse": float(F.mse_loss(networks.control(window), control)),
        "reconstruction_mse": float(reconstruction),
        "sample_cm": float(errors.mean()),
        "best_of_8_cm": float(errors.min(0).values.mean()),
        "mean_of_8_cm": float(mean_error),
    }
    modules.train()
    return score


def positions(lower: Tensor) -> Tensor:
    """Positions [N, S, 9, 3] of the lower joints from flat lower-body features [N, S * size]."""
    count = len(LOWER_JOINTS)
    return lower.unflatten(-1, (-1, LOWER_BODY.size))[..., : 3 * count].unflatten(-1, (count, 3))


def train(data: dict[str, Dataset], config: TrainConfig, folder: Path, resume: bool) -> Generator[Progress, None, list[Networks]]:
    """Trains every mode of the configuration; a checkpoint in `folder` after each epoch. Same data, configuration and seed: same networks."""
    trained = []
    torch.set_flush_denormal(True)
    try:
        for i, name in enumerate(config.modes):
            job = train_mode(data, MODES[name], config, Path(folder) / f"{name}.checkpoint.npz", resume)
            trained.append((yield from part(job, i / len(config.modes), (i + 1) / len(config.modes))))
    finally:
        torch.set_flush_denormal(False)  # it is the processor's state: whoever calls may need small numbers
    return trained


def train_mode(data: dict[str, Dataset], mode: Mode, config: TrainConfig, checkpoint: Path, resume: bool) -> Generator[Progress, None, Networks]:
    """AdamW with a warm-up and a cosine schedule; bf16 where the processor has it, fp32 weights."""
    networks = build(data["train"], mode, config)
    modules = networks.modules()
    optimiser = torch.optim.AdamW(modules.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay)
    steps = len(data["train"]) // config.batch
    if steps == 0:
        raise InputError("training data", f"holds {len(data['train'])} frames; at least one batch of {config.batch} is needed")
    done = load_checkpoint(checkpoint, modules, optimiser, config) if resume else 0
    weight = config.matching_weight
    if config.matching != "paper":
        weight /= len(networks.statistics["lower_body"].mean)
    half = torch.cpu._is_avx512_bf16_supported()
    total, warmup = config.epochs * steps, 200
    for epoch in range(done, config.epochs):
        torch.manual_seed(config.seed * 1000 + epoch)
        losses, started = torch.zeros(3), time.perf_counter()
        for step, frames in enumerate(data["train"].drawn(config.batch, config.seed * 1000 + epoch)):
            now = epoch * steps + step
            rate = config.learning_rate * min(1.0, (now + 1) / warmup) * 0.5 * (1 + math.cos(math.pi * now / total))
            for group in optimiser.param_groups:
                group["lr"] = rate
            window, control, lower = tensors(data["train"], frames, networks)
            window = disturb(window, len(mode.window), config.noise)
            with torch.autocast("cpu", torch.bfloat16, enabled=half):
                regression = F.mse_loss(networks.control(window).float(), control)
                reconstruction, matching = networks.lower_body.losses(window, lower, config.matching)
            loss = regression + reconstruction + weight * matching
            optimiser.zero_grad(set_to_none=True)
            loss.backward()
            optimiser.step()
            losses += torch.stack((regression, reconstruction, matching)).detach()
            if step % 20 == 0:
                speed = (step + 1) * config.batch / (time.perf_counter() - started)
                yield Progress(now / total, f"{mode.name}: epoch {epoch + 1} of {config.epochs}, {speed:.0f} samples/s")
        networks.score = validate(data["validation"], networks)
        save_checkpoint(checkpoint, modules, optimiser, config, epoch + 1)
        mean = losses / steps
        text = ", ".join(f"{key} {value:.3g}" for key, value in networks.score.items())
        yield Progress(
            (epoch + 1) / config.epochs, f"{mode.name}: epoch {epoch + 1}: control {mean[0]:.3f} reconstruction {mean[1]:.3f} matching {mean[2]:.2f}; {text}"
        )
    if not networks.score:
        networks.score = validate(data["validation"], networks)
    modules.eval()
    return networks


def save_checkpoint(path: Path, modules: nn.ModuleDict, optimiser: torch.optim.Optimizer, config: TrainConfig, epoch: int) -> None:
    """Parameters and AdamW's moments as plain arrays; written beside and renamed, so that a kill leaves the last good one."""
    arrays = {f"parameter/{key}": value.numpy() for key, value in modules.state_dict().items()}
    for index, parameter in enumerate(optimiser.param_groups[0]["params"]):
        for key, value in optimiser.state.get(parameter, {}).items():
            arrays[f"moment/{index}/{key}"] = value.numpy()
    arrays["config"] = np.array(json.dumps(config.as_dict() | {"epochs_done": epoch}))
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_suffix(".partial.npz")
    np.savez(temporary, **arrays)
    temporary.replace(path)


def load_checkpoint(path: Path, modules: nn.ModuleDict, optimiser: torch.optim.Optimizer, config: TrainConfig) -> int:
    """Restores a checkpoint and returns how many epochs it holds; 0 if there is none."""
    if not path.exists():
        return 0
    with np.load(path, allow_pickle=False) as stored:
        saved = json.loads(str(stored["config"]))
        epoch = saved.pop("epochs_done")
        if saved != json.loads(json.dumps(config.as_dict())):
            raise InputError(path, "was made with another configuration; resume with that one or choose another model folder")
        modules.load_state_dict({key[10:]: torch.from_numpy(stored[key]) for key in stored.files if key.startswith("parameter/")})
        parameters = optimiser.param_groups[0]["params"]
        for key in stored.files:
            if key.startswith("moment/"):
                _, index, name = key.split("/")
                optimiser.state[parameters[int(index)]][name] = torch.from_numpy(stored[key])
    return epoch
