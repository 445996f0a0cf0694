"""A proxy for an armature without a mesh: one mesh in the shape of a simple figure that follows the deforming bones."""

from __future__ import annotations

import bpy
import numpy as np

from ..rigs.tables import Table
from .figure import CORNERS, DARK, LEFT, PALE, RIGHT, Piece, figure
from .rig import read_rig

MATERIALS = {
    PALE: ("CBM Proxy", (0.70, 0.68, 0.65, 1)),
    LEFT: ("CBM Proxy Left", (0.20, 0.45, 0.78, 1)),
    RIGHT: ("CBM Proxy Right", (0.85, 0.40, 0.16, 1)),
    DARK: ("CBM Proxy Visor", (0.05, 0.05, 0.06, 1)),
}


def meshes_of(armature: bpy.types.Object) -> list[bpy.types.Object]:
    """The meshes that an armature deforms or carries."""
    return [
        obj
        for obj in bpy.data.objects
        if obj.type == "MESH" and (obj.parent == armature or any(mod.type == "ARMATURE" and mod.object == armature for mod in obj.modifiers))
    ]


def add_proxy(armature: bpy.types.Object, table: Table | None = None) -> bpy.types.Object | None:
    """A new mesh object beside the armature, which itself is not changed; None if none of its bones deforms.

    table  the user's map of its bones
    """
    rig = read_rig(armature, table)
    pieces = figure(rig, [bone.name for bone in armature.data.bones if bone.use_deform])
    if not pieces:
        return None
    corners, faces = _surface(pieces)
    mesh = bpy.data.meshes.new("CBM Proxy")
    mesh.from_pydata(rig.to_armature(corners).tolist(), [], faces)
    for _, (name, colour) in sorted(MATERIALS.items()):
        mesh.materials.append(plain_material(name, colour))
    faces_of = [_face_count(piece) for piece in pieces]
    mesh.polygons.foreach_set("material_index", np.repeat([piece.material for piece in pieces], faces_of).astype(np.int32))
    mesh.polygons.foreach_set("use_smooth", np.ones(len(faces), dtype=bool))
    proxy = bpy.data.objects.new("CBM Proxy", mesh)
    proxy.parent = armature
    (armature.users_collection or (bpy.context.scene.collection,))[0].objects.link(proxy)
    first = 0
    for piece in pieces:
        group = proxy.vertex_groups.get(piece.bone) or proxy.vertex_groups.new(name=piece.bone)
        count = len(piece.rings) * CORNERS
        group.add(range(first, first + count), 1.0, "REPLACE")
        first += count
    proxy.modifiers.new("Armature", "ARMATURE").object = armature
    return proxy


def plain_material(name: str, colour: tuple[float, float, float, float]) -> bpy.types.Material:
    """The file's material of that name, or a new one; its viewport colour is what Workbench shows."""
    material = bpy.data.materials.get(name) or bpy.data.materials.new(name)
    material.diffuse_color = colour
    return material


def _face_count(piece: Piece) -> int:
    return (len(piece.rings) - 1) * CORNERS + 2


def _surface(pieces: list[Piece]) -> tuple[np.ndarray, list[list[int]]]:
    """Corners [V, 3] and faces of all pieces: bands between rings, and a lid at each end."""
    faces: list[list[int]] = []
    first = 0
    around = np.arange(CORNERS)
    for piece in pieces:
        last = first + (len(piece.rings) - 1) * CORNERS
        for ring in range(first, last, CORNERS):
            low = ring + around
            faces += np.stack((low, np.roll(low, -1), np.roll(low, -1) + CORNERS, low + CORNERS), axis=-1).tolist()
        faces += [(first + around[::-1]).tolist(), (last + around).tolist()]
        first = last + CORNERS
    return np.concatenate([piece.rings.reshape(-1, 3) for piece in pieces]), faces
