"""What was not tracked is filled: bridged when short, held relative to the head when long, hanging when never seen."""

from __future__ import annotations

import numpy as np
import pytest

from cbm_addon.motion.rotations import difference, quat_from_yaw, rotate
from cbm_addon.takes.gaps import SHORT_GAP, fill
from cbm_addon.takes.take import HEAD, LEFT, RIGHT

RATE = 100
TIMES = np.arange(5 * RATE) / RATE
STATURE = 1.75


@pytest.fixture
def poses():
    """A head that circles and turns at 1.6 m, hands carried along with it; nothing is lost yet."""
    yaw = 0.6 * TIMES
    facing = quat_from_yaw(yaw)
    head = np.stack((np.cos(TIMES), np.sin(TIMES), 1.6 + 0.1 * np.sin(3 * TIMES)), axis=-1)
    positions = np.stack([head, *(head + rotate(facing, np.array([side * 0.3, -0.3, -0.4])) for side in (1, -1))], axis=1)
    return positions, np.repeat(facing[:, None], 3, axis=1), np.ones((len(TIMES), 3), dtype=bool)


def lose(poses, device, start, end):
    positions, rotations, tracked = (array.copy() for array in poses)
    gone = slice(round(start * RATE), round(end * RATE))
    positions[gone, device], rotations[gone, device], tracked[gone, device] = np.nan, np.nan, False
    return positions, rotations, tracked


def assert_sound(positions, rotations):
    assert np.isfinite(positions).all()
    np.testing.assert_allclose(np.linalg.norm(rotations, axis=-1), 1, atol=1e-9)
    assert (np.sum(rotations[1:] * rotations[:-1], axis=-1) > 0).all()


def test_what_is_tracked_is_kept(poses):
    positions, rotations = fill(TIMES, *poses, STATURE)
    np.testing.assert_array_equal(positions, poses[0])
    np.testing.assert_allclose(rotations, poses[1], atol=1e-12)


@pytest.mark.parametrize("device", [HEAD, LEFT, RIGHT])
def test_short_gaps_are_bridged(poses, device):
    positions, rotations = fill(TIMES, *lose(poses, device, 2.0, 2.0 + SHORT_GAP - 0.05), STATURE)
    assert_sound(positions, rotations)
    np.testing.assert_allclose(positions, poses[0], atol=0.02)
    assert difference(rotations, poses[1]).max() < 0.01


@pytest.mark.parametrize(("start", "end"), [(1, 4), (0, 2), (3, 5)], ids=["middle", "beginning", "end"])
def test_a_hand_lost_for_long_stays_where_it_was_from_the_head(poses, start, end):
    """These hands never move relative to the head and its heading: holding them gives the truth."""
    positions, rotations = fill(TIMES, *lose(poses, LEFT, start, end), STATURE)
    assert_sound(positions, rotations)
    np.testing.assert_allclose(positions, poses[0], atol=1e-9)
    np.testing.assert_allclose(difference(rotations, poses[1]), 0, atol=1e-6)


def test_a_held_hand_comes_back_without_a_jump(poses):
    positions, rotations, tracked = lose(poses, LEFT, 1, 3)
    positions[TIMES >= 3, LEFT] += [0, 0, 0.5]
    filled, _ = fill(TIMES, positions, rotations, tracked, STATURE)
    speed = np.linalg.norm(np.diff(filled[:, LEFT], axis=0), axis=-1) * RATE
    assert speed.max() < 1.5 * 0.5 / SHORT_GAP + 1


def test_a_head_lost_for_long_is_interpolated(poses):
    positions, rotations = fill(TIMES, *lose(poses, HEAD, 1, 2), STATURE)
    assert_sound(positions, rotations)
    between = (TIMES > 1) & (TIMES < 2)
    steps = np.diff(positions[between, HEAD], axis=0)
    np.testing.assert_allclose(steps, np.broadcast_to(steps[0], steps.shape), atol=1e-9)


def test_a_hand_that_is_never_seen_hangs_beside_the_body(poses):
    positions, rotations = fill(TIMES, *lose(lose(poses, LEFT, 0, 9), RIGHT, 0, 9), STATURE)
    assert_sound(positions, rotations)
    facing = poses[1][:, HEAD]
    leftward = rotate(facing, np.array([1.0, 0, 0]))
    for hand, side in ((LEFT, 1), (RIGHT, -1)):
        from_head = positions[:, hand] - positions[:, HEAD]
        assert (side * np.sum(from_head * leftward, axis=-1) > 0.15).all()
        assert (from_head[:, 2] < -0.5).all()
        np.testing.assert_allclose(rotate(rotations[:, hand], np.array([side * 1.0, 0, 0])), np.broadcast_to([0, 0, -1], (len(TIMES), 3)), atol=1e-9)
        np.testing.assert_allclose(rotate(rotations[:, hand], np.array([0, -1.0, 0])), rotate(facing, np.array([0, -1.0, 0])), atol=1e-9)
