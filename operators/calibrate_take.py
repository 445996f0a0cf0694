"""Calibrate the take of the scene."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..cbm_addon.errors import InputError
from .import_take import load_take, report_lines
from .properties import CALIBRATION_NAMES, CalibrationProperties, changing_many


class CBM_OT_calibrate_take(bpy.types.Operator, CalibrationProperties):
    bl_idname = "cbm.calibrate_take"
    bl_label = "Calibrate Take"
    bl_description = "Correct what was measured of the take: units, axes, floor, eye height, controllers"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: bpy.types.Context) -> bool:
        return bool(context.scene.cbm.take)

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        for name in CALIBRATION_NAMES:
            setattr(self, name, getattr(context.scene.cbm, name))
        return context.window_manager.invoke_props_dialog(self)

    def execute(self, context: bpy.types.Context) -> set[str]:
        settings = context.scene.cbm
        before = {name: _value(settings, name) for name in CALIBRATION_NAMES}
        with changing_many():
            for name in CALIBRATION_NAMES:
                if self.properties.is_property_set(name):
                    setattr(settings, name, getattr(self, name))
            try:
                lines = load_take(context, Path(settings.take))
            except InputError as error:
                for name, value in before.items():
                    setattr(settings, name, value)
                self.report({"ERROR"}, str(error))
                return {"CANCELLED"}
        report_lines(self, lines)
        return {"FINISHED"}


def _value(settings: bpy.types.PropertyGroup, name: str) -> object:
    """What a setting is now; of vectors Blender gives a view that would change with them."""
    value = getattr(settings, name)
    return tuple(value) if name.endswith("_offset") else value
