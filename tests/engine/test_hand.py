"""The hand: any rest pose, any axes, either side; angles make turns and positions, and come back from them; limits hold."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cbm_addon.errors import InputError
from cbm_addon.hands.hand import ANGLES, FINGERS, JOINTS, LIMITS, TIPS, Hand
from cbm_addon.motion.rotations import difference, inverse, multiply, normalize, quat_from_rotvec, rotate

seeds = st.integers(0, 10_000)
MIRROR = np.array([-1, 1, 1], np.float32)


def straight_hand() -> np.ndarray:
    """A right hand [20, 3], palm down, fingers along +Y, thumb toward -X; lengths of phalanges of a hand of 190 mm."""
    bases = np.array([[-0.025, 0.035, -0.018], [-0.024, 0.095, 0], [-0.002, 0.096, 0], [0.018, 0.09, 0], [0.036, 0.08, -0.004]])
    lengths = np.array([[0.035, 0.033, 0.025], [0.038, 0.024, 0.023], [0.043, 0.028, 0.025], [0.039, 0.027, 0.024], [0.031, 0.02, 0.021]])
    fan = np.radians([40, 4, 0, -6, -12])
    directions = np.stack((-np.sin(fan), np.cos(fan), [-0.4, 0, 0, 0, 0]), -1)
    chain = bases[:, None] + normalize(directions)[:, None] * np.concatenate((np.zeros((5, 1)), lengths.cumsum(-1)), -1)[..., None]
    return np.concatenate((chain[:, :3].reshape(15, 3), chain[:, 3])).astype(np.float32)


def sampled(seed: int, count: int = 20, hand: Hand | None = None) -> np.ndarray:
    limits = LIMITS if hand is None else hand.limits
    return np.random.default_rng(seed).uniform(*limits.T, size=(count, len(ANGLES))).astype(np.float32)


@pytest.fixture(scope="module")
def hand() -> Hand:
    return Hand.from_rest("right", straight_hand())


def test_names_and_sizes() -> None:
    assert len(JOINTS) == 15
    assert len(ANGLES) == 20
    assert JOINTS[3:6] == ("Index1", "Index2", "Index3")
    assert TIPS[1] == "IndexTip"
    assert (LIMITS[:, 0] < LIMITS[:, 1]).all()


def test_at_rest_nothing_turns(hand: Hand) -> None:
    turns = hand.turns(hand.rest_angles[None])
    np.testing.assert_allclose(turns[0], np.tile([1, 0, 0, 0], (15, 1)), atol=1e-6)
    np.testing.assert_allclose(hand.positions(hand.rest_angles[None])[0], hand.rest_positions, atol=1e-6)


def test_a_straight_hand_has_straight_fingers_at_rest(hand: Hand) -> None:
    bends = np.degrees(hand.rest_angles.reshape(5, 4)[1:, :3])
    assert np.abs(bends).max() < 3


@given(seeds)
@settings(max_examples=20, deadline=None)
def test_bending_brings_the_tips_out_of_the_palm_and_keeps_lengths(seed: int) -> None:
    hand = Hand.from_rest("right", straight_hand())
    angles = np.zeros((1, 20), np.float32)
    angles[0, 4:] = np.random.default_rng(seed).uniform(0.1, 0.5)
    bent, straight = hand.positions(angles), hand.positions(np.zeros((1, 20), np.float32))
    out = (bent - straight) @ hand.palm[:, 2]
    assert (out[0, 16:] > 0).all(), "the four fingers bend toward the palm's side"
    for finger in range(5):
        chain = [finger * 3, finger * 3 + 1, finger * 3 + 2, 15 + finger]
        lengths = np.linalg.norm(np.diff(bent[0, chain], axis=0), axis=-1)
        np.testing.assert_allclose(lengths, np.linalg.norm(np.diff(hand.rest_positions[chain], axis=0), axis=-1), atol=1e-6)


def test_spread_parts_the_fingers(hand: Hand) -> None:
    closed, parted = np.zeros((2, 1, 20), np.float32)
    parted[0, 7::4] = 0.2
    tips = [hand.positions(angles)[0, 16:] for angles in (closed, parted)]
    widths = [np.linalg.norm(tip[0] - tip[3]) for tip in tips]
    assert widths[1] > widths[0] + 0.01


@given(seeds)
@settings(max_examples=20, deadline=None)
def test_angles_come_back_from_turns(seed: int) -> None:
    hand = Hand.from_rest("right", straight_hand())
    angles = sampled(seed)
    found = hand.angles_from_turns(hand.turns(angles))
    assert ((found >= hand.limits[:, 0] - 1e-6) & (found <= hand.limits[:, 1] + 1e-6)).all()
    moved = np.linalg.norm(hand.positions(found) - hand.positions(angles), axis=-1)
    assert np.quantile(moved, 0.99) < 1e-3
    assert moved.max() < 5e-3


def test_what_is_beyond_the_limits_is_brought_within(hand: Hand) -> None:
    backwards = np.tile(np.array([-1.2, -1.2, -1.2, 0], np.float32), 5)[None]
    found = hand.angles_from_turns(hand.turns(backwards))
    assert (found >= hand.limits[:, 0] - 1e-6).all()


@given(seeds)
@settings(max_examples=15, deadline=None)
def test_a_rest_pose_in_other_axes_gives_the_same_hand(seed: int) -> None:
    turn = quat_from_rotvec(np.random.default_rng(seed).normal(size=3) * 2).astype(np.float32)
    hand, turned = (Hand.from_rest("right", positions) for positions in (straight_hand(), rotate(turn, straight_hand())))
    np.testing.assert_allclose(turned.rest_angles, hand.rest_angles, atol=1e-3)
    angles = sampled(seed, 5)
    np.testing.assert_allclose(turned.positions(angles), rotate(turn, hand.positions(angles)), atol=1e-4)


@given(seeds)
@settings(max_examples=15, deadline=None)
def test_the_left_hand_is_the_mirror_image(seed: int) -> None:
    right, left = Hand.from_rest("right", straight_hand()), Hand.from_rest("left", straight_hand() * MIRROR)
    np.testing.assert_allclose(left.rest_angles, right.rest_angles, atol=1e-4)
    angles = sampled(seed, 5)
    np.testing.assert_allclose(left.positions(angles), right.positions(angles) * MIRROR, atol=1e-5)


@given(seeds)
@settings(max_examples=30, deadline=None)
def test_a_curled_rest_pose_is_measured(seed: int) -> None:
    """The same hand, its rest pose taken from itself when bent: the angles that it finds are those that were set."""
    straight, random = Hand.from_rest("right", straight_hand()), np.random.default_rng(seed)
    angles = (straight.rest_angles + np.tile([0.5, 0.6, 0.4, 0.1], 5) * random.uniform(0, 1, 20)).astype(np.float32)
    curled = Hand.from_rest("right", straight.positions(angles[None])[0])
    found, set_to = curled.rest_angles.reshape(5, 4), angles.reshape(5, 4)
    assert np.degrees(np.abs(found - set_to)[1:, :3]).max() < 8
    poses = sampled(seed, 5)
    error = np.linalg.norm(curled.positions(poses) - straight.positions(poses), axis=-1)
    assert error.mean() < 0.01


def test_orientations_in_the_world_follow_the_recipe(hand: Hand) -> None:
    """wrist * turn * rest: a marker fixed to a phalanx goes with the phalanx."""
    random = np.random.default_rng(0)
    angles, wrist = sampled(1, 1), quat_from_rotvec(random.normal(size=3)).astype(np.float32)
    rest = quat_from_rotvec(random.normal(size=(15, 3))).astype(np.float32)
    world = multiply(multiply(wrist, hand.turns(angles)[0]), rest)
    starts, _, _ = hand.capsules(angles, np.zeros((1, 3), np.float32), wrist[None])
    joint, following = JOINTS.index("Index1"), JOINTS.index("Index2")
    along_at_rest = hand.rest_positions[following] - hand.rest_positions[joint]
    in_bone = rotate(inverse(rest[joint]), along_at_rest)
    np.testing.assert_allclose(rotate(world[joint], in_bone), starts[0, following] - starts[0, joint], atol=1e-5)
    assert difference(world[joint], multiply(wrist, rest[joint])) > 0


def test_capsules_start_at_the_joints_and_touch_the_tips(hand: Hand) -> None:
    angles = sampled(3, 4)
    wrists = np.random.default_rng(1).normal(size=(4, 3)).astype(np.float32), np.tile(np.array([1, 0, 0, 0], np.float32), (4, 1))
    starts, ends, radii = hand.capsules(angles, *wrists)
    placed = hand.positions(angles) + wrists[0][:, None]
    np.testing.assert_allclose(starts[:, :15], placed[:, :15], atol=1e-6)
    reach = np.linalg.norm(placed[:, 15:] - ends[:, 2:15:3], axis=-1)
    np.testing.assert_allclose(reach, np.broadcast_to(radii[2:15:3], (4, 5)), atol=1e-4)
    assert starts.shape[1] == ends.shape[1] == len(radii) == 15 + len(FINGERS)
    assert hand.capsules(angles, *wrists, palm=False)[0].shape[1] == 15


def test_what_is_no_hand_is_refused() -> None:
    collapsed = straight_hand()
    collapsed[4] = collapsed[3]
    with pytest.raises(InputError, match=r"Index1: has no length"):
        Hand.from_rest("right", collapsed)
    line = straight_hand()
    line[:, 0] = 0
    line[:, 2] = 0
    with pytest.raises(InputError, match=r"span the palm"):
        Hand.from_rest("right", line + np.arange(20, dtype=np.float32)[:, None] * [0, 0.001, 0])


@given(seeds)
@settings(max_examples=15, deadline=None)
def test_positions_are_those_of_the_turns(seed: int) -> None:
    hand = Hand.from_rest("left", straight_hand() * MIRROR)
    angles = sampled(seed)
    steps = rotate(hand.turns(angles), hand_steps(hand.rest_positions))
    np.testing.assert_allclose(hand_steps(hand.positions(angles)), steps, atol=1e-6)


def hand_steps(positions: np.ndarray) -> np.ndarray:
    """From each joint to the next, or to the tip [..., 15, 3]."""
    joints = positions[..., :15, :].reshape(*positions.shape[:-2], 5, 3, 3)
    following = np.concatenate((joints[..., 1:, :], positions[..., 15:, None, :]), -2)
    return (following - joints).reshape(*positions.shape[:-2], 15, 3)
