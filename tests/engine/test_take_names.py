"""Headset and controllers are found by what things are called."""

from __future__ import annotations

import pytest

from cbm_addon.errors import InputError
from cbm_addon.takes.names import choose_devices, find_devices, is_body, words
from cbm_addon.takes.recording import TakeOverrides

FOUND = {
    "our trackers": ("walk origin", "walk head", "walk left", "walk right"),
    "tracking toolkit": ("root", "head", "head Offset", "left_hand", "left_hand Offset", "right_hand", "right_hand Offset"),
    "its nicknames": ("head", "hand.L", "hand.R"),
    "passive bones": ("Hips", "Head", "HMD", "MotionControllerLeft", "MotionControllerRight", "TrackedDevice1"),
    "SteamVR in Unity": ("[CameraRig]", "Controller (left)", "Controller (right)", "Camera (eye)"),
    "body": ("Hips", "Head", "LeftHand", "LeftHandThumb1", "LeftHandIndex1", "RightHand", "RightForeArm"),
    "snake": ("l_hand", "r_hand", "headset_01"),
}
EXPECTED = {
    "our trackers": (1, 2, 3),
    "tracking toolkit": (1, 3, 5),
    "its nicknames": (0, 1, 2),
    "passive bones": (2, 3, 4),
    "SteamVR in Unity": (3, 1, 2),
    "body": (1, 2, 5),
    "snake": (2, 0, 1),
}


@pytest.mark.parametrize("case", FOUND)
def test_devices_are_found(case):
    assert find_devices(FOUND[case]) == dict(zip(("head", "left", "right"), EXPECTED[case], strict=True))


@pytest.mark.parametrize("names", [(), ("Cube", "Light"), ("LeftLeg", "RightFoot"), ("LeftHandThumb1",)])
def test_what_is_no_device_is_not_found(names):
    assert find_devices(names) == {}


def test_words_are_told_apart_by_case_signs_and_digits():
    assert words("MotionControllerLeft") == words("motion_controller.left") == words("Motion-Controller_Left.001") == ["motion", "controller", "left"]
    assert words("XRHand.L") == ["xr", "hand", "l"]


def test_a_body_is_told_from_trackers():
    assert is_body(["Hips", "LeftUpLeg", "Head"])
    assert not is_body(FOUND["tracking toolkit"])


def test_the_user_names_what_is_not_found():
    names = ("Rift", "Cube", "Cube.001")
    with pytest.raises(InputError, match="--head"):
        choose_devices("scene", names, TakeOverrides())
    with pytest.raises(InputError, match="no 'Sphere'; it holds Rift"):
        choose_devices("scene", names, TakeOverrides(head="Sphere"))
    devices, constant = choose_devices("scene", names, TakeOverrides(head="Rift", left="Cube.001"))
    assert devices == {"head": 0, "left": 2}
    assert (constant.value, constant.source) == ("Rift, Cube.001, no right", "given")
