"""Trained models: a folder of ONNX files with a JSON card, loaded with onnxruntime. What does not fit is refused."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..features import CONTROL, LOWER_BODY, LOWER_JOINTS, MODES, PROPORTIONS, RATE, TRACKERS, Mode, network_input
from ..model_folder import MODELS_FOLDER, card_of_format, open_session, session_options, verify_files
from ..motion.rotations import Array

CARD_FORMAT = "cbm-model 1"
DEFAULT_MODEL = MODELS_FOLDER / "base"
PARTS = ("estimator", "decoder")
MISCALIBRATION = "miscalibration"  # a part that a mode may have besides


def signature(mode: Mode) -> dict[str, Any]:
    """What a network of this mode expects and gives, as a card says it: names in order, offsets, rate."""
    layouts = {"window": TRACKERS, "control": CONTROL, "lower_body": LOWER_BODY}
    return {
        "rate": RATE,
        "window_offsets": list(mode.window),
        "sequence_offsets": list(mode.sequence),
        **{name: [*layout.points, *layout.directions, *layout.scalars] for name, layout in layouts.items()},
        "proportions": list(PROPORTIONS),
    }


@dataclass(frozen=True)
class Estimate:
    """What the estimator says of tracker windows: stage 1 (`control` [N, S, .]), the `logits` [N, C, D] of the codebook, and the `features`
    [N, H] that the decoder needs."""

    control: Array
    logits: Array
    features: Array


@dataclass(frozen=True)
class ModeNetworks:
    """The sessions of one mode, PARTS and MISCALIBRATION; every call takes and gives float32 batches. `manners` [M, 9, 3] are those of solve/manner.py;
    `proportions` [2, P] are the least and the most that training saw of each."""

    mode: Mode
    channels: int
    classes: int
    sessions: dict[str, Any]
    manners: Array
    proportions: Array

    def estimate(self, windows: Array, proportions: Array) -> Estimate:
        """What tracker windows [N, O, .] say of a body of these proportions [P]. Of a body unlike all that trained the nearest that did is asked for."""
        seen = network_input(windows, np.clip(proportions, *self.proportions))
        control, logits, features = self.sessions["estimator"].run(["control", "logits", "features"], {"window": seen})
        return Estimate(
            control.reshape(len(windows), len(self.mode.sequence), CONTROL.size), logits.reshape(len(windows), self.channels, self.classes), features
        )

    def decode(self, codes: np.ndarray, features: Array) -> Array:
        """Lower-body sequences [N, S, .] from class numbers int [N, C] and the features [N, H] of the windows that they belong to."""
        one_hot = np.eye(self.classes, dtype=np.float32)[codes].reshape(len(codes), -1)
        flat = self.sessions["decoder"].run(None, {"codes": one_hot, "features": features})[0]
        return flat.reshape(len(codes), len(self.mode.sequence), LOWER_BODY.size)

    @property
    def tells_miscalibration(self) -> bool:
        return MISCALIBRATION in self.sessions

    def miscalibration(self, features: Array) -> Array:
        """How windows with these features [N, H] say that a calibration is off, [N, 7]: the offset of the left controller (head heights) and its turn
        (rotation vector), both in the wrist's frame, and the logarithm of the true height's share of the believed one."""
        return self.sessions[MISCALIBRATION].run(None, {"features": features})[0]


@dataclass(frozen=True)
class Model:
    """A loaded model: its card and the networks of every mode that it holds."""

    folder: Path
    card: dict[str, Any]
    modes: dict[str, ModeNetworks]

    @property
    def name(self) -> str:
        return self.card["name"]

    def networks(self, mode: str) -> ModeNetworks:
        if mode not in self.modes:
            raise InputError(self.folder, f"has no networks for the mode '{mode}'; it holds {', '.join(self.modes)}")
        return self.modes[mode]


def read_card(folder: Path) -> dict[str, Any]:
    """The card of a model folder, checked against what this version of the engine solves with."""
    card, path = card_of_format(folder, CARD_FORMAT, ("modes",)), Path(folder) / "card.json"
    for name, entry in card["modes"].items():
        if name not in MODES:
            raise InputError(path, f"has the unknown mode '{name}'; known are {', '.join(MODES)}")
        expected = signature(MODES[name])
        for key, value in expected.items():
            if entry["features"].get(key) != value:
                raise InputError(path, f"was trained on other features ('{key}' of mode '{name}' differs); train the model again with this version")
    return card


def describe(card: dict[str, Any]) -> str:
    """A card in one line."""
    size = sum(entry["bytes"] for entry in card["files"].values()) / 1e6
    clips = card["training"]["clips"]["train"]
    return f"'{card['name']}' {card['version']}: {' and '.join(card['modes'])}, {size:.1f} MB, trained on {clips} clips, {card['licence']}"


def load_model(folder: Path | None = None, threads: int = 0) -> Model:
    """Loads a model folder (the shipped one by default) after checking its card and files; InputError where it does not fit.

    `threads` 0 lets onnxruntime choose.
    """
    folder = Path(folder) if folder else DEFAULT_MODEL
    card = read_card(folder)
    verify_files(folder, card)
    options = session_options(threads)
    modes = {
        name: ModeNetworks(
            MODES[name],
            entry["channels"],
            entry["classes"],
            {part: open_session(folder / f"{name}.{part}.onnx", options) for part in _parts(name, card)},
            np.array(entry.get("manners", []), np.float32).reshape(-1, len(LOWER_JOINTS), 3),
            np.array(entry["proportions_range"], np.float32),
        )
        for name, entry in card["modes"].items()
    }
    return Model(folder, card, modes)


def _parts(mode: str, card: dict[str, Any]) -> tuple[str, ...]:
    return (*PARTS, MISCALIBRATION) if f"{mode}.{MISCALIBRATION}.onnx" in card["files"] else PARTS
