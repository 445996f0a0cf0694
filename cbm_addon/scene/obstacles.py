"""What hands may meet in a scene: its meshes as Blender evaluates them, read frame by frame.

Only what comes near a hand is looked at. A mesh that keeps its shape is one obstacle that moves, with a cache of its distances; one that
bends is rebuilt from its triangles near the hands. Everything is kept in units of a hand of average size, in which millimetres mean what they say.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache

import bpy
import numpy as np
from mathutils.bvhtree import BVHTree

from ..errors import InputError
from ..hands.distance_cache import CachedDistances
from ..hands.mesh import Closest, Mesh, Topology
from ..hands.obstacle import Obstacle, empty
from ..hands.shapes import Moved, Union
from ..motion.rotations import Array, quat_from_matrix

SURFACES = ("MESH", "CURVE", "SURFACE", "META", "FONT")
SEEN_THROUGH = ("WIRE", "BOUNDS")  # how objects are displayed that stand for something else
SAME = 1e-5  # of an object's size, within which it has kept its shape
STILL = 1e-6  # of a metre or a quaternion
REBUILT = 64  # meshes that bend and are kept ready


def find_collection(name: str) -> bpy.types.Collection:
    """The collection of that name; InputError that lists the others if there is none."""
    if name not in bpy.data.collections:
        others = ", ".join(collection.name for collection in bpy.data.collections) or "none"
        raise InputError(name, f"is not a collection of this file; its collections are: {others}")
    return bpy.data.collections[name]


def search_tree(vertices: Array, triangles: np.ndarray) -> Closest:
    """Nearest places by Blender's own tree."""
    tree = BVHTree.FromPolygons(np.asarray(vertices).tolist(), np.asarray(triangles).tolist(), all_triangles=True)

    def closest(points: Array) -> tuple[Array, np.ndarray]:
        found = [tree.find_nearest(point) for point in np.asarray(points).tolist()]
        places = np.array([value for place, _, _, _ in found for value in place]).reshape(-1, 3)
        return places, np.fromiter((triangle for _, _, triangle, _ in found), np.int64, len(found))

    return closest


class SceneObstacles:
    """What the hands of an armature may meet, once every frame was looked at.

    collection  where the obstacles are; None for everything visible that does not belong to the character
    unit        world units per unit of the hands' own space
    reach       in that space, from a wrist
    """

    def __init__(self, armature: bpy.types.Object, collection: bpy.types.Collection | None, unit: float, reach: float) -> None:
        self._armature, self._unit, self._reach = armature, unit, reach
        self._chosen = None if collection is None else set(collection.all_objects)
        self._things: dict[tuple, _Thing] = {}
        self._seen: list[list[tuple[_Thing, _Pose | _Bent]]] = []
        self._unions: dict[tuple, Obstacle] = {}

    @property
    def names(self) -> list[str]:
        """What came near a hand."""
        return sorted({thing.name for thing in self._things.values()})

    def begin(self) -> None:
        """The next frame that is looked at is the first."""
        self._seen, self._unions = [], {}

    def look(self, depsgraph: bpy.types.Depsgraph, wrists: Array, free: Array) -> None:
        """Takes in the scene at its current frame, the next one. wrists [H, 3] and a point [3] that is in free space, in the hands' own space."""
        seen: list[tuple[_Thing, _Pose | _Bent]] = []
        for instance in depsgraph.object_instances:
            if self._may_meet(instance):
                self._look_at(instance, wrists, free, seen)
        self._seen.append(seen)

    def at(self, frame: int) -> Obstacle:
        """What is in reach of the hands at a frame, counted from the first that was looked at; one obstacle for all frames in which that is the same."""
        seen = tuple(self._seen[frame])
        if seen not in self._unions:
            parts = tuple(thing.obstacle(state) for thing, state in seen)
            self._unions[seen] = parts[0] if len(parts) == 1 else Union(parts) if parts else empty()
        return self._unions[seen]

    def _may_meet(self, instance: bpy.types.DepsgraphObjectInstance) -> bool:
        obj = instance.object.original
        owner = instance.parent.original if instance.is_instance else obj
        if obj.type not in SURFACES or deforms(self._armature, obj):
            return False
        if self._chosen is not None:
            return owner in self._chosen
        return instance.show_self and obj.display_type not in SEEN_THROUGH and not belongs(self._armature, owner)

    def _look_at(self, instance: bpy.types.DepsgraphObjectInstance, wrists: Array, free: Array, seen: list) -> None:
        obj = instance.object
        matrix = np.array(instance.matrix_world, dtype=np.float64)
        matrix[:3] /= self._unit
        corners = np.array(obj.bound_box) @ matrix[:3, :3].T + matrix[:3, 3]
        beyond = wrists - np.clip(wrists, corners.min(axis=0), corners.max(axis=0))
        if np.linalg.norm(beyond, axis=-1).min() > self._reach:
            return
        read = _shown(obj)
        if read is None:
            return
        local, triangles = read
        key = (instance.parent.name, *instance.persistent_id, obj.name) if instance.is_instance else (obj.name,)
        key = (*key, len(local), len(triangles))
        if key not in self._things:
            self._things[key] = _Thing(obj.name, local, matrix, triangles, free)
        thing = self._things[key]
        seen.append((thing, thing.state(local, matrix, wrists, self._reach)))


@dataclass(frozen=True, eq=False)
class _Pose:
    """Where something rigid is, against where it was first seen."""

    position: Array
    rotation: Array


@dataclass(frozen=True, eq=False)
class _Bent:
    """Something that has another shape than it had first: what of it is near a hand, vertices [V, 3] and the topology of its triangles."""

    vertices: Array
    topology: Topology


@dataclass(eq=False)
class _Thing:
    """An object or an instance as it was first seen: vertices [V, 3] of its mesh, its matrix [4, 4], triangles int [F, 3] and a free point [3]."""

    name: str
    local: Array
    matrix: Array
    triangles: np.ndarray
    free: Array
    _rigid: Obstacle | None = None
    _topology: Topology | None = None
    _last: _Pose | None = None

    @property
    def vertices(self) -> Array:
        return _placed(self.local, self.matrix)

    @property
    def topology(self) -> Topology:
        if self._topology is None:
            self._topology = Topology.of(self.vertices, self.triangles, self.free[None])
        return self._topology

    def state(self, local: Array, matrix: Array, wrists: Array, reach: float) -> _Pose | _Bent:
        """How the thing is now."""
        if np.abs(local - self.local).max() <= SAME * np.ptp(self.local, axis=0).max():
            motion = matrix @ np.linalg.inv(self.matrix)
            if np.abs(motion[:3, :3].T @ motion[:3, :3] - np.eye(3)).max() < SAME and np.linalg.det(motion[:3, :3]) > 0:
                return self._pose(motion)
        vertices = _placed(local, matrix)
        corners = vertices[self.topology.triangles]
        low, high = corners.min(axis=1), corners.max(axis=1)
        distances = [np.linalg.norm(wrist - np.clip(wrist, low, high), axis=-1) for wrist in wrists]
        near = self.topology.only(np.min(distances, axis=0) < reach)
        used, triangles = np.unique(near.triangles, return_inverse=True)
        return _Bent(vertices[used], replace(near, triangles=triangles.reshape(-1, 3)))

    def _pose(self, motion: Array) -> _Pose:
        """The last pose, as long as the thing stands still."""
        position, rotation = motion[:3, 3].astype(np.float32), quat_from_matrix(motion[:3, :3]).astype(np.float32)
        last = self._last
        if last is None or np.abs(position - last.position).max() > STILL or np.abs(rotation - last.rotation).max() > STILL:
            self._last = last = _Pose(position, rotation)
        return last

    def obstacle(self, state: _Pose | _Bent) -> Obstacle:
        if isinstance(state, _Bent):
            return _rebuilt(state)
        if self._rigid is None:
            self._rigid = _cached(self.vertices, self.topology)
        moved = np.abs(state.position).max() > STILL or np.abs(state.rotation[1:]).max() > STILL
        return Moved(self._rigid, state.position, state.rotation) if moved else self._rigid


@lru_cache(maxsize=REBUILT)
def _rebuilt(bent: _Bent) -> Obstacle:
    return Mesh(bent.vertices, bent.topology, search_tree) if len(bent.vertices) else empty()


def cached_mesh(vertices: Array, triangles: np.ndarray, free: Array | None = None) -> Obstacle:
    """A mesh that keeps its shape: vertices [V, 3], triangles int [F, 3], and points [N, 3] that are known to be in free space."""
    return _cached(vertices, Topology.of(vertices, triangles, free))


def _cached(vertices: Array, topology: Topology) -> Obstacle:
    if not len(topology.triangles):
        return empty()
    return CachedDistances(Mesh(vertices, topology, search_tree), vertices.min(axis=0), vertices.max(axis=0))


def _placed(local: Array, matrix: Array) -> Array:
    return local @ matrix[:3, :3].T + matrix[:3, 3]


def _shown(obj: bpy.types.Object) -> tuple[Array, np.ndarray] | None:
    """The triangles of an evaluated object; None if it shows no surface."""
    try:
        mesh = obj.to_mesh()
    except RuntimeError:
        return None
    if mesh is None:
        return None
    try:
        read = triangles_of(mesh)
        return read if len(read[1]) else None
    finally:
        obj.to_mesh_clear()


def triangles_of(mesh: bpy.types.Mesh) -> tuple[Array, np.ndarray]:
    """Vertices float64 [V, 3] and triangles int [F, 3] of a mesh, without those of which a corner is nowhere."""
    vertices, triangles = np.empty(3 * len(mesh.vertices), np.float32), np.empty(3 * len(mesh.loop_triangles), np.int32)
    mesh.vertices.foreach_get("co", vertices)
    mesh.loop_triangles.foreach_get("vertices", triangles)
    vertices, triangles = vertices.reshape(-1, 3).astype(np.float64), triangles.reshape(-1, 3)
    somewhere = np.asarray(np.isfinite(vertices).all(axis=-1))
    return np.where(somewhere[:, None], vertices, 0), triangles[somewhere[triangles].all(axis=-1)]


def deforms(armature: bpy.types.Object, obj: bpy.types.Object) -> bool:
    """Whether an object is skin of an armature."""
    return any(modifier.type == "ARMATURE" and modifier.object == armature for modifier in obj.modifiers)


def belongs(armature: bpy.types.Object, obj: bpy.types.Object) -> bool:
    """Whether an object goes along with an armature: as its skin, as a child, or by a constraint, like what a hand holds."""
    return any(above == armature or deforms(armature, above) or _follows(armature, above) for above in _upward(obj))


def _follows(armature: bpy.types.Object, obj: bpy.types.Object) -> bool:
    return any(getattr(constraint, "target", None) == armature and not constraint.mute for constraint in obj.constraints)


def _upward(obj: bpy.types.Object | None) -> Iterator[bpy.types.Object]:
    while obj is not None:
        yield obj
        obj = obj.parent


def skin_of(armature: bpy.types.Object) -> list[bpy.types.Object]:
    """The meshes that an armature deforms."""
    return [obj for obj in bpy.data.objects if obj.type == "MESH" and deforms(armature, obj)]
