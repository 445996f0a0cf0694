"""What is measured of answers y [N, POINTS] to steepnesses x [N, 1]; every error is an RMSE relative to the branch's own size."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from .function import TIMES, branch

COHERENT = 0.15  # the largest relative error of an answer that counts as a branch


def branch_errors(x: Tensor, y: Tensor) -> Tensor:
    """Error [N] to the nearer of the two branches."""
    positive = branch(x)
    nearer = torch.minimum(_size(y - positive), _size(y + positive))
    return nearer / _size(positive)


def coherent_share(x: Tensor, y: Tensor) -> float:
    """Share of answers that are one of the two branches."""
    return float((branch_errors(x, y) <= COHERENT).float().mean())


def positive_share(x: Tensor, y: Tensor) -> float:
    """Share of the positive branch among the coherent answers; NaN if there are none."""
    coherent = y[branch_errors(x, y) <= COHERENT]
    return float((steepness(coherent) > 0).float().mean()) if len(coherent) else math.nan


def reconstruction_error(y: Tensor, rebuilt: Tensor) -> float:
    """Error of rebuilt sequences, over all of them at once."""
    return float(_size((rebuilt - y).flatten()) / _size(y.flatten()))


def parabola_share(y: Tensor) -> float:
    """Share of answers that are a branch of any steepness, whatever was asked for: what is left of a method's coherence outside its data."""
    fitted = branch(steepness(y)[:, None])
    return float((_size(y - fitted) <= COHERENT * _size(fitted)).float().mean())


def steepness(y: Tensor) -> Tensor:
    """Steepness [N] with its sign of the branches that fit answers best (least squares)."""
    squares = TIMES.square()
    return y @ squares / squares.square().sum()


def _size(y: Tensor) -> Tensor:
    return y.square().mean(-1).sqrt()
