"""Controllers that sit otherwise than was thought."""

from __future__ import annotations

import numpy as np
import pytest

from cbm_addon.motion.mirror import mirror_positions, mirror_rotations
from cbm_addon.motion.motion import Motion
from cbm_addon.motion.rotations import difference, inverse, multiply, rotate
from cbm_addon.takes.calibrate import CalibrationOptions, calibrate
from cbm_addon.takes.devices import CONTROLLERS
from cbm_addon.takes.slip import Slip, mistaken, slipped
from cbm_addon.takes.synthesize import synthesize
from cbm_addon.takes.take import HEAD, LEFT, RIGHT, Take

SLIP = Slip(np.array([0.1, -0.05, 0.02], np.float32), np.array([0.1, 0.2, -0.3], np.float32))


def assert_same(take: Take, other: Take, metres: float = 1e-5, radians: float = 1e-3) -> None:
    np.testing.assert_allclose(take.positions, other.positions, atol=metres)
    assert difference(take.rotations, other.rotations).max() < radians


def test_wrists_are_carried_along_at_a_constant_place_and_as_mirror_images(body_motion: Motion) -> None:
    take = synthesize(body_motion)
    seen = slipped(take, SLIP)
    np.testing.assert_array_equal(seen.positions[:, HEAD], take.positions[:, HEAD])
    places = [rotate(inverse(take.rotations[:, hand]), seen.positions[:, hand] - take.positions[:, hand]) for hand in (LEFT, RIGHT)]
    turns = [multiply(inverse(take.rotations[:, hand]), seen.rotations[:, hand]) for hand in (LEFT, RIGHT)]
    np.testing.assert_allclose(places[0], np.broadcast_to(SLIP.offset, places[0].shape), atol=1e-5)
    np.testing.assert_allclose(places[1], mirror_positions(places[0]), atol=1e-5)
    assert difference(turns[1], mirror_rotations(turns[0])).max() < 1e-3


def test_a_slip_is_taken_back(body_motion: Motion) -> None:
    take = synthesize(body_motion)
    assert_same(slipped(slipped(take, SLIP), SLIP.undone()), take)


@pytest.mark.parametrize(("held", "thought"), [("index", "quest2"), ("quest2", "touch-steamvr")])
def test_a_mistake_of_controllers_is_a_slip(body_motion: Motion, held: str, thought: str) -> None:
    calibrated = calibrate(synthesize(body_motion, device=held), CalibrationOptions(device=thought)).take
    assert_same(slipped(synthesize(body_motion), mistaken(CONTROLLERS[held], CONTROLLERS[thought])), calibrated, metres=2e-3)
