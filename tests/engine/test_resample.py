"""Resampling by timestamps."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cbm_addon.motion.motion import Motion
from cbm_addon.motion.resample import brackets, frame_times, lerp_samples, resample, slerp_samples
from cbm_addon.motion.rotations import difference, quat_from_yaw
from cbm_addon.motion.skeleton import STANDARD_BODY


def turning(times: np.ndarray, speed: float = 1.0) -> Motion:
    """The standard body walks along X at 1 m/s and turns about Z at `speed` radians per second."""
    rotations = np.zeros((len(times), len(STANDARD_BODY), 4), dtype=np.float32)
    rotations[..., 0] = 1
    rotations[:, 0] = quat_from_yaw(times * speed)
    root = np.stack((times, 0 * times, 0 * times), axis=-1).astype(np.float32)
    return Motion(STANDARD_BODY, times, root, rotations)


def test_a_steady_motion_is_the_same_at_any_times():
    uneven = np.sort(np.random.default_rng(0).uniform(0, 4, 50))
    uneven[[0, -1]] = 0, 4
    at = np.linspace(0, 4, 77)
    found = resample(turning(uneven), at)
    expected = turning(at)
    assert np.allclose(found.root, expected.root, atol=1e-5)
    assert difference(found.rotations, expected.rotations).max() < 1e-3
    assert np.array_equal(found.times, at)


def test_its_own_times_change_nothing():
    motion = turning(np.arange(20) / 30)
    same = resample(motion, motion.times)
    assert np.allclose(same.root, motion.root)
    assert np.allclose(same.rotations, motion.rotations, atol=1e-6)


def test_before_the_start_and_after_the_end_the_motion_stands_still():
    motion = turning(np.arange(10) / 10)
    found = resample(motion, np.array([-5.0, 50.0]))
    assert np.allclose(found.root, motion.root[[0, -1]])
    assert difference(found.rotations, motion.rotations[[0, -1]]).max() < 1e-3


def test_a_flipped_sign_between_samples_is_not_a_turn():
    q = np.array([[1, 0, 0, 0], [-1, 0, 0, 0]], dtype=np.float32)
    assert difference(slerp_samples(np.array([0.0, 1.0]), q, np.array([0.5])), q[:1]).max() < 1e-6


def test_animated_offsets_are_resampled_too():
    times = np.array([0.0, 1.0])
    offsets = np.stack((STANDARD_BODY.offsets, 3 * STANDARD_BODY.offsets))
    steady = turning(times)
    motion = Motion(STANDARD_BODY, times, steady.root, steady.rotations, offsets)
    found = resample(motion, np.array([0.5])).offsets
    assert found is not None
    assert np.allclose(found[0], 2 * STANDARD_BODY.offsets)


def test_a_single_sample_is_the_same_at_all_times():
    assert np.array_equal(lerp_samples(np.array([2.0]), np.array([[7.0]]), np.array([0.0, 2.0, 9.0])), [[7], [7], [7]])


@given(st.lists(st.floats(0, 10), min_size=1, max_size=20), st.integers(2, 30))
def test_brackets_hold_the_time_between_them(at, count):
    times = np.linspace(1, 9, count)
    before, share = brackets(times, np.array(at))
    assert ((share >= 0) & (share <= 1)).all()
    assert np.allclose(times[before] + share * (times[before + 1] - times[before]), np.clip(at, 1, 9))


@given(st.integers(1, 20_000), st.sampled_from([24, 30, 60, 30 / 1.001, 120]))
def test_frame_times_reach_the_end_and_not_beyond(frames, rate):
    times = frame_times(2.0, 2.0 + (frames - 1) / rate, rate)
    assert len(times) == frames
    assert np.isclose(times[0], 2)
    assert times[-1] <= 2.0 + (frames - 1) / rate + 1e-6
