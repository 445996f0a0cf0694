"""Animated scenes of simple solids in which fingers pierce before they are mended: what the solver is measured on.

The palm is held just outside of the solid, as a person's own hand would be, but for a few frames of the table; the fingers close,
open and curl regardless of it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...hands.contact import palm_depths
from ...hands.hand import Hand, Side
from ...hands.obstacle import Obstacle, over_time
from ...hands.poses import POSES, controller_pose
from ...hands.shapes import Box, Capsules, Cylinder, Moved, Sphere, Union, capsule
from ...hands.standard import standard_hand
from ...motion.rotations import Array, multiply, normalize, quat_from_axis_angle, quat_from_matrix, quat_from_yaw, rotate

RATE = 24.0
FRAMES = 288
CLEARANCE = 0.002  # metres between palm and solid


@dataclass(frozen=True)
class Scene:
    """One hand over time, what it wants, and what it must not enter. `smooth`: the solid has no edges."""

    name: str
    hand: Hand
    wrists: tuple[Array, Array]
    wanted: Array
    obstacles: Callable[[int], Obstacle]
    smooth: bool

    def __len__(self) -> int:
        return len(self.wanted)


def scenes() -> list[Scene]:
    """Every scene, always the same."""
    return [build() for build in (_sphere, _cube, _mug, _plate, _table, _chair, _hands, _thigh)]


def facing(hand: Hand, points: Array, normals: Array, along: Array, gap: Array | float) -> tuple[Array, Array]:
    """Wrists (positions [T, 3], rotations [T, 4]) whose palms look against `normals` [T, 3] at a distance of `gap` from `points`, fingers `along` [T, 3]."""
    out = -normalize(np.asarray(normals, np.float64))
    along = np.broadcast_to(along, out.shape)
    forward = normalize(along - np.sum(along * out, -1, keepdims=True) * out)
    across = np.cross(out, forward) * np.sign(np.linalg.det(hand.palm))
    rotation = np.stack((forward, across, out), -1) @ hand.palm.T.astype(np.float64)
    middle = hand.rest_positions[[3, 6, 9, 12]].mean(0) * 0.8
    palm = middle + hand.palm[:, 2] * 0.06 * hand.length
    positions = points + np.asarray(normals) * np.reshape(gap, (-1, 1)) - (rotation @ palm)
    return positions.astype(np.float32), quat_from_matrix(rotation).astype(np.float32)


def kept_out(hand: Hand, wrists: tuple[Array, Array], normals: Array, obstacles: Callable[[int], Obstacle]) -> tuple[Array, Array]:
    """The same wrists, moved along `normals` [T, 3] until the palm is CLEARANCE outside."""
    nearest, (positions, rotations) = over_time(obstacles), wrists
    for _ in range(12):
        inside = np.maximum(palm_depths(hand, (positions, rotations), nearest) + CLEARANCE, 0)
        positions = (positions + normals * inside[:, None]).astype(np.float32)
    return _eased(positions), rotations


def _eased(positions: Array) -> Array:
    """Positions without the jerks of being pushed out (a short moving average)."""
    padded = np.concatenate((positions[:1].repeat(2, 0), positions, positions[-1:].repeat(2, 0)))
    return np.stack([padded[i : i + len(positions)] for i in range(5)]).mean(0).astype(np.float32)


def _wave(cycles: float, phase: float = 0.0, low: float = 0.0, high: float = 1.0) -> Array:
    """A slow cosine over the scene between two values [T]."""
    time = np.arange(FRAMES) / FRAMES
    return low + (high - low) * (0.5 - 0.5 * np.cos(2 * np.pi * (cycles * time + phase)))


def _blend(first: str, second: str, share: Array) -> Array:
    return (POSES[first] + share[:, None] * (POSES[second] - POSES[first])).astype(np.float32)


def _around(cycles: float, tilt: float) -> Array:
    """Directions [T, 3] that go around the Z axis and nod."""
    turn = 2 * np.pi * cycles * np.arange(FRAMES) / FRAMES
    up = tilt * np.sin(3 * turn + 1)
    return normalize(np.stack((np.cos(turn), np.sin(turn), up), -1))


def _held(
    name: str, side: Side, solid: Callable[[int], Obstacle], directions: Array, along: Array, gap: Array, wanted: Array, surface: float, smooth: bool
) -> Scene:
    hand = standard_hand(side)
    wrists = facing(hand, directions * surface, directions, along, gap)
    return Scene(name, hand, kept_out(hand, wrists, directions, solid), wanted, solid, smooth)


def _sphere() -> Scene:
    ball = Sphere(np.zeros(3, np.float32), 0.05)
    gap = _wave(3, low=-0.005, high=0.13)
    return _held("sphere", "right", lambda frame: ball, _around(1, 0.5), np.array([0, 0, 1]), gap, controller_pose(_wave(6), _wave(5)), 0.05, True)


def _cube() -> Scene:
    cube = Box(np.zeros(3, np.float32), np.full(3, 0.035, np.float32))
    turned = [Moved(cube, np.zeros(3, np.float32), quat_from_yaw(np.float32(0.02 * frame))) for frame in range(FRAMES)]
    wanted = _blend("spread", "fist", _wave(6))
    return _held("cube", "left", turned.__getitem__, _around(1, 0.3), np.array([0.3, 0, 1]), _wave(3, low=-0.01, high=0.12), wanted, 0.04, False)


def _mug() -> Scene:
    turns = np.linspace(-np.pi / 2, np.pi / 2, 9)
    arc = np.stack((0.04 + 0.03 * np.cos(turns), 0 * turns, 0.033 * np.sin(turns)), -1).astype(np.float32)
    mug = Union((Cylinder(np.zeros(3, np.float32), 0.04, 0.05), Capsules(arc[:-1], arc[1:], np.full(8, 0.006, np.float32))))
    lifted = [Moved(mug, np.array([0, 0, h], np.float32)) for h in _wave(2, high=0.15)]
    directions = normalize(np.stack((np.cos(_wave(1, low=0.2, high=3.2)), np.sin(_wave(1, low=0.2, high=3.2)), 0 * _wave(1)), -1))
    along = np.cross(directions, np.array([0, 0, -1.0]))
    scene = _held("mug", "right", lambda frame: mug, directions, along, _wave(3, low=0.0, high=0.12), controller_pose(_wave(5), _wave(4, 0.1)), 0.04, False)
    shift = np.stack((0 * _wave(2), 0 * _wave(2), _wave(2, high=0.15)), -1).astype(np.float32)
    return Scene(scene.name, scene.hand, (scene.wrists[0] + shift, scene.wrists[1]), scene.wanted, lifted.__getitem__, scene.smooth)


def _plate() -> Scene:
    """The hand comes to the rim from the side, thumb above and fingers below, or with the rim across the fingers."""
    plate = Cylinder(np.zeros(3, np.float32), 0.12, 0.004)
    hand = standard_hand("right")
    directions = normalize(np.stack((np.cos(_wave(1, high=1.2)), np.sin(_wave(1, high=1.2)), 0 * _wave(1)), -1))
    normals = normalize(directions * 0.8 - np.array([0, 0, 0.7]))
    wrists = facing(hand, directions * _wave(5, low=0.095, high=0.19)[:, None], normals, -directions, 0.01)
    wanted = _blend("spread", "pinch", _wave(4))
    return Scene("plate", hand, kept_out(hand, wrists, normals, lambda frame: plate), wanted, lambda frame: plate, False)


def _table() -> Scene:
    """Laid on the table, slid, pressed; in a few frames the palm is pushed into it."""
    table = Box(np.array([0, 0, -0.02], np.float32), np.array([0.5, 0.5, 0.02], np.float32))
    hand = standard_hand("left")
    up = np.tile([0, 0, 1.0], (FRAMES, 1))
    places = np.stack((_wave(2, low=-0.2, high=0.2), _wave(3, low=-0.1, high=0.1), 0 * _wave(1)), -1)
    tilted = normalize(up + np.stack((0.25 * np.sin(_wave(2) * 6), 0.2 * np.cos(_wave(3) * 6), 0 * _wave(1)), -1))
    wrists = facing(hand, places, tilted, np.array([0, 1.0, 0]), _wave(4, low=0, high=0.05))
    positions, rotations = kept_out(hand, wrists, up, lambda frame: table)
    positions[FRAMES - 88 : FRAMES - 76, 2] -= 0.02 * np.sin(np.linspace(0, np.pi, 12, dtype=np.float32))
    return Scene("table", hand, (positions, rotations), _blend("flat", "fist", _wave(5, high=0.8)), lambda frame: table, True)


def _chair() -> Scene:
    """The hand goes along the top of a chair's back and closes around it."""
    parts = [((0, 0.22, 0.7), (0.22, 0.015, 0.25)), ((0, 0, 0.44), (0.22, 0.22, 0.02))]
    parts += [((x, y, 0.21), (0.02, 0.02, 0.21)) for x in (-0.2, 0.2) for y in (-0.2, 0.2)]
    chair = Union(tuple(Box(np.array(centre, np.float32), np.array(half, np.float32)) for centre, half in parts))
    hand = standard_hand("right")
    normals = normalize(np.stack((0.2 * np.sin(_wave(3) * 6), _wave(2, low=-0.4, high=0.4), 1 + 0 * _wave(1)), -1))
    places = np.stack((_wave(2, low=-0.18, high=0.18), np.full(FRAMES, 0.22), np.full(FRAMES, 0.95)), -1)
    wrists = facing(hand, places, normals, np.array([0, 1.0, 0]), _wave(4, low=0, high=0.04))
    wanted = controller_pose(_wave(5), _wave(5, 0.1))
    return Scene("chair", hand, kept_out(hand, wrists, normals, lambda frame: chair), wanted, lambda frame: chair, False)


def _hands() -> Scene:
    """Palm to palm; the left hand moves and is what the right one must not enter."""
    hand, other = standard_hand("right"), standard_hand("left")
    normals = normalize(np.stack((np.ones(FRAMES), 0.3 * np.sin(_wave(2) * 6), 0.2 * np.cos(_wave(3) * 6)), -1))
    gap = _wave(5, low=0.004, high=0.06)
    along = np.stack((0 * gap, 0.4 * np.sin(_wave(1) * 6), np.ones(FRAMES)), -1)
    left = facing(other, np.zeros((FRAMES, 3)), np.tile([-1.0, 0, 0], (FRAMES, 1)), np.array([0, 0, 1.0]), 0.0)
    capsules = other.capsules(_blend("flat", "relaxed", _wave(3)), *left)
    solids = [Capsules(capsules[0][frame], capsules[1][frame], capsules[2]) for frame in range(FRAMES)]
    wrists = facing(hand, np.zeros((FRAMES, 3)), normals, along, gap)
    wanted = _blend("flat", "cup", _wave(4))
    return Scene("two hands", hand, kept_out(hand, wrists, normals, solids.__getitem__), wanted, solids.__getitem__, True)


def _thigh() -> Scene:
    """The hand rests on a thigh that swings, and strokes along it."""
    thigh = capsule(np.array([0, 0, 0]), np.array([0, -0.42, -0.05]), 0.085)
    swings = [quat_from_axis_angle(np.array([1.0, 0, 0], np.float32), np.float32(angle)).astype(np.float32) for angle in _wave(2, low=-0.2, high=0.2)]
    moved = [Moved(thigh, np.zeros(3, np.float32), swing) for swing in swings]
    hand = standard_hand("left")
    normals = normalize(np.stack((_wave(2, low=-0.7, high=0.7), 0 * _wave(1), np.ones(FRAMES)), -1))
    places = np.stack((0 * _wave(1), _wave(2, 0.2, low=-0.3, high=-0.2), 0 * _wave(1)), -1) + normals * 0.085
    still = facing(hand, places, normals, normalize(np.array([-0.5, -1.0, 0])), _wave(3, low=0, high=0.04))
    rotation = np.stack(swings)
    wrists = rotate(rotation, still[0]).astype(np.float32), multiply(rotation, still[1]).astype(np.float32)
    out = rotate(rotation, normals.astype(np.float32))
    wanted = _blend("flat", "fist", _wave(4, high=0.7))
    return Scene("thigh", hand, kept_out(hand, wrists, out, moved.__getitem__), wanted, moved.__getitem__, True)
