"""The fingers of a rig: found where they are, and turned as asked, whatever the bones' axes and whatever moves the hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cbm_addon.errors import InputError
from cbm_addon.hands.hand import JOINTS, Hand
from cbm_addon.motion.rotations import difference, inverse, multiply, normalize, quat_from_matrix, quat_from_rotvec
from cbm_addon.rigs.fingers import finger_bones, finger_poses, finger_turns, hands_with_fingers, read_before
from cbm_addon.rigs.pose import BonePose
from cbm_addon.rigs.recognize import recognized
from cbm_addon.rigs.rig import FINGER_JOINTS, Rig
from tests.sample_rigs import POSES, SAMPLE_RIGS, SampleRig, bones_at_rest, evaluate, joint_positions, renamed, transform

FRAMES = 7
FINGERED = [sample for sample in SAMPLE_RIGS if set(FINGER_JOINTS) <= set(sample.joints)]
MOVED = transform(normalize(np.array([0.9, 0.1, -0.2, 0.4])), np.array([3.0, -2, 1]), 1.1)


@pytest.fixture(params=FINGERED, ids=lambda sample: sample.name)
def sample(request: pytest.FixtureRequest) -> SampleRig:
    return request.param


def a_rig(sample: SampleRig, pose: str = "A", **more) -> Rig:
    return recognized(bones_at_rest(sample, pose, **more))


def any_turns(count: int, seed: int = 0) -> np.ndarray:
    return quat_from_rotvec(np.random.default_rng(seed).normal(size=(FRAMES, count, 3)) * 0.6)


def any_poses(rig: Rig, seed: int = 1) -> list[BonePose]:
    """A pose of every bone, as an animator may have left it."""
    turns = any_turns(len(rig.bones), seed)
    return [BonePose(bone, False, turns[:, i], None) for i, bone in enumerate(rig.bones)]


def rotations_of(rig: Rig, matrices: np.ndarray) -> dict[str, np.ndarray]:
    """Rotations [T, 4] in the armature of all bones from world matrices."""
    local = np.linalg.inv(rig.object_matrix) @ matrices
    return {bone: quat_from_matrix(local[:, i, :3, :3]) for i, bone in enumerate(rig.bones)}


@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("side", ["Left", "Right"])
def test_joints_are_where_the_rig_has_them(sample, pose, side):
    rig = a_rig(sample, pose)
    fingers = finger_bones(rig, side)
    at = joint_positions(POSES[pose])
    wrist = at[f"{side}Hand"]
    names = [f"{side}Hand{joint.replace('Little', 'Pinky')}" for joint in JOINTS]
    distances = np.linalg.norm(np.array([at[name] for name in names]) - wrist, axis=-1)
    np.testing.assert_allclose(np.linalg.norm(fingers.positions[:15], axis=-1), distances, atol=1e-9)
    assert Hand.from_rest(side.lower(), fingers.positions).length == pytest.approx(fingers.length, rel=1e-4)


@pytest.mark.parametrize("flags", ["inherits", "does not"])
def test_bones_turn_as_asked_whatever_else_is_posed(sample, flags):
    rig = a_rig(sample, object_matrix=MOVED)
    if flags == "does not":
        inherits = rig.inherits_rotation.copy()
        inherits[[rig.index(sample.joints[joint]) for joint in FINGER_JOINTS[::2]]] = False
        rig = replace(rig, inherits_rotation=inherits)
    before = evaluate(rig, FRAMES, any_poses(rig))
    posed = {pose.bone: pose for pose in any_poses(rig)}
    turns = any_turns(15, seed=2)
    fingers = finger_bones(rig, "Left")
    for pose in finger_poses(rig, fingers, turns, rotations_of(rig, before)):
        posed[pose.bone] = pose
    after = rotations_of(rig, evaluate(rig, FRAMES, posed.values()))
    np.testing.assert_allclose(difference(finger_turns(fingers, after), turns), 0, atol=1e-6)


def test_what_is_read_is_what_poses_it(sample):
    """The turns that the rig has now are keyed as the poses that it has now."""
    rig = a_rig(sample)
    given = {pose.bone: pose.rotation for pose in any_poses(rig)}
    rotations = rotations_of(rig, evaluate(rig, FRAMES, any_poses(rig)))
    for side in ("Left", "Right"):
        fingers = finger_bones(rig, side)
        asked = {bone: rotations[bone] for bone in read_before(rig, fingers)}
        for pose in finger_poses(rig, fingers, finger_turns(fingers, asked), asked):
            np.testing.assert_allclose(difference(pose.rotation, given[pose.bone]), 0, atol=1e-6)


def test_at_rest_nothing_is_turned(sample):
    rig = a_rig(sample)
    fingers = finger_bones(rig, "Right")
    rotations = rotations_of(rig, evaluate(rig, FRAMES, []))
    np.testing.assert_allclose(difference(finger_turns(fingers, rotations), np.array([1.0, 0, 0, 0])), 0, atol=1e-6)


def test_a_tip_that_its_bone_does_not_tell_is_straight_on():
    sample = next(sample for sample in FINGERED if sample.name == "Unreal 4")
    bones = bones_at_rest(sample)
    rest = bones.rest.copy()
    third = bones.index(sample.joints["LeftHandIndex3"])
    rest[third, :3, :3] = rest[third, :3, [2, 0, 1]].T  # its Y axis is now across
    fingers = finger_bones(recognized(replace(bones, rest=rest)), "Left")
    middle, last, tip = fingers.positions[[4, 5, 16]]
    np.testing.assert_allclose(normalize(tip - last), normalize(last - middle), atol=1e-9)


def test_a_finger_that_is_missing_lies_in_the_one_beside_it_and_is_not_keyed():
    sample = next(sample for sample in FINGERED if sample.name == "Mixamo")
    rig = a_rig(sample)
    fewer = {joint: bone for joint, bone in rig.mapping.fingers.items() if "Pinky" not in joint}
    fingers = finger_bones(replace(rig, mapping=replace(rig.mapping, fingers=fewer)), "Left")
    assert fingers.bones[12:] == fingers.controls[12:] == (None, None, None)
    np.testing.assert_array_equal(fingers.positions[12:15], fingers.positions[9:12])
    turns = finger_turns(fingers, rotations_of(rig, evaluate(rig, FRAMES, any_poses(rig))))
    np.testing.assert_array_equal(turns[:, 12:], turns[:, 9:12])


def test_rigs_without_fingers_are_refused_by_side():
    rig = a_rig(next(sample for sample in SAMPLE_RIGS if sample.name == "motion capture"))
    assert hands_with_fingers(rig) == ()
    with pytest.raises(InputError, match="no bones for the fingers of its left hand"):
        finger_bones(rig, "Left")


def test_unknown_names_have_fingers_by_their_shape(sample):
    assert hands_with_fingers(recognized(renamed(bones_at_rest(sample, "A")))) == ("Left", "Right")


def test_helpers_between_keyed_bones_keep_their_own_turns():
    """A bone between two phalanges that something else has turned stays turned against the bone that carries it."""
    sample = next(sample for sample in FINGERED if sample.name == "Mixamo")
    rig = a_rig(sample)
    second, first = sample.joints["LeftHandIndex2"], sample.joints["LeftHandIndex1"]
    helper = "drives " + second
    names = (*rig.bones, helper)
    order = [i for i in range(len(rig.bones)) if i != rig.index(second)]
    place = order.index(rig.index(first)) + 1
    order[place:place] = [len(rig.bones), rig.index(second)]
    parents = np.append(rig.parents, rig.index(first))
    parents[rig.index(second)] = len(rig.bones)
    where = {old: new for new, old in enumerate(order)}
    extended = replace(
        rig,
        bones=tuple(names[i] for i in order),
        parents=np.array([where.get(int(parents[i]), -1) for i in order]),
        rest=np.concatenate((rig.rest, rig.rest[rig.index(second)][None]))[order],
        lengths=np.append(rig.lengths, 0.01)[order],
        **{flag: np.append(getattr(rig, flag), flag != "constrained")[order] for flag in ("inherits_rotation", "local_location", "constrained")},
    )
    before = rotations_of(extended, evaluate(extended, FRAMES, any_poses(extended)))
    fingers, turns = finger_bones(extended, "Left"), any_turns(15, seed=4)
    posed = {pose.bone: pose for pose in any_poses(extended)} | {pose.bone: pose for pose in finger_poses(extended, fingers, turns, before)}
    after = rotations_of(extended, evaluate(extended, FRAMES, posed.values()))
    np.testing.assert_allclose(difference(finger_turns(fingers, after), turns), 0, atol=1e-6)
    against = [multiply(inverse(rotations[first]), rotations[helper]) for rotations in (before, after)]
    np.testing.assert_allclose(difference(*against), 0, atol=1e-6)
