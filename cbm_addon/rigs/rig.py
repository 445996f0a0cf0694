"""Rigs: the bones of an armature at rest, and which of them play the joints of a body."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..motion.rotations import quat_from_matrix


@dataclass(frozen=True)
class Control:
    """A bone that is keyed. It turns rigidly with `joint`, while its parent is carried by `carrier`.

    joint    the body joint whose rotation it takes
    carrier  the body joint that carries the bone's parent; None where the parent stays at rest
    anchor   the body joint beside which the bone stays, for a bone that is also moved; None for one that only turns
    lower    it is needed to place hips and legs
    """

    bone: str
    joint: str
    carrier: str | None
    anchor: str | None
    lower: bool


@dataclass(frozen=True)
class Setting:
    """A custom property of a bone that the controls rely on, and the value that it must have."""

    bone: str
    name: str
    value: float
    lower: bool


@dataclass(frozen=True)
class Mapping:
    """How an armature's bones play a body.

    kind      the recognition table that fits: "rigify_generated", "rigify_metarig", "mocap"
    joints    body joint -> bone whose head is that joint, parents first
    parents   body joint -> the joint above it on this rig; None for the hips
    controls  the bones that are keyed, parents first
    settings  custom properties that are keyed with them
    """

    kind: str
    joints: dict[str, str]
    parents: dict[str, str | None]
    controls: tuple[Control, ...]
    settings: tuple[Setting, ...] = ()


@dataclass(frozen=True)
class Rig:
    """An armature at rest, as the engine sees it; B bones.

    bones              names, parents first
    parents            int [B]; -1 for none
    rest               float64 [B, 4, 4]: rest matrices in armature space (head at the origin of a bone, tail along its Y)
    lengths            float64 [B]: from head to tail, armature units
    inherits_rotation  bool [B]
    object_matrix      float64 [4, 4]: armature space to the world; rotation, uniform scale, translation
    """

    name: str
    bones: tuple[str, ...]
    parents: np.ndarray
    rest: np.ndarray
    lengths: np.ndarray
    inherits_rotation: np.ndarray
    object_matrix: np.ndarray
    mapping: Mapping

    @cached_property
    def _indices(self) -> dict[str, int]:
        return {name: i for i, name in enumerate(self.bones)}

    def index(self, bone: str) -> int:
        return self._indices[bone]

    @property
    def scale(self) -> float:
        """World units per armature unit."""
        return float(np.cbrt(np.linalg.det(self.object_matrix[:3, :3])))

    @property
    def object_rotation(self) -> np.ndarray:
        """The armature object's world rotation, a quaternion float64 [4]."""
        return quat_from_matrix(self.object_matrix[:3, :3] / self.scale)

    def to_world(self, points: np.ndarray) -> np.ndarray:
        """Armature-space points [..., 3] in the world."""
        return points @ self.object_matrix[:3, :3].T + self.object_matrix[:3, 3]

    def to_armature(self, points: np.ndarray) -> np.ndarray:
        """World points [..., 3] in armature space."""
        return (points - self.object_matrix[:3, 3]) @ np.linalg.inv(self.object_matrix[:3, :3]).T

    def head(self, bone: str) -> np.ndarray:
        """World position of a bone's head at rest."""
        return self.to_world(self.rest[self.index(bone), :3, 3])

    def tail(self, bone: str) -> np.ndarray:
        """World position of a bone's tail at rest."""
        i = self.index(bone)
        return self.to_world(self.rest[i, :3, 3] + self.rest[i, :3, 1] * self.lengths[i])

    def children(self, bone: str) -> list[str]:
        return [self.bones[i] for i in np.flatnonzero(self.parents == self.index(bone))]
