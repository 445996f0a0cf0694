"""Pictures of what touches what: signed distances, sphere-traced into a PNG."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

import numpy as np

from ..hands.obstacle import Obstacle
from ..motion.rotations import Array, normalize

STEPS = 32
SKIN, SOLID, WALL = (np.array(colour, float) for colour in ((224, 172, 140), (120, 144, 176), (250, 250, 250)))
LIGHT = normalize(np.array([0.2, -0.3, 0.9]))


@dataclass(frozen=True)
class View:
    """Parallel rays toward `middle` [3] from the direction `toward` [3], the upper edge in the direction of `up` [3]; `width` metres that are shown,
    and `size` pixels across."""

    middle: Array
    toward: Array
    up: Array
    width: float
    size: int


def traced(skin: Obstacle, solid: Obstacle, view: View) -> np.ndarray:
    """uint8 [size, size, 3]: a body in the colour of skin and a solid, lit from above."""
    toward = normalize(view.toward)
    right = normalize(np.cross(view.up, toward))
    up = np.cross(toward, right)
    raster = ((np.arange(view.size) + 0.5) / view.size - 0.5) * view.width
    x, y = np.meshgrid(raster, -raster)
    depth = 1.25 * view.width
    points = (view.middle + depth * toward + x.reshape(-1, 1) * right + y.reshape(-1, 1) * up).astype(np.float32)
    travelled, active = np.zeros(len(points)), np.arange(len(points))
    for _ in range(STEPS):
        nearest = np.minimum(skin.nearest(points[active])[0], solid.nearest(points[active])[0])
        points[active] -= (nearest[:, None] * toward).astype(np.float32)
        travelled[active] += nearest
        active = active[(nearest > 1e-3 * view.width) & (travelled[active] < 2 * depth)]
    skin_distance, skin_normals = skin.nearest(points)
    solid_distance, solid_normals = solid.nearest(points)
    of_skin = skin_distance < solid_distance
    shade = 0.45 + 0.55 * np.clip(np.where(of_skin[:, None], skin_normals, solid_normals) @ LIGHT, 0, 1)
    colours = np.where(of_skin[:, None], SKIN, SOLID) * shade[:, None]
    colours[travelled >= 2 * depth] = WALL
    return colours.reshape(view.size, view.size, 3).clip(0, 255).astype(np.uint8)


def png(pixels: np.ndarray) -> bytes:
    """A PNG file of uint8 [H, W, 3]."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    height, width, _ = pixels.shape
    rows = np.concatenate((np.zeros((height, 1), np.uint8), pixels.reshape(height, -1)), 1)
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows.tobytes(), 9)) + chunk(b"IEND", b"")
