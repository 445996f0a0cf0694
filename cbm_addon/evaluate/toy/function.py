"""Y = B X t² (eq. 11): X, the steepness, is given; the sign B is not. Only a whole branch is a valid answer."""

from __future__ import annotations

import torch
from torch import Tensor

POINTS = 100
TIMES = torch.linspace(-2, 2, POINTS)
GAP = (0.45, 0.55)  # no pair that trains has its X in here
STORED = 10_000


def branch(x: Tensor) -> Tensor:
    """The positive branch [N, POINTS] for steepnesses x [N, 1]; the other one is its negative."""
    return x * TIMES.square()


def training_pairs(seed: int) -> tuple[Tensor, Tensor]:
    """STORED steepnesses, uniform over 0 to 1 without GAP, each with both signs: x [2 STORED, 1] in rising order and y [2 STORED, POINTS].

    Both have about unit size, so that no method needs to normalise them.
    """
    low, high = GAP
    drawn = torch.rand(STORED, 1, generator=torch.Generator().manual_seed(seed)) * (low + 1 - high)
    x = torch.where(drawn < low, drawn, drawn + high - low).sort(dim=0).values.repeat_interleave(2, dim=0)
    signs = torch.tensor([1.0, -1.0]).repeat(STORED)[:, None]
    return x, signs * branch(x)


def spread_evenly(low: float, high: float, count: int) -> Tensor:
    """Steepnesses [count, 1] in the middles of `count` equal parts of low to high."""
    return (low + (high - low) * (torch.arange(count) + 0.5) / count)[:, None]
