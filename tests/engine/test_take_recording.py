"""From rows to a take: axes, unit and sides are measured, dirt is repaired or left out, and everything is reported."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cbm_addon.errors import InputError
from cbm_addon.motion.rotations import continuous, difference, matrix_from_quat, multiply, quat_from_axis_angle, quat_from_matrix, quat_from_yaw, rotate
from cbm_addon.takes.frames import AXES, METRES, device_axes, to_engine
from cbm_addon.takes.recording import Recording, TakeOverrides, take_from
from cbm_addon.takes.sample_motion import sample_take
from cbm_addon.takes.take import HEAD, LEFT, RIGHT, Take

FILE = Path("recording.csv")
SAMPLE = sample_take()


def recorded(axes: str = "openxr", unit: str = "cm") -> Recording:
    """The sample take as a file in other axes and another unit would hold it."""
    c = AXES[axes]
    rotations = continuous(quat_from_matrix(c.T @ matrix_from_quat(SAMPLE.rotations.astype(np.float64)) @ device_axes(axes)))
    return Recording("test", SAMPLE.times + 7.0, SAMPLE.positions @ c / METRES[unit], rotations)


def read(recording: Recording, overrides: TakeOverrides = TakeOverrides()) -> Take:  # noqa: B008
    return take_from(recording, FILE, overrides)


def defects(take: Take) -> dict[str, int]:
    return {defect.kind: defect.count for defect in take.report.defects}


def assert_same(take: Take, truth: Take = SAMPLE) -> None:
    np.testing.assert_allclose(take.times, truth.times, atol=1e-9)
    np.testing.assert_allclose(take.positions, truth.positions, atol=1e-5)
    assert np.degrees(np.nanmax(difference(take.rotations, truth.rotations))) < 0.05


DEVICE_AXES = {  # where a device looks, up, and to its right, in its own frame
    "engine": ((0, -1, 0), (0, 0, 1), (-1, 0, 0)),
    "openxr": ((0, 0, -1), (0, 1, 0), (1, 0, 0)),
    "unity": ((0, 0, 1), (0, 1, 0), (1, 0, 0)),
    "unreal": ((1, 0, 0), (0, 0, 1), (0, 1, 0)),
    "zup": ((0, 1, 0), (0, 0, 1), (1, 0, 0)),
    "blender": ((0, 0, -1), (0, 1, 0), (1, 0, 0)),
    "fbx": ((0, 0, 1), (0, 1, 0), (-1, 0, 0)),
}


@pytest.mark.parametrize("axes", AXES)
def test_axes_are_proper_or_mirrored_frames_that_keep_up_and_forward(axes):
    world, device = AXES[axes], device_axes(axes)
    for matrix in (world, device):
        np.testing.assert_allclose(matrix @ matrix.T, np.eye(3))
        assert np.linalg.det(matrix) == pytest.approx(-1 if axes in ("unity", "unreal") else 1)
    forward, up, right = DEVICE_AXES[axes]
    np.testing.assert_allclose(device @ forward, (0, -1, 0))
    np.testing.assert_allclose(device @ up, (0, 0, 1))
    np.testing.assert_allclose(device @ right, (-1, 0, 0))
    np.testing.assert_allclose(world @ ((0, 1, 0) if axes in ("openxr", "unity") else (0, 0, 1)), (0, 0, 1))


@pytest.mark.parametrize("axes", AXES)
def test_conversion_keeps_what_a_device_points_at(axes):
    """A point fixed to a device lands at the same place whether it is converted before or after it is turned."""
    rng = np.random.default_rng(1)
    quaternion, point = rng.normal(size=(20, 4)), rng.normal(size=(20, 3))
    quaternion /= np.linalg.norm(quaternion, axis=-1, keepdims=True)
    turned = np.einsum("tij,tj->ti", matrix_from_quat(quaternion), point)
    converted, rotation = to_engine(turned, quaternion, axes)
    np.testing.assert_allclose(rotate(rotation, point @ device_axes(axes).T), converted, atol=1e-12)


IN_FILES, IN_BLENDER = ("openxr", "unity", "zup", "unreal", "engine"), ("blender", "fbx", "zup", "engine")


@pytest.mark.parametrize(("axes", "among"), [*((axes, IN_FILES) for axes in IN_FILES), *((axes, IN_BLENDER) for axes in IN_BLENDER)])
@pytest.mark.parametrize("unit", ["m", "cm"])
def test_axes_and_unit_are_measured(axes, among, unit):
    take = read(replace(recorded(axes, unit), likely_axes=among))
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


def test_axes_that_a_format_hardly_ever_has_are_told():
    assert defects(read(replace(recorded("openxr"), usual_axes="openxr"))) == {}
    take = read(replace(recorded("unity"), usual_axes="openxr"))
    assert_same(take)
    assert defects(take) == {"axes_unusual": len(SAMPLE)}


def exchanged_components(recording: Recording) -> Recording:
    """As if nodding were leaning: the quaternions' x and z exchanged."""
    return replace(recording, rotations=recording.rotations[..., [0, 3, 2, 1]])


def looking_down() -> Recording:
    """The sample with a head that looks down by 50° throughout."""
    recording = recorded()
    rotations = recording.rotations.copy()
    rotations[:, HEAD] = multiply(rotations[:, HEAD], quat_from_axis_angle(np.array([1.0, 0, 0]), np.radians(-50)))
    return replace(recording, rotations=rotations)


def test_a_head_that_leans_as_no_head_does_is_refused_unless_somebody_vouches_for_it():
    assert "head_tilted" not in defects(read(looking_down()))
    wrong = exchanged_components(looking_down())
    with pytest.raises(InputError, match="leans far to its side"):
        read(wrong)
    assert "head_tilted" in defects(read(wrong, TakeOverrides(axes="openxr")))
    assert "head_tilted" in defects(read(replace(wrong, axes="openxr")))


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


def test_odd_rates_and_gaps_are_reported_not_changed():
    recording = recorded()
    fast = read(replace(recording, times=recording.times / 3))
    assert "implausible_rate" in defects(fast)
    assert fast.rate == pytest.approx(3 * SAMPLE.rate)
    gapped = read(replace(recording, times=recording.times + 155 * (np.arange(len(SAMPLE)) > 700)))
    assert defects(gapped) == {"gap": 1}
    assert gapped.seconds == pytest.approx(SAMPLE.seconds + 155)


def test_a_given_rate_stretches_the_times():
    recording = recorded()
    take = read(replace(recording, times=recording.times / 3), TakeOverrides(rate=72))
    assert_same(take)
    assert take.report.constants["time"].source == "given"
    assert defects(take) == {}


def test_times_of_years_are_refused():
    recording = recorded()
    with pytest.raises(InputError, match="hours"):
        read(replace(recording, times=recording.times * 1e6))


def test_a_sample_that_jumps_away_and_back_is_not_tracked_unless_it_is_kept():
    recording = recorded()
    recording.positions[300, LEFT, 0] += 60
    take = read(recording)
    assert np.flatnonzero(~take.tracked[:, LEFT]).tolist() == [300]
    assert defects(take) == {"spike": 1, "left_lost": 1}
    kept = read(recording, TakeOverrides(keep_outliers=True))
    assert kept.tracked.all()
    assert defects(kept) == {"hand_jump": 2}


def recentred() -> Recording:
    """The sample in a tracking space that is moved by 2 m and turned by 90° in the middle."""
    recording = recorded()
    positions, rotations = to_engine(recording.positions, recording.rotations, "openxr")
    turn = quat_from_yaw(np.full((len(SAMPLE) - 1000, 1), np.pi / 2))
    positions[1000:] = rotate(turn, positions[1000:]) + [200, 0, 0]
    rotations[1000:] = multiply(turn, rotations[1000:])
    return replace(recording, positions=positions, rotations=continuous(rotations), axes="engine")


def test_a_jump_of_the_whole_tracking_space_is_told_and_joined_on_request():
    kept = read(recentred())
    assert defects(kept) == {"teleport": 1, "hand_jump": 3}
    joined = read(recentred(), TakeOverrides(join_teleports=True))
    assert defects(joined) == {"teleport": 1}
    moved = np.linalg.norm(joined.positions - SAMPLE.positions, axis=-1)
    assert moved.max() < 0.05, "it goes on where it was, but for the way of one sample"
    assert difference(joined.rotations, SAMPLE.rotations).max() < np.radians(3)


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
