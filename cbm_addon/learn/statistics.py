"""Mean and deviation of what goes into networks and comes out of them."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor


@dataclass(frozen=True)
class Statistics:
    """Mean and deviation of each number of a feature vector; constant numbers get a deviation of 1."""

    mean: Tensor
    deviation: Tensor

    def normalise(self, values: Tensor) -> Tensor:
        return (values - self.mean) / self.deviation

    def restore(self, values: Tensor) -> Tensor:
        return values * self.deviation + self.mean
