"""Thinned curves: what they pass through, and that they are the best of their kind."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cbm_addon.rigs.reduce import between, handles


def wave(frames: int = 60, seed: int = 0) -> np.ndarray:
    """Smooth values [T, 2] with a little noise."""
    random = np.random.default_rng(seed)
    t = np.arange(frames)[:, None]
    return np.sin(t / np.array([9.0, 14.0])) + 0.01 * random.normal(size=(frames, 2))


@given(st.sets(st.integers(1, 58)), st.integers(0, 5))
def test_curves_pass_through_their_keys(inner, seed):
    values, keyed = wave(seed=seed), np.array([0, *sorted(inner), 59])
    np.testing.assert_allclose(between(values, keyed, keyed), values[keyed], atol=1e-12)


@given(st.sets(st.integers(1, 58)))
def test_straight_lines_stay_straight_whatever_is_keyed(inner):
    values, keyed = np.arange(60.0)[:, None] * np.array([0.3, -2.0]), np.array([0, *sorted(inner), 59])
    np.testing.assert_allclose(between(values, keyed, np.arange(60)), values, atol=1e-9)


def test_a_cubic_needs_only_its_ends():
    t = np.arange(60)[:, None] / 59.0
    values = 2 * t**3 - 3 * t**2 + 0.5 * t
    np.testing.assert_allclose(between(values, np.array([0, 59]), np.arange(60)), values, atol=1e-3)


def test_a_key_changes_the_curves_beside_it_alone():
    values, frames = wave(), np.arange(60)
    fewer, more = between(values, np.array([0, 20, 40, 59]), frames), between(values, np.array([0, 20, 30, 40, 59]), frames)
    away = np.abs(fewer - more).max(axis=-1)
    assert away[:21].max() == away[40:].max() == 0
    assert away[21:40].max() > 0


@pytest.mark.parametrize("nudge", [0.01, -0.01])
def test_other_handles_are_no_better(nudge):
    values, keyed, frames = wave(), np.array([0, 25, 59]), np.arange(60)
    leaving, arriving = handles(values, keyed)
    best = ((between(values, keyed, frames) - values) ** 2).sum()
    t = (frames[:25, None]) / 25.0
    for start, end in ((nudge, 0), (0, nudge), (nudge, -nudge)):
        a, b = (leaving[0] + start) * 25, (arriving[0] + end) * 25
        way = values[25] - values[0]
        other = between(values, keyed, frames)
        other[:25] = values[0] + t * (a + t * (3 * way - 2 * a - b + t * (a + b - 2 * way)))
        assert ((other - values) ** 2).sum() > best


def test_a_single_frame_is_held():
    values = wave(1)
    np.testing.assert_array_equal(between(values, np.array([0]), np.array([0])), values)
