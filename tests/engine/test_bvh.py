"""BVH files: every dialect is read as the same motion, defects are named in one line, and what is written reads back as it was."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from pathlib import Path

import bvhio
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cbm_addon.errors import InputError
from cbm_addon.motion.bvh import AXES, read_bvh, read_bvh_file, write_bvh
from cbm_addon.motion.motion import Motion
from cbm_addon.motion.rotations import difference, normalize, quat_from_rotvec, rotate
from cbm_addon.motion.skeleton import STANDARD_BODY

WALKER = """\
HIERARCHY
ROOT Hips
{
  OFFSET 0.0 90.0 0.0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Chest
  {
    OFFSET 0.0 25.0 0.0
    CHANNELS 3 Yrotation Xrotation Zrotation
    JOINT Head
    {
      OFFSET 0.0 35.0 2.0
      CHANNELS 3 Zrotation Xrotation Yrotation
      End Site
      {
        OFFSET 0.0 20.0 0.0
      }
    }
  }
  JOINT LeftLeg
  {
    OFFSET 10.0 0.0 0.0
    CHANNELS 3 Zrotation Xrotation Yrotation
    JOINT LeftFoot
    {
      OFFSET 0.0 -85.0 0.0
      CHANNELS 3 Zrotation Xrotation Yrotation
      End Site
      {
        OFFSET 0.0 -5.0 15.0
      }
    }
  }
}
MOTION
Frames: 3
Frame Time: 0.0333333
1.5 91.0 -3.0 10.0 20.0 30.0 1.0 2.0 3.0 -4.0 5.0 -6.0 7.0 -8.0 9.0 0.5 0.25 -0.125
2.5 92.0 -2.0 11.0 21.0 31.0 1.5 2.5 3.5 -4.5 5.5 -6.5 7.5 -8.5 9.5 0.5 0.25 -0.125
3.5 93.0 -1.0 12.0 22.0 32.0 2.0 3.0 4.0 -5.0 6.0 -7.0 8.0 -9.0 10.0 0.5 0.25 -0.125
"""


@pytest.fixture
def file(tmp_path: Path) -> Callable[[str], Path]:
    """Writes a file's bytes as they are."""

    def write(text: str, name: str = "clip.bvh") -> Path:
        path = tmp_path / name
        path.write_bytes(text.encode())
        return path

    return write


def in_numbers(change: Callable[[float], str]) -> Callable[[str], str]:
    return lambda text: re.sub(r"-?\d+\.\d+", lambda match: change(float(match[0])), text)


def assert_same_motion(a: Motion, b: Motion, metres: float = 1e-6, radians: float = 1e-3) -> None:
    assert a.skeleton.names == b.skeleton.names
    assert np.array_equal(a.skeleton.parents, b.skeleton.parents)
    assert np.allclose(a.skeleton.offsets, b.skeleton.offsets, atol=metres)
    assert np.allclose(a.skeleton.tips, b.skeleton.tips, atol=metres, equal_nan=True)
    assert np.allclose(a.times, b.times, atol=1e-6)
    assert np.allclose(a.root, b.root, atol=metres)
    assert difference(a.rotations, b.rotations).max() < radians
    assert np.allclose(a.positions(), b.positions(), atol=metres)


# Dialects


@pytest.mark.parametrize(
    "dialect",
    [
        pytest.param(lambda text: text.replace("\n", "\r\n"), id="Windows line ends"),
        pytest.param(lambda text: text.replace("\n", "\r"), id="old Macintosh line ends"),
        pytest.param(lambda text: text.replace("  ", "\t").replace(": ", ":\t"), id="tabs"),
        pytest.param(lambda text: text.replace("\n", " \t \n"), id="trailing blanks"),
        pytest.param(lambda text: text + "\n\n  \n", id="blank lines at the end"),
        pytest.param(lambda text: text.rstrip(), id="no line end at the end"),
        pytest.param(lambda text: "\ufeff" + text, id="byte order mark"),
        pytest.param(lambda text: re.sub(r"\n +\{", " {", text), id="braces on the line of the joint"),
        pytest.param(lambda text: text.replace("position", "Position").replace("rotation", "ROTATION"), id="case of the channels"),
        pytest.param(lambda text: text.replace("End Site", "End site"), id="case of the end site"),
        pytest.param(in_numbers(lambda x: f"{x:.6e}"), id="scientific notation"),
        pytest.param(in_numbers(lambda x: re.sub(r"e([+-])", r"e\g<1>0", f"{x:e}")), id="exponents of three digits"),
        pytest.param(in_numbers(lambda x: f"{x:g}".replace("0.", ".")), id="no zero before the point"),
        pytest.param(in_numbers(lambda x: f"{x:+.7f}"), id="plus signs"),
    ],
)
def test_every_dialect_is_the_same_motion(file, dialect):
    assert_same_motion(read_bvh(file(dialect(WALKER))), read_bvh(file(WALKER, "plain.bvh")))


def test_numbers_mean_what_they_say(file):
    found = read_bvh_file(file(WALKER))
    motion = found.motion
    assert motion.skeleton.names == ("Hips", "Chest", "Head", "LeftLeg", "LeftFoot")
    assert motion.skeleton.parents.tolist() == [-1, 0, 1, 0, 3]
    assert np.allclose(motion.skeleton.offsets[2], [0, -0.02, 0.35])  # Y up to Z up, centimetres to metres, the face to -Y
    assert np.allclose(motion.skeleton.tips[4], [0, -0.15, -0.05])
    assert np.isnan(motion.skeleton.tips[1]).all()
    assert np.allclose(motion.root[1], [0.025, 0.02, 0.92])  # a position replaces the offset
    assert motion.offsets is None
    assert (found.channels, found.frames_declared, found.frame_time) == (18, 3, 0.0333333)
    assert (found.unit, found.up_axis, found.rotation_orders, found.warnings) == ("cm", "Y", ("ZXY", "YXZ"), ())


def test_a_rotation_about_the_vertical_axis_of_the_file_is_one_about_z(file):
    only_turned = WALKER.split("Frame Time")[0].replace("Frames: 3", "Frames: 1") + "Frame Time: 0.01\n" + "0 0 0 0 0 90 " + "0 " * 12
    motion = read_bvh(file(only_turned))
    assert np.allclose(rotate(motion.rotations[0, 0], np.array([0, -1.0, 0])), [1, 0, 0], atol=1e-6)  # from facing -Y to the left, +X


@pytest.mark.parametrize(
    ("written", "rate"),
    [
        ("0.0333333", 30), ("0.033333", 30), ("3.33333e-002", 30), ("0.033367", 30 / 1.001), (".0083333", 120), ("0.00833333", 120),
        ("0.016667", 60), ("0.0416667", 24), ("0.0417083", 24 / 1.001), ("0.04", 25), ("0.025", 40), ("0.01", 100), ("0.0123", 1 / 0.0123),
    ],
)  # fmt: skip
def test_a_rounded_frame_time_stands_for_the_usual_rate(file, written, rate):
    motion = read_bvh(file(WALKER.replace("0.0333333", written)))
    assert np.allclose(np.diff(motion.times), 1 / rate, rtol=1e-12)


@pytest.mark.parametrize("declared", ["2", "5", "0", "many"])
def test_a_wrong_frame_count_is_a_warning_and_every_frame_is_read(file, declared):
    found = read_bvh_file(file(WALKER.replace("Frames: 3", f"Frames: {declared}")))
    assert len(found.motion) == 3
    assert len(found.warnings) == 1
    assert "3" in found.warnings[0]


def test_joints_of_the_same_name_become_different_with_a_warning(file):
    found = read_bvh_file(file(WALKER.replace("LeftLeg", "Chest")))
    assert found.motion.skeleton.names == ("Hips", "Chest", "Head", "Chest_2", "LeftFoot")
    assert any("Chest_2" in warning for warning in found.warnings)


def test_names_may_hold_blanks_and_colons(file):
    names = read_bvh(file(WALKER.replace("LeftLeg", "mixamorig:Left Leg"))).skeleton.names
    assert names[3] == "mixamorig:Left Leg"


def test_joints_may_come_without_end_sites_and_without_channels(file):
    text = re.sub(r"End Site\s+\{[^}]*\}", "", WALKER).replace("CHANNELS 3 Yrotation Xrotation Zrotation", "CHANNELS 0")
    text = re.sub(r"(?m)^((?:\S+ ){6})\S+ \S+ \S+ ", r"\1", text)
    motion = read_bvh(file(text))
    assert np.isnan(motion.skeleton.tips).all()
    assert difference(motion.rotations[:, 1], np.array([1, 0, 0, 0])).max() == 0


def test_a_joint_that_moves_in_its_parent_has_animated_offsets(file):
    """Of a position, only the axes that have a channel replace the offset."""
    text = WALKER.replace("CHANNELS 3 Yrotation Xrotation Zrotation", "CHANNELS 4 Yrotation Xrotation Yposition Zrotation")
    text = re.sub(r"(?m)^((?:\S+ ){8})", r"\g<1>30.0 ", text)
    found = read_bvh_file(file(text))
    assert found.moving_joints == ("Chest",)
    assert found.motion.offsets is not None
    assert np.allclose(found.motion.offsets[:, 1], [0, 0, 0.30])
    assert np.allclose(found.motion.skeleton.offsets[1], [0, 0, 0.25])
    plain = read_bvh(file(WALKER, "plain.bvh"))
    lift = found.motion.positions()[:, 1] - plain.positions()[:, 1]
    assert np.allclose(lift, rotate(plain.rotations[:, 0], np.array([0, 0, 0.05], dtype=np.float32)), atol=1e-6)


def test_a_joint_with_position_channels_that_repeat_its_offset_does_not_move(file):
    text = WALKER.replace("CHANNELS 3 Yrotation Xrotation Zrotation", "CHANNELS 6 Xposition Yposition Zposition Yrotation Xrotation Zrotation")
    text = re.sub(r"(?m)^((?:\S+ ){6})", r"\g<1>1e-7 25.0 0.0 ", text)
    found = read_bvh_file(file(text))
    assert found.moving_joints == ()
    assert found.motion.offsets is None
    assert_same_motion(found.motion, read_bvh(file(WALKER, "plain.bvh")))


@pytest.mark.parametrize(("unit", "metres"), [("m", 1), ("cm", 0.01), ("mm", 0.001), ("inch", 0.0254), ("cmu", 0.056444)])
def test_the_unit_is_guessed_from_the_size_of_the_body_and_explained(file, unit, metres):
    def rescale(match: re.Match[str]) -> str:
        return match[1] + " ".join(f"{float(x) * 0.01 / metres:.6f}" for x in match[2].split())

    text = re.sub(r"(OFFSET )(\S+ \S+ \S+)", rescale, WALKER)
    text = re.sub(r"(?m)^()(\S+ 9\S+ \S+)", rescale, text)  # the root's positions
    found = read_bvh_file(file(text))
    assert found.unit == unit
    assert np.isclose(found.unit_to_metres, metres, rtol=1e-4)
    assert unit in found.unit_reason
    assert_same_motion(found.motion, read_bvh(file(WALKER, "plain.bvh")), metres=1e-4)


def test_an_upright_body_with_z_up_is_kept_as_it_stands(file):
    offsets = {"0.0 90.0 0.0": "0.0 0.0 90.0", "0.0 25.0 0.0": "0.0 0.0 25.0", "0.0 35.0 2.0": "0.0 -2.0 35.0", "0.0 20.0 0.0": "0.0 0.0 20.0"}
    offsets |= {"0.0 -85.0 0.0": "0.0 0.0 -85.0", "0.0 -5.0 15.0": "0.0 -15.0 -5.0"}
    text = WALKER.split("Frames:")[0]
    for y_up, z_up in offsets.items():
        text = text.replace(f"OFFSET {y_up}\n", f"OFFSET {z_up}\n")
    found = read_bvh_file(file(text + "Frames: 1\nFrame Time: 0.01\n1 2 90 " + "0 " * 15))
    assert found.up_axis == "Z"
    assert np.allclose(found.motion.root, [[0.01, 0.02, 0.9]])
    assert np.allclose(found.motion.skeleton.offsets, read_bvh(file(WALKER, "plain.bvh")).skeleton.offsets)


# Defects


@pytest.mark.parametrize(
    ("broken", "complaint"),
    [
        (lambda text: "", "not a BVH file"),
        (lambda text: "time,head_px\n0,1\n", "not a BVH file"),
        (lambda text: text[:300], "truncated"),
        (lambda text: text.split("MOTION")[0], "truncated"),
        (lambda text: text.replace("}\nMOTION", "MOTION"), "Hips is still open"),
        (lambda text: text.replace("OFFSET 0.0 25.0 0.0", ""), "Chest has no OFFSET"),
        (lambda text: text.replace("0.0 25.0 0.0", "0.0 high 0.0"), "OFFSET 0.0 high 0.0"),
        (lambda text: text.replace("0.0 25.0 0.0", "0.0 nan 0.0"), "OFFSET 0.0 nan 0.0"),
        (lambda text: text.replace("CHANNELS 3 Y", "CHANNELS 4 Y"), "'joint' is not a channel"),
        (lambda text: text.replace("JOINT LeftLeg", "BONE LeftLeg"), "'BONE' is not expected"),
        (lambda text: text.replace("JOINT LeftLeg", "ROOT LeftLeg"), "LeftLeg is out of place"),
        (lambda text: re.sub(r"CHANNELS.*", "CHANNELS 0", text), "no channels"),
        (lambda text: text.replace("Frame Time: 0.0333333\n", ""), "Frame Time"),
        (lambda text: text.replace("0.0333333", "0"), "above 0"),
        (lambda text: text.replace("0.0333333", "-0.01"), "above 0"),
        (lambda text: text.replace("0.0333333", "nan"), "above 0"),
        (lambda text: text.replace("0.0333333", "soon"), "'soon'"),
        (lambda text: text[: text.index("1.5 91.0")], "no frames"),
        (lambda text: text.replace(" -2.0 11.0", " 11.0"), "line 39: 17 values; the channels of the hierarchy ask for 18"),
        (lambda text: text.replace(" -2.0 11.0", " -2.0 -2.0 11.0"), "line 39: 19 values"),
        (lambda text: text[:-40], "line 40"),
        (lambda text: text.replace("92.0", "nan"), "line 39: a value is not finite"),
        (lambda text: text.replace("92.0", "1e99"), "line 39: a value is not finite or far too large"),
        (lambda text: text.replace("92.0", "92,0"), "line 39: '92,0' is not a number"),
        (lambda text: text.replace("92.0 -2.0", "92.0.-2.0"), "line 39: '92.0.-2.0'"),
        (lambda text: text.replace("-0.125\n2.5", "-0.125 oops\n2.5"), "line 38: 'oops'"),
    ],
)
def test_a_defect_is_one_line_that_names_the_file_and_what_is_wrong(file, broken, complaint):
    path = file(broken(WALKER))
    with warnings.catch_warnings(), pytest.raises(InputError) as error:
        warnings.simplefilter("error")  # no warning of a library may reach the user
        read_bvh(path)
    assert str(error.value).startswith(f"{path}: ")
    assert complaint in str(error.value)
    assert "\n" not in str(error.value)


def test_a_missing_file_is_an_input_error(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        read_bvh(tmp_path / "missing.bvh")


# Writing


def random_motion(seed: int, frames: int = 12) -> Motion:
    """The standard body, every joint turned every way; the hips stand upright enough to tell up from down."""
    random = np.random.default_rng(seed)
    rotations = normalize(random.normal(size=(frames, len(STANDARD_BODY), 4))).astype(np.float32)
    upright = [STANDARD_BODY.index(name) for name in (*STANDARD_BODY.names[:6], "LeftUpLeg", "RightUpLeg", "LeftLeg", "RightLeg")]
    rotations[:, upright] = quat_from_rotvec(random.normal(0, 0.15, (frames, len(upright), 3)).astype(np.float32))
    root = random.normal(0, 3, (frames, 3)).astype(np.float32)
    return Motion(STANDARD_BODY, np.arange(frames) / 30, root, rotations)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_what_is_written_reads_back(tmp_path, seed):
    motion = random_motion(seed)
    write_bvh(tmp_path / "clip.bvh", motion)
    assert_same_motion(read_bvh(tmp_path / "clip.bvh"), motion, metres=1e-4, radians=np.radians(0.05))


def test_joints_that_move_in_their_parent_are_written_and_read(tmp_path):
    motion = random_motion(1)
    offsets = np.repeat(STANDARD_BODY.offsets[None], len(motion), axis=0)
    offsets[:, 4] += np.linspace(0, 0.1, len(motion), dtype=np.float32)[:, None]
    offsets[:, 9] += 0.02
    moving = Motion(motion.skeleton, motion.times, motion.root, motion.rotations, offsets)
    write_bvh(tmp_path / "clip.bvh", moving)
    found = read_bvh_file(tmp_path / "clip.bvh")
    assert found.moving_joints == ("Neck", "LeftHand")
    assert_same_motion(found.motion, moving, metres=1e-4)


@pytest.mark.parametrize("pitch", [-90, 90])
def test_gimbal_lock_is_written_and_read(tmp_path, pitch):
    """In the order ZXY the angle about X is the middle one."""
    motion = random_motion(2)
    motion.rotations[:, 8] = quat_from_rotvec(np.array([np.radians(pitch), 0, 0], dtype=np.float32))
    write_bvh(tmp_path / "clip.bvh", motion)
    assert_same_motion(read_bvh(tmp_path / "clip.bvh"), motion, metres=1e-4, radians=np.radians(0.05))


def test_files_are_y_up_in_centimetres_with_the_root_at_its_world_position(tmp_path):
    motion = random_motion(3)
    write_bvh(tmp_path / "clip.bvh", motion)
    text = (tmp_path / "clip.bvh").read_text()
    first = np.array(text.split("Frame Time: 0.03333333\n")[1].split("\n")[0].split(), dtype=float)
    x, y, z = motion.root[0] * 100
    assert np.allclose(first[:3], [x, z, -y], atol=1e-3)
    assert text.count("CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation") == 1
    assert text.count("CHANNELS 3 Zrotation Xrotation Yrotation") == len(STANDARD_BODY) - 1
    assert text.count("End Site") == np.isfinite(STANDARD_BODY.tips).all(axis=1).sum()


def test_written_angles_never_jump(tmp_path):
    frames = 400
    motion = random_motion(4, frames)
    steps = np.arange(frames, dtype=np.float32)[:, None]
    motion.rotations[:] = quat_from_rotvec(steps * np.array([0.01, 0.05, 0.03], dtype=np.float32))[:, None]
    write_bvh(tmp_path / "clip.bvh", motion)
    rows = (tmp_path / "clip.bvh").read_text().split("Frame Time: 0.03333333\n")[1]
    angles = np.array([line.split() for line in rows.splitlines()], dtype=float)[:, 3:]
    assert np.abs(np.diff(angles, axis=0)).max() < 90


def test_uneven_times_become_even(tmp_path):
    motion = random_motion(5, 30)
    uneven = Motion(motion.skeleton, motion.times * np.linspace(0.9, 1.1, 30), motion.root, motion.rotations)
    write_bvh(tmp_path / "clip.bvh", uneven)
    found = read_bvh(tmp_path / "clip.bvh")
    assert np.allclose(np.diff(found.times), 1 / uneven.rate, rtol=1e-3)
    assert abs(found.seconds - uneven.seconds) < 1 / uneven.rate


# The independent oracle


def oracle_positions(path: Path, frames: list[int]) -> tuple[list[str], np.ndarray]:
    """World positions [T, J, 3] in the file's own axes and unit, by the package bvhio."""
    root = bvhio.readAsHierarchy(str(path))
    names = [joint.Name for joint, _, _ in root.layout()]
    positions = []
    for frame in frames:
        root.loadPose(frame)
        positions.append([list(joint.PositionWorld) for joint, _, _ in root.layout()])
    return names, np.array(positions)


def assert_oracle_agrees(path: Path, frames: list[int], oracle_path: Path, oracle_frames: list[int]) -> None:
    found = read_bvh_file(path)
    names, expected = oracle_positions(oracle_path, oracle_frames)
    assert names == list(found.motion.skeleton.names)
    positions = found.motion.positions()[frames]
    size = np.ptp(found.motion.skeleton.rest_positions(), axis=0).max()
    assert np.abs(positions - expected @ AXES[found.up_axis].T * found.unit_to_metres).max() < 1e-3 * size


def test_the_oracle_agrees_on_the_hand_written_file(file):
    path = file(WALKER)
    assert_oracle_agrees(path, [0, 1, 2], path, [0, 1, 2])


@pytest.mark.parametrize("orders", ["XYZ YZX ZXY", "ZYX YXZ XZY"])
def test_the_oracle_agrees_on_any_order_of_channels_and_on_joints_that_move(file, orders):
    """A chain whose joints all have six channels, each in another order, positions after rotations."""
    names = ("Hips", "Chest", "Head")
    random = np.random.default_rng(7)
    text = "HIERARCHY\n"
    for word, name, order in zip(("ROOT", "JOINT", "JOINT"), names, orders.split(), strict=True):
        channels = " ".join([f"{axis}rotation" for axis in order] + [f"{axis}position" for axis in "ZXY"])
        text += f"{word} {name}\n{{\nOFFSET 1.0 60.0 2.0\nCHANNELS 6 {channels}\n"
    text += "End Site\n{\nOFFSET 0.0 10.0 0.0\n}\n" + "}\n" * 3 + "MOTION\nFrames: 4\nFrame Time: 0.02\n"
    text += "\n".join(" ".join(f"{x:.4f}" for x in row) for row in random.uniform(-170, 170, (4, 18))) + "\n"
    path = file(text)
    assert_oracle_agrees(path, [0, 1, 2, 3], path, [0, 1, 2, 3])


def test_the_oracle_agrees_on_what_is_written(tmp_path):
    motion = random_motion(6)
    write_bvh(tmp_path / "clip.bvh", motion)
    assert_oracle_agrees(tmp_path / "clip.bvh", [0, 5, 11], tmp_path / "clip.bvh", [0, 5, 11])


def imported_files() -> list[str]:
    """The files to import, by name, so that each is a test of its own."""
    return [
        "animdraw__jesse_dance", "bandai__dataset-1_walk_normal_001", "bandai__dataset-2_wave-both-hands_active_001", "cmu_acrnn__10",
        "cmu_iclone__002_01", "jaanga__clenching", "pybvh__cmu_12_01_walk", "snu_interactive__tennis_KangTennisF19", "snu_tcr__s_005_3_1",
        "snu_tcr__t_pose_ue2", "snu_vsports__16_35_1", "snu_vsports__s_003_1_1", "snu_vsports__t_pose", "snu_ys2010__wd2_tt_serve",
        "upc__example_2",
    ]  # fmt: skip


@pytest.mark.needs_data
@pytest.mark.parametrize("name", imported_files())
def test_the_oracle_agrees_on_real_files(data_folder, tmp_path, name):
    """bvhio is slow: it gets a copy of the file with a handful of the frames."""
    path = data_folder / "mocap" / "import_tests" / f"{name}.bvh"
    lines = path.read_text(errors="replace").splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("Frame Time")) + 1
    rows = [line for line in lines[first:] if line.strip()]
    frames = sorted({0, 1 % len(rows), len(rows) // 3, len(rows) // 2, len(rows) - 1})
    thin = tmp_path / "thin.bvh"
    thin.write_text("\n".join([*lines[: first - 2], f"Frames: {len(frames)}", lines[first - 1], *(rows[i] for i in frames)]) + "\n")
    assert_oracle_agrees(path, frames, thin, list(range(len(frames))))


@pytest.mark.needs_data
def test_units_axes_and_counts_of_real_files(data_folder):
    found = {path.stem: read_bvh_file(path) for path in (data_folder / "mocap" / "import_tests").glob("*.bvh")}
    assert sorted(found) == sorted(imported_files())
    others = {"jaanga__clenching": "mm", "pybvh__cmu_12_01_walk": "cmu", "snu_ys2010__wd2_tt_serve": "inch", "upc__example_2": "m"}
    assert {name: file.unit for name, file in found.items()} == {name: others.get(name, "cm") for name in found}
    assert [name for name, file in found.items() if file.up_axis == "Z"] == ["upc__example_2"]
    assert [name for name, file in found.items() if file.warnings] == ["jaanga__clenching"]
    assert sorted(name for name, file in found.items() if file.moving_joints == ("Hips",)) == sorted(n for n in found if n.startswith("bandai"))


@pytest.mark.needs_data
def test_the_training_clips_stand_on_the_floor_in_metres(data_folder):
    clips = sorted((data_folder / "mocap" / "core").glob("*.bvh"))[::60]
    for clip in clips:
        found = read_bvh_file(clip)
        heights = found.motion.positions()[..., 2]
        assert (found.unit, found.up_axis) == ("cm", "Y")
        assert -0.1 < np.percentile(heights, 1) < 0.15
        assert 1.0 < np.percentile(heights, 99) < 2.3
