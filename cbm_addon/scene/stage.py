"""A stage for pictures: a chequered floor on which sliding feet show, a camera, and markers at the trackers."""

from __future__ import annotations

import math

import bpy
import numpy as np
from mathutils import Vector

from ..motion.rotations import Array
from ..takes.take import DEVICES
from .proxy import plain_material

TILE = 0.5  # metres
MARKER_COLOURS = {"head": (0.10, 0.62, 0.22, 1), "left": (0.10, 0.45, 0.95, 1), "right": (0.95, 0.22, 0.10, 1)}
MARKER_SIZE = 0.11  # metres from the middle to a tip
VIEW = Vector((0.62, -1.0, 0.30)).normalized()  # from the subject to the camera, of a subject that faces -Y
LENS, SENSOR = 50.0, 36.0  # millimetres


def add_floor(collection: bpy.types.Collection, corners: Array, margin: float) -> bpy.types.Object:
    """A chequered floor at z = 0 under the ground between two corners [2, 3] and `margin` around it."""
    low = np.floor((corners[0, :2] - margin) / TILE).astype(int)
    high = np.ceil((corners[1, :2] + margin) / TILE).astype(int)
    columns, rows = (high - low).tolist()
    x, y = np.meshgrid(low[0] + np.arange(columns + 1), low[1] + np.arange(rows + 1))
    points = np.stack((x, y, np.zeros_like(x)), axis=-1).reshape(-1, 3) * TILE
    first = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    faces = np.stack((first, first + 1, first + columns + 2, first + columns + 1), axis=-1)
    mesh = bpy.data.meshes.new("CBM Floor")
    mesh.from_pydata(points.tolist(), [], faces.tolist())
    for name, grey in (("CBM Floor Light", 0.42), ("CBM Floor Dark", 0.31)):
        mesh.materials.append(plain_material(name, (grey, grey, grey, 1)))
    odd = (np.arange(rows)[:, None] + low[1] + np.arange(columns) + low[0]) % 2
    mesh.polygons.foreach_set("material_index", odd.ravel().astype(np.int32))
    floor = bpy.data.objects.new("CBM Floor", mesh)
    floor.hide_select = True
    collection.objects.link(floor)
    return floor


def add_camera(scene: bpy.types.Scene, collection: bpy.types.Collection, facing: float, width: float, height: float, room: float) -> bpy.types.Object:
    """The scene's camera, in whose picture what stands at the world's origin fits, `width` across and `height` tall with `room` around it.
    It faces the angle `facing` (radians about Z, from -Y). Move the camera along with it."""
    camera = bpy.data.objects.new("CBM Camera", bpy.data.cameras.new("CBM Camera"))
    camera.data.lens = LENS
    collection.objects.link(camera)
    scene.camera = camera
    aspect = scene.render.resolution_y / scene.render.resolution_x
    half = SENSOR / 2 / LENS  # of the picture's longer side, at a distance of 1
    across, upright = half / max(aspect, 1), half * min(aspect, 1)
    distance = max((width / 2 + room) / across, (height / 2 + room) / upright) + width / 4
    away = Vector((*_turned(VIEW.xy, facing), VIEW.z))
    camera.location = Vector((0, 0, height / 2)) + away * distance
    camera.rotation_euler = away.to_track_quat("Z", "Y").to_euler()
    camera.data.clip_end = 10 * distance + 100
    return camera


def _turned(xy: Vector, angle: float) -> tuple[float, float]:
    cosine, sine = math.cos(angle), math.sin(angle)
    return cosine * xy[0] - sine * xy[1], sine * xy[0] + cosine * xy[1]


def add_markers(collection: bpy.types.Collection) -> dict[str, bpy.types.Object]:
    """A coloured three-armed cross for each device, long enough to stick out of a wrist or a head that it is in."""
    markers = {}
    for device in DEVICES:
        mesh = bpy.data.meshes.new(f"CBM Marker {device}")
        mesh.from_pydata(*_cross(MARKER_SIZE * (1.6 if device == "head" else 1.0)))
        mesh.materials.append(plain_material(f"CBM Marker {device}", MARKER_COLOURS[device]))
        markers[device] = bpy.data.objects.new(f"CBM Marker {device}", mesh)
        collection.objects.link(markers[device])
    return markers


def _cross(size: float) -> tuple[list, list, list]:
    """Three thin double spikes along the axes."""
    points, faces = [], []
    for axis in np.eye(3):
        across = 0.1 * size * np.eye(3)[axis == 0]
        first = len(points)
        points += [size * axis, -size * axis, *across, *-across]
        faces += [(first + tip, first + 2 + corner, first + 2 + (corner + 1) % 4) for tip in (0, 1) for corner in range(4)]
    return [tuple(point) for point in points], [], faces
