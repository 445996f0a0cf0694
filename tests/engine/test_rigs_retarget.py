"""Motion moves from any skeleton to any rig: limbs point where they pointed, feet keep to the floor, and odd rest poses do not matter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cbm_addon.errors import InputError
from cbm_addon.motion.bvh import read_bvh
from cbm_addon.motion.motion import Motion, local_rotations
from cbm_addon.motion.rotations import IDENTITY, inverse, multiply, normalize, quat_from_rotvec, rotate
from cbm_addon.motion.skeleton import Skeleton
from cbm_addon.rigs.recognize import recognized
from cbm_addon.rigs.retarget import retarget, source_rig
from cbm_addon.rigs.rig import Rig
from tests.sample_rigs import POSES, SAMPLE_RIGS, SampleRig, bones_at_rest

FRAMES = 10
LIMBS = (("Arm", "ForeArm"), ("ForeArm", "Hand"), ("UpLeg", "Leg"), ("Leg", "Foot"))


def sample_called(name: str) -> SampleRig:
    return next(sample for sample in SAMPLE_RIGS if sample.name == name)


def skeleton_of(sample: SampleRig, pose: str) -> Skeleton:
    """A sample rig as the skeleton of a motion capture file: joints without axes of their own."""
    bones = bones_at_rest(sample, pose)
    heads = bones.rest[:, :3, 3]
    offsets = np.where(bones.parents[:, None] >= 0, heads - heads[bones.parents], heads)
    return Skeleton(bones.bones, bones.parents, offsets.astype(np.float32), np.full((len(heads), 3), np.nan, np.float32))


def a_motion(skeleton: Skeleton, size: float = 0.4) -> Motion:
    """From the rest pose on, every joint turns more and more, each its own way, while the body walks off."""
    random = np.random.default_rng(3)
    growth = np.linspace(0, 1, FRAMES)[:, None, None]
    turns = quat_from_rotvec(growth * random.uniform(-size, size, (1, len(skeleton), 3)))
    root = skeleton.offsets[0] + growth[:, 0] * [1.0, -2.0, 0.0]
    return Motion(skeleton, np.arange(FRAMES) / 30, root.astype(np.float32), turns.astype(np.float32))


def directions(positions: np.ndarray, index: dict[str, int]) -> np.ndarray:
    """Where the limbs point, [T, 8, 3]."""
    return np.stack([normalize(positions[:, index[side + b]] - positions[:, index[side + a]]) for side in ("Left", "Right") for a, b in LIMBS], axis=1)


def on(target: Rig, motion: Motion, name: str = "clip"):
    source, rested = source_rig(name, motion)
    moved = retarget(rested, source, target)
    return source, moved.solved, moved.motion


@pytest.mark.parametrize("sample", SAMPLE_RIGS, ids=lambda sample: sample.name)
@pytest.mark.parametrize("pose", POSES)
def test_limbs_point_where_those_of_the_source_point_whatever_the_rest_poses(sample, pose):
    target = recognized(bones_at_rest(sample, pose))
    mixamo = sample_called("Mixamo")
    motion = a_motion(skeleton_of(mixamo, "T"))
    _, solved, moved = on(target, motion)
    of_source = {joint: motion.skeleton.index(bone) for joint, bone in mixamo.joints.items()}
    of_target = {name: i for i, name in enumerate(solved.body.names)}
    np.testing.assert_allclose(directions(moved.positions(), of_target), directions(motion.positions(), of_source), atol=1e-4)


def test_a_rig_takes_its_own_motion_back():
    """Every joint, the fingers too, is where it was beside the hips; only the neck bends evenly between chest and head."""
    sample = sample_called("Unreal 4")
    bones = bones_at_rest(sample, "A")
    motion = a_motion(skeleton_of(sample, "A"), 0.3)
    rig = recognized(bones)
    played = {control.bone for control in rig.mapping.controls if not control.roll}
    motion.rotations[:, [i for i, name in enumerate(motion.skeleton.names) if name not in played]] = IDENTITY
    _, solved, moved = on(rig, motion)
    assert len(solved.body) == len(sample.joints)
    indices = [motion.skeleton.index(sample.joints[name]) for name in solved.body.names]
    expected = motion.positions()[:, indices]
    apart = np.abs((moved.positions() - moved.positions()[:, :1]) - (expected - expected[:, :1])).max(axis=(0, 2))
    head = solved.body.index("Head")
    np.testing.assert_allclose(np.delete(apart, head), 0, atol=1e-5)
    assert apart[head] < 0.02


def test_fingers_carry_over_where_the_source_has_them():
    """What is closed to a fist is a fist on the other hand, however that hand is held at rest."""
    source, target = sample_called("VRoid"), recognized(bones_at_rest(sample_called("Daz Genesis 8"), "hanging"))
    motion = a_motion(skeleton_of(source, "T"), 0.0)
    growth = np.linspace(0, 1.4, FRAMES)[:, None]
    for joint, bone in source.joints.items():
        if "Hand" in joint[4:-1] and "Thumb" not in joint:
            axis = np.array([0, 1.0, 0]) if joint.startswith("Left") else np.array([0, -1.0, 0])
            motion.rotations[:, motion.skeleton.index(bone)] = quat_from_rotvec(growth * axis)
    _, solved, moved = on(target, motion)
    index = {name: i for i, name in enumerate(solved.body.names)}
    positions = moved.positions()
    for side in ("Left", "Right"):
        for finger in ("Index", "Pinky"):
            ways = [positions[:, index[f"{side}Hand{finger}{i + 1}"]] - positions[:, index[f"{side}Hand{finger}{i}"]] for i in (1, 2)]
            between = np.arccos(np.clip(np.sum(normalize(ways[0]) * normalize(ways[1]), axis=-1), -1, 1))
            np.testing.assert_allclose(between, growth[:, 0], atol=0.02)


def test_fingers_of_the_rig_that_the_source_lacks_are_not_moved():
    _, solved, _ = on(recognized(bones_at_rest(sample_called("Mixamo"))), a_motion(skeleton_of(sample_called("SMPL"), "T")))
    assert not [name for name in solved.body.names if "Hand" in name[4:-1]]


@pytest.mark.parametrize("size", [0.6, 1.0, 1.3])
def test_a_body_of_another_size_walks_as_far_as_its_legs_say_and_stands_on_the_floor(size):
    target = recognized(bones_at_rest(sample_called("Unreal 5"), "A", scale=size))
    motion = a_motion(skeleton_of(sample_called("Mixamo"), "T"), 0.0)
    _, solved, moved = on(target, motion)
    ankle = moved.positions()[0, solved.body.index("LeftFoot"), 2]
    assert ankle == pytest.approx(target.head("foot_l")[2], abs=0.012 * size)
    assert moved.root[-1, 1] - moved.root[0, 1] == pytest.approx(-2.0 * size, rel=0.03)


def scrambled(motion: Motion) -> Motion:
    """The same positions from a skeleton whose rest pose is none: every joint has axes of its own, as in files without a rest pose."""
    skeleton = motion.skeleton
    axes = normalize(np.random.default_rng(5).normal(size=(len(skeleton), 4))).astype(np.float32)
    above = np.where((skeleton.parents >= 0)[:, None], axes[skeleton.parents], IDENTITY)
    world = multiply(motion.forward()[0], axes)
    single = replace(skeleton, offsets=rotate(inverse(above), skeleton.offsets))
    return Motion(single, motion.times, motion.root, local_rotations(single, world))


def test_ankles_are_told_on_the_scale_of_the_target():
    """Where they are in the motion, as far as the way through the world is scaled; standing as high as the target stands at rest."""
    target = recognized(bones_at_rest(sample_called("Unreal 5"), "A", scale=1.3))
    motion = a_motion(skeleton_of(sample_called("Mixamo"), "T"), 0.0)
    source, rested = source_rig("clip", motion)
    ankles = retarget(rested, source, target).ankles
    assert set(ankles) == {"Left", "Right"}
    ours = motion.positions()[:, motion.skeleton.index("mixamorig:LeftFoot")]
    np.testing.assert_allclose(np.ptp(ankles["Left"], axis=0), 1.3 * np.ptp(ours, axis=0), rtol=0.01, atol=1e-4)
    assert ankles["Left"][0, 2] == pytest.approx(target.head("foot_l")[2], abs=1e-3)


def test_a_rest_pose_that_is_none_is_replaced_by_the_straightest_upright_pose_of_the_motion():
    proper = a_motion(skeleton_of(sample_called("motion capture"), "T"))
    motion = scrambled(proper)
    np.testing.assert_allclose(motion.positions(), proper.positions(), atol=1e-5)
    target = recognized(bones_at_rest(sample_called("Unreal 5"), "A"))
    source, _, moved = on(target, motion)
    assert source.mapping.kind == "mixamo"
    np.testing.assert_allclose(moved.positions(), on(target, proper)[2].positions(), atol=1e-4)


def test_a_motion_without_any_upright_pose_is_refused():
    motion = scrambled(a_motion(skeleton_of(sample_called("motion capture"), "T")))
    lying = replace(motion, rotations=np.tile(IDENTITY, (FRAMES, len(motion.skeleton), 1)))
    with pytest.raises(InputError, match="clip: has the names of Mixamo, but"):
        source_rig("clip", lying)


@pytest.mark.needs_data
def test_every_real_skeleton_is_known(data_folder):
    """Of fifteen files from a dozen systems all are bodies but one, which is a hand."""
    kinds = {}
    for path in sorted((data_folder / "mocap" / "import_tests").glob("*.bvh")):
        motion = read_bvh(path)
        try:
            source, rested = source_rig(path.stem, motion)
        except InputError as error:
            kinds[path.stem] = str(error)
            continue
        np.testing.assert_allclose(rested.positions(), motion.positions(), atol=1e-4)
        kinds[path.stem] = source.mapping.kind
    assert len(kinds) == 15
    assert "no two chains of bones could be its legs" in kinds.pop("jaanga__clenching")
    assert set(kinds.values()) == {"mixamo", "vrm", "daz", "character_creator", "cmu_bvh", "shape"}
    assert kinds["upc__example_2"] == "shape"
