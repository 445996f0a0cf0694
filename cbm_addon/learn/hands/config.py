"""What a training run of the hands is: the fields of `HandConfig`, which a TOML file may set."""

from __future__ import annotations

from dataclasses import dataclass

from ..avoidance_config import AvoidanceConfig


@dataclass(frozen=True)
class HandConfig(AvoidanceConfig):
    """`shapes` is the share of the samples whose geometry is solid shapes; the others see independent noise, as in the paper. `poses` are how
    many poses the free ones are interpolated to, `hands` the number of differently proportioned hands that wear them, `samples` how many
    surroundings are made for them. `cell` is the edge of a cell that the networks see, in metres at a hand of 190 mm."""

    name: str = "hands"
    poses: int = 4_000
    hands: int = 4
    samples: int = 20_000
    shapes: float = 0.75
    cell: float = 0.01
