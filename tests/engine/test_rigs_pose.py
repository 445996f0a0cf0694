"""A rig's bones land exactly where the solved body has its joints, whatever the rig's rest pose, bone axes and object transform."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cbm_addon.motion.motion import Motion
from cbm_addon.motion.rotations import (
    continuous,
    difference,
    inverse,
    matrix_from_quat,
    multiply,
    normalize,
    quat_from_euler,
    quat_from_matrix,
    quat_from_rotvec,
)
from cbm_addon.motion.skeleton import STANDARD_BODY
from cbm_addon.motion.transfer import transfer
from cbm_addon.rigs.body import DOWN, OUTWARD, rig_body
from cbm_addon.rigs.pose import bone_poses, rotation_values
from cbm_addon.rigs.recognize import recognized
from cbm_addon.rigs.rig import FINGER_JOINTS, Bones, Rig
from tests.sample_rigs import POSES, SAMPLE_RIGS, bones_at_rest, evaluate, transform


def an_a_posed_rig(seed: int = 0, object_matrix: np.ndarray | None = None) -> Rig:
    """The standard body with lowered arms, knees a little bent, bones with arbitrary axes, and an unmapped bone above the left knee and the head."""
    rng = np.random.default_rng(seed)
    pose = np.tile(np.array([1.0, 0, 0, 0]), (len(STANDARD_BODY), 1))
    for side, sign in (("Left", 1), ("Right", -1)):
        pose[STANDARD_BODY.index(side + "Arm")] = quat_from_rotvec(np.array([0, 0.8 * sign, 0.1]))
        pose[STANDARD_BODY.index(side + "UpLeg")] = quat_from_rotvec(np.array([-0.1, 0, 0]))
        pose[STANDARD_BODY.index(side + "Leg")] = quat_from_rotvec(np.array([0.2, 0, 0]))
        pose[STANDARD_BODY.index(side + "Foot")] = quat_from_rotvec(np.array([-0.1, 0, 0.15 * sign]))
    heads = Motion(STANDARD_BODY, np.zeros(1), np.array([[0, 0, 0.95]]), pose[None]).positions()[0]
    bones, parents, rest = [], [], []
    for joint, name in enumerate(STANDARD_BODY.names):
        parent = bones.index(STANDARD_BODY.names[STANDARD_BODY.parents[joint]]) if joint else -1
        if name in ("LeftLeg", "Head"):
            bones.append(f"helper of {name}")
            parents.append(parent)
            rest.append(transform(normalize(rng.normal(size=4)), heads[joint] - [0, 0.02, 0]))
            parent = len(bones) - 1
        bones.append(name)
        parents.append(parent)
        rest.append(transform(normalize(rng.normal(size=4)), heads[joint]))
    count = len(bones)
    return recognized(
        Bones(
            name="test rig",
            bones=tuple(bones),
            parents=np.array(parents),
            rest=np.stack(rest),
            lengths=np.full(count, 0.1),
            inherits_rotation=np.ones(count, bool),
            local_location=np.ones(count, bool),
            constrained=np.zeros(count, bool),
            object_matrix=np.eye(4) if object_matrix is None else object_matrix,
        )
    )


def a_motion(body, frames: int = 20, seed: int = 1) -> Motion:
    rng = np.random.default_rng(seed)
    rotations = quat_from_rotvec(rng.uniform(-1, 1, (frames, len(body), 3)))
    return Motion(body, np.arange(frames) / 30, rng.uniform(-1, 1, (frames, 3)), rotations)


def assert_bones_follow(rig: Rig, solved, motion: Motion) -> np.ndarray:
    """Every mapped bone is where its joint is and turned as its joint; returns all bones' matrices."""
    matrices = evaluate(rig, len(motion), bone_poses(rig, solved, motion))
    world, positions = motion.forward()
    bones = rig.mapping.joints | rig.mapping.fingers
    for joint, name in enumerate(solved.body.names):
        bone = rig.index(bones[name])
        np.testing.assert_allclose(matrices[:, bone, :3, 3], positions[:, joint], atol=2e-6 * max(1, rig.scale), err_msg=name)
        rest = multiply(rig.object_rotation, rig.rest_rotation(bones[name]))
        expected = multiply(multiply(world[:, joint], solved.alignment[joint]), rest)
        np.testing.assert_allclose(matrices[:, bone, :3, :3] / rig.scale, matrix_from_quat(expected), atol=2e-6, err_msg=name)
    return matrices


TURNED_AND_SCALED = transform(quat_from_rotvec(np.array([0, 0, 2.0])), np.array([3.0, -1, 0]), 2.5)


@pytest.mark.parametrize("object_matrix", [np.eye(4), TURNED_AND_SCALED], ids=["at the origin", "turned, moved and scaled"])
def test_bones_are_where_the_solved_joints_are(object_matrix):
    rig = an_a_posed_rig(object_matrix=object_matrix)
    solved = rig_body(rig)
    assert_bones_follow(rig, solved, a_motion(solved.body))


@pytest.mark.parametrize("sample", SAMPLE_RIGS, ids=lambda sample: sample.name)
@pytest.mark.parametrize("pose", POSES)
def test_every_kind_of_rig_follows_with_its_fingers(sample, pose):
    """Whatever its rest pose and rolls, in centimetres and lying on its back until its object turns it upright."""
    upright = transform(quat_from_rotvec(np.array([np.pi / 2, 0, 0])), np.array([1.0, 2, 0]), 0.01)
    lying = transform(quat_from_rotvec(np.array([-np.pi / 2, 0, 0])), np.zeros(3))
    bones = bones_at_rest(sample, pose, scale=100)
    rig = recognized(replace(bones, rest=lying @ bones.rest, object_matrix=upright))
    solved = rig_body(rig, FINGER_JOINTS)
    assert len(solved.body) == len(sample.joints)
    assert_bones_follow(rig, solved, a_motion(solved.body))


@pytest.mark.parametrize("loose", ["Head", "Hips", "LeftForeArm", "helper of LeftLeg", "helper of Head", "all"])
def test_bones_that_do_not_inherit_rotation_follow_too(loose):
    rig = an_a_posed_rig()
    inherits = np.array([name != loose and loose != "all" for name in rig.bones])
    rig = recognized(replace(rig, inherits_rotation=inherits))
    solved = rig_body(rig)
    assert_bones_follow(rig, solved, a_motion(solved.body))


def test_hips_whose_location_is_not_along_their_own_axes_follow_too():
    rig = an_a_posed_rig()
    solved = rig_body(rig)
    free = replace(rig, local_location=np.zeros(len(rig.bones), bool))
    assert_bones_follow(free, solved, a_motion(solved.body))
    below = bones_at_rest(next(sample for sample in SAMPLE_RIGS if sample.name == "Unreal 4"), "A")
    below = recognized(replace(below, local_location=np.zeros(len(below.bones), bool)))
    assert_bones_follow(below, rig_body(below), a_motion(rig_body(below).body))


@pytest.mark.parametrize("name", ["Unreal 5", "MakeHuman default", "Daz Genesis 9", "3ds Max Biped"])
def test_twist_bones_share_the_roll_of_the_hand(name):
    """They turn about the forearm by their share of the hand's roll, whatever the hand bends; the hand itself stays where it was solved."""
    rig = recognized(bones_at_rest(next(sample for sample in SAMPLE_RIGS if sample.name == name), "A"))
    solved = rig_body(rig)
    frames = 25
    roll, bend = np.linspace(-1.5, 1.5, frames), 0.4
    motion = a_motion(solved.body, frames)
    for side in ("Left", "Right"):
        turns = np.tile(np.array([0, 0, bend]), (frames, 1))
        twist = quat_from_rotvec(roll[:, None] * OUTWARD[side])
        motion.rotations[:, solved.body.index(f"{side}Hand")] = multiply(twist, quat_from_rotvec(turns))
    matrices = assert_bones_follow(rig, solved, motion)
    twists = [control for control in rig.mapping.controls if control.roll and control.joint.endswith("ForeArm")]
    assert twists
    for control in twists:
        forearm = rig.mapping.joints[control.joint]
        own, limb = (quat_from_matrix(matrices[:, rig.index(bone), :3, :3]) for bone in (control.bone, forearm))
        rest_own, rest_limb = rig.rest_rotation(control.bone), rig.rest_rotation(forearm)
        turned = multiply(multiply(inverse(rest_limb), rest_own), inverse(multiply(inverse(limb), own)))
        np.testing.assert_allclose(2 * np.arccos(np.clip(np.abs(turned[:, 0]), -1, 1)), control.roll * np.abs(roll), atol=2e-3)


@pytest.mark.parametrize("name", ["Unreal 4", "Unreal 5", "Character Creator", "Daz Genesis 9", "MakeHuman default", "Auto-Rig Pro export"])
@pytest.mark.parametrize(("rolled", "spread"), [("Arm", "Arm"), ("UpLeg", "UpLeg"), ("Foot", "Leg")])
def test_upper_arms_and_legs_spread_their_roll(name, rolled, spread):
    """A joint that only rolls: the farther a twist bone is from the end that stays, the more it turns; what is below the limb stays exact."""
    rig = recognized(bones_at_rest(next(sample for sample in SAMPLE_RIGS if sample.name == name), "T"))
    solved = rig_body(rig)
    roll = np.linspace(-1.2, 1.2, 13)
    rotations = np.tile(np.array([1.0, 0, 0, 0]), (len(roll), len(solved.body), 1))
    for side in ("Left", "Right"):
        rotations[:, solved.body.index(side + rolled)] = quat_from_rotvec(roll[:, None] * (OUTWARD[side] if rolled == "Arm" else DOWN))
    matrices = assert_bones_follow(rig, solved, Motion(solved.body, np.arange(len(roll)) / 30, np.zeros((len(roll), 3)), rotations))
    found = [control for control in rig.mapping.controls if control.roll and control.joint in ("Left" + spread, "Right" + spread)]
    without = ("Daz Genesis 9",) if spread == "Leg" else ("MakeHuman default", "Auto-Rig Pro export")  # whose twist bones there carry the limb
    assert bool(found) == (name not in without)
    for control in found:
        own = multiply(quat_from_matrix(matrices[:, rig.index(control.bone), :3, :3]), inverse(rig.rest_rotation(control.bone)))
        still = multiply(own, inverse(own[len(roll) // 2]))
        share = control.roll if spread == "Leg" else 1 + control.roll
        assert 0 < share < 1
        np.testing.assert_allclose(2 * np.arccos(np.clip(np.abs(still[:, 0]), -1, 1)), share * np.abs(roll), atol=2e-3)


def test_toes_that_have_a_bone_each_turn_together():
    rig = recognized(bones_at_rest(next(sample for sample in SAMPLE_RIGS if sample.name == "MakeHuman default")))
    solved = rig_body(rig)
    matrices = assert_bones_follow(rig, solved, a_motion(solved.body))
    turns = []
    for toe in range(1, 6):
        own, rest = (quat_from_matrix(m[..., :3, :3]) for m in (matrices[:, rig.index(f"toe{toe}-1.L")], rig.rest[rig.index(f"toe{toe}-1.L")]))
        turns.append(matrix_from_quat(multiply(own, inverse(rest))))
    np.testing.assert_allclose(turns[1:], np.broadcast_to(turns[0], (4, *turns[0].shape)), atol=1e-6)


def test_a_roll_beyond_half_a_turn_does_not_jump():
    rig = recognized(bones_at_rest(next(sample for sample in SAMPLE_RIGS if sample.name == "Unreal 4")))
    solved = rig_body(rig)
    motion = a_motion(solved.body, 60)
    motion.rotations[:, solved.body.index("LeftHand")] = quat_from_rotvec(np.linspace(2.5, 4, 60)[:, None] * OUTWARD["Left"])
    (pose,) = (pose for pose in bone_poses(rig, solved, motion) if pose.bone == "lowerarm_twist_01_l")
    assert difference(pose.rotation[1:], pose.rotation[:-1]).max() < 0.05


def test_fingers_that_the_motion_does_not_have_are_left_alone():
    rig = recognized(bones_at_rest(SAMPLE_RIGS[0]))
    solved = rig_body(rig, ["LeftHandIndex1", "LeftHandIndex2"])
    posed = {pose.bone for pose in bone_poses(rig, solved, a_motion(solved.body))}
    assert {bone for bone in posed if "Hand" in bone[-12:] and bone[-1].isdigit()} == {"mixamorig:LeftHandIndex1", "mixamorig:LeftHandIndex2"}


def test_a_finger_joint_that_the_motion_skips_goes_with_the_one_before_it():
    rig = recognized(bones_at_rest(SAMPLE_RIGS[0], "A"))
    solved = rig_body(rig, ["LeftHandIndex1", "LeftHandIndex3", "RightHandPinky2"])
    assert_bones_follow(rig, solved, a_motion(solved.body))


def test_fingers_of_a_rig_are_straight_in_the_t_pose():
    rig = recognized(bones_at_rest(SAMPLE_RIGS[0], "A"))
    body = rig_body(rig, FINGER_JOINTS).body
    for side in ("Left", "Right"):
        for joint in (f"{side}HandThumb2", f"{side}HandMiddle3"):
            np.testing.assert_allclose(normalize(body.offsets[body.index(joint)]), OUTWARD[side], atol=1e-5)


def test_body_of_a_rig_stands_in_the_t_pose_that_faces_minus_y():
    rig = an_a_posed_rig(object_matrix=TURNED_AND_SCALED)
    body = rig_body(rig).body
    rest = dict(zip(body.names, body.rest_positions(), strict=True))
    for side, sign in (("Left", 1), ("Right", -1)):
        for joint in ("ForeArm", "Hand"):
            np.testing.assert_allclose(normalize(body.offsets[body.index(side + joint)]), [sign, 0, 0], atol=1e-6)
        for joint in ("Leg", "Foot"):
            np.testing.assert_allclose(normalize(body.offsets[body.index(side + joint)]), [0, 0, -1], atol=1e-6)
        toe = body.offsets[body.index(side + "Toe")]
        assert abs(toe[0]) < 1e-6
        assert toe[1] < 0
    assert rest["LeftUpLeg"][0] > 0 > rest["RightUpLeg"][0]


def test_body_of_a_rig_keeps_its_lengths_in_world_units():
    rig = an_a_posed_rig(object_matrix=TURNED_AND_SCALED)
    body = rig_body(rig).body
    lengths = np.linalg.norm(body.offsets, axis=-1)
    np.testing.assert_allclose(lengths, rig.scale * np.linalg.norm(STANDARD_BODY.offsets, axis=-1), rtol=1e-5)


def test_soles_stay_flat_in_the_t_pose():
    """The height of the toe below the ankle is that of the rest pose: feet are only turned about the vertical."""
    rig = an_a_posed_rig()
    body = rig_body(rig).body
    for side in ("Left", "Right"):
        drop = rig.head(side + "Toe")[2] - rig.head(side + "Foot")[2]
        assert body.offsets[body.index(side + "Toe"), 2] == pytest.approx(drop, abs=1e-6)


@pytest.mark.parametrize("mode", ["XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"])
def test_euler_curves_are_the_same_rotations_without_jumps(mode):
    """Blender's XYZ turns about the fixed X, then Y, then Z: intrinsically about Z, Y, X."""
    rotation = quat_from_rotvec(np.linspace(0, 1, 400)[:, None] * np.array([[9.0, 5.0, -7.0]]))
    name, values = rotation_values(rotation, mode)
    assert name == "rotation_euler"
    order = mode[::-1]
    again = quat_from_euler(values[:, ["XYZ".index(axis) for axis in order]], order)
    np.testing.assert_allclose(matrix_from_quat(again), matrix_from_quat(rotation), atol=1e-6)
    assert np.abs(np.diff(values, axis=0)).max() < np.pi / 2


def test_angles_and_axes_are_the_same_rotations_without_jumps():
    rotation = continuous(quat_from_rotvec(np.linspace(-3, 3, 400)[:, None] * np.array([[3.0, 1.0, -1.0]])))
    name, values = rotation_values(rotation, "AXIS_ANGLE")
    assert name == "rotation_axis_angle"
    np.testing.assert_allclose(matrix_from_quat(quat_from_rotvec(values[:, :1] * values[:, 1:])), matrix_from_quat(rotation), atol=1e-6)
    assert np.abs(np.diff(values, axis=0)).max() < np.pi / 2


def test_transfer_to_the_same_body_changes_nothing():
    motion = a_motion(STANDARD_BODY)
    again = transfer(motion, STANDARD_BODY)
    chain = STANDARD_BODY.chain("Hips", "Head")
    others = [joint for joint in range(len(STANDARD_BODY)) if joint not in chain[1:-2]]
    np.testing.assert_allclose(matrix_from_quat(again.forward()[0]), matrix_from_quat(motion.forward()[0]), atol=1e-6)
    np.testing.assert_allclose(again.positions()[:, others], motion.positions()[:, others], atol=1e-5)


def test_transfer_gives_the_chest_of_a_rig_the_rotation_of_the_upper_chest():
    """On a rig whose Spine2 carries the shoulders, that joint plays the part that Neck plays on the engine's body."""
    names = list(STANDARD_BODY.names)
    parents = STANDARD_BODY.parents.copy()
    parents[[names.index("LeftShoulder"), names.index("RightShoulder")]] = names.index("Spine2")
    body = replace(STANDARD_BODY, parents=parents)
    motion = a_motion(STANDARD_BODY)
    source, result = motion.forward()[0], transfer(motion, body).forward()[0]
    neck, chest, head, hand = (names.index(name) for name in ("Neck", "Spine2", "Head", "LeftHand"))
    np.testing.assert_allclose(matrix_from_quat(result[:, chest]), matrix_from_quat(source[:, neck]), atol=1e-6)
    np.testing.assert_allclose(matrix_from_quat(result[:, [head, hand]]), matrix_from_quat(source[:, [head, hand]]), atol=1e-6)
    np.testing.assert_allclose(difference(result[:, neck], result[:, chest]), difference(result[:, neck], result[:, head]), atol=1e-5)
