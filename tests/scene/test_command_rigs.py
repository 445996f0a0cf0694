"""`cbm rigs`: what a file's armatures are taken for, and maps of bones that are saved, corrected and baked with."""

from __future__ import annotations

import json
from pathlib import Path

import bpy
import pytest

from cbm_addon.cli import main
from tests.sample_rigs import SAMPLE_RIGS, SampleRig, add_armature, bones_at_rest, renamed, rig

SAMPLE = Path(__file__).resolve().parents[2] / "cbm_addon" / "takes" / "sample" / "walk_turn_crouch.csv"


def sample_called(name: str) -> SampleRig:
    return next(sample for sample in SAMPLE_RIGS if sample.name == name)


@pytest.fixture
def folder(empty_scene: bpy.types.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with a second of the sample take, and a file with a rig, one without names, and a snake."""
    lines = SAMPLE.read_text(encoding="utf-8").splitlines(keepends=True)
    (tmp_path / "walk.csv").write_text("".join(lines[: 2 + 72]), encoding="utf-8")
    add_armature(bones_at_rest(sample_called("Unreal 5"), "A"))
    add_armature(renamed(bones_at_rest(sample_called("SMPL")))).name = "Nameless"
    add_armature(bones_at_rest(rig("Snake", "none", "L R", "a > b > c > d")))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_every_armature_is_listed_with_its_kind_its_score_and_its_doubts(folder, capsys):
    assert main(["rigs", "scene.blend", "--json", "out.json"]) == 0
    said = capsys.readouterr().out
    assert "Unreal's mannequin, score 1.00: 22 joints, 30 finger joints, root bone root" in said
    assert "! found by its shape" in said
    assert "! no body: has neither the names of a known rig nor the shape of a person" in said
    reports = {report["rig"]: report for report in json.loads((folder / "out.json").read_text())["rigs"]}
    assert reports["Unreal 5"]["kind"] == "unreal"
    assert reports["Unreal 5"]["joints"]["LeftHand"] == "hand_l"
    assert reports["Unreal 5"]["ranking"][0] == ["Unreal's mannequin", 1.0]
    assert reports["Nameless"]["kind"] == "shape"
    assert "refused" in reports["Snake"]


def test_a_map_is_saved_corrected_and_baked_with(folder):
    assert main(["rigs", "scene.blend", "--rig", "Unreal 5", "--save-map", "map.json"]) == 0
    content = json.loads((folder / "map.json").read_text())
    content["joints"]["Spine1"] = "spine_04"
    content["kind"] = "mine"
    (folder / "map.json").write_text(json.dumps(content))
    assert main(["rigs", "scene.blend", "--rig", "Unreal 5", "--map", "map.json", "--json", "out.json"]) == 0
    assert json.loads((folder / "out.json").read_text())["rigs"][0]["kind"] == "mine"
    argv = ["bake", "walk.csv", "--rig", "Unreal 5", "--blend", "scene.blend", "-o", "out.blend", "--map", "map.json", "--root", "bone", "--quiet"]
    assert main(argv) == 0
    bpy.ops.wm.open_mainfile(filepath=str(folder / "out.blend"))
    keyed = {curve.split('"')[1] for curve in curves(bpy.data.objects["Unreal 5"])}
    assert {"root", "spine_04", "lowerarm_twist_01_l"} <= keyed
    assert "spine_02" not in keyed


def curves(armature: bpy.types.Object) -> list[str]:
    from cbm_addon.scene.action import action_curves

    return [curve.data_path for curve in action_curves(armature)]


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["absent.blend"], "absent.blend: does not exist"),
        (["scene.blend", "--rig", "Nobody"], "Nobody: is not an armature"),
        (["scene.blend", "--rig", "Snake"], "Snake: has neither"),
        (["scene.blend", "--save-map", "map.json"], "name one with --rig"),
        (["scene.blend", "--rig", "Snake", "--save-map", "map.json"], "Snake: has neither"),
        (["scene.blend", "--map", "walk.csv"], "walk.csv: is not JSON"),
        (["scene.blend", "--rig", "Unreal 5", "--save-map", "walk.csv"], "pass --overwrite"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(folder, capsys, argv, message):
    before = sorted(path.name for path in folder.iterdir())
    assert main(["rigs", *argv]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert [line for line in said if line.startswith("error: ")] == said[-1:]
    assert message in said[-1]
    assert sorted(path.name for path in folder.iterdir()) == before


@pytest.mark.parametrize(("argv", "message"), [(["--map", "absent.json"], "absent.json: cannot be read"), (["--root", "object", "--part", "lower"], "hips")])
def test_a_bake_with_a_bad_map_or_root_writes_nothing(folder, capsys, argv, message):
    assert main(["bake", "walk.csv", "--rig", "Unreal 5", "--blend", "scene.blend", "-o", "out.blend", "--quiet", *argv]) == 2
    assert message in capsys.readouterr().err
    assert not (folder / "out.blend").exists()
