"""The panel in the sidebar of the 3D view: take, rig, model, bake. Drawing reads what the operators found and does no work."""

from __future__ import annotations

import re
import textwrap
from pathlib import PurePath

import bpy

from ..cbm_addon.scene.modal import ModalJob
from ..cbm_addon.scene.overlay import Overlay
from ..operators.bake_take import CBM_OT_bake_take
from ..operators.clear_body import CBM_OT_clear_body
from ..operators.import_mocap import CBM_OT_import_mocap
from ..operators.import_take import CBM_OT_import_take
from ..operators.load_model import CBM_OT_load_model
from ..operators.pose_fingers import CBM_OT_add_colliders, CBM_OT_pose_fingers, CBM_OT_show_hands
from ..operators.train_model import CBM_OT_train_model

FINDINGS_SHOWN = 8
WHY = re.compile(r" \((\w+).*\)$", re.MULTILINE)  # of a constant: whether it was measured, given or assumed, and more that has no room in a sidebar


class CBM_PT_sidebar(bpy.types.Panel):
    bl_label = "CBM"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "CBM"

    def draw(self, context: bpy.types.Context) -> None:
        settings = context.scene.cbm
        layout = self.layout
        if ModalJob.running:
            progress = ModalJob.running.progress
            layout.progress(factor=progress.share, text=progress.message)
            layout.label(text="Esc cancels")
        letters = _letters(context)
        self._take(layout.box(), settings, letters)
        self._rig(layout.box(), settings, letters)
        self._model(layout.box(), settings, letters)
        self._bake(layout.box(), settings)
        self._fingers(layout.box(), settings, letters)

    def _take(self, box: bpy.types.UILayout, settings: bpy.types.PropertyGroup, letters: int) -> None:
        box.label(text="1. Take", icon="REC")
        name = PurePath(settings.take).name if settings.take else "Choose a Recording"
        box.operator(CBM_OT_import_take.bl_idname, text=name, icon="FILEBROWSER")
        box.operator(CBM_OT_import_take.bl_idname, text="From Animated Objects", icon="OBJECT_DATA").source = "OBJECTS"
        if settings.take:
            _findings(box, WHY.sub(r" (\1)", settings.take_summary), letters)
            if _unfolded(box, settings, "show_calibration"):
                self._calibration(box.column(), settings)

    def _calibration(self, column: bpy.types.UILayout, settings: bpy.types.PropertyGroup) -> None:
        column.prop(settings, "eye_height", text="Eye Height" if settings.eye_height else "Eye Height (0: measured)")
        row = column.row(align=True)
        row.prop(settings, "measure_floor")
        if not settings.measure_floor:
            row.prop(settings, "floor")
        column.prop(settings, "seated")
        column.prop(settings, "device")
        column.prop(settings, "own_offsets")
        if settings.own_offsets:
            for name in ("head_offset", "wrist_offset"):
                column.column(align=True).prop(settings, name)
        for name in ("swap_hands", "axes", "unit"):
            column.prop(settings, name)
        column.prop(settings, "rotation_order", text="Angles")
        column.prop(settings, "rate", text="Rate" if settings.rate else "Rate (0: as recorded)")
        for name in ("keep_outliers", "join_teleports"):
            column.prop(settings, name)

    def _rig(self, box: bpy.types.UILayout, settings: bpy.types.PropertyGroup, letters: int) -> None:
        box.label(text="2. Rig", icon="ARMATURE_DATA")
        box.prop(settings, "rig", text="")
        if settings.rig:
            _findings(box, settings.rig_summary, letters)
            box.prop(settings, "map")
        box.operator(CBM_OT_import_mocap.bl_idname, icon="IMPORT")

    def _model(self, box: bpy.types.UILayout, settings: bpy.types.PropertyGroup, letters: int) -> None:
        box.label(text="3. Model", icon="NETWORK_DRIVE")
        column = box.column(align=True)
        column.scale_y = 0.8
        _label(column, settings.model_summary or "The shipped model", letters, "DOT")
        row = box.row(align=True)
        row.operator(CBM_OT_load_model.bl_idname, icon="FILE_FOLDER")
        row.operator(CBM_OT_train_model.bl_idname, icon="PREFERENCES")

    def _bake(self, box: bpy.types.UILayout, settings: bpy.types.PropertyGroup) -> None:
        box.label(text="4. Bake", icon="ACTION")
        column = box.column(align=True)
        column.prop(settings, "part")
        column.prop(settings, "root", text="Root")
        column.prop(settings, "limbs")
        column.prop(settings, "variations")
        if _unfolded(box, settings, "show_options"):
            column = box.column(align=True)
            column.prop(settings, "mode")
            column.prop(settings, "variation", text="First Variation")
            for name in ("candidates", "seed", "reduce"):
                column.prop(settings, name)
            if settings.reduce:
                for name in ("reduce_distance", "reduce_angle"):
                    column.prop(settings, name)
            for name in ("push_down", "fake_user"):
                column.prop(settings, name)
        row = box.row()
        row.scale_y = 1.5
        row.enabled = bool(settings.take and settings.rig)
        text = f"Bake {settings.variations} Variations" if settings.variations > 1 else CBM_OT_bake_take.bl_label
        row.operator(CBM_OT_bake_take.bl_idname, text=text, icon="PLAY")

    def _fingers(self, box: bpy.types.UILayout, settings: bpy.types.PropertyGroup, letters: int) -> None:
        fingers = settings.fingers
        box.label(text="5. Fingers and Body", icon="VIEW_PAN")
        column = box.column(align=True)
        column.row(align=True).prop(fingers, "hands", expand=True)
        column.prop(fingers, "obstacles")
        column.prop(fingers, "strength")
        row = column.row(align=True)
        row.prop(fingers, "use_range", text="Frames")
        for name in ("frame_start", "frame_end"):
            limit = row.row(align=True)
            limit.enabled = fingers.use_range
            limit.prop(fingers, name, text="")
        column = box.column(align=True)
        column.prop(fingers, "grasp")
        buttons = column.row()
        buttons.enabled = bool(settings.take)
        buttons.prop(fingers, "buttons")
        row = box.row(align=True)
        row.operator(CBM_OT_add_colliders.bl_idname, icon="MESH_CAPSULE")
        row.operator(CBM_OT_show_hands.bl_idname, icon="OVERLAY", depress=Overlay.shown is not None)
        row = box.row()
        row.scale_y = 1.5
        row.enabled = settings.rig is not None
        row.operator(CBM_OT_pose_fingers.bl_idname, icon="PLAY")
        if fingers.summary:
            _findings(box, fingers.summary, letters)
        row = box.row(align=True)
        row.enabled = settings.rig is not None
        row.prop(fingers, "hold")
        row.operator(CBM_OT_clear_body.bl_idname, icon="PLAY")
        if fingers.body_summary:
            _findings(box, fingers.body_summary, letters)


def _letters(context: bpy.types.Context) -> int:
    """About how many letters fit beside an icon, inside a box of the sidebar."""
    return max(20, int((context.region.width / context.preferences.system.ui_scale - 85) / 6.2))


def _unfolded(box: bpy.types.UILayout, settings: bpy.types.PropertyGroup, name: str) -> bool:
    """A line that unfolds what comes below it, and whether it has."""
    is_open = getattr(settings, name)
    row = box.row()
    row.alignment = "LEFT"
    row.prop(settings, name, icon="TRIA_DOWN" if is_open else "TRIA_RIGHT", emboss=False)
    return is_open


def _findings(box: bpy.types.UILayout, summary: str, letters: int) -> None:
    """The lines of a summary, those first that warn."""
    column = box.column(align=True)
    column.scale_y = 0.8
    lines = sorted(summary.split("\n"), key=lambda line: not line.startswith("!"))
    for line in lines[:FINDINGS_SHOWN]:
        _label(column, line.removeprefix("! "), letters, "ERROR" if line.startswith("!") else "DOT")


def _label(column: bpy.types.UILayout, text: str, letters: int, icon: str) -> None:
    """A label of as many lines as the text needs."""
    for line in textwrap.wrap(text, letters):
        column.label(text=line, icon=icon)
        icon = "BLANK1"
