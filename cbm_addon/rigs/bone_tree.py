"""The bones of an armature at rest as a tree of points in the world."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ..motion.rotations import Array, normalize
from .rig import Bones

EVEN = 0.15  # how far apart in height the ends of two chains side by side may be, as a share of their length
ALIKE = 0.75  # and how long the shorter of them is at least, as a share of the longer


@dataclass(frozen=True)
class Pair:
    """Two chains side by side: the bone that they hang off, and the bones of each, the first of them a child of it."""

    parent: int
    chains: tuple[list[int], list[int]]

    def swapped(self) -> Pair:
        return Pair(self.parent, (self.chains[1], self.chains[0]))


class BoneTree:
    """Bones by their index; B bones.

    heads, tails  [B, 3]: world
    reach         [B]: length of the longest chain below a bone
    top           [B]: the greatest height of a head in the branch that begins with a bone
    """

    def __init__(self, bones: Bones) -> None:
        self.parents = bones.parents
        self.heads = bones.to_world(bones.rest[:, :3, 3])
        self.tails = bones.to_world(bones.rest[:, :3, 3] + bones.rest[:, :3, 1] * bones.lengths[:, None])
        self.children: list[list[int]] = [[] for _ in bones.bones]
        self.reach, self.top = np.zeros(len(bones.bones)), self.heads[:, 2].copy()
        for bone, parent in reversed(list(enumerate(self.parents))):
            if parent >= 0:
                self.children[parent].insert(0, bone)
                self.reach[parent] = max(self.reach[parent], self.reach[bone] + self.distance(bone, parent))
                self.top[parent] = max(self.top[parent], self.top[bone])

    def distance(self, a: int, b: int) -> float:
        return float(np.linalg.norm(self.heads[a] - self.heads[b]))

    def longest(self, bone: int) -> list[int]:
        """The longest chain that begins with a bone."""
        chain = [bone]
        while below := self.children[chain[-1]]:
            chain.append(max(below, key=lambda child: self.reach[child] + self.distance(child, chain[-1])))
        return chain

    def down_to(self, bone: int) -> list[int]:
        """From the topmost bone above a bone down to it."""
        chain = [bone]
        while self.parents[chain[-1]] >= 0:
            chain.append(int(self.parents[chain[-1]]))
        return chain[::-1]

    def shared(self, a: int, b: int) -> list[int]:
        """The bones that are above both or one of them, the topmost first."""
        return [x for x, y in zip(self.down_to(a), self.down_to(b), strict=False) if x == y]

    def branches(self, bone: int) -> int:
        """How many of a bone's children have children themselves."""
        return sum(bool(self.children[child]) for child in self.children[bone])

    def pairs(self) -> Iterator[Pair]:
        """Chains of three bones or more and of about the same length that hang off one bone and end at about the same height, apart."""
        for parent, children in enumerate(self.children):
            chains = [chain for chain in (self.longest(child) for child in children) if len(chain) >= 3]
            for first, second in combinations(chains, 2):
                lengths = [self.reach[chain[0]] + self.distance(chain[0], parent) for chain in (first, second)]
                apart = self.heads[first[-1]] - self.heads[second[-1]]
                if min(lengths) > ALIKE * max(lengths) and abs(apart[2]) < EVEN * max(lengths) and np.linalg.norm(apart[:2]) > 0.02 * max(lengths):
                    yield Pair(parent, (first, second))

    def across(self, pair: Pair) -> Array:
        """Horizontal direction [3] from the second chain of a pair to the first."""
        first, second = (self.heads[chain].mean(axis=0) for chain in pair.chains)
        return normalize((first - second) * [1, 1, 0])

    def beside(self, pair: Pair, which: int) -> Array:
        """How far the bones of a chain are from the plane half-way between it and the other one."""
        middle = sum(self.heads[chain].mean(axis=0) for chain in pair.chains) / 2
        return np.abs((self.heads[pair.chains[which]] - middle) @ self.across(pair))
