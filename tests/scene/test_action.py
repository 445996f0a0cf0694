"""Actions: what is written is what Blender evaluates, and nothing that was there before changes."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from cbm_addon.errors import InputError
from cbm_addon.motion.rotations import matrix_from_quat, normalize
from cbm_addon.motion.skeleton import STANDARD_BODY
from cbm_addon.scene.action import Channel, action_curves, key_frames, pose_path, rotation_channel, scene_frames, scene_rate, write_action
from cbm_addon.scene.armature import new_armature

FRAMES = np.arange(5, 15)
MODES = ["QUATERNION", "AXIS_ANGLE", "XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"]


@pytest.fixture
def cube(empty_scene: bpy.types.Scene) -> bpy.types.Object:
    obj = bpy.data.objects.new("Cube", None)
    empty_scene.collection.objects.link(obj)
    return obj


@pytest.fixture
def body(empty_scene: bpy.types.Scene) -> bpy.types.Object:
    return new_armature(bpy.context, "Body", STANDARD_BODY)


def locations(seed: int = 0) -> Channel:
    return Channel("location", np.random.default_rng(seed).normal(size=(len(FRAMES), 3)).astype(np.float32), "Object Transforms")


def rotations(seed: int = 0) -> np.ndarray:
    return normalize(np.random.default_rng(seed).normal(size=(len(FRAMES), 4))).astype(np.float32)


def keys(curve: bpy.types.FCurve) -> np.ndarray:
    return np.array([point.co for point in curve.keyframe_points])


def test_the_object_does_what_the_channels_say(cube, empty_scene):
    channel = locations()
    write_action(cube, "Walk", FRAMES, [channel])
    for frame, expected in zip(FRAMES, channel.values, strict=True):
        empty_scene.frame_set(int(frame))
        assert np.allclose(cube.matrix_world.translation, expected, atol=1e-6)


def test_between_keys_values_are_linear(cube, empty_scene):
    channel = locations()
    write_action(cube, "Walk", FRAMES, [channel])
    empty_scene.frame_set(7, subframe=0.5)
    assert np.allclose(cube.matrix_world.translation, channel.values[2:4].mean(axis=0), atol=1e-6)


def test_every_curve_has_a_key_at_every_frame_and_belongs_to_the_group(cube):
    write_action(cube, "Walk", FRAMES, [locations()])
    curves = action_curves(cube)
    assert [(curve.data_path, curve.array_index) for curve in curves] == [("location", 0), ("location", 1), ("location", 2)]
    assert all(np.array_equal(keys(curve)[:, 0], FRAMES) for curve in curves)
    assert {curve.group.name for curve in curves} == {"Object Transforms"}
    assert np.array_equal(key_frames(cube), FRAMES)


def test_handles_lie_with_their_keys(cube):
    """Blender frames its graph editor by them, and a curve made smooth later starts from them."""
    write_action(cube, "Walk", FRAMES, [locations()])
    for curve in action_curves(cube):
        assert all(point.co.x - 1 <= point.handle_left.x <= point.co.x <= point.handle_right.x <= point.co.x + 1 for point in curve.keyframe_points)


def test_a_component_that_never_changes_has_one_key(cube, empty_scene):
    values = np.tile(np.array([0.5, 0, 0], dtype=np.float32), (len(FRAMES), 1))
    values[:, 2] = FRAMES
    write_action(cube, "Walk", FRAMES, [Channel("location", values, "Move")])
    assert [len(curve.keyframe_points) for curve in action_curves(cube)] == [1, 1, len(FRAMES)]
    empty_scene.frame_set(10)
    assert np.allclose(cube.matrix_world.translation, [0.5, 0, 10])


def test_keys_may_lie_between_frames(cube):
    frames = np.linspace(1, 2, len(FRAMES))
    write_action(cube, "Walk", frames, [locations()])
    assert np.allclose(key_frames(cube), frames, atol=1e-6)


def test_each_writing_is_a_new_action_and_leaves_the_others_as_they_were(cube):
    first = write_action(cube, "Walk", FRAMES, [locations(0)])
    before = [keys(curve) for curve in action_curves(cube)]
    second = write_action(cube, "Walk", FRAMES, [locations(1)])
    assert second != first
    assert cube.animation_data.action == second
    assert first.name in bpy.data.actions
    cube.animation_data.action = first
    if hasattr(first, "slots"):
        cube.animation_data.action_slot = first.slots[0]
    assert all(np.array_equal(keys(curve), old) for curve, old in zip(action_curves(cube), before, strict=True))


@pytest.mark.parametrize("fake_user", [True, False])
def test_an_action_survives_without_users_if_asked_to(cube, fake_user):
    assert write_action(cube, "Walk", FRAMES, [locations()], fake_user=fake_user).use_fake_user == fake_user


@pytest.mark.parametrize("mode", MODES)
def test_rotations_arrive_whatever_the_bones_rotation_mode(body, empty_scene, mode):
    bone = body.pose.bones["LeftArm"]
    bone.rotation_mode = mode
    quaternions = rotations()
    write_action(body, "Wave", FRAMES, [rotation_channel(bone, quaternions)])
    assert bone.rotation_mode == mode
    for frame, expected in zip(FRAMES, matrix_from_quat(quaternions), strict=True):
        empty_scene.frame_set(int(frame))
        assert np.allclose(np.array(bone.matrix_basis)[:3, :3], expected, atol=1e-5)


@pytest.mark.parametrize("mode", MODES)
def test_a_steady_turn_has_no_jump_between_keys(body, empty_scene, mode):
    """About a fixed axis, twice around: half-way between two keys the bone is half-way between their poses."""
    bone = body.pose.bones["LeftArm"]
    bone.rotation_mode = mode
    frames = np.arange(121)
    half = np.radians(3.0 * frames)[:, None]
    quaternions = np.concatenate((np.cos(half), np.sin(half) * np.array([0.48, 0.6, 0.64])), axis=-1)
    quaternions[::7] *= -1
    write_action(body, "Turn", frames, [rotation_channel(bone, quaternions.astype(np.float32))])
    for frame in range(0, 120, 5):
        empty_scene.frame_set(frame, subframe=0.5)
        middle = np.radians(3.0 * (frame + 0.5))
        expected = np.array([np.cos(middle), *(np.sin(middle) * np.array([0.48, 0.6, 0.64]))])
        assert np.allclose(np.array(bone.matrix_basis)[:3, :3], matrix_from_quat(expected), atol=0.02)


def test_names_with_quotes_and_backslashes_are_escaped(body, empty_scene):
    bone = body.pose.bones["LeftArm"]
    bone.name = 'Left "Arm" \\ 1'
    write_action(body, "Wave", FRAMES, [Channel(pose_path(bone.name, "location"), locations().values, bone.name)])
    empty_scene.frame_set(5)
    assert np.allclose(bone.location, locations().values[0])


def test_custom_properties_can_be_keyed(body, empty_scene):
    body["IK"] = 0.0
    write_action(body, "Switch", FRAMES, [Channel('["IK"]', np.linspace(0, 1, len(FRAMES), dtype=np.float32)[:, None], "Settings")])
    empty_scene.frame_set(14)
    assert body["IK"] == 1


def test_seconds_become_frames_by_the_scenes_rate(empty_scene):
    empty_scene.render.fps, empty_scene.render.fps_base = 30, 1.001
    assert np.isclose(scene_rate(empty_scene), 29.97003)
    assert np.allclose(scene_frames(empty_scene, np.array([0, 1.001]), 10), [10, 40])


def test_an_object_in_tweak_mode_is_refused_before_anything_is_made(cube):
    data = cube.animation_data_create()
    data.nla_tracks.new().strips.new("Old", 1, bpy.data.actions.new("Old"))
    data.use_tweak_mode = True
    with pytest.raises(InputError, match="tweak mode"):
        write_action(cube, "Walk", FRAMES, [locations()])
    assert [action.name for action in bpy.data.actions] == ["Old"]


def test_an_object_without_animation_has_no_curves(cube):
    assert action_curves(cube) == []
    assert len(key_frames(cube)) == 0
