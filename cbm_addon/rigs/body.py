"""A rig's own proportions as a body that the engine can solve for."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from ..features import proportions_of
from ..motion.rotations import Array, multiply, quat_between, quat_from_yaw, rotate
from ..motion.skeleton import Skeleton
from .rig import SIDES, Mapping, Rig

OUTWARD = {"Left": np.array([1.0, 0, 0]), "Right": np.array([-1.0, 0, 0])}
DOWN = np.array([0.0, 0, -1])
STRAIGHTENED = np.radians(45)  # a hand that leaves its forearm by more than this has a bone that says nothing of the hand's direction
PLAUSIBLE_SOLE = 0.1  # share of the head's height up to which toes may be above the floor


@dataclass(frozen=True)
class RigBody:
    """A rig as a body in the T-pose that faces -Y; J joints.

    body       its joints are the rig's mapped ones, its lengths world units
    alignment  float64 [J, 4]: world rotations that take the bones from the rig's rest pose to the T-pose, so that the world rotation of a
               bone is (world rotation of its joint) * alignment * (world rotation of the bone at rest)
    sole       world units: height of the toe joints above the floor on which the rig stands at rest
    """

    body: Skeleton
    alignment: Array
    sole: float

    @property
    def proportions(self) -> Array:
        """What the networks see of the rig (features.PROPORTIONS)."""
        return proportions_of(self.body, self.sole)


def rig_body(rig: Rig, fingers: Collection[str] = ()) -> RigBody:
    """The body whose joints are where the rig's bones have their heads, whatever the pose: bones between mapped ones stay at rest.

    fingers  which finger joints it has besides those of the body, as far as the rig has them
    """
    fingers = {joint: bone for joint, bone in rig.mapping.fingers.items() if joint in fingers}
    joints = rig.mapping.joints | fingers
    above = rig.mapping.parents | _above_fingers(rig.mapping, fingers)
    names = tuple(joints)
    alignment = _alignment(rig, fingers, above)
    parents = np.full(len(names), -1)
    offsets, tips = np.zeros((len(names), 3)), np.full((len(names), 3), np.nan)
    for i, name in enumerate(names):
        parent = above[name]
        if parent is not None:
            parents[i] = names.index(parent)
            offsets[i] = rotate(alignment[parent], rig.head(joints[name]) - rig.head(joints[parent]))
        if name not in above.values():
            tips[i] = rotate(alignment[name], rig.tail(joints[name]) - rig.head(joints[name]))
    body = Skeleton(names, parents, offsets.astype(np.float32), tips.astype(np.float32))
    return RigBody(body, np.stack([alignment[name] for name in names]), _sole(rig))


def _above_fingers(mapping: Mapping, fingers: dict[str, str]) -> dict[str, str | None]:
    """Finger joint -> the one before it, or the hand."""
    before = {joint: [f"{joint[:-1]}{phalanx}" for phalanx in range(int(joint[-1]) - 1, 0, -1)] for joint in fingers}
    return {joint: next((name for name in before[joint] if name in fingers), joint[: joint.index("Hand") + 4]) for joint in fingers}


def _alignment(rig: Rig, fingers: dict[str, str], above: dict[str, str | None]) -> dict[str, Array]:
    """World rotations [4] of every joint from the rest pose to the T-pose: arms and fingers along X and legs along -Z by the shortest arc,
    feet turned only about Z so that soles stay flat, the trunk upright as it is."""
    joints = rig.mapping.joints
    heads = {joint: rig.head(bone) for joint, bone in joints.items()}
    across = np.sum([heads[f"Left{name}"] - heads[f"Right{name}"] for name in ("UpLeg", "Arm")], axis=0)
    facing = quat_from_yaw(-np.arctan2(across[1], across[0]))
    alignment = dict.fromkeys(joints, facing)

    def turned(start: Array, along: Array, goal: Array) -> Array:
        return multiply(quat_between(rotate(start, along), goal), start)

    for side in SIDES:
        arm, forearm, hand, thigh, shin, foot = (f"{side}{name}" for name in ("Arm", "ForeArm", "Hand", "UpLeg", "Leg", "Foot"))
        alignment[arm] = turned(facing, heads[forearm] - heads[arm], OUTWARD[side])
        alignment[forearm] = turned(facing, heads[hand] - heads[forearm], OUTWARD[side])
        alignment[hand] = _continued(alignment[forearm], _hand_direction(rig, joints[hand]), OUTWARD[side])
        alignment[thigh] = turned(facing, heads[shin] - heads[thigh], DOWN)
        alignment[shin] = turned(facing, heads[foot] - heads[shin], DOWN)
        toe = f"{side}Toe"
        pointing = heads[toe] if toe in joints else rig.tail(joints[foot])
        along = rotate(facing, pointing - heads[foot])
        alignment[foot] = multiply(quat_from_yaw(-np.arctan2(along[0], -along[1])), facing)
        if toe in joints:
            alignment[toe] = alignment[foot]
    for joint, bone in fingers.items():
        following = [rig.head(fingers[name]) for name, parent in above.items() if parent == joint]
        along = (following[0] if following else rig.tail(bone)) - rig.head(bone)
        alignment[joint] = turned(alignment[str(above[joint])], along, OUTWARD[joint.split("Hand")[0]])
    return alignment


def _hand_direction(rig: Rig, hand: str) -> Array:
    """From the wrist toward the fingers: the middle of the bones below the hand, or the hand's own tail."""
    children = rig.children(hand)
    end = np.mean([rig.head(child) for child in children], axis=0) if children else rig.tail(hand)
    return end - rig.head(hand)


def _continued(forearm: Array, along: Array, goal: Array) -> Array:
    """The forearm's alignment with the hand's own small bend straightened."""
    bend = quat_between(rotate(forearm, along), goal)
    straight = 2 * np.arccos(np.clip(bend[0], -1, 1)) < STRAIGHTENED and np.linalg.norm(along) > 0
    return multiply(bend, forearm) if straight else forearm


def _sole(rig: Rig) -> float:
    """Height of the lower toe joint (the ankle of a rig without toes) above the floor. The floor is the armature's own origin where its
    feet stand there, else the lowest end of the bones of the feet."""
    joints = rig.mapping.joints
    feet = [f"{side}Foot" for side in SIDES]
    toes = [joints.get(f"{side}Toe", joints[f"{side}Foot"]) for side in SIDES]
    toe = min(rig.head(bone)[2] for bone in toes)
    above_origin = toe - rig.object_matrix[2, 3]
    if 0 <= above_origin <= PLAUSIBLE_SOLE * (rig.head(joints["Head"])[2] - toe):
        return float(above_origin)
    ends = [rig.tail(bone)[2] for foot in feet for bone in (joints[foot], *rig.children(joints[foot]))]
    return float(max(0.0, toe - min(ends)))
