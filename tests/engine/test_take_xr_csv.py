"""CSV files of XR research: columns are found by name, in whichever dialect."""

from __future__ import annotations

import numpy as np
import pytest

from cbm_addon.errors import InputError
from cbm_addon.motion.rotations import continuous, difference, matrix_from_quat, quat_from_matrix
from cbm_addon.takes.frames import AXES
from cbm_addon.takes.readers import read_take
from cbm_addon.takes.sample_motion import sample_take
from cbm_addon.takes.xr_csv import ASSUMED_RATE

SAMPLE = sample_take()
KINEMATIC_MAZE = ("head", "left_hand", "right_hand")
WHO_IS_ALYX = ("hmd", "left_controller", "right_controller")


def columns(prefixes=KINEMATIC_MAZE, rotation="xyzw") -> dict[str, np.ndarray]:
    """The sample take in OpenXR axes and centimetres, by column name."""
    c = AXES["openxr"]
    positions = SAMPLE.positions @ c * 100
    rotations = continuous(quat_from_matrix(c.T @ matrix_from_quat(SAMPLE.rotations.astype(np.float64)) @ c))
    table = {}
    for device, prefix in enumerate(prefixes):
        table |= {f"{prefix}_pos_{axis}": positions[:, device, i] for i, axis in enumerate("xyz")}
        table |= {f"{prefix}_rot_{axis}": rotations[:, device, "wxyz".index(axis)] for axis in rotation}
    return table


def write(path, table: dict[str, np.ndarray]) -> None:
    rows = zip(*table.values(), strict=True)
    path.write_text("\n".join([",".join(table), *(",".join("" if np.isnan(value) else repr(float(value)) for value in row) for row in rows)]) + "\n")


@pytest.fixture
def path(tmp_path):
    return tmp_path / "data.csv"


MILLISECONDS = SAMPLE.times * 1000


@pytest.mark.parametrize(
    "table",
    [
        {"delta_time_ms": MILLISECONDS} | columns(),
        columns(rotation="wxyz") | {"delta_time_s": SAMPLE.times},
        {"": np.arange(len(SAMPLE)), "delta_time_ms": MILLISECONDS} | columns(),
        {"timestamp": 1.6e12 + MILLISECONDS} | columns(WHO_IS_ALYX, rotation="wxyz"),
        {"timestamp": SAMPLE.times} | columns(WHO_IS_ALYX),
    ],
    ids=["maze", "w first, time last", "index column", "alyx, milliseconds of an epoch", "seconds"],
)
def test_dialects_give_the_same_take(path, table):
    write(path, table)
    take = read_take(path)
    np.testing.assert_allclose(take.times, SAMPLE.times, atol=1e-3 if "timestamp" in table else 1e-9)
    np.testing.assert_allclose(take.positions, SAMPLE.positions, atol=1e-5)
    assert np.degrees(difference(take.rotations, SAMPLE.rotations).max()) < 0.05
    assert take.report.defects == ()


def test_without_a_time_column_a_rate_is_assumed_and_said(path):
    write(path, columns())
    take = read_take(path)
    assert take.rate == pytest.approx(ASSUMED_RATE)
    assert take.report.constants["time"].source == "assumed"


def test_empty_fields_are_lost_samples(path):
    table = {"delta_time_ms": MILLISECONDS} | columns()
    table["left_hand_pos_x"] = np.where(SAMPLE.times < 1, np.nan, table["left_hand_pos_x"])
    write(path, table)
    np.testing.assert_array_equal(read_take(path).tracked[:, 1], SAMPLE.times >= 1)


def test_a_headset_alone(path):
    write(path, {"delta_time_ms": MILLISECONDS} | {name: values for name, values in columns().items() if name.startswith("head")})
    assert read_take(path).tracked.all(axis=0).tolist() == [True, False, False]


@pytest.mark.parametrize("missing", ["head_rot_w", "left_hand_pos_x", "right_hand_rot_z"])
def test_a_missing_column_is_named(path, missing):
    table = columns()
    del table[missing]
    write(path, table)
    with pytest.raises(InputError, match=f"no column {missing}"):
        read_take(path)


def test_hands_without_a_head_are_refused(path):
    write(path, {name: values for name, values in columns().items() if not name.startswith("head")})
    with pytest.raises(InputError, match="head"):
        read_take(path)
