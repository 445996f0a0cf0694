"""Move the body of a rig out of what it pierces."""

from __future__ import annotations

import bpy

from ..cbm_addon.progress import Job
from ..cbm_addon.scene.body import BodyReport, clear_body
from ..cbm_addon.scene.modal import ModalJob
from .properties import chosen_armature


class CBM_OT_clear_body(bpy.types.Operator, ModalJob):
    bl_idname = "cbm.clear_body"
    bl_label = "Clear Body"
    bl_description = (
        "Move the body out of what it pierces, head and wrists with their trackers and planted feet where they are, as an action of its own above all "
        "other animation; Esc cancels and changes nothing"
    )
    bl_options = {"UNDO"}

    rig: bpy.props.StringProperty(name="Rig", description="Name of the armature; the panel's or the active one if empty", options={"SKIP_SAVE"})

    def job(self, context: bpy.types.Context) -> Job[BodyReport]:
        """Body avoidance with the scene's settings; InputError before it begins if the rig is missing."""
        settings = context.scene.cbm
        return clear_body(context, chosen_armature(context, self.rig), settings.fingers.body_options(settings.table()))

    def finish(self, context: bpy.types.Context, result: BodyReport) -> None:
        context.scene.cbm.fingers.body_summary = result.summary
        self.report({"INFO"}, result.summary)
