"""From trained networks to a model folder: ONNX files with fp16 weights and a JSON card."""

from __future__ import annotations

from pathlib import Path

import onnx
import torch

from ..features import MODES
from ..model_folder import write_model
from ..solve.models import CARD_FORMAT, MISCALIBRATION, signature
from .curves import curves
from .onnx_graph import Graph
from .training import Networks


def graphs(networks: Networks) -> dict[str, onnx.ModelProto]:
    """The graphs of one mode by file name: the estimator (window -> control, logits, features), the decoder (codes, features -> lower body) and, where
    it was trained, what tells a miscalibration (features -> offset, turn, height)."""
    stats, stage2 = networks.statistics, networks.lower_body
    sizes = {name: len(found.mean) for name, found in stats.items()}
    codes, hidden = stage2.channels * stage2.classes, networks.control[0].in_features
    estimator = Graph()
    features = estimator.layer(networks.trunk, estimator.normalised("window", stats["window"]))
    estimator.restored(estimator.layer(networks.control, features), stats["control"], "control")
    estimator.node("Identity", estimator.layer(stage2.estimator, features), output="logits")
    estimator.node("Identity", features, output="features")
    decoder = Graph()
    decoder.restored(decoder.layer(stage2.decoder_of_codes(), decoder.node("Concat", "codes", "features", axis=-1)), stats["lower_body"], "lower_body")
    outputs = {"control": sizes["control"], "logits": codes, "features": hidden}
    found = {
        f"{networks.mode.name}.estimator.onnx": estimator.model("estimator", {"window": sizes["window"]}, outputs),
        f"{networks.mode.name}.decoder.onnx": decoder.model("decoder", {"codes": codes, "features": hidden}, {"lower_body": sizes["lower_body"]}),
    }
    if told := networks.miscalibration:
        graph = Graph()
        graph.restored(graph.layer(told.layers, graph.normalised("features", told.features)), told.targets, "miscalibration")
        found[f"{networks.mode.name}.{MISCALIBRATION}.onnx"] = graph.model(MISCALIBRATION, {"features": hidden}, {"miscalibration": len(told.targets.mean)})
    return found


def export(trained: list[Networks], folder: Path, facts: dict) -> Path:
    """Writes the ONNX files, `training.svg` and `card.json`; `facts` are the card's words on name, data, licence and configuration. Returns the card's path."""
    files = {}
    for networks in trained:
        with torch.no_grad():
            files |= {name: model.SerializeToString() for name, model in graphs(networks).items()}
    card = {
        "format": CARD_FORMAT,
        **facts,
        "modes": {
            n.mode.name: {
                "features": signature(MODES[n.mode.name]),
                "channels": n.lower_body.channels,
                "classes": n.lower_body.classes,
                "history": n.history,
                "proportions_range": n.proportions.astype(float).round(5).tolist(),
                "manners": n.manners.astype(float).round(5).tolist(),
            }
            | ({"miscalibration": n.miscalibration.told} if n.miscalibration else {})
            for n in trained
        },
    }
    path = write_model(folder, files, card)
    (path.parent / "training.svg").write_text(curves({n.mode.name: n.history for n in trained}))
    return path
