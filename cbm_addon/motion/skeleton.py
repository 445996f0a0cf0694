"""Skeletons: names, hierarchy and rest offsets; the standard body of the engine."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from .rotations import Array

# The 22 joints that the engine solves for, parents first. The neck carries the shoulders: it is the upper chest.
BODY_JOINTS = (
    "Hips", "Spine", "Spine1", "Spine2", "Neck", "Head",
    "LeftShoulder", "LeftArm", "LeftForeArm", "LeftHand",
    "RightShoulder", "RightArm", "RightForeArm", "RightHand",
    "LeftUpLeg", "LeftLeg", "LeftFoot", "LeftToe",
    "RightUpLeg", "RightLeg", "RightFoot", "RightToe",
)  # fmt: skip
BODY_PARENTS = (-1, 0, 1, 2, 3, 4, 4, 6, 7, 8, 4, 10, 11, 12, 0, 14, 15, 16, 0, 18, 19, 20)


@dataclass(frozen=True)
class Skeleton:
    """A hierarchy of joints, parents before children.

    names    J joint names
    parents  int [J]; -1 for a root
    offsets  float32 [J, 3], metres: each joint in its parent's frame at rest (all rotations identity)
    tips     float32 [J, 3], metres: where the bone of a leaf joint ends, in the joint's frame; NaN where unknown
    """

    names: tuple[str, ...]
    parents: np.ndarray
    offsets: Array
    tips: Array

    def __len__(self) -> int:
        return len(self.names)

    @cached_property
    def _indices(self) -> dict[str, int]:
        return {name: i for i, name in enumerate(self.names)}

    def __contains__(self, name: str) -> bool:
        return name in self._indices

    def index(self, name: str) -> int:
        """The position of a joint; KeyError if there is none of that name."""
        return self._indices[name]

    def indices(self, names: tuple[str, ...] | list[str]) -> np.ndarray:
        return np.array([self._indices[name] for name in names])

    def chain(self, start: str, end: str) -> list[int]:
        """Joint indices from `start` down to its descendant `end`, both included; ValueError if `end` is not below `start`."""
        path = [self.index(end)]
        while self.names[path[-1]] != start:
            if self.parents[path[-1]] < 0:
                raise ValueError(f"{end} is not below {start}")
            path.append(int(self.parents[path[-1]]))
        return path[::-1]

    def rest_positions(self) -> Array:
        """World positions at rest [J, 3], the root's own offset included."""
        positions = self.offsets.copy()
        for joint, parent in enumerate(self.parents):
            if parent >= 0:
                positions[joint] += positions[parent]
        return positions

    def scaled(self, factor: float) -> Skeleton:
        """The same body, larger or smaller."""
        return replace(self, offsets=self.offsets * np.float32(factor), tips=self.tips * np.float32(factor))

    def subset(self, names: tuple[str, ...]) -> Skeleton:
        """The skeleton of these joints alone, in this order (parents first); a joint hangs off its nearest ancestor that is kept."""
        rest, kept = self.rest_positions(), self.indices(names)
        parents = []
        for joint in kept:
            parent = int(self.parents[joint])
            while parent >= 0 and parent not in kept:
                parent = int(self.parents[parent])
            parents.append(names.index(self.names[parent]) if parent >= 0 else -1)
        offsets = np.stack([rest[joint] - (rest[kept[parent]] if parent >= 0 else 0) for joint, parent in zip(kept, parents, strict=True)])
        return Skeleton(names, np.array(parents), offsets.astype(np.float32), self.tips[kept])

    def height_above_toes(self, joint: str = "Head") -> float:
        """Rest height of a joint above the lowest of the toe and foot joints, metres.

        Of the head: the size that the engine normalises by. Some skeletons rest with their toes pulled up above their ankles, and none stands so.
        """
        rest = self.rest_positions()
        lowest = min(rest[self.index(name), 2] for side in ("Left", "Right") for name in (f"{side}Toe", f"{side}Foot") if name in self)
        return float(rest[self.index(joint), 2] - lowest)


def chest_of(body: Skeleton) -> int:
    """The joint that carries the shoulders."""
    return int(body.parents[body.index("LeftShoulder" if "LeftShoulder" in body else "LeftArm")])


def _standard_body() -> Skeleton:
    """A body of 1.75 m in the T-pose that faces -Y, hips at the origin; segment lengths after Drillis and Contini (1966), as shares of stature."""
    stature = 1.75
    left = {
        "Hips": (0, 0, 0),
        "Spine": (0, 0.003, 0.066),
        "Spine1": (0, 0, 0.086),
        "Spine2": (0, 0, 0.086),
        "Neck": (0, -0.006, 0.112),
        "Head": (0, 0, 0.042),
        "LeftShoulder": (0.041, -0.004, -0.035),
        "LeftArm": (0.078, 0, 0),
        "LeftForeArm": (0.163, 0, 0),
        "LeftHand": (0.148, 0, 0),
        "LeftUpLeg": (0.051, 0.003, 0),
        "LeftLeg": (0, 0, -0.232),
        "LeftFoot": (0, 0, -0.231),
        "LeftToe": (0, -0.073, -0.052),
    }
    tips = {"Head": (0, -0.02, 0.093), "LeftHand": (0.104, 0, 0), "LeftToe": (0, -0.04, 0)}
    mirror = np.array([-1, 1, 1])

    def place(table: dict[str, tuple[float, float, float]], name: str) -> Array:
        if name in table:
            return np.array(table[name])
        twin = name.replace("Right", "Left")
        return np.array(table[twin]) * mirror if name.startswith("Right") and twin in table else np.full(3, np.nan)

    return Skeleton(
        names=BODY_JOINTS,
        parents=np.array(BODY_PARENTS),
        offsets=(stature * np.stack([place(left, name) for name in BODY_JOINTS])).astype(np.float32),
        tips=(stature * np.stack([place(tips, name) for name in BODY_JOINTS])).astype(np.float32),
    )


STANDARD_STATURE = 1.75
STANDARD_BODY = _standard_body()


def standard_body(stature: float = STANDARD_STATURE) -> Skeleton:
    """The engine's body for a person of that stature (top of the head above the floor, metres)."""
    return STANDARD_BODY.scaled(stature / STANDARD_STATURE)
