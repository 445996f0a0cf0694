"""Collision-free hand poses in numbers: the free poses, interpolated along what hands do together, worn by hands of several proportions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...hands.contact import MEASURING, axis_points
from ...hands.hand import ANGLES, FINGERS, LIMITS, RADII, Hand, finger_angles
from ...hands.sensor import Grid
from ...hands.standard import standard_positions
from ...motion.rotations import IDENTITY, Array

STEP = 0.002  # of a stored distance, in lengths of the hand
TOLERANCE = 0.03  # lengths of the hand by which capsules of different fingers may overlap: flesh gives way


@dataclass(frozen=True)
class HandBank:
    """Poses of one hand, in its palm's frame and in lengths of the hand.

    angles     [N, 20]
    distances  uint8 [N, C]: from the cells of the grid to the surface of the hand, in STEPs, 0 inside and 255 for far away
    """

    hand: Hand
    angles: Array
    distances: np.ndarray

    def hand_distances(self, chosen: np.ndarray) -> Array:
        """Distances [n, C] in lengths of the hand."""
        return self.distances[chosen].astype(np.float32) * STEP


def interpolated(poses: Array, count: int, random: np.random.Generator) -> Array:
    """Poses [count, 20] between pairs of recorded poses [P, 20]; some fingers follow a pair of their own, and all vary a little."""

    def mixed(size: tuple[int, ...]) -> Array:
        first, second = poses[random.integers(len(poses), size=size)], poses[random.integers(len(poses), size=size)]
        share = random.random((*size, 1)).astype(np.float32)
        return first + share * (second - first)

    together = finger_angles(mixed((count,)))
    own = np.stack([finger_angles(mixed((count,)))[:, finger] for finger in range(len(FINGERS))], 1)
    apart = random.random((count, len(FINGERS), 1)) < 0.2
    angles = np.where(apart, own, together).reshape(count, len(ANGLES)) + random.normal(scale=np.radians(3), size=(count, len(ANGLES)))
    return np.clip(angles, *LIMITS.T).astype(np.float32)


def at_the_origin(count: int) -> tuple[Array, Array]:
    """Wrists that do not move: positions [count, 3], rotations [count, 4]."""
    return np.zeros((count, 3), np.float32), np.tile(IDENTITY, (count, 1))


def without_self_collision(hand: Hand, angles: Array) -> np.ndarray:
    """bool [N]: fingers do not enter one another by more than TOLERANCE."""
    starts, ends, radii = hand.capsules(angles, *at_the_origin(len(angles)), palm=False)
    points = axis_points(hand, hand.chains(finger_angles(angles)), MEASURING)
    deepest = np.full(len(angles), -np.inf, np.float32)
    for finger in range(len(FINGERS)):
        others = [j for j in range(len(radii)) if j // 3 > finger]
        along = ends[:, others] - starts[:, others]
        offset = points[:, finger, :, None] - starts[:, None, others]
        share = np.clip((offset * along[:, None]).sum(-1) / (along * along).sum(-1)[:, None], 0, 1)
        distance = np.linalg.norm(offset - share[..., None] * along[:, None], axis=-1) - radii[others]
        if others:
            own = np.repeat(hand.radii.reshape(len(FINGERS), -1)[finger], len(MEASURING))
            deepest = np.maximum(deepest, (own[:, None] - distance).max((-1, -2)))
    return deepest < TOLERANCE * hand.length


def make_bank(poses: Array, grid: Grid, count: int, hands: int, seed: int) -> list[HandBank]:
    """`count` poses shared among `hands` hands, the first with standard proportions, the others with fingers and palms of their own."""
    found = []
    for number in range(hands):
        random = np.random.default_rng([seed, number])
        varied = number > 0
        positions = standard_positions("right", 1 + varied * random.normal(scale=0.07, size=(5, 3)), 1 + varied * random.normal(scale=0.06, size=3))
        hand = Hand.from_rest("right", positions)
        thickness = 1 + varied * random.uniform(-0.15, 0.15)
        hand = Hand.from_rest("right", positions, RADII * hand.length * np.float32(thickness))
        angles = interpolated(poses, 2 * count // hands, random)
        angles = angles[without_self_collision(hand, angles)][: count // hands]
        found.append(HandBank(hand, angles, _cell_distances(hand, angles, grid)))
    return found


def _cell_distances(hand: Hand, angles: Array, grid: Grid) -> np.ndarray:
    starts, ends, radii = (values / hand.length for values in hand.capsules(angles, *at_the_origin(len(angles))))
    centres = (grid.centres() @ hand.palm.T).astype(np.float32)
    squares = (centres * centres).sum(-1)[:, None]
    found = np.empty((len(angles), len(centres)), np.uint8)
    for row, (start, along) in enumerate(zip(starts, ends - starts, strict=True)):
        to_start = squares - 2 * centres @ start.T + (start * start).sum(-1)
        length = (along * along).sum(-1)
        forward = centres @ along.T - (start * along).sum(-1)
        share = np.clip(forward / length, 0, 1)
        distances = np.sqrt(np.maximum(to_start + share * (share * length - 2 * forward), 0)) - radii
        found[row] = np.clip(np.round(distances.min(-1) / STEP), 0, 255)
    return found
