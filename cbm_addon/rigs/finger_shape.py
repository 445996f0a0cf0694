"""The fingers of a hand whose bones have names that say nothing: chains below it, told apart by where they are."""

from __future__ import annotations

import numpy as np

from ..motion.rotations import Array, normalize
from .bone_tree import BoneTree
from .rig import FINGERS

METACARPAL = 0.6  # a chain whose first bone begins nearer to the wrist than this share of the way to its second begins in the palm


def finger_chains(tree: BoneTree, hand: int) -> dict[str, list[int]]:
    """The three bones of each finger that is found below the bone of a hand, by the names of FINGERS; none if it has no thumb and two fingers.

    The thumb is the chain that leaves the others' direction most. The others follow in the order in which they stand beside it; of a
    hand with fewer of them those that it lacks are the last.
    """
    chains = [chain for chain in map(tree.longest, tree.children[hand]) if len(chain) >= 3]
    if not 3 <= len(chains) <= len(FINGERS):
        return {}
    directions = np.array([normalize(tree.heads[chain[2]] - tree.heads[chain[0]]) for chain in chains])
    thumb = int(np.argmin(directions @ directions.sum(axis=0)))
    bare = [chain[_in_palm(tree, hand, chain) :] for i, chain in enumerate(chains) if i != thumb]
    has_ends = min(map(len, bare)) > 3
    bare.insert(thumb, chains[thumb][0 if has_ends else -3 :])  # its own base is where others have their palm's bone, so that those tell
    chains = [chain[:3] for chain in bare]
    along = normalize(np.delete(directions, thumb, axis=0).sum(axis=0))
    beside = np.array([_off(tree.heads[chain[0]] - tree.heads[chains[thumb][0]], along) for chain in chains])
    order = sorted((i for i in range(len(chains)) if i != thumb), key=lambda i: beside[i])
    return dict(zip(FINGERS, [chains[thumb], *(chains[i] for i in order)], strict=False))


def _off(way: Array, along: Array) -> float:
    """How far a way leads off a direction."""
    return float(np.linalg.norm(way - np.dot(way, along) * along))


def _in_palm(tree: BoneTree, hand: int, chain: list[int]) -> bool:
    """Whether a finger's chain begins with a bone of the palm."""
    wrist, first, second = tree.heads[hand], tree.heads[chain[0]], tree.heads[chain[1]]
    return len(chain) > 3 and bool(np.linalg.norm(first - wrist) < METACARPAL * np.linalg.norm(second - wrist))
