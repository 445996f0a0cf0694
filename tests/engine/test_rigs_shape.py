"""Bodies are found by their shape alone, and what has not the shape of a person is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cbm_addon.errors import InputError
from cbm_addon.motion.rotations import quat_from_rotvec, quat_from_yaw
from cbm_addon.rigs.recognize import recognize
from cbm_addon.rigs.rig import Bones
from cbm_addon.rigs.shape import REQUIRED, find_joints, misshapen
from tests.sample_rigs import POSES, SAMPLE_RIGS, SampleRig, bones_at_rest, renamed, rig, transform, with_lengths


@pytest.fixture(params=SAMPLE_RIGS, ids=lambda sample: sample.name)
def sample(request: pytest.FixtureRequest) -> SampleRig:
    return request.param


def found_in(bones: Bones, shown: Bones | None = None) -> dict[str, str]:
    """The required joints that are found in the renamed bones, by the bones' own names."""
    own = dict(zip(renamed(bones).bones, bones.bones, strict=True))
    joints = find_joints(renamed(shown or bones))
    return {joint: own[joints[joint]] for joint in REQUIRED}


def expected(sample: SampleRig) -> dict[str, str]:
    return {joint: sample.joints[joint] for joint in REQUIRED}


@pytest.mark.parametrize("pose", POSES)
def test_every_rig_is_found_with_all_its_bones_renamed(sample, pose):
    assert found_in(bones_at_rest(sample, pose)) == expected(sample)


def test_recognition_falls_back_on_the_shape_and_says_so(sample):
    found = recognize(renamed(bones_at_rest(sample, "A")))
    assert found.mapping.kind == "shape"
    assert "not by names" in found.doubts[0]


@pytest.mark.parametrize(
    "object_matrix",
    [
        transform(quat_from_yaw(np.asarray(2.0)), np.array([4.0, -3, 0.5]), 0.01),
        transform(quat_from_yaw(np.asarray(-1.57)), np.zeros(3), 40.0),
    ],
    ids=["turned and small", "looking along X and huge"],
)
def test_size_place_and_heading_do_not_matter(sample, object_matrix):
    assert found_in(bones_at_rest(sample, "A", object_matrix)) == expected(sample)


def test_the_axes_of_the_armature_do_not_matter(sample):
    """Y up in the armature, turned upright by its object, as game engines' skeletons come."""
    bones = bones_at_rest(sample, "T")
    lying = transform(quat_from_rotvec(np.array([-np.pi / 2, 0, 0])), np.zeros(3))
    upright = transform(quat_from_rotvec(np.array([np.pi / 2, 0, 0])), np.zeros(3))
    assert found_in(bones, replace(bones, rest=lying @ bones.rest, object_matrix=upright)) == expected(sample)


def test_the_order_of_siblings_does_not_matter(sample):
    bones = bones_at_rest(sample)
    random = np.random.default_rng(2)
    order: list[int] = []
    open_bones = [int(root) for root in np.flatnonzero(bones.parents < 0)]
    while open_bones:
        order.append(open_bones.pop(random.integers(len(open_bones))))
        open_bones += np.flatnonzero(bones.parents == order[-1]).tolist()
    place = {bone: i for i, bone in enumerate(order)}
    shuffled = replace(
        bones,
        bones=tuple(bones.bones[bone] for bone in order),
        parents=np.array([place.get(int(bones.parents[bone]), -1) for bone in order]),
        rest=bones.rest[order],
        lengths=bones.lengths[order],
    )
    assert found_in(shuffled) == expected(sample)


@pytest.mark.parametrize(
    "factors",
    [{"ForeArm": 1.5, "Hand": 1.5}, {"Leg": 0.6, "Foot": 0.6}, {"Leg": 1.5, "Foot": 1.5}, {"Leg": 1.3, "Foot": 0.8}, {"Hand": 1.4}],
    ids=["long arms", "short legs", "long legs", "long thighs", "long forearms"],
)
def test_odd_proportions_are_still_a_person(factors):
    sample = next(sample for sample in SAMPLE_RIGS if sample.name == "Unreal 4")
    assert found_in(with_lengths(sample, "A", factors)) == expected(sample)


# Where the bones of the CMU rig of MPFB2 have their heads (data/rigs/standard/rig.cmu_mb.json), in metres from the middle of the body: arms
# lowered and held forward, legs apart. The right side is its mirror image.
MAKEHUMAN = {
    "Hips": (0, -0.013, 0.056),
    "LowerBack": (0, 0.026, 0.136),
    "Spine": (0, 0.008, 0.277),
    "Spine1": (0, 0.019, 0.421),
    "Neck": (0, -0.005, 0.596),
    "Neck1": (0, -0.025, 0.646),
    "Head": (0, -0.044, 0.697),
    "LeftShoulder": (0.023, -0.022, 0.525),
    "LeftArm": (0.170, -0.019, 0.502),
    "LeftForeArm": (0.331, -0.020, 0.322),
    "LeftHand": (0.453, -0.183, 0.197),
    "LeftFingerBase": (0.464, -0.209, 0.182),
    "LeftHandIndex1": (0.481, -0.278, 0.157),
    "LeftThumb": (0.454, -0.227, 0.190),
    "LeftHipJoint": (0, -0.013, 0.056),
    "LeftUpLeg": (0.101, -0.005, 0.048),
    "LeftLeg": (0.142, -0.037, -0.343),
    "LeftFoot": (0.181, -0.023, -0.749),
    "LeftToeBase": (0.195, -0.153, -0.793),
}


def test_a_real_character_is_found_as_it_stands():
    sample = next(sample for sample in SAMPLE_RIGS if sample.name == "CMU, MotionBuilder names")
    bones = bones_at_rest(sample)
    rest = bones.rest.copy()
    for i, name in enumerate(bones.bones):
        rest[i, :3, 3] = MAKEHUMAN.get(name) or MAKEHUMAN[name.replace("Right", "Left")] * np.array([-1, 1, 1])
    standing = replace(bones, rest=rest)
    assert found_in(standing) == expected(sample)
    assert recognize(standing).doubts == ()


# What is refused


def bent_over() -> Bones:
    """A person whose trunk is level, all that is above the legs turned about the hips."""
    sample = next(sample for sample in SAMPLE_RIGS if sample.name == "Mixamo")
    bones = bones_at_rest(sample, "hanging")
    hips = bones.rest[bones.index(sample.joints["Hips"]), :3, 3]
    level = transform(quat_from_rotvec(np.array([np.pi / 2, 0, 0])), np.zeros(3))[:3, :3]
    rest = bones.rest.copy()
    for i, name in enumerate(bones.bones):
        if not any(part in name for part in ("Leg", "Foot", "Toe")):
            rest[i, :3, 3] = hips + level @ (rest[i, :3, 3] - hips)
    return replace(bones, rest=rest)


SPIDER = rig("spider", "none", "L R", "\n".join(f"body > leg{i}.{{s}}~{{S}}UpLeg > knee{i}.{{s}}~{{S}}Leg > foot{i}.{{s}}~{{S}}Foot" for i in range(4)))
WALKER = rig("walker", "none", "L R", "body > leg.{s}~{S}UpLeg > knee.{s}~{S}Leg > foot.{s}~{S}Foot > toe.{s}~{S}Toe")
STICK = rig("stick", "none", "L R", "bone")
HAND = rig("hand", "none", "1 2", "hand > {f}1~LeftHand{F}1 > {f}2~LeftHand{F}2 > {f}3~LeftHand{F}3")
ARMS_ON_THE_HIPS = rig(
    "torso",
    "none",
    "L R",
    """
    hips~Hips > arm.{s}~{S}Arm > forearm.{s}~{S}ForeArm > hand.{s}~{S}Hand
    hips > leg.{s}~{S}UpLeg > shin.{s}~{S}Leg > foot.{s}~{S}Foot
    hips > neck~Neck > head~Head
    """,
)
HEADLESS = rig(
    "headless",
    "none",
    "L R",
    """
    hips~Hips > chest~Spine2 > arm.{s}~{S}Arm > forearm.{s}~{S}ForeArm > hand.{s}~{S}Hand
    hips > leg.{s}~{S}UpLeg > shin.{s}~{S}Leg > foot.{s}~{S}Foot
    """,
)
FOUR_ARMS = rig(
    "four arms",
    "none",
    "L R",
    """
    hips~Hips > chest~Spine2 > head~Head
    chest > arm.{s}~{S}Arm > forearm.{s}~{S}ForeArm > hand.{s}~{S}Hand
    chest > wing.{s}~{S}Arm > feather.{s}~{S}ForeArm > tip.{s}~{S}Hand
    hips > leg.{s}~{S}UpLeg > shin.{s}~{S}Leg > foot.{s}~{S}Foot
    """,
)


@pytest.mark.parametrize(
    ("bones", "reason"),
    [
        (bent_over(), "no two chains of bones could be its arms"),
        (bones_at_rest(SPIDER), "more than two chains of bones could be its legs"),
        (bones_at_rest(WALKER), "no two chains of bones could be its arms"),
        (bones_at_rest(STICK), "no two chains of bones could be its legs"),
        (bones_at_rest(HAND), "no two chains of bones could be its legs"),
        (bones_at_rest(ARMS_ON_THE_HIPS), "same bone as its legs"),
        (bones_at_rest(HEADLESS), "no head"),
        (bones_at_rest(FOUR_ARMS), "more than two chains of bones could be its arms"),
    ],
    ids=lambda value: value.name if isinstance(value, Bones) else "",
)
def test_what_is_no_person_is_refused_with_the_reason(bones, reason):
    with pytest.raises(InputError, match=reason):
        find_joints(bones)


@pytest.mark.parametrize("part", ["UpLeg", "Leg"])
@pytest.mark.parametrize("name", ["Mixamo", "Unreal 4", "Unreal 5", "VRM 1", "VRoid", "SMPL", "SMPL-X", "Daz Genesis 9", "Meta, OpenXR body", "3ds Max Biped"])
def test_legs_without_thighs_or_shins_are_refused_and_not_guessed(name, part):
    sample = next(sample for sample in SAMPLE_RIGS if sample.name == name)
    lost = {sample.joints[f"{side}{part}"] for side in ("Left", "Right")}
    bones = {bone: sample.bones[str(parent)] if parent in lost else parent for bone, parent in sample.bones.items() if bone not in lost}
    legless = replace(sample, bones=bones, joints={joint: bone for joint, bone in sample.joints.items() if bone in bones})
    with pytest.raises(InputError):
        find_joints(renamed(bones_at_rest(legless)))


def test_a_body_that_lies_at_rest_is_refused():
    lying = transform(quat_from_rotvec(np.array([1.5, 0, 0])), np.zeros(3))
    for sample in SAMPLE_RIGS:
        with pytest.raises(InputError):
            find_joints(bones_at_rest(sample, object_matrix=lying))


def test_a_level_trunk_is_no_person_by_any_names():
    sample = next(sample for sample in SAMPLE_RIGS if sample.name == "Mixamo")
    assert misshapen(bent_over(), sample.joints) == "its spine is not upright at rest"
    assert misshapen(bones_at_rest(sample, "hanging"), sample.joints) is None
