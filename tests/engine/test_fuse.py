"""Stage 3: on any body the head and wrists meet the trackers, bones keep their lengths, knees bend forward and planted feet stand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cbm_addon.evaluate.baselines import carry_legs
from cbm_addon.features import LOWER_JOINTS, RATE
from cbm_addon.motion.contacts import CONTACT_JOINTS
from cbm_addon.motion.motion import Motion
from cbm_addon.motion.resample import frame_times, lerp_samples, resample
from cbm_addon.motion.rotations import difference, multiply, normalize, quat_from_rotvec, rotate
from cbm_addon.motion.skeleton import BODY_JOINTS, STANDARD_BODY, Skeleton
from cbm_addon.solve.fuse import fuse
from cbm_addon.solve.miscalibration import NONE, Miscalibration
from cbm_addon.solve.performance import Performance
from cbm_addon.takes.sample_motion import sample_motion
from cbm_addon.takes.synthesize import synthesize
from tests.performances import true_performance

ENDS = {"Head": 0, "LeftHand": 1, "RightHand": 2}


def without(body: Skeleton, *names: str) -> Skeleton:
    return body.subset(tuple(name for name in BODY_JOINTS if name not in names))


def stretched(body: Skeleton, part: str, factor: float) -> Skeleton:
    offsets = body.offsets.copy()
    for i, name in enumerate(body.names):
        if part in name:
            offsets[i] *= factor
    return replace(body, offsets=offsets)


def test_the_truth_gives_back_the_truth(body_motion: Motion) -> None:
    solved = fuse(true_performance(body_motion), synthesize(body_motion), body_motion.times, body_motion.skeleton)
    error = np.linalg.norm(solved.positions() - body_motion.positions(), axis=-1)
    assert error.mean() < 0.01
    assert np.percentile(error, 99) < 0.04


BODIES = {
    "the person's own": lambda body: body,
    "a child of 1.1 m": lambda body: body.scaled(1.1 / 1.75),
    "a giant of 2.2 m": lambda body: body.scaled(2.2 / 1.75),
    "long arms": lambda body: stretched(stretched(body, "ForeArm", 1.2), "Hand", 1.2),
    "short legs": lambda body: stretched(body, "Leg", 0.85),
    "no toes": lambda body: without(body, "LeftToe", "RightToe"),
    "no shoulders and one spine bone": lambda body: without(body, "LeftShoulder", "RightShoulder", "Spine1", "Spine2"),
}


@pytest.mark.parametrize("name", BODIES)
def test_head_and_wrists_meet_the_trackers_on_any_body(body_motion: Motion, name: str) -> None:
    body = BODIES[name](body_motion.skeleton)
    take = synthesize(body_motion)
    solved = fuse(true_performance(body_motion), take, body_motion.times, body)
    scale = body.height_above_toes() / body_motion.skeleton.height_above_toes()
    rotations, positions = solved.forward()
    for joint, device in ENDS.items():
        missed = np.linalg.norm(positions[:, body.index(joint)] - take.positions[:, device] * scale, axis=-1)
        assert np.mean(missed < 0.01) > 0.95, joint
        same = np.abs(np.sum(rotations[:, body.index(joint)] * take.rotations[:, device], axis=-1))
        np.testing.assert_allclose(same, 1, atol=1e-4)


def test_the_head_is_always_met_even_when_hips_and_hands_are_predicted_badly(body_motion: Motion) -> None:
    random = np.random.default_rng(0)
    truth = true_performance(body_motion)
    wrong = replace(
        truth,
        lower_positions=truth.lower_positions + random.normal(0, 0.08, (1, 1, 3)).astype(np.float32),
        upper_rotations=multiply(quat_from_rotvec(random.normal(0, 0.3, (1, 10, 3)).astype(np.float32)), truth.upper_rotations),
    )
    take = synthesize(body_motion)
    solved = fuse(wrong, take, body_motion.times, body_motion.skeleton)
    head = solved.positions()[:, solved.skeleton.index("Head")]
    np.testing.assert_allclose(head, take.positions[:, 0], atol=1e-4)


def test_wrists_beyond_short_arms_are_met_by_shoulders_and_chest() -> None:
    """The sample reaches to its sides with arms straight, where a shoulder that points the same way cannot help."""
    motion = resample(sample_motion(), frame_times(0, 36, RATE / 2))
    body = stretched(stretched(motion.skeleton, "ForeArm", 0.9), "Hand", 0.9)
    take = synthesize(motion)
    solved = fuse(true_performance(motion), take, motion.times, body).positions()
    for name, device in ENDS.items():
        missed = np.linalg.norm(solved[:, body.index(name)] - take.positions[:, device], axis=-1)
        assert np.percentile(missed, 98) < 0.004, name


def test_knees_bend_forward(body_motion: Motion) -> None:
    solved = fuse(true_performance(body_motion), synthesize(body_motion), body_motion.times, body_motion.skeleton)
    rotations, positions = solved.forward()
    for side in ("Left", "Right"):
        hip, knee, ankle = (positions[:, solved.skeleton.index(f"{side}{name}")] for name in ("UpLeg", "Leg", "Foot"))
        forward = rotate(rotations[:, 0], np.array([0, -1, 0], np.float32))
        bulge = np.sum((knee - (hip + ankle) / 2) * forward, axis=-1)
        assert bulge.min() > -0.01


def test_hips_that_are_predicted_too_high_and_tremble_do_not_shake_the_spine(body_motion: Motion) -> None:
    """Nearly straight, a spine that took up a centimetre would bend by tens of degrees."""
    truth, take, body = true_performance(body_motion), synthesize(body_motion), body_motion.skeleton
    rate = 1 / float(np.median(np.diff(body_motion.times)))
    bounce = 0.006 * np.sin(2 * np.pi * 2 * body_motion.times)
    positions, velocities = truth.lower_positions.copy(), truth.lower_velocities.copy()
    positions[:, 0, 2] += bounce.astype(np.float32)
    velocities[:, 0, 2] += (np.gradient(bounce) * rate).astype(np.float32)
    spine = body.indices(["Spine", "Spine1", "Spine2", "Neck", "LeftShoulder", "RightShoulder"])

    def turning(performance: Performance) -> float:
        rotations = fuse(performance, take, body_motion.times, body).rotations[:, spine]
        return float(np.degrees(difference(rotations[1:], rotations[:-1])).mean() * rate)

    assert turning(replace(truth, lower_positions=positions, lower_velocities=velocities)) < turning(truth) + 1


def test_a_body_that_is_too_tall_by_a_mistake_that_was_told_has_its_hips_where_the_performers_are(body_motion: Motion) -> None:
    body, take = body_motion.skeleton, synthesize(body_motion)
    truth = true_performance(body_motion)
    believed = truth.measured_in(1.1 * truth.head_height)

    def missed(performance: Performance) -> float:
        hips = fuse(performance, take, body_motion.times, body.scaled(1.1)).positions()[:, 0]
        return float(np.median(np.linalg.norm(hips - body_motion.positions()[:, 0], axis=-1)))

    assert missed(replace(believed, miscalibration=Miscalibration(NONE.slip, 1 / 1.1))) < 0.005
    assert missed(replace(believed, causal=True)) < 0.06, "nor far from it where nothing tells: a whole spine would be 7 cm"


def test_feet_stay_on_the_floor_even_where_stiff_legs_are_carried_far_below_it() -> None:
    """A thigh may then face backwards exactly: the half-turn that makes its knee a hinge must be about the bone, or the foot goes elsewhere."""
    take, body = synthesize(sample_motion()), STANDARD_BODY
    low = replace(take, positions=take.positions - np.array([0, 0, 0.9], np.float32))
    solved = fuse(carry_legs(low, body, causal=False), low, take.times[::5], body)
    feet = solved.positions()[:, body.indices(list(CONTACT_JOINTS)), 2]
    assert feet.min() > -0.01


def test_knees_are_hinges_though_thighs_and_shins_were_predicted_to_twist(body_motion: Motion) -> None:
    truth, body = true_performance(body_motion), body_motion.skeleton
    twists = truth.lower_rotations.copy()
    random = np.random.default_rng(2)
    for name in ("LeftUpLeg", "LeftLeg", "RightUpLeg", "RightLeg"):
        about = np.array([0, 0, 1]) * random.normal(scale=0.3, size=(len(body_motion), 1))
        twists[:, LOWER_JOINTS.index(name)] = multiply(twists[:, LOWER_JOINTS.index(name)], quat_from_rotvec(about).astype(np.float32))
    solved = fuse(replace(truth, lower_rotations=twists), synthesize(body_motion), body_motion.times, body)
    for side in ("Left", "Right"):
        knee = solved.rotations[:, body.index(f"{side}Leg")]
        bone = normalize(body.offsets[body.index(f"{side}Foot")])
        assert np.abs(knee[:, 1:] @ bone).max() < 1e-3, "no turn about the shin"
        shin = rotate(knee, bone)
        aside = np.cross(np.array([0, -1, 0]), bone)
        assert np.abs(shin @ aside).max() < 0.02, "no bend to the side"
        assert (shin @ np.array([0, 1, 0])).min() > -0.02, "no bend back to front"


def test_planted_feet_stand_still_though_they_were_predicted_to_slide(body_motion: Motion) -> None:
    truth = true_performance(body_motion)
    drift = np.linspace(0, 0.1, len(body_motion))[:, None, None] * np.array([1, 0, 0])
    feet = [LOWER_JOINTS.index(name) for name in CONTACT_JOINTS]
    sliding = truth.lower_positions.copy()
    sliding[:, feet] += drift.astype(np.float32)
    solved = fuse(replace(truth, lower_positions=sliding), synthesize(body_motion), body_motion.times, body_motion.skeleton)
    toes = solved.positions()[:, solved.skeleton.indices(["LeftToe", "RightToe"]), :2]
    contact = truth.contacts[:, [1, 3]] > 0.5
    inside = contact[2:] & contact[1:-1] & contact[:-2]
    speed = np.linalg.norm(np.diff(toes, axis=0), axis=-1)[1:] * RATE
    assert np.median(speed[inside]) < 0.01
    assert np.percentile(speed[inside], 90) < 0.08


def test_where_legs_are_too_short_heels_rise_over_toes_that_stay_planted(body_motion: Motion) -> None:
    """A headset 4 cm higher than legs and spine reach draws no foot away from where it stands. (The body as a whole stands elsewhere: the trackers say so.)"""
    truth, take = true_performance(body_motion), synthesize(body_motion)
    high = replace(take, positions=take.positions + np.array([0, 0, 0.04], np.float32))
    body = body_motion.skeleton
    solved, stood = (fuse(truth, trackers, body_motion.times, body).positions() for trackers in (high, take))
    toes, heels = body.indices(["LeftToe", "RightToe"]), body.indices(["LeftFoot", "RightFoot"])
    contact = truth.contacts[:, [1, 3]] > 0.5
    still = contact[1:] & contact[:-1]
    np.testing.assert_allclose(np.diff(solved[:, toes], axis=0)[still], np.diff(stood[:, toes], axis=0)[still], atol=0.002)
    assert (solved[:, heels, 2] - stood[:, heels, 2])[contact].max() > 0.02
    np.testing.assert_allclose(solved[:, body.index("Head")], high.positions[:, 0], atol=1e-4)


def test_a_causal_performance_gives_frames_that_do_not_depend_on_later_ones(body_motion: Motion) -> None:
    take = synthesize(body_motion)
    performance = true_performance(body_motion, causal=True)
    whole = fuse(performance, take, body_motion.times, body_motion.skeleton)
    half = len(body_motion) // 2
    early = Performance(*(getattr(performance, name)[:half] for name in list(performance.__dataclass_fields__)[:6]), performance.head_height, True)
    part = fuse(early, take, body_motion.times[:half], body_motion.skeleton)
    np.testing.assert_allclose(part.positions(), whole.positions()[:half], atol=1e-4)


def test_any_frame_rate_is_met_exactly(body_motion: Motion) -> None:
    take = synthesize(body_motion)
    times = np.arange(0, 7.5, 1 / 24)
    solved = fuse(true_performance(body_motion), take, times, body_motion.skeleton)
    assert len(solved) == len(times)
    head = solved.positions()[:, solved.skeleton.index("Head")]
    np.testing.assert_allclose(head, lerp_samples(take.times, take.positions[:, 0], times), atol=1e-4)
