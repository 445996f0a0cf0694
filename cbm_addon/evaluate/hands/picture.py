"""Pictures of a hand and what it touches, before and after: signed distances, sphere-traced into a PNG."""

from __future__ import annotations

import struct
import zlib

import numpy as np

from ...hands.shapes import Capsules
from ...motion.rotations import Array, normalize, rotate
from .scenes import Scene

SIZE = 200  # pixels of one picture
WIDTH = 0.24  # metres that it shows
STEPS = 32
SKIN, SOLID, WALL = (np.array(colour, float) for colour in ((224, 172, 140), (120, 144, 176), (250, 250, 250)))
LIGHT = normalize(np.array([0.2, -0.3, 0.9]))


def before_and_after(scene: Scene, angles: Array, frame: int) -> np.ndarray:
    """uint8 [SIZE, 2 SIZE, 3]: the wanted fingers at the left, these at the right."""
    return np.concatenate([_drawn(scene, pose, frame) for pose in (scene.wanted, angles)], 1)


def _drawn(scene: Scene, angles: Array, frame: int) -> np.ndarray:
    hand, here = scene.hand, slice(frame, frame + 1)
    position, rotation = scene.wrists[0][frame], scene.wrists[1][frame]
    starts, ends, radii = hand.capsules(angles[here], scene.wrists[0][here], scene.wrists[1][here])
    skin, solid = Capsules(starts[0], ends[0], radii), scene.obstacles(frame)
    along, across, out = rotate(rotation, hand.palm.T)
    toward = normalize(across * 0.75 - out * 0.15 + along * 0.35)  # from the hand to the eye
    right = normalize(np.cross(out, toward))
    up = np.cross(toward, right)
    if up[2] < 0:
        right, up = -right, -up
    middle = position + along * 0.11 + out * 0.02
    raster = (np.arange(SIZE) + 0.5) / SIZE - 0.5
    x, y = np.meshgrid(raster * WIDTH, -raster * WIDTH)
    points = (middle + 0.3 * toward + x.reshape(-1, 1) * right + y.reshape(-1, 1) * up).astype(np.float32)
    travelled, active = np.zeros(len(points)), np.arange(len(points))
    for _ in range(STEPS):
        nearest = np.minimum(skin.nearest(points[active])[0], solid.nearest(points[active])[0])
        points[active] -= (nearest[:, None] * toward).astype(np.float32)
        travelled[active] += nearest
        active = active[(nearest > 2e-4) & (travelled[active] < 0.6)]
    skin_distance, skin_normals = skin.nearest(points)
    solid_distance, solid_normals = solid.nearest(points)
    of_skin = skin_distance < solid_distance
    shade = 0.45 + 0.55 * np.clip(np.where(of_skin[:, None], skin_normals, solid_normals) @ LIGHT, 0, 1)
    colours = np.where(of_skin[:, None], SKIN, SOLID) * shade[:, None]
    colours[travelled >= 0.6] = WALL
    return colours.reshape(SIZE, SIZE, 3).clip(0, 255).astype(np.uint8)


def png(pixels: np.ndarray) -> bytes:
    """A PNG file of uint8 [H, W, 3]."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    height, width, _ = pixels.shape
    rows = np.concatenate((np.zeros((height, 1), np.uint8), pixels.reshape(height, -1)), 1)
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows.tobytes(), 9)) + chunk(b"IEND", b"")
