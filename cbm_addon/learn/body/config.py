"""What a training run of body avoidance is: the fields of `BodyConfig`, which a TOML file may set."""

from __future__ import annotations

from dataclasses import dataclass

from ..avoidance_config import AvoidanceConfig


@dataclass(frozen=True)
class BodyConfig(AvoidanceConfig):
    """`shapes` is the share of the samples whose geometry is solid shapes; the others see independent noise, as in the paper. `poses` are drawn
    from the clips, `samples` surroundings are made for them. `cell` is the edge of a cell that the networks see, in standing heights of the head joint."""

    name: str = "body"
    poses: int = 8_000
    samples: int = 40_000
    shapes: float = 0.75
    cell: float = 0.06
    hidden: int = 256
    epochs: int = 20
