"""A generated Rigify rig through its own inverse kinematics: Blender's solver gives the pose that forward kinematics has."""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np
import pytest

from cbm_addon.errors import InputError
from cbm_addon.motion.bvh import write_bvh
from cbm_addon.motion.motion import Motion
from cbm_addon.motion.resample import resample
from cbm_addon.motion.rotations import difference, quat_from_matrix, quat_from_rotvec
from cbm_addon.progress import run
from cbm_addon.rigs.body import rig_body
from cbm_addon.rigs.limbs import hinged
from cbm_addon.rigs.rig import Rig
from cbm_addon.scene.action import action_curves, write_action
from cbm_addon.scene.bake import BakeOptions, bake, rig_channels, solve_on_rig
from cbm_addon.scene.importers import import_mocap
from cbm_addon.scene.rig import read_rig
from cbm_addon.solve.ik import REACH
from cbm_addon.solve.models import load_model
from cbm_addon.solve.perform import SolveOptions, sampled
from cbm_addon.takes.calibrate import Calibrated, calibrate
from cbm_addon.takes.sample_motion import sample_motion, sample_take
from tests.evaluated import evaluated

MILLIMETRE, HALF_A_DEGREE = 1e-3, 0.5


@pytest.fixture(scope="module")
def model():
    return load_model()


@pytest.fixture(scope="module")
def calibrated() -> Calibrated:
    """Two seconds of the sample take that begin in a walk and end in a turn."""
    return piece(calibrate(sample_take()), 5, 2)


def piece(calibrated: Calibrated, start: float, seconds: float) -> Calibrated:
    take = sampled(calibrated.take, calibrated.take.times[0] + start + np.arange(0, seconds, 1 / 90))
    return replace(calibrated, take=replace(take, times=take.times - take.times[0]))


def a_motion(rig: Rig, frames: int = 12, bend: float = 1.0) -> Motion:
    """Limbs bent and rolled every way: crossed, folded, knees turned backwards; in the last frame all are as straight as the engine makes them."""
    body = rig_body(rig).body
    random = np.random.default_rng(3)
    rotations = quat_from_rotvec(random.uniform(-bend, bend, (frames, len(body), 3)))
    hinges = body.indices([side + name for side in ("Left", "Right") for name in ("ForeArm", "Leg")])
    rotations[-1, hinges] = quat_from_rotvec(np.array([0, 2 * np.arccos(REACH), 0]))
    return Motion(body, np.arange(frames) / 24, random.uniform(-1, 1, (frames, 3)).astype(np.float32), rotations.astype(np.float32))


def key(armature: bpy.types.Object, rig: Rig, motion: Motion, limbs: str, **more) -> None:
    write_action(armature, limbs, 1.0 + np.arange(len(motion)), list(rig_channels(armature, rig, rig_body(rig), motion, limbs=limbs, **more)))


def switch(armature: bpy.types.Object, value: float) -> None:
    """What an animator does with the slider IK-FK, all along the action."""
    for curve in action_curves(armature):
        if curve.data_path.endswith('["IK_FK"]'):
            for point in curve.keyframe_points:
                point.co[1] = value
            curve.update()


def assert_kinematics_agree(armature: bpy.types.Object, frames: int) -> None:
    bones = [bone.name for bone in armature.pose.bones if bone.name.startswith(("ORG-", "DEF-"))]
    ik = evaluated(armature, bones, frames)
    switch(armature, 1.0)
    fk = evaluated(armature, bones, frames)
    assert np.linalg.norm(ik[..., :3, 3] - fk[..., :3, 3], axis=-1).max() < MILLIMETRE
    turns = [quat_from_matrix(m[..., :3, :3] / np.linalg.norm(m[..., :3, :3], axis=-2, keepdims=True)) for m in (ik, fk)]
    assert np.degrees(difference(*turns)).max() < HALF_A_DEGREE


def keyed(armature: bpy.types.Object) -> set[str]:
    return {curve.data_path for curve in action_curves(armature)}


def values(armature: bpy.types.Object) -> dict[str, float]:
    """What custom properties are keyed to, by their path."""
    return {curve.data_path: curve.keyframe_points[0].co[1] for curve in action_curves(armature) if '"]["' in curve.data_path}


def test_both_kinematics_agree_however_limbs_are_bent(human):
    rig = read_rig(human)
    motion = a_motion(rig)
    key(human, rig, motion, "both")
    assert_kinematics_agree(human, len(motion))


@pytest.mark.parametrize("root", ["hips", "bone", "object"])
def test_the_joints_of_limbs_land_where_they_were_solved_through_the_rigs_own_kinematics(human, root):
    """Wherever the rig stands, whatever its size, and whatever carries the way."""
    human.location, human.rotation_euler, human.scale = (1, 2, 0), (0, 0, 0.7), (1.5, 1.5, 1.5)
    rig = read_rig(human)
    motion = a_motion(rig, bend=0.8)
    key(human, rig, motion, "ik", root=root)
    joints = [rig.mapping.joints[name] for name in motion.skeleton.names]
    np.testing.assert_allclose(evaluated(human, joints, len(motion))[..., :3, 3], motion.positions(), atol=1.5 * MILLIMETRE)


def test_a_solved_take_agrees_and_its_limbs_do_not_flip(human, model, calibrated):
    rig = read_rig(human)
    solved = rig_body(rig)
    motion = run(solve_on_rig(solved, calibrated, model, SolveOptions(), 24))
    key(human, rig, motion, "both")
    limbs = [f"ORG-{bone}.{side}" for bone in ("upper_arm", "forearm", "thigh", "shin") for side in "LR"]
    turns = quat_from_matrix(evaluated(human, limbs, len(motion))[..., :3, :3])
    assert np.degrees(difference(turns[1:], turns[:-1])).max() < 30
    assert_kinematics_agree(human, len(motion))


@pytest.mark.needs_data
@pytest.mark.parametrize(("recording", "start"), [("xror/bsor_sample1_anon.bsor", 60), ("kinematic_maze/moore_cross_domain23_fixed.csv", 37)])
def test_real_takes_agree(human, model, data_folder, recording, start):
    from cbm_addon.takes.readers import read_take

    rig = read_rig(human)
    real = piece(calibrate(read_take(data_folder / "takes" / recording)), start, 5)
    motion = run(solve_on_rig(rig_body(rig), real, model, SolveOptions(), 24))
    key(human, rig, motion, "both")
    assert_kinematics_agree(human, len(motion))


def test_imported_motion_capture_agrees(human, tmp_path):
    whole = sample_motion()
    motion = resample(whole, 3 + np.arange(20) / 30)
    write_bvh(tmp_path / "walk.bvh", motion)
    bpy.context.scene.render.fps = 30
    (made,) = import_mocap(bpy.context, [tmp_path / "walk.bvh"], human, 1, limbs="both")
    assert made.action.frame_range[1] == 20
    assert_kinematics_agree(human, 20)


def test_hinges_only_roll_the_bones_of_limbs(human):
    rig = read_rig(human)
    motion = a_motion(rig)
    rolled = hinged(rig, rig_body(rig), motion)
    np.testing.assert_allclose(rolled.positions(), motion.positions(), atol=1e-5)
    kept = [i for i, name in enumerate(motion.skeleton.names) if not name.endswith(("Arm", "UpLeg", "Leg"))]
    assert difference(rolled.forward()[0][:, kept], motion.forward()[0][:, kept]).max() < 1e-3


@pytest.mark.parametrize(("limbs", "value"), [("fk", 1.0), ("ik", 0.0), ("both", 0.0)])
def test_the_rig_is_switched_to_what_is_keyed(human, limbs, value):
    rig = read_rig(human)
    key(human, rig, a_motion(rig, 2), limbs)
    switches = [at for path, at in values(human).items() if path.endswith('["IK_FK"]')]
    assert switches == [value] * 4
    paths = keyed(human)
    assert any("_fk.L" in path and "rotation" in path for path in paths if "spine" not in path) == (limbs != "ik")
    assert any("hand_ik.L" in path for path in paths) == any("thigh_ik_target.R" in path for path in paths) == (limbs != "fk")
    if limbs != "fk":
        others = {path.rsplit('["', 1)[-1]: at for path, at in values(human).items() if "thigh_parent.L" in path}
        assert {name: others[f'{name}"]'] for name in ("IK_Stretch", "pole_vector", "IK_parent", "pole_parent")} == {
            "IK_Stretch": 0,
            "pole_vector": 1,
            "IK_parent": 1,
            "pole_parent": 1,
        }


def test_what_an_animator_left_on_other_controls_stays(human):
    """Keys for IK do not touch FK controls, tweaks and the face."""
    left = dict.fromkeys(("jaw_master", "forearm_tweak.L", "thigh_fk.L"), (0.1, 0.2, 0.3))
    for name, location in left.items():
        human.pose.bones[name].location = location
    rig = read_rig(human)
    key(human, rig, a_motion(rig, 2), "ik")
    for name, location in left.items():
        assert tuple(human.pose.bones[name].location) == pytest.approx(location)
        assert not [path for path in keyed(human) if f'"{name}"' in path]


def test_what_an_earlier_animation_left_on_the_controls_does_not_displace_them(human):
    for name in ("hand_ik.L", "foot_ik.R", "foot_spin_ik.R", "foot_heel_ik.R", "toe_ik.R", "upper_arm_ik_target.L"):
        bone = human.pose.bones[name]
        bone.location, bone.scale, bone.rotation_mode, bone.rotation_euler = (0.1, 0.2, 0.3), (1.2, 1.2, 1.2), "XYZ", (0.3, 0.2, 0.1)
    human.pose.bones["thigh_ik.L"].rotation_euler = (0, 0.7, 0)
    human.pose.bones["thigh_parent.L"]["IK_parent"], human.pose.bones["upper_arm_parent.R"]["pole_parent"] = 4, 3
    rig = read_rig(human)
    motion = a_motion(rig, bend=0.8)
    key(human, rig, motion, "both")
    assert_kinematics_agree(human, len(motion))


def test_the_lower_part_keys_the_kinematics_of_legs_alone(human):
    rig = read_rig(human)
    key(human, rig, a_motion(rig, 2), "ik", part="lower")
    paths = keyed(human)
    assert any("foot_ik.L" in path for path in paths)
    assert not [path for path in paths if "hand" in path or "arm" in path]


def test_rigs_without_known_inverse_kinematics_are_refused_before_anything_is_solved(metarig, model, calibrated):
    with pytest.raises(InputError, match=r"metarig: is Rigify's .*; key its limbs with fk") as error:
        next(bake(bpy.context, metarig, calibrated, model, BakeOptions(limbs="ik")))
    assert "\n" not in str(error.value)
    assert not bpy.data.actions


def test_a_generated_rig_that_lacks_a_pole_still_bakes_its_forward_kinematics(human, model, calibrated):
    bpy.ops.object.mode_set(mode="EDIT")
    human.data.edit_bones.remove(human.data.edit_bones["thigh_ik_target.L"])
    bpy.ops.object.mode_set(mode="OBJECT")
    rig = read_rig(human)
    key(human, rig, a_motion(rig, 2), "fk")
    with pytest.raises(InputError, match="no inverse kinematics are known"):
        next(bake(bpy.context, human, calibrated, model, BakeOptions(limbs="both")))
