"""Model folders: what the card says is what is loaded, and what does not fit is refused in one line."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from cbm_addon.errors import InputError
from cbm_addon.features import MODES, TRACKERS
from cbm_addon.solve.models import DEFAULT_MODEL, load_model


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
        estimate = networks.estimate(windows)
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
