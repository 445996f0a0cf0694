"""Foot locks: what is in contact stands still, what is not keeps its predicted velocity."""

from __future__ import annotations

import numpy as np
import pytest

from cbm_addon.solve.foot_lock import CONTACT, LEASH, LIFT, RISE, SLACK, VELOCITY, contact_states, lock_causally, lowered, solve_paths, without_blips

RATE = 30.0


def walk() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A foot that drifts where it should stand: positions [T, 1, 3], velocities, contacts bool [T, 1]."""
    time = np.arange(90) / RATE
    stepping = (time % 1.0) > 0.5
    speed = np.where(stepping, 1.4, 0.12)
    x = np.cumsum(speed) / RATE
    positions = np.stack((x, 0 * x, np.where(stepping, 0.1, 0.0)), axis=-1)[:, None].astype(np.float32)
    velocities = np.gradient(positions, axis=0) * RATE
    return positions, velocities, ~stepping[:, None]


def test_a_locked_foot_stands_still_and_stays_near_its_prediction() -> None:
    positions, velocities, contact = walk()
    path = solve_paths(positions, velocities, contact, RATE)
    still = (contact[1:] & contact[:-1])[:, 0]
    speed = np.linalg.norm(np.diff(path[:, 0], axis=0), axis=-1) * RATE
    assert speed[still].max() < 0.01, "metres per second in contact"
    assert np.abs(path - positions).max() < 0.1


def test_without_contacts_and_with_consistent_velocities_nothing_changes() -> None:
    positions, _, contact = walk()
    steps = np.diff(positions, axis=0, prepend=positions[:1]) * RATE
    np.testing.assert_allclose(solve_paths(positions, steps, np.zeros_like(contact), RATE), positions, atol=1e-5)


def test_the_solution_is_the_least_squares_optimum() -> None:
    """An independent oracle: the same problem as a dense matrix."""
    random = np.random.default_rng(0)
    positions, velocities = random.normal(size=(2, 12, 1, 3)).astype(np.float32)
    contact = random.random((12, 1)) > 0.5
    still = contact[1:, 0] & contact[:-1, 0]
    rows, right = [np.eye(12)], [positions[:, 0]]
    for t in range(1, 12):
        weight = np.sqrt(CONTACT if still[t - 1] else VELOCITY)
        row = np.zeros((1, 12))
        row[0, t], row[0, t - 1] = weight, -weight
        rows.append(row)
        right.append(weight * (0 * velocities[t] if still[t - 1] else velocities[t] / RATE))
    expected = np.linalg.lstsq(np.concatenate(rows), np.concatenate(right), rcond=None)[0]
    np.testing.assert_allclose(solve_paths(positions, velocities, contact, RATE)[:, 0], expected, atol=1e-4)


def test_a_causal_lock_uses_no_later_frame() -> None:
    positions, _, contact = walk()
    whole = lock_causally(positions, contact, RATE, 2.5)
    for end in (20, 47, 61):
        np.testing.assert_array_equal(lock_causally(positions[:end], contact[:end], RATE, 2.5), whole[:end])
    still = (contact[1:] & contact[:-1])[:, 0]
    assert np.abs(np.diff(whole[:, 0], axis=0)[still]).max() < 1e-6


def test_a_causal_lock_creeps_after_a_path_that_goes_away() -> None:
    unit, speed = 1.6, 0.15
    positions = np.zeros((90, 1, 3), np.float32)
    positions[:, 0, 0] = np.arange(90) * speed / RATE
    path = lock_causally(positions, np.ones((90, 1), bool), RATE, unit)[:, 0, 0]
    steps, behind = np.diff(path) * RATE, positions[:-1, 0, 0] - path[:-1]
    assert np.abs(steps[behind < SLACK * unit - speed / RATE]).max() < 1e-5, "it stands within the slack"
    assert steps.min() > -1e-5, "and never turns back"
    assert steps.max() < speed + 1e-5, "nor overtakes the path that it follows"
    assert steps[-1] > 0.9 * speed, "which it follows in the end"


def test_a_causal_lock_keeps_its_height_until_its_path_is_well_above() -> None:
    unit = 1.6
    positions = np.zeros((60, 1, 3), np.float32)
    positions[:, 0, 2] = 0.08 + 0.9 * LIFT * unit * np.sin(np.arange(60) / 6)
    heights = lock_causally(positions, np.ones((60, 1), bool), RATE, unit)[:, 0, 2]
    assert np.ptp(heights) < 1e-6, "a wobble within the slack is no movement"
    positions[30:, 0, 2] = 0.08 + 2 * RISE * unit
    lifted = lock_causally(positions, np.ones((60, 1), bool), RATE, unit)[:, 0, 2]
    assert (positions[30:, 0, 2] - lifted[30:]).max() < RISE * unit + 1e-6, "a path that rises takes it along"


def test_a_causal_lock_is_never_farther_from_its_path_than_its_leash() -> None:
    unit = 1.6
    positions = np.zeros((60, 1, 3), np.float32)
    positions[:, 0, 0] = np.linspace(0, 6, 60)
    path = lock_causally(positions, np.ones((60, 1), bool), RATE, unit)
    away = np.abs(path - positions).max()
    assert away == pytest.approx(LEASH * unit, rel=1e-4)


def test_a_point_in_contact_comes_down_to_where_it_stands() -> None:
    positions = np.full((3, 2, 3), 0.2, np.float32)
    positions[2, :, 2] = 0.05
    lower = lowered(positions, np.array([[0, 0], [1, 0.5], [1, 1]], np.float32), np.array([0, 0.1], np.float32))
    np.testing.assert_allclose(lower[..., :2], positions[..., :2])
    np.testing.assert_allclose(lower[0], positions[0])
    assert 0 < lower[1, 0, 2] < lower[1, 1, 2] < 0.2
    assert lower[2, 1, 2] == pytest.approx(0.05), "none is raised"


def test_contacts_have_hysteresis_and_no_blips() -> None:
    probability = np.array([0.1, 0.7, 0.5, 0.45, 0.5, 0.3, 0.9, 0.2, 0.1, 0.1, 0.1], np.float32)[:, None]
    state = contact_states(probability)
    assert state[:, 0].tolist() == [False, True, True, True, True, False, True, False, False, False, False]
    assert without_blips(state)[:, 0].tolist() == [False, True, True, True, True, True, True, False, False, False, False]
