"""Blender's own evaluation of an animated armature: the oracle for everything that is keyed."""

from __future__ import annotations

import bpy
import numpy as np


def evaluated(armature: bpy.types.Object, bones: list[str], frames: int) -> np.ndarray:
    """World matrices [frames, B, 4, 4] of pose bones, from the dependency graph, at the scene's frames from 1 on."""
    matrices = []
    for frame in range(1, frames + 1):
        bpy.context.scene.frame_set(frame)
        posed = armature.evaluated_get(bpy.context.evaluated_depsgraph_get())
        matrices.append([np.array(posed.matrix_world @ posed.pose.bones[bone].matrix) for bone in bones])
    return np.array(matrices)
