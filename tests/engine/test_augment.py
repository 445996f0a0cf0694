"""What training does to clips and takes: other bodies keep their feet, and errors are those that recordings have."""

from __future__ import annotations

import numpy as np

from cbm_addon.features import LOWER_JOINTS
from cbm_addon.learn.augment import slip_hands, vary
from cbm_addon.motion.mirror import mirror_positions, mirror_rotations
from cbm_addon.motion.motion import Motion
from cbm_addon.motion.resample import lerp_samples
from cbm_addon.motion.rotations import difference, inverse, multiply, rotate
from cbm_addon.takes.synthesize import synthesize
from cbm_addon.takes.take import HEAD, LEFT, RIGHT


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


def test_controllers_of_another_kind_sit_at_a_constant_place_and_as_mirror_images(body_motion: Motion) -> None:
    take = synthesize(body_motion)
    slipped = slip_hands(take, np.random.default_rng(0))
    np.testing.assert_array_equal(slipped.positions[:, HEAD], take.positions[:, HEAD])
    places = [rotate(inverse(take.rotations[:, hand]), slipped.positions[:, hand] - take.positions[:, hand]) for hand in (LEFT, RIGHT)]
    turns = [multiply(inverse(take.rotations[:, hand]), slipped.rotations[:, hand]) for hand in (LEFT, RIGHT)]
    for place in places:
        np.testing.assert_allclose(place, place[:1].repeat(len(place), 0), atol=1e-5)
    assert np.linalg.norm(places[0][0]) > 0.01
    np.testing.assert_allclose(places[1], mirror_positions(places[0]), atol=1e-5)
    assert difference(turns[1], mirror_rotations(turns[0])).max() < 1e-3
