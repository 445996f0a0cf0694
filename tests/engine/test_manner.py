"""Manners: what variations differ by, drawn with a seed, carried along by the body, and found in the errors of clips."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cbm_addon.features import LOWER_JOINTS
from cbm_addon.motion.motion import Motion
from cbm_addon.motion.rotations import quat_from_yaw, rotate
from cbm_addon.solve.manner import draw_manner, into_body, out_of_body, with_manner
from cbm_addon.solve.performance import Performance

OFFSETS = np.random.default_rng(0).normal(size=(len(LOWER_JOINTS), 3)).astype(np.float32)


@pytest.fixture
def performance(body_motion: Motion) -> Performance:
    rotations, positions = body_motion.forward()
    lower = body_motion.skeleton.indices(list(LOWER_JOINTS))
    count = len(body_motion)
    return Performance(
        body_motion.times, positions[:, lower], np.zeros((count, 9, 3), np.float32), rotations[:, lower], np.zeros((count, 10, 4), np.float32),
        np.zeros((count, 4), np.float32), 1.0, False,
    )  # fmt: skip


def test_the_first_answer_has_no_manner_and_others_have_their_own() -> None:
    manners = np.random.default_rng(1).normal(size=(4, 9, 3)).astype(np.float32)
    assert not draw_manner(manners, 0, 0).any()
    np.testing.assert_array_equal(draw_manner(manners, 5, 1), draw_manner(manners, 5, 1))
    assert not np.allclose(draw_manner(manners, 5, 1), draw_manner(manners, 5, 2))
    assert not draw_manner(np.zeros((0, 9, 3), np.float32), 5, 1).any()


def test_manners_are_drawn_as_long_as_they_are() -> None:
    manners = np.zeros((1, 9, 3), np.float32)
    manners[0, 0, 1] = 0.02
    drawn = np.array([draw_manner(manners, seed, 1)[0, 1] for seed in range(2000)])
    assert drawn.std() == pytest.approx(0.02, rel=0.05)
    assert drawn.mean() == pytest.approx(0, abs=0.002)


def test_a_manner_turns_with_the_body(performance: Performance) -> None:
    turn = quat_from_yaw(np.float32(0.7))
    turned = replace(performance, lower_positions=rotate(turn, performance.lower_positions))
    moved = with_manner(replace(performance, manner=OFFSETS)).lower_positions
    np.testing.assert_allclose(with_manner(replace(turned, manner=OFFSETS)).lower_positions, rotate(turn, moved), atol=1e-4)
    np.testing.assert_allclose(into_body(performance.lower_positions, out_of_body(performance.lower_positions, OFFSETS))[0], OFFSETS, atol=1e-5)


def test_a_body_that_faces_forward_moves_by_the_offsets_themselves(performance: Performance) -> None:
    positions = performance.lower_positions[:1].copy()
    positions[0, LOWER_JOINTS.index("LeftUpLeg")], positions[0, LOWER_JOINTS.index("RightUpLeg")] = (0.1, 0, 0.9), (-0.1, 0, 0.9)
    np.testing.assert_allclose(out_of_body(positions, OFFSETS)[0], OFFSETS, atol=1e-6)
