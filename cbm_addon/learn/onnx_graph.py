"""ONNX graphs written layer by layer, so that they hold nothing but what is meant: normalise, the network, restore."""

from __future__ import annotations

from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper
from torch import Tensor, nn

from .networks import Block
from .statistics import Statistics

OPSET = 17


class Graph:
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
