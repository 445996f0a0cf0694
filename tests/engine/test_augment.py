"""What training does to clips: other bodies keep their feet."""

from __future__ import annotations

import numpy as np

from cbm_addon.features import LOWER_JOINTS
from cbm_addon.learn.augment import vary
from cbm_addon.motion.motion import Motion
from cbm_addon.motion.resample import lerp_samples


def test_a_varied_body_walks_on_the_same_prints_larger_or_smaller(body_motion: Motion) -> None:
    varied = vary(body_motion, 3)
    joints = body_motion.skeleton.indices(list(LOWER_JOINTS))
    share = np.linspace(0, 1, len(varied)) * varied.seconds / varied.times[-1]
    before = lerp_samples(np.linspace(0, 1, len(body_motion)), body_motion.positions()[:, joints], share)
    after = varied.positions()[:, joints]
    scale = np.sum(before * after) / np.sum(before * before)
    assert abs(scale - 1) > 0.01
    # A foot is where it was, times one factor; the tempo leaves at most half a frame at the end.
    assert np.median(np.linalg.norm(after - scale * before, axis=-1)) < 0.01


def test_a_varied_body_has_other_proportions_and_another_tempo(body_motion: Motion) -> None:
    varied = vary(body_motion, 3)
    length = np.linalg.norm(varied.skeleton.offsets[1:], axis=-1) / np.linalg.norm(body_motion.skeleton.offsets[1:], axis=-1)
    assert len({round(float(value), 3) for value in length}) == 3  # legs, torso and arms
    assert len(varied) != len(body_motion)
    np.testing.assert_allclose(varied.rate, body_motion.rate)
