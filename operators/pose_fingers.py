"""Pose the fingers of a rig so that they touch and do not pierce; the objects that stand for its body meanwhile; and what is worked with, shown."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..cbm_addon.errors import InputError
from ..cbm_addon.progress import Job
from ..cbm_addon.rigs.fingers import finger_bones, hands_with_fingers
from ..cbm_addon.scene.colliders import add_colliders
from ..cbm_addon.scene.fingers import FingerReport, pose_fingers
from ..cbm_addon.scene.modal import ModalJob, redraw
from ..cbm_addon.scene.overlay import Overlay
from ..cbm_addon.scene.rig import read_rig, require_editable
from ..cbm_addon.takes.readers import read_take
from .properties import chosen_armature


class CBM_OT_pose_fingers(bpy.types.Operator, ModalJob):
    bl_idname = "cbm.pose_fingers"
    bl_label = "Pose Fingers"
    bl_description = "Move the fingers of the rig out of what they pierce, as an action of their own above all other animation; Esc cancels and changes nothing"
    bl_options = {"UNDO"}

    rig: bpy.props.StringProperty(name="Rig", description="Name of the armature; the panel's or the active one if empty", options={"SKIP_SAVE"})

    def job(self, context: bpy.types.Context) -> Job[FingerReport]:
        """Finger posing with the scene's settings; InputError before it begins if the rig is missing."""
        settings = context.scene.cbm
        take = read_take(Path(settings.take), settings.overrides()) if settings.take and settings.fingers.buttons else None
        return pose_fingers(context, chosen_armature(context, self.rig), settings.fingers.options(settings.table(), take))

    def finish(self, context: bpy.types.Context, result: FingerReport) -> None:
        context.scene.cbm.fingers.summary = "\n".join(f"{side}: {hand.summary}" for side, hand in result.hands.items())
        for side, hand in result.hands.items():
            self.report({"INFO"}, f"{side} hand: {hand.summary}")
        self.report({"INFO"}, result.summary)


class CBM_OT_add_colliders(bpy.types.Operator):
    bl_idname = "cbm.add_colliders"
    bl_label = "Add Colliders"
    bl_description = "Add objects that stand for the body of the rig while fingers are posed, to edit or delete; without them they are fitted each time"
    bl_options = {"REGISTER", "UNDO"}

    rig: bpy.props.StringProperty(name="Rig", description="Name of the armature; the panel's or the active one if empty", options={"SKIP_SAVE"})

    def execute(self, context: bpy.types.Context) -> set[str]:
        try:
            armature = chosen_armature(context, self.rig)
            require_editable(armature)
            rig = read_rig(armature, context.scene.cbm.table())
            collection = add_colliders(context, armature, rig, [finger_bones(rig, side) for side in hands_with_fingers(rig)])
        except InputError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, f"{len(collection.objects)} colliders in the collection {collection.name}")
        return {"FINISHED"}


class CBM_OT_show_hands(bpy.types.Operator):
    bl_idname = "cbm.show_hands"
    bl_label = "Show Hands"
    bl_description = "Draw what finger posing works with: the capsules of hands and body, and the cells near the hands that something fills. Again to hide it"

    @classmethod
    def unregister(cls) -> None:
        Overlay.hide()

    def execute(self, context: bpy.types.Context) -> set[str]:
        if Overlay.shown is not None:
            Overlay.hide()
        else:
            try:
                Overlay.show(chosen_armature(context, ""), context.scene.cbm.fingers.obstacles, context.scene.cbm.table())
            except InputError as error:
                self.report({"ERROR"}, str(error))
                return {"CANCELLED"}
        redraw()
        return {"FINISHED"}
