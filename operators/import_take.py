"""Import a three-point recording: from a file, or what objects of the scene do."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import bpy
from bpy_extras.io_utils import ImportHelper

from ..cbm_addon.errors import InputError
from ..cbm_addon.scene.take_files import BLENDER_FILES
from ..cbm_addon.scene.take_objects import objects_take
from ..cbm_addon.scene.takes import tracker_empties
from ..cbm_addon.takes import native_csv
from ..cbm_addon.takes.calibrate import calibrate
from ..cbm_addon.takes.describe import take_lines
from ..cbm_addon.takes.readers import read_take, register
from ..cbm_addon.takes.recording import TakeOverrides
from ..cbm_addon.takes.take import Take

EXTENSION = __name__.rsplit(".", 2)[0]
FOLDER = "takes"  # of the extension's own files

register(BLENDER_FILES)


def load_take(context: bpy.types.Context, path: Path) -> list[str]:
    """Reads and calibrates a take with the scene's settings, shows its trackers and remembers what was found. Returns the findings."""
    return _show(context, read_again(path, context.scene.cbm.overrides()), path)


def read_again(path: Path, overrides: TakeOverrides) -> Take:
    """Reads a take, or gives the one that was read last if that is what is asked for: while it is calibrated, only constants change."""
    written = path.stat().st_mtime_ns if path.is_file() else 0
    return _read(path, written, overrides)


@lru_cache(maxsize=1)
def _read(path: Path, written: int, overrides: TakeOverrides) -> Take:
    return read_take(path, overrides)


def load_objects(context: bpy.types.Context, head: str, left: str, right: str) -> list[str]:
    """The same with what objects or bones of the scene do: those named, or with "" those found by name.

    The take is kept among the extension's own files, so that it can be calibrated and baked whatever becomes of the objects.
    """
    name = Path(bpy.data.filepath).stem or context.scene.name
    overrides = replace(context.scene.cbm.overrides(), head=head or None, left=left or None, right=right or None)
    take = objects_take(context.scene, Path(name), overrides)
    path = Path(bpy.utils.extension_path_user(EXTENSION, path=FOLDER, create=True), f"{bpy.path.clean_name(name)}.csv")
    native_csv.write(path, take)
    return _show(context, take, path)


def _show(context: bpy.types.Context, take: Take, path: Path) -> list[str]:
    settings = context.scene.cbm
    calibrated = calibrate(take, settings.calibration())
    tracker_empties(context, calibrated.take)
    lines = list(take_lines(take, calibrated.calibration))
    settings.take, settings.take_summary = str(path), "\n".join(lines)
    settings.show_offsets(calibrated.calibration)
    return lines


def report_lines(operator: bpy.types.Operator, lines: list[str]) -> None:
    for line in lines:
        operator.report({"WARNING" if line.startswith("!") else "INFO"}, line.removeprefix("! "))


class CBM_OT_import_take(bpy.types.Operator, ImportHelper):
    bl_idname = "cbm.import_take"
    bl_label = "Import Take"
    bl_description = "Load a recording of a headset and two controllers, measure what it is, and show its trackers"
    bl_options = {"REGISTER", "UNDO"}

    filter_glob: bpy.props.StringProperty(default="*.csv;*.bsor;*.txt;*.bvh;*.fbx;*.glb;*.gltf;*.blend", options={"HIDDEN"})
    source: bpy.props.EnumProperty(
        name="Source",
        items=[("FILE", "File", "A recording in a file"), ("OBJECTS", "Animated Objects", "Objects or bones of this scene that were recorded or animated")],
        options={"SKIP_SAVE"},
    )
    head: bpy.props.StringProperty(name="Headset", description="The object or bone that is the headset; found by name if empty", options={"SKIP_SAVE"})
    left: bpy.props.StringProperty(name="Left", description="The object or bone that is the left controller; found by name if empty", options={"SKIP_SAVE"})
    right: bpy.props.StringProperty(name="Right", description="The object or bone that is the right controller; found by name if empty", options={"SKIP_SAVE"})

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        return context.window_manager.invoke_props_dialog(self) if self.source == "OBJECTS" else super().invoke(context, event)

    def draw(self, context: bpy.types.Context) -> None:
        if self.source == "OBJECTS":
            for name in ("head", "left", "right"):
                self.layout.prop_search(self, name, context.scene, "objects")

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            if self.source == "OBJECTS":
                lines = load_objects(context, self.head, self.left, self.right)
            else:
                lines = load_take(context, Path(bpy.path.abspath(self.filepath)))
        except InputError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        report_lines(self, lines)
        return {"FINISHED"}
