"""From rows to a take: axes, unit and sides are measured, dirt is repaired or left out, and everything is reported."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cbm_addon.errors import InputError
from cbm_addon.motion.rotations import continuous, difference, matrix_from_quat, quat_from_matrix
from cbm_addon.takes.frames import AXES, METRES, to_engine
from cbm_addon.takes.recording import Recording, TakeOverrides, take_from
from cbm_addon.takes.sample_motion import sample_take
from cbm_addon.takes.take import HEAD, LEFT, RIGHT, Take

FILE = Path("recording.csv")
SAMPLE = sample_take()


def recorded(axes: str = "openxr", unit: str = "cm") -> Recording:
    """The sample take as a file in other axes and another unit would hold it."""
    c = AXES[axes]
    rotations = continuous(quat_from_matrix(c.T @ matrix_from_quat(SAMPLE.rotations.astype(np.float64)) @ c))
    return Recording("test", SAMPLE.times + 7.0, SAMPLE.positions @ c / METRES[unit], rotations)


def read(recording: Recording, overrides: TakeOverrides = TakeOverrides()) -> Take:  # noqa: B008
    return take_from(recording, FILE, overrides)


def defects(take: Take) -> dict[str, int]:
    return {defect.kind: defect.count for defect in take.report.defects}


def assert_same(take: Take, truth: Take = SAMPLE) -> None:
    np.testing.assert_allclose(take.times, truth.times, atol=1e-9)
    np.testing.assert_allclose(take.positions, truth.positions, atol=1e-5)
    assert np.degrees(np.nanmax(difference(take.rotations, truth.rotations))) < 0.05


@pytest.mark.parametrize("axes", AXES)
def test_axes_are_proper_or_mirrored_frames_that_keep_up_and_forward(axes):
    c = AXES[axes]
    np.testing.assert_allclose(c @ c.T, np.eye(3))
    assert np.linalg.det(c) == pytest.approx(-1 if axes in ("unity", "unreal") else 1)
    forward = {"engine": (0, -1, 0), "openxr": (0, 0, -1), "unity": (0, 0, 1), "unreal": (1, 0, 0)}[axes]
    up = (0, 0, 1) if axes in ("engine", "unreal") else (0, 1, 0)
    right = {"engine": (-1, 0, 0), "openxr": (1, 0, 0), "unity": (1, 0, 0), "unreal": (0, 1, 0)}[axes]
    np.testing.assert_allclose(c @ [forward, up, right][0], (0, -1, 0))
    np.testing.assert_allclose(c @ up, (0, 0, 1))
    np.testing.assert_allclose(c @ right, (-1, 0, 0))


@pytest.mark.parametrize("axes", AXES)
def test_conversion_keeps_what_a_device_points_at(axes):
    """A point fixed to a device lands at the same place whether it is converted before or after it is turned."""
    rng = np.random.default_rng(1)
    c = AXES[axes]
    quaternion, point = rng.normal(size=(20, 4)), rng.normal(size=(20, 3))
    quaternion /= np.linalg.norm(quaternion, axis=-1, keepdims=True)
    turned = np.einsum("tij,tj->ti", matrix_from_quat(quaternion), point)
    converted, rotation = to_engine(point, quaternion, axes)
    np.testing.assert_allclose(np.einsum("tij,tj->ti", matrix_from_quat(rotation), converted), turned @ c.T, atol=1e-12)


@pytest.mark.parametrize("unit", METRES)
@pytest.mark.parametrize("axes", ["openxr", "unity"])
def test_axes_and_unit_are_measured(axes, unit):
    take = read(recorded(axes, unit))
    assert_same(take)
    assert take.report.constants["axes"].value == axes
    assert take.report.constants["axes"].source == "measured"
    assert take.report.constants["axes"].confidence > 0.5
    assert take.report.constants["unit"].value == unit
    assert defects(take) == {}


def test_axes_and_unit_can_be_given():
    take = read(recorded("unreal", "cm"), TakeOverrides(unit="cm", axes="unreal"))
    assert_same(take)
    assert {take.report.constants[name].source for name in ("axes", "unit")} == {"given"}


def test_what_the_format_says_is_doubted_aloud():
    take = read(replace(recorded("unity"), axes="openxr"))
    assert "axes_unlikely" in defects(take)


def test_no_human_unit_is_refused_and_can_be_given():
    recording = recorded(unit="m")
    tripled = replace(recording, positions=recording.positions * 3)
    with pytest.raises(InputError, match="--unit"):
        read(tripled)
    take = read(tripled, TakeOverrides(unit="m"))
    np.testing.assert_allclose(take.positions[:, HEAD], SAMPLE.positions[:, HEAD] * 3, atol=1e-5)


def test_exchanged_hands_are_put_right_unless_forbidden():
    recording = recorded()
    exchanged = replace(recording, positions=recording.positions[:, [0, 2, 1]], rotations=recording.rotations[:, [0, 2, 1]])
    take = read(exchanged)
    assert_same(take)
    assert "hands_swapped" in defects(take)
    kept = read(exchanged, TakeOverrides(swap_hands=False))
    np.testing.assert_allclose(kept.positions[:, LEFT], SAMPLE.positions[:, RIGHT], atol=1e-5)


def test_repeated_and_backward_times_are_left_out():
    recording = recorded()
    times = recording.times.copy()
    times[10] = times[11]
    times[20] = times[5]
    take = read(replace(recording, times=times))
    assert len(take) == len(SAMPLE) - 2
    assert (np.diff(take.times) > 0).all()
    kept = np.delete(np.arange(len(SAMPLE)), [10, 20])
    np.testing.assert_allclose(take.positions, SAMPLE.positions[kept], atol=1e-5)
    assert defects(take) == {"duplicate_time": 1, "backward_time": 1}


def test_rows_without_a_time_are_left_out():
    recording = recorded()
    times = recording.times.copy()
    times[100:103] = np.nan
    take = read(replace(recording, times=times))
    assert len(take) == len(SAMPLE) - 3
    assert defects(take) == {"no_time": 3}
    with pytest.raises(InputError, match="0 usable samples"):
        read(replace(recording, times=times * np.nan))


def test_times_that_mostly_run_backward_are_refused():
    recording = recorded()
    with pytest.raises(InputError, match="run backward"):
        read(replace(recording, times=recording.times[::-1]))


def test_rows_without_a_head_at_the_ends_are_left_out():
    """First rows with a zero quaternion are common in real files."""
    recording = recorded()
    recording.rotations[:3] = 0
    recording.positions[-2:, HEAD] = np.nan
    take = read(recording)
    assert len(take) == len(SAMPLE) - 5
    assert take.times[0] == 0
    assert defects(take) == {"zero_quaternion": 9, "no_head_at_ends": 5}


def test_a_lost_hand_is_not_tracked_and_nan():
    recording = recorded()
    recording.positions[100:150, LEFT] = np.nan
    recording.rotations[120:130, RIGHT] = 0
    take = read(recording)
    assert (~take.tracked).sum(axis=0).tolist() == [0, 50, 10]
    assert (np.isnan(take.positions).all(-1) == ~take.tracked).all()
    assert (np.isnan(take.rotations).all(-1) == ~take.tracked).all()
    assert defects(take) == {"zero_quaternion": 10, "left_lost": 50, "right_lost": 10}


def test_a_hand_out_of_human_reach_is_not_tracked():
    recording = recorded(unit="m")
    recording.positions[200:210, LEFT] += 5
    take = read(recording)
    assert not take.tracked[200:210, LEFT].any()
    assert take.tracked.sum() == take.tracked.size - 10
    assert defects(take)["out_of_reach"] == 10


def test_sign_flips_and_lengths_of_quaternions_are_repaired():
    recording = recorded()
    recording.rotations[50:, LEFT] *= -1
    recording.rotations[:, RIGHT] *= 2
    take = read(recording)
    assert_same(take)
    assert (np.sum(take.rotations[1:] * take.rotations[:-1], axis=-1) > 0).all()
    assert defects(take) == {"sign_flip": 1, "quaternion_length": len(SAMPLE)}


def test_odd_rates_gaps_and_jumps_are_reported_not_changed():
    recording = recorded()
    fast = read(replace(recording, times=recording.times / 3))
    assert "implausible_rate" in defects(fast)
    gapped = read(replace(recording, times=recording.times + 155 * (np.arange(len(SAMPLE)) > 700)))
    assert defects(gapped) == {"gap": 1}
    recording.positions[300, LEFT, 0] += 60
    assert defects(read(recording))["hand_jump"] == 2


def test_an_origin_at_eye_level_is_reported():
    recording = recorded(unit="m")
    recording.positions[..., 1] -= 1.6
    assert "origin_off_floor" in defects(read(recording))


def test_no_head_at_all_is_refused():
    recording = recorded()
    recording.positions[:, HEAD] = np.nan
    with pytest.raises(InputError, match="headset is tracked in no row"):
        read(recording)


def test_a_headset_alone_is_a_take():
    recording = recorded()
    recording.positions[:, 1:] = np.nan
    take = read(recording)
    np.testing.assert_allclose(take.positions[:, HEAD], SAMPLE.positions[:, HEAD], atol=1e-5)
    assert take.tracked.all(axis=0).tolist() == [True, False, False]
    assert take.report.constants["axes"].value == "openxr"


def test_a_take_refuses_arrays_that_do_not_fit():
    with pytest.raises(ValueError, match="cannot have"):
        replace(SAMPLE, positions=SAMPLE.positions[1:])
    with pytest.raises(ValueError, match="must increase"):
        replace(SAMPLE, times=np.zeros(len(SAMPLE)))
