"""The trained networks of collision avoidance: a code for what is sensed, and a pose for the code."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..model_folder import card_of_format, open_session, session_options, verify_files
from ..motion.rotations import Array

ESTIMATOR, DECODER = "estimator.onnx", "decoder.onnx"


@dataclass(frozen=True)
class Codebook:
    """Estimator and decoder of codebook matching over `channels` of `classes`."""

    channels: int
    classes: int
    estimator: Any
    decoder: Any

    def answers(self, sensed: Array, candidates: int, seed: int) -> Array:
        """[K, F, A] for what is sensed [F, S]: that of the likeliest code first, then of drawn ones.

        The noise of a candidate is the same in all frames, so that its codes do not flicker.
        """
        logits, features = self.estimator.run(["logits", "features"], {"sensed": sensed})
        logits = logits.reshape(len(sensed), self.channels, self.classes)
        noise = np.random.default_rng(seed).gumbel(size=(candidates, 1, self.channels, self.classes)).astype(np.float32)
        noise[0] = 0
        codes = np.eye(self.classes, dtype=np.float32)[(logits + noise).argmax(-1)].reshape(candidates * len(sensed), -1)
        return self.decoder.run(None, {"codes": codes, "features": np.tile(features, (candidates, 1))})[0].reshape(candidates, len(sensed), -1)


def checked_card(folder: Path, kind: str, features: dict[str, Any]) -> dict[str, Any]:
    """The card of a model folder of the format `kind`; InputError if it was trained on other `features` than this version of the engine has."""
    card = card_of_format(folder, kind, ("features", "channels", "classes"))
    for key, expected in features.items():
        if card["features"].get(key) != expected:
            raise InputError(Path(folder) / "card.json", f"was trained on other features ('{key}' differs); train the model again with this version")
    return card


def described(card: dict[str, Any], what: str) -> str:
    """A card in one line; `what` it is a model of."""
    size = sum(entry["bytes"] for entry in card["files"].values()) / 1e6
    return f"'{card['name']}' {card['version']}: {what}, {size:.1f} MB, trained on {card['training']['poses']} poses, {card['licence']}"


def load_codebook(folder: Path, card: dict[str, Any], threads: int = 0) -> Codebook:
    """The networks of a model folder, once its files are what its card says; InputError where they are not."""
    verify_files(folder, card)
    options = session_options(threads)
    prefix = card["format"].split()[0].removeprefix("cbm-")
    estimator, decoder = (open_session(folder / f"{prefix}.{name}", options) for name in (ESTIMATOR, DECODER))
    return Codebook(card["channels"], card["classes"], estimator, decoder)
