"""The trained networks of body avoidance: a model folder whose card also holds the grid that they see."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..hands.codebook import Codebook, checked_card, described, load_codebook
from ..hands.sensor import Grid
from ..model_folder import MODELS_FOLDER
from ..motion.motion import Motion, local_rotations
from ..motion.rotations import Array, matrix_from_quat, matrix_from_sixd, quat_from_matrix
from ..motion.skeleton import BODY_JOINTS, STANDARD_BODY
from ..motion.transfer import transfer
from .contact import Nearest
from .freedom import KEPT, Freedom
from .sensor import PLACES, roots, sense

CARD_FORMAT = "cbm-body 1"
DEFAULT_BODY = MODELS_FOLDER / "body"
TURNING = tuple(name for name in BODY_JOINTS if name not in KEPT)  # joints whose world rotations the networks give, seen from the root
FEATURES = {"places": list(PLACES), "rotations": list(TURNING)}
ANSWERS = 3 + 6 * len(TURNING)  # the hips' shift in standing heights of the head joint, and 6D rotations


@dataclass(frozen=True)
class BodyModel:
    """Codebook matching for whole poses: from what is sensed (body/sensor.py) to poses that are free of it."""

    folder: Path
    card: dict[str, Any]
    grid: Grid
    codebook: Codebook

    @property
    def name(self) -> str:
        return self.card["name"]

    def propose(self, freedom: Freedom, unit: float, nearest: Nearest, frames: np.ndarray, candidates: int, seed: int) -> list[Array]:
        """Changes [R, n] of each of so many candidates at `frames` [R]: that of the likeliest code first, then of drawn ones."""
        answers = self.codebook.answers(sense(self.grid, freedom, unit, nearest, frames), candidates, seed)
        return [changes_of(freedom, unit, frames, answer.astype(np.float64)) for answer in answers]


def changes_of(freedom: Freedom, unit: float, frames: np.ndarray, answers: Array) -> Array:
    """The changes [R, n] that bring a body to what the networks answered [R, ANSWERS] at `frames` [R], whatever spine it has."""
    positions, rotations = roots(freedom, frames)
    hips = positions + unit * (rotations @ answers[:, :3, None])[..., 0]
    turned = rotations[:, None] @ matrix_from_sixd(answers[:, 3:].reshape(len(answers), -1, 6))
    world = np.tile(np.array([1.0, 0, 0, 0]), (len(frames), len(BODY_JOINTS), 1))
    world[:, [BODY_JOINTS.index(name) for name in TURNING]] = quat_from_matrix(turned)
    for name in KEPT:
        if name in freedom.body:
            world[:, BODY_JOINTS.index(name)] = quat_from_matrix(freedom.world[frames, freedom.body.index(name)])
    standard = Motion(STANDARD_BODY, np.arange(len(frames), dtype=float), hips.astype(np.float32), local_rotations(STANDARD_BODY, world))
    return freedom.changes_to(frames, matrix_from_quat(transfer(standard, freedom.body).forward()[0]), hips)


def signature(grid: Grid) -> dict[str, Any]:
    """What the networks take and give, as the card says it."""
    return {"grid": grid.as_dict(), **FEATURES}


def read_card(folder: Path) -> dict[str, Any]:
    """The card of a model of bodies, checked against this version of the engine."""
    return checked_card(folder, CARD_FORMAT, FEATURES)


def describe(card: dict[str, Any]) -> str:
    """A card in one line."""
    return described(card, "body")


def load_body_model(folder: Path | None = None, threads: int = 0) -> BodyModel:
    """Loads a model of bodies (the shipped one by default) after checking its card and files; InputError where it does not fit."""
    folder = Path(folder) if folder else DEFAULT_BODY
    card = read_card(folder)
    return BodyModel(folder, card, Grid.from_dict(card["features"]["grid"]), load_codebook(folder, card, threads))
