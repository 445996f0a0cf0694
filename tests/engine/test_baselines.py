"""The baselines are sound: they move with the person, keep to their mode, and motion matching finds what it knows."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cbm_addon.errors import InputError
from cbm_addon.evaluate import METHODS, motion_matching
from cbm_addon.evaluate.baselines import carry_legs, shuffle_codes
from cbm_addon.evaluate.methods import prepare_methods
from cbm_addon.evaluate.motion_matching import PLAYED, Database, index_database, match_motion
from cbm_addon.features import CONTROL, LOWER_BODY, LOWER_JOINTS, MODES, RATE, STANDARD_PROPORTIONS, TRACKERS
from cbm_addon.learn.dataset import Dataset, clip_frames, join
from cbm_addon.motion.bvh import write_bvh
from cbm_addon.motion.motion import Motion
from cbm_addon.motion.rotations import Array, difference, multiply, quat_from_yaw, rotate, yaw_from_quat
from cbm_addon.progress import run
from cbm_addon.solve.fuse import fuse
from cbm_addon.solve.models import Model, ModeNetworks
from cbm_addon.solve.perform import SolveOptions, perform
from cbm_addon.solve.performance import Performance
from cbm_addon.takes.synthesize import synthesize
from cbm_addon.takes.take import HEAD, Take

HIPS = LOWER_JOINTS.index("Hips")


def placed(motion: Motion, yaw: float, step: tuple[float, float, float]) -> Motion:
    """The motion turned about the world's Z, then moved."""
    turn = quat_from_yaw(np.float32(yaw)).astype(np.float32)
    rotations = motion.rotations.copy()
    rotations[:, 0] = multiply(turn, rotations[:, 0])
    return replace(motion, root=rotate(turn, motion.root) + np.array(step, np.float32), rotations=rotations)


def changed_from(take: Take, frame: int) -> Take:
    positions, rotations = take.positions.copy(), take.rotations.copy()
    positions[frame:, :, :2] += np.float32(0.5)
    rotations[frame:] = multiply(quat_from_yaw(np.float32(1)).astype(np.float32), rotations[frame:])
    return replace(take, positions=positions, rotations=rotations)


@pytest.fixture(scope="module")
def dataset(body_motion: Motion) -> Dataset:
    return join([clip_frames("known", body_motion)])


@pytest.fixture(scope="module")
def databases(dataset: Dataset) -> dict[str, Database]:
    return {mode: run(index_database(dataset, mode)) for mode in MODES}


def solved_by(name: str, take: Take, body_motion: Motion, mode: str, databases: dict[str, Database]) -> Performance:
    body = body_motion.skeleton
    if name == "legs-carried":
        return carry_legs(take, body, causal=mode == "causal")
    return match_motion(take, body.height_above_toes("Head"), databases[mode])


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", ["legs-carried", "motion-matching"])
class TestBoth:
    def test_the_answer_covers_the_take_and_says_its_mode(self, name, mode, body_motion, databases) -> None:
        result = solved_by(name, synthesize(body_motion), body_motion, mode, databases)
        arrays = [result.lower_positions, result.lower_velocities, result.lower_rotations, result.upper_rotations, result.contacts]
        assert all(len(values) == len(body_motion) and np.isfinite(values).all() and values.dtype == np.float32 for values in arrays)
        assert result.causal == (mode == "causal")

    def test_the_answer_goes_where_the_person_goes(self, name, mode, body_motion, databases) -> None:
        yaw, step = 2.0, (3.0, -1.0, 0.0)
        here = solved_by(name, synthesize(body_motion), body_motion, mode, databases)
        there = solved_by(name, synthesize(placed(body_motion, yaw, step)), body_motion, mode, databases)
        turn = quat_from_yaw(np.float32(yaw)).astype(np.float32)
        expected = rotate(turn, here.lower_positions) + np.array(step, np.float32) / np.float32(here.head_height)
        np.testing.assert_allclose(there.lower_positions, expected, atol=1e-3)
        assert difference(there.lower_rotations, multiply(turn, here.lower_rotations)).max() < 0.01

    def test_only_causal_mode_does_not_look_ahead(self, name, mode, body_motion, databases) -> None:
        take = synthesize(body_motion)
        half = len(body_motion) // 2
        before, after = (solved_by(name, t, body_motion, mode, databases).lower_positions[half - 5 : half] for t in (take, changed_from(take, half)))
        assert np.allclose(before, after, atol=1e-6) == (mode == "causal")


def test_a_person_at_rest_keeps_the_legs_at_rest(body_motion: Motion) -> None:
    count = len(body_motion)
    root = np.zeros((count, 3), np.float32)
    root[:, 2] = body_motion.skeleton.height_above_toes("Hips")
    rest = replace(body_motion, root=root, rotations=np.tile(np.array([1, 0, 0, 0], np.float32), (count, len(body_motion.skeleton), 1)))
    result = carry_legs(synthesize(rest), rest.skeleton, causal=False)
    truth = rest.positions()[:, rest.skeleton.indices(LOWER_JOINTS)]
    np.testing.assert_allclose(result.lower_positions * result.head_height, truth, atol=1e-4)


def test_carried_legs_stay_above_the_floor_when_the_person_crouches(body_motion: Motion) -> None:
    take = synthesize(body_motion)
    low = replace(take, positions=take.positions - np.array([0, 0, 0.4], np.float32))
    motion = fuse(carry_legs(low, body_motion.skeleton, causal=False), low, body_motion.times, body_motion.skeleton)
    toes = motion.positions()[:, motion.skeleton.indices(["LeftToe", "RightToe"]), 2]
    assert toes.min() > -0.01


def test_a_glance_turns_the_hips_less_than_the_head(body_motion: Motion) -> None:
    take = synthesize(body_motion)
    glance = quat_from_yaw(np.float32(np.radians(60))).astype(np.float32)
    rotations = take.rotations.copy()
    rotations[:, HEAD] = multiply(glance, rotations[:, HEAD])
    before, after = (carry_legs(t, body_motion.skeleton, causal=False).lower_rotations[:, HIPS] for t in (take, replace(take, rotations=rotations)))
    turned = np.degrees(np.median(np.abs(yaw_from_quat(multiply(after, before * np.array([1, -1, -1, -1]))))))
    assert 5 < turned < 60


def test_motion_matching_finds_every_frame_that_it_knows(dataset: Dataset, databases: dict[str, Database]) -> None:
    for mode, database in databases.items():
        windows = dataset.batch(np.arange(len(dataset)), MODES[mode])[0]
        found = dataset.batch(database.nearest(windows), MODES[mode])[0]
        np.testing.assert_allclose(found, windows, atol=1e-2)


def test_the_search_in_blocks_is_a_plain_nearest_neighbour_search(monkeypatch: pytest.MonkeyPatch, databases: dict[str, Database]) -> None:
    monkeypatch.setattr(motion_matching, "BLOCK", 7)
    random = np.random.default_rng(5)
    database = databases["lookahead"]
    windows = random.normal(size=(20, len(database.mode.window), TRACKERS.size)).astype(np.float32)
    queries = (windows.reshape(20, -1) - database.mean) @ database.basis
    expected = np.linalg.norm(queries[:, None] - database.keys[None], axis=-1).argmin(axis=1)
    np.testing.assert_array_equal(database.nearest(windows), expected)


def test_motion_matching_gives_a_known_clip_back(body_motion: Motion, databases: dict[str, Database]) -> None:
    result = match_motion(synthesize(body_motion), body_motion.skeleton.height_above_toes("Head"), databases["lookahead"])
    truth = body_motion.positions()[:, body_motion.skeleton.indices(LOWER_JOINTS)]
    error = np.linalg.norm(result.lower_positions * result.head_height - truth, axis=-1)
    assert np.median(error) < 0.01


@pytest.mark.parametrize("mode", MODES)
def test_matches_fade_into_each_other(mode: str) -> None:
    played = PLAYED[mode]
    weights = dict(zip(played.sequence, motion_matching._weights(played), strict=True))
    hop = motion_matching.HOP
    for frame in range(hop):
        assert sum(weights.get(frame + shift * hop, 0) for shift in (-1, 0, 1)) == pytest.approx(1)


class Session:
    """Stands for an ONNX session: functions of the inputs by name."""

    def __init__(self, *answers: Callable[..., Array]) -> None:
        self.answers = answers

    def run(self, outputs: list[str] | None, inputs: dict[str, Array]) -> list[Array]:
        return [answer(**inputs) for answer in self.answers]


def random_model(channels: int = 4, classes: int = 8) -> Model:
    """Networks that are random linear maps."""
    random = np.random.default_rng(0)
    modes = {}
    for mode in MODES.values():
        window, sequence = len(mode.window) * TRACKERS.size + len(STANDARD_PROPORTIONS), len(mode.sequence)
        control = random.normal(size=(window, sequence * CONTROL.size)).astype(np.float32)
        logits = random.normal(size=(window, channels * classes)).astype(np.float32)
        lower_body = random.normal(size=(channels * classes, sequence * LOWER_BODY.size)).astype(np.float32)
        sessions = {
            "estimator": Session(lambda window, control=control: window @ control, lambda window, logits=logits: window @ logits, lambda window: window),
            "decoder": Session(lambda codes, features, lower_body=lower_body: codes @ lower_body),
        }
        modes[mode.name] = ModeNetworks(
            mode, channels, classes, sessions, np.zeros((0, 9, 3), np.float32), np.stack((STANDARD_PROPORTIONS, STANDARD_PROPORTIONS))
        )
    return Model(Path("random"), {"name": "random"}, modes)


@pytest.mark.parametrize("mode", MODES)
def test_shuffled_codes_are_those_of_other_frames(mode: str) -> None:
    model = random_model()
    own, shuffled = model.networks(mode), shuffle_codes(model, seed=1).networks(mode)
    windows = np.random.default_rng(0).normal(size=(30, len(own.mode.window), TRACKERS.size)).astype(np.float32)
    estimate, shuffle = own.estimate(windows, STANDARD_PROPORTIONS), shuffled.estimate(windows, STANDARD_PROPORTIONS)
    codes, dealt = estimate.logits, shuffle.logits
    assert sorted(codes.sum((1, 2)).tolist()) == sorted(dealt.sum((1, 2)).tolist())
    assert np.mean([np.array_equal(a, b) for a, b in zip(codes, dealt, strict=True)]) < 0.2
    np.testing.assert_array_equal(dealt, shuffled.estimate(windows, STANDARD_PROPORTIONS).logits)
    np.testing.assert_array_equal(estimate.control, shuffle.control)
    np.testing.assert_array_equal(estimate.features, shuffle.features)


def test_shuffled_codes_change_the_legs_and_nothing_above(body_motion: Motion) -> None:
    model, take = random_model(), synthesize(body_motion)
    own, shuffled = (run(perform(take, 1.6, STANDARD_PROPORTIONS, used, SolveOptions(candidates=1))) for used in (model, shuffle_codes(model, seed=1)))
    np.testing.assert_array_equal(own.upper_rotations, shuffled.upper_rotations)
    assert not np.allclose(own.lower_positions, shuffled.lower_positions, atol=0.1)


def test_velocities_of_carried_legs_are_per_second(body_motion: Motion) -> None:
    result = carry_legs(synthesize(body_motion), body_motion.skeleton, causal=False)
    np.testing.assert_allclose(result.lower_velocities[1:] / RATE, np.diff(result.lower_positions, axis=0), atol=1e-5)


def test_every_method_that_has_a_name_can_be_prepared_and_answers(tmp_path: Path, body_motion: Motion) -> None:
    write_bvh(tmp_path / "clip.bvh", body_motion)
    take, body = synthesize(body_motion), body_motion.skeleton
    methods = run(prepare_methods(METHODS, MODES, random_model(), [tmp_path]))
    assert tuple(methods) == METHODS
    for method in methods.values():
        for mode in MODES:
            answer = run(method(take, body, SolveOptions(mode=mode, candidates=2)))
            assert len(answer.times) == len(body_motion)
            assert answer.causal == (mode == "causal")


def test_a_mode_that_the_model_lacks_is_refused_before_anything_is_solved() -> None:
    model = random_model()
    with pytest.raises(InputError, match="causal"):
        run(prepare_methods(["ours"], ["causal"], replace(model, modes={"lookahead": model.modes["lookahead"]}), []))


def test_motion_matching_asks_for_a_database() -> None:
    with pytest.raises(InputError, match="--database"):
        run(prepare_methods(["motion-matching"], ["lookahead"], None, []))
