"""A bake: a take becomes a new action, and nothing else of the file changes."""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np
import pytest

from cbm_addon.motion.contacts import contact_labels
from cbm_addon.motion.rotations import multiply, quat_from_rotvec
from cbm_addon.motion.skeleton import BODY_JOINTS
from cbm_addon.motion.transfer import transfer
from cbm_addon.progress import run
from cbm_addon.rigs.body import rig_body
from cbm_addon.scene.action import action_curves, curves_of, rotation_channel, write_action
from cbm_addon.scene.bake import BakeOptions, BakeReport, bake, rig_channels, take_scale
from cbm_addon.scene.rig import read_rig
from cbm_addon.solve.models import load_model
from cbm_addon.solve.perform import SolveOptions, sampled
from cbm_addon.takes.calibrate import Calibrated, CalibrationOptions, calibrate
from cbm_addon.takes.sample_motion import sample_motion, sample_take
from cbm_addon.takes.take import Take

SECONDS = 3.0
UPPER = ("chest", "spine_fk.002", "neck", "head", "upper_arm_fk.L", "forearm_fk.R", "hand_fk.L")
FINGER = ("f_index.01.L",)
FRAMES_OF_A_WALK = (1, 13, 30, 55, 72)
LEGS = ("ORG-thigh.L", "ORG-shin.L", "ORG-foot.L", "ORG-thigh.R", "ORG-shin.R", "ORG-foot.R")


@pytest.fixture(scope="module")
def model():
    return load_model()


@pytest.fixture(scope="module")
def calibrated() -> Calibrated:
    """Three seconds from the middle of the first walk of the sample take."""
    take = sampled(sample_take(), 2 + np.arange(0, SECONDS, 1 / 72))
    return calibrate(replace(take, name="walk", times=take.times - take.times[0]))


def bake_on(armature: bpy.types.Object, calibrated: Calibrated, model, part: str = "full", variation: int = 0) -> BakeReport:
    return run(bake(bpy.context, armature, calibrated, model, BakeOptions(part, SolveOptions(variation=variation))))


def keyed_bones(armature: bpy.types.Object) -> set[str]:
    return {curve.data_path.split('"')[1] for curve in action_curves(armature)}


def pose_at(armature: bpy.types.Object, frame: float, bones: tuple[str, ...]) -> np.ndarray:
    """Bases [B, 4, 4] of pose bones: what the animator's own channels say, whatever the body does."""
    bpy.context.scene.frame_set(int(frame))
    return np.array([armature.pose.bones[bone].matrix_basis for bone in bones])


def heads_at(armature: bpy.types.Object, frames: np.ndarray, bones: tuple[str, ...]) -> np.ndarray:
    """World positions [T, B, 3] of evaluated bones."""
    heads = []
    for frame in frames:
        bpy.context.scene.frame_set(int(frame))
        posed = armature.evaluated_get(bpy.context.evaluated_depsgraph_get())
        heads.append([posed.matrix_world @ posed.pose.bones[bone].head for bone in bones])
    return np.array(heads)


@pytest.mark.parametrize("rig", ["human", "metarig"])
def test_head_and_wrists_meet_the_trackers_on_the_rig(request, model, calibrated, rig):
    armature = request.getfixturevalue(rig)
    report = bake_on(armature, calibrated, model)
    take, scene = calibrated.take, bpy.context.scene
    frames = scene.frame_start + np.arange(0, report.frames, 7)
    trackers = sampled(take, (frames - scene.frame_start) / report.fps).positions * report.scale
    joints = read_rig(armature).mapping.joints
    errors = np.linalg.norm(heads_at(armature, frames, (joints["Head"], joints["LeftHand"], joints["RightHand"])) - trackers, axis=-1)
    assert np.percentile(errors, 95) < 0.01
    assert report.tracker_errors["head"].p95_cm == pytest.approx(100 * np.percentile(errors[:, 0], 95), abs=0.01)


def test_an_armature_of_any_size_gets_the_same_performance(metarig, model, calibrated):
    """The take is scaled to the rig: a doll does what a giant does."""
    frames = np.array([1, 20, 40, 60])
    heights = []
    for size in (1.0, 0.1, 30.0):
        metarig.scale = (size, size, size)
        bake_on(metarig, calibrated, model)
        heights.append(heads_at(metarig, frames, ("spine", "foot.L", "hand.R")) / size)
    np.testing.assert_allclose(heights[1], heights[0], atol=2e-3)
    np.testing.assert_allclose(heights[2], heights[0], atol=2e-3)


@pytest.mark.parametrize(("fps", "base"), [(24, 1.0), (60, 1.0), (30, 1.001)])
def test_seconds_stay_seconds_at_the_rate_of_the_scene(metarig, model, calibrated, fps, base):
    scene = bpy.context.scene
    scene.render.fps, scene.render.fps_base, scene.frame_start = fps, base, 101
    report = bake_on(metarig, calibrated, model)
    action = bpy.data.actions[report.action]
    assert report.fps == pytest.approx(fps / base)
    assert action.frame_range[0] == 101
    assert (action.frame_range[1] - 101) / report.fps == pytest.approx(calibrated.take.seconds, abs=1 / report.fps)


def test_a_take_of_90_hz_in_a_scene_of_24_fps_goes_on_beyond_the_scenes_end(metarig, model):
    """Ends are the take's and not the scene's; between its samples the take is where it would have been."""
    take = sampled(sample_take(), np.arange(0, 11, 1 / 90))
    scene = bpy.context.scene
    scene.render.fps, scene.frame_start, scene.frame_end = 24, 1, 250
    report = bake_on(metarig, calibrate(take), model)
    assert (scene.frame_start, scene.frame_end, scene.render.fps) == (1, 250, 24)
    assert bpy.data.actions[report.action].frame_range[1] == 1 + 24 * 11 - 1
    frames = np.array([2, 100, 251, 263])
    trackers = sampled(calibrate(take).take, (frames - 1) / 24).positions[:, 0] * report.scale
    np.testing.assert_allclose(heads_at(metarig, frames, ("spine.006",))[:, 0], trackers, atol=1e-3)


def test_only_an_action_is_added(human, model, calibrated):
    human.pose.bones["jaw_master"].location = (0, 0.01, 0)
    scene = bpy.context.scene
    scene.frame_set(7, subframe=0.25)
    settings = [(scene.render.fps, scene.render.fps_base, scene.frame_start, scene.frame_end, scene.frame_current, scene.frame_subframe)]
    objects, meshes = set(bpy.data.objects), set(bpy.data.meshes)
    report = bake_on(human, calibrated, model)
    assert settings == [(scene.render.fps, scene.render.fps_base, scene.frame_start, scene.frame_end, scene.frame_current, scene.frame_subframe)]
    assert (set(bpy.data.objects), set(bpy.data.meshes)) == (objects, meshes)
    assert [action.name for action in bpy.data.actions] == [report.action] == ["walk_variation0"]
    assert human.pose.bones["jaw_master"].location.y == pytest.approx(0.01)
    rig = read_rig(human)
    controls = [control for control in rig.mapping.controls if control.limbs != "ik"]
    body = [control.bone for control in controls if control.joint in BODY_JOINTS]  # a take knows nothing of fingers
    assert keyed_bones(human) == {*body, *(setting.bone for setting in rig.mapping.settings if setting.limbs != "ik")}
    assert not [curve for curve in action_curves(human) if curve.data_path.endswith("scale")]


def test_the_action_that_was_there_is_kept_when_the_file_is_saved(metarig, model, calibrated, tmp_path):
    first = bake_on(metarig, calibrated, model)
    bpy.data.actions[first.action].use_fake_user = False
    second = bake_on(metarig, calibrated, model, variation=1)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "saved.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "saved.blend"))
    assert {first.action, second.action} <= set(bpy.data.actions.keys())
    assert bpy.data.objects["metarig"].animation_data.action.name == second.action


def test_variations_differ_and_the_same_variation_does_not(metarig, model, calibrated):
    frames = np.arange(1, 70, 6)
    feet = []
    for variation in (0, 3, 3):
        bake_on(metarig, calibrated, model, variation=variation)
        feet.append(heads_at(metarig, frames, ("foot.L", "foot.R")))
    np.testing.assert_array_equal(feet[1], feet[2])
    assert np.abs(feet[0] - feet[1]).max() > 0.01


def an_animators_action(armature: bpy.types.Object, calibrated: Calibrated) -> bpy.types.Action:
    """Keys on the whole body, legs, hips and a finger too, at other frames than the take's: another performer's walk where the take walks."""
    rig = read_rig(armature)
    solved = rig_body(rig)
    own = sample_motion()
    frames = np.searchsorted(own.times, 2 + np.linspace(0, SECONDS, 40))
    scale = take_scale(solved, calibrated)
    motion = transfer(replace(own, times=own.times[frames], root=own.root[frames], rotations=own.rotations[frames]), solved.body, scale)
    lean = multiply(quat_from_rotvec(np.array([0, 0, 0.3])), motion.rotations[:, 0])  # not quite the take's
    motion = replace(motion, root=motion.root + np.array([0.05, 0.02, -0.03], np.float32), rotations=motion.rotations.copy())
    motion.rotations[:, 0] = lean
    channels = list(rig_channels(armature, rig, solved, motion))
    turns = quat_from_rotvec(np.linspace(0, 1, 40)[:, None] * np.array([[1.0, 0, 0]]))
    channels.append(rotation_channel(armature.pose.bones[FINGER[0]], turns))
    return write_action(armature, "animator", 10 + 1.5 * np.arange(40), channels, fake_user=False)


def tracked_at(armature: bpy.types.Object, frames: tuple[int, ...]) -> np.ndarray:
    """World matrices [T, 3, 4, 4] of the evaluated bones of head and wrists."""
    rig = read_rig(armature)
    bones = [rig.mapping.joints[name] for name in ("Head", "LeftHand", "RightHand")]
    matrices = []
    for frame in frames:
        bpy.context.scene.frame_set(frame)
        posed = armature.evaluated_get(bpy.context.evaluated_depsgraph_get())
        matrices.append([np.array(posed.matrix_world @ posed.pose.bones[bone].matrix) for bone in bones])
    return np.array(matrices)


@pytest.mark.parametrize("rig", ["human", "metarig"])
def test_the_lower_part_keeps_head_and_wrists_of_an_animation_where_they_were(request, model, calibrated, rig):
    armature = request.getfixturevalue(rig)
    action = an_animators_action(armature, calibrated)
    before = tracked_at(armature, FRAMES_OF_A_WALK)
    hips = heads_at(armature, np.array(FRAMES_OF_A_WALK), (read_rig(armature).mapping.joints["Hips"],))
    fingers = [pose_at(armature, frame, FINGER) for frame in FRAMES_OF_A_WALK]
    curves = [(curve.data_path, curve.array_index, len(curve.keyframe_points)) for curve in action_curves(armature)]
    report = bake_on(armature, calibrated, model, part="lower")
    after = tracked_at(armature, FRAMES_OF_A_WALK)
    np.testing.assert_allclose(after[:, 0, :3, 3], before[:, 0, :3, 3], atol=1e-3)
    np.testing.assert_allclose(after[:, 1:, :3, 3], before[:, 1:, :3, 3], atol=5e-3)  # an arm that was stretched may now be too short by this
    np.testing.assert_allclose(after[..., :3, :3], before[..., :3, :3], atol=0.01)
    assert max(error.median_cm for error in report.tracker_errors.values()) < 0.1
    assert np.linalg.norm(heads_at(armature, np.array(FRAMES_OF_A_WALK), (read_rig(armature).mapping.joints["Hips"],)) - hips, axis=-1).max() > 0.01
    for frame, expected in zip(FRAMES_OF_A_WALK, fingers, strict=True):
        np.testing.assert_allclose(pose_at(armature, frame, FINGER), expected, atol=1e-6)
    rig = read_rig(armature)
    assert keyed_bones(armature) <= {item.bone for item in (*rig.mapping.controls, *rig.mapping.settings) if item.lower}
    above = armature.animation_data.nla_tracks[-1].strips[0].action
    assert above.name == "walk_variation0_upper"
    assert not {curve.data_path.split('"')[1] for curve in curves_of(above, above.slots[0] if hasattr(above, "slots") else None)} & set(FINGER)
    armature.animation_data.action = action
    assert [(curve.data_path, curve.array_index, len(curve.keyframe_points)) for curve in action_curves(armature)] == curves


def test_the_lower_part_goes_where_the_take_goes(metarig, model, calibrated):
    """Feet are those of a full bake of the same take, as far as the legs reach from where the upper body is."""
    bake_on(metarig, calibrated, model)
    full = heads_at(metarig, np.array(FRAMES_OF_A_WALK), ("foot.L", "foot.R"))
    an_animators_action(metarig, calibrated)
    bake_on(metarig, calibrated, model, part="lower")
    apart = np.linalg.norm(heads_at(metarig, np.array(FRAMES_OF_A_WALK), ("foot.L", "foot.R")) - full, axis=-1)
    assert np.median(apart) < 0.01


def test_the_lower_part_of_a_rig_without_an_animation_keys_hips_and_legs_alone(human, model, calibrated):
    bake_on(human, calibrated, model)
    legs = heads_at(human, np.array(FRAMES_OF_A_WALK), LEGS)
    human.animation_data.action = None
    for bone in human.pose.bones:
        bone.matrix_basis.identity()
    report = bake_on(human, calibrated, model, part="lower")
    np.testing.assert_allclose(heads_at(human, np.array(FRAMES_OF_A_WALK), LEGS), legs, atol=1e-4)
    rig = read_rig(human)
    assert keyed_bones(human) == {item.bone for item in (*rig.mapping.controls, *rig.mapping.settings) if item.lower and item.limbs != "ik"}
    assert not keyed_bones(human) & set(UPPER)
    assert report.tracker_errors == {}


def test_an_animation_that_is_elsewhere_than_the_take_is_carried_along_as_it_is(human, model, calibrated):
    an_animators_action(human, calibrated)
    for curve in action_curves(human):
        if curve.data_path == 'pose.bones["torso"].location' and curve.array_index == 0:
            for point in curve.keyframe_points:
                point.co[1] += 4
            curve.update()
    before = [pose_at(human, frame, UPPER) for frame in FRAMES_OF_A_WALK]
    report = bake_on(human, calibrated, model, part="lower")
    for frame, expected in zip(FRAMES_OF_A_WALK, before, strict=True):
        np.testing.assert_allclose(pose_at(human, frame, UPPER), expected, atol=1e-6)
    assert not keyed_bones(human) & set(UPPER)
    assert report.tracker_errors == {}


def test_a_second_lower_part_takes_the_place_of_the_first(metarig, model, calibrated):
    an_animators_action(metarig, calibrated)
    before = tracked_at(metarig, FRAMES_OF_A_WALK)
    for variation in (0, 1):
        bake_on(metarig, calibrated, model, part="lower", variation=variation)
    np.testing.assert_allclose(tracked_at(metarig, FRAMES_OF_A_WALK)[..., :3, 3], before[..., :3, 3], atol=5e-3)
    strips = [strip.action.name for track in metarig.animation_data.nla_tracks for strip in track.strips]
    assert strips == ["animator", "walk_variation0_upper", "walk_variation1_upper"]
    assert [track.mute for track in metarig.animation_data.nla_tracks] == [False, True, False]
    assert metarig.animation_data.action.name == "walk_variation1"
    assert "walk_variation0" in bpy.data.actions


def test_a_cancelled_bake_changes_nothing(metarig, model, calibrated):
    job = bake(bpy.context, metarig, calibrated, model, BakeOptions())
    events = [next(job) for _ in range(3)]
    job.close()
    assert [event.share for event in events] == sorted(event.share for event in events)
    assert not bpy.data.actions
    assert metarig.animation_data is None


def test_planted_feet_stand_still_on_the_rig(metarig, model, calibrated):
    """Ankles in contact by the engine's own rule drift less than 6 cm a second while the body walks."""
    report = bake_on(metarig, calibrated, model)
    frames = bpy.context.scene.frame_start + np.arange(report.frames)
    rig = read_rig(metarig)
    body = rig_body(rig).body
    positions = heads_at(metarig, frames, tuple(rig.mapping.joints[name] for name in body.names))
    contacts = contact_labels(body, positions, report.fps)
    feet = positions[:, body.indices(["LeftFoot", "LeftToe", "RightFoot", "RightToe"]), :2]
    speed = np.linalg.norm(np.gradient(feet, axis=0), axis=-1) * report.fps
    assert contacts.mean() > 0.3
    assert np.median(speed[contacts]) < 0.06


@pytest.mark.needs_data
@pytest.mark.parametrize("recording", ["xror/bsor_sample1_anon.bsor", "kinematic_maze/moore_cross_domain23_fixed.csv"])
def test_real_recordings_meet_their_trackers(human, model, data_folder, recording):
    from cbm_addon.takes.readers import read_take

    calibrated = calibrate(read_take(data_folder / "takes" / recording))
    report = bake_on(human, calibrated, model)
    assert min(error.share_within_1_cm for error in report.tracker_errors.values()) >= 0.95
    for curve in action_curves(human):
        keys = np.empty(2 * len(curve.keyframe_points), dtype=np.float32)
        curve.keyframe_points.foreach_get("co", keys)
        assert np.isfinite(keys).all(), curve.data_path
    assert report.frames == pytest.approx(calibrated.take.seconds * report.fps, abs=1)


def test_takes_and_trackers_share_the_origin_of_the_world(metarig, model, calibrated):
    """Wherever the armature stands, the body walks where the take was recorded, scaled about the world's origin."""
    metarig.location, metarig.rotation_euler = (5, 4, 0), (0, 0, 1.2)
    report = bake_on(metarig, calibrated, model)
    start: Take = sampled(calibrated.take, np.zeros(1))
    np.testing.assert_allclose(heads_at(metarig, np.array([1]), ("spine.006",))[0, 0], start.positions[0, 0] * report.scale, atol=1e-3)


def test_the_report_says_what_the_model_finds_wrong_with_the_calibration(human, model, calibrated):
    assert bake_on(human, calibrated, model).warnings == ()
    taller = calibrate(sampled(sample_take(), 2 + np.arange(0, SECONDS, 1 / 72)), CalibrationOptions(eye_height=1.9))
    (warning,) = bake_on(human, taller, model).warnings
    assert "as tall as is believed" in warning
