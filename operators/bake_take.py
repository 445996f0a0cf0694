"""Bake the take of the scene onto a rig."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..cbm_addon.errors import InputError
from ..cbm_addon.progress import Job
from ..cbm_addon.scene.bake import BakeReport, bake_variations
from ..cbm_addon.scene.modal import ModalJob
from ..cbm_addon.scene.takes import scale_trackers
from ..cbm_addon.solve.models import load_model
from ..cbm_addon.takes.calibrate import calibrate
from .import_take import read_again
from .properties import chosen_armature


class CBM_OT_bake_take(bpy.types.Operator, ModalJob):
    bl_idname = "cbm.bake_take"
    bl_label = "Bake Take"
    bl_description = "Solve the take for the rig and write the body's animation as a new action; Esc cancels and changes nothing"
    bl_options = {"UNDO"}

    take: bpy.props.StringProperty(name="Take", description="The recording; the panel's if empty", subtype="FILE_PATH", options={"SKIP_SAVE"})
    rig: bpy.props.StringProperty(name="Rig", description="Name of the armature; the panel's or the active one if empty", options={"SKIP_SAVE"})
    variations: bpy.props.IntProperty(name="Variations", description="How many are baked; as many as the panel says if 0", min=0, max=16, options={"SKIP_SAVE"})

    _take_name = ""

    def job(self, context: bpy.types.Context) -> Job[list[BakeReport]]:
        """The bake with the scene's settings; InputError before it begins if take, rig or model are missing."""
        settings = context.scene.cbm
        path = bpy.path.abspath(self.take) if self.take else settings.take
        if not path:
            raise InputError("Take", "none is loaded; import a take first")
        take = read_again(Path(path), settings.overrides())
        self._take_name = take.name
        calibrated = calibrate(take, settings.calibration())
        model = load_model(settings.model_folder())
        count = self.variations or settings.variations
        return bake_variations(context, chosen_armature(context, self.rig), calibrated, model, settings.bake_options(), count)

    def finish(self, context: bpy.types.Context, result: list[BakeReport]) -> None:
        scale_trackers(context.scene, self._take_name, result[0].scale)
        for report in result:
            for device, error in report.tracker_errors.items():
                far = f"{error.share_within_1_cm:.0%} of frames, {error.max_cm:.1f} cm at most"
                self.report({"INFO"}, f"{report.action}: {device} within 1 cm of its tracker at {far}")
            if thinned := report.reduction:
                self.report({"INFO"}, f"{report.action}: {thinned.keys_before} keys thinned to {thinned.keys_after}")
            self.report({"INFO"}, f"{report.action}: {report.frames} frames at {report.fps:g} fps in {report.seconds:.1f} s")

        for warning in result[0].warnings:
            self.report({"WARNING"}, warning)
        scene, last = context.scene, context.scene.frame_start + result[0].frames - 1
        if last > scene.frame_end:
            self.report({"WARNING"}, f"the bake ends at frame {last}, and the scene plays to {scene.frame_end}")
