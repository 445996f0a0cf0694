"""Armature objects as the engine's rigs."""

from __future__ import annotations

import bpy
import numpy as np

from ..errors import InputError
from ..rigs.recognize import recognized
from ..rigs.rig import Bones, Rig
from ..rigs.tables import Table

TRANSFORMS = ("location", "rotation_quaternion", "rotation_euler", "rotation_axis_angle")


def read_rig(armature: bpy.types.Object, table: Table | None = None) -> Rig:
    """The rig of an armature object as it stands in the world now, by a map of its bones if one is given.

    Raises InputError if it is no armature, if its bones are no body, or if a transform of it cannot be animated exactly.
    """
    rig = recognized(read_bones(armature), table)
    for control in rig.mapping.controls:
        if control.anchor and armature.data.bones[control.bone].use_connect:
            raise InputError(armature.name, f"its bone {control.bone} must move; switch Connected off in its relations")
    return rig


def read_bones(armature: bpy.types.Object) -> Bones:
    """The bones of an armature object at rest; InputError if it is no armature, or scaled unevenly or negatively."""
    if armature.type != "ARMATURE":
        raise InputError(armature.name, f"is a {armature.type.lower()}; choose an armature")
    bpy.context.view_layer.update()
    bones = armature.data.bones
    names = tuple(bones.keys())
    place = {name: i for i, name in enumerate(names)}
    constrained = {bone.name for bone in armature.pose.bones if any(not item.mute and item.influence > 0 for item in bone.constraints)} | _driven(armature)
    return Bones(
        name=armature.name,
        bones=names,
        parents=np.array([place[bone.parent.name] if bone.parent else -1 for bone in bones], dtype=int),
        rest=np.array([bone.matrix_local for bone in bones], dtype=np.float64).reshape(-1, 4, 4),
        lengths=np.array([bone.length for bone in bones]),
        inherits_rotation=np.array([bone.use_inherit_rotation for bone in bones], dtype=bool),
        local_location=np.array([bone.use_local_location for bone in bones], dtype=bool),
        constrained=np.array([name in constrained for name in names], dtype=bool),
        object_matrix=_object_matrix(armature),
    )


def find_armature(name: str) -> bpy.types.Object:
    """The armature object of that name; InputError that lists the others if there is none."""
    armature = bpy.data.objects.get(name)
    if armature is None or armature.type != "ARMATURE":
        others = ", ".join(found.name for found in armatures()) or "none"
        raise InputError(name, f"is not an armature of this file; its armatures are: {others}")
    return armature


def armatures() -> list[bpy.types.Object]:
    """The armature objects of the file."""
    return [obj for obj in bpy.data.objects if obj.type == "ARMATURE"]


def require_editable(armature: bpy.types.Object) -> None:
    """InputError if an armature cannot be animated in this file."""
    if armature.library is not None:
        raise InputError(armature.name, f"is linked from {armature.library.filepath}; make a library override of it, or bake in its own file")
    if armature.mode == "EDIT":
        raise InputError(armature.name, "its bones are being edited; leave edit mode first")


def _driven(armature: bpy.types.Object) -> set[str]:
    """Bones whose place or rotation a driver sets."""
    drivers = armature.animation_data.drivers if armature.animation_data else ()
    paths = [curve.data_path for curve in drivers if curve.data_path.rsplit(".", 1)[-1] in TRANSFORMS]
    return {bone.name for bone in armature.pose.bones if any(path.startswith(f'pose.bones["{bpy.utils.escape_identifier(bone.name)}"].') for path in paths)}


def _object_matrix(armature: bpy.types.Object) -> np.ndarray:
    matrix = np.array(armature.matrix_world, dtype=np.float64)
    axes = matrix[:3, :3]
    scales = np.linalg.norm(axes, axis=0)
    shown = ", ".join(f"{value:g}" for value in armature.matrix_world.to_scale())
    if np.linalg.det(axes) <= 0:
        raise InputError(armature.name, f"its scale is {shown}; a negative scale mirrors it: apply the scale")
    if np.abs(axes.T @ axes - np.mean(scales) ** 2 * np.eye(3)).max() > 1e-4 * scales.max() ** 2:
        raise InputError(armature.name, f"its scale is {shown}; it must be the same positive number along all axes, unsheared: apply the scale")
    return matrix
