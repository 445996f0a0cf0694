"""Model folders: what the card says is what is loaded, and what does not fit is refused in one line."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from cbm_addon.errors import InputError
from cbm_addon.features import LOWER_JOINTS, MODES, STANDARD_PROPORTIONS, TRACKERS, proportions_of
from cbm_addon.learn.augment import move_hips
from cbm_addon.motion.motion import Motion
from cbm_addon.progress import run
from cbm_addon.solve.models import DEFAULT_MODEL, load_model
from cbm_addon.solve.perform import SolveOptions, perform
from cbm_addon.takes.synthesize import synthesize


@pytest.fixture
def folder(small_model_folder: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(small_model_folder, tmp_path / "copy"))


def edit(folder: Path, change) -> None:
    card = json.loads((folder / "card.json").read_text())
    change(card)
    (folder / "card.json").write_text(json.dumps(card))


def test_a_model_gives_sequences_for_windows(small_model_folder: Path) -> None:
    model = load_model(small_model_folder)
    for name, mode in MODES.items():
        networks = model.networks(name)
        windows = np.zeros((3, len(mode.window), TRACKERS.size), np.float32)
        estimate = networks.estimate(windows, STANDARD_PROPORTIONS)
        assert estimate.control.shape[:2] == (3, len(mode.sequence))
        assert estimate.logits.shape == (3, networks.channels, networks.classes)
        assert networks.decode(estimate.logits.argmax(-1), estimate.features).shape[:2] == (3, len(mode.sequence))


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda card: card.update(format="other 9"), "format"),
        (lambda card: card.pop("licence"), "licence"),
        (lambda card: card["modes"]["causal"]["features"].update(rate=60.0), "rate"),
        (lambda card: card["modes"]["causal"]["features"]["window"].reverse(), "features"),
        (lambda card: card["modes"].update(sideways=card["modes"]["causal"]), "sideways"),
        (lambda card: card["files"]["causal.estimator.onnx"].update(sha256="0"), "checksum"),
    ],
)
def test_a_card_that_does_not_fit_is_refused(folder: Path, change, said: str) -> None:
    edit(folder, change)
    with pytest.raises(InputError, match=said):
        load_model(folder)


def test_a_missing_file_or_card_is_named(folder: Path) -> None:
    (folder / "lookahead.decoder.onnx").unlink()
    with pytest.raises(InputError, match=r"lookahead\.decoder\.onnx"):
        load_model(folder)
    (folder / "card.json").unlink()
    with pytest.raises(InputError, match=r"card\.json"):
        load_model(folder)


def test_the_shipped_model_loads_and_is_small() -> None:
    model = load_model()
    assert set(model.modes) == set(MODES)
    assert sum(entry["bytes"] for entry in model.card["files"].values()) < 25e6
    assert not any(path.suffix in {".pkl", ".pt", ".npz"} for path in DEFAULT_MODEL.rglob("*"))


@pytest.mark.parametrize("mode", MODES)
def test_a_body_unlike_all_that_trained_is_answered_as_the_nearest_that_did(mode: str) -> None:
    networks = load_model().networks(mode)
    windows = np.zeros((1, len(networks.mode.window), TRACKERS.size), np.float32)
    least, most = networks.proportions
    for far, nearest in ((least - 1, least), (most + 1, most)):
        np.testing.assert_array_equal(networks.estimate(windows, far).logits, networks.estimate(windows, nearest).logits)


def test_hips_are_predicted_higher_on_a_body_that_has_them_higher(body_motion: Motion) -> None:
    """Two skeletons of the same person may have their hips at other places of the same pelvis. The networks follow by more than half; the rest the
    measurement update does."""
    take, model = synthesize(body_motion), load_model()
    heights = []
    for rise in (0.0, 0.1):
        body = move_hips(body_motion, rise).skeleton
        performance = run(perform(take, body.height_above_toes(), proportions_of(body), model, SolveOptions(candidates=4)))
        heights.append(float(performance.lower_positions[:, LOWER_JOINTS.index("Hips"), 2].mean()) * body.height_above_toes())
    assert 0.05 < heights[1] - heights[0] < 0.11
