"""Motion as poses of a rig's bones: the rotations and locations that Blender keys, relative to each bone's rest."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..motion.motion import Motion
from ..motion.rotations import Array, continuous, continuous_euler, euler_from_quat, inverse, multiply, quat_from_matrix, rotate
from .body import RigBody
from .rig import Control, Rig


@dataclass(frozen=True)
class BonePose:
    """One keyed bone over T frames.

    control   which bone, and what it follows
    rotation  float64 [T, 4]: relative to the bone's rest, signs continuous
    location  float64 [T, 3]: relative to the bone's rest, armature units; None for a bone that only turns
    """

    control: Control
    rotation: Array
    location: Array | None


def bone_poses(rig: Rig, rig_body: RigBody, motion: Motion) -> Iterator[BonePose]:
    """The poses of the rig's controls that put its bones where `motion` (on rig_body.body, world units) has its joints.

    Bones that are not controls are taken to be at rest relative to their parents.
    """
    joints = motion.skeleton
    world, positions = (values.astype(np.float64) for values in motion.forward())
    turns = multiply(world, rig_body.alignment)  # from the rest pose, world axes
    object_rotation = rig.object_rotation
    armature_turns = multiply(multiply(inverse(object_rotation), turns), object_rotation)
    for control in rig.mapping.controls:
        bone = rig.index(control.bone)
        rest = quat_from_matrix(rig.rest[bone, :3, :3])
        turn = armature_turns[:, joints.index(control.joint)]
        if control.carrier is not None and rig.inherits_rotation[bone]:
            turn = multiply(inverse(armature_turns[:, joints.index(control.carrier)]), turn)
        rotation = continuous(multiply(multiply(inverse(rest), turn), rest))
        location = None
        if control.anchor is not None:
            beside = rig.head(control.bone) - rig.head(rig.mapping.joints[control.anchor])
            head = positions[:, joints.index(control.anchor)] + rotate(turns[:, joints.index(control.joint)], beside)
            location = rotate(inverse(rest), rig.to_armature(head) - rig.rest[bone, :3, 3])
        yield BonePose(control, rotation, location)


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
