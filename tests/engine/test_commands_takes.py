"""`info`, `convert` and `synthesize` on the command line."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from cbm_addon.cli import main
from cbm_addon.motion.bvh import read_bvh, write_bvh
from cbm_addon.takes import native_csv
from cbm_addon.takes.readers import read_take
from cbm_addon.takes.sample_motion import sample_motion, sample_take
from cbm_addon.takes.synthesize import synthesize
from cbm_addon.takes.take import DEVICES

SVG = "{http://www.w3.org/2000/svg}"


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


def test_a_table_has_a_line_for_every_file_and_a_broken_one_does_not_stop_it(take_file, clip_file, tmp_path, capsys):
    broken = tmp_path / "broken.csv"
    broken.write_text("no take", encoding="utf-8")
    assert run("info", "--table", broken, take_file, clip_file, "--json", tmp_path / "report.json") == 2
    said = capsys.readouterr()
    header, *rows = said.out.splitlines()
    assert [row.split()[0] for row in rows] == ["broken.csv", "take.csv", "clip.bvh"]
    assert "refused: is not a take" in rows[0]
    for row, column, value in ((1, "format", "native take CSV"), (1, "rate", "72.0"), (1, "unit", "m"), (1, "eyes", "1.65 measured"), (2, "axes", "Y up")):
        assert rows[row][header.index(column) :].startswith(value)
    assert said.err == "error: 1 of 3 files cannot be read; the last column says why\n"
    assert ["refused" in facts for facts in json.loads((tmp_path / "report.json").read_text())["files"]] == [True, False, False]


def test_info_plots_a_take_before_and_after_cleaning(tmp_path):
    take = sample_take()
    take.tracked[500:600, 1] = False
    take.positions[1000, 2, 0] += 1
    native_csv.write(tmp_path / "dirty.csv", replace(take, positions=np.where(take.tracked[..., None], take.positions, np.nan)))
    assert run("info", tmp_path / "dirty.csv", "--plot", tmp_path / "take.svg") == 0
    drawing = ElementTree.parse(tmp_path / "take.svg").getroot()
    assert [text.text for text in drawing.iter(f"{SVG}text") if text.text in DEVICES] == list(DEVICES)
    curves = [np.array([point.split(",") for point in line.get("points").split()], dtype=float) for line in drawing.iter(f"{SVG}polyline")]
    assert len(curves) == 9
    assert all(len(curve) < 4 * 900 and (np.diff(curve[:, 0]) >= 0).all() for curve in curves)
    assert len([shade for shade in drawing.iter(f"{SVG}rect") if shade.get("fill") == "#fbe9d0"]) == 2, "a loss, and the sample taken out"
    # The sample that jumped away is among the dots, and no curve goes there.
    marks = list(drawing.iter(f"{SVG}path"))[6].get("d").split("M")[1:]
    dots = np.array([mark.split("h")[0].split() for mark in marks], dtype=float)
    off = np.abs(dots[:, 1] - np.interp(dots[:, 0], *curves[6].T))
    assert (off > 10).sum() == 1
    assert dots[np.argmax(off), 0] == pytest.approx(60 + 900 * take.times[1000] / take.seconds, abs=1)


def test_only_one_take_is_plotted_and_nothing_of_the_user_s_is_replaced(take_file, tmp_path, capsys):
    assert run("info", take_file, take_file, "--plot", tmp_path / "take.svg") == 2
    (tmp_path / "mine.svg").write_text("mine")
    assert run("info", take_file, "--plot", tmp_path / "mine.svg") == 2
    assert (tmp_path / "mine.svg").read_text() == "mine"
    assert capsys.readouterr().err.count("error:") == 2


def test_convert_splits_an_interrupted_take(tmp_path):
    take = sample_take()
    native_csv.write(tmp_path / "long.csv", replace(take, times=take.times + 60 * (np.arange(len(take)) >= 1000)))
    assert run("convert", tmp_path / "long.csv", tmp_path / "piece.csv", "--split", 2, "--json", tmp_path / "report.json") == 0
    pieces = [read_take(tmp_path / f"piece_{number}.csv") for number in (1, 2)]
    assert [len(piece) for piece in pieces] == [1000, len(take) - 1000]
    assert [piece["samples"] for piece in json.loads((tmp_path / "report.json").read_text())["pieces"]] == [1000, len(take) - 1000]
    assert not (tmp_path / "piece.csv").exists()


def test_decisions_can_be_overridden(take_file, tmp_path, capsys):
    assert run("info", take_file, "--rate", 36, "--device", "none", "--json", tmp_path / "report.json") == 0
    (take,) = json.loads((tmp_path / "report.json").read_text())["files"]
    assert take["rate_hz"] == pytest.approx(36, abs=0.01)
    assert take["constants"]["time"]["source"] == "given"
    assert "device" not in take["calibration"]["constants"]
    assert "36 samples a second (given)" in capsys.readouterr().out


def test_what_takes_blender_says_so_where_there_is_none(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "bpy", None)
    (tmp_path / "take.fbx").write_bytes(b"Kaydara FBX Binary  \0")
    assert run("info", tmp_path / "take.fbx") == 2
    assert "inside Blender" in capsys.readouterr().err


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
        ["convert", "take.csv", "out.csv", "--split", "0"],
        ["convert", "clip.bvh", "out.bvh", "--split", "1"],
        ["info", "take.csv", "--rate", "fast"],
        ["info", "take.csv", "--plot", "folder/plot.svg"],
        ["record", "-o", "kept.csv"],
        ["record", "-o", "out.csv", "--seconds", "-1"],
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
