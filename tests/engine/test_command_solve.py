"""`solve`, `train` and `models` as a shell calls them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from cbm_addon.cli import main
from cbm_addon.motion.bvh import read_bvh, write_bvh
from cbm_addon.motion.motion import Motion
from cbm_addon.motion.skeleton import BODY_JOINTS
from cbm_addon.takes.native_csv import write
from cbm_addon.takes.synthesize import synthesize


@pytest.fixture
def clip(tmp_path: Path, body_motion: Motion) -> Path:
    path = tmp_path / "clip.bvh"
    write_bvh(path, body_motion)
    return path


@pytest.fixture
def take(tmp_path: Path, body_motion: Motion) -> Path:
    path = tmp_path / "take.csv"
    write(path, synthesize(body_motion))
    return path


def solve(take: Path, output: Path, model: Path, *options: str) -> int:
    return main(["solve", str(take), "-o", str(output), "--model", str(model), "--candidates", "4", "--quiet", *options])


def head_error(solved: Motion, truth: Motion) -> float:
    frames = slice(0, min(len(solved), len(truth)))
    head = [motion.positions()[frames, motion.skeleton.index("Head")] for motion in (solved, truth)]
    return float(np.linalg.norm(head[0] - head[1], axis=-1).max())


@pytest.mark.parametrize("mode", ["lookahead", "causal"])
def test_a_take_becomes_a_body_in_the_world_of_the_take(
    tmp_path: Path, take: Path, clip: Path, body_motion: Motion, small_model_folder: Path, mode: str
) -> None:
    output, report = tmp_path / "out.bvh", tmp_path / "report.json"
    assert solve(take, output, small_model_folder, "--mode", mode, "--skeleton", str(clip), "--json", str(report)) == 0
    solved = read_bvh(output)
    assert solved.skeleton.names == BODY_JOINTS
    np.testing.assert_allclose(solved.skeleton.offsets[1:], body_motion.skeleton.offsets[1:], atol=1e-4)
    assert solved.rate == pytest.approx(30, abs=0.01)
    assert head_error(solved, body_motion) < 0.002
    facts = json.loads(report.read_text())
    assert (facts["frames"], facts["mode"]) == (len(solved), mode)
    assert facts["calibration"]["constants"]["floor"]["source"] in ("measured", "assumed")


def test_the_body_has_the_stature_that_is_asked_for(tmp_path: Path, take: Path, small_model_folder: Path) -> None:
    assert solve(take, tmp_path / "tall.bvh", small_model_folder, "--stature", "2.0") == 0
    skeleton = read_bvh(tmp_path / "tall.bvh").skeleton
    top = skeleton.height_above_toes() + skeleton.tips[skeleton.index("Head"), 2]
    assert top == pytest.approx(2.0, abs=0.01)


def test_the_same_seed_gives_the_same_file_and_a_variation_another(tmp_path: Path, take: Path, small_model_folder: Path) -> None:
    for name, options in {"a": ["--seed", "5"], "b": ["--seed", "5"], "c": ["--seed", "5", "--variation", "1"]}.items():
        assert solve(take, tmp_path / f"{name}.bvh", small_model_folder, *options) == 0
    a, b, c = ((tmp_path / f"{name}.bvh").read_bytes() for name in "abc")
    assert a == b
    assert a != c


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--candidates", "0"], "--candidates"),
        (["--variation", "-1"], "--variation"),
        (["--fps", "0"], "--fps"),
        (["--eye-height", "17"], "--eye-height"),
        (["--skeleton", "missing.bvh"], "missing.bvh"),
    ],
)
def test_options_that_make_no_sense_are_refused_in_one_line(
    tmp_path: Path, take: Path, small_model_folder: Path, capsys: pytest.CaptureFixture[str], options: list[str], said: str
) -> None:
    assert solve(take, tmp_path / "out.bvh", small_model_folder, *options) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert error.count("\n") == 1
    assert said in error
    assert not (tmp_path / "out.bvh").exists()


def test_training_on_ones_own_clips_gives_a_model_that_solves(tmp_path: Path, take: Path, clip: Path, capsys: pytest.CaptureFixture[str]) -> None:
    config, model = tmp_path / "tiny.toml", tmp_path / "model"
    config.write_text('name = "mine"\nchannels = 4\nclasses = 4\nhidden = 16\nepochs = 1\nbatch = 32\n')
    arguments = ["train", str(clip), "-o", str(model), "--config", str(config), "--quiet"]
    assert main(arguments) == 0
    assert main(["models", str(model)]) == 0
    assert "'mine'" in capsys.readouterr().out
    assert solve(take, tmp_path / "out.bvh", model) == 0
    assert main(arguments) == 2, "a model is not replaced unasked"
    assert "--overwrite" in capsys.readouterr().err


def test_json_lines_tell_a_driving_program_what_happens(tmp_path: Path, take: Path, small_model_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert solve(take, tmp_path / "out.bvh", small_model_folder, "--json-lines") == 0
    events = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    shares = [event["share"] for event in events if "share" in event]
    assert shares == sorted(shares)
    assert "solved" in events[-1]["said"]


def test_controllers_that_are_not_those_of_the_take_are_said(tmp_path: Path, body_motion: Motion, capsys: pytest.CaptureFixture[str]) -> None:
    take, report = tmp_path / "index.csv", tmp_path / "report.json"
    write(take, synthesize(body_motion, device="index"))
    said = {}
    for device in ("index", "quest2"):
        options = ["--device", device, "--candidates", "2", "--json", str(report), "--overwrite"]
        assert main(["solve", str(take), "-o", str(tmp_path / "out.bvh"), *options]) == 0
        said[device] = json.loads(report.read_text())["warnings"]
    assert said["index"] == []
    assert len(said["quest2"]) == 1
    assert f"{take}: {said['quest2'][0]}" in capsys.readouterr().out
