"""A take and its mirror image: the solver has no favourite side."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

import numpy as np

from cbm_addon.features import STANDARD_PROPORTIONS
from cbm_addon.motion.mirror import mirror
from cbm_addon.motion.motion import Motion
from cbm_addon.progress import run
from cbm_addon.solve.mirroring import mirror_performance, mirror_take
from cbm_addon.solve.models import load_model
from cbm_addon.solve.perform import SolveOptions, perform
from cbm_addon.takes.synthesize import synthesize


def test_the_take_of_the_mirrored_motion_is_the_mirrored_take(body_motion: Motion) -> None:
    ours, theirs = mirror_take(synthesize(body_motion)), synthesize(mirror(body_motion))
    np.testing.assert_allclose(ours.positions, theirs.positions, atol=1e-5)
    np.testing.assert_allclose(np.abs(np.sum(ours.rotations * theirs.rotations, axis=-1)), 1, atol=1e-5)


def test_mirroring_twice_changes_nothing(body_motion: Motion, small_model_folder: Path) -> None:
    take = synthesize(body_motion)
    performance = run(perform(take, 1.6, STANDARD_PROPORTIONS, load_model(small_model_folder), SolveOptions()))
    twice = mirror_performance(mirror_performance(performance))
    for field in fields(performance):
        np.testing.assert_array_equal(getattr(twice, field.name), getattr(performance, field.name))
    np.testing.assert_array_equal(mirror_take(mirror_take(take)).positions, take.positions)


def test_a_mirrored_take_gives_the_mirrored_performance(body_motion: Motion, small_model_folder: Path) -> None:
    take, model = synthesize(body_motion), load_model(small_model_folder)
    for mode in ("lookahead", "causal"):
        solved, mirrored = (run(perform(source, 1.6, STANDARD_PROPORTIONS, model, SolveOptions(mode))) for source in (take, mirror_take(take)))
        np.testing.assert_allclose(mirror_performance(mirrored).lower_positions, solved.lower_positions, atol=1e-4)
        np.testing.assert_allclose(mirror_performance(mirrored).contacts, solved.contacts, atol=1e-4)
