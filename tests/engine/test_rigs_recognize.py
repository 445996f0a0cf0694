"""Recognition: every rig by its names, nothing that is not a body, and never a wrong bone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cbm_addon.errors import InputError
from cbm_addon.motion.rotations import quat_from_rotvec
from cbm_addon.motion.skeleton import BODY_JOINTS
from cbm_addon.rigs.recognize import recognize
from cbm_addon.rigs.rig import Bones
from cbm_addon.rigs.tables import Table, tables
from tests.sample_rigs import POSES, SAMPLE_RIGS, SampleRig, bones_at_rest, renamed, rig, transform

KINDS_BUILT_BY_BLENDER = {"rigify_metarig", "rigify_generated"}


@pytest.fixture(params=SAMPLE_RIGS, ids=lambda sample: sample.name)
def sample(request: pytest.FixtureRequest) -> SampleRig:
    return request.param


def named(name: str) -> Bones:
    return bones_at_rest(next(sample for sample in SAMPLE_RIGS if sample.name == name))


def with_names(bones: Bones, change) -> Bones:
    return replace(bones, bones=tuple(map(change, bones.bones)))


def test_every_table_has_a_rig_to_prove_it():
    assert {sample.kind for sample in SAMPLE_RIGS} | KINDS_BUILT_BY_BLENDER == {table.kind for table in tables()}
    assert all(table.source for table in tables())


@pytest.mark.parametrize("pose", POSES)
def test_a_rig_is_known_by_its_names_and_every_bone_is_the_right_one(sample, pose):
    found = recognize(bones_at_rest(sample, pose))
    assert found.mapping.kind == sample.kind
    assert found.mapping.joints | found.mapping.fingers == sample.joints
    assert found.score == 1
    assert found.ranking[0] == (found.mapping.table.title, found.score)
    assert set(found.doubts) <= {found.mapping.table.note}


@pytest.mark.parametrize("change", [str.upper, str.lower, "Hero:{}".format, "Armature|Hero_{}".format, lambda name: name.replace("_", "-")])
def test_prefixes_case_and_separators_do_not_matter(sample, change):
    found = recognize(with_names(bones_at_rest(sample), change))
    assert found.mapping.kind == sample.kind
    assert found.mapping.joints == {joint: change(bone) for joint, bone in sample.joints.items() if joint in BODY_JOINTS}


def test_no_other_table_fits_a_rig_as_well(sample):
    """Where another fits nearly as well and with other bones, that is a doubt."""
    found = recognize(bones_at_rest(sample))
    assert [score for _, score in found.ranking] == sorted((score for _, score in found.ranking), reverse=True)
    assert not [doubt for doubt in found.doubts if "fits about as well" in doubt]


def test_a_rig_without_toes_and_fingers_is_known_with_a_lower_score_and_the_doubt_said():
    bones = named("Mixamo")
    bones = with_names(bones, lambda name: f"extra {name}" if "Toe" in name or "Index" in name else name)
    found = recognize(bones)
    assert found.mapping.kind == "mixamo"
    assert 0.8 < found.score < 1
    assert any("LeftToe, RightToe" in doubt for doubt in found.doubts)
    assert any("6 of its finger joints" in doubt for doubt in found.doubts)


def test_names_that_the_shape_contradicts_are_a_doubt():
    """A forearm that is called by another name, and its twist bone by the forearm's."""
    names = {"lowerarm01.L": "other", "lowerarm02.L": "lowerarm01.L"}
    doubts = recognize(with_names(named("MakeHuman default"), lambda name: names.get(name, name))).doubts
    assert "LeftForeArm is lowerarm01.L by its name, but other by the shape of the armature" in doubts


def test_left_and_right_exchanged_by_name_are_found_out_by_the_feet():
    bones = named("Unreal 4")
    exchanged = with_names(bones, lambda name: name[:-2] + {"_l": "_r", "_r": "_l"}.get(name[-2:], name[-2:]))
    found = recognize(exchanged)
    assert found.mapping.kind == "shape"
    assert found.mapping.joints["LeftHand"] == "hand_r"
    assert found.doubts


def test_constraints_on_mapped_bones_are_a_doubt():
    bones = named("Mixamo")
    constrained = np.array([name.endswith(("LeftHand", "LeftFoot")) for name in bones.bones])
    assert any("constraints move" in doubt for doubt in recognize(replace(bones, constrained=constrained)).doubts)


def test_twist_bones_are_keyed_with_growing_shares_of_the_roll():
    """Forearm and shin: the more of the hand's and the foot's the nearer to it. Upper arm and thigh: their own, taken back from the other end on."""
    shares = {control.bone: control.roll for control in recognize(named("Unreal 5")).mapping.controls if control.roll}
    first, second = 1 / 3, 2 / 3
    by_place = {"lowerarm_twist_02": first, "lowerarm_twist_01": second, "calf_twist_02": first, "calf_twist_01": second}
    by_place |= {f"{limb}_twist_0{i}": share - 1 for limb in ("upperarm", "thigh") for i, share in ((1, first), (2, second))}
    assert shares == {f"{bone}_{side}": pytest.approx(share) for side in "lr" for bone, share in by_place.items()}


@pytest.mark.parametrize("name", ["MakeHuman default", "Daz Genesis 8", "Auto-Rig Pro export"])
def test_twist_bones_that_carry_the_limb_on_do_not_take_its_roll(name):
    controls = recognize(named(name)).mapping.controls
    assert not [control for control in controls if control.roll and control.joint.endswith(("UpLeg", "LeftArm", "RightArm"))]


@pytest.mark.parametrize(("name", "root"), [("Unreal 5", "root"), ("Mixamo", None), ("Auto-Rig Pro controls", "c_traj"), ("3ds Max Biped", "Bip001")])
def test_the_bone_that_may_carry_the_way_is_above_the_hips(name, root):
    assert recognize(named(name)).mapping.root == root


# A user's own choice


def a_map(sample: SampleRig, **other: str) -> Table:
    joints = {joint: (bone,) for joint, bone in (sample.joints | other).items() if joint in BODY_JOINTS}
    return Table("mine", "my map", "by hand", joints, {})


def test_a_map_that_is_given_wins_over_what_would_be_recognised():
    sample = next(sample for sample in SAMPLE_RIGS if sample.name == "Unreal 5")
    found = recognize(bones_at_rest(sample), a_map(sample, Spine1="spine_04"))
    assert (found.mapping.kind, found.mapping.joints["Spine1"]) == ("mine", "spine_04")


def test_a_map_that_is_given_is_used_where_nothing_is_recognised():
    sample = next(sample for sample in SAMPLE_RIGS if sample.name == "Mixamo")
    bones = bones_at_rest(sample)
    lying = renamed(replace(bones, object_matrix=transform(quat_from_rotvec(np.array([1.4, 0, 0])), np.zeros(3))))
    with pytest.raises(InputError, match="no two chains of bones could be its legs"):
        recognize(lying)
    new_name = dict(zip(bones.bones, lying.bones, strict=True))
    mine = Table("mine", "my map", "by hand", {joint: (new_name[bone],) for joint, bone in sample.joints.items()}, {})
    found = recognize(lying, mine)
    assert found.mapping.joints == {joint: new_name[bone] for joint, bone in sample.joints.items() if joint in BODY_JOINTS}
    assert any("not that of a person" in doubt for doubt in found.doubts)


@pytest.mark.parametrize(
    ("other", "message"),
    [
        ({"Head": "nobody"}, "lacks bones for Head .*my map"),
        ({"LeftArm": "thigh_l"}, "LeftArm|more than one joint"),
        ({"LeftLeg": "calf_r"}, "more than one joint"),
        ({"LeftHand": "root"}, "not below"),
    ],
)
def test_a_map_that_cannot_be_is_refused(other, message):
    sample = next(sample for sample in SAMPLE_RIGS if sample.name == "Unreal 4")
    with pytest.raises(InputError, match=message):
        recognize(bones_at_rest(sample), a_map(sample, **other))


# What is no body


def test_half_a_body_is_refused_with_what_it_lacks():
    sample = next(sample for sample in SAMPLE_RIGS if sample.name == "motion capture")
    names = [bone for bone in sample.bones if not any(part in bone for part in ("Leg", "Foot", "Toe"))]
    half = replace(sample, name="half a body", bones={bone: sample.bones[bone] for bone in names}, joints={bone: bone for bone in names})
    with pytest.raises(InputError, match=r"half a body: lacks bones for LeftUpLeg .*RightFoot"):
        recognize(bones_at_rest(half))


def test_one_line_says_why_something_is_no_body():
    chain = rig("snake", "none", "L R", "a > b > c > d > e > f > g")
    with pytest.raises(InputError, match="neither the names of a known rig nor the shape of a person: no two chains of bones could be its legs") as error:
        recognize(bones_at_rest(chain))
    assert "\n" not in str(error.value)


def test_a_leg_that_hangs_beside_the_hips_is_refused():
    bones = named("motion capture")
    parents = bones.parents.copy()
    parents[bones.index("LeftUpLeg")] = -1
    with pytest.raises(InputError, match="LeftUpLeg.*parent it below Hips"):
        recognize(replace(bones, parents=parents))
