"""The fingers of a rig's hands: where their joints are at rest, and turns of them as poses of the bones that are keyed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..motion.rotations import Array, continuous, inverse, multiply, normalize, rotate
from .pose import BonePose
from .rig import FINGERS, SIDES, Rig

PHALANGES = (1, 2, 3)
NEEDED = ("Thumb", "Index")  # a hand without one of these has no fingers that could hold something
LAST = 0.8  # length of a last phalanx whose bone does not tell, over that before it
PLAUSIBLE = 0.4, 1.6  # and the lengths that are believed
ALIGNED = 0.7  # cosine between the directions of the last two phalanges


@dataclass(frozen=True)
class FingerBones:
    """The fingers of one hand; joints are in the order of FINGERS and PHALANGES.

    side       "Left" or "Right"
    wrist      the hand's bone, whose head and axes are the wrist's frame
    bones      the bones [15] that play the joints; None for those of fingers that the rig lacks
    controls   the bones [15] that are keyed so that those turn
    positions  float64 [20, 3]: the joints and then the tips at rest in the wrist's frame, world units. A finger that the rig lacks lies in
               the one beside it
    rest       float64 [15, 4]: the bones' rotations at rest in the wrist's frame
    """

    side: str
    wrist: str
    bones: tuple[str | None, ...]
    controls: tuple[str | None, ...]
    positions: Array
    rest: Array

    @property
    def length(self) -> float:
        """From the wrist along the middle finger to its tip, world units."""
        first = 3 * FINGERS.index("Middle")
        way = np.concatenate((np.zeros((1, 3)), self.positions[first : first + 3], self.positions[15 + first // 3][None]))
        return float(np.linalg.norm(np.diff(way, axis=0), axis=-1).sum())

    @property
    def directions(self) -> Array:
        """Unit vectors [15, 3] from each joint to the next or to the tip, at rest in the wrist's frame."""
        chains = np.concatenate((self.positions[:15].reshape(5, 3, 3), self.positions[15:, None]), axis=1)
        return normalize(np.diff(chains, axis=1)).reshape(15, 3)


def finger_bones(rig: Rig, side: str) -> FingerBones:
    """The fingers of the hand on a side of SIDES; InputError if it lacks the thumb or the index finger, or all but these."""
    mapping = rig.mapping
    wrist = mapping.joints[f"{side}Hand"]
    whole = {}
    for finger in FINGERS:
        bones = [mapping.fingers.get(f"{side}Hand{finger}{phalanx}") for phalanx in PHALANGES]
        if all(bones):
            whole[finger] = [str(bone) for bone in bones]
    if len(whole) < 3 or any(finger not in whole for finger in NEEDED):
        there = ", ".join(whole) or "none"
        raise InputError(rig.name, f"has no bones for the fingers of its {side.lower()} hand (whole ones: {there}); name them in a map of its bones")
    keyed = {control.joint: control.bone for control in mapping.controls}
    frame = inverse(rig.rest_rotation(wrist))
    bones: list[str | None] = []
    places, tips, rest = [], [], []
    beside = whole["Thumb"]
    for finger in FINGERS:
        beside = whole.get(finger, beside)
        bones += whole.get(finger, [None] * len(PHALANGES))
        places += [rig.head(bone) for bone in beside]
        tips.append(_tip(rig, *beside[1:]))
        rest += [multiply(frame, rig.rest_rotation(bone)) for bone in beside]
    joints = [f"{side}Hand{finger}{phalanx}" for finger in FINGERS for phalanx in PHALANGES]
    controls = tuple(keyed.get(joint) if bone else None for joint, bone in zip(joints, bones, strict=True))
    world = multiply(rig.object_rotation, rig.rest_rotation(wrist))
    positions = rotate(inverse(world), np.array([*places, *tips]) - rig.head(wrist))
    return FingerBones(side, wrist, tuple(bones), controls, positions, np.array(rest))


def hands_with_fingers(rig: Rig) -> tuple[str, ...]:
    """The sides of the hands whose fingers can be posed."""
    found = []
    for side in SIDES:
        try:
            finger_bones(rig, side)
        except InputError:
            continue
        found.append(side)
    return tuple(found)


def _tip(rig: Rig, second: str, third: str) -> Array:
    """Where a finger ends: at the head of a bone that goes on from its last, or at that bone's own tail; straight on if both point elsewhere."""
    before, start = rig.head(second), rig.head(third)
    along, length = normalize(start - before), np.linalg.norm(start - before)
    for end in (*(rig.head(child) for child in rig.children(third)), rig.tail(third)):
        way = end - start
        if np.dot(normalize(way), along) > ALIGNED and PLAUSIBLE[0] * length < np.linalg.norm(way) < PLAUSIBLE[1] * length:
            return end
    return start + LAST * length * along


def read_before(rig: Rig, fingers: FingerBones) -> tuple[str, ...]:
    """The bones whose rotations `finger_turns` and `finger_poses` ask for."""
    keyed = [bone for bone in fingers.controls if bone]
    parents = [parent for bone in keyed if (parent := rig.parent(bone))]
    return tuple(dict.fromkeys([fingers.wrist, *(bone for bone in fingers.bones if bone), *keyed, *parents]))


def finger_turns(fingers: FingerBones, rotations: Mapping[str, Array]) -> Array:
    """How far the joints are turned from rest in the wrist's frame, [T, 15, 4], if bones have rotations [T, 4] in the armature.

    A finger that the rig lacks turns as the one beside it.
    """
    wrist = inverse(rotations[fingers.wrist])
    turns: list[Array] = []
    for joint, bone in enumerate(fingers.bones):
        turns.append(multiply(multiply(wrist, rotations[bone]), inverse(fingers.rest[joint])) if bone else turns[joint - len(PHALANGES)])
    return np.stack(turns, axis=1)


def finger_poses(rig: Rig, fingers: FingerBones, turns: Array, rotations: Mapping[str, Array]) -> Iterator[BonePose]:
    """The poses of the controls with which the joints are turned by `turns` [T, 15, 4] from rest in the wrist's frame.

    rotations  of the bones of `read_before` in the armature [T, 4], under whatever poses the fingers now. What is between the keyed bones
               (helpers that a rig drives with controls of its own) is taken to go on moving with the keyed bone that carries it
    """
    goals: dict[str, Array] = {}
    for joint, (bone, control) in enumerate(zip(fingers.bones, fingers.controls, strict=True)):
        if bone is None or control is None:
            continue
        rest = rig.rest_rotation(control)
        goal = multiply(rotations[fingers.wrist], multiply(turns[:, joint], fingers.rest[joint]))
        goal = multiply(goal, multiply(inverse(rig.rest_rotation(bone)), rest))
        frame, parent = rest, rig.parent(control)
        if parent and rig.inherits_rotation[rig.index(control)]:
            carrier = next((above for above in rig.ancestors(control) if above in goals), None)
            now = rotations[parent]
            if carrier:
                now = multiply(multiply(goals[carrier], inverse(rotations[carrier])), now)
            frame = multiply(now, multiply(inverse(rig.rest_rotation(parent)), rest))
        goals[control] = goal
        yield BonePose(control, False, continuous(normalize(multiply(inverse(frame), goal))), None)
