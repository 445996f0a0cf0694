"""Hips and ankles that are predicted apart come together, and no knee snaps."""

from __future__ import annotations

import numpy as np
import pytest

from cbm_addon.motion.rotations import Array
from cbm_addon.motion.skeleton import STANDARD_BODY
from cbm_addon.solve.reach import SHARE, within_reach

LENGTH = float(np.linalg.norm(STANDARD_BODY.offsets[STANDARD_BODY.indices(["LeftLeg", "LeftFoot"])], axis=-1).sum())
SOCKETS = {side: STANDARD_BODY.offsets[STANDARD_BODY.index(f"{side}UpLeg")] for side in ("Left", "Right")}
UPRIGHT = STANDARD_BODY.rest_positions()[STANDARD_BODY.index("Head")]


def brought_together(left: Array, standing: float = 0.0, crouch: float = 0.3) -> tuple[Array, dict[str, Array], Array, dict[str, Array]]:
    """Hips and ankles after and before, of a body with its hips at the origin, its head lowered by `crouch`, its right foot well within reach and its left
    ankle as far below its hip joint as `left` [T] says, as shares of the leg's length."""
    count = len(left)
    world = np.zeros((count, len(STANDARD_BODY), 4), np.float32)
    world[..., 0] = 1
    hips = np.zeros((count, 3), np.float32)
    down = np.array([0.6, 0, -0.8], np.float32)
    ankles = {
        "Left": SOCKETS["Left"] + LENGTH * left[:, None].astype(np.float32) * down,
        "Right": np.tile(SOCKETS["Right"] - (0, 0, 0.8 * LENGTH), (count, 1)).astype(np.float32),
    }
    head = np.tile(UPRIGHT - np.array([0, 0, crouch], np.float32), (count, 1))
    stands = {"Left": np.full(count, standing, np.float32), "Right": np.ones(count, np.float32)}
    moved = within_reach(STANDARD_BODY, world, hips, head, ankles, stands)
    return *moved, hips, ankles


def spans(hips: Array, ankles: dict[str, Array]) -> Array:
    """How far the left ankle is from its hip joint, as a share of the leg's length, [T]."""
    return np.linalg.norm(hips + SOCKETS["Left"] - ankles["Left"], axis=-1) / LENGTH


def test_what_is_within_reach_stays() -> None:
    hips, ankles, before, ankles_before = brought_together(np.linspace(0.3, 0.98, 20))
    np.testing.assert_array_equal(hips, before)
    for side in ankles:
        np.testing.assert_array_equal(ankles[side], ankles_before[side])


@pytest.mark.parametrize("standing", [0.0, 0.5, 1.0])
def test_no_leg_is_longer_than_it_is(standing: float) -> None:
    hips, ankles, *_ = brought_together(np.linspace(0.9, 1.2, 50), standing)
    assert spans(hips, ankles).max() < 1


@pytest.mark.parametrize("standing", [0.0, 1.0])
def test_a_leg_straightens_ever_more_slowly(standing: float) -> None:
    hips, ankles, *_ = brought_together(np.linspace(0.9, 1.1, 201), standing)
    step = np.diff(spans(hips, ankles)) / 0.001
    assert step.min() > -1e-3  # farther apart as predicted is farther apart after
    assert np.abs(np.diff(step)).max() < 0.2  # a hard limit would go from 1 to 0 at once


def test_a_foot_that_stands_stays_and_the_hips_come() -> None:
    hips, ankles, before, ankles_before = brought_together(np.array([1.08]), standing=1.0)
    np.testing.assert_array_equal(ankles["Left"], ankles_before["Left"])
    assert np.linalg.norm(hips - before) > 0.05


def test_a_foot_in_the_air_comes_most_of_the_way() -> None:
    hips, ankles, before, ankles_before = brought_together(np.array([1.08]))
    ankle, hip = np.linalg.norm(ankles["Left"] - ankles_before["Left"]), np.linalg.norm(hips - before)
    assert hip / (ankle + hip) == pytest.approx(SHARE, abs=0.02)


def test_the_head_comes_first() -> None:
    hips, *_ = brought_together(np.array([1.3]), standing=1.0, crouch=0.0)
    assert np.linalg.norm(UPRIGHT - hips) < np.linalg.norm(UPRIGHT) + 1e-3
