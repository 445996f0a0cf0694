"""Fingers are found by the shape of a hand, whatever their bones are called."""

from __future__ import annotations

import pytest

from cbm_addon.rigs.recognize import recognize
from cbm_addon.rigs.rig import FINGER_JOINTS
from tests.sample_rigs import SAMPLE_RIGS, SampleRig, bones_at_rest, renamed, rig

FINGERED = [sample for sample in SAMPLE_RIGS if set(FINGER_JOINTS) <= set(sample.joints)]


@pytest.fixture(params=FINGERED, ids=lambda sample: sample.name)
def sample(request: pytest.FixtureRequest) -> SampleRig:
    return request.param


def fingers_found(bones) -> dict[str, str]:
    """The finger joints that are found in the renamed bones, by the bones' own names."""
    own = dict(zip(renamed(bones).bones, bones.bones, strict=True))
    return {joint: own[bone] for joint, bone in recognize(renamed(bones)).mapping.fingers.items()}


@pytest.mark.parametrize("pose", ["T", "A", "hanging"])
def test_every_finger_is_found_with_or_without_bones_in_the_palm_and_at_the_tips(sample, pose):
    assert fingers_found(bones_at_rest(sample, pose)) == {joint: sample.joints[joint] for joint in FINGER_JOINTS}


def test_hands_without_fingers_have_none():
    motion_capture = next(sample for sample in SAMPLE_RIGS if sample.name == "motion capture")
    assert fingers_found(bones_at_rest(motion_capture)) == {}


def test_a_hand_of_four_fingers_lacks_the_last():
    paths = """
        Hips=Hips > Spine=Spine > Spine1=Spine1 > Spine2=Spine2 > Neck=Neck > Head=Head
        Spine2 > {s}Shoulder={S}Shoulder > {s}Arm={S}Arm > {s}ForeArm={S}ForeArm > {s}Hand={S}Hand
        Hips > {s}UpLeg={S}UpLeg > {s}Leg={S}Leg > {s}Foot={S}Foot > {s}Toe={S}Toe
    """
    for finger in ("Thumb", "Index", "Middle", "Ring"):
        paths += "\n" + "{s}Hand > " + " > ".join(f"{{s}}{finger}{i}={{S}}Hand{finger}{i}" for i in (1, 2, 3))
    found = fingers_found(bones_at_rest(rig("four fingers", "cartoon", "Left Right", paths)))
    assert found == {joint: joint.replace("Hand", "") for joint in FINGER_JOINTS if "Pinky" not in joint}
