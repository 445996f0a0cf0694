"""Detail that averaging takes away is given back, and trembling is not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cbm_addon.features import LOWER_JOINTS, RATE
from cbm_addon.motion.rotations import Array, difference, quat_from_axis_angle
from cbm_addon.solve.performance import Performance
from cbm_addon.solve.sharpen import sharpened

COUNT = 240


def swinging(hertz: float, head_heights: float, causal: bool = False) -> Performance:
    """A body whose lower joints swing along X, and turn about it by as many radians."""
    times = np.arange(COUNT) / RATE
    angle = head_heights * np.sin(2 * np.pi * hertz * times)
    positions = np.zeros((COUNT, 9, 3), np.float32)
    positions[..., 0] = angle[:, None]
    turns = quat_from_axis_angle(np.array([1.0, 0, 0]), angle).astype(np.float32)
    return Performance(
        times,
        positions,
        np.gradient(positions, axis=0) * np.float32(RATE),
        np.repeat(turns[:, None], 9, axis=1),
        np.repeat(turns[:, None], 10, axis=1),
        np.zeros((COUNT, 4), np.float32),
        1.6,
        causal,
    )


def size(values: Array) -> float:
    return float(np.std(values[60:-60], axis=0).max())


def test_a_swing_of_a_fast_body_grows_and_its_turns_do_most() -> None:
    before = swinging(1.5, 0.3)
    after = sharpened(before)
    for name in ("lower_positions", "lower_velocities"):
        assert 1.1 < size(getattr(after, name)) / size(getattr(before, name)) < 1.6, name
    hips, feet = (LOWER_JOINTS.index(name) for name in ("Hips", "LeftFoot"))
    assert 1.5 < size(after.lower_rotations[:, feet]) / size(before.lower_rotations[:, feet]) < 2.5
    assert 2 < size(after.lower_rotations[:, hips]) / size(before.lower_rotations[:, hips]) < 3.5


def test_a_slow_sway_of_somebody_who_stands_loses_a_tenth_at_most() -> None:
    before = swinging(0.2, 0.05)
    assert 0.9 < size(sharpened(before).lower_positions) / size(before.lower_positions) <= 1


def test_the_legs_of_somebody_who_stands_hardly_follow_arms_that_wave() -> None:
    before = swinging(1.5, 0.008)
    after = sharpened(before)
    for name in ("lower_positions", "lower_velocities", "lower_rotations"):
        assert size(getattr(after, name)) < 0.2 * size(getattr(before, name)), name


def test_the_trembling_of_legs_shrinks() -> None:
    before = swinging(12, 0.002)
    legs = slice(1, None)
    assert size(sharpened(before).lower_positions[:, legs]) < 0.5 * size(before.lower_positions[:, legs])


def test_the_way_of_the_hips_stays() -> None:
    before = swinging(1.5, 0.3)
    after = sharpened(before)
    for name in ("lower_positions", "lower_velocities"):
        np.testing.assert_allclose(getattr(after, name)[:, 0], getattr(before, name)[:, 0], atol=1e-4)


@pytest.mark.parametrize("causal", [False, True])
def test_thighs_and_shins_turn_no_more_than_predicted(causal: bool) -> None:
    before = swinging(1.5, 0.3, causal)
    legs = [i for i, name in enumerate(LOWER_JOINTS) if name.endswith("Leg")]
    assert difference(sharpened(before).lower_rotations[:, legs], before.lower_rotations[:, legs]).max() < 1e-3


def test_causally_turns_grow_and_positions_stay() -> None:
    before = swinging(1.5, 0.3, causal=True)
    after = sharpened(before)
    np.testing.assert_array_equal(after.lower_positions, before.lower_positions)
    assert size(after.lower_rotations) > 1.1 * size(before.lower_rotations)


@pytest.mark.parametrize("until", [50, 120])
def test_causally_nothing_later_counts(until: int) -> None:
    whole = swinging(1.5, 0.3, causal=True)
    early = replace(whole, **{name: getattr(whole, name)[:until] for name in list(whole.__dataclass_fields__)[:6]})
    assert difference(sharpened(whole).lower_rotations[:until], sharpened(early).lower_rotations).max() < 1e-3
