"""From trained networks to a model folder: ONNX files with fp16 weights and a JSON card.

The graphs are written layer by layer, so that they hold nothing but what is meant: normalise, the network, restore.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import torch
from onnx import TensorProto, helper, numpy_helper
from torch import Tensor, nn

from ..features import MODES
from ..solve.models import CARD_FORMAT, signature
from .curves import curves
from .networks import Block
from .training import Networks, Statistics

OPSET = 17


class _Graph:
    """A graph under construction: nodes, weights, and names that nothing else has."""

    def __init__(self) -> None:
        self.nodes: list[onnx.NodeProto] = []
        self.weights: list[onnx.TensorProto] = []
        self.count = 0

    def constant(self, values: Tensor, kind: type = np.float32) -> str:
        """Stored numbers."""
        self.count += 1
        name = f"weight{self.count}"
        self.weights.append(numpy_helper.from_array(values.detach().numpy().astype(kind), name))
        return name

    def weight(self, values: Tensor, bits: int) -> str:
        """A matrix [in, out], stored in fp16 or, each column by its own scale, in 8 bits; it is widened once, when the session is made."""
        if bits == 16:
            return self.node("Cast", self.constant(values, np.float16), to=TensorProto.FLOAT)
        scale = values.abs().amax(0).clamp(min=1e-12) / 127
        return self.node("Mul", self.node("Cast", self.constant((values / scale).round(), np.int8), to=TensorProto.FLOAT), self.constant(scale))

    def node(self, kind: str, *inputs: str, output: str = "", **attributes: Any) -> str:
        """Adds a node and returns the name of what it gives."""
        self.count += 1
        output = output or f"{kind.lower()}{self.count}"
        self.nodes.append(helper.make_node(kind, list(inputs), [output], **attributes))
        return output

    def layer(self, module: nn.Module, value: str, bits: int = 16) -> str:
        """A module of learn/networks.py applied to a value. Residual steps are small additions and bear 8 bits."""
        match module:
            case nn.Sequential():
                for part in module:
                    value = self.layer(part, value, bits)
                return value
            case Block():
                return self.node("Add", value, self.layer(module.step, value, 8))
            case nn.Linear():
                return self.node("Add", self.node("MatMul", value, self.weight(module.weight.T, bits)), self.constant(module.bias))
            case nn.LayerNorm():
                return self.node("LayerNormalization", value, self.constant(module.weight), self.constant(module.bias), axis=-1, epsilon=module.eps)
            case nn.ELU():
                return self.node("Elu", value)
            case nn.Dropout():
                return value
        raise TypeError(f"{type(module).__name__} has no ONNX form here")

    def normalised(self, value: str, stats: Statistics) -> str:
        return self.node("Div", self.node("Sub", value, self.constant(stats.mean)), self.constant(stats.deviation))

    def restored(self, value: str, stats: Statistics, output: str) -> None:
        self.node("Add", self.node("Mul", value, self.constant(stats.deviation)), self.constant(stats.mean), output=output)

    def model(self, name: str, inputs: dict[str, int], outputs: dict[str, int]) -> onnx.ModelProto:
        """The finished graph; inputs and outputs are [N, size]."""
        ends = [[helper.make_tensor_value_info(label, TensorProto.FLOAT, ["N", size]) for label, size in sizes.items()] for sizes in (inputs, outputs)]
        graph = helper.make_graph(self.nodes, name, *ends, self.weights)
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], producer_name="cbm")
        model.ir_version = 8
        onnx.checker.check_model(model)
        return model


def graphs(networks: Networks) -> dict[str, onnx.ModelProto]:
    """The two graphs of one mode by file name: the estimator (window -> control, logits, features) and the decoder (codes, features ->
    lower body)."""
    stats, stage2 = networks.statistics, networks.lower_body
    sizes = {name: len(found.mean) for name, found in stats.items()}
    codes, hidden = stage2.channels * stage2.classes, networks.control[0].in_features
    estimator = _Graph()
    features = estimator.layer(networks.trunk, estimator.normalised("window", stats["window"]))
    estimator.restored(estimator.layer(networks.control, features), stats["control"], "control")
    estimator.node("Identity", estimator.layer(stage2.estimator, features), output="logits")
    estimator.node("Identity", features, output="features")
    decoder = _Graph()
    decoder.restored(decoder.layer(stage2.decoder_of_codes(), decoder.node("Concat", "codes", "features", axis=-1)), stats["lower_body"], "lower_body")
    outputs = {"control": sizes["control"], "logits": codes, "features": hidden}
    return {
        f"{networks.mode.name}.estimator.onnx": estimator.model("estimator", {"window": sizes["window"]}, outputs),
        f"{networks.mode.name}.decoder.onnx": decoder.model("decoder", {"codes": codes, "features": hidden}, {"lower_body": sizes["lower_body"]}),
    }


def export(trained: list[Networks], folder: Path, facts: dict) -> Path:
    """Writes the ONNX files, `training.svg` and `card.json`; `facts` are the card's words on name, data, licence and configuration. Returns the card's path."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    files = {}
    for networks in trained:
        with torch.no_grad():
            for name, model in graphs(networks).items():
                data = model.SerializeToString()
                (folder / name).write_bytes(data)
                files[name] = {"sha256": hashlib.sha256(data).hexdigest(), "bytes": len(data)}
    card = {
        "format": CARD_FORMAT,
        **facts,
        "modes": {
            n.mode.name: {
                "features": signature(MODES[n.mode.name]),
                "channels": n.lower_body.channels,
                "classes": n.lower_body.classes,
                "history": n.history,
                "manners": n.manners.astype(float).round(5).tolist(),
            }
            for n in trained
        },
        "files": files,
    }
    (folder / "training.svg").write_text(curves({n.mode.name: n.history for n in trained}))
    path = folder / "card.json"
    path.write_text(json.dumps(card, indent=2) + "\n")
    return path
