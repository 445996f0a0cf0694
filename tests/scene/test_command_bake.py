"""`cbm bake`: what it writes, what it leaves alone, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path
from types import ModuleType

import bpy
import numpy as np
import pytest

from cbm_addon.cli import main
from cbm_addon.motion.skeleton import BODY_JOINTS, STANDARD_BODY
from cbm_addon.scene.action import Channel, write_action
from cbm_addon.scene.rigify import rigify_metarig

SAMPLE = Path(__file__).resolve().parents[2] / "cbm_addon" / "takes" / "sample" / "walk_turn_crouch.csv"


@pytest.fixture
def folder(empty_scene: bpy.types.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with two pieces of the sample take of one second each."""
    lines = SAMPLE.read_text(encoding="utf-8").splitlines(keepends=True)
    for name, start in (("stand", 2), ("walk", 2 + 4 * 72)):
        (tmp_path / f"{name}.csv").write_text("".join([*lines[:2], *lines[start : start + 73]]), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def scene_blend(folder: Path) -> Path:
    """A scene of a user: a metarig called Hero at 25 frames per second that starts at frame 11."""
    armature = rigify_metarig(bpy.context)
    armature.name = "Hero"
    scene = bpy.context.scene
    scene.render.fps, scene.frame_start, scene.frame_end = 25, 11, 99
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "scene.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return folder / "scene.blend"


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_a_preset_becomes_a_file_that_opens_well(folder):
    assert main(["bake", "walk.csv", "--preset", "rigify-metarig", "-o", "out.blend", "--preview", "out.png", "--json", "out.json", "--quiet"]) == 0
    assert names(folder) == {"stand.csv", "walk.csv", "out.blend", "out.png", "out.json"}
    report = json.loads((folder / "out.json").read_text())
    (baked,) = report["bakes"]
    bpy.ops.wm.open_mainfile(filepath=str(folder / "out.blend"))
    scene = bpy.context.scene
    action = bpy.data.objects[report["rig"]].animation_data.action
    assert action.name == baked["action"] == "walk_variation0"
    assert bpy.data.actions.keys() == ["walk_variation0"]
    assert tuple(action.frame_range) == (scene.frame_start, scene.frame_end) == (1, baked["frames"])
    assert scene.camera is not None
    assert bpy.data.objects["CBM Proxy"].parent == bpy.data.objects[report["rig"]]


def test_a_users_scene_keeps_its_settings_and_its_file(folder, scene_blend):
    content = scene_blend.read_bytes()
    assert main(["bake", "walk.csv", "--rig", "Hero", "--blend", "scene.blend", "-o", "out.blend", "--quiet"]) == 0
    assert scene_blend.read_bytes() == content
    bpy.ops.wm.open_mainfile(filepath=str(folder / "out.blend"))
    scene = bpy.context.scene
    assert (scene.render.fps, scene.frame_start, scene.frame_end) == (25, 11, 99)
    assert tuple(bpy.data.objects["Hero"].animation_data.action.frame_range) == (11, 36)
    assert set(bpy.data.objects.keys()) == {"Hero", "CBM Proxy"}


def test_takes_and_variations_become_actions_and_the_first_is_active(folder, scene_blend):
    argv = ["bake", "stand.csv", "walk.csv", "--variations", "2", "--rig", "Hero", "--blend", "scene.blend", "-o", "out.blend", "--json", "out.json"]
    assert main([*argv, "--quiet"]) == 0
    expected = ["stand_variation0", "stand_variation1", "walk_variation0", "walk_variation1"]
    assert [baked["action"] for baked in json.loads((folder / "out.json").read_text())["bakes"]] == expected
    bpy.ops.wm.open_mainfile(filepath=str(folder / "out.blend"))
    assert sorted(bpy.data.actions.keys()) == expected
    assert bpy.data.objects["Hero"].animation_data.action.name == "stand_variation0"


def test_earlier_actions_and_other_variations_become_muted_tracks_on_request(folder, scene_blend):
    bpy.ops.wm.open_mainfile(filepath=str(scene_blend))
    hero = bpy.data.objects["Hero"]
    write_action(hero, "mine", np.array([11.0, 20.0]), [Channel("location", np.eye(3)[:2], "Move")], fake_user=False)
    bpy.ops.wm.save_mainfile()
    argv = ["bake", "walk.csv", "--variations", "2", "--push-down", "--no-fake-user", "--rig", "Hero", "--blend", "scene.blend", "-o", "out.blend"]
    assert main([*argv, "--quiet"]) == 0
    bpy.ops.wm.open_mainfile(filepath=str(folder / "out.blend"))
    data = bpy.data.objects["Hero"].animation_data
    assert data.action.name == "walk_variation0"
    assert [(track.name, track.mute, track.strips[0].action.name) for track in data.nla_tracks] == [
        ("mine", True, "mine"),
        ("walk_variation1", True, "walk_variation1"),
    ]
    assert (data.nla_tracks[0].strips[0].frame_start, data.nla_tracks[0].strips[0].frame_end) == (11, 20)
    assert not any(action.use_fake_user for action in bpy.data.actions)


def test_a_preset_can_be_added_to_a_users_scene(folder, scene_blend):
    assert main(["bake", "walk.csv", "--preset", "rigify-metarig", "--blend", "scene.blend", "-o", "out.blend", "--quiet"]) == 0
    bpy.ops.wm.open_mainfile(filepath=str(folder / "out.blend"))
    assert set(bpy.data.objects.keys()) == {"Hero", "metarig", "CBM Proxy"}
    assert bpy.context.scene.render.fps == 25
    assert bpy.context.scene.camera is None


def test_the_extension_that_runs_it_stays_registered(folder, scene_blend, extension: ModuleType):
    argv = ["bake", "walk.csv", "--rig", "Hero", "--blend", "scene.blend", "-o", "out.blend", "--quiet"]
    assert extension.run_command(argv) == 0
    assert extension.run_command(["bake", "walk.csv", "--preset", "rigify-metarig", "-o", "other.blend", "--quiet"]) == 0
    assert all(cls.is_registered for cls in extension.registered)


def a_body_without_legs() -> None:
    data = bpy.data.armatures.new("Half")
    armature = bpy.data.objects.new("Half", data)
    bpy.context.scene.collection.objects.link(armature)
    bpy.context.view_layer.objects.active = armature
    bpy.ops.object.mode_set(mode="EDIT")
    rest = STANDARD_BODY.rest_positions()
    for joint, name in enumerate(BODY_JOINTS):
        if "Leg" not in name and "Foot" not in name and "Toe" not in name:
            bone = data.edit_bones.new(name)
            bone.head = rest[joint]
            bone.tail = rest[joint] + (0, 0, 0.1)
            parent = STANDARD_BODY.parents[joint]
            bone.parent = data.edit_bones[BODY_JOINTS[parent]] if parent >= 0 else None
    bpy.ops.object.mode_set(mode="OBJECT")


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["--rig", "Nobody", "--blend", "scene.blend"], "Nobody: is not an armature of this file; its armatures are: Hero"),
        (["--rig", "Hero", "--blend", "absent.blend"], "absent.blend: does not exist"),
        (["--rig", "Hero", "--blend", "walk.csv"], "walk.csv: cannot be opened"),
        (["--rig", "Hero"], "Hero: is not an armature of this file; its armatures are: none"),
        (["--preset", "rigify-metarig", "--preview", "out.gif"], "out.gif: is no kind of preview"),
        (["--preset", "rigify-metarig", "--preview", "out.blend"], "out.blend: is no kind of preview"),
        (["--preset", "rigify-metarig", "--variations", "0"], "--variations: is 0"),
        (["--preset", "rigify-metarig", "--reduce", "5"], "'5' is not two numbers with commas between them"),
        (["--preset", "rigify-metarig", "--reduce", "0,1"], "--reduce: allows 0 mm"),
        (["--preset", "rigify-metarig", "--model", "."], "card.json"),
        (["--preset", "rigify-metarig", "--limbs", "ik"], "key its limbs with fk"),
        (["--preset", "nonsense"], "nonsense"),
        ([], "--rig"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(folder, scene_blend, capsys, argv, message):
    before = names(folder)
    capsys.readouterr()
    assert main(["bake", "walk.csv", "-o", "out.blend", "--quiet", *argv]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert [line for line in said if line.startswith("error: ")] == said[-1:]
    assert message in said[-1]
    assert names(folder) == before


def test_an_armature_without_legs_is_refused(folder, capsys):
    a_body_without_legs()
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "half.blend"))
    assert main(["bake", "walk.csv", "--rig", "Half", "--blend", "half.blend", "-o", "out.blend", "--quiet"]) == 2
    assert "Half: lacks bones for LeftUpLeg" in capsys.readouterr().err
    assert "out.blend" not in names(folder)


@pytest.mark.parametrize("how", ["named", "open"])
def test_the_file_that_is_read_is_never_written(folder, scene_blend, capsys, how):
    content = scene_blend.read_bytes()
    argv = ["bake", "walk.csv", "--rig", "Hero", "-o", "./scene.blend", "--overwrite", "--quiet"]
    if how == "open":
        bpy.ops.wm.open_mainfile(filepath=str(scene_blend))
    else:
        argv += ["--blend", "scene.blend"]
    assert main(argv) == 2
    assert "write to another one" in capsys.readouterr().err
    assert scene_blend.read_bytes() == content
