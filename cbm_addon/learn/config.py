"""What a training run is: a TOML file whose keys are the fields of `TrainConfig`."""

from __future__ import annotations

import tomllib
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Protocol, TypeVar

from ..errors import InputError

LATENTS = ("categorical", "continuous", "gaussian")
MATCHINGS = ("kl", "probabilities", "paper")


@dataclass(frozen=True)
class TrainConfig:
    """Sizes, losses and schedule, and what the card says of the model.

    `matching_weight` is per output number: the loss adds weight / outputs * matching. `blocks` are the residual blocks of the trunk, `code_blocks`
    those of encoder and decoder. Each clip trains as it is and by `variants` - 1 other bodies; `noise`, `height_error` and `rough` (a share of the
    samples) are what learn/augment.py does to the trackers. `latent`, `sampled`, `end_to_end` and `decoder_sees_window` make the rivals and
    ablations that the results compare: "continuous" and "gaussian" (a conditional VAE) take the place of codes; one channel of one class is a plain
    regressor. `miscalibration`: whether it is learnt too, looking ahead, what calibrations get wrong (learn/miscalibration.py). `keep` is the share
    of the weights of the model that training goes on from, if it does, which the trained ones are mixed with.
    """

    name: str = "custom"
    licence: str = "the licence of the training data"
    credits: tuple[str, ...] = ()
    modes: tuple[str, ...] = ("lookahead", "causal")
    channels: int = 64
    classes: int = 8
    hidden: int = 512
    blocks: int = 10
    code_blocks: int = 2
    dropout: float = 0.15
    matching: str = "kl"
    matching_weight: float = 1.0
    epochs: int = 4
    batch: int = 512
    learning_rate: float = 1e-3
    weight_decay: float = 0.03
    latent: str = "categorical"
    sampled: bool = True
    end_to_end: bool = True
    decoder_sees_window: bool = True
    noise: float = 0.01
    height_error: float = 0.04
    rough: float = 0.35
    variants: int = 6
    miscalibration: bool = True
    keep: float = 0.5
    seed: int = 1

    def as_dict(self) -> dict:
        return asdict(self)


class Trainable(Protocol):
    """A dataclass of settings that a training run is repeated from."""

    @property
    def matching(self) -> str: ...

    def as_dict(self) -> dict[str, Any]: ...


Config = TypeVar("Config", bound="Trainable")


def read_settings(path: Path | None, defaults: Config) -> Config:
    """`defaults` with the settings of a TOML file in their place; InputError for what it does not know or what has another type."""
    if path is None:
        return defaults
    try:
        values = tomllib.loads(Path(path).read_text())
    except (OSError, tomllib.TOMLDecodeError) as error:
        raise InputError(path, f"is not a training configuration ({error}); a TOML file is expected") from error
    known = defaults.as_dict()
    if unknown := sorted(set(values) - set(known)):
        raise InputError(path, f"has unknown settings {', '.join(unknown)}; known are {', '.join(sorted(known))}")
    for key, value in values.items():
        expected = type(known[key])
        values[key] = tuple(value) if isinstance(value, list) else float(value) if expected is float and isinstance(value, int) else value
        if not isinstance(values[key], expected):
            raise InputError(path, f"'{key}' is {value!r}; {expected.__name__} is expected, such as {known[key]!r}")
    config = replace(defaults, **values)  # type: ignore[type-var]
    if config.matching not in MATCHINGS:
        raise InputError(path, f"'matching' is {config.matching!r}; {', '.join(MATCHINGS)} are known")
    return config


def read_config(path: Path | None) -> TrainConfig:
    """The configuration in a TOML file; the defaults without one."""
    config = read_settings(path, TrainConfig())
    if config.latent not in LATENTS:
        raise InputError(path or "configuration", f"'latent' is {config.latent!r}; {', '.join(LATENTS)} are known")
    return config
