"""The character's own body as an obstacle: capsules around its bones, or objects that stand for them once the user has asked for those."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Matrix

from ..hands.hand import PALM_RADIUS, RADII
from ..hands.obstacle import Obstacle
from ..hands.shapes import Capsules, Moved
from ..motion.rotations import Array, normalize, quat_from_matrix
from ..rigs.colliders import Collider, body_colliders, finger_colliders, fitted
from ..rigs.fingers import FingerBones
from ..rigs.rig import Rig
from .obstacles import cached_mesh, skin_of, triangles_of

PIECES = 4  # capsules of even thickness in the place of a tapered one
AROUND, ACROSS = 16, 4  # corners of a collider's mesh: around it, and over each of its round ends
MARK = "cbm_colliders"  # custom property of the collection that holds them


def skin_points(armature: bpy.types.Object) -> Array:
    """The vertices [V, 3] of the armature's skin in the world, at rest."""
    points = [np.empty((0, 3))]
    for obj in skin_of(armature):
        local = np.empty(3 * len(obj.data.vertices), np.float32)
        obj.data.vertices.foreach_get("co", local)
        matrix = np.array(obj.matrix_world, dtype=np.float64)
        points.append(local.reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3])
    return np.concatenate(points)


def fitted_body(armature: bpy.types.Object, rig: Rig, hands: list[FingerBones]) -> tuple[list[Collider], list[Array]]:
    """The parts of the body without its hands, and the radii of the phalanges [15] of each of the hands, world units, as the skin has them.

    What the skin does not tell is as thick as the rig's size says.
    """
    body = body_colliders(rig)
    parts = [finger_colliders(rig, fingers, fingers.length * RADII, fingers.length * PALM_RADIUS) for fingers in hands]
    skin = skin_points(armature)
    if len(skin):
        counts = np.cumsum([len(body), *map(len, parts)])
        together = fitted([*body, *(collider for hand in parts for collider in hand)], skin)
        body, *parts = (together[start:end] for start, end in zip([0, *counts[:-1]], counts, strict=True))
    return body, [np.array([np.mean(collider.radii) for collider in hand[: len(RADII)]]) for hand in parts]


@dataclass(frozen=True, eq=False)
class BodyPart:
    """A part of the body that a bone carries: an obstacle as it is at rest, in the hands' own space, and a ball [3] and radius around it."""

    bone: str
    obstacle: Obstacle
    middle: Array
    size: float

    def at(self, motion: Array) -> Obstacle:
        """The part when its bone has been moved from rest by a matrix [4, 4]."""
        if isinstance(self.obstacle, Capsules):
            starts, ends = ((points @ motion[:3, :3].T + motion[:3, 3]).astype(np.float32) for points in (self.obstacle.starts, self.obstacle.ends))
            return Capsules(starts, ends, self.obstacle.radii)
        return Moved(self.obstacle, motion[:3, 3].astype(np.float32), quat_from_matrix(motion[:3, :3]).astype(np.float32))


def body_parts(armature: bpy.types.Object, rig: Rig, colliders: list[Collider], unit: float) -> list[BodyPart]:
    """The body as the user's collider objects show it; as capsules where there are none. `unit`: world units per unit of the hands' own space."""
    collection = collider_collection(armature)
    if collection is None:
        return [_capsules(collider, unit) for collider in colliders]
    return [part for obj in collection.objects if obj.type == "MESH" and (part := _object(obj, rig, unit))]


def _capsules(collider: Collider, unit: float) -> BodyPart:
    starts, ends, radii = [], [], []
    for line in _lines(collider):
        points = np.linspace(*line, PIECES + 1)
        starts.append(points[:-1])
        ends.append(points[1:])
        radii.append(np.interp((np.arange(PIECES) + 0.5) / PIECES, (0, 1), collider.radii))
    middle, size = (collider.start + collider.end) / 2, np.linalg.norm(collider.end - collider.start) / 2
    size += np.linalg.norm(collider.beside) + max(collider.radii)
    shapes = (np.concatenate(values).astype(np.float32) / np.float32(unit) for values in (starts, ends, radii))
    return BodyPart(collider.bone, Capsules(*shapes), middle / unit, float(size / unit))


def _lines(collider: Collider) -> list[tuple[Array, Array]]:
    """Where its capsules begin and end."""
    besides = (collider.beside, -collider.beside) if np.any(collider.beside) else (collider.beside,)
    return [(collider.start + beside, collider.end + beside) for beside in besides]


def _object(obj: bpy.types.Object, rig: Rig, unit: float) -> BodyPart | None:
    """A collider object where it is when its bone is at rest; None if no bone carries it, or if it has no surface."""
    obj.data.calc_loop_triangles()
    local, triangles = triangles_of(obj.data)
    if obj.parent_bone not in rig.bones or not len(triangles):
        return None
    matrix = _carrier(rig, obj.parent_bone) @ np.array(obj.matrix_parent_inverse) @ np.array(obj.matrix_basis)
    vertices = (local @ matrix[:3, :3].T + matrix[:3, 3]) / unit
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    return BodyPart(obj.parent_bone, cached_mesh(vertices, triangles), (low + high) / 2, float(np.linalg.norm(high - low) / 2))


# Colliders as objects


def collider_collection(armature: bpy.types.Object) -> bpy.types.Collection | None:
    """The collection of an armature's collider objects; None if it has none."""
    return next((found for found in bpy.data.collections if found.get(MARK) and any(obj.parent == armature for obj in found.objects)), None)


def add_colliders(context: bpy.types.Context, armature: bpy.types.Object, rig: Rig, hands: list[FingerBones]) -> bpy.types.Collection:
    """A new collection with an object for every part of the body, shown as wires and carried by its bone, for the user to edit. Earlier ones go."""
    earlier = collider_collection(armature)
    if earlier is not None:
        bpy.data.batch_remove([*earlier.objects, earlier])
    collection = bpy.data.collections.new(f"{armature.name} Colliders")
    collection[MARK] = True
    context.scene.collection.children.link(collection)
    for collider in fitted_body(armature, rig, hands)[0]:
        mesh = bpy.data.meshes.new(f"{armature.name} {collider.joint}")
        mesh.from_pydata(*surface(collider))
        obj = bpy.data.objects.new(mesh.name, mesh)
        obj.display_type, obj.hide_render = "WIRE", True
        obj.parent, obj.parent_type, obj.parent_bone = armature, "BONE", collider.bone
        obj.matrix_parent_inverse = Matrix(np.linalg.inv(_carrier(rig, collider.bone)))
        collection.objects.link(obj)
    return collection


def _carrier(rig: Rig, bone: str) -> Array:
    """World matrix [4, 4] at rest of what carries the children of a bone: its axes, at its tail."""
    matrix = rig.object_matrix @ rig.rest[rig.index(bone)]
    matrix[:3, 3] = rig.tail(bone)
    return matrix


def surface(collider: Collider) -> tuple[list, list, list]:
    """A tapered capsule as a mesh in the world; of two side by side both, which overlap."""
    along = normalize(collider.end - collider.start)
    across = normalize(np.cross(along, np.eye(3)[np.argmin(np.abs(along))]))
    turn = 2 * np.pi * np.arange(AROUND) / AROUND
    circle = np.cos(turn)[:, None] * across + np.sin(turn)[:, None] * np.cross(along, across)
    rise = np.linspace(0, np.pi / 2, ACROSS + 1)
    points: list[list[float]] = []
    faces: list[list[int]] = []
    for start, end in _lines(collider):
        first = len(points)
        for centre, radius, angles in ((start, collider.radii[0], rise - np.pi / 2), (end, collider.radii[1], rise)):
            points += [point for angle in angles for point in (centre + radius * (np.cos(angle) * circle + np.sin(angle) * along)).tolist()]
        here = first + np.arange(len(points) - first).reshape(-1, AROUND)
        faces += np.stack((here[:-1], np.roll(here[:-1], -1, 1), np.roll(here[1:], -1, 1), here[1:]), -1).reshape(-1, 4).tolist()
    return points, [], faces
