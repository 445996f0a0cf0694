"""Foot contacts by height and speed."""

from __future__ import annotations

import numpy as np
import pytest

from cbm_addon.motion.contacts import CONTACT_JOINTS, contact_labels
from cbm_addon.motion.skeleton import STANDARD_BODY

RATE = 30.0


def standing(frames: int = 60) -> np.ndarray:
    """World positions of a body that stands still."""
    return np.repeat(STANDARD_BODY.rest_positions()[None], frames, axis=0)


def foot(joint: str) -> int:
    return STANDARD_BODY.index(joint)


def test_who_stands_still_touches_the_floor_with_every_foot_joint():
    labels = contact_labels(STANDARD_BODY, standing(), RATE)
    assert labels.shape == (60, 4)
    assert labels.all()


@pytest.mark.parametrize("joint", CONTACT_JOINTS)
def test_a_lifted_joint_does_not_touch_and_the_others_do(joint):
    positions = standing()
    positions[20:40, foot(joint), 2] += 0.1
    labels = contact_labels(STANDARD_BODY, positions, RATE)
    lifted = np.zeros((60, 4), dtype=bool)
    lifted[20:40, CONTACT_JOINTS.index(joint)] = True
    assert np.array_equal(labels, ~lifted)


@pytest.mark.parametrize(("speed", "touches"), [(0.3, True), (0.5, False)])
def test_a_joint_that_slides_fast_does_not_touch(speed, touches):
    positions = standing()
    positions[:, foot("LeftToe"), 1] -= speed * np.arange(60) / RATE
    labels = contact_labels(STANDARD_BODY, positions, RATE)
    assert (labels[:, CONTACT_JOINTS.index("LeftToe")] == touches).all()
    assert labels[:, CONTACT_JOINTS.index("RightToe")].all()


def test_the_floor_may_be_anywhere():
    """Heights count from the joint's own lowest, not from zero."""
    assert contact_labels(STANDARD_BODY, standing() + np.array([0, 0, 7], dtype=np.float32), RATE).all()


def test_a_single_pose_has_no_speed():
    assert contact_labels(STANDARD_BODY, standing(1), RATE).all()
