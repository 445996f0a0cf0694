"""Skeletons, motions and forward kinematics."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cbm_addon.motion.motion import Motion, forward_kinematics, local_rotations
from cbm_addon.motion.rotations import difference, multiply, normalize, quat_from_axis_angle, quat_from_yaw, rotate
from cbm_addon.motion.skeleton import BODY_JOINTS, STANDARD_BODY, Skeleton, standard_body

seeds = st.integers(0, 2**32 - 1)


def random_motion(seed: int, frames: int = 8) -> Motion:
    random = np.random.default_rng(seed)
    rotations = normalize(random.normal(size=(frames, len(STANDARD_BODY), 4))).astype(np.float32)
    return Motion(STANDARD_BODY, np.arange(frames) / 30, random.normal(size=(frames, 3)).astype(np.float32), rotations)


def arm() -> Skeleton:
    """Shoulder, elbow and wrist along X, one metre apart."""
    offsets = np.array([[0, 0, 0], [1, 0, 0], [1, 0, 0]], dtype=np.float32)
    return Skeleton(("Shoulder", "Elbow", "Wrist"), np.array([-1, 0, 1]), offsets, np.full((3, 3), np.nan, dtype=np.float32))


def test_a_bent_arm_lies_where_the_textbook_says():
    quarter = quat_from_axis_angle(np.array([0, 0, 1]), np.array(np.pi / 2))
    straight = np.array([1.0, 0, 0, 0])
    world, positions = forward_kinematics(arm(), np.array([0, 0, 5.0]), np.array([quarter, quarter, straight]))
    assert np.allclose(positions, [[0, 0, 5], [0, 1, 5], [-1, 1, 5]], atol=1e-6)
    assert np.allclose(rotate(world[2], np.array([1.0, 0, 0])), [-1, 0, 0], atol=1e-6)


def test_at_rest_the_joints_are_where_the_offsets_put_them():
    rest = np.zeros((len(STANDARD_BODY), 4))
    rest[:, 0] = 1
    _, positions = forward_kinematics(STANDARD_BODY, np.zeros(3), rest)
    assert np.allclose(positions, STANDARD_BODY.rest_positions())


@given(seeds)
def test_local_rotations_undo_forward_kinematics(seed):
    motion = random_motion(seed)
    world, _ = motion.forward()
    assert difference(local_rotations(STANDARD_BODY, world), motion.rotations).max() < 2e-3  # of float32, near 180 degrees


@given(seeds)
def test_bones_keep_their_lengths(seed):
    motion = random_motion(seed)
    positions = motion.positions()
    lengths = np.linalg.norm(positions[:, 1:] - positions[:, STANDARD_BODY.parents[1:]], axis=-1)
    assert np.allclose(lengths, np.linalg.norm(STANDARD_BODY.offsets[1:], axis=-1), atol=1e-5)


@given(seeds, st.floats(-3, 3))
def test_turning_the_root_turns_the_body(seed, yaw):
    motion = random_motion(seed)
    turn = quat_from_yaw(np.array(yaw, dtype=np.float32))
    rotations = motion.rotations.copy()
    rotations[:, 0] = multiply(turn, rotations[:, 0])
    turned = Motion(motion.skeleton, motion.times, rotate(turn, motion.root), rotations)
    assert np.allclose(turned.positions(), rotate(turn, motion.positions()), atol=1e-5)


def test_animated_offsets_replace_those_of_the_skeleton():
    still = np.zeros((2, 3, 4), dtype=np.float32)
    still[..., 0] = 1
    offsets = np.array([[[0, 0, 0], [1, 0, 0], [1, 0, 0]], [[0, 0, 0], [3, 0, 0], [0, 0, 2]]], dtype=np.float32)
    motion = Motion(arm(), np.array([0.0, 1.0]), np.zeros((2, 3), dtype=np.float32), still, offsets)
    assert np.allclose(motion.positions()[1], [[0, 0, 0], [3, 0, 0], [3, 0, 2]])


def test_rate_and_duration_come_from_the_timestamps():
    motion = random_motion(0, frames=31)
    assert np.isclose(motion.rate, 30)
    assert np.isclose(motion.seconds, 1)
    assert len(motion) == 31


def test_a_single_pose_has_no_rate_and_no_duration():
    motion = random_motion(0, frames=1)
    assert (motion.rate, motion.seconds) == (0, 0)


def test_the_standard_body_is_symmetric_and_stands_upright_in_a_t_pose():
    rest = STANDARD_BODY.rest_positions()
    for name in BODY_JOINTS:
        twin = name.replace("Left", "Right") if name.startswith("Left") else name.replace("Right", "Left")
        assert np.allclose(rest[STANDARD_BODY.index(name)] * [-1, 1, 1], rest[STANDARD_BODY.index(twin)])
    hand, shoulder, head, toe, foot = (rest[STANDARD_BODY.index(name)] for name in ("LeftHand", "LeftArm", "Head", "LeftToe", "LeftFoot"))
    assert hand[0] > shoulder[0] > 0  # left is +X
    assert np.isclose(hand[2], shoulder[2])
    assert toe[1] < foot[1]  # the character faces -Y
    assert head[2] > 0 > toe[2]


@pytest.mark.parametrize("stature", [1.5, 1.95])
def test_a_body_scales_with_its_stature(stature):
    body = standard_body(stature)
    assert np.allclose(body.rest_positions(), STANDARD_BODY.rest_positions() * (stature / 1.75))
    assert np.isclose(body.height_above_toes(), STANDARD_BODY.height_above_toes() * (stature / 1.75))


def test_chains_run_from_a_joint_down_to_its_descendant():
    assert [BODY_JOINTS[i] for i in STANDARD_BODY.chain("LeftUpLeg", "LeftToe")] == ["LeftUpLeg", "LeftLeg", "LeftFoot", "LeftToe"]
    with pytest.raises(ValueError, match="LeftToe is not below RightUpLeg"):
        STANDARD_BODY.chain("RightUpLeg", "LeftToe")


def test_joints_are_found_by_name():
    assert "Head" in STANDARD_BODY
    assert "Tail" not in STANDARD_BODY
    assert STANDARD_BODY.indices(["Hips", "Head"]).tolist() == [0, 5]
    with pytest.raises(KeyError):
        STANDARD_BODY.index("Tail")
