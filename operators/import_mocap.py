"""Import motion capture."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy_extras.io_utils import ImportHelper

from ..cbm_addon.errors import InputError
from ..cbm_addon.scene.importers import import_mocap
from ..cbm_addon.scene.rig import find_armature
from .properties import RigProperties


class CBM_OT_import_mocap(bpy.types.Operator, ImportHelper, RigProperties):
    bl_idname = "cbm.import_mocap"
    bl_label = "Import Motion Capture"
    bl_description = "Put the motion of BVH, FBX or glTF files on an armature, each file as a new action in real time"
    bl_options = {"REGISTER", "UNDO"}

    filter_glob: bpy.props.StringProperty(default="*.bvh;*.fbx;*.glb;*.gltf", options={"HIDDEN"})
    directory: bpy.props.StringProperty(subtype="DIR_PATH", options={"HIDDEN", "SKIP_SAVE"})
    files: bpy.props.CollectionProperty(type=bpy.types.OperatorFileListElement, options={"HIDDEN", "SKIP_SAVE"})
    use_new_armature: bpy.props.BoolProperty(
        name="New Armature",
        description="Make an armature for each file. Otherwise an existing armature does what the files do, whatever its bones are called",
        default=True,
    )
    armature: bpy.props.StringProperty(
        name="Armature",
        description="The existing armature to key; the active one if this is empty and New Armature is off",
    )
    frame_start: bpy.props.IntProperty(name="Start Frame", description="Frame of the motion's first sample; the scene's start frame if not given")

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        self.frame_start = context.scene.frame_start
        return super().invoke(context, event)

    def execute(self, context: bpy.types.Context) -> set[str]:
        names = [file.name for file in self.files if file.name]
        folder = Path(bpy.path.abspath(self.directory))
        paths = [folder / name for name in names] or [Path(bpy.path.abspath(self.filepath))]
        start = self.frame_start if self.properties.is_property_set("frame_start") else context.scene.frame_start
        try:
            results = import_mocap(context, paths, self._target(context), start, self.table(), self.root, self.limbs)
        except InputError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        for result in results:
            first, last = result.action.frame_range
            self.report({"INFO"}, f"{result.action.name}: frames {first:.0f} to {last:.0f} on {result.armature.name}")
            for note in result.notes:
                self.report({"INFO"}, f"{result.action.name}: {note}")
        return {"FINISHED"}

    def _target(self, context: bpy.types.Context) -> bpy.types.Object | None:
        if self.armature:
            return find_armature(self.armature)
        if self.use_new_armature:
            return None
        active = context.active_object
        if active is None or active.type != "ARMATURE":
            raise InputError("Armature", "none is active; select one, name one, or let New Armature make one")
        return active
