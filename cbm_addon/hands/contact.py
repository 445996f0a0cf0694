"""Where fingers touch: points on the axes of their phalanges, how deep they are in an obstacle, and which angles move them out.

Everything here works on rows: one row is one finger in one frame, so that only those are asked that may touch.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..motion.rotations import Array, matrix_from_quat
from .hand import EVERY, FINGERS, JOINTS, PALM_RADIUS, PHALANGES, Hand, finger_angles

Nearest = Callable[[np.ndarray, Array], tuple[Array, Array]]
"""(frames int [R], world points [R, M, 3]) -> distances [R, M], normals [R, M, 3]; obstacle.over_time makes it."""

SOLVING = (1 / 3, 2 / 3, 1.0)  # where along a phalanx the solver looks
MEASURING = (0.2, 0.4, 0.6, 0.8, 1.0)  # where depth is measured
THUMB_FREE = 0.5  # the first half of the thumb's metacarpal lies in the palm and counts with it
PALM_SHARES = (0.4, 0.6, 0.8, 1.0)


@dataclass(frozen=True)
class Probe:
    """Points on the phalanges of a hand over time, M = 3 * shares to a finger.

    wrists   world positions [T, 3] and rotations [T, 4]
    nearest  what must not be entered
    """

    hand: Hand
    wrists: tuple[Array, Array]
    nearest: Nearest
    shares: tuple[float, ...] = SOLVING

    def __len__(self) -> int:
        return len(self.wrists[0])

    @cached_property
    def radii(self) -> Array:
        return point_radii(self.hand, self.shares)

    @cached_property
    def matrices(self) -> Array:
        """Rotations of the wrists [T, 3, 3]."""
        return matrix_from_quat(self.wrists[1])

    @cached_property
    def moves(self) -> Array:
        """bool [M, 4]: which angles of a finger move which of its points."""
        phalanx = np.repeat(np.arange(PHALANGES), len(self.shares))
        return np.concatenate((np.arange(PHALANGES) <= phalanx[:, None], np.ones((len(phalanx), 1), bool)), -1)

    def depths(self, frames: np.ndarray, fingers: np.ndarray, angles: Array) -> Array:
        """How deep the points of fingers [R, M] are inside at their angles [R, 4], metres, negative outside."""
        return self._touch(frames, fingers, self.hand.chains(angles, fingers))[0]

    def contacts(self, frames: np.ndarray, fingers: np.ndarray, angles: Array) -> tuple[Array, Array]:
        """As `depths`, and how much less deep each point gets with each angle of its finger [R, M, 4]."""
        chains = self.hand.chains(angles, fingers)
        depths, points, normals = self._touch(frames, fingers, chains)
        flex = self.hand.spread(angles[:, 3], self.hand.flex_axis[fingers][:, None], fingers)
        # n . (axis x (p - joint)) = axis . (p x n - joint x n)
        arms, shifts = _cross(points, normals), _cross(chains[:, None, :PHALANGES], normals[:, :, None])
        bends = (arms @ np.swapaxes(flex, -1, -2)) - (shifts * flex[:, None]).sum(-1)
        spread = ((arms - shifts[:, :, 0]) * self.hand.spread_axis[fingers][:, None]).sum(-1, keepdims=True)
        return depths, np.concatenate((bends, spread), -1) * self.moves

    def _touch(self, frames: np.ndarray, fingers: np.ndarray, chains: Array) -> tuple[Array, Array, Array]:
        """Depths [R, M], points and normals [R, M, 3] in the wrist's frame."""
        points = axis_points(self.hand, chains, self.shares, fingers)
        rotations = self.matrices[frames]
        world = points @ np.swapaxes(rotations, -1, -2) + self.wrists[0][frames, None]
        distances, normals = self.nearest(frames, world.astype(np.float32))
        return self.radii[fingers] - distances, points, normals @ rotations


def _cross(a: Array, b: Array) -> Array:
    """The cross product [..., 3], several times faster than numpy's."""
    ax, ay, az, bx, by, bz = a[..., 0], a[..., 1], a[..., 2], b[..., 0], b[..., 1], b[..., 2]
    return np.stack((ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx), -1)


def axis_points(hand: Hand, chains: Array, shares: tuple[float, ...], fingers: np.ndarray | slice = EVERY) -> Array:
    """Points [..., R, M, 3] at shares of the axes of phalanges, of chains [..., R, 4, 3]."""
    starts = chains[..., :PHALANGES, None, :]
    ends = hand.axis_ends(chains, fingers)[..., None, :]
    points = starts + (ends - starts) * np.array(shares, np.float32)[:, None]
    return points.reshape(*chains.shape[:-2], PHALANGES * len(shares), 3)


def point_radii(hand: Hand, shares: tuple[float, ...]) -> Array:
    """Radii [5, M] of `axis_points`; -1 where a point belongs to the palm, so that it never touches."""
    radii = np.repeat(hand.radii.reshape(len(FINGERS), PHALANGES, 1), len(shares), -1)
    radii[0, 0, np.array(shares) < THUMB_FREE] = -1
    return radii.reshape(len(FINGERS), -1)


def palm_points(hand: Hand) -> tuple[Array, Array]:
    """Points [P, 3] of the palm and the ball of the thumb in the wrist's frame, and their radii [P]."""
    bases = hand.rest_positions[: len(JOINTS) : PHALANGES]
    points = (bases[:, None] * np.array(PALM_SHARES, np.float32)[:, None]).reshape(-1, 3)
    radii = np.full((len(FINGERS), len(PALM_SHARES)), PALM_RADIUS * hand.length, np.float32)
    radii[:, -1] = hand.radii[::PHALANGES]
    thumb = hand.rest_positions[0] + THUMB_FREE * (hand.rest_positions[1] - hand.rest_positions[0])
    return np.concatenate((points, thumb[None])), np.append(radii, hand.radii[0])


def every_row(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Frames and fingers [5 T] of the rows of `count` frames."""
    return np.repeat(np.arange(count), len(FINGERS)), np.tile(np.arange(len(FINGERS)), count)


def finger_depths(hand: Hand, wrists: tuple[Array, Array], nearest: Nearest, angles: Array) -> Array:
    """How deep the deepest point of each finger is inside [T, 5], metres, negative if it is free, at angles [T, 20]."""
    frames, fingers = every_row(len(angles))
    rows = finger_angles(np.asarray(angles)).reshape(len(frames), -1)
    return Probe(hand, wrists, nearest, MEASURING).depths(frames, fingers, rows).max(-1).reshape(len(angles), len(FINGERS))


def palm_depths(hand: Hand, wrists: tuple[Array, Array], nearest: Nearest) -> Array:
    """How deep the palm with its knuckles is inside [T], metres: what fingers cannot mend."""
    points, radii = palm_points(hand)
    world = points @ np.swapaxes(matrix_from_quat(wrists[1]), -1, -2) + wrists[0][:, None]
    distances, _ = nearest(np.arange(len(world)), world.astype(np.float32))
    return (radii - distances).max(-1)
