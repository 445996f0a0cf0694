"""Going on from a trained model: what its ONNX files hold, put back into networks, so that they learn further on other clips."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import onnx
import torch
from onnx import numpy_helper
from torch import Tensor, nn

from ..errors import InputError
from ..solve.models import read_card, verify_files
from .networks import Block
from .statistics import Statistics
from .training import Networks


@torch.no_grad()
def start_from(folder: Path, networks: Networks) -> None:
    """Gives `networks` the trunk, the statistics, stage 1, estimator and decoder of the model in `folder`. Its encoder and regression were not
    exported and stay as they are. InputError if the model has other sizes or lacks the mode."""
    card = read_card(folder)
    verify_files(folder, card)
    mode, stage2 = networks.mode.name, networks.lower_body
    if mode not in card["modes"]:
        raise InputError(folder, f"has no networks for the mode '{mode}'; it holds {', '.join(card['modes'])}")
    estimator, decoder = (_stored(Path(folder) / f"{mode}.{part}.onnx") for part in ("estimator", "decoder"))
    try:
        window = Statistics(*_two(estimator))
        for module in (networks.trunk, networks.control):
            _fill(module, estimator)
        control = Statistics(*reversed(_two(estimator)))
        _fill(stage2.estimator, estimator)
        _fill(stage2.decoder, decoder)
        lower_body = Statistics(*reversed(_two(decoder)))
    except (StopIteration, RuntimeError) as error:
        raise InputError(folder, "has networks of other sizes than the configuration; start from a model that was trained with the same sizes") from error
    networks.statistics = {"window": window, "control": control, "lower_body": lower_body}
    seen = np.stack((networks.proportions, card["modes"][mode]["proportions_range"]))
    networks.proportions = np.stack((seen[:, 0].min(axis=0), seen[:, 1].max(axis=0)))


@torch.no_grad()
def keep_some(folder: Path, networks: Networks, share: float) -> None:
    """Draws trained networks back toward the model in `folder`: `share` of each weight is the model's, the rest stays as it is. What was learnt is
    mostly kept and what the model knew is hardly lost (Wortsman et al. 2022, Robust fine-tuning of zero-shot models)."""
    trained = {name: value.clone() for name, value in networks.modules().state_dict().items()}
    start_from(folder, networks)
    for name, value in networks.modules().state_dict().items():
        value.lerp_(trained[name], 1 - share)


def _stored(path: Path) -> Iterator[np.ndarray]:
    """The constants of a graph in the order in which export.py wrote them."""
    return (numpy_helper.to_array(constant) for constant in onnx.load(path).graph.initializer)


def _two(constants: Iterator[np.ndarray]) -> tuple[Tensor, Tensor]:
    first, second = (torch.from_numpy(next(constants).copy()) for _ in range(2))
    return first, second


def _fill(module: nn.Module, constants: Iterator[np.ndarray]) -> None:
    """The inverse of `_Graph.layer` of export.py."""
    match module:
        case nn.Sequential():
            for part in module:
                _fill(part, constants)
        case Block():
            _fill(module.step, constants)
        case nn.Linear():
            weight = next(constants)
            if weight.dtype == np.int8:
                weight = weight.astype(np.float32) * next(constants)
            module.weight.copy_(torch.from_numpy(weight.astype(np.float32).T))
            module.bias.copy_(torch.from_numpy(next(constants).copy()))
        case nn.LayerNorm():
            module.weight.copy_(torch.from_numpy(next(constants).copy()))
            module.bias.copy_(torch.from_numpy(next(constants).copy()))
