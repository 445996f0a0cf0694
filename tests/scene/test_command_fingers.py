"""`cbm fingers` and the operators of the panel: what they write, what they leave alone, and what they refuse."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import bpy
import pytest

from cbm_addon.cli import main
from cbm_addon.takes import native_csv
from cbm_addon.takes.sample_motion import sample_take
from tests.hand_scenes import SCENES, add_things, animate
from tests.sample_rigs import SAMPLE_RIGS, add_armature, bones_at_rest

FRAMES = 10


def hero() -> bpy.types.Object:
    """A character called Hero, whose left hand closes on a ball in the collection Props."""
    bpy.context.scene.frame_start = 11
    armature = add_armature(bones_at_rest(next(sample for sample in SAMPLE_RIGS if sample.name == "Unreal 4"), "A"))
    armature.name = "Hero"
    rig = animate(armature, SCENES["sphere"], FRAMES)
    props = bpy.data.collections.new("Props")
    bpy.context.scene.collection.children.link(props)
    for thing in add_things(armature, rig, SCENES["sphere"]):
        props.objects.link(thing)
    return armature


@pytest.fixture
def folder(empty_scene: bpy.types.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with the file scene.blend of a user."""
    hero()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_a_file_is_read_and_another_written(folder):
    content = (folder / "scene.blend").read_bytes()
    argv = ["fingers", "--blend", "scene.blend", "--rig", "Hero", "-o", "out.blend", "--obstacles", "Props", "--hands", "left", "--frames", "12:19"]
    assert main([*argv, "--json", "out.json", "--quiet"]) == 0
    assert names(folder) == {"scene.blend", "out.blend", "out.json"}
    assert (folder / "scene.blend").read_bytes() == content
    report = json.loads((folder / "out.json").read_text())
    assert (report["rig"], report["first_frame"], report["frames"], report["obstacles"], list(report["hands"])) == ("Hero", 12, 8, ["Thing"], ["Left"])
    assert report["hands"]["Left"]["pierced_before"] > report["hands"]["Left"]["pierced_after"]
    bpy.ops.wm.open_mainfile(filepath=str(folder / "out.blend"))
    tracks = bpy.data.objects["Hero"].animation_data.nla_tracks
    assert [track.name for track in tracks] == ["user", report["action"]]
    assert (tracks[1].strips[0].frame_start, tracks[1].strips[0].frame_end) == (12, 19)


def test_triggers_of_a_take_are_followed(folder):
    take = sample_take()
    native_csv.write(folder / "take.csv", replace(take, extras={"grip_left": take.times.astype("f4") % 1, "trigger_right": take.times.astype("f4") % 1}))
    argv = ["fingers", "--blend", "scene.blend", "--rig", "Hero", "-o", "out.blend", "--take", "take.csv", "--grasp", "--json", "out.json", "--quiet"]
    assert main(argv) == 0
    assert {hand["wanted"] for hand in json.loads((folder / "out.json").read_text())["hands"].values()} == {"controller"}


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["--rig", "Nobody"], "Nobody: is not an armature of this file; its armatures are: Hero"),
        (["--rig", "Hero", "--obstacles", "Walls"], "Walls: is not a collection of this file; its collections are: Props"),
        (["--rig", "Hero", "--hands", "middle"], "--hands: is middle; name left, right, or left,right"),
        (["--rig", "Hero", "--frames", "9"], "--frames: is 9; give the first and the last frame"),
        (["--rig", "Hero", "--frames", "9:3"], "frames 9 to 3: are none"),
        (["--rig", "Hero", "--strength", "2"], "--strength: is 2; it is from 0 to 1"),
        (["--rig", "Hero", "--take", "bare.csv"], "bare.csv: has no values of triggers or grips"),
        (["--rig", "Hero", "--blend", "absent.blend"], "absent.blend: does not exist"),
        (["--rig", "Hero", "-o", "scene.blend"], "scene.blend: is the file that is read"),
        ([], "--rig"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(folder, capsys, argv, message):
    native_csv.write(folder / "bare.csv", replace(sample_take(), extras={}))
    before = names(folder)
    assert main(["fingers", "--blend", "scene.blend", "-o", "out.blend", "--quiet", *argv]) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert [line for line in said if line.startswith("error: ")] == said[-1:]
    assert message in said[-1]
    assert names(folder) == before


# The operators


def test_the_operator_poses_the_panels_rig_and_says_what_became_of_it(extension: ModuleType):
    armature = hero()
    settings = bpy.context.scene.cbm
    settings.rig, settings.fingers.hands, settings.fingers.obstacles = armature, "LEFT", bpy.data.collections["Props"]
    settings.fingers.use_range, settings.fingers.frame_start, settings.fingers.frame_end = True, 12, 18
    assert bpy.ops.cbm.pose_fingers() == {"FINISHED"}
    strip = armature.animation_data.nla_tracks[-1].strips[0]
    assert (strip.frame_start, strip.frame_end) == (12, 18)
    assert settings.fingers.summary.startswith("Left: ")
    assert len(settings.fingers.summary.splitlines()) == 1


def test_the_operator_says_what_is_missing(extension: ModuleType):
    with pytest.raises(RuntimeError, match="choose an armature"):
        bpy.ops.cbm.pose_fingers()
    armature = add_armature(bones_at_rest(next(sample for sample in SAMPLE_RIGS if sample.name == "motion capture")))
    with pytest.raises(RuntimeError, match="no bones for the fingers of its left hand"):
        bpy.ops.cbm.pose_fingers(rig=armature.name)
    assert not bpy.data.actions


def test_colliders_of_the_rig_are_added(extension: ModuleType):
    armature = hero()
    bpy.context.scene.cbm.rig = armature
    assert bpy.ops.cbm.add_colliders() == {"FINISHED"}
    colliders = bpy.data.collections["Hero Colliders"].objects
    assert all(obj.parent == armature and obj.parent_bone and obj.display_type == "WIRE" for obj in colliders)
    assert len(colliders) > 12


def test_showing_the_hands_needs_a_window_and_leaves_nothing_behind_without_one(extension: ModuleType):
    from bl_ext.user_default.cbm.cbm_addon.scene.overlay import Overlay

    bpy.context.scene.cbm.rig = hero()
    assert bpy.ops.cbm.show_hands() == {"FINISHED"}
    assert Overlay.shown is None


def test_what_would_be_shown_is_where_it_is(empty_scene: bpy.types.Scene):
    from cbm_addon.hands.sensor import reachable_grid
    from cbm_addon.scene.overlay import overlay_lines
    from cbm_addon.scene.rigged_hands import obstacles_of, rigged_hands

    armature = hero()
    rigged = rigged_hands(armature)
    bpy.context.scene.frame_set(11 + FRAMES // 2)
    lines = overlay_lines(bpy.context.evaluated_depsgraph_get(), rigged, obstacles_of(rigged, None), reachable_grid())
    hand = armature.evaluated_get(bpy.context.evaluated_depsgraph_get()).pose.bones["hand_l"].matrix.translation
    thing = bpy.data.objects["Thing"]
    for name, middle, within in (("hands", hand, 0.3), ("cells", thing.matrix_world @ thing.data.vertices[0].co, 0.12)):
        near = abs(lines[name].reshape(-1, 3) - middle).max(axis=-1)
        assert near.min() < within
        assert len(lines[name]) > 100
    assert lines["body"].reshape(-1, 3)[:, 2].max() > 1.6
