"""Frames on the ground."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cbm_addon.motion.ground_frame import GroundFrame, ground_frame, root_frame
from cbm_addon.motion.rotations import difference, multiply, quat_from_rotvec, quat_from_yaw, rotate
from cbm_addon.motion.skeleton import STANDARD_BODY

yaws = st.floats(-3, 3)


def frame_at(x: float, y: float, yaw: float) -> GroundFrame:
    return GroundFrame(np.array([x, y, 0.0]), quat_from_yaw(np.array(yaw)))


@given(yaws)
def test_the_frame_of_an_upright_thing_is_below_it_and_faces_as_it_does(yaw):
    position, rotation = np.array([3.0, -2.0, 1.7]), quat_from_yaw(np.array(yaw))
    frame = ground_frame(position, rotation)
    assert np.allclose(frame.origin, [3.0, -2.0, 0.0])
    assert difference(frame.rotation, rotation) < 1e-6


@given(yaws, st.floats(-1, 1))
def test_a_nod_does_not_turn_the_shadow_of_a_head(yaw, nod):
    rotation = multiply(quat_from_yaw(np.array(yaw)), quat_from_rotvec(np.array([nod, 0, 0])))
    assert difference(ground_frame(np.zeros(3), rotation).rotation, quat_from_yaw(np.array(yaw))) < 1e-6


@given(st.floats(-5, 5), st.floats(-5, 5), yaws)
def test_the_root_of_a_body_follows_where_it_stands_and_faces(x, y, yaw):
    there = frame_at(x, y, yaw)
    positions = rotate(there.rotation, STANDARD_BODY.rest_positions().astype(np.float64)) + there.origin
    root = root_frame(STANDARD_BODY, positions)
    assert np.allclose(root.origin, there.origin)
    assert difference(root.rotation, there.rotation) < 1e-6


def test_a_body_at_rest_faces_minus_y():
    root = root_frame(STANDARD_BODY, STANDARD_BODY.rest_positions())
    assert np.allclose(rotate(root.rotation, np.array([0, -1, 0])), [0, -1, 0])


def test_frames_over_time_can_be_sliced():
    frames = ground_frame(np.arange(12.0).reshape(4, 3), np.tile([1.0, 0, 0, 0], (4, 1)))
    assert np.array_equal(frames[1:3].origin, [[3, 4, 0], [6, 7, 0]])
