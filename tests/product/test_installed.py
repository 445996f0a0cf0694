"""The installed extension, in processes that know nothing of the checkout."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from cbm_addon.motion.bvh import write_bvh
from cbm_addon.motion.motion import Motion
from cbm_addon.motion.rotations import quat_from_axis_angle
from cbm_addon.motion.skeleton import STANDARD_BODY

REPOSITORY = Path(__file__).resolve().parents[2]

BAKED_SECONDS = """
bpy.ops.wm.open_mainfile(filepath=sys.argv[1])
armature = next(obj for obj in bpy.data.objects if obj.type == "ARMATURE" and obj.animation_data and obj.animation_data.action)
first, last = armature.animation_data.action.frame_range
render = bpy.context.scene.render
answer = (last - first) / render.fps * render.fps_base
"""


def error_lines(stderr: str) -> list[str]:
    return [line for line in stderr.splitlines() if line.startswith("error: ")]


@pytest.fixture
def piece(tmp_path) -> Path:
    """The first three seconds of the shipped sample take."""
    (sample,) = (REPOSITORY / "cbm_addon" / "takes" / "sample").glob("*.csv")
    marker, header, *rows = sample.read_text(encoding="utf-8").splitlines()
    kept = [row for row in rows if float(next(csv.reader([row]))[0]) <= 3]
    path = tmp_path / "piece.csv"
    path.write_text("\n".join([marker, header, *kept]) + "\n", encoding="utf-8")
    return path


def a_step() -> Motion:
    """Half a second at 30 samples a second: the hips move on while the left leg swings."""
    share = np.linspace(0, 1, 16, dtype=np.float32)
    rotations = np.zeros((16, len(STANDARD_BODY), 4), dtype=np.float32)
    rotations[..., 0] = 1
    rotations[:, STANDARD_BODY.index("LeftUpLeg")] = quat_from_axis_angle(np.array([1, 0, 0], dtype=np.float32), -0.8 * share)
    root = np.stack([0 * share, -0.6 * share, np.full_like(share, 0.95)], axis=-1)
    return Motion(STANDARD_BODY, np.arange(16) / 30, root, rotations)


def test_it_registers_and_unregisters_without_a_trace(blender):
    """Operators, panel and settings of the contract come with the extension and go with it, more than once."""
    blender.script("""
operators = {"import_mocap", "import_take", "calibrate_take", "load_model", "train_model", "bake_take"}
operators |= {"pose_fingers", "clear_body", "add_colliders", "show_hands"}
for _ in range(2):
    assert set(dir(bpy.ops.cbm)) == operators, dir(bpy.ops.cbm)
    assert hasattr(bpy.types, "CBM_PT_sidebar") and hasattr(bpy.context.scene, "cbm")
    addon_utils.disable("bl_ext.user_default.cbm", default_set=True)
    assert dir(bpy.ops.cbm) == []
    assert not hasattr(bpy.types, "CBM_PT_sidebar") and not hasattr(bpy.context.scene, "cbm")
    addon_utils.enable("bl_ext.user_default.cbm", default_set=True)
""")


def test_onnxruntime_comes_out_of_the_zip(blender):
    place = blender.script("import onnxruntime; answer = onnxruntime.__file__")
    assert str(blender.user_resources) in place


def test_imported_motion_stands_where_the_file_says_whatever_the_scene_rate(blender, tmp_path):
    motion = a_step()
    write_bvh(tmp_path / "step.bvh", motion)
    heads = blender.script(
        """
scene = bpy.context.scene
scene.render.fps, scene.frame_start = 60, 1
assert bpy.ops.cbm.import_mocap("EXEC_DEFAULT", filepath=sys.argv[1]) == {"FINISHED"}
armature = bpy.context.active_object
answer = []
for sample in range(16):
    scene.frame_set(1 + 2 * sample)
    answer.append([list(armature.matrix_world @ armature.pose.bones[name].head) for name in ("Hips", "LeftFoot", "RightHand")])
""",
        tmp_path / "step.bvh",
    )
    expected = motion.positions()[:, STANDARD_BODY.indices(["Hips", "LeftFoot", "RightHand"])]
    np.testing.assert_allclose(heads, expected, atol=1e-4)


def test_shipped_models_are_found_and_sound(blender, tmp_path):
    done = blender.cbm("models", "--json", "models.json", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    models = json.loads((tmp_path / "models.json").read_text())["models"]
    assert [Path(model["folder"]).name for model in models] == ["base", "body", "hands"]
    assert all(str(blender.user_resources) in model["folder"] for model in models)


def test_bake_puts_the_sample_take_on_a_rigify_human(blender, piece, tmp_path):
    argv = ["bake", piece, "--preset", "rigify", "-o", "bake.blend", "--preview", "bake.png", "--json", "bake.json"]
    done = blender.cbm(*argv, folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["bake.blend", "bake.json", "bake.png", "piece.csv"]
    (bake,) = json.loads((tmp_path / "bake.json").read_text())["bakes"]
    assert {device: error["share_within_1_cm"] for device, error in bake["tracker_errors"].items()} == {"head": 1, "left": 1, "right": 1}
    assert blender.script(BAKED_SECONDS, tmp_path / "bake.blend") == pytest.approx(3, abs=0.05)


def test_bad_input_is_one_line_exit_code_2_and_nothing_written(blender, piece, tmp_path):
    rows = piece.read_text(encoding="utf-8").splitlines()
    piece.write_text("\n".join([rows[0], rows[1].replace("head_px", "head_x"), *rows[2:]]), encoding="utf-8")
    (tmp_path / "cut.bvh").write_text("HIERARCHY\nROOT Hips\n{\n  OFFSET 0 0 0\n", encoding="utf-8")
    before = sorted(tmp_path.iterdir())
    for argv in (
        ["nonsense"],
        ["bake", "absent.csv", "--preset", "rigify", "-o", "out.blend"],
        ["bake", piece, "--preset", "rigify", "-o", "out.blend"],
        ["bake", piece, "--preset", "nonsense", "-o", "out.blend"],
        ["fingers", "--blend", "absent.blend", "--rig", "Hero", "-o", "out.blend"],
        ["info", "cut.bvh"],
        ["solve", piece, "-o", "absent/out.bvh"],
    ):
        done = blender.cbm(*argv, folder=tmp_path)
        assert done.returncode == 2, done.stderr
        assert len(error_lines(done.stderr)) == 1, done.stderr
        assert "Traceback" not in done.stderr
        assert sorted(tmp_path.iterdir()) == before
