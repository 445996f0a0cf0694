"""What training does to clips: other bodies keep their feet, and hips may be at other places of a pelvis."""

from __future__ import annotations

import numpy as np

from cbm_addon.features import LOWER_JOINTS
from cbm_addon.learn.augment import move_hips, vary
from cbm_addon.motion.motion import Motion
from cbm_addon.motion.resample import lerp_samples
from cbm_addon.motion.rotations import rotate


def test_a_varied_body_walks_on_the_same_prints_larger_or_smaller(body_motion: Motion) -> None:
    varied = vary(body_motion, 3)
    joints = body_motion.skeleton.indices([name for name in LOWER_JOINTS if name != "Hips"])
    share = np.linspace(0, 1, len(varied)) * varied.seconds / varied.times[-1]
    before = lerp_samples(np.linspace(0, 1, len(body_motion)), body_motion.positions()[:, joints], share)
    after = varied.positions()[:, joints]
    scale = np.sum(before * after) / np.sum(before * before)
    assert abs(scale - 1) > 0.01
    # A foot is where it was, times one factor; the tempo leaves at most half a frame at the end.
    assert np.median(np.linalg.norm(after - scale * before, axis=-1)) < 0.01


def test_a_varied_body_has_other_proportions_and_another_tempo(body_motion: Motion) -> None:
    varied = vary(body_motion, 3)
    kept = body_motion.skeleton.parents > 0  # not those whose parents are the hips, which are elsewhere in the pelvis
    length = np.linalg.norm(varied.skeleton.offsets[kept], axis=-1) / np.linalg.norm(body_motion.skeleton.offsets[kept], axis=-1)
    assert len({round(float(value), 3) for value in length}) == 3  # legs, torso and arms
    assert len(varied) != len(body_motion)
    np.testing.assert_allclose(varied.rate, body_motion.rate)


def test_hips_that_are_elsewhere_in_the_pelvis_move_nothing_else(body_motion: Motion) -> None:
    before, after = body_motion.forward(), move_hips(body_motion, 0.1).forward()
    np.testing.assert_allclose(after[0], before[0])
    np.testing.assert_allclose(after[1][:, 1:], before[1][:, 1:], atol=1e-5)
    up = rotate(before[0][:, 0], np.array([0, 0, 0.1], np.float32))
    np.testing.assert_allclose(after[1][:, 0] - before[1][:, 0], up, atol=1e-5)
