"""Hips and ankles that agree: legs no longer than they are, and no knee that snaps straight.

Hips and ankles are predicted each by itself, so that in up to every fifth frame of a walk they are farther apart than the leg is long. Whatever brings them
together must come and go gently: near its full length a leg turns a millimetre of hips into five of knee.
"""

from __future__ import annotations

import numpy as np

from ..motion.rotations import Array, rotate
from ..motion.skeleton import Skeleton
from .ik import REACH, clamp_reach

SOFT = 0.015  # of its length: a leg that is nearer than that to straight straightens ever more slowly
SHARE = 0.3  # the least share of what a leg is too short by that the hips take; the ankle takes the rest
ROUNDS = 3  # in which the legs are brought within reach by turns


def within_reach(
    body: Skeleton, world: Array, hips: Array, head: Array, ankles: dict[str, Array], standing: dict[str, Array]
) -> tuple[Array, dict[str, Array]]:
    """Hips [T, 3] and ankles ([T, 3] by side) moved as little as needed for the spine to reach the head [T, 3] and the legs the ankles.

    The head comes first. Between hips and ankle the ankle moves, the less the likelier its foot stands, `standing` [T] by side, 0 to 1. Nothing depends
    on other frames. Where the head or two standing feet leave no way, a leg stays too short.
    """
    chain = body.chain("Hips", "Head")
    spine = float(np.linalg.norm(body.offsets[chain[1:]], axis=-1).sum())
    ankles = dict(ankles)
    for _ in range(ROUNDS):
        for side in ankles:
            leg = body.chain("Hips", f"{side}Foot")
            socket = rotate(world[:, leg[0]], body.offsets[leg[1]])
            length = float(np.linalg.norm(body.offsets[leg[2:]], axis=-1).sum())
            nearer = _too_far(hips + socket - ankles[side], length)
            share = np.maximum(standing[side], np.float32(SHARE))[:, None]
            hips, ankles[side] = hips - share * nearer, ankles[side] + (1 - share) * nearer
        hips = clamp_reach(head, hips, spine)
    return hips, ankles


def _too_far(leg: Array, length: float) -> Array:
    """By how much legs [T, 3], from ankle to hip joint, are longer than a leg of `length` is, along them; smoothly from 1 - SOFT of it on."""
    distance = np.linalg.norm(leg, axis=-1, keepdims=True)
    limit, soft = np.float32(REACH * length), np.float32(SOFT * REACH * length)
    beyond = np.maximum(distance - (limit - soft), 0)
    spanned = np.where(beyond > 0, limit - soft * np.exp(-beyond / soft), distance)
    return leg * ((distance - spanned) / np.maximum(distance, 1e-9))
