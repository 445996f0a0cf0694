"""Ways around: steps that a hand can make, through free space, whatever lies between two poses."""

from __future__ import annotations

import numpy as np
import pytest

from cbm_addon.hands.contact import Probe
from cbm_addon.hands.detour import SOLID, Detours, Rough, around, leaping, windows
from cbm_addon.hands.hand import LIMITS, finger_angles
from cbm_addon.hands.obstacle import Obstacle, over_time
from cbm_addon.hands.poses import POSES
from cbm_addon.hands.project import FASTEST_TIP, fastest_steps, held_back, tip_steps
from cbm_addon.hands.sensor import reachable_grid
from cbm_addon.hands.shapes import Box, Sphere
from cbm_addon.hands.standard import standard_hand
from cbm_addon.motion.rotations import IDENTITY
from cbm_addon.progress import run

CHOICES, EVERY, RATE = 40, 2, 24.0
SECONDS = EVERY / RATE
TICKS = EVERY * np.arange(CHOICES)
BOARD = Box(np.array([0, 0.2, -0.05], np.float32), np.array([0.3, 0.3, 0.006], np.float32))
"""Lies across below the right hand, whose palm is down, so that a fist would need to be on both of its sides."""
FIST, FLAT = (finger_angles(np.clip(POSES[name], *LIMITS.T)) for name in ("fist", "flat"))


def detours(obstacle: Obstacle, finger: int) -> Detours:
    count = EVERY * CHOICES
    wrists = np.zeros((count, 3), np.float32), np.tile(IDENTITY, (count, 1))
    probe = Probe(standard_hand(), wrists, over_time(lambda frame: obstacle))
    return Detours(Rough(probe, reachable_grid()), finger, SECONDS, 16.0)


def depths(of: Detours, path: np.ndarray) -> np.ndarray:
    """Of a path [K, 4], also between its poses."""
    dense = np.concatenate([path[:-1] + share * np.diff(path, axis=0) for share in (0.0, 0.25, 0.5, 0.75)]).astype(np.float32)
    return of.probe.depths(np.zeros(len(dense), int), np.full(len(dense), of.finger), dense).max(-1)


def tips(of: Detours, path: np.ndarray) -> np.ndarray:
    return np.linalg.norm(np.diff(of.probe.hand.chains(path, np.full(len(path), of.finger))[:, -1], axis=0), axis=-1)


@pytest.mark.parametrize("finger", range(5))
def test_steps_of_the_grid_stay_within_limits_and_are_no_faster_than_a_hand(finger: int) -> None:
    of = detours(BOARD, finger)
    least, greatest = finger_angles(LIMITS.T)[:, finger]
    assert ((of.poses >= least - 1e-6) & (of.poses <= greatest + 1e-6)).all()
    before, between, costs = of.steps
    ends = of.probe.hand.chains(of.poses, np.full(len(of.poses), finger))[:, -1]
    apart = np.linalg.norm(ends[before] - ends[:, None], axis=-1)
    assert apart[np.isfinite(costs)].max() <= FASTEST_TIP * of.probe.hand.length * SECONDS + 1e-6
    start, end, way = of.poses[before], of.poses[:, None], of.poses[between]
    assert ((way >= np.minimum(start, end) - 1e-6) & (way <= np.maximum(start, end) + 1e-6)).all(), "a step goes by way of a pose between its ends"


@pytest.mark.parametrize("obstacle", [BOARD, Sphere(np.array([0, 0.13, -0.06], np.float32), 0.03)], ids=["board", "ball"])
@pytest.mark.parametrize("finger", [0, 2])
def test_rough_depths_are_right_to_a_few_millimetres(obstacle: Obstacle, finger: int) -> None:
    of = detours(obstacle, finger)
    rough = of.depths(np.array([0]))[0]
    true = of.probe.depths(np.zeros(len(of.poses), int), np.full(len(of.poses), finger), of.poses).max(-1)
    near = np.abs(true) < 0.02
    assert near.sum() > 20
    assert np.percentile(np.abs(rough - true)[near], 90) < 0.005
    assert (rough[true > 0.01] > SOLID).all(), "what is deep inside is never called free"


def test_a_finger_closes_by_steps_where_it_wants_to_be_closed_at_once() -> None:
    of = detours(Sphere(np.array([0, 0, 5], np.float32), 0.1), 1)
    wanted = np.where(np.arange(CHOICES)[:, None] < CHOICES // 2, FLAT[1], FIST[1])
    path, free = of.path(TICKS, wanted, None, None)
    assert free
    assert tips(of, path).max() <= FASTEST_TIP * of.probe.hand.length * SECONDS + 1e-6
    assert np.abs(path[[0, -1]] - wanted[[0, -1]]).max() < np.radians(25)


def test_a_finger_does_not_go_where_it_could_only_get_through_a_solid() -> None:
    """The cheapest poses by themselves are beyond a board, for a while."""
    of = detours(BOARD, 2)
    beyond = (np.arange(CHOICES) > 12) & (np.arange(CHOICES) < 28)
    path = np.where(beyond[:, None], np.array([np.pi / 2, 0, 0, 0], np.float32), FLAT[2]).astype(np.float32)
    whole = np.repeat(path[:, None], 5, 1)
    leaps = leaping(of.probe, TICKS, whole, np.repeat(FLAT[None], CHOICES, 0), SECONDS)[:, 2]
    assert leaps.sum() == 2
    way = run(around(of, TICKS, path, path, leaps))
    assert depths(of, path).max() > 0.005
    assert depths(of, way).max() < 0.001
    assert tips(of, way).max() < 0.045


def test_what_is_near_a_leap_is_sought_again_and_what_meets_is_one() -> None:
    leaps = np.zeros(99, bool)
    leaps[[2, 40, 48, 80]] = True
    assert windows(leaps, 5) == [(0, 8), (35, 54), (75, 86)]


def test_what_is_held_back_does_not_leap() -> None:
    random, hand = np.random.default_rng(0), standard_hand()
    start = np.repeat(FLAT[None], 50, 0) + np.cumsum(random.normal(scale=0.03, size=(50, 5, 4)), 0)
    moved = start + random.normal(scale=0.1, size=start.shape)
    fastest = fastest_steps(hand, np.repeat(FLAT[None], 50, 0), 1 / RATE)
    waits = held_back(hand, start, moved, np.zeros((50, 5), bool), fastest)
    kept = tip_steps(hand, np.where(waits[..., None], start, moved))
    assert (tip_steps(hand, moved) > fastest).any()
    assert (kept <= np.maximum(fastest, tip_steps(hand, start)) + 1e-5).all()
    assert not waits.all()
