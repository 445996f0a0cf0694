"""BVH of trackers, on files that the test writes from the description of the format: a root with a joint for each device."""

from __future__ import annotations

import numpy as np
import pytest

from cbm_addon.cli import main
from cbm_addon.errors import InputError
from cbm_addon.motion.bvh import write_bvh
from cbm_addon.motion.rotations import difference, euler_from_quat, matrix_from_quat, quat_from_matrix
from cbm_addon.takes.frames import AXES
from cbm_addon.takes.readers import read_take
from cbm_addon.takes.recording import TakeOverrides
from cbm_addon.takes.sample_motion import sample_motion, sample_take

SAMPLE = sample_take()
DEVICES = ("HMD", "MotionControllerLeft", "MotionControllerRight")
CHANNELS = "CHANNELS 6 Xposition Yposition Zposition Yrotation Xrotation Zrotation"


def text(axes: str = "openxr", units: float = 100.0, names=DEVICES) -> str:
    """The sample take's first 600 samples as joints below a root that does not move."""
    c = AXES[axes]
    places = SAMPLE.positions[:600].astype(np.float64) @ c * units
    turns = quat_from_matrix(c.T @ matrix_from_quat(SAMPLE.rotations[:600].astype(np.float64)) @ c)
    values = np.concatenate((places, np.degrees(euler_from_quat(turns, "YXZ"))), axis=-1)
    joints = [f"  JOINT {name}\n  {{\n    OFFSET 0 0 0\n    {CHANNELS}\n    End Site\n    {{\n      OFFSET 0 0 0\n    }}\n  }}" for name in names]
    hierarchy = ["HIERARCHY", "ROOT Stage", "{", "  OFFSET 0 0 0", "  CHANNELS 3 Zrotation Xrotation Yrotation", *joints, "}"]
    frames = [" ".join(["0 0 0", *map("{:.6f}".format, row.ravel())]) for row in values]
    return "\n".join([*hierarchy, "MOTION", f"Frames: {len(frames)}", f"Frame Time: {1 / 72:.8f}", *frames]) + "\n"


@pytest.fixture
def path(tmp_path):
    return tmp_path / "trackers.bvh"


@pytest.mark.parametrize(("axes", "units"), [("openxr", 100.0), ("unity", 1.0), ("engine", 1.0)])
def test_joints_become_a_take_in_whatever_axes_and_unit(path, axes, units):
    path.write_text(text(axes, units))
    take = read_take(path)
    assert take.report.constants["axes"].value == axes
    np.testing.assert_allclose(take.times, SAMPLE.times[:600], atol=1e-6)
    np.testing.assert_allclose(take.positions, SAMPLE.positions[:600], atol=2e-4)
    assert np.degrees(difference(take.rotations, SAMPLE.rotations[:600]).max()) < 0.05
    assert take.report.constants["trackers"].value == ", ".join(DEVICES)


def test_joints_of_any_name_can_be_named(path):
    path.write_text(text(names=("A", "B", "C")))
    with pytest.raises(InputError, match="--head"):
        read_take(path)
    take = read_take(path, TakeOverrides(head="A", left="B", right="C"))
    np.testing.assert_allclose(take.positions, SAMPLE.positions[:600], atol=2e-4)


def test_a_body_is_mocap_and_no_take_unless_trackers_are_named(tmp_path, capsys):
    write_bvh(tmp_path / "body.bvh", sample_motion())
    with pytest.raises(InputError, match="motion capture of a body"):
        read_take(tmp_path / "body.bvh")
    assert main(["info", str(tmp_path / "body.bvh")]) == 0
    assert "BVH: 2592 frames" in capsys.readouterr().out
    assert main(["info", str(tmp_path / "body.bvh"), "--head", "Head", "--left", "LeftHand", "--right", "RightHand", "--device", "none"]) == 0
    assert "BVH of trackers" in capsys.readouterr().out


def test_info_and_convert_take_trackers_for_a_take(path, tmp_path, capsys):
    path.write_text(text())
    assert main(["info", str(path)]) == 0
    assert "BVH of trackers, device poses: 600 samples" in capsys.readouterr().out
    assert main(["convert", str(path), str(tmp_path / "take.csv")]) == 0
    np.testing.assert_allclose(read_take(tmp_path / "take.csv").positions, SAMPLE.positions[:600], atol=2e-4)


def test_a_file_that_is_cut_off_is_refused(path):
    path.write_text(text()[:300])
    with pytest.raises(InputError, match="truncated"):
        read_take(path)
