"""Takes made from mocap: joint poses as they are, device poses that calibration takes back, noise by seed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cbm_addon.errors import InputError
from cbm_addon.motion.rotations import difference, rotate
from cbm_addon.motion.skeleton import STANDARD_BODY
from cbm_addon.takes.calibrate import CalibrationOptions, calibrate
from cbm_addon.takes.devices import CONTROLLERS, EYE_SHARE, HEAD_JOINT_SHARE, RAW
from cbm_addon.takes.sample_motion import sample_motion
from cbm_addon.takes.synthesize import TRACKED_JOINTS, synthesize
from cbm_addon.takes.take import HEAD, LEFT, RIGHT

MOTION = sample_motion()
JOINTS = synthesize(MOTION)


def test_joint_poses_are_those_of_the_motion():
    world, positions = MOTION.forward()
    joints = MOTION.skeleton.indices(TRACKED_JOINTS)
    assert JOINTS.kind == "joint"
    assert JOINTS.tracked.all()
    np.testing.assert_array_equal(JOINTS.times, MOTION.times)
    np.testing.assert_allclose(JOINTS.positions, positions[:, joints], atol=1e-5)
    assert difference(JOINTS.rotations, world[:, joints]).max() < 1e-3


@pytest.mark.parametrize("stature", [1.2, 1.75, 2.0])
@pytest.mark.parametrize("device", CONTROLLERS)
def test_calibration_takes_device_poses_back_to_the_joints(device, stature):
    factor = np.float32(stature / 1.75)
    motion = replace(MOTION, skeleton=MOTION.skeleton.scaled(float(factor)), root=MOTION.root * factor)
    truth = synthesize(motion)
    head_height = motion.skeleton.height_above_toes()
    options = CalibrationOptions(eye_height=head_height * EYE_SHARE / HEAD_JOINT_SHARE)
    calibrated = calibrate(synthesize(motion, device=device), options)
    assert calibrated.calibration.head_height == pytest.approx(head_height, abs=1e-6)
    np.testing.assert_allclose(calibrated.take.positions, truth.positions, atol=1e-5)
    assert difference(calibrated.take.rotations, truth.rotations).max() < 1e-3


def at_rest(device: str):
    """The device poses of a body in the T-pose that faces -Y."""
    rotations = np.zeros((2, len(STANDARD_BODY), 4), np.float32)
    rotations[..., 0] = 1
    return synthesize(replace(MOTION, times=np.arange(2.0), root=np.zeros((2, 3), np.float32), rotations=rotations), device)


@pytest.mark.parametrize("device", CONTROLLERS)
def test_devices_in_the_t_pose(device):
    """The headset looks along -Y from before and above the head joint. The backs of the hands are up; a handle leans between the thumb (-Y)
    and the fingers; each controller is farther out than its wrist."""
    take = at_rest(device)
    rest = STANDARD_BODY.rest_positions()
    np.testing.assert_allclose(take.rotations[0, HEAD], [1, 0, 0, 0], atol=1e-6)
    assert take.positions[0, HEAD, 1] < rest[STANDARD_BODY.index("Head"), 1]
    assert take.positions[0, HEAD, 2] > rest[STANDARD_BODY.index("Head"), 2]
    for hand, side, joint in ((LEFT, 1, "LeftHand"), (RIGHT, -1, "RightHand")):
        out_of_the_back = rotate(take.rotations[0, hand], np.array([side, 0, 0], np.float32))
        handle = rotate(take.rotations[0, hand], np.array([0, -1, 0], np.float32))
        np.testing.assert_allclose(out_of_the_back, [0, 0, 1], atol=1e-6)
        assert handle[1] < -0.5
        assert side * handle[0] > 0.5
        assert side * (take.positions[0, hand, 0] - rest[STANDARD_BODY.index(joint), 0]) > 0.05


def test_a_raw_origin_lies_before_the_hand():
    """The origin of a raw pose is a hand's length beyond the fist."""
    take = at_rest("index")
    wrist = STANDARD_BODY.rest_positions()[STANDARD_BODY.index("LeftHand")]
    np.testing.assert_allclose(np.linalg.norm(take.positions[0, LEFT] - wrist), np.linalg.norm(RAW.wrist), atol=1e-6)
    assert np.linalg.norm(RAW.wrist) > 0.15


def test_noise_has_the_size_asked_for_and_comes_from_the_seed():
    noisy = synthesize(MOTION, noise=(3.0, 2.0), seed=4)
    assert np.std(noisy.positions - JOINTS.positions) * 1000 == pytest.approx(3, rel=0.02)
    mean_square = np.mean(np.degrees(difference(noisy.rotations, JOINTS.rotations)) ** 2)
    assert np.sqrt(mean_square / 3) == pytest.approx(2, rel=0.02)
    np.testing.assert_array_equal(synthesize(MOTION, noise=(3.0, 2.0), seed=4).positions, noisy.positions)
    assert not np.array_equal(synthesize(MOTION, noise=(3.0, 2.0), seed=5).positions, noisy.positions)


def test_a_headset_alone():
    take = synthesize(MOTION, device="quest2", head_only=True)
    assert take.tracked.all(axis=0).tolist() == [True, False, False]
    assert np.isnan(take.positions[:, LEFT]).all()
    assert np.isfinite(calibrate(take).take.positions).all()


def test_unknown_devices_and_bodies_are_refused():
    with pytest.raises(InputError, match="'wand'"):
        synthesize(MOTION, device="wand")
    names = tuple(name.replace("Hand", "Paw") for name in MOTION.skeleton.names)
    with pytest.raises(InputError, match="no joint LeftHand, RightHand"):
        synthesize(replace(MOTION, skeleton=replace(MOTION.skeleton, names=names)))
