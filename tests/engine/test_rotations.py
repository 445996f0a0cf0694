"""Rotations: every representation is the same rotation, whichever way round it was reached."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cbm_addon.motion import rotations as rot

ORDERS = ["".join(order) for order in itertools.permutations("XYZ")]

seeds = st.integers(0, 2**32 - 1)
angles = st.floats(-np.pi, np.pi)
settings.register_profile("cbm", deadline=None)
settings.load_profile("cbm")


def random_quaternions(seed: int, *shape: int) -> np.ndarray:
    return rot.normalize(np.random.default_rng(seed).normal(size=(*shape, 4)))


def elementary(axis: str, theta: float) -> np.ndarray:
    """The textbook's rotation matrix about one axis."""
    c, s = np.cos(theta), np.sin(theta)
    return np.array({"X": [[1, 0, 0], [0, c, -s], [0, s, c]], "Y": [[c, 0, s], [0, 1, 0], [-s, 0, c]], "Z": [[c, -s, 0], [s, c, 0], [0, 0, 1]]}[axis])


def assert_same_rotation(a: np.ndarray, b: np.ndarray, within: float = 1e-6) -> None:
    assert rot.difference(a, b).max() < within


@given(seeds)
def test_a_product_of_quaternions_is_the_product_of_their_matrices(seed):
    a, b = random_quaternions(seed, 2, 5)
    assert np.allclose(rot.matrix_from_quat(rot.multiply(a, b)), rot.matrix_from_quat(a) @ rot.matrix_from_quat(b))


@given(seeds)
def test_rotating_a_vector_is_multiplying_it_by_the_matrix(seed):
    q, v = random_quaternions(seed, 5), np.random.default_rng(seed).normal(size=(5, 3))
    assert np.allclose(rot.rotate(q, v), (rot.matrix_from_quat(q) @ v[..., None])[..., 0])


@given(seeds)
def test_matrices_are_orthonormal_and_keep_handedness(seed):
    m = rot.matrix_from_quat(random_quaternions(seed, 5))
    assert np.allclose(m @ np.swapaxes(m, -1, -2), np.eye(3))
    assert np.allclose(np.linalg.det(m), 1)


@given(seeds)
def test_the_inverse_undoes(seed):
    q = random_quaternions(seed, 5)
    assert_same_rotation(rot.multiply(q, rot.inverse(q)), np.broadcast_to(rot.IDENTITY, q.shape))


@given(seeds)
def test_matrix_rotation_vector_and_sixd_lead_back(seed):
    q = random_quaternions(seed, 20)
    assert_same_rotation(rot.quat_from_matrix(rot.matrix_from_quat(q)), q)
    assert_same_rotation(rot.quat_from_rotvec(rot.rotvec_from_quat(q)), q)
    assert_same_rotation(rot.quat_from_sixd(rot.sixd_from_quat(q)), q)


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.6, 0, 0.8)])
def test_half_turns_survive_the_way_through_matrices(axis):
    """Where the sum of the diagonal is -1, the simple formula for the quaternion divides by zero."""
    q = np.array([0.0, *axis])
    assert_same_rotation(rot.quat_from_matrix(rot.matrix_from_quat(q)), q)


def test_any_two_directions_make_a_rotation():
    m = rot.matrix_from_sixd(np.array([2.0, 0, 0, 5, 3, 0]))
    assert np.allclose(m, np.eye(3))


@given(angles, angles, angles, st.sampled_from(ORDERS))
def test_euler_angles_are_elementary_rotations_one_after_the_other(a, b, c, order):
    q = rot.quat_from_euler(np.array([a, b, c]), order)
    expected = elementary(order[0], a) @ elementary(order[1], b) @ elementary(order[2], c)
    assert np.allclose(rot.matrix_from_quat(q), expected)


@given(seeds, st.sampled_from(ORDERS))
def test_euler_angles_lead_back(seed, order):
    q = random_quaternions(seed, 20)
    assert_same_rotation(rot.quat_from_euler(rot.euler_from_quat(q, order), order), q, within=1e-5)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("middle", [-np.pi / 2, np.pi / 2])
def test_euler_angles_lead_back_at_gimbal_lock(order, middle):
    q = rot.quat_from_euler(np.array([0.7, middle, -0.4]), order)
    assert_same_rotation(rot.quat_from_euler(rot.euler_from_quat(q, order), order), q, within=1e-3)


@given(seeds)
def test_quat_between_takes_the_one_direction_to_the_other(seed):
    u, v = np.random.default_rng(seed).normal(size=(2, 10, 3))
    assert np.allclose(rot.rotate(rot.quat_between(u, v), rot.normalize(u)), rot.normalize(v))


@pytest.mark.parametrize("u", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.6, -0.8, 0)])
@pytest.mark.parametrize("sign", [1, -1])
def test_quat_between_parallel_and_opposite_directions(u, sign):
    u = np.array(u, dtype=float)
    q = rot.quat_between(u, sign * u)
    assert np.allclose(rot.rotate(q, u), sign * u, atol=1e-6)
    assert np.isclose(rot.angle(q), 0 if sign > 0 else np.pi, atol=1e-6)


@given(seeds, st.floats(0, 1))
def test_slerp_turns_at_a_steady_speed_along_the_shorter_arc(seed, t):
    a, b = random_quaternions(seed, 2, 5)
    whole = rot.difference(a, b)
    between = rot.slerp(a, b, t)
    assert np.allclose(rot.difference(a, between), t * whole, atol=1e-5)
    assert np.allclose(rot.difference(between, b), (1 - t) * whole, atol=1e-5)
    assert_same_rotation(rot.slerp(a, -b, t), between, within=1e-5)


@given(seeds)
def test_continuous_keeps_the_rotations_and_never_jumps_to_the_other_sign(seed):
    q = random_quaternions(seed, 30, 2)
    smooth = rot.continuous(q)
    assert_same_rotation(smooth, q)
    assert (np.sum(smooth[1:] * smooth[:-1], axis=-1) >= 0).all()


@given(seeds, st.sampled_from(ORDERS))
def test_continuous_euler_keeps_the_rotations_and_follows_a_smooth_motion_across_gimbal_lock(seed, order):
    """Angles that grow steadily, far beyond a turn: each component of what comes back is as steady."""
    speeds = np.random.default_rng(seed).uniform(0.01, 0.05, 3)
    steady = np.arange(400)[:, None] * speeds + 0.123
    quaternions = rot.quat_from_euler(steady, order)
    found = rot.continuous_euler(rot.euler_from_quat(quaternions, order))
    assert_same_rotation(rot.quat_from_euler(found, order), quaternions, within=1e-3)
    assert np.abs(np.diff(found, axis=0)).max() < 0.1


@given(st.floats(-3.1, 3.1), st.floats(-1, 1), st.floats(-1, 1))
def test_yaw_is_the_turn_about_z_whatever_the_tilt(yaw, tilt_x, tilt_y):
    tilt = rot.quat_from_rotvec(np.array([tilt_x, tilt_y, 0]))
    q = rot.multiply(rot.quat_from_yaw(np.array(yaw)), tilt)
    assert_same_rotation(rot.quat_from_yaw(rot.yaw_from_quat(q)), rot.quat_from_yaw(np.array(yaw)))


@given(angles)
def test_a_quarter_turn_about_z_takes_x_to_y(theta):
    assert np.allclose(rot.rotate(rot.quat_from_yaw(np.array(theta)), np.array([1.0, 0, 0])), [np.cos(theta), np.sin(theta), 0])
    assert_same_rotation(rot.quat_from_axis_angle(np.array([0.0, 0, 1]), np.array(theta)), rot.quat_from_yaw(np.array(theta)))


def test_functions_keep_float32():
    q = random_quaternions(0, 6).astype(np.float32)
    v = np.ones((6, 3), dtype=np.float32)
    results = (
        rot.multiply(q, q), rot.inverse(q), rot.rotate(q, v), rot.matrix_from_quat(q), rot.quat_from_matrix(rot.matrix_from_quat(q)),
        rot.quat_from_rotvec(v), rot.rotvec_from_quat(q), rot.sixd_from_quat(q), rot.quat_from_sixd(rot.sixd_from_quat(q)),
        rot.euler_from_quat(q, "ZXY"), rot.quat_from_euler(v, "ZXY"), rot.slerp(q, q, 0.5), rot.continuous(q), rot.continuous_euler(v),
        rot.quat_between(v, v), rot.normalize(v), rot.angle(q), rot.quat_from_yaw(rot.yaw_from_quat(q)),
    )  # fmt: skip
    assert [result.dtype for result in results] == [np.float32] * len(results)


def test_normalising_zero_gives_zero():
    assert (rot.normalize(np.zeros(4)) == 0).all()
