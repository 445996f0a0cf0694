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
    metarig.hide_set(True)
    rig = context.view_layer.objects.active
    rig.name = "Human"
    return rig


def rigify_metarig(context: bpy.types.Context) -> bpy.types.Object:
    """Adds Rigify's human metarig to the scene: a plain skeleton that needs no generated controls."""
    enabled, loaded = addon_utils.check("rigify")
    if not (enabled and loaded):
        addon_utils.enable("rigify", default_set=True)  # without its preferences entry Rigify cannot register
    if context.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    bpy.ops.object.armature_human_metarig_add()
    return context.view_layer.objects.active
