"""`info`, `convert` and `synthesize` on the command line."""

from __future__ import annotations

import json

import numpy as np
import pytest

from cbm_addon.cli import main
from cbm_addon.motion.bvh import read_bvh, write_bvh
from cbm_addon.takes import native_csv
from cbm_addon.takes.readers import read_take
from cbm_addon.takes.sample_motion import sample_motion, sample_take
from cbm_addon.takes.synthesize import synthesize


@pytest.fixture
def take_file(tmp_path):
    native_csv.write(tmp_path / "take.csv", sample_take())
    return tmp_path / "take.csv"


@pytest.fixture
def clip_file(tmp_path):
    write_bvh(tmp_path / "clip.bvh", sample_motion())
    return tmp_path / "clip.bvh"


def run(*argv) -> int:
    return main([str(word) for word in argv])


def test_info_tells_takes_and_mocap_apart(take_file, clip_file, tmp_path, capsys):
    assert run("info", take_file, clip_file, "--json", tmp_path / "report.json") == 0
    out = capsys.readouterr().out
    assert "native take CSV, device poses: 2592 samples" in out
    assert "BVH: 2592 frames" in out
    take, clip = json.loads((tmp_path / "report.json").read_text())["files"]
    assert take["kind"] == "take"
    assert take["rate_hz"] == pytest.approx(72, abs=0.01)
    assert take["constants"]["axes"] == {"value": "engine", "source": "format", "why": "", "confidence": None}
    assert take["calibration"]["constants"]["eye_height"]["source"] == "measured"
    assert take["tracked"] == {"head": 1.0, "left": 1.0, "right": 1.0}
    assert clip["kind"] == "mocap"
    assert (clip["unit"], clip["up_axis"], clip["frames"]) == ("cm", "Y", 2592)
    assert clip["stature"] == pytest.approx(1.75, abs=0.01)


def test_info_reports_defects_and_overrides(take_file, tmp_path, capsys):
    lines = take_file.read_text().splitlines()
    lines[10] = lines[11]
    take_file.write_text("\n".join(lines) + "\n")
    assert run("info", take_file, "--eye-height", 1.8, "--json", tmp_path / "report.json") == 0
    assert "! rows with the time of the next row, left out: 1" in capsys.readouterr().out
    (take,) = json.loads((tmp_path / "report.json").read_text())["files"]
    assert take["defects"] == [{"kind": "duplicate_time", "count": 1, "message": "rows with the time of the next row, left out: 1"}]
    assert take["calibration"]["eye_height"] == pytest.approx(1.8)


def test_convert_writes_a_native_take(take_file, tmp_path):
    assert run("convert", take_file, tmp_path / "again.csv") == 0
    assert read_take(tmp_path / "again.csv").kind == "device"
    np.testing.assert_allclose(read_take(tmp_path / "again.csv").positions, read_take(take_file).positions, atol=2e-6)


def test_convert_writes_bvh(clip_file, tmp_path):
    assert run("convert", clip_file, tmp_path / "again.bvh") == 0
    np.testing.assert_allclose(read_bvh(tmp_path / "again.bvh").positions(), read_bvh(clip_file).positions(), atol=1e-4)


def test_synthesize_makes_a_take_of_a_clip(clip_file, tmp_path):
    assert run("synthesize", clip_file, "-o", tmp_path / "joints.csv") == 0
    take = read_take(tmp_path / "joints.csv")
    assert take.kind == "joint"
    np.testing.assert_allclose(take.positions, synthesize(sample_motion()).positions, atol=1e-4)
    assert run("synthesize", clip_file, "-o", tmp_path / "noisy.csv", "--device", "index", "--noise", "2,1", "--hmd-only", "--seed", 3) == 0
    noisy = read_take(tmp_path / "noisy.csv")
    assert noisy.kind == "device"
    assert noisy.tracked.all(axis=0).tolist() == [True, False, False]


def test_synthesize_makes_the_sample_again(tmp_path):
    assert run("synthesize", "--sample", "--device", "quest2", "-o", tmp_path / "sample.csv") == 0
    native_csv.write(tmp_path / "ours.csv", sample_take())
    assert (tmp_path / "sample.csv").read_bytes() == (tmp_path / "ours.csv").read_bytes()


@pytest.mark.parametrize(
    "argv",
    [
        ["info", "absent.csv"],
        ["info", "take.csv", "--eye-height", "165"],
        ["convert", "take.csv", "take.bvh"],
        ["convert", "clip.bvh", "clip.csv"],
        ["convert", "cut.csv", "out.csv"],
        ["convert", "take.csv", "kept.csv"],
        ["synthesize", "clip.bvh", "-o", "kept.csv"],
        ["synthesize", "absent.bvh", "-o", "out.csv"],
        ["synthesize", "-o", "out.csv"],
        ["synthesize", "clip.bvh", "--sample", "-o", "out.csv"],
        ["synthesize", "clip.bvh", "-o", "out.csv", "--noise", "1"],
        ["synthesize", "clip.bvh", "-o", "out.csv", "--noise", "-1,0"],
        ["synthesize", "clip.bvh", "-o", "out.csv", "--device", "wand"],
    ],
    ids=" ".join,
)
def test_bad_input_is_one_line_and_writes_nothing(take_file, clip_file, tmp_path, monkeypatch, capsys, argv):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cut.csv").write_text(take_file.read_text()[:50_000])
    (tmp_path / "kept.csv").write_text("the user's own")
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    assert main(argv) == 2
    err = capsys.readouterr().err
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before
