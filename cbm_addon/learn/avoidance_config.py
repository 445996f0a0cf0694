"""What training runs of collision avoidance have in common."""

from __future__ import annotations

from dataclasses import asdict, dataclass


@dataclass(frozen=True)
class AvoidanceConfig:
    """The sizes of the networks and the schedule of their training."""

    name: str = "avoidance"
    licence: str = "the licence of the training data"
    credits: tuple[str, ...] = ()
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
