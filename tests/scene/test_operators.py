"""The operators, as a script in background mode calls them: take, rig, model, bake."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType

import bpy
import numpy as np
import pytest

from cbm_addon.scene.action import action_curves

REPOSITORY = Path(__file__).resolve().parents[2]
SAMPLE = REPOSITORY / "cbm_addon" / "takes" / "sample" / "walk_turn_crouch.csv"


@pytest.fixture
def metarig(extension: ModuleType) -> bpy.types.Object:
    from bl_ext.user_default.cbm.cbm_addon.scene.rigify import rigify_metarig

    return rigify_metarig(bpy.context)


@pytest.fixture
def short_take(tmp_path: Path) -> Path:
    """The first four seconds of the sample take."""
    lines = SAMPLE.read_text().splitlines(keepends=True)
    path = tmp_path / "short.csv"
    path.write_text("".join(lines[: 2 + 4 * 72]))
    return path


def test_importing_a_take_shows_its_trackers_and_remembers_what_was_found(extension: ModuleType, short_take: Path) -> None:
    assert bpy.ops.cbm.import_take(filepath=str(short_take)) == {"FINISHED"}
    trackers = bpy.data.collections["short trackers"].objects
    assert {empty.name for empty in trackers} == {"short origin", "short head", "short left", "short right"}
    assert 1.3 < trackers["short head"].location.z < 1.9
    assert "stature" in bpy.context.scene.cbm.take_summary
    bpy.ops.cbm.import_take(filepath=str(short_take))
    assert (len(bpy.data.objects), len(bpy.data.actions)) == (4, 3), "importing again replaces, and does not pile up"


def test_calibration_overrides_what_was_measured(extension: ModuleType, short_take: Path) -> None:
    bpy.ops.cbm.import_take(filepath=str(short_take))
    assert bpy.ops.cbm.calibrate_take(eye_height=1.5) == {"FINISHED"}
    assert "eye height: 1.500 m (given" in bpy.context.scene.cbm.take_summary
    with pytest.raises(RuntimeError, match="eye height of a person"):
        bpy.ops.cbm.calibrate_take(eye_height=0.2)
    assert bpy.context.scene.cbm.eye_height == pytest.approx(1.5), "a refused correction changes nothing"


def test_a_corrected_setting_moves_the_trackers_at_once(extension: ModuleType, short_take: Path) -> None:
    bpy.ops.cbm.import_take(filepath=str(short_take))
    settings, head = bpy.context.scene.cbm, bpy.data.objects["short head"]
    settings.eye_height = 1.65  # or another floor makes another stature
    before = tracker(head)
    settings.measure_floor, settings.floor = False, 0.25
    np.testing.assert_allclose(tracker(head) - before, (0, 0, -0.25), atol=1e-5)
    assert "floor: 0.250 m (given)" in settings.take_summary
    settings.eye_height = 0.2
    assert settings.take_summary.startswith("! --eye-height"), "what cannot be is said where the findings stand"
    settings.eye_height, settings.measure_floor = 1.65, True
    np.testing.assert_allclose(tracker(head), before, atol=1e-5)
    assert (len(bpy.data.objects), len(bpy.data.actions)) == (4, 3), "the trackers are moved, and not made again"


def tracker(obj: bpy.types.Object) -> np.ndarray:
    """Where an object is in the middle of the take."""
    bpy.context.scene.frame_set(40)
    return np.array(obj.matrix_world.translation)


def test_own_offsets_begin_as_those_of_the_device(extension: ModuleType, tmp_path: Path) -> None:
    from bl_ext.user_default.cbm.cbm_addon.takes import native_csv
    from bl_ext.user_default.cbm.cbm_addon.takes.sample_motion import sample_motion
    from bl_ext.user_default.cbm.cbm_addon.takes.synthesize import synthesize

    native_csv.write(tmp_path / "device.csv", synthesize(sample_motion(), "index"))
    bpy.ops.cbm.import_take(filepath=str(tmp_path / "device.csv"))
    settings, wrist = bpy.context.scene.cbm, bpy.data.objects["device left"]
    settings.device = "index"
    before = tracker(wrist)
    settings.own_offsets = True
    np.testing.assert_allclose(tracker(wrist), before, atol=1e-5)
    settings.wrist_offset[1] += 0.1
    assert np.linalg.norm(tracker(wrist) - before) == pytest.approx(0.1, abs=1e-3)


def test_variations_become_actions_in_one_go(metarig: bpy.types.Object, short_take: Path) -> None:
    settings = bpy.context.scene.cbm
    settings.push_down = settings.reduce = True
    assert bpy.ops.cbm.bake_take(take=str(short_take), rig=metarig.name, variations=2) == {"FINISHED"}
    assert metarig.animation_data.action.name == "short_variation0"
    (track,) = metarig.animation_data.nla_tracks
    assert (track.name, track.mute, track.strips[0].action.name) == ("short_variation1", True, "short_variation1")
    assert max(len(curve.keyframe_points) for curve in action_curves(metarig)) < 4 * 24 - 1


def test_a_model_is_checked_before_it_is_chosen(extension: ModuleType, tmp_path: Path) -> None:
    assert bpy.ops.cbm.load_model() == {"FINISHED"}
    assert "'base'" in bpy.context.scene.cbm.model_summary
    with pytest.raises(RuntimeError, match=r"card\.json"):
        bpy.ops.cbm.load_model(directory=str(tmp_path))
    assert "'base'" in bpy.context.scene.cbm.model_summary


def test_baking_makes_a_new_action_and_leaves_the_rest_alone(metarig: bpy.types.Object, short_take: Path) -> None:
    scene = bpy.context.scene
    before = scene.render.fps, scene.frame_start, scene.frame_end, np.array([bone.matrix_local for bone in metarig.data.bones])
    bpy.ops.cbm.import_take(filepath=str(short_take))
    assert bpy.ops.cbm.bake_take(rig=metarig.name) == {"FINISHED"}
    first = metarig.animation_data.action
    assert first.name == "short_variation0"
    bpy.context.view_layer.update()
    head, tracker = metarig.pose.bones["spine.006"].head, bpy.data.objects["short head"].matrix_world.translation
    assert (metarig.matrix_world @ head - tracker).length < 0.01, "the trackers that are shown are the size of the rig"
    assert tuple(first.frame_range) == (scene.frame_start, scene.frame_start + 4 * 24 - 1)
    assert bpy.ops.cbm.bake_take(rig=metarig.name) == {"FINISHED"}
    assert metarig.animation_data.action != first
    assert first.name in bpy.data.actions
    assert before[:3] == (scene.render.fps, scene.frame_start, scene.frame_end)
    np.testing.assert_array_equal(before[3], np.array([bone.matrix_local for bone in metarig.data.bones]))


def test_choosing_a_rig_shows_what_it_is_taken_for(metarig: bpy.types.Object, tmp_path: Path) -> None:
    settings = bpy.context.scene.cbm
    settings.rig = metarig
    assert settings.rig_summary == "Rigify's human metarig, score 1.00: 22 joints, 30 finger joints, root bone none"
    settings.map = str(tmp_path / "absent.json")
    assert settings.rig_summary.startswith("! ")
    assert "absent.json" in settings.rig_summary
    settings.rig = None
    assert settings.rig_summary == ""


def test_baking_keeps_to_the_panels_map_and_root(metarig: bpy.types.Object, short_take: Path, tmp_path: Path) -> None:
    from bl_ext.user_default.cbm.cbm_addon.rigs.tables import save_map
    from bl_ext.user_default.cbm.cbm_addon.scene.rig import read_rig

    save_map(tmp_path / "map.json", read_rig(metarig).mapping)
    content = (tmp_path / "map.json").read_text()
    (tmp_path / "map.json").write_text(content.replace('"Spine1": "spine.002",', ""))
    settings = bpy.context.scene.cbm
    settings.map, settings.root = str(tmp_path / "map.json"), "object"
    assert bpy.ops.cbm.bake_take(take=str(short_take), rig=metarig.name) == {"FINISHED"}
    paths = {curve.data_path for curve in action_curves(metarig)}
    assert "location" in paths
    assert not [path for path in paths if "spine.002" in path]


def test_baking_without_a_take_or_onto_no_body_says_so(extension: ModuleType, short_take: Path) -> None:
    with pytest.raises(RuntimeError, match="import a take first"):
        bpy.ops.cbm.bake_take()
    data = bpy.data.armatures.new("Stick")
    stick = bpy.data.objects.new("Stick", data)
    bpy.context.scene.collection.objects.link(stick)
    with pytest.raises(RuntimeError, match="Stick"):
        bpy.ops.cbm.bake_take(take=str(short_take), rig="Stick")
    assert not bpy.data.actions


def test_limbs_that_a_rig_has_not_are_refused_by_the_panels_choice(extension: ModuleType, metarig: bpy.types.Object, short_take: Path) -> None:
    bpy.context.scene.cbm.limbs = "both"
    with pytest.raises(RuntimeError, match="key its limbs with fk"):
        bpy.ops.cbm.bake_take(take=str(short_take), rig=metarig.name)
    assert not bpy.data.actions


def test_cancelling_a_bake_changes_nothing(metarig: bpy.types.Object, short_take: Path) -> None:
    from bl_ext.user_default.cbm.cbm_addon.scene.bake import BakeOptions, bake
    from bl_ext.user_default.cbm.cbm_addon.solve.models import load_model
    from bl_ext.user_default.cbm.cbm_addon.takes.calibrate import calibrate
    from bl_ext.user_default.cbm.cbm_addon.takes.readers import read_take

    job = bake(bpy.context, metarig, calibrate(read_take(short_take)), load_model(), BakeOptions())
    for _ in range(3):
        next(job)
    job.close()
    assert not bpy.data.actions
    assert metarig.animation_data is None


def test_training_runs_in_another_python_and_reports_its_progress(extension: ModuleType, tmp_path: Path) -> None:
    from bl_ext.user_default.cbm.cbm_addon.motion.bvh import write_bvh
    from bl_ext.user_default.cbm.cbm_addon.motion.resample import frame_times, resample
    from bl_ext.user_default.cbm.cbm_addon.takes.sample_motion import sample_motion

    motion = sample_motion()
    (tmp_path / "clips").mkdir()
    for i in range(2):
        write_bvh(tmp_path / "clips" / f"clip{i}.bvh", resample(motion, frame_times(10.0 * i, 10.0 * i + 5, 30)))
    (tmp_path / "tiny.toml").write_text("channels = 4\nclasses = 4\nhidden = 16\nepochs = 1\nbatch = 32\n")
    finished = bpy.ops.cbm.train_model(data=str(tmp_path / "clips"), output=str(tmp_path / "model"), python=sys.executable, config=str(tmp_path / "tiny.toml"))
    assert finished == {"FINISHED"}
    assert bpy.ops.cbm.load_model(directory=str(tmp_path / "model")) == {"FINISHED"}


def test_training_that_cannot_begin_says_why_in_one_line(extension: ModuleType, tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match="is not an interpreter"):
        bpy.ops.cbm.train_model(data=str(tmp_path), output=str(tmp_path / "model"), python="/nonexistent/python")
    with pytest.raises(RuntimeError, match="holds no BVH files"):
        bpy.ops.cbm.train_model(data=str(tmp_path), output=str(tmp_path / "model"), python=sys.executable)
    assert not (tmp_path / "model").exists()
