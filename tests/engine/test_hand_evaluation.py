"""The evaluation of the hands: its scenes are what they say, its figures measure what they name."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cbm_addon.cli import main
from cbm_addon.evaluate.hands.measures import Manifold, before, measured, summed
from cbm_addon.evaluate.hands.methods import gradient, sweep
from cbm_addon.evaluate.hands.recordings import recorded_angles
from cbm_addon.evaluate.hands.scenes import FRAMES, RATE, Scene, scenes
from cbm_addon.evaluate.tracing import png
from cbm_addon.hands.avoid import FingerOptions, avoiding
from cbm_addon.hands.model import load_hand_model
from cbm_addon.progress import run


@pytest.fixture(scope="module")
def every_scene() -> list[Scene]:
    return scenes()


def test_at_least_half_of_two_thousand_frames_pierce_and_the_palm_hardly_ever(every_scene: list[Scene]) -> None:
    starts = [before(scene) for scene in every_scene]
    depths = np.concatenate([start.depths for start in starts])
    assert len(depths) >= 2000
    assert (depths > 0.001).mean() >= 0.5
    assert 0 < np.mean([not outside for start in starts for outside in start.palm_outside]) < 0.02


def test_what_stays_as_it_is_wanted_has_not_moved(every_scene: list[Scene]) -> None:
    scene = every_scene[0]
    row = measured(scene, before(scene), scene.wanted, Manifold(scene.wanted[:1]))
    figures = summed([row], fastest=1e9)
    assert figures["moved_mm"] == 0
    assert figures["too_fast_percent"] == 0
    assert figures["frames"] == FRAMES
    assert row.strangeness.min() >= 0


def test_a_pose_of_the_manifold_is_at_no_distance_from_it() -> None:
    poses = np.random.default_rng(0).normal(size=(50, 20)).astype(np.float32)
    assert Manifold(poses).distances(poses[:5]).max() < 0.1
    np.testing.assert_allclose(Manifold(poses[:1]).distances(poses[:1] + np.float32(0.1)), np.degrees(0.1), rtol=1e-2)


def test_baselines_pierce_less_than_what_was_wanted(every_scene: list[Scene]) -> None:
    scene = every_scene[0]
    start = before(scene)
    for method in (sweep, gradient):
        row = measured(scene, start, run(method(scene)), None)
        assert np.maximum(row.depths, 0).mean() < np.maximum(start.depths, 0).mean() / 2
        assert row.beyond < 1e-3


@pytest.mark.parametrize("name", ["sphere", "thigh"])
def test_on_smooth_solids_fingertips_neither_pierce_nor_leap(every_scene: list[Scene], name: str) -> None:
    scene = next(scene for scene in every_scene if scene.name == name)
    result = run(avoiding(scene.hand, scene.wrists, scene.wanted, scene.obstacles, RATE, load_hand_model(threads=1), FingerOptions()))
    figures = summed([measured(scene, before(scene), result.angles, None)], fastest=302.0)
    assert figures["max_depth_mm"] < 0.5
    assert figures["smooth_step_mm"] < 25
    assert figures["too_fast_percent"] < 0.6


def test_a_picture_is_a_png() -> None:
    data = png(np.zeros((4, 6, 3), np.uint8))
    assert data.startswith(b"\x89PNG")
    assert data[16:24] == (6).to_bytes(4, "big") + (4).to_bytes(4, "big")


def test_without_clips_the_body_is_not_measured(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate"]) == 2
    assert "CLIP" in capsys.readouterr().err


def test_without_its_model_the_hands_are_not_measured(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", "--hands", "--model", str(tmp_path / "nowhere"), "--report", str(tmp_path / "report"), "--quiet"]) == 2
    assert "nowhere: is not a model" in capsys.readouterr().err
    assert not list((tmp_path / "report").iterdir())


@pytest.mark.needs_data
def test_recorded_hands_bend_toward_their_palms(data_folder: Path) -> None:
    path = sorted((data_folder / "mocap" / "hands").rglob("*Hand.bvh"))[0]
    angles = recorded_angles(path, RATE)
    assert np.degrees(angles[:, 4::4].mean()) > 0
    assert np.degrees(np.percentile(np.abs(np.diff(angles, axis=0)) * RATE, 99.5)) < 600
