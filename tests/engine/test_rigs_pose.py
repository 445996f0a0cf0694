"""A rig's bones land exactly where the solved body has its joints, whatever the rig's rest pose, bone axes and object transform."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cbm_addon.errors import InputError
from cbm_addon.motion.motion import Motion
from cbm_addon.motion.rotations import (
    continuous,
    difference,
    matrix_from_quat,
    multiply,
    normalize,
    quat_from_euler,
    quat_from_matrix,
    quat_from_rotvec,
)
from cbm_addon.motion.skeleton import STANDARD_BODY
from cbm_addon.rigs.body import rig_body
from cbm_addon.rigs.pose import bone_poses, rotation_values
from cbm_addon.rigs.recognize import recognize
from cbm_addon.rigs.rig import Rig
from cbm_addon.rigs.transfer import transfer


def transform(rotation: np.ndarray, position: np.ndarray, scale: float = 1.0) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3] = matrix_from_quat(np.asarray(rotation, float)) * scale
    matrix[:3, 3] = position
    return matrix


def an_a_posed_rig(seed: int = 0, object_matrix: np.ndarray | None = None, prefix: str = "") -> Rig:
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
        parent = bones.index(prefix + STANDARD_BODY.names[STANDARD_BODY.parents[joint]]) if joint else -1
        if name in ("LeftLeg", "Head"):
            bones.append(f"helper of {name}")
            parents.append(parent)
            rest.append(transform(normalize(rng.normal(size=4)), heads[joint] - [0, 0.02, 0]))
            parent = len(bones) - 1
        bones.append(prefix + name)
        parents.append(parent)
        rest.append(transform(normalize(rng.normal(size=4)), heads[joint]))
    names, above = tuple(bones), np.array(parents)
    return Rig(
        name="test rig",
        bones=names,
        parents=above,
        rest=np.stack(rest),
        lengths=np.full(len(bones), 0.1),
        inherits_rotation=np.ones(len(bones), bool),
        object_matrix=np.eye(4) if object_matrix is None else object_matrix,
        mapping=recognize("test rig", names, above),
    )


def a_motion(body, frames: int = 20, seed: int = 1) -> Motion:
    rng = np.random.default_rng(seed)
    rotations = quat_from_rotvec(rng.uniform(-1, 1, (frames, len(body), 3)))
    return Motion(body, np.arange(frames) / 30, rng.uniform(-1, 1, (frames, 3)), rotations)


def evaluate(rig: Rig, motion_frames: int, poses) -> np.ndarray:
    """World matrices [T, B, 4, 4] of the bones by Blender's definition: parent's pose * offset at rest * own pose."""
    basis = np.tile(np.eye(4), (motion_frames, len(rig.bones), 1, 1))
    for pose in poses:
        bone = rig.index(pose.control.bone)
        basis[:, bone, :3, :3] = matrix_from_quat(pose.rotation)
        if pose.location is not None:
            basis[:, bone, :3, 3] = pose.location
    matrices = np.empty_like(basis)
    for bone, parent in enumerate(rig.parents):
        above = np.eye(4) if parent < 0 else matrices[:, parent] @ np.linalg.inv(rig.rest[parent])
        matrices[:, bone] = above @ rig.rest[bone] @ basis[:, bone]
    return rig.object_matrix @ matrices


TURNED_AND_SCALED = transform(quat_from_rotvec(np.array([0, 0, 2.0])), np.array([3.0, -1, 0]), 2.5)


@pytest.mark.parametrize("object_matrix", [np.eye(4), TURNED_AND_SCALED], ids=["at the origin", "turned, moved and scaled"])
def test_bones_are_where_the_solved_joints_are(object_matrix):
    rig = an_a_posed_rig(object_matrix=object_matrix)
    solved = rig_body(rig)
    motion = a_motion(solved.body)
    matrices = evaluate(rig, len(motion), bone_poses(rig, solved, motion))
    world, positions = motion.forward()
    for joint, name in enumerate(solved.body.names):
        bone = rig.index(rig.mapping.joints[name])
        np.testing.assert_allclose(matrices[:, bone, :3, 3], positions[:, joint], atol=2e-6)
        rest = multiply(rig.object_rotation, quat_from_matrix(rig.rest[bone, :3, :3]))
        expected = multiply(multiply(world[:, joint], solved.alignment[joint]), rest)
        np.testing.assert_allclose(matrices[:, bone, :3, :3] / rig.scale, matrix_from_quat(expected), atol=2e-6)


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


def test_a_prefix_before_the_names_is_tolerated():
    assert an_a_posed_rig(prefix="mixamorig:").mapping.joints["LeftFoot"] == "mixamorig:LeftFoot"


def test_an_armature_without_legs_is_refused_with_what_it_lacks():
    names = tuple(name for name in STANDARD_BODY.names if "Leg" not in name and "Foot" not in name and "Toe" not in name)
    parents = np.array([-1, *(names.index(STANDARD_BODY.names[STANDARD_BODY.parents[STANDARD_BODY.index(name)]]) for name in names[1:])])
    with pytest.raises(InputError, match="half a body: .*LeftUpLeg.*RightFoot"):
        recognize("half a body", names, parents)


def test_a_leg_that_hangs_beside_the_hips_is_refused():
    parents = np.array(STANDARD_BODY.parents)
    parents[STANDARD_BODY.index("LeftUpLeg")] = -1
    with pytest.raises(InputError, match="LeftUpLeg.*parent it below Hips"):
        recognize("rig", STANDARD_BODY.names, parents)


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
