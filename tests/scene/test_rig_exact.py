"""Blender's own evaluation is the oracle: the bones of a rig stand where the solved body has its joints."""

from __future__ import annotations

import bpy
import numpy as np
import pytest

from cbm_addon.errors import InputError
from cbm_addon.motion.motion import Motion
from cbm_addon.motion.rotations import matrix_from_quat, multiply, quat_from_matrix, quat_from_rotvec
from cbm_addon.rigs.body import RigBody, rig_body
from cbm_addon.rigs.rig import Rig
from cbm_addon.scene.action import write_action
from cbm_addon.scene.bake import rig_channels
from cbm_addon.scene.rig import find_armature, read_rig
from tests.evaluated import evaluated

FRAMES = 6
TENTH_OF_A_MILLIMETRE = 1e-4


@pytest.fixture(params=["human", "metarig"])
def armature(request) -> bpy.types.Object:
    """A generated rig, and a plain skeleton."""
    return request.getfixturevalue(request.param)


def a_motion(solved: RigBody, bend: float = 0.6) -> Motion:
    """Poses in which every joint is turned every way, and the body is anywhere."""
    random = np.random.default_rng(4)
    rotations = quat_from_rotvec(random.uniform(-bend, bend, (FRAMES, len(solved.body), 3))).astype(np.float32)
    return Motion(solved.body, np.arange(FRAMES) / 24, random.uniform(-1, 1, (FRAMES, 3)).astype(np.float32), rotations)


def put_on(armature: bpy.types.Object, rig: Rig, solved: RigBody, motion: Motion) -> None:
    write_action(armature, "test", np.arange(FRAMES) + 1.0, rig_channels(armature, rig, solved, motion))


def move(armature: bpy.types.Object) -> None:
    """Turned, scaled and below a parent that is turned itself."""
    parent = bpy.data.objects.new("Parent", None)
    bpy.context.scene.collection.objects.link(parent)
    parent.location, parent.rotation_euler = (3, -1, 0), (0, 0, 2)
    armature.parent = parent
    armature.location, armature.rotation_euler, armature.scale = (0, 1, 0), (0, 0, 0.7), (1.5, 1.5, 1.5)


@pytest.mark.parametrize("moved", [False, True], ids=["at the origin", "moved, turned and scaled"])
def test_joints_land_where_they_were_solved(armature, moved):
    if moved:
        move(armature)
    rig = read_rig(armature)
    solved = rig_body(rig)
    motion = a_motion(solved)
    put_on(armature, rig, solved, motion)
    joints = [rig.mapping.joints[name] for name in solved.body.names]
    positions = evaluated(armature, joints, FRAMES)[..., :3, 3]
    np.testing.assert_allclose(positions, motion.positions(), atol=TENTH_OF_A_MILLIMETRE)
    deforming = [bone.replace("ORG-", "DEF-") for bone in joints]
    np.testing.assert_allclose(evaluated(armature, deforming, FRAMES)[..., :3, 3], motion.positions(), atol=TENTH_OF_A_MILLIMETRE)


def test_bones_are_turned_as_their_joints_and_never_scaled(armature):
    """Except the middle of a generated spine, whose twist Rigify spreads itself between hips and chest."""
    rig = read_rig(armature)
    solved = rig_body(rig)
    motion = a_motion(solved)
    put_on(armature, rig, solved, motion)
    spread = {"Spine", "Spine1"} if rig.mapping.kind == "rigify_generated" else set()
    kept = [i for i, name in enumerate(solved.body.names) if name not in spread]
    bones = [rig.mapping.joints[solved.body.names[i]] for i in kept]
    rest = np.stack([quat_from_matrix(rig.rest[rig.index(bone), :3, :3]) for bone in bones])
    world = motion.forward()[0][:, kept]
    expected = matrix_from_quat(multiply(multiply(world, solved.alignment[kept]), rest))
    np.testing.assert_allclose(evaluated(armature, bones, FRAMES)[..., :3, :3], expected, atol=1e-3)


def test_a_rig_is_read_without_changing_it(human):
    values = {(bone.name, name): value for bone in human.pose.bones for name, value in bone.items() if isinstance(value, (int, float))}
    rest = np.array([bone.matrix_local for bone in human.data.bones])
    rig = read_rig(human)
    solved = rig_body(rig)
    put_on(human, rig, solved, a_motion(solved))
    human.animation_data.action = None
    after = {(bone.name, name): value for bone in human.pose.bones for name, value in bone.items() if isinstance(value, (int, float))}
    assert after == values
    np.testing.assert_array_equal(np.array([bone.matrix_local for bone in human.data.bones]), rest)


def test_a_generated_rig_keys_its_forward_kinematics_and_the_switches_it_needs(human):
    rig = read_rig(human)
    solved = rig_body(rig)
    paths = {channel.data_path for channel in rig_channels(human, rig, solved, a_motion(solved))}
    assert 'pose.bones["thigh_parent.L"]["IK_FK"]' in paths
    assert 'pose.bones["foot_fk.R"].rotation_quaternion' in paths
    assert 'pose.bones["torso"].location' in paths
    assert not [path for path in paths if "ORG-" in path or "DEF-" in path or "_ik" in path or "scale" in path]


def test_an_armature_that_is_scaled_unevenly_is_refused(metarig):
    metarig.scale = (1, 1, 2)
    with pytest.raises(InputError, match="apply the scale"):
        read_rig(metarig)


def test_hips_that_cannot_move_are_refused(metarig):
    bpy.ops.object.mode_set(mode="EDIT")
    root = metarig.data.edit_bones.new("root")
    root.head, root.tail = (0, 0, 0), metarig.data.edit_bones["spine"].head
    metarig.data.edit_bones["spine"].parent = root
    metarig.data.edit_bones["spine"].use_connect = True
    bpy.ops.object.mode_set(mode="OBJECT")
    with pytest.raises(InputError, match="spine must move"):
        read_rig(metarig)


def test_a_missing_armature_is_named_beside_those_that_are_there(metarig):
    with pytest.raises(InputError, match="Nobody: .*metarig"):
        find_armature("Nobody")
