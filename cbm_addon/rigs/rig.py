"""Rigs: the bones of an armature at rest, and which of them play the joints of a body."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ..motion.rotations import quat_from_matrix

if TYPE_CHECKING:
    from .tables import Table

SIDES = ("Left", "Right")
FINGERS = ("Thumb", "Index", "Middle", "Ring", "Pinky")
FINGER_JOINTS = tuple(f"{side}Hand{finger}{phalanx}" for side in SIDES for finger in FINGERS for phalanx in (1, 2, 3))


LIMBS = (("Arm", "ForeArm", "Hand"), ("UpLeg", "Leg", "Foot"))  # names of joints without their side
OWN_ROLL = tuple(f"{side}{upper}" for side in SIDES for upper, *_ in LIMBS)  # joints whose twist bones spread their own roll


def next_in_limb(joint: str) -> str:
    """The joint below an upper arm, forearm, thigh or shin."""
    side = next(side for side in SIDES if joint.startswith(side))
    return next(side + below for limb in LIMBS for above, below in pairwise(limb) if side + above == joint)


@dataclass(frozen=True)
class Control:
    """A bone that is keyed. It turns rigidly with `joint`, while its parent is carried by the bone `carrier`.

    joint    the joint whose rotation it takes
    carrier  the keyed bone that carries the bone's parent; None where the parent stays at rest or its rotation is not inherited
    anchor   the body joint beside which the bone stays, for a bone that is also moved; None for one that only turns
    lower    it is needed to place hips and legs
    roll     share of a roll that a twist bone takes on top of its joint's rotation: of the hand's or the foot's in forearm and shin; in upper arm
             and thigh of the joint's own, taken back (negative), as that must be less toward the shoulder and the hip
    limbs    "fk" or "ik" of a control of those kinematics of a limb
    """

    bone: str
    joint: str
    carrier: str | None
    anchor: str | None
    lower: bool
    roll: float = 0.0
    limbs: str = ""


@dataclass(frozen=True)
class Pole:
    """A bone toward which the rig's own inverse kinematics bend a limb; `joint` is where that bends, its knee or elbow."""

    bone: str
    joint: str
    lower: bool


@dataclass(frozen=True)
class Setting:
    """A property of a bone, custom or its own, that the controls (with `limbs`: those of "fk" or "ik") rely on, and the value that it must have."""

    bone: str
    name: str
    value: float
    lower: bool
    limbs: str = ""


@dataclass(frozen=True)
class Mapping:
    """How an armature's bones play a body.

    table     the recognition table that fits, with the names of this armature's bones
    joints    body joint -> bone whose head is that joint, parents first
    fingers   finger joint -> bone, of FINGER_JOINTS
    parents   body joint -> the joint above it on this rig; None for the hips
    controls  the bones that are keyed, parents first
    settings  custom properties that are keyed with them
    poles     what limbs bend toward if the rig's own inverse kinematics move them; none if those are not known
    root      the bone above all of them that may carry the way over the ground; None if the hips have nothing above them
    """

    table: Table
    joints: dict[str, str]
    fingers: dict[str, str]
    parents: dict[str, str | None]
    controls: tuple[Control, ...]
    settings: tuple[Setting, ...] = ()
    poles: tuple[Pole, ...] = ()
    root: str | None = None

    @property
    def kind(self) -> str:
        """Name of the table: "mixamo", "rigify_generated", "shape" ..."""
        return self.table.kind


@dataclass(frozen=True)
class Bones:
    """An armature at rest, as the engine sees it; B bones.

    bones              names, parents first
    parents            int [B]; -1 for none
    rest               float64 [B, 4, 4]: rest matrices in armature space (head at the origin of a bone, tail along its Y)
    lengths            float64 [B]: from head to tail, armature units
    inherits_rotation  bool [B]
    local_location     bool [B]: the bone's location is along its own axes at rest, else along its parent's (along the armature's, without one)
    constrained        bool [B]: something else than its own keys moves the bone
    object_matrix      float64 [4, 4]: armature space to the world; rotation, uniform scale, translation
    """

    name: str
    bones: tuple[str, ...]
    parents: np.ndarray
    rest: np.ndarray
    lengths: np.ndarray
    inherits_rotation: np.ndarray
    local_location: np.ndarray
    constrained: np.ndarray
    object_matrix: np.ndarray

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

    def rest_rotation(self, bone: str) -> np.ndarray:
        """A bone's rotation at rest in armature space, a quaternion float64 [4]."""
        return quat_from_matrix(self.rest[self.index(bone), :3, :3])

    def head(self, bone: str) -> np.ndarray:
        """World position of a bone's head at rest."""
        return self.to_world(self.rest[self.index(bone), :3, 3])

    def tail(self, bone: str) -> np.ndarray:
        """World position of a bone's tail at rest."""
        i = self.index(bone)
        return self.to_world(self.rest[i, :3, 3] + self.rest[i, :3, 1] * self.lengths[i])

    def parent(self, bone: str) -> str | None:
        above = int(self.parents[self.index(bone)])
        return self.bones[above] if above >= 0 else None

    def ancestors(self, bone: str) -> list[str]:
        """The bones above, the nearest first."""
        above = []
        while (parent := self.parent(bone)) is not None:
            above.append(parent)
            bone = parent
        return above

    def children(self, bone: str) -> list[str]:
        return [self.bones[i] for i in np.flatnonzero(self.parents == self.index(bone))]


@dataclass(frozen=True)
class Rig(Bones):
    """An armature whose bones are known to play a body."""

    mapping: Mapping
