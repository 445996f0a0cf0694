"""The installed extension, in a process that knows nothing of the checkout."""

from __future__ import annotations


def test_it_registers_and_unregisters_without_a_trace(blender):
    blender.script("""
names = [cls.__name__ for cls in extension.registered]
assert names and all(hasattr(bpy.types, name) for name in names), names
addon_utils.disable("bl_ext.user_default.cbm", default_set=True)
assert not [name for name in names if hasattr(bpy.types, name)]
assert addon_utils.enable("bl_ext.user_default.cbm", default_set=True)
assert all(hasattr(bpy.types, name) for name in names)
""")


def test_onnxruntime_comes_out_of_the_zip(blender):
    place = blender.script("import onnxruntime; print(onnxruntime.__file__)")
    assert str(blender.user_resources) in place


def test_bad_usage_is_one_line_and_exit_code_2(blender, tmp_path):
    done = blender.cbm("nonsense", folder=tmp_path)
    assert done.returncode == 2
    assert [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert list(tmp_path.iterdir()) == []
