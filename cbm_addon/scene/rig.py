"""Armature objects as the engine's rigs."""

from __future__ import annotations

import bpy
import numpy as np

from ..errors import InputError
from ..rigs.recognize import recognize
from ..rigs.rig import Rig


def read_rig(armature: bpy.types.Object) -> Rig:
    """The rig of an armature object as it stands in the world now.

    Raises InputError if it is no armature, if its bones are not known, or if a transform of it cannot be animated exactly.
    """
    if armature.type != "ARMATURE":
        raise InputError(armature.name, f"is a {armature.type.lower()}; choose an armature")
    bpy.context.view_layer.update()
    bones = armature.data.bones
    names = tuple(bones.keys())
    place = {name: i for i, name in enumerate(names)}
    parents = np.array([place[bone.parent.name] if bone.parent else -1 for bone in bones])
    rig = Rig(
        name=armature.name,
        bones=names,
        parents=parents,
        rest=np.array([bone.matrix_local for bone in bones], dtype=np.float64).reshape(-1, 4, 4),
        lengths=np.array([bone.length for bone in bones]),
        inherits_rotation=np.array([bone.use_inherit_rotation for bone in bones]),
        object_matrix=_object_matrix(armature),
        mapping=recognize(armature.name, names, parents),
    )
    for control in rig.mapping.controls:
        bone = bones[control.bone]
        if control.anchor and (bone.use_connect or not bone.use_local_location):
            raise InputError(armature.name, f"its bone {bone.name} must move; switch Connected off and Local Location on in its relations")
    return rig


def find_armature(name: str) -> bpy.types.Object:
    """The armature object of that name; InputError that lists the others if there is none."""
    armature = bpy.data.objects.get(name)
    if armature is None or armature.type != "ARMATURE":
        others = ", ".join(found.name for found in bpy.data.objects if found.type == "ARMATURE") or "none"
        raise InputError(name, f"is not an armature of this file; its armatures are: {others}")
    return armature


def _object_matrix(armature: bpy.types.Object) -> np.ndarray:
    matrix = np.array(armature.matrix_world, dtype=np.float64)
    scales = np.linalg.norm(matrix[:3, :3], axis=0)
    if np.ptp(scales) > 1e-4 * scales.max() or np.linalg.det(matrix[:3, :3]) <= 0:
        raise InputError(armature.name, f"its scale is {scales.round(4).tolist()}; it must be the same positive number along all axes: apply the scale")
    return matrix
