"""What a training run is: a TOML file whose keys are the fields of `TrainConfig`."""

from __future__ import annotations

import tomllib
from dataclasses import asdict, dataclass, fields
from pathlib import Path

from ..errors import InputError


@dataclass(frozen=True)
class TrainConfig:
    """Sizes, losses and schedule, and what the card says of the model.

    `matching_weight` is per output number: the loss adds weight / outputs * matching. `noise` is that of `disturb`.
    """

    name: str = "custom"
    licence: str = "the licence of the training data"
    credits: tuple[str, ...] = ()
    modes: tuple[str, ...] = ("lookahead", "causal")
    channels: int = 64
    classes: int = 8
    hidden: int = 512
    dropout: float = 0.1
    matching: str = "kl"
    matching_weight: float = 1.0
    epochs: int = 10
    batch: int = 512
    learning_rate: float = 1e-3
    weight_decay: float = 1e-4
    noise: float = 0.01
    seed: int = 1

    def as_dict(self) -> dict:
        return asdict(self)


def read_config(path: Path | None) -> TrainConfig:
    """The configuration in a TOML file; the defaults without one."""
    if path is None:
        return TrainConfig()
    try:
        values = tomllib.loads(Path(path).read_text())
    except (OSError, tomllib.TOMLDecodeError) as error:
        raise InputError(path, f"is not a training configuration ({error}); a TOML file is expected") from error
    known = {field.name for field in fields(TrainConfig)}
    if unknown := sorted(set(values) - known):
        raise InputError(path, f"has unknown settings {', '.join(unknown)}; known are {', '.join(sorted(known))}")
    return TrainConfig(**{key: tuple(value) if isinstance(value, list) else value for key, value in values.items()})
