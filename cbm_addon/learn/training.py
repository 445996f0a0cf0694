"""The training loop: both stages of each mode, resumable, with checkpoints that hold arrays only."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from ..errors import InputError
from ..features import CONTROL, LOWER_BODY, LOWER_JOINTS, MODES, PROPORTIONS, TRACKERS, Mode, network_input
from ..progress import Progress, part
from .augment import misjudge_height
from .config import Trainable, TrainConfig
from .dataset import Dataset
from .miscalibration import MiscalibrationNetwork
from .networks import Blind, CodebookMatching, mean_error, sample_codes, trunk
from .rivals import ConditionalVae, ContinuousMatching
from .statistics import Statistics

Stage2 = CodebookMatching | ConditionalVae | ContinuousMatching
ENCODER_STEPS = 500  # in which the encoder of a model that is trained further finds the codes of its decoder; a fifth of all at most
NEAR, FAR = 3.0, 0.3  # causally: frames over which a prediction's importance falls, and what is left of it for the last ones
CONTACTS = 3.0  # and how much more contacts count than other numbers
LOSSES = ("control", "regression", "reconstruction", "matching")
LAYOUTS = {"window": TRACKERS, "control": CONTROL, "lower_body": LOWER_BODY}


@dataclass
class Networks:
    """What is trained for one mode, with the statistics of its inputs and outputs.

    trunk       tracker window -> features, which all the others see
    control     stage 1
    regression  the lower body without a codebook: it shapes the trunk, and is the yardstick for stage 2
    lower_body  stage 2
    history     of each epoch the mean losses (LOSSES) and what `validate` found
    manners     float32 [M, 9, 3]: what variations differ by (learn/manner.py)
    proportions  float32 [2, P]: the least and the most that was seen of each of features.PROPORTIONS
    miscalibration  what tells it from features (learn/miscalibration.py), if the mode looks ahead
    """

    mode: Mode
    trunk: nn.Sequential
    control: nn.Sequential
    regression: nn.Sequential
    lower_body: Stage2
    statistics: dict[str, Statistics]
    history: list[dict[str, float]]
    proportions: np.ndarray
    manners: np.ndarray = field(default_factory=lambda: np.zeros((0, len(LOWER_JOINTS), 3), np.float32))
    miscalibration: MiscalibrationNetwork | None = None

    def modules(self) -> nn.ModuleDict:
        parts = {"trunk": self.trunk, "control": self.control, "regression": self.regression, "lower_body": self.lower_body}
        return nn.ModuleDict(parts | {"statistics": nn.ModuleDict(self.statistics)})

    def features(self, window: Tensor) -> Tensor:
        """What the trunk makes of windows and proportions (features.network_input) as they are."""
        return self.trunk(self.statistics["window"].normalise(window))

    def losses(self, window: Tensor, control: Tensor, lower: Tensor, matching: str) -> Tensor:
        """LOSSES: the errors of control, regression and reconstruction (eq. 2), and the matching loss (eq. 3)."""
        features = self.trunk(window)
        important = importance(self.mode)
        reconstruction, matched = self.lower_body.losses(features, lower, matching, important)
        regression = mean_error(self.regression(features), lower, important)
        return torch.stack((mean_error(self.control(features), control), regression, reconstruction, matched))


@cache
def importance(mode: Mode) -> Tensor:
    """How much each number of the lower body over a sequence counts in training, flat [S * size], 1 on average.

    Causally the frames that are near count more, since the solver uses them most, and contacts do, since they decide where a foot is held.
    """
    counts = torch.ones(len(mode.sequence), LOWER_BODY.size)
    if mode.name == "causal":
        counts *= FAR + (1 - FAR) * torch.exp(-torch.tensor(mode.sequence) / NEAR)[:, None]
        counts[:, -len(LOWER_BODY.scalars) :] *= CONTACTS
    return (counts / counts.mean()).flatten()


def statistics(data: Dataset, mode: Mode, seed: int) -> dict[str, Statistics]:
    """Mean and deviation of the three feature vectors over a sample of the training set."""
    chosen = np.random.default_rng(seed).choice(len(data), size=min(len(data), 8192), replace=False)
    found = {}
    for name, values in zip(LAYOUTS, data.batch(chosen, mode), strict=True):
        flat = torch.from_numpy(network_input(values, data.proportions[chosen]) if name == "window" else values.reshape(len(values), -1))
        deviation = flat.std(0)
        # A number that hardly varies must not be blown up: no deviation below a fifth of the typical one.
        found[name] = Statistics(flat.mean(0), torch.maximum(deviation, deviation.median() / 5).clamp(min=1e-4))
    return found


def build(data: Dataset, mode: Mode, config: TrainConfig) -> Networks:
    """Fresh networks for one mode, initialised from the configuration's seed."""
    torch.manual_seed(config.seed)
    stats = statistics(data, mode, config.seed)
    inputs, control, lower = (len(stats[name].mean) for name in LAYOUTS)
    return Networks(
        mode,
        trunk(inputs, config.hidden, config.blocks, config.dropout),
        nn.Sequential(nn.Linear(config.hidden, control)),
        nn.Sequential(nn.Linear(config.hidden, lower)),
        stage2(lower, config),
        stats,
        [],
        np.stack((data.proportions.min(axis=0), data.proportions.max(axis=0))),
    )


def stage2(outputs: int, config: TrainConfig) -> Stage2:
    """Fresh networks of stage 2 over the features of a trunk: codebook matching or one of its rivals."""
    sizes = {"hidden": config.hidden, "dropout": config.dropout, "blocks": config.code_blocks}
    if config.latent == "gaussian":
        return ConditionalVae(config.hidden, outputs, **sizes)
    if config.latent == "continuous":
        return ContinuousMatching(config.hidden, outputs, config.channels * config.classes, **sizes)
    net = CodebookMatching(config.hidden, outputs, config.channels, config.classes, linear=True, **sizes)
    net.sampled, net.end_to_end = config.sampled, config.end_to_end
    if not config.decoder_sees_window:
        net.thin = Blind()
    return net


def tensors(
    data: Dataset, frames: np.ndarray, networks: Networks, rough: np.ndarray | None = None, heights: np.ndarray | None = None
) -> tuple[Tensor, Tensor, Tensor]:
    """Normalised window (with proportions), control and lower body of a batch of frames int [N].

    rough    bool [N]: whose trackers are those of a rough recording
    heights  float32 [N]: the true head height as a share of the one that is believed
    """
    found = []
    for (name, layout), values in zip(LAYOUTS.items(), data.batch(frames, networks.mode, rough), strict=True):
        seen = values if heights is None else misjudge_height(layout, values, heights)
        flat = network_input(seen, data.proportions[frames]) if name == "window" else seen.reshape(len(seen), -1)
        found.append(networks.statistics[name].normalise(torch.from_numpy(flat)))
    return tuple(found)  # type: ignore[return-value]


def disturb(window: Tensor, offsets: int, noise: float) -> Tensor:
    """A tracker window and proportions with an error that is constant over it, as a wrong calibration and a rig unlike the performer make: N(0, noise)
    deviations times ten per number of one frame and per proportion, and N(0, noise) per sample."""
    constant = torch.randn(len(window), 1, TRACKERS.size) * (10 * noise)
    errors = (constant + torch.randn(len(window), offsets, TRACKERS.size) * noise).flatten(1)
    return window + torch.cat((errors, torch.randn(len(window), len(PROPORTIONS)) * (10 * noise)), -1)


@torch.no_grad()
def validate(data: Dataset, networks: Networks, limit: int = 4096) -> dict[str, float]:
    """Normalised errors on clips that never trained, and the position error of lower joints from sampled codes (cm at a head height of 1.6 m)."""
    modules = networks.modules().eval()
    frames = np.linspace(0, len(data) - 1, min(limit, len(data))).astype(int)
    window, control, lower = tensors(data, frames, networks)
    net, features = networks.lower_body, networks.trunk(window)
    control_error, _, reconstruction, _ = networks.losses(window, control, lower, "kl")
    estimate = net.logits(net.estimator, features)
    restore = networks.statistics["lower_body"].restore
    truth = positions(restore(lower))
    drawn = torch.stack([positions(restore(net.decode(sample_codes(estimate), features))) for _ in range(8)])
    errors = (drawn - truth).norm(dim=-1).mean((-1, -2)) * 160
    regressed = positions(restore(networks.regression(features)))
    score = {
        "control_mse": float(control_error),
        "reconstruction_mse": float(reconstruction),
        "sample_cm": float(errors.mean()),
        "best_of_8_cm": float(errors.min(0).values.mean()),
        "mean_of_8_cm": float((drawn.mean(0) - truth).norm(dim=-1).mean() * 160),
        "regression_cm": float((regressed - truth).norm(dim=-1).mean() * 160),
    }
    modules.train()
    return score


def positions(lower: Tensor) -> Tensor:
    """Positions [N, S, 9, 3] of the lower joints from flat lower-body features [N, S * size]."""
    count = len(LOWER_JOINTS)
    return lower.unflatten(-1, (-1, LOWER_BODY.size))[..., : 3 * count].unflatten(-1, (count, 3))


def train(
    data: dict[str, Dataset], config: TrainConfig, folder: Path, resume: bool, begin: Callable[[Networks], None] | None = None
) -> Generator[Progress, None, list[Networks]]:
    """Trains every mode of the configuration; a checkpoint in `folder` after each epoch. Same data, configuration and seed: same networks.

    begin  gives fresh networks what a trained model knows (learn/start.py)
    """
    trained = []
    torch.set_flush_denormal(True)
    try:
        for i, name in enumerate(config.modes):
            job = train_mode(data, MODES[name], config, Path(folder) / f"{name}.checkpoint.npz", resume, begin)
            trained.append((yield from part(job, i / len(config.modes), (i + 1) / len(config.modes))))
    finally:
        torch.set_flush_denormal(False)  # it is the processor's state: whoever calls may need small numbers
    return trained


def train_mode(
    data: dict[str, Dataset], mode: Mode, config: TrainConfig, checkpoint: Path, resume: bool, begin: Callable[[Networks], None] | None = None
) -> Generator[Progress, None, Networks]:
    """AdamW with a warm-up and a cosine schedule; bf16 where the processor has it, fp32 weights.

    Networks that begin from a trained model first learn what a model does not hold, encoder and regression, the rest held as it is.
    """
    networks = build(data["train"], mode, config)
    if begin:
        begin(networks)
    modules = networks.modules()
    optimiser = torch.optim.AdamW(modules.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay, fused=True)
    steps = len(data["train"]) // config.batch
    if steps == 0:
        raise InputError("training data", f"holds {len(data['train'])} frames; at least one batch of {config.batch} is needed")
    networks.history = load_checkpoint(checkpoint, modules, optimiser, config) if resume else []
    weights = torch.ones(4)
    weights[3] = config.matching_weight
    if config.matching != "paper":
        weights[3] /= len(networks.statistics["lower_body"].mean)
    half = torch.cpu._is_avx512_bf16_supported()
    total, warmup = config.epochs * steps, 200
    held = [module for module in (networks.trunk, networks.control, networks.lower_body.estimator, networks.lower_body.decoder) if begin]
    for epoch in range(len(networks.history), config.epochs):
        torch.manual_seed(config.seed * 1000 + epoch)
        random = np.random.default_rng([config.seed, epoch])
        losses, started = torch.zeros(4), time.perf_counter()
        for step, frames in enumerate(data["train"].drawn(config.batch, config.seed * 1000 + epoch)):
            now = epoch * steps + step
            for module in held:
                module.requires_grad_(now >= min(ENCODER_STEPS, total // 5))
            rate = config.learning_rate * min(1.0, (now + 1) / warmup) * 0.5 * (1 + math.cos(math.pi * now / total))
            for group in optimiser.param_groups:
                group["lr"] = rate
            rough = random.random(len(frames)) < config.rough
            heights = np.exp(random.normal(scale=config.height_error, size=len(frames))).astype(np.float32)
            window, control, lower = tensors(data["train"], frames, networks, rough, heights)
            window = disturb(window, len(mode.window), config.noise)
            with torch.autocast("cpu", torch.bfloat16, enabled=half):
                parts = networks.losses(window, control, lower, config.matching)
            loss = (parts * weights).sum()
            optimiser.zero_grad(set_to_none=True)
            loss.backward()
            optimiser.step()
            losses += parts.detach()
            if step % 20 == 0:
                speed = (step + 1) * config.batch / (time.perf_counter() - started)
                yield Progress(now / total, f"{mode.name}: epoch {epoch + 1} of {config.epochs}, {speed:.0f} samples/s")
        said = dict(zip(LOSSES, (losses / steps).tolist(), strict=True)) | validate(data["validation"], networks)
        networks.history.append({name: round(value, 4) for name, value in said.items()})
        save_checkpoint(checkpoint, modules, optimiser, config, networks.history)
        yield Progress((epoch + 1) / config.epochs, f"{mode.name}: epoch {epoch + 1}: " + ", ".join(f"{name} {value:.3g}" for name, value in said.items()))
    modules.eval()
    return networks


def save_checkpoint(path: Path, modules: nn.ModuleDict, optimiser: torch.optim.Optimizer, config: Trainable, history: list[dict[str, float]]) -> None:
    """Parameters and AdamW's moments as plain arrays; written beside and renamed, so that a kill leaves the last good one."""
    arrays = {f"parameter/{key}": value.numpy() for key, value in modules.state_dict().items()}
    for index, parameter in enumerate(optimiser.param_groups[0]["params"]):
        for key, value in optimiser.state.get(parameter, {}).items():
            arrays[f"moment/{index}/{key}"] = value.numpy()
    arrays["config"] = np.array(json.dumps(config.as_dict() | {"history": history}))
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_suffix(".partial.npz")
    np.savez(temporary, **arrays)
    temporary.replace(path)


def load_checkpoint(path: Path, modules: nn.ModuleDict, optimiser: torch.optim.Optimizer, config: Trainable) -> list[dict[str, float]]:
    """Restores a checkpoint and returns its history, an entry for each epoch; empty if there is none."""
    if not path.exists():
        return []
    with np.load(path, allow_pickle=False) as stored:
        saved = json.loads(str(stored["config"]))
        history = saved.pop("history")
        if saved != json.loads(json.dumps(config.as_dict())):
            raise InputError(path, "was made with another configuration; resume with that one or choose another model folder")
        modules.load_state_dict({key[10:]: torch.from_numpy(stored[key]) for key in stored.files if key.startswith("parameter/")})
        parameters = optimiser.param_groups[0]["params"]
        for key in stored.files:
            if key.startswith("moment/"):
                _, index, name = key.split("/")
                optimiser.state[parameters[int(index)]][name] = torch.from_numpy(stored[key])
    return history
