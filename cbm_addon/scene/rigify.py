"""Rigify: Blender's own human, as a target for takes that come without a character."""

from __future__ import annotations

import addon_utils
import bpy


def rigify_human(context: bpy.types.Context) -> bpy.types.Object:
    """Adds Rigify's human metarig to the scene, generates its rig and returns that; the metarig stays, hidden.

    Rigify is enabled if it is not.
    """
    metarig = rigify_metarig(context)
    bpy.ops.pose.rigify_generate()
    rig = context.view_layer.objects.active
    rig.name = "Human"
    metarig.hide_set(True)
    if bpy.app.background:
        _forget_rig_ui()
    return rig


def rigify_metarig(context: bpy.types.Context) -> bpy.types.Object:
    """Adds Rigify's human metarig to the scene: a plain skeleton without generated controls."""
    enabled, loaded = addon_utils.check("rigify")
    if not (enabled and loaded):
        addon_utils.enable("rigify", default_set=True)  # without its entry in the preferences Rigify cannot register
    if context.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    bpy.ops.object.armature_human_metarig_add()
    return context.view_layer.objects.active


def _forget_rig_ui() -> None:
    """Unregisters the panels and operators that the generated script registered; opening the saved file in a window registers them again.

    Nothing else ever unregisters them, and Blender 4.5 as a Python module hangs at its exit when such classes are left.
    """
    for base in (bpy.types.Panel, bpy.types.Operator, bpy.types.PropertyGroup):
        for cls in base.__subclasses__():
            if cls.__module__ == "builtins" and cls.is_registered:  # what a script that was run as text defines
                bpy.utils.unregister_class(cls)
