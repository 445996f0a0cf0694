"""Brekel OpenVR Recorder text, on files that the test writes as the recorder does: sections, tabs, an empty line after each section."""

from __future__ import annotations

import numpy as np
import pytest

from cbm_addon.errors import InputError
from cbm_addon.motion.rotations import difference, euler_from_quat, matrix_from_quat, quat_from_matrix
from cbm_addon.takes.frames import AXES
from cbm_addon.takes.readers import read_take
from cbm_addon.takes.recording import TakeOverrides
from cbm_addon.takes.sample_motion import sample_take

SAMPLE = sample_take()
C = AXES["openxr"]
BUTTONS = ["System", "ApplicationMenu", "Grip", "DPad_Left", "DPad_Up", "DPad_Right", "DPad_Down", "A", "ProximitySensor"]
BUTTONS += [f"Axis{i}" for i in range(5)] + [f"axis{i}_{part}" for i in range(5) for part in "XY"]


def rows(number: int, device: int, rotation: str, buttons: bool, times=SAMPLE.times) -> list[str]:
    """One device of the sample take as OpenVR has it: metres, Y up, looking along -Z."""
    places = SAMPLE.positions[:, device].astype(np.float64) @ C
    turns = quat_from_matrix(C.T @ matrix_from_quat(SAMPLE.rotations[:, device].astype(np.float64)) @ C)
    if rotation == "quaternion":
        turned = turns[:, [1, 2, 3, 0]]
    else:
        angles = np.degrees(euler_from_quat(turns, rotation))
        turned = angles[:, [rotation.index(axis) for axis in "XYZ"]]
    tail = ["0"] * len(BUTTONS) if buttons else []
    return [
        "\t".join([str(number), f"{time + 12.5:.5f}", "", *map("{:.6f}".format, (*place, *turn)), *tail])
        for time, place, turn in zip(times, places, turned, strict=True)
    ]


def text(rotation: str = "ZYX", controllers: tuple[tuple[int, int], ...] = ((3, 1), (4, 2)), headset: bool = True) -> str:
    """`controllers` are (their number, which device of the take they are)."""
    columns = ["deviceID", "timestamp", "", "posX", "posY", "posZ", "rotX", "rotY", "rotZ"] + (["rotW"] if rotation == "quaternion" else [])
    lines = ["Brekel OpenVR Recorder", "Recording start\tyear:\t2026", "Recording start\tmillisecond:\t12", ""]
    if headset:
        lines += [" Head Mounted Display(s)", "\t".join(columns), *rows(0, 0, rotation, False), ""]
    if controllers:
        tracks = [rows(number, device, rotation, True) for number, device in controllers]
        lines += [" Controllers", "\t".join([*columns, *BUTTONS]), *(line for lines in zip(*tracks, strict=True) for line in lines), ""]
    lines += [" Generic Trackers", "\t".join(columns), *rows(7, 0, rotation, False)[:10], ""]
    return "\n".join(lines) + "\n"


@pytest.fixture
def path(tmp_path):
    return tmp_path / "recording.txt"


def assert_same(take) -> None:
    np.testing.assert_allclose(take.times, SAMPLE.times, atol=2e-5)
    np.testing.assert_allclose(take.positions, SAMPLE.positions, atol=1e-5)
    assert np.degrees(difference(take.rotations, SAMPLE.rotations).max()) < 0.05


@pytest.mark.parametrize("rotation", ["ZYX", "quaternion"])
def test_devices_become_a_take(path, rotation):
    path.write_text(text(rotation))
    take = read_take(path)
    assert_same(take)
    assert take.kind == "device"
    assert take.report.constants["axes"].value == "openxr"
    assert take.report.constants["rotation_order"].source == "assumed"


def test_another_order_of_angles_can_be_given(path):
    path.write_text(text("YXZ"))
    take = read_take(path, TakeOverrides(rotation_order="YXZ"))
    assert_same(take)
    assert take.report.constants["rotation_order"].source == "given"


def test_which_controller_is_which_hand_is_measured(path):
    path.write_text(text(controllers=((3, 2), (4, 1))))
    take = read_take(path)
    assert_same(take)
    assert take.report.constants["swap_hands"].value


def test_a_headset_alone_and_a_third_controller(path):
    path.write_text(text(controllers=()))
    assert read_take(path).tracked.all(axis=0).tolist() == [True, False, False]
    path.write_text(text(controllers=((3, 1), (4, 2), (5, 1))))
    take = read_take(path)
    assert_same(take)
    assert [(defect.kind, defect.count) for defect in take.report.defects] == [("device_unused", 1)]


def test_controllers_with_times_of_their_own_are_brought_to_the_headset_s(path):
    lines = text().splitlines()
    shifted = [line.replace("\t", "\t", 1) for line in lines]
    for i, line in enumerate(shifted):
        if line.startswith("3\t"):
            number, time, rest = line.split("\t", 2)
            shifted[i] = f"{number}\t{float(time) + 0.004:.5f}\t{rest}"
    path.write_text("\n".join(shifted) + "\n")
    take = read_take(path)
    assert take.tracked[1:, 1].all()
    speed = np.linalg.norm(np.diff(SAMPLE.positions[:, 1], axis=0), axis=-1).max() * SAMPLE.rate
    assert np.nanmax(np.linalg.norm(take.positions[:, 1] - SAMPLE.positions[:, 1], axis=-1)) < 1.5 * 0.004 * speed


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda text: text.replace("\trotY", ""), "no column rotY"),
        (lambda text: text.replace("12.51389\t", "\t"), "fields, its header has 8"),
        (lambda text: text.replace("12.51389", "soon"), "not a number"),
    ],
)
def test_bad_files_are_refused(path, change, message):
    path.write_text(change(text(controllers=())))
    with pytest.raises(InputError, match=message):
        read_take(path)


def test_without_a_headset_it_is_no_take(path):
    path.write_text(text(headset=False))
    with pytest.raises(InputError, match="at least the head"):
        read_take(path)
