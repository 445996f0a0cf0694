"""What a training run of the hands is: the fields of `HandConfig`, which a TOML file may set."""

from __future__ import annotations

from dataclasses import asdict, dataclass


@dataclass(frozen=True)
class HandConfig:
    """`shapes` is the share of the samples whose geometry is solid shapes; the others see independent noise, as in the paper. `poses` are how
    many poses the free ones are interpolated to, `hands` the number of differently proportioned hands that wear them, `samples` how many
    surroundings are made for them."""

    name: str = "hands"
    licence: str = "the licence of the training data"
    credits: tuple[str, ...] = ()
    poses: int = 4_000
    hands: int = 4
    samples: int = 20_000
    shapes: float = 0.75
    channels: int = 32
    classes: int = 8
    hidden: int = 192
    blocks: int = 3
    code_blocks: int = 1
    dropout: float = 0.05
    matching: str = "kl"
    matching_weight: float = 0.05
    epochs: int = 16
    batch: int = 256
    learning_rate: float = 1e-3
    weight_decay: float = 1e-4
    seed: int = 1

    def as_dict(self) -> dict:
        return asdict(self)
