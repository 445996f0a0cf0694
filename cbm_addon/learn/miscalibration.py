"""Learning to tell a miscalibration (solve/miscalibration.py): a small network over the features of a trained trunk, whose answers are averaged
over a take. It trains on the training clips with controllers that sit askew and heights that are misjudged."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field
from itertools import permutations
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from torch import Tensor, nn

from ..features import STANDARD_PROPORTIONS, network_input, tracker_frames
from ..motion.mirror import mirror
from ..motion.motion import Motion
from ..motion.rotations import Array
from ..progress import Job, Progress, part
from ..takes.devices import CONTROLLERS
from ..takes.slip import Slip, mistaken, slipped
from ..takes.synthesize import synthesize
from .augment import draw_slip, vary
from .dataset import read_sound_motion
from .split import split_of
from .statistics import Statistics

if TYPE_CHECKING:
    from .training import Networks

TAKES = 8  # are made of each clip, of its mirror image, and of the same by other bodies
WINDOWS = 40  # are seen of each
EXACT, MISTAKEN = 0.2, 0.25  # how many of them are calibrated well, and how many as recordings of other controllers
WIDE, NEAR = 1.4, 0.3  # the slips of the others, and those besides a mistake, as shares of what `draw_slip` draws
HEIGHT = 0.06  # the deviation of the logarithm of the height
HIDDEN, DROPOUT = 256, 0.3
PASSES, BATCH, RATE, DECAY = 15, 1024, 1e-3, 0.05
MISTAKES = tuple(mistaken(*pair) for pair in permutations(dict.fromkeys(CONTROLLERS.values()), 2))


@dataclass
class MiscalibrationNetwork:
    """layers     normalised features -> normalised offset (head heights), turn (rotation vector) and logarithm of the height's share
    told        what the card says of it: the deviation of each kind over takes of validation clips, and what is left of it
    """

    layers: nn.Sequential
    features: Statistics
    targets: Statistics
    told: dict[str, list[float]] = field(default_factory=dict)

    def __call__(self, features: Tensor) -> Tensor:
        return self.targets.restore(self.layers(self.features.normalise(features)))


@dataclass(frozen=True)
class Examples:
    """Features float16 [N, W, H] of W windows of each of N takes, and what is off in them, float32 [N, 7]."""

    features: np.ndarray
    targets: Array


def draw_miscalibration(random: np.random.Generator) -> tuple[Slip, float]:
    """A slip, and the true height as a share of the believed one."""
    kind, wide, near = random.random(), draw_slip(random, WIDE), draw_slip(random, NEAR)
    height = float(np.exp(random.normal(scale=HEIGHT)))
    if kind < EXACT:
        return Slip(np.zeros(3, np.float32), np.zeros(3, np.float32)), 1.0
    if kind < EXACT + MISTAKEN:
        mistake = MISTAKES[random.integers(len(MISTAKES))]
        return Slip(mistake.offset + near.offset, mistake.turn + near.turn), height
    return wide, height


@torch.no_grad()
def examples(motions: list[Motion], networks: Networks, seed: int) -> Examples:
    """TAKES of each motion, seen by the trunk of trained networks."""
    random = np.random.default_rng(seed)
    found, targets = [], []
    for motion in motions:
        take, head_height = synthesize(motion), motion.skeleton.height_above_toes("Head")
        for _ in range(TAKES):
            slip, height = draw_miscalibration(random)
            believed = head_height / height
            trackers, anchors = tracker_frames(slipped(take, slip), believed)
            frames = np.linspace(0, len(trackers) - 1, WINDOWS).round().astype(int)
            windows = trackers.seen_from(anchors[frames], frames[:, None] + np.array(networks.mode.window))
            seen = network_input(windows, STANDARD_PROPORTIONS)
            found.append(networks.features(torch.from_numpy(seen)).numpy().astype(np.float16))
            targets.append(np.concatenate((slip.offset / believed, slip.turn, [np.log(height)])))
    return Examples(np.stack(found), np.array(targets, np.float32))


def learn_miscalibration(clips: list[Path], split: dict[str, str], networks: Networks, seed: int) -> Job[MiscalibrationNetwork]:
    """Trains on the training clips, their mirror images and the same by other bodies, and measures on the validation clips."""
    made: dict[str, list[Examples]] = {"train": [], "validation": []}
    for i, path in enumerate(clips):
        yield Progress(0.6 * i / len(clips), f"miscalibrating {path.name}")
        name = split_of(path.stem, split)
        if name in made and (motion := read_sound_motion(path)):
            own = zlib.crc32(f"{seed}/{path.stem}".encode())
            bodies = [motion, mirror(motion), vary(motion, own), mirror(vary(motion, own + 1))] if name == "train" else [motion]
            made[name].append(examples(bodies, networks, own))
    train = _joined(made["train"])
    found = yield from part(_fit(train, seed), 0.6, 1)
    found.told = _measured(found, _joined(made["validation"]) if made["validation"] else train)
    return found


def _joined(made: list[Examples]) -> Examples:
    return Examples(np.concatenate([one.features for one in made]), np.concatenate([one.targets for one in made]))


def _fit(train: Examples, seed: int) -> Job[MiscalibrationNetwork]:
    torch.manual_seed(seed)
    inputs = torch.from_numpy(train.features).flatten(0, 1)
    targets = torch.from_numpy(train.targets).repeat_interleave(train.features.shape[1], 0)
    size, outputs = inputs.shape[1], targets.shape[1]
    sample = inputs[:: max(1, len(inputs) // 20_000)].float()
    layers = nn.Sequential(nn.Linear(size, HIDDEN), nn.ELU(), nn.Dropout(DROPOUT), nn.Linear(HIDDEN, outputs))
    found = MiscalibrationNetwork(layers, Statistics(sample.mean(0), sample.std(0) + 1e-3), Statistics(torch.zeros(outputs), targets.std(0) + 1e-6))
    optimiser = torch.optim.AdamW(layers.parameters(), lr=RATE, weight_decay=DECAY)
    steps = max(1, PASSES * len(inputs) // BATCH)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    for step in range(steps):
        chosen = torch.randint(len(inputs), (min(BATCH, len(inputs)),))
        error = (found(inputs[chosen].float()) - targets[chosen]) / found.targets.deviation
        optimiser.zero_grad()
        error.square().mean().backward()
        optimiser.step()
        schedule.step()
        if step % 50 == 0:
            yield Progress(step / steps, "learning what calibrations get wrong")
    layers.eval()
    return found


@torch.no_grad()
def _measured(found: MiscalibrationNetwork, seen: Examples) -> dict[str, list[float]]:
    """Root mean squares over takes, of what was off and of what is left of it: metres at a head height of 1.6 m, degrees, share of the height."""
    told = np.stack([found(torch.from_numpy(features).float()).mean(0).numpy() for features in seen.features])

    def sizes(values: Array) -> list[float]:
        offset, turn, height = np.split(values, (3, 6), axis=1)
        kinds = 1.6 * offset, np.degrees(turn), height
        return [round(float(np.sqrt(np.mean(np.sum(np.square(kind), axis=-1)))), 4) for kind in kinds]

    return {"off": sizes(seen.targets), "left": sizes(told - seen.targets)}
