"""Feet: what is planted stands, what is not is turned as predicted."""

from __future__ import annotations

import numpy as np
import pytest

from cbm_addon.features import LOWER_JOINTS, RATE
from cbm_addon.motion.rotations import Array, difference, inverse, multiply, normalize, rotate
from cbm_addon.motion.skeleton import STANDARD_BODY
from cbm_addon.solve.feet import plant_feet
from cbm_addon.solve.performance import Performance

COUNT, UNIT = 120, np.float32(1.6)
FOOT, TOE = (STANDARD_BODY.index(name) for name in ("LeftFoot", "LeftToe"))
OFFSET = STANDARD_BODY.offsets[TOE]
ANKLE = np.array([0.1, 0, STANDARD_BODY.height_above_toes("LeftFoot")], np.float32)


def standing(contact: float, tremble: float = 0.0, causal: bool = False) -> tuple[Performance, Array]:
    """Somebody whose predicted ankles and toes tremble around a stand, and the world rotations that were predicted."""
    random = np.random.default_rng(0)
    positions = np.zeros((COUNT, len(LOWER_JOINTS), 3), np.float32)
    for side, x in (("Left", 1), ("Right", -1)):
        ankle = ANKLE * (x, 1, 1)
        positions[:, LOWER_JOINTS.index(f"{side}Foot")] = ankle
        positions[:, LOWER_JOINTS.index(f"{side}Toe")] = ankle + OFFSET
    positions = positions / UNIT + random.normal(scale=tremble, size=positions.shape).astype(np.float32)
    turns = np.zeros((COUNT, 10, 4), np.float32)
    turns[..., 0] = 1
    velocities = np.zeros_like(positions)
    performance = Performance(
        np.arange(COUNT) / RATE, positions, velocities, turns[:, :9], turns, np.full((COUNT, 4), contact, np.float32), float(UNIT), causal
    )
    world = np.zeros((COUNT, len(STANDARD_BODY), 4), np.float32)
    world[..., 0] = 1
    return performance, world


@pytest.mark.parametrize("causal", [False, True])
def test_a_planted_foot_stands_still_whatever_its_rotation_was_predicted_to_be(causal: bool) -> None:
    performance, world = standing(1.0, causal=causal)
    world[:, FOOT] = normalize(world[:, FOOT] + np.random.default_rng(1).normal(scale=0.03, size=(COUNT, 4)).astype(np.float32))
    ankle = plant_feet(STANDARD_BODY, performance, world, UNIT, RATE, 0.0)["Left"]
    toe = ankle + rotate(world[:, FOOT], OFFSET)
    np.testing.assert_allclose(toe, np.broadcast_to(toe[-1], toe.shape), atol=1e-3)
    if not causal:  # without looking ahead a turn is met a moment later
        np.testing.assert_allclose(ankle, np.broadcast_to(ankle[-1], ankle.shape), atol=1e-3)


@pytest.mark.parametrize("causal", [False, True])
def test_a_foot_in_the_air_does_not_tremble_with_the_paths_of_its_points(causal: bool) -> None:
    performance, world = standing(0.0, tremble=0.01, causal=causal)
    plant_feet(STANDARD_BODY, performance, world, UNIT, RATE, 0.0)
    two_points = performance.lower_positions[:, LOWER_JOINTS.index("LeftToe")] - performance.lower_positions[:, LOWER_JOINTS.index("LeftFoot")]
    aimed = np.degrees(np.arccos(np.clip(np.sum(normalize(two_points[1:]) * normalize(two_points[:-1]), axis=-1), -1, 1)))
    assert np.degrees(difference(world[1:, FOOT], world[:-1, FOOT])).mean() < 0.4 * aimed.mean()


def test_toes_bend_as_predicted() -> None:
    performance, world = standing(1.0, tremble=0.005)
    world[:, FOOT] = normalize(world[:, FOOT] + np.random.default_rng(1).normal(scale=0.03, size=(COUNT, 4)).astype(np.float32))
    bend = multiply(inverse(world[:, FOOT]), world[:, TOE])
    plant_feet(STANDARD_BODY, performance, world, UNIT, RATE, 0.0)
    assert difference(multiply(inverse(world[:, FOOT]), world[:, TOE]), bend).max() < 2e-3


def test_nothing_goes_below_the_sole() -> None:
    performance, world = standing(0.0, tremble=0.02)
    ankle = plant_feet(STANDARD_BODY, performance, world, UNIT, RATE, 0.01)["Left"]
    assert (ankle + rotate(world[:, FOOT], OFFSET))[:, 2].min() > 0.01 - 1e-6
