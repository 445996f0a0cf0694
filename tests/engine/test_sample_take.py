"""The shipped sample: made again byte for byte, and a motion that a body could do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import cbm_addon.takes
from cbm_addon.motion.contacts import contact_labels
from cbm_addon.motion.rotations import difference, normalize, rotate
from cbm_addon.takes import native_csv
from cbm_addon.takes.calibrate import calibrate
from cbm_addon.takes.readers import read_take
from cbm_addon.takes.sample_motion import RATE, WALKS, sample_motion, sample_take

SHIPPED = Path(cbm_addon.takes.__file__).parent / "sample" / "walk_turn_crouch.csv"

MOTION = sample_motion()
WORLD, PLACES = MOTION.forward()
FORWARD = np.array([0, -1, 0], np.float32)


def place(joint: str) -> np.ndarray:
    return PLACES[:, MOTION.skeleton.index(joint)]


def speed(joint: str) -> np.ndarray:
    """Metres per second over the floor."""
    return np.linalg.norm(np.gradient(place(joint)[:, :2], axis=0), axis=-1) * RATE


def during(start: float, end: float) -> np.ndarray:
    return (MOTION.times >= start) & (MOTION.times < end)


def test_shipped_file_is_made_again_byte_for_byte(tmp_path):
    native_csv.write(tmp_path / "again.csv", sample_take())
    assert (tmp_path / "again.csv").read_bytes() == SHIPPED.read_bytes()
    assert SHIPPED.stat().st_size < 1.5e6


def test_shipped_file_reads_without_a_defect_and_calibrates_to_the_body():
    take = read_take(SHIPPED)
    assert take.report.defects == ()
    assert take.kind == "device"
    assert 30 <= take.seconds <= 40
    calibrated = calibrate(take)
    assert calibrated.calibration.head_height == pytest.approx(MOTION.skeleton.height_above_toes(), rel=0.01)
    assert calibrated.calibration.reach == 1
    assert calibrated.calibration.warnings == ()


def test_it_walks_turns_stops_and_crouches():
    assert np.median(speed("Hips")[during(3, 9)]) == pytest.approx(WALKS[0].speed, rel=0.1)
    assert speed("Hips")[during(20, 24)].max() < 0.05
    facing = rotate(WORLD[:, 0], FORWARD)
    assert np.sum(facing[during(3, 3.1)].mean(axis=0) * facing[during(9.5, 9.6)].mean(axis=0)) < -0.9
    assert place("Head")[during(16.2, 17.9), 2].max() < 0.7 * place("Head")[during(0, 1), 2].min()


def test_it_waves_and_points():
    assert (place("RightHand")[during(21.3, 23.8), 2] > place("RightArm")[during(21.3, 23.8), 2]).all()
    reach = place("LeftHand") - place("LeftArm")
    ahead = np.sum(reach * rotate(WORLD[:, 0], FORWARD), axis=-1)
    assert ahead[during(25.6, 27.2)].min() > 0.4


def test_planted_feet_stay_and_none_is_under_the_floor():
    contacts = contact_labels(MOTION.skeleton, PLACES, RATE)
    assert contacts.any(axis=1).all()
    for side in ("Left", "Right"):
        toe, height = speed(side + "Toe"), place(side + "Toe")[:, 2]
        down = height < 1e-4
        assert np.mean(down) > 0.6
        assert toe[down][1:-1].max() < 0.4
        assert np.percentile(toe[down], 95) < 1e-3
        assert height.min() > -1e-4
        heel = place(side + "Foot") + rotate(WORLD[:, MOTION.skeleton.index(side + "Foot")], np.array([0, 0.05, -0.091], np.float32))
        assert heel[:, 2].min() > -0.005


def test_knees_bend_forward_and_elbows_back():
    for side in ("Left", "Right"):
        hip, knee, ankle = (place(side + joint) for joint in ("UpLeg", "Leg", "Foot"))
        toward = rotate(WORLD[:, MOTION.skeleton.index(side + "Foot")], FORWARD)
        assert (np.sum((knee - (hip + ankle) / 2) * toward, axis=-1) > 0.02).all()
        bend = np.sum(normalize(knee - hip) * normalize(ankle - knee), axis=-1)
        assert bend.max() < 0.995
        shoulder, elbow, hand = (place(side + joint) for joint in ("Arm", "ForeArm", "Hand"))
        walking = during(3, 9)
        backward = -rotate(WORLD[:, 0], FORWARD)
        assert (np.sum((elbow - (shoulder + hand) / 2) * backward, axis=-1)[walking] > 0).all()


def test_arms_swing_against_the_legs():
    walking = during(3, 9)
    facing = rotate(WORLD[:, 0], FORWARD)
    swing = {name: np.sum((place(name) - place("Hips")) * facing, axis=-1)[walking] for name in ("LeftHand", "LeftFoot", "RightFoot")}
    assert np.corrcoef(swing["LeftHand"], swing["RightFoot"])[0, 1] > 0.8
    assert np.corrcoef(swing["LeftHand"], swing["LeftFoot"])[0, 1] < -0.8


def test_nothing_jumps():
    acceleration = np.linalg.norm(np.diff(PLACES, 2, axis=0), axis=-1) * RATE**2
    assert acceleration[:, MOTION.skeleton.indices(["Hips", "Head", "LeftHand", "RightHand"])].max() < 20
    assert acceleration.max() < 80
    turns = difference(MOTION.rotations[1:], MOTION.rotations[:-1]) * RATE
    assert np.degrees(turns.max()) < 720
    assert (np.sum(MOTION.rotations[1:] * MOTION.rotations[:-1], axis=-1) > 0).all()
