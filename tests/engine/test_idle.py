"""Standing and looking around: no step, no drift, and the body does not turn with the head. With the shipped model, in both modes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cbm_addon.evaluate.metrics import tracks
from cbm_addon.features import MODES, RATE, STANDARD_PROPORTIONS
from cbm_addon.motion.contacts import CONTACT_JOINTS
from cbm_addon.motion.ground_frame import root_frame
from cbm_addon.motion.rotations import multiply, quat_from_axis_angle, quat_from_yaw, yaw_from_quat
from cbm_addon.motion.skeleton import STANDARD_BODY
from cbm_addon.progress import run
from cbm_addon.solve.fuse import fuse
from cbm_addon.solve.idle import at_rest, settle
from cbm_addon.solve.models import load_model
from cbm_addon.solve.perform import SolveOptions, perform
from cbm_addon.takes.synthesize import synthesize
from cbm_addon.takes.take import Take, TakeReport

X, Y, Z = np.eye(3)
HEAD_HEIGHT = STANDARD_BODY.height_above_toes("Head")


def standing_take(seconds: float = 30.0, rate: float = 72.0) -> Take:
    """Somebody stands with hanging arms, sways by a centimetre or two, nods, and looks up to 60 degrees to both sides for stretches of the time."""
    times = np.arange(round(seconds * rate)) / rate
    random = np.random.default_rng(0)

    def sway(pace: float, size: float) -> np.ndarray:
        return sum(size / k * np.sin(2 * np.pi * (pace * k * times + random.random())) for k in (1, 1.7, 2.3))

    yaw = np.radians(60) * np.sin(2 * np.pi * times / 9) * (np.sin(2 * np.pi * times / 23) > -0.5)
    nod = np.radians(8) * np.sin(2 * np.pi * times / 5.3)
    places = [np.stack((sway(0.13, 0.008), -0.02 + sway(0.17, 0.008), HEAD_HEIGHT - 0.01 + sway(0.2, 0.002)), -1)]
    turns = [multiply(quat_from_yaw(yaw), quat_from_axis_angle(X, nod))]
    for side in (1, -1):
        places.append(np.stack((side * 0.2 + sway(0.15, 0.006), -0.08 + sway(0.11, 0.006), HEAD_HEIGHT - 0.62 + sway(0.2, 0.004)), -1))
        turns.append(np.broadcast_to(quat_from_axis_angle(Y, side * 1.5), (len(times), 4)))
    positions, rotations = np.stack(places, 1).astype(np.float32), np.stack(turns, 1).astype(np.float32)
    return Take("standing", times, positions, rotations, np.ones((len(times), 3), bool), "joint", {}, TakeReport("synthetic", len(times), constants={}))


@pytest.mark.parametrize("mode", MODES)
def test_half_a_minute_of_standing_is_no_walk(mode: str) -> None:
    take = standing_take()
    performance = run(perform(take, HEAD_HEIGHT, STANDARD_PROPORTIONS, load_model(), SolveOptions(mode)))
    solved = tracks(fuse(performance, take, np.arange(30 * 30) / 30, STANDARD_BODY))
    feet = 100 * 30 * np.linalg.norm(np.diff(solved.of(CONTACT_JOINTS), axis=0), axis=-1)
    heading = np.degrees(np.unwrap(yaw_from_quat(root_frame(solved.body, solved.positions).rotation)))
    assert feet.mean() < 0.3  # cm/s
    assert feet.max() < 2
    assert np.ptp(heading) < 5


def test_who_walks_is_not_held(body_motion) -> None:
    take = synthesize(body_motion)
    rest = at_rest(take.positions / HEAD_HEIGHT, causal=False)
    speed = np.linalg.norm(np.gradient(take.positions[:, 0], axis=0), axis=-1) * RATE
    assert rest[speed > 0.3].max() == 0
    performance = run(perform(take, HEAD_HEIGHT, STANDARD_PROPORTIONS, load_model(), SolveOptions()))
    moving = settle(performance, replace(take, positions=take.positions + np.arange(len(take.times))[:, None, None].astype(np.float32)))
    np.testing.assert_allclose(moving.lower_positions, performance.lower_positions, atol=1e-5)


def test_rest_is_judged_by_the_fastest_tracker_and_causally_by_the_past_alone() -> None:
    positions = np.zeros((120, 3, 3), np.float32)
    positions[60:, 1, 0] = np.arange(60) * 0.01
    for causal in (False, True):
        rest = at_rest(positions, causal)
        assert rest[:40].min() == 1
        assert rest[80:].max() == 0
    np.testing.assert_array_equal(at_rest(positions, True)[:61], at_rest(positions[:61], True))
