"""Motion as poses of a rig's bones: the rotations and locations that Blender keys, relative to each bone's rest."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass

import numpy as np

from ..motion.motion import Motion
from ..motion.rotations import (
    Array,
    continuous,
    continuous_euler,
    euler_from_quat,
    inverse,
    multiply,
    normalize,
    quat_from_axis_angle,
    rotate,
)
from .body import DOWN, OUTWARD, RigBody
from .rig import OWN_ROLL, Control, Rig, next_in_limb


@dataclass(frozen=True)
class BonePose:
    """One keyed bone over T frames.

    lower     it is needed to place hips and legs
    rotation  float64 [T, 4]: relative to the bone's rest, signs continuous
    location  float64 [T, 3]: relative to the bone's rest, armature units; None for a bone that only turns
    """

    bone: str
    lower: bool
    rotation: Array
    location: Array | None


def bone_poses(rig: Rig, rig_body: RigBody, motion: Motion, ways: Collection[str] = ("fk",)) -> Iterator[BonePose]:
    """The poses of the rig's controls that put its bones where `motion` (on rig_body.body, world units) has its joints.

    ways  the kinematics of the limbs, "fk" or "ik", whose controls get poses, of a rig that has both
    Controls of joints that the motion does not have get no pose. Bones that are not controls are taken to be at rest relative to their
    parents.
    """
    joints = motion.skeleton
    world, positions = (values.astype(np.float64) for values in motion.forward())
    turns = multiply(world, rig_body.alignment)  # from the rest pose, world axes
    object_rotation = rig.object_rotation
    armature_turns = multiply(multiply(inverse(object_rotation), turns), object_rotation)
    turn_of: dict[str | None, Array] = {}
    roll_of: dict[str | None, float] = {}
    for control in rig.mapping.controls:
        if control.joint not in joints:
            if control.carrier in turn_of:
                turn_of[control.bone] = turn_of[control.carrier]
            continue
        turn = armature_turns[:, joints.index(control.joint)]
        if control.roll:
            share = control.roll - roll_of.get(control.carrier, 0.0)
            turn = multiply(turn_of.get(control.carrier, turn), _roll(rig, motion, control, share))
        turn_of[control.bone], roll_of[control.bone] = turn, control.roll
        if control.carrier in turn_of:
            turn = multiply(inverse(turn_of[control.carrier]), turn)
        if control.limbs not in ("", *ways):
            continue
        head = None
        if control.anchor is not None:
            beside = rig.head(control.bone) - rig.head(rig.mapping.joints[control.anchor])
            head = positions[:, joints.index(control.anchor)] + rotate(turns[:, joints.index(control.joint)], beside)
        yield placed(rig, control.bone, control.lower, turn, head)


def placed(rig: Rig, bone: str, lower: bool, turn: Array, head: Array | None) -> BonePose:
    """The pose of a bone that is turned from its rest by `turn` [T, 4] (armature axes, as seen from its parent), and whose head is at
    `head` [T, 3] in the world while its parent is at rest; None leaves it where its parent carries it."""
    rest = rig.rest_rotation(bone)
    rotation = continuous(multiply(multiply(inverse(rest), turn), rest))
    if head is None:
        return BonePose(bone, lower, rotation, None)
    frame, parent = rest, rig.parent(bone)
    if not rig.local_location[rig.index(bone)]:
        frame = rig.rest_rotation(parent) if parent else np.array([1.0, 0, 0, 0])
    return BonePose(bone, lower, rotation, rotate(inverse(frame), rig.to_armature(head) - rig.rest[rig.index(bone), :3, 3]))


def _roll(rig: Rig, motion: Motion, control: Control, share: float) -> Array:
    """A share of the roll that a twist bone spreads, [T, 4], about its axis at rest (armature axes): the part of a joint's rotation against
    the one above that is about the bone's length in the T-pose (swing-twist decomposition).

    A bone that carries the next joint turns about the line from itself to that, so that it stays where it is.
    """
    below = next_in_limb(control.joint)
    along = OUTWARD[control.joint.removesuffix("ForeArm").removesuffix("Arm")] if "Arm" in control.joint else DOWN
    rolled = control.joint if control.joint in OWN_ROLL else below
    local = motion.rotations[:, motion.skeleton.index(rolled)].astype(np.float64)
    angle = np.unwrap(2 * np.arctan2(local[:, 1:] @ along, local[:, 0]), period=2 * np.pi)
    angle -= 2 * np.pi * np.round(np.median(angle) / (2 * np.pi))
    limb, end = rig.mapping.joints[control.joint], rig.mapping.joints[below]
    start = control.bone if control.bone in rig.ancestors(end) else limb
    heads = (rig.rest[rig.index(bone), :3, 3] for bone in (start, end))
    axis = normalize(np.subtract(*reversed(list(heads))))
    return quat_from_axis_angle(np.broadcast_to(axis, (len(angle), 3)), share * angle)


def rotation_values(rotation: Array, mode: str) -> tuple[str, Array]:
    """Blender's property for a rotation mode ("QUATERNION", "AXIS_ANGLE" or an Euler order), and its values [T, N] without jumps.

    rotation  [T, 4] with continuous signs
    """
    if mode == "QUATERNION":
        return "rotation_quaternion", rotation
    if mode == "AXIS_ANGLE":
        return "rotation_axis_angle", _angle_and_axis(rotation)
    # Blender names Euler orders by the sequence of fixed axes: its XYZ is the intrinsic ZYX.
    order = mode[::-1]
    angles = continuous_euler(euler_from_quat(rotation, order))
    return "rotation_euler", angles[:, [order.index(axis) for axis in "XYZ"]]


def _angle_and_axis(rotation: Array) -> Array:
    """Angle and axis [T, 4]; the axis never jumps to its opposite."""
    sine = np.linalg.norm(rotation[:, 1:], axis=-1, keepdims=True)
    axis = np.where(sine > 1e-6, rotation[:, 1:] / np.maximum(sine, 1e-6), np.array([0, 1, 0], dtype=rotation.dtype))
    flips = np.sum(axis[1:] * axis[:-1], axis=-1) < 0
    sign = np.where(np.cumsum(np.concatenate(([False], flips))) % 2, -1, 1).astype(rotation.dtype)[:, None]
    angle = 2 * np.arctan2(sine, rotation[:, :1])
    return np.concatenate((np.unwrap(angle * sign, axis=0), axis * sign), axis=-1)
