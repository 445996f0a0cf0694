"""Finger posing in a scene: what Blender evaluates afterwards pierces nothing, and what the user animated is as it was."""

from __future__ import annotations

from collections.abc import Callable

import bpy
import numpy as np
import pytest

from cbm_addon.errors import InputError
from cbm_addon.hands.avoid import FingerOptions
from cbm_addon.hands.hand import RADII
from cbm_addon.hands.shapes import Sphere
from cbm_addon.motion.resample import frame_times
from cbm_addon.progress import run
from cbm_addon.rigs.fingers import finger_bones
from cbm_addon.rigs.rig import FINGERS, SIDES
from cbm_addon.scene.action import curves_of
from cbm_addon.scene.fingers import FingerReport, PoseOptions, pose_fingers
from cbm_addon.scene.rig import read_rig
from cbm_addon.scene.rigify import rigify_metarig
from cbm_addon.takes.take import Take
from tests.hand_scenes import SCENES, HandScene, add_things, animate, evaluated_matrices, strip_curves
from tests.sample_rigs import SAMPLE_RIGS, add_armature, bones_at_rest, renamed

FRAMES = 12
RADIUS = 0.04
BALL = HandScene({"Arm": ((0, 0, 0), (0, 1, 0))}, ("relaxed", "cup"))


def sample(name: str, pose: str = "A", scale: float = 1.0) -> bpy.types.Object:
    return add_armature(bones_at_rest(next(sample for sample in SAMPLE_RIGS if sample.name == name), pose, scale=scale))


@pytest.fixture
def mixamo(empty_scene: bpy.types.Scene) -> bpy.types.Object:
    return sample("Mixamo")


def add_ball(armature: bpy.types.Object, name: str = "Ball") -> tuple[bpy.types.Object, Sphere]:
    """A ball below the left palm that closing fingers enter, and the same as a shape in the world."""
    rig = read_rig(armature)
    fingers = finger_bones(rig, "Left")
    size = fingers.length / 0.19
    joints = [rig.mapping.joints["LeftHand"], str(fingers.bones[3 * FINGERS.index("Middle")])]
    wrist, knuckle = (matrices[0, :3, 3] for matrices in evaluated_matrices(armature, joints, np.array([bpy.context.scene.frame_start])).values())
    centre = knuckle + (knuckle - wrist) / np.linalg.norm(knuckle - wrist) * 0.03 * size - np.array([0, 0, RADIUS + 0.022]) * size
    bpy.ops.mesh.primitive_uv_sphere_add(segments=64, ring_count=48, radius=RADIUS * size, location=centre)
    bpy.context.object.name = name
    return bpy.context.object, Sphere(centre.astype(np.float32), RADIUS * size)


def depths(armature: bpy.types.Object, shape: Sphere, side: str = "Left") -> np.ndarray:
    """How deep the deepest phalanx is in a shape at each frame [T], metres, as the dependency graph has the bones."""
    rig = read_rig(armature)
    fingers = finger_bones(rig, side)
    numbers = bpy.context.scene.frame_start + np.arange(FRAMES)
    matrices = evaluated_matrices(armature, [bone for bone in fingers.bones if bone], numbers)
    radii, tips = RADII * fingers.length, fingers.positions[15:]
    deepest = np.full(FRAMES, -np.inf)
    for finger in range(len(FINGERS)):
        bones = [str(fingers.bones[3 * finger + phalanx]) for phalanx in range(3)]
        length = np.linalg.norm(tips[finger] - fingers.positions[3 * finger + 2])
        heads = [matrices[bone][:, :3, 3] for bone in bones]
        axes = matrices[bones[2]][:, :3, :3] @ np.linalg.inv(rig.object_matrix[:3, :3] @ rig.rest[rig.index(bones[2]), :3, :3])
        straight = rig.rest[rig.index(fingers.wrist), :3, :3] @ (tips[finger] - fingers.positions[3 * finger + 2])
        heads.append(heads[2] + np.einsum("tij,j->ti", axes, straight) * (1 - radii[3 * finger + 2] / length))
        for phalanx in range(3):
            for share in np.linspace(0.5 if (finger, phalanx) == (0, 0) else 0.2, 1, 5):
                points = heads[phalanx] + share * (heads[phalanx + 1] - heads[phalanx])
                deepest = np.maximum(deepest, radii[3 * finger + phalanx] - shape.nearest(points.astype(np.float32))[0])
    return deepest


def pose(armature: bpy.types.Object, **options) -> FingerReport:
    return run(pose_fingers(bpy.context, armature, PoseOptions(**options)))


def poses_of(armature: bpy.types.Object, bones) -> np.ndarray:
    return np.stack(list(evaluated_matrices(armature, bones, bpy.context.scene.frame_start + np.arange(FRAMES)).values()))


def unknown_names() -> bpy.types.Object:
    return add_armature(renamed(bones_at_rest(next(sample for sample in SAMPLE_RIGS if sample.name == "Unreal 5"), "A")))


RIGS: dict[str, Callable[[], bpy.types.Object]] = {
    "Mixamo": lambda: sample("Mixamo"),
    "Unreal 5, arms hanging": lambda: sample("Unreal 5", "hanging"),
    "VRM, a child": lambda: sample("VRM 1", "T", 0.6),
    "Daz": lambda: sample("Daz Genesis 8"),
    "Auto-Rig Pro": lambda: sample("Auto-Rig Pro export"),
    "bones without names": unknown_names,
    "Rigify metarig": lambda: rigify_metarig(bpy.context),
}


@pytest.mark.parametrize("add", RIGS.values(), ids=RIGS)
def test_fingers_that_pierced_rest_on_the_surface(empty_scene, add):
    armature = add()
    animate(armature, BALL, FRAMES)
    ball, shape = add_ball(armature)
    before = depths(armature, shape)
    assert before.max() > 0.01, "the scene must have something to mend"
    report = pose(armature)
    assert report.obstacles == [ball.name]
    assert report.off_by_deg < 0.1
    assert depths(armature, shape).max() < 1e-3
    hand = report.hands["Left"]
    assert (hand.wanted, hand.palm_inside, hand.pierced_after) == ("animation", 0, 0)
    assert hand.pierced_before == (before > 1e-3).sum()


def test_a_control_rig_whose_master_controls_bend_the_fingers_does_as_solved(human):
    """Rigify's helper bones between the phalanges follow controls of their own."""
    bpy.context.scene.frame_start = 1
    animate(human, BALL, FRAMES)
    human.pose.bones["f_index.01_master.L"].scale = 1, 0.7, 1
    _, shape = add_ball(human)
    assert depths(human, shape).max() > 0.005
    report = pose(human, sides=("Left",))
    assert report.off_by_deg < 0.1
    assert depths(human, shape).max() < 1e-3


def test_the_users_action_is_as_it_was_and_plays_on(mixamo):
    rig = animate(mixamo, BALL, FRAMES)
    add_ball(mixamo)
    user, body = mixamo.animation_data.action, list(rig.mapping.joints.values())
    keys = {
        (curve.data_path, curve.array_index): [tuple(point.co) for point in curve.keyframe_points]
        for curve in curves_of(user, getattr(mixamo.animation_data, "action_slot", None))
    }
    before = poses_of(mixamo, body)
    report = pose(mixamo)
    np.testing.assert_allclose(poses_of(mixamo, body), before, atol=1e-5)
    tracks = mixamo.animation_data.nla_tracks
    assert [track.strips[0].action.name for track in tracks] == ["user", report.action], "ours is above the user's, which keys the same bones"
    slot = getattr(tracks[0].strips[0], "action_slot", None)
    assert {(curve.data_path, curve.array_index): [tuple(point.co) for point in curve.keyframe_points] for curve in curves_of(user, slot)} == keys
    ours = {curve.data_path for curve in curves_of(bpy.data.actions[report.action], getattr(tracks[1].strips[0], "action_slot", None))}
    named = [bone for side in SIDES for bone in finger_bones(rig, side).controls]
    assert ours == {f'pose.bones["{bone}"].rotation_quaternion' for bone in named}


def test_an_action_without_finger_keys_stays_the_active_one(mixamo):
    rig = animate(mixamo, BALL, FRAMES)
    user = mixamo.animation_data.action
    fingers = {bone for side in SIDES for bone in finger_bones(rig, side).controls}
    for bone in fingers:
        mixamo.pose.bones[bone].rotation_quaternion = 1, 0, 0, 0
    strip_curves(mixamo, lambda curve: any(f'"{bone}"' in curve.data_path for bone in fingers))
    _, shape = add_ball(mixamo)
    report = pose(mixamo)
    assert mixamo.animation_data.action == user
    assert [track.name for track in mixamo.animation_data.nla_tracks] == [report.action]
    assert {hand.wanted for hand in report.hands.values()} == {"relaxed"}
    assert depths(mixamo, shape).max() < 1e-3


def test_outside_of_the_frames_the_users_fingers_show(mixamo):
    rig = animate(mixamo, BALL, FRAMES)
    add_ball(mixamo)
    bones = [str(bone) for bone in finger_bones(rig, "Left").bones]
    before = poses_of(mixamo, bones)
    report = pose(mixamo, frames=(4, 9))
    assert (report.first_frame, report.frames) == (4, 6)
    changed = np.abs(poses_of(mixamo, bones) - before).max(axis=(0, 2, 3)) > 1e-4
    assert not changed[[0, 1, 2, 9, 10, 11]].any()
    assert changed[3:9].any()


def test_posing_again_reads_the_users_fingers_and_replaces_the_earlier_result(mixamo):
    animate(mixamo, BALL, FRAMES)
    _, shape = add_ball(mixamo)
    first = pose(mixamo)
    posed = depths(mixamo, shape)
    again = pose(mixamo)
    assert again.hands["Left"].pierced_before == first.hands["Left"].pierced_before > 0
    np.testing.assert_allclose(depths(mixamo, shape), posed, atol=1e-5)
    assert [track.name for track in mixamo.animation_data.nla_tracks] == ["user", again.action]
    assert first.action in bpy.data.actions


def test_the_same_seed_gives_the_same_fingers(mixamo):
    animate(mixamo, BALL, FRAMES)
    add_ball(mixamo)
    actions = [bpy.data.actions[pose(mixamo, solve=FingerOptions(seed=3)).action] for _ in range(2)]
    values = [
        [point.co.y for curve in curves_of(action, action.slots[0] if hasattr(action, "slots") else None) for point in curve.keyframe_points]
        for action in actions
    ]
    assert values[0] == values[1]


def test_strength_zero_leaves_the_fingers_as_they_are(mixamo):
    animate(mixamo, BALL, FRAMES)
    _, shape = add_ball(mixamo)
    before = depths(mixamo, shape)
    pose(mixamo, solve=FingerOptions(strength=0))
    np.testing.assert_allclose(depths(mixamo, shape), before, atol=1.5e-3)  # the hand's joints are hinges, the rig's are free


def test_a_grasp_closes_fingers_that_were_away_from_the_surface(mixamo):
    animate(mixamo, HandScene(BALL.arm, ("relaxed", "relaxed")), FRAMES)
    _, shape = add_ball(mixamo)
    loose = pose(mixamo)
    gaps = -depths(mixamo, shape)
    pose(mixamo, solve=FingerOptions(grasp=True))
    assert np.abs(depths(mixamo, shape)).max() < 2e-3
    assert loose.hands["Left"].pierced_before < FRAMES or gaps.max() >= 0


def test_one_hand_alone_is_keyed_if_asked(mixamo):
    rig = animate(mixamo, BALL, FRAMES)
    report = pose(mixamo, sides=("Right",))
    assert list(report.hands) == ["Right"]
    paths = {curve.data_path for curve in curves_of(bpy.data.actions[report.action], mixamo.animation_data.nla_tracks[-1].strips[0].action_slot)}
    assert not [path for path in paths if any(f'"{bone}"' in path for bone in finger_bones(rig, "Left").controls)]


def test_triggers_and_grips_of_a_take_bend_the_fingers(mixamo):
    animate(mixamo, HandScene({}, ("flat", "flat")), FRAMES)
    times = frame_times(0, 1, 72)
    count = len(times)
    identity = np.tile(np.array([1, 0, 0, 0], np.float32), (count, 3, 1))
    extras = {"grip_left": np.linspace(0, 1, count, dtype=np.float32)}
    take = Take("pressed", times, np.zeros((count, 3, 3), np.float32), identity, np.ones((count, 3), bool), "joint", extras)
    report = pose(mixamo, take=take)
    assert (report.hands["Left"].wanted, report.hands["Right"].wanted) == ("controller", "animation")
    tips = poses_of(mixamo, ["mixamorig:LeftHandMiddle4", "mixamorig:LeftHand"])[..., :3, 3]
    reach = np.linalg.norm(tips[0] - tips[1], axis=-1)
    assert (np.diff(reach) < 0).all(), "the hand closes while the grip is pressed"


def test_hands_do_not_enter_each_other_nor_the_body(mixamo):
    for name in ("two hands", "thigh"):
        animate(mixamo, SCENES[name], FRAMES)
        report = pose(mixamo)
        hand = report.hands["Left"]
        assert hand.pierced_before > 0, name
        assert hand.pierced_after <= 0.2 * hand.pierced_before, name


def test_the_cap_of_a_mug_and_more_is_mended(mixamo):
    for name in ("sphere", "cube", "mug", "table top"):
        rig = animate(mixamo, SCENES[name], FRAMES)
        things = add_things(mixamo, rig, SCENES[name])
        hand = pose(mixamo).hands["Left"]
        assert hand.pierced_before > 2, name
        assert hand.pierced_after <= 0.1 * hand.pierced_before, name
        bpy.data.batch_remove(things)


def test_cancelling_changes_nothing(mixamo):
    animate(mixamo, BALL, FRAMES)
    add_ball(mixamo)
    pose(mixamo)
    tracks = [(track.name, track.mute) for track in mixamo.animation_data.nla_tracks]
    actions, frame = bpy.data.actions.keys(), bpy.context.scene.frame_current
    job = pose_fingers(bpy.context, mixamo, PoseOptions())
    for _ in range(FRAMES // 2):
        next(job)
    job.close()
    assert [(track.name, track.mute) for track in mixamo.animation_data.nla_tracks] == tracks
    assert (bpy.data.actions.keys(), bpy.context.scene.frame_current) == (actions, frame)


def test_what_cannot_be_posed_is_refused_before_anything_changes(mixamo):
    with pytest.raises(InputError, match="frames 9 to 3"):
        pose(mixamo, frames=(9, 3))
    animate(mixamo, BALL, FRAMES)
    pose(mixamo)
    mixamo.animation_data.nla_tracks[0].is_solo = True
    with pytest.raises(InputError, match="played alone"):
        pose(mixamo)
    bare = sample("motion capture")
    with pytest.raises(InputError, match="no bones for the fingers"):
        pose(bare)
    assert bare.animation_data is None
