"""Calibration: floor, eye height and offsets are constants of the take, measured, given or assumed, and said to be so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cbm_addon.errors import InputError
from cbm_addon.motion.rotations import IDENTITY, difference, multiply, quat_from_axis_angle, rotate
from cbm_addon.takes.calibrate import ADULT_STATURE, CalibrationOptions, calibrate
from cbm_addon.takes.devices import CONTROLLERS, EYE_SHARE
from cbm_addon.takes.frames import AXES
from cbm_addon.takes.sample_motion import sample_motion
from cbm_addon.takes.synthesize import synthesize
from cbm_addon.takes.take import HEAD, LEFT, RIGHT

MOTION = sample_motion()
TRUTH = synthesize(MOTION)
TAKE = synthesize(MOTION, device="quest2")
HEAD_HEIGHT = MOTION.skeleton.height_above_toes()
EYE_HEIGHT = EYE_SHARE * 1.75


def moved(metres: float, take=TAKE):
    return replace(take, positions=take.positions + np.array([0, 0, metres], np.float32))


def sources(calibrated) -> dict[str, str]:
    return {name: constant.source for name, constant in calibrated.calibration.constants.items()}


def test_standing_height_is_measured_though_the_body_walks_and_crouches():
    calibrated = calibrate(TAKE)
    assert calibrated.calibration.head_height == pytest.approx(HEAD_HEIGHT, rel=0.01)
    assert calibrated.calibration.eye_height == pytest.approx(EYE_HEIGHT, rel=0.01)
    assert sources(calibrated)["eye_height"] == "measured"
    np.testing.assert_allclose(calibrated.take.positions, TRUTH.positions, atol=0.002)
    assert calibrated.calibration.warnings == ()


def test_a_calibrated_take_is_of_joints_and_keeps_times_and_extras():
    take = replace(TAKE, extras={"grip_left": np.ones(len(TAKE), np.float32)})
    calibrated = calibrate(take).take
    assert calibrated.kind == "joint"
    assert calibrated.positions.dtype == calibrated.rotations.dtype == np.float32
    np.testing.assert_array_equal(calibrated.times, take.times)
    np.testing.assert_array_equal(calibrated.extras["grip_left"], 1)


def test_joint_poses_need_no_devices():
    calibrated = calibrate(TRUTH)
    np.testing.assert_array_equal(calibrated.take.positions, TRUTH.positions)
    assert calibrated.calibration.head_height == pytest.approx(HEAD_HEIGHT, rel=0.01)
    assert "device" not in calibrated.calibration.constants


def test_looking_down_throughout_does_not_make_a_person_smaller():
    """The eyes sink by centimetres, the joint that carries the head does not."""
    motion = MOTION
    head = motion.skeleton.index("Head")
    rotations = motion.rotations.copy()
    down = quat_from_axis_angle(np.array([1, 0, 0], np.float32), np.float32(0.7))
    rotations[:, head] = multiply(rotations[:, head], down)
    looking_down = synthesize(replace(motion, rotations=rotations), device="quest2")
    assert np.percentile(looking_down.positions[:, HEAD, 2], 95) < np.percentile(TAKE.positions[:, HEAD, 2], 95) - 0.05
    assert calibrate(looking_down).calibration.head_height == pytest.approx(HEAD_HEIGHT, rel=0.01)


def test_an_origin_at_eye_level_is_put_on_the_floor():
    """Like a game whose floor is at the eyes: only an assumed or given eye height can tell."""
    given = calibrate(moved(-EYE_HEIGHT), CalibrationOptions(eye_height=EYE_HEIGHT))
    assert given.calibration.floor == pytest.approx(-EYE_HEIGHT, abs=0.02)
    np.testing.assert_allclose(given.take.positions, TRUTH.positions, atol=0.02)
    assumed = calibrate(moved(-EYE_HEIGHT))
    assert sources(assumed)["eye_height"] == "assumed"
    assert assumed.calibration.stature == ADULT_STATURE
    assert np.percentile(assumed.take.positions[:, HEAD, 2], 95) == pytest.approx(assumed.calibration.head_height)
    assert len(assumed.calibration.warnings) == 2


def test_a_head_beyond_human_height_is_not_believed():
    high = calibrate(moved(1.0))
    assert high.calibration.stature == ADULT_STATURE
    assert high.calibration.floor == pytest.approx(1.0, abs=0.1)


def test_a_given_floor_is_subtracted():
    calibrated = calibrate(moved(0.4), CalibrationOptions(floor=0.4))
    np.testing.assert_allclose(calibrated.take.positions, TRUTH.positions, atol=0.002)
    assert sources(calibrated)["floor"] == "given"
    assert calibrated.calibration.head_height == pytest.approx(HEAD_HEIGHT, rel=0.01)


def test_a_given_eye_height_wins():
    calibration = calibrate(TAKE, CalibrationOptions(eye_height=1.9)).calibration
    assert calibration.eye_height == pytest.approx(1.9)
    assert calibration.constants["eye_height"].source == "given"
    assert calibration.floor == 0


def test_a_seated_performer_has_an_assumed_height_over_a_measured_floor():
    seated = calibrate(moved(-0.4), CalibrationOptions(seated=True))
    assert seated.calibration.stature == ADULT_STATURE
    assert seated.calibration.floor == 0
    at_the_eyes = calibrate(moved(-EYE_HEIGHT), CalibrationOptions(seated=True))
    assert np.percentile(at_the_eyes.take.positions[:, HEAD, 2], 95) == pytest.approx(0.7 * ADULT_STATURE - 0.07, abs=0.02)


def test_who_never_stands_is_warned_about():
    assert "nobody stands" in calibrate(moved(-0.4)).calibration.warnings[0]


def test_offsets_can_be_given_and_are_mirrored_for_the_right():
    options = CalibrationOptions(head_offset=(0, 0, 0), wrist_offset=(0, 0, 0))
    calibrated = calibrate(TAKE, options)
    np.testing.assert_allclose(calibrated.take.positions, TAKE.positions, atol=1e-6)
    assert {sources(calibrated)[name] for name in ("head_offset", "wrist_offset")} == {"given"}
    outward = calibrate(TAKE, replace(options, wrist_offset=(0.1, 0, 0))).take.positions - TAKE.positions
    np.testing.assert_allclose(np.linalg.norm(outward[:, [LEFT, RIGHT]], axis=-1), 0.1, atol=1e-6)
    standing = TAKE.times < 1
    assert (outward[standing, LEFT, 0] > 0.05).all()  # out of the backs of the hands
    assert (outward[standing, RIGHT, 0] < -0.05).all()


def test_the_device_comes_from_the_user_the_take_or_an_assumption():
    silent = replace(TAKE, report=None)
    assert sources(calibrate(silent))["device"] == "assumed"
    assert sources(calibrate(TAKE))["device"] == "format"
    calibrated = calibrate(TAKE, CalibrationOptions(device="index"))
    assert (calibrated.calibration.constants["device"].value, sources(calibrated)["device"]) == ("index", "given")


def test_reach_tells_a_wrong_size():
    assert calibrate(TAKE).calibration.reach == 1
    small = calibrate(TAKE, CalibrationOptions(eye_height=1.0)).calibration
    assert small.reach < 0.5
    assert "reaches the wrist" in small.warnings[-1]


def test_lost_samples_are_filled_and_stay_marked():
    tracked = TAKE.tracked.copy()
    tracked[200:600, LEFT] = False
    tracked[700:710, RIGHT] = False
    hidden = np.where(tracked[..., None], 1, np.nan).astype(np.float32)
    take = replace(TAKE, positions=TAKE.positions * hidden, rotations=TAKE.rotations * hidden, tracked=tracked)
    calibrated = calibrate(take).take
    assert np.isfinite(calibrated.positions).all()
    np.testing.assert_allclose(np.linalg.norm(calibrated.rotations, axis=-1), 1, atol=1e-5)
    assert (np.sum(calibrated.rotations[1:] * calibrated.rotations[:-1], axis=-1) > 0).all()
    np.testing.assert_array_equal(calibrated.tracked, tracked)


def test_poses_of_joints_can_be_declared():
    """A take that its format calls one of devices, whatever was recorded."""
    calibrated = calibrate(replace(TRUTH, kind="device"), CalibrationOptions(device="none"))
    np.testing.assert_array_equal(calibrated.take.positions, TRUTH.positions)
    assert "device" not in calibrated.calibration.constants


def test_controllers_of_one_hand_differ_by_where_their_poses_are():
    """SteamVR's models of Quest controllers put the grip pose 7 mm to the side of the raw pose, 1.8 mm below and 101.9 mm behind it, tilted
    by 20.6° (OpenXR axes). A hand on the grip is where a hand on the raw pose is."""
    to_engine = AXES["openxr"]
    tilt = quat_from_axis_angle(to_engine @ np.array([1.0, 0, 0]), np.radians(20.6))
    grip, touch = CONTROLLERS["grip"], CONTROLLERS["touch-steamvr"]
    wrist = to_engine @ np.array([0.007, -0.00183, 0.10195]) + rotate(tilt, np.array(grip.wrist))
    np.testing.assert_allclose(touch.wrist, wrist, atol=0.001)
    assert np.degrees(difference(touch.wrist_rotation(), multiply(tilt, grip.wrist_rotation()))) < 0.1


def test_arm_reach_is_measured():
    constant = calibrate(TRUTH).calibration.constants["arm_reach"]
    rest = MOTION.skeleton
    arm = np.linalg.norm(rest.offsets[rest.index("LeftForeArm")]) + np.linalg.norm(rest.offsets[rest.index("LeftHand")])
    assert constant.value == pytest.approx(arm, rel=0.1)
    alone = synthesize(MOTION, device="quest2", head_only=True)
    assert "arm_reach" not in calibrate(alone).calibration.constants


def test_a_hand_under_the_floor_is_told():
    positions = TAKE.positions.copy()
    positions[500:520, LEFT, 2] -= positions[500:520, LEFT, 2].max() + 0.3
    warnings = calibrate(replace(TAKE, positions=positions)).calibration.warnings
    assert any("under the floor" in warning for warning in warnings)


def posed(device: str = "quest2", crouch: float = 0.0):
    """A second in the T-pose in which the skeleton rests, then the sample, lower by `crouch` metres."""
    still = replace(MOTION, times=MOTION.times[:90], root=np.repeat(MOTION.root[:1], 90, axis=0), rotations=np.tile(IDENTITY, (90, len(MOTION.skeleton), 1)))
    still = replace(still, root=still.root + np.float32([0, 0, MOTION.skeleton.height_above_toes() - still.positions()[0, MOTION.skeleton.index("Head"), 2]]))
    first, rest = synthesize(still, device=device), moved(-crouch, synthesize(MOTION, device=device))
    return replace(
        rest,
        times=np.concatenate((first.times, rest.times + first.times[-1] + 1 / 72)),
        positions=np.concatenate((first.positions, rest.positions)),
        rotations=np.concatenate((first.rotations, rest.rotations)),
        tracked=np.concatenate((first.tracked, rest.tracked)),
    )


def test_the_t_pose_tells_the_height_of_who_hardly_stands_otherwise():
    calibration = calibrate(posed(crouch=0.35)).calibration
    assert calibration.constants["t_pose"].value == "0.0 to 1.2 s"
    assert calibration.head_height == pytest.approx(HEAD_HEIGHT, rel=0.01)
    assert "T-pose" in calibration.constants["eye_height"].why
    assert "t_pose" not in calibrate(TAKE).calibration.constants


def test_the_t_pose_tells_the_wrong_controllers():
    def pointing(options: CalibrationOptions) -> list[str]:
        return [warning for warning in calibrate(posed("quest2"), options).calibration.warnings if "away from the arms" in warning]

    assert pointing(CalibrationOptions()) == []
    assert pointing(CalibrationOptions(device="index")) == []  # 15° of difference are within how people hold things
    assert pointing(CalibrationOptions(device="none")) != []


def test_a_headset_alone_gives_a_whole_take():
    alone = calibrate(synthesize(MOTION, device="quest2", head_only=True))
    assert np.isfinite(alone.take.positions).all()
    assert alone.calibration.head_height == pytest.approx(HEAD_HEIGHT, rel=0.01)
    assert alone.calibration.warnings == ()


@pytest.mark.parametrize(
    "options",
    [
        CalibrationOptions(eye_height=165),
        CalibrationOptions(eye_height=float("nan")),
        CalibrationOptions(floor=float("inf")),
        CalibrationOptions(device="wand"),
        CalibrationOptions(head_offset=(0, 9, 0)),
        CalibrationOptions(wrist_offset=(float("nan"), 0, 0)),
    ],
)
def test_options_out_of_this_world_are_refused(options):
    with pytest.raises(InputError):
        calibrate(TAKE, options)


def test_a_report_is_plain_data():
    facts = calibrate(TAKE).calibration.as_dict()
    assert facts["head_height"] == pytest.approx(HEAD_HEIGHT, rel=0.01)
    assert facts["constants"]["floor"] == {"value": 0.0, "source": "assumed", "why": "the origin of the recording", "confidence": None}
