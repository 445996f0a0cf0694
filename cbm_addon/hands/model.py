"""The trained networks of the hands: a model folder whose card also holds the grid that they see."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..model_folder import MODELS_FOLDER
from ..motion.rotations import Array
from .codebook import Codebook, checked_card, described, load_codebook
from .hand import ANGLES, JOINTS, TIPS
from .sensor import Grid

CARD_FORMAT = "cbm-hands 1"
DEFAULT_HANDS = MODELS_FOLDER / "hands"
FEATURES = {"places": [*JOINTS, *TIPS], "angles": list(ANGLES)}


@dataclass(frozen=True)
class HandModel:
    """Codebook matching for one hand: from what is sensed (voxels, then wanted places; hands/sensor.py) to angles that are free of it."""

    folder: Path
    card: dict[str, Any]
    grid: Grid
    codebook: Codebook

    @property
    def name(self) -> str:
        return self.card["name"]

    def propose(self, occupancy: Array, places: Array, candidates: int, seed: int) -> Array:
        """Angles [K, F, 20] for occupancy [F, C] and wanted places [F, 60]: the likeliest code first, then drawn ones."""
        return self.codebook.answers(np.concatenate((occupancy, places), -1).astype(np.float32), candidates, seed)


def signature(grid: Grid) -> dict[str, Any]:
    """What the networks take and give, as the card says it."""
    return {"grid": grid.as_dict(), **FEATURES}


def read_card(folder: Path) -> dict[str, Any]:
    """The card of a model of hands, checked against this version of the engine."""
    return checked_card(folder, CARD_FORMAT, FEATURES)


def describe(card: dict[str, Any]) -> str:
    """A card in one line."""
    return described(card, "hands")


def load_hand_model(folder: Path | None = None, threads: int = 0) -> HandModel:
    """Loads a model of hands (the shipped one by default) after checking its card and files; InputError where it does not fit."""
    folder = Path(folder) if folder else DEFAULT_HANDS
    card = read_card(folder)
    return HandModel(folder, card, Grid.from_dict(card["features"]["grid"]), load_codebook(folder, card, threads))
