"""Where a hand touches: points on the axes of its phalanges, how deep they are in an obstacle, and which angles move them out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..motion.rotations import Array, matrix_from_quat
from .hand import FINGERS, JOINTS, PALM_RADIUS, PHALANGES, Hand, finger_angles

Nearest = Callable[[Array, Array], tuple[Array, Array]]
"""(frames int [F], world points [F, M, 3]) -> distances [F, M], normals [F, M, 3]; obstacle.over_time makes it."""

SOLVING = (1 / 3, 2 / 3, 1.0)  # where along a phalanx the solver looks
MEASURING = (0.2, 0.4, 0.6, 0.8, 1.0)  # where depth is measured
THUMB_FREE = 0.5  # the first half of the thumb's metacarpal lies in the palm and counts with it
PALM_SHARES = (0.4, 0.6, 0.8, 1.0)


@dataclass(frozen=True)
class Probe:
    """Points on the phalanges of a hand over time: their places, depths, and how the angles move them. M = 3 * shares per finger.

    wrists  world positions [T, 3] and rotations [T, 4]
    """

    hand: Hand
    wrists: tuple[Array, Array]
    shares: tuple[float, ...] = SOLVING

    @cached_property
    def radii(self) -> Array:
        """[5, M]; far below zero where a point belongs to the palm, so that it never touches."""
        radii = np.repeat(self.hand.radii.reshape(len(FINGERS), PHALANGES, 1), len(self.shares), -1)
        radii[0, 0, np.array(self.shares) < THUMB_FREE] = -1
        return radii.reshape(len(FINGERS), -1)

    @cached_property
    def moves(self) -> Array:
        """bool [M, 4]: which angles of a finger move which of its points."""
        phalanx = np.repeat(np.arange(PHALANGES), len(self.shares))
        return np.concatenate((np.arange(PHALANGES) <= phalanx[:, None], np.ones((len(phalanx), 1), bool)), -1)

    def points(self, placed: Array) -> Array:
        """Points [F, 5, M, 3] in the wrist's frame, from positions [F, 20, 3]."""
        starts = placed[:, : len(JOINTS), None]
        ends = self.hand.phalanx_ends(placed)[:, :, None]
        shares = np.array(self.shares, np.float32)[:, None]
        return (starts + (ends - starts) * shares).reshape(len(placed), len(FINGERS), -1, 3)

    def touch(self, nearest: Nearest, frames: Array, points: Array) -> tuple[Array, Array]:
        """Depths [F, 5, M], positive inside, and normals [F, 5, M, 3] in the wrist's frame, of points in the wrist's frame at `frames`."""
        positions, rotations = self.wrists[0][frames], matrix_from_quat(self.wrists[1][frames])
        flat = points.reshape(len(points), -1, 3)
        world = flat @ np.swapaxes(rotations, -1, -2) + positions[:, None]
        distances, normals = nearest(frames, world.astype(np.float32))
        return self.radii - distances.reshape(points.shape[:-1]), (normals @ rotations).reshape(points.shape)

    def slopes(self, angles: Array, placed: Array, points: Array, normals: Array) -> Array:
        """How the distances of points grow with the angles of their finger [F, 5, M, 4]."""
        by_finger = finger_angles(angles)
        flex = self.hand.spread(by_finger[..., 3], np.broadcast_to(self.hand.flex_axis[:, None], (*by_finger.shape[:-1], 1, 3)))
        joints = placed[:, : len(JOINTS)].reshape(len(placed), len(FINGERS), PHALANGES, 3)
        # n . (axis x (p - joint)) = axis . ((p - joint) x n)
        about = np.cross(points[..., None, :] - joints[:, :, None], normals[..., None, :])  # [F, 5, M, 3 joints, 3]
        bends = (about * flex[:, :, None]).sum(-1)
        spread = (about[..., 0, :] * self.hand.spread_axis[:, None]).sum(-1, keepdims=True)
        return np.concatenate((bends, spread), -1) * self.moves


def depth(hand: Hand, wrists: tuple[Array, Array], nearest: Nearest, angles: Array, frames: Array | None = None) -> Array:
    """How deep the deepest point of each finger is inside [F, 5], metres, negative if it is free; `frames` are all by default."""
    frames = np.arange(len(angles)) if frames is None else frames
    probe = Probe(hand, wrists, MEASURING)
    return probe.touch(nearest, frames, probe.points(hand.positions(angles)))[0].max(-1)


def palm_depth(hand: Hand, wrists: tuple[Array, Array], nearest: Nearest) -> Array:
    """How deep the palm with its knuckles is inside [T], metres: what fingers cannot mend."""
    bases = hand.rest_positions[: len(JOINTS) : PHALANGES]
    points = (bases[:, None] * np.array(PALM_SHARES, np.float32)[:, None]).reshape(-1, 3)
    radii = np.full((len(FINGERS), len(PALM_SHARES)), PALM_RADIUS * hand.length, np.float32)
    radii[:, -1] = hand.radii[::PHALANGES]
    world = points @ np.swapaxes(matrix_from_quat(wrists[1]), -1, -2) + wrists[0][:, None]
    distances, _ = nearest(np.arange(len(world)), world.astype(np.float32))
    return (radii.reshape(-1) - distances).max(-1)
