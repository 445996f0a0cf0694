"""The joints of a body between hips, head and hands, and where they are carried."""

from __future__ import annotations

from itertools import pairwise

from ..motion.rotations import Array, rotate, slerp
from ..motion.skeleton import Skeleton, chest_of


def with_neck(body: Skeleton, world: Array, head: Array) -> Array:
    """World rotations [T, J, 4] with the joints between the chest and the head half-way between the two; head [T, 4]."""
    turned, chain = world.copy(), body.chain("Hips", "Head")[1:-1]
    chest = chest_of(body)
    for joint in chain[chain.index(chest) + 1 :]:
        turned[:, joint] = slerp(world[:, chest], head, 0.5)
    return turned


def carried(body: Skeleton, world: Array, hips: Array, chain: list[int]) -> Array:
    """World position [T, 3] of the last joint of a chain of joint indices that begins at the hips."""
    position = hips
    for parent, joint in pairwise(chain):
        position = position + rotate(world[:, parent], body.offsets[joint])
    return position
