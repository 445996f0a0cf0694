"""Fewer keys, by what Blender makes of them: joints stay within the tolerance, and standing feet stand."""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np
import pytest

from cbm_addon.motion.contacts import CONTACT_JOINTS, contact_labels
from cbm_addon.motion.motion import Motion
from cbm_addon.motion.transfer import transfer
from cbm_addon.progress import run
from cbm_addon.rigs.body import RigBody, rig_body
from cbm_addon.rigs.rig import Rig
from cbm_addon.scene.action import Channel, action_curves, write_action
from cbm_addon.scene.bake import rig_channels
from cbm_addon.scene.reduction import Reduction, ReductionReport, reducing_channels
from cbm_addon.scene.rig import read_rig
from cbm_addon.takes.sample_motion import sample_motion

FRAMES = 90
RATE = 30
ROUNDING = 1.01  # Blender evaluates in single precision


@pytest.fixture(params=["human", "metarig"])
def armature(request) -> bpy.types.Object:
    return request.getfixturevalue(request.param)


def a_walk(solved: RigBody) -> Motion:
    """Three seconds of the sample motion, which walks and turns, at 30 frames a second."""
    motion = transfer(sample_motion(), solved.body)
    step = round(motion.rate / RATE)
    frames = slice(1200, 1200 + step * FRAMES, step)
    return replace(motion, times=np.arange(FRAMES) / RATE, root=motion.root[frames], rotations=motion.rotations[frames])


def thinned(
    armature: bpy.types.Object, reduction: Reduction, part: str = "full", root: str = "hips", limbs: str = "fk"
) -> tuple[Rig, Motion, list[Channel], ReductionReport]:
    """Writes an action of a walk with fewer keys; returns the walk and its dense channels."""
    rig = read_rig(armature)
    solved = rig_body(rig)
    motion = a_walk(solved)
    dense = list(rig_channels(armature, rig, solved, motion, part, root, limbs))
    fewer, report = run(reducing_channels(armature, rig, motion, dense, reduction, 1.0))
    write_action(armature, "thinned", 1.0 + np.arange(FRAMES), fewer)
    return rig, motion, dense, report


def evaluated(armature: bpy.types.Object, rig: Rig, joints: tuple[str, ...]) -> np.ndarray:
    """World matrices [FRAMES, J, 4, 4] of the bones of joints, from the dependency graph."""
    matrices = np.empty((FRAMES, len(joints), 4, 4))
    for frame in range(FRAMES):
        bpy.context.scene.frame_set(frame + 1)
        posed = armature.evaluated_get(bpy.context.evaluated_depsgraph_get())
        matrices[frame] = [posed.matrix_world @ posed.pose.bones[rig.mapping.joints[joint]].matrix for joint in joints]
    return matrices


def angles(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Degrees between rotations [..., 3, 3]; from their distance, since a cosine near 1 says little in single precision."""
    return np.degrees(2 * np.arcsin(np.linalg.norm(a - b, axis=(-1, -2)) / np.sqrt(8)))


@pytest.mark.parametrize(("millimetres", "degrees"), [(1, 0.3), (10, 2)])
def test_no_joint_leaves_the_tolerance_at_any_frame(armature, millimetres, degrees):
    rig, motion, dense, report = thinned(armature, Reduction(millimetres, degrees))
    joints = motion.skeleton.names
    fewer = evaluated(armature, rig, joints)
    write_action(armature, "dense", 1.0 + np.arange(FRAMES), dense)
    full = evaluated(armature, rig, joints)
    away = 1000 * np.linalg.norm(fewer[..., :3, 3] - full[..., :3, 3], axis=-1)
    turned = angles(fewer[..., :3, :3], full[..., :3, :3])
    assert away.max() <= ROUNDING * millimetres
    assert turned.max() <= ROUNDING * degrees
    assert away.max() == pytest.approx(report.largest_mm, abs=0.02), "what is reported is what Blender shows"
    assert report.keys_after < report.keys_before / (2 if millimetres == 1 else 4)


@pytest.mark.parametrize("mode", ["XYZ", "ZXY", "AXIS_ANGLE"])
def test_the_tolerance_holds_in_every_rotation_mode(metarig, mode):
    for bone in metarig.pose.bones:
        bone.rotation_mode = mode
    rig, motion, _, _ = thinned(metarig, Reduction(5, 1))
    heads = evaluated(metarig, rig, motion.skeleton.names)[..., :3, 3]
    assert 1000 * np.linalg.norm(heads - motion.positions(), axis=-1).max() <= ROUNDING * 5


@pytest.mark.parametrize("root", ["bone", "object"])
def test_the_tolerance_holds_whatever_carries_the_way(human, root):
    rig, motion, _, _ = thinned(human, Reduction(5, 1), root=root)
    heads = evaluated(human, rig, motion.skeleton.names)[..., :3, 3]
    assert 1000 * np.linalg.norm(heads - motion.positions(), axis=-1).max() <= ROUNDING * 5


@pytest.mark.parametrize("limbs", ["ik", "both"])
def test_hands_and_feet_that_inverse_kinematics_place_stay_where_they_are(human, limbs):
    joints = ("LeftFoot", "RightFoot", "LeftHand", "RightHand")
    rig, _, dense, report = thinned(human, Reduction(5, 1), limbs=limbs)
    fewer = evaluated(human, rig, joints)[..., :3, 3]
    write_action(human, "dense", 1.0 + np.arange(FRAMES), dense)
    assert 1000 * np.linalg.norm(fewer - evaluated(human, rig, joints)[..., :3, 3], axis=-1).max() < 0.5
    assert report.keys_after < 0.7 * report.keys_before, "the limbs keep theirs"


def test_standing_feet_stand_however_much_is_allowed(metarig):
    rig, motion, _, _ = thinned(metarig, Reduction(50, 10))
    feet = evaluated(metarig, rig, CONTACT_JOINTS)[..., :3, 3]
    dense = motion.positions()[:, motion.skeleton.indices(list(CONTACT_JOINTS))]
    standing = contact_labels(motion.skeleton, motion.positions(), RATE)
    assert standing.mean() > 0.2
    assert 1000 * np.linalg.norm(feet - dense, axis=-1)[standing].max() < 0.25
    both = standing[1:] & standing[:-1]
    slides = [np.linalg.norm(np.diff(values[..., :2], axis=0), axis=-1)[both].mean() * RATE * 100 for values in (dense, feet)]
    assert slides[1] - slides[0] < 0.6, "cm/s"


def test_only_the_lower_body_is_thinned_where_only_that_is_keyed(metarig):
    _, _, dense, report = thinned(metarig, Reduction(5, 1), part="lower")
    assert {channel.group for channel in dense} == {curve.group.name for curve in action_curves(metarig)}
    assert report.keys_after < report.keys_before / 2


def test_the_keys_that_are_counted_are_those_of_the_action(metarig):
    *_, report = thinned(metarig, Reduction(5, 1))
    assert sum(len(curve.keyframe_points) for curve in action_curves(metarig)) == report.keys_after
