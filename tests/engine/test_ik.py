"""Inverse kinematics: limbs keep their lengths and end where they should; chains bend evenly."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cbm_addon.motion.rotations import normalize, quat_from_rotvec, rotate
from cbm_addon.solve.ik import aim, bend_chain, clamp_reach, turned_toward, two_bone

seeds = st.integers(0, 10_000)


@given(seeds)
def test_two_bones_meet_any_target_within_reach(seed: int) -> None:
    random = np.random.default_rng(seed)
    origin, pole = random.normal(size=(2, 50, 3))
    upper, lower = 0.3 + random.random(2) * 0.3
    distance = random.uniform(abs(upper - lower) * 1.01, (upper + lower) * 0.999, (50, 1))
    target = origin + normalize(random.normal(size=(50, 3))) * distance
    middle = two_bone(origin, target, upper, lower, pole)
    np.testing.assert_allclose(np.linalg.norm(middle - origin, axis=-1), upper, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(target - middle, axis=-1), lower, atol=1e-5)


@given(seeds)
def test_a_limb_bends_toward_its_pole(seed: int) -> None:
    random = np.random.default_rng(seed)
    origin, pole = random.normal(size=(2, 50, 3))
    target = origin + normalize(random.normal(size=(50, 3))) * 0.5
    bend = two_bone(origin, target, 0.4, 0.35, pole) - (origin + target) / 2
    along = normalize(target - origin)
    across = pole - np.sum(pole * along, axis=-1, keepdims=True) * along
    assert (np.sum(bend * across, axis=-1) > 0).all()


def test_a_target_out_of_reach_is_pulled_in_along_its_line() -> None:
    origin = np.zeros((1, 3))
    far = np.array([[0.0, 3.0, 4.0]])
    near = clamp_reach(origin, far, 1.0)
    assert 0.99 < np.linalg.norm(near) < 1.0
    np.testing.assert_allclose(np.cross(near, far), 0, atol=1e-9)
    np.testing.assert_array_equal(clamp_reach(origin, far, 6.0), far)


@given(seeds)
def test_aiming_points_the_bone_and_a_limited_turn_stays_within_its_limit(seed: int) -> None:
    random = np.random.default_rng(seed)
    rotation = quat_from_rotvec(random.normal(size=(20, 3)))
    offset, direction = random.normal(size=3), random.normal(size=(20, 3))
    aimed = rotate(aim(rotation, offset, direction), offset)
    np.testing.assert_allclose(normalize(aimed), normalize(direction), atol=1e-5)
    limited = rotate(turned_toward(rotation, offset, direction, 0.3), offset)
    before = rotate(rotation, offset)
    turned = np.arccos(np.clip(np.sum(normalize(limited) * normalize(before), axis=-1), -1, 1))
    assert (turned < 0.3 + 1e-3).all()


def test_a_chain_reaches_what_it_can_and_shares_the_bend() -> None:
    offsets = np.array([[0, 0, 0.2], [0, 0, 0.2], [0, 0, 0.2], [0, 0, 0.07]], np.float32)
    rotations = np.tile(np.array([1, 0, 0, 0], np.float32), (3, 4, 1))
    base = np.zeros((3, 3), np.float32)
    target = np.array([[0.1, 0, 0.62], [0.0, 0.3, 0.5], [0.2, -0.2, 0.4]], np.float32)
    bent, end = bend_chain(rotations, offsets, base, target)
    np.testing.assert_allclose(end, target, atol=5e-3)
    directions = rotate(bent, normalize(offsets))
    between = np.degrees(np.arccos(np.clip(np.sum(directions[:, 1:] * directions[:, :-1], axis=-1), -1, 1)))
    assert between.max() < 75, "no joint takes the whole bend"
