"""What the shipped model finds wrong with the calibration of a whole take, on a motion that the project's own code makes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cbm_addon.features import STANDARD_PROPORTIONS
from cbm_addon.motion.motion import Motion
from cbm_addon.motion.rotations import difference
from cbm_addon.progress import run
from cbm_addon.solve.miscalibration import NONE, Miscalibration, find_miscalibration
from cbm_addon.solve.models import load_model, read_card
from cbm_addon.solve.perform import SolveOptions, at_rate, calibration_warnings, perform
from cbm_addon.takes.calibrate import CalibrationOptions, calibrate
from cbm_addon.takes.devices import CONTROLLERS
from cbm_addon.takes.slip import Slip, mistaken
from cbm_addon.takes.synthesize import synthesize
from cbm_addon.takes.take import HANDS, Take


def found(take: Take, head_height: float) -> Miscalibration:
    return find_miscalibration(at_rate(take), head_height, load_model().networks("lookahead"))


@pytest.fixture(scope="module")
def head_height(body_motion: Motion) -> float:
    return body_motion.skeleton.height_above_toes("Head")


def test_a_take_that_is_calibrated_well_stays_what_it_is(body_motion: Motion, head_height: float) -> None:
    told = found(synthesize(body_motion), head_height)
    assert np.linalg.norm(told.slip.offset) < 0.03
    assert abs(told.height - 1) < 0.02
    assert told.warnings() == []


def test_controllers_of_another_kind_are_found(body_motion: Motion, head_height: float) -> None:
    true = mistaken(CONTROLLERS["index"], CONTROLLERS["quest2"])
    take = calibrate(synthesize(body_motion, device="index"), CalibrationOptions(device="quest2")).take
    told = found(take, head_height)
    assert np.linalg.norm(told.slip.offset - true.offset) < 0.5 * np.linalg.norm(true.offset)
    corrected, exact = told.corrected(take).positions, synthesize(body_motion).positions
    assert np.linalg.norm(corrected - exact, axis=-1)[:, HANDS].mean() < 0.5 * np.linalg.norm(take.positions - exact, axis=-1)[:, HANDS].mean()
    assert "from where the calibration puts them" in told.warnings()[0]


@pytest.mark.parametrize("believed", [0.9, 1.1])
def test_a_height_that_was_misjudged_is_found(body_motion: Motion, head_height: float, believed: float) -> None:
    told = found(synthesize(body_motion), believed * head_height)
    np.testing.assert_allclose(told.height * believed, 1, atol=0.04)
    assert "as tall as is believed" in told.warnings()[-1]


def test_who_is_low_throughout_is_not_taken_for_small(body_motion: Motion, head_height: float) -> None:
    assert found(synthesize(body_motion), 1.5 * head_height).height == 1


def test_of_hands_that_were_never_tracked_nothing_is_told(body_motion: Motion, head_height: float) -> None:
    take = calibrate(synthesize(body_motion, head_only=True)).take
    assert found(take, 0.9 * head_height) is NONE


def test_without_looking_ahead_nothing_is_told(body_motion: Motion, head_height: float) -> None:
    take = synthesize(body_motion)
    assert calibration_warnings(take, 0.9 * head_height, load_model(), SolveOptions("causal")) == []
    assert calibration_warnings(take, 0.9 * head_height, load_model(), SolveOptions("lookahead")) != []


def test_a_performance_keeps_the_units_of_the_height_that_was_believed(body_motion: Motion, head_height: float) -> None:
    take, model = synthesize(body_motion), load_model()
    right, wrong = (run(perform(take, share * head_height, STANDARD_PROPORTIONS, model, SolveOptions(candidates=4))) for share in (1, 1.1))
    np.testing.assert_allclose(wrong.head_height, 1.1 * head_height)
    metres = [performance.lower_positions * performance.head_height for performance in (right, wrong)]
    assert np.linalg.norm(metres[1] - metres[0], axis=-1).mean() < 0.06


def test_nothing_that_is_corrected_by_nothing_changes(body_motion: Motion) -> None:
    take = synthesize(body_motion)
    unchanged = replace(NONE, slip=Slip(NONE.slip.offset, NONE.slip.turn)).corrected(take)
    np.testing.assert_allclose(unchanged.positions, take.positions, atol=1e-6)
    assert difference(unchanged.rotations, take.rotations).max() < 1e-3


def test_training_measures_what_it_finds(small_model_folder: Path) -> None:
    told = read_card(small_model_folder)["modes"]["lookahead"]["miscalibration"]
    assert set(told) == {"off", "left"}
    assert all(len(values) == 3 and min(values) > 0 for values in told.values())
    assert load_model(small_model_folder).networks("lookahead").tells_miscalibration
