"""Stages 1 and 2 on a small model that was really trained and exported."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cbm_addon.features import MODES, STANDARD_PROPORTIONS
from cbm_addon.motion.motion import Motion
from cbm_addon.progress import Progress, run
from cbm_addon.solve.models import Model, load_model
from cbm_addon.solve.perform import SolveOptions, perform
from cbm_addon.solve.performance import Performance
from cbm_addon.takes.synthesize import synthesize
from cbm_addon.takes.take import Take


@pytest.fixture(scope="module")
def model(small_model_folder: Path) -> Model:
    return load_model(small_model_folder)


def solved(take: Take, model: Model, **options) -> Performance:
    return run(perform(take, 1.6, STANDARD_PROPORTIONS, model, SolveOptions(candidates=4, **options)))


def arrays(performance: Performance) -> list[np.ndarray]:
    return [getattr(performance, name) for name in list(performance.__dataclass_fields__)[:6]]


@pytest.mark.parametrize("mode", MODES)
def test_the_same_seed_gives_the_same_bytes_and_variations_differ(body_motion: Motion, model: Model, mode: str) -> None:
    take = synthesize(body_motion)
    first, again, other = (solved(take, model, mode=mode, variation=v) for v in (1, 1, 2))
    for a, b in zip(arrays(first), arrays(again), strict=True):
        assert a.tobytes() == b.tobytes()
    assert not np.array_equal(first.lower_positions, other.lower_positions)


@pytest.mark.parametrize("mode", MODES)
def test_a_performance_covers_the_take_and_holds_sound_values(body_motion: Motion, model: Model, mode: str) -> None:
    result = solved(synthesize(body_motion), model, mode=mode)
    assert all(len(values) == len(body_motion) and np.isfinite(values).all() for values in arrays(result))
    for rotations in (result.lower_rotations, result.upper_rotations):
        np.testing.assert_allclose(np.linalg.norm(rotations, axis=-1), 1, atol=1e-5)
    assert result.contacts.min() >= 0
    assert result.contacts.max() <= 1


def test_causal_mode_does_not_look_ahead_and_lookahead_does(body_motion: Motion, model: Model) -> None:
    take = synthesize(body_motion)
    half = len(body_motion) // 2
    changed = take.positions.copy()
    changed[half:] += np.float32(0.3)
    other = replace(take, positions=changed)
    for mode, same in (("causal", True), ("lookahead", False)):
        before, after = (solved(t, model, mode=mode).lower_positions[half - 6 : half] for t in (take, other))
        assert np.array_equal(before, after) == same, mode


def test_a_job_reports_growing_shares_and_can_be_stopped(body_motion: Motion, model: Model) -> None:
    job = perform(synthesize(body_motion), 1.6, STANDARD_PROPORTIONS, model, SolveOptions(candidates=2))
    events = [next(job), next(job)]
    job.close()
    assert all(isinstance(event, Progress) for event in events)
    assert 0 <= events[0].share <= events[1].share <= 1


def test_a_take_of_one_sample_gives_one_frame(body_motion: Motion, model: Model) -> None:
    take = synthesize(body_motion)
    single = replace(take, times=take.times[:1], positions=take.positions[:1], rotations=take.rotations[:1], tracked=take.tracked[:1], extras={})
    assert len(solved(single, model).times) == 1
