"""From trained networks to a model folder: ONNX files with fp16 weights and a JSON card.

The graphs are written layer by layer, so that they hold nothing but what is meant: normalise, three linear layers with ELU, restore.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import onnx
import torch
from onnx import TensorProto, helper, numpy_helper
from torch import nn

from ..features import MODES
from ..solve.models import CARD_FORMAT, signature
from .training import Networks, Statistics

OPSET = 17


def _graph(name: str, inputs: list[tuple[str, int, Statistics | None]], layers: nn.Sequential, output: tuple[str, int, Statistics | None]) -> onnx.ModelProto:
    """A graph that concatenates its (normalised) inputs, runs the linear layers with ELU between, and restores the output's units."""
    nodes, weights = [], []

    def constant(label: str, values: np.ndarray, half: bool) -> str:
        """A weight; halves are stored in fp16 and widened when the session is made."""
        if not half:
            weights.append(numpy_helper.from_array(values.astype(np.float32), label))
            return label
        weights.append(numpy_helper.from_array(values.astype(np.float16), f"{label}.half"))
        nodes.append(helper.make_node("Cast", [f"{label}.half"], [label], to=TensorProto.FLOAT))
        return label

    current = []
    for label, _, stats in inputs:
        if stats is None:
            current.append(label)
            continue
        mean, deviation = constant(f"{label}.mean", stats.mean.numpy(), False), constant(f"{label}.deviation", stats.deviation.numpy(), False)
        nodes.append(helper.make_node("Sub", [label, mean], [f"{label}.centred"]))
        nodes.append(helper.make_node("Div", [f"{label}.centred", deviation], [f"{label}.normal"]))
        current.append(f"{label}.normal")
    value = current[0]
    if len(current) > 1:
        nodes.append(helper.make_node("Concat", current, ["joined"], axis=-1))
        value = "joined"
    linear = [layer for layer in layers if isinstance(layer, nn.Linear)]
    for i, layer in enumerate(linear):
        weight = constant(f"layer{i}.weight", layer.weight.detach().numpy().T, True)
        bias = constant(f"layer{i}.bias", layer.bias.detach().numpy(), False)
        nodes.append(helper.make_node("MatMul", [value, weight], [f"layer{i}.product"]))
        nodes.append(helper.make_node("Add", [f"layer{i}.product", bias], [f"layer{i}"]))
        value = f"layer{i}"
        if i < len(linear) - 1:
            nodes.append(helper.make_node("Elu", [value], [f"layer{i}.elu"]))
            value = f"layer{i}.elu"
    label, size, stats = output
    if stats is None:
        nodes.append(helper.make_node("Identity", [value], [label]))
    else:
        mean, deviation = constant("output.mean", stats.mean.numpy(), False), constant("output.deviation", stats.deviation.numpy(), False)
        nodes.append(helper.make_node("Mul", [value, deviation], ["output.scaled"]))
        nodes.append(helper.make_node("Add", ["output.scaled", mean], [label]))
    graph = helper.make_graph(
        nodes,
        name,
        [helper.make_tensor_value_info(label, TensorProto.FLOAT, ["N", size]) for label, size, _ in inputs],
        [helper.make_tensor_value_info(output[0], TensorProto.FLOAT, ["N", size])],
        weights,
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], producer_name="cbm")
    model.ir_version = 8
    onnx.checker.check_model(model)
    return model


def graphs(networks: Networks) -> dict[str, onnx.ModelProto]:
    """The three graphs of one mode by file name."""
    mode, stats, stage2 = networks.mode.name, networks.statistics, networks.lower_body
    window = ("window", len(stats["window"].mean), stats["window"])
    codes = stage2.channels * stage2.classes
    control = ("control", len(stats["control"].mean), stats["control"])
    lower = ("lower_body", len(stats["lower_body"].mean), stats["lower_body"])
    return {
        f"{mode}.control.onnx": _graph("control", [window], networks.control, control),
        f"{mode}.estimator.onnx": _graph("estimator", [window], stage2.estimator, ("logits", codes, None)),
        f"{mode}.decoder.onnx": _graph("decoder", [("codes", codes, None), window], stage2.decoder, lower),
    }


def export(trained: list[Networks], folder: Path, facts: dict) -> Path:
    """Writes the ONNX files and `card.json`; `facts` are the card's words on name, data, licence and configuration. Returns the card's path."""
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
                "validation": {key: round(value, 4) for key, value in n.score.items()},
            }
            for n in trained
        },
        "files": files,
    }
    path = folder / "card.json"
    path.write_text(json.dumps(card, indent=2) + "\n")
    return path
