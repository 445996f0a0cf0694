"""Cleaning: spikes go, swings stay; gaps are held or split; a moved tracking space is joined."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cbm_addon.motion.rotations import difference, multiply, quat_from_axis_angle, quat_from_yaw
from cbm_addon.takes.calibrate import calibrate
from cbm_addon.takes.cleaning import hold_gaps, spikes, split, teleports
from cbm_addon.takes.sample_motion import sample_take
from cbm_addon.takes.take import HEAD, LEFT, RIGHT, Take

SAMPLE = sample_take()
RATE = 90.0


def swinging(rate: float = RATE, reach: float = 0.7, hertz: float = 3.0) -> Take:
    """A head that stands, and hands that swing on arms as fast as people can: 13 m/s, with turns of the wrist."""
    times = np.arange(round(4 * rate)) / rate
    angle = 2 * np.pi * hertz * times
    positions = np.zeros((len(times), 3, 3), dtype=np.float32)
    positions[:, HEAD, 2] = 1.6
    for hand, side in ((LEFT, 1), (RIGHT, -1)):
        positions[:, hand] = np.stack((side * 0.3 + 0 * angle, -reach * np.cos(angle), 1.3 + reach * np.sin(angle)), axis=-1)
    rotations = np.zeros((len(times), 3, 4), dtype=np.float32)
    rotations[..., 0] = 1
    rotations[:, [LEFT, RIGHT]] = quat_from_axis_angle(np.array([1.0, 0, 0]), np.sin(2 * angle) * 1.5)[:, None]
    return Take("swinging", times, positions, rotations, np.ones((len(times), 3), dtype=bool), "joint")


def found(take: Take) -> list[tuple[int, int]]:
    return [(int(row), int(device)) for row, device in np.argwhere(spikes(take.times, take.positions, take.rotations, take.tracked))]


@pytest.mark.parametrize("rate", [36.0, 72.0, 120.0])
def test_what_people_do_is_no_spike(rate):
    assert found(swinging(rate)) == []
    assert found(SAMPLE) == []


@settings(max_examples=25, deadline=None)
@given(row=st.integers(10, 340), length=st.integers(1, 4), device=st.sampled_from([HEAD, LEFT, RIGHT]), way=st.integers(0, 2), size=st.floats(1.3, 3))
def test_a_few_samples_elsewhere_are_a_spike_and_nothing_beside_them(row, length, device, way, size):
    take = swinging()
    take.positions[row : row + length, device, way] += size
    assert found(take) == [(row + i, device) for i in range(length)]


def test_a_turn_away_and_back_is_a_spike():
    take = swinging()
    half_turn = quat_from_axis_angle(np.array([0, 0, 1.0], np.float32), np.float32(np.pi))
    take.rotations[100, LEFT] = multiply(take.rotations[100, LEFT], half_turn)
    assert found(take) == [(100, LEFT)]


def test_samples_out_of_reach_at_the_edge_of_a_loss_are_spikes():
    take = swinging()
    take.tracked[100:150, LEFT] = False
    take.positions[150:152, LEFT, 2] += 1
    take.positions[98:100, LEFT, 2] += 1
    assert found(take) == [(98, LEFT), (99, LEFT), (150, LEFT), (151, LEFT)]


def test_a_jump_that_stays_is_no_spike_but_a_teleport():
    take = swinging()
    take.positions[200:] += np.array([1, 0, 0], np.float32)
    assert found(take) == []
    assert teleports(take.times, take.positions, take.rotations, take.tracked).tolist() == [200]


def test_a_snap_turn_is_a_teleport():
    take = swinging()
    take.rotations[200:, HEAD] = quat_from_yaw(np.float32(np.radians(30)))
    assert teleports(take.times, take.positions, take.rotations, take.tracked).tolist() == [200]
    assert not len(teleports(SAMPLE.times, SAMPLE.positions, SAMPLE.rotations, SAMPLE.tracked))


def interrupted(seconds: float) -> Take:
    """The sample with `seconds` in its middle in which nothing was recorded; every extra holds the row's number."""
    later = np.arange(len(SAMPLE)) >= 700
    return replace(SAMPLE, times=SAMPLE.times + seconds * later, extras={"grip_left": np.arange(len(SAMPLE), dtype=np.float32)})


def test_short_gaps_are_left_to_interpolation():
    take = interrupted(0.2)
    assert hold_gaps(take) is take


def test_long_gaps_are_held():
    take = interrupted(5.0)
    held = hold_gaps(take)
    new = ~held.tracked.any(axis=1)
    assert np.diff(held.times).max() < 0.1
    assert (np.diff(held.times) > 0).all()
    np.testing.assert_array_equal(held.times[~new], take.times)
    np.testing.assert_array_equal(held.positions[~new], take.positions)
    assert np.isnan(held.positions[new]).all()
    assert (held.extras["grip_left"][new] == 699).all()


def test_a_calibrated_take_keeps_its_hands_by_its_side_over_a_gap():
    """The body turns round while nothing is recorded: hands that moved straight would pass through it."""
    calibrated = calibrate(interrupted(5.0)).take
    away = np.linalg.norm((calibrated.positions[:, [LEFT, RIGHT]] - calibrated.positions[:, [HEAD]])[..., :2], axis=-1)
    in_gap = ~calibrated.tracked.any(axis=1)
    assert in_gap.sum() > 100
    assert away[in_gap].min() > 0.9 * away[700 - 1].min()
    assert np.isfinite(calibrated.positions).all()


def test_a_take_is_split_where_it_was_interrupted():
    take = interrupted(5.0)
    first, second = split(take, 1.0)
    assert (len(first), len(second)) == (700, len(SAMPLE) - 700)
    assert first.times[0] == second.times[0] == 0
    np.testing.assert_allclose(np.concatenate((first.positions, second.positions)), SAMPLE.positions)
    np.testing.assert_array_equal(second.extras["grip_left"], np.arange(700, len(SAMPLE)))
    assert [piece.name for piece in split(take, 10.0)] == [f"{take.name}_1"]


def test_a_take_is_split_where_the_head_was_lost_and_where_it_jumped():
    tracked = SAMPLE.tracked.copy()
    tracked[300:400] = False
    positions = SAMPLE.positions.copy()
    positions[1000:] += np.array([2, 0, 0], np.float32)
    pieces = split(replace(SAMPLE, tracked=tracked, positions=positions), 1.0)
    assert [len(piece) for piece in pieces] == [300, 600, len(SAMPLE) - 1000]
    assert all(piece.tracked[[0, -1], HEAD].all() for piece in pieces)


@settings(max_examples=20, deadline=None)
@given(rate=st.floats(20, 200), start=st.floats(0, 1))
def test_resampling_by_timestamps_is_exact_between_samples(rate, start):
    """What moves straight and turns evenly between samples is met at any time, whatever the rate of the recording."""
    from cbm_addon.solve.perform import sampled

    coarse = np.sort(np.random.default_rng(3).uniform(0, 10, 200))
    way, spin = np.array([0.3, -0.8, 0.1]), 0.4

    def at(times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        places = np.repeat((times[:, None] * way)[:, None], 3, axis=1)
        return places, np.repeat(quat_from_yaw(spin * times)[:, None], 3, axis=1)

    positions, rotations = at(coarse)
    take = Take("even", coarse, positions, rotations, np.ones((200, 3), dtype=bool), "joint")
    times = np.arange(coarse[0] + start, coarse[-1], 1 / rate)
    again, (places, turns) = sampled(take, times), at(times)
    np.testing.assert_allclose(again.positions, places, atol=1e-9)
    assert difference(again.rotations, turns).max() < 1e-6
