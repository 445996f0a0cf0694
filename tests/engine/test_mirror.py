"""Mirroring: what the left did, the right does."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cbm_addon.motion.mirror import mirror, mirror_positions, mirrored_joints
from cbm_addon.motion.motion import Motion
from cbm_addon.motion.rotations import difference, normalize
from cbm_addon.motion.skeleton import STANDARD_BODY, Skeleton


def random_motion(seed: int) -> Motion:
    """A lopsided body with animated offsets."""
    random = np.random.default_rng(seed)
    offsets = STANDARD_BODY.offsets + random.normal(0, 0.05, STANDARD_BODY.offsets.shape).astype(np.float32)
    body = Skeleton(STANDARD_BODY.names, STANDARD_BODY.parents, offsets, STANDARD_BODY.tips)
    rotations = normalize(random.normal(size=(5, len(body), 4))).astype(np.float32)
    moved = (offsets + random.normal(0, 0.05, (5, *offsets.shape))).astype(np.float32)
    return Motion(body, np.arange(5) / 30, random.normal(size=(5, 3)).astype(np.float32), rotations, moved)


@given(st.integers(0, 2**32 - 1))
def test_the_joints_of_the_mirrored_motion_are_the_mirror_images_of_their_twins(seed):
    motion = random_motion(seed)
    twins = mirrored_joints(motion.skeleton)
    assert np.allclose(mirror(motion).positions(), mirror_positions(motion.positions()[:, twins]), atol=1e-4)


@given(st.integers(0, 2**32 - 1))
def test_mirroring_twice_gives_the_original(seed):
    motion = random_motion(seed)
    twice = mirror(mirror(motion))
    assert np.array_equal(twice.root, motion.root)
    assert difference(twice.rotations, motion.rotations).max() < 1e-6
    assert np.array_equal(twice.skeleton.offsets, motion.skeleton.offsets)
    assert np.array_equal(np.isnan(twice.skeleton.tips), np.isnan(motion.skeleton.tips))


def test_a_symmetric_body_is_its_own_mirror_image():
    rest = np.zeros((1, len(STANDARD_BODY), 4), dtype=np.float32)
    rest[..., 0] = 1
    mirrored = mirror(Motion(STANDARD_BODY, np.zeros(1), np.zeros((1, 3), dtype=np.float32), rest))
    assert np.allclose(mirrored.skeleton.offsets, STANDARD_BODY.offsets)
    assert np.allclose(mirrored.skeleton.tips, STANDARD_BODY.tips, equal_nan=True)


def test_joints_without_a_twin_are_their_own():
    names = ("Hips", "LeftArm", "RightArm", "LeftTail")
    nothing = np.zeros((4, 3), dtype=np.float32)
    assert mirrored_joints(Skeleton(names, np.array([-1, 0, 0, 0]), nothing, nothing)).tolist() == [0, 2, 1, 3]
