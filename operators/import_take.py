"""Import a three-point recording."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy_extras.io_utils import ImportHelper

from ..cbm_addon.errors import InputError
from ..cbm_addon.scene.takes import tracker_empties
from ..cbm_addon.takes.calibrate import calibrate
from ..cbm_addon.takes.describe import take_lines
from ..cbm_addon.takes.readers import read_take


def load_take(context: bpy.types.Context, path: Path) -> list[str]:
    """Reads and calibrates a take with the scene's settings, shows its trackers and remembers what was found. Returns the findings."""
    settings = context.scene.cbm
    take = read_take(path, settings.overrides())
    calibrated = calibrate(take, settings.calibration())
    tracker_empties(context, calibrated.take)
    lines = list(take_lines(take, calibrated.calibration))
    settings.take, settings.take_summary = str(path), "\n".join(lines)
    return lines


def report_lines(operator: bpy.types.Operator, lines: list[str]) -> None:
    for line in lines:
        operator.report({"WARNING" if line.startswith("!") else "INFO"}, line.removeprefix("! "))


class CBM_OT_import_take(bpy.types.Operator, ImportHelper):
    bl_idname = "cbm.import_take"
    bl_label = "Import Take"
    bl_description = "Load a recording of a headset and two controllers, measure what it is, and show its trackers"
    bl_options = {"REGISTER", "UNDO"}

    filter_glob: bpy.props.StringProperty(default="*.csv;*.bsor;*.txt", options={"HIDDEN"})

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            lines = load_take(context, Path(bpy.path.abspath(self.filepath)))
        except InputError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        report_lines(self, lines)
        return {"FINISHED"}
