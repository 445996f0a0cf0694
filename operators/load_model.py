"""Choose the model that bakes."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..cbm_addon.errors import InputError
from ..cbm_addon.solve.models import DEFAULT_MODEL, describe, load_model


class CBM_OT_load_model(bpy.types.Operator):
    bl_idname = "cbm.load_model"
    bl_label = "Load Model"
    bl_description = "Choose a model folder and check that it fits; without a folder, the shipped model"
    bl_options = {"REGISTER", "UNDO"}

    directory: bpy.props.StringProperty(name="Folder", description="The model folder, which holds card.json", subtype="DIR_PATH", options={"SKIP_SAVE"})

    def invoke(self, context: bpy.types.Context, event: bpy.types.Event) -> set[str]:
        context.window_manager.fileselect_add(self)
        return {"RUNNING_MODAL"}

    def execute(self, context: bpy.types.Context) -> set[str]:
        folder = Path(bpy.path.abspath(self.directory)) if self.directory else DEFAULT_MODEL
        try:
            model = load_model(folder)
        except InputError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        settings = context.scene.cbm
        settings.model, settings.model_summary = self.directory, describe(model.card)
        self.report({"INFO"}, settings.model_summary)
        return {"FINISHED"}
