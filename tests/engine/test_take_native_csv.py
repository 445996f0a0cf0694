"""The native take CSV: what is written is read again, and bad files are refused with the line or column at fault."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cbm_addon.errors import InputError
from cbm_addon.motion.rotations import difference
from cbm_addon.takes import native_csv
from cbm_addon.takes.readers import read_take
from cbm_addon.takes.sample_motion import sample_motion, sample_take
from cbm_addon.takes.synthesize import synthesize
from cbm_addon.takes.take import LEFT, Take

POSE = "0,0,1.6,1,0,0,0,0.2,-0.3,1.2,1,0,0,0,-0.2,-0.3,1.2,1,0,0,0"
HEADER = "time," + ",".join(native_csv.COLUMNS)


@pytest.fixture
def path(tmp_path):
    return tmp_path / "take.csv"


def with_losses(take: Take) -> Take:
    tracked = take.tracked.copy()
    tracked[40:90, LEFT] = False
    hidden = np.where(tracked[..., None], 1, np.nan).astype(np.float32)
    return replace(take, positions=take.positions * hidden, rotations=take.rotations * hidden, tracked=tracked)


@pytest.mark.parametrize("take", [sample_take(), synthesize(sample_motion()), with_losses(sample_take())], ids=["device", "joint", "lost"])
def test_round_trip(path, take):
    extras = {"stick_x": np.linspace(-1, 1, len(take), dtype=np.float32), "grip_left": np.zeros(len(take), np.float32)}
    native_csv.write(path, replace(take, extras=extras))
    again = read_take(path)
    np.testing.assert_allclose(again.times, take.times, atol=1e-6)
    np.testing.assert_allclose(again.positions, take.positions, atol=1e-6)
    assert np.nanmax(difference(again.rotations, take.rotations)) < 1e-5
    np.testing.assert_array_equal(again.tracked, take.tracked)
    assert again.kind == take.kind
    assert again.extras.keys() == extras.keys()
    np.testing.assert_allclose(again.extras["stick_x"], extras["stick_x"], atol=1e-6)


def test_first_lines_are_the_contract(path):
    native_csv.write(path, synthesize(sample_motion(), head_only=True))
    magic, header, first = path.read_text().splitlines()[:3]
    assert magic == "# cbm-take 1 poses=joint"
    assert header == (
        "time,head_px,head_py,head_pz,head_qw,head_qx,head_qy,head_qz,left_px,left_py,left_pz,left_qw,left_qx,left_qy,left_qz,"
        "right_px,right_py,right_pz,right_qw,right_qx,right_qy,right_qz"
    )
    assert first.startswith("0.000000,")
    assert first.endswith("," * 14)


def test_controllers_are_remembered(path):
    native_csv.write(path, synthesize(sample_motion(), device="index"))
    assert path.read_text().startswith("# cbm-take 1 poses=device device=index\n")
    assert read_take(path).report.constants["device"].value == "index"


def test_windows_line_ends_byte_order_mark_and_column_order_do_not_matter(path):
    names, values = HEADER.split(","), ["0.5", *POSE.split(",")]
    rows = [",".join(names[::-1]), ",".join(values[::-1]), ",".join(["1.5", *values[1:]][::-1])]
    path.write_bytes(b"\xef\xbb\xbf" + "\r\n".join(["# cbm-take 1 poses=joint", *rows, ""]).encode())
    take = read_take(path)
    np.testing.assert_allclose(take.times, [0, 1])
    np.testing.assert_allclose(take.positions[0], [[0, 0, 1.6], [0.2, -0.3, 1.2], [-0.2, -0.3, 1.2]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("# cbm-take 2 poses=joint\n", "version 2"),
        ("# cbm-take\n", r"version \(none\)"),
        ("# cbm-take 1 poses=body\n", "poses=device or poses=joint"),
        ("# cbm-take 1\n", "poses=device or poses=joint"),
        ("# cbm-take 1 poses=device device=wand\n", "'wand'"),
        (f"# cbm-take 1 poses=joint\n{HEADER.replace(',left_qw', '')}\n{','.join('0' * 21)}\n", "no column left_qw"),
        (f"# cbm-take 1 poses=joint\n{HEADER}\n", "no rows"),
        (f"# cbm-take 1 poses=joint\n{HEADER}\n0,{POSE}\n1,{POSE[:-4]}\n", "line 4 has 20 fields, the header has 22"),
        (f"# cbm-take 1 poses=joint\n{HEADER}\n0,{POSE}\n1,{POSE[:-1]}x\n", "line 4: column 'right_qz' is not a number"),
        (f"# cbm-take 1 poses=joint\n{HEADER}\n0,{POSE}\n", "at least 2"),
        (f"# cbm-take 1 poses=joint\n{HEADER}\n0,{'9' * 200_000}\n", "line 3 is not CSV"),
    ],
)
def test_bad_files_are_refused(path, text, message):
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        read_take(path)


@pytest.mark.parametrize("content", [b"", b"a,b,c\n1,2,3\n", bytes(range(256))])
def test_what_is_no_take_is_refused(path, content):
    path.write_bytes(content)
    with pytest.raises(InputError, match="is empty|is not a take"):
        read_take(path)


def test_what_cannot_be_opened_is_refused(tmp_path):
    for path in (tmp_path / "absent.csv", tmp_path):
        with pytest.raises(InputError, match="cannot be read"):
            read_take(path)
