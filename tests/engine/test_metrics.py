"""The metrics say what they are named for: motions whose errors are known by construction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cbm_addon.evaluate.metrics import measure, measure_raw, weighted_means
from cbm_addon.features import LOWER_JOINTS, RATE
from cbm_addon.motion.motion import Motion
from cbm_addon.motion.rotations import IDENTITY, multiply, quat_from_yaw, rotate
from cbm_addon.motion.skeleton import STANDARD_BODY, Skeleton
from tests.performances import true_performance

POSITIONS = ("lower_mpjpe_cm", "hips_cm", "feet_cm", "mpjpe_cm", "tracker_cm")
ANGLES = ("mpjre_deg", "root_deg", "tracker_deg")
RATIOS = ("detail_ratio", "jitter_ratio", "upper_detail_ratio", "upper_jitter_ratio", "contact_f1")


def standing(frames: int = 60) -> Motion:
    """The standard body at rest, its toes on the floor."""
    root = np.zeros((frames, 3), np.float32)
    root[:, 2] = STANDARD_BODY.height_above_toes("Hips")
    return Motion(STANDARD_BODY, np.arange(frames) / RATE, root, np.tile(IDENTITY, (frames, len(STANDARD_BODY), 1)))


def moved(motion: Motion, step) -> Motion:
    return replace(motion, root=motion.root + np.asarray(step, np.float32))


def turned(motion: Motion, yaw) -> Motion:
    """The motion turned about the world's Z; yaw radians, a number or one per frame."""
    turn = quat_from_yaw(np.broadcast_to(np.asarray(yaw, np.float32), len(motion)))
    rotations = motion.rotations.copy()
    rotations[:, 0] = multiply(turn, rotations[:, 0])
    return replace(motion, root=rotate(turn, motion.root), rotations=rotations)


def test_the_truth_against_itself_is_perfect(body_motion: Motion) -> None:
    values = measure(body_motion, body_motion)
    for name in (*POSITIONS, *ANGLES, "root_cm"):
        assert values[name] == pytest.approx(0, abs=1e-3), name
    for name in RATIOS:
        assert values[name] == 1, name
    assert values["slide_cm_s"] == values["slide_truth_contact_cm_s"] == values["slide_gt_cm_s"]
    assert values["penetration_p99_cm"] == values["penetration_gt_p99_cm"]


def test_a_centimetre_aside_is_a_centimetre(body_motion: Motion) -> None:
    values = measure(moved(body_motion, (0.006, -0.008, 0)), body_motion)
    for name in (*POSITIONS, "root_cm"):
        assert values[name] == pytest.approx(1, abs=1e-3), name
    for name in ANGLES:
        assert values[name] == pytest.approx(0, abs=1e-3), name
    for name in RATIOS:
        assert values[name] == pytest.approx(1, abs=1e-3), name


def test_a_centimetre_down_goes_under_the_floor_and_leaves_the_root_where_it_is() -> None:
    values = measure(moved(standing(), (0, 0, -0.01)), standing())
    assert values["hips_cm"] == pytest.approx(1, abs=1e-4)
    assert values["root_cm"] == 0
    assert values["penetration_p99_cm"] == pytest.approx(1, abs=1e-4)
    assert values["penetration_gt_p99_cm"] == pytest.approx(0, abs=1e-4)


def test_a_turn_of_the_whole_body_is_an_error_of_one_local_rotation_and_of_the_heading(body_motion: Motion) -> None:
    values = measure(turned(body_motion, np.radians(11)), body_motion)
    assert values["root_deg"] == pytest.approx(11, abs=1e-2)
    assert values["tracker_deg"] == pytest.approx(11, abs=1e-2)
    assert values["mpjre_deg"] == pytest.approx(11 / 22, abs=1e-2)


def test_a_body_that_glides_slides_in_its_own_and_in_the_true_contacts() -> None:
    truth = standing()
    values = measure(moved(truth, truth.times[:, None] * [0.03, 0.04, 0]), truth)
    assert values["slide_cm_s"] == pytest.approx(5, abs=1e-3)
    assert values["slide_truth_contact_cm_s"] == pytest.approx(5, abs=1e-3)
    assert values["slide_gt_cm_s"] == 0
    assert values["contact_f1"] == 1


def test_a_body_in_flight_has_no_contact_to_slide_in() -> None:
    truth = standing()
    values = measure(moved(truth, truth.times[:, None] * [2.0, 0, 0]), truth)
    assert np.isnan(values["slide_cm_s"])
    assert values["slide_truth_contact_cm_s"] == pytest.approx(200, abs=0.01)
    assert values["contact_f1"] == 0


def test_contact_f1_counts_missed_contacts() -> None:
    truth = standing(60)
    lift = np.zeros((60, 3))
    lift[30:, 2] = 0.1
    assert measure(moved(truth, lift), truth)["contact_f1"] == pytest.approx(2 * 30 / (30 + 60))


def test_detail_is_the_mean_local_rotation_speed_of_nine_joints() -> None:
    truth = standing()
    turning = [turned(truth, np.radians(speed) * truth.times) for speed in (30, 45)]
    values = measure(turning[1], turning[0])
    assert values["detail_gt_deg_s"] == pytest.approx(30 / 9, rel=1e-3)
    assert values["detail_ratio"] == pytest.approx(1.5, rel=1e-3)


def test_jitter_is_the_third_derivative() -> None:
    truth = standing(12)
    jerks = [moved(truth, (jerk * truth.times**3 / 6)[:, None] * [1, 0, 0]) for jerk in (300, 600)]
    values = measure(jerks[1], jerks[0])
    assert values["jitter_gt_100m_s3"] == pytest.approx(3, rel=1e-3)
    assert values["jitter_ratio"] == pytest.approx(2, rel=1e-3)
    assert values["upper_jitter_ratio"] == pytest.approx(2, rel=1e-3)


def test_a_spine_that_turns_is_detail_of_the_upper_body_alone() -> None:
    truth = standing()

    def twisting(speed: float) -> Motion:
        rotations = truth.rotations.copy()
        rotations[:, truth.skeleton.index("Spine1")] = quat_from_yaw((np.radians(speed) * truth.times).astype(np.float32))
        return replace(truth, rotations=rotations)

    values = measure(twisting(45), twisting(30))
    assert values["upper_detail_ratio"] == pytest.approx(1.5, rel=1e-3)
    assert values["detail_gt_deg_s"] == pytest.approx(0, abs=1e-3)


def test_ratios_to_a_truth_that_does_not_move_are_not_defined() -> None:
    values = measure(moved(standing(), (0.1, 0, 0)), standing())
    assert np.isnan(values["detail_ratio"])
    assert np.isnan(values["jitter_ratio"])


def test_joints_that_the_engine_does_not_know_are_left_out(body_motion: Motion) -> None:
    body = body_motion.skeleton
    longer = Skeleton(
        (*body.names, "LeftThumb"),
        np.append(body.parents, body.index("LeftHand")),
        np.vstack((body.offsets, [[0.1, 0, 0]])).astype(np.float32),
        np.vstack((body.tips, np.full((1, 3), np.nan))).astype(np.float32),
    )
    rotations = np.concatenate((body_motion.rotations, body_motion.rotations[:, :1]), axis=1)
    other = replace(body_motion, skeleton=longer, rotations=rotations)
    assert measure(body_motion, other) == measure(body_motion, body_motion)


def test_a_true_performance_has_no_raw_error(body_motion: Motion) -> None:
    values = measure_raw(true_performance(body_motion), body_motion)
    assert values["raw_lower_mpjpe_cm"] == pytest.approx(0, abs=0.01)
    assert values["raw_tracker_cm"] == pytest.approx(0, abs=0.01)


def test_hips_that_are_off_carry_head_and_hands_along(body_motion: Motion) -> None:
    said = true_performance(body_motion)
    off = said.lower_positions.copy()
    off[:, LOWER_JOINTS.index("Hips"), 1] += np.float32(0.09 / said.head_height)
    values = measure_raw(replace(said, lower_positions=off), body_motion)
    assert values["raw_tracker_cm"] == pytest.approx(9, abs=0.01)
    assert values["raw_lower_mpjpe_cm"] == pytest.approx(1, abs=0.01)


def test_means_over_clips_are_weighted_by_seconds_and_leave_out_what_is_not_defined() -> None:
    nan = float("nan")
    means = weighted_means([{"a": 1.0, "b": nan, "c": nan}, {"a": 4.0, "b": 2.0, "c": nan}, {"a": 1.0, "b": 5.0}], [10.0, 20.0, 10.0])
    assert means["a"] == pytest.approx(2.5)
    assert means["b"] == pytest.approx(3)
    assert np.isnan(means["c"])
