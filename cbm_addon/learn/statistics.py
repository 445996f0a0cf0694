"""What numbers are normalised by: shared by the networks of body and hands."""

from __future__ import annotations

from torch import Tensor, nn


class Statistics(nn.Module):
    """Mean and deviation of each number of a feature vector; constant numbers get a deviation of 1."""

    mean: Tensor
    deviation: Tensor

    def __init__(self, mean: Tensor, deviation: Tensor) -> None:
        super().__init__()
        self.register_buffer("mean", mean)
        self.register_buffer("deviation", deviation)

    def normalise(self, values: Tensor) -> Tensor:
        return (values - self.mean) / self.deviation

    def restore(self, values: Tensor) -> Tensor:
        return values * self.deviation + self.mean
