"""Limbs through a rig's own inverse kinematics: they bend as hinges do, and a pole says to which side.

A two-bone chain with a pole has no choice left: its bones turn about their X axes alone, and those are perpendicular to the plane of the
limb. What a body does beyond that, a roll of the thigh against the plane of the leg, only forward kinematics can show. A limb that is keyed
both ways is therefore turned first as its inverse kinematics turns it, so that the two agree.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Literal

import numpy as np

from ..errors import InputError
from ..motion.motion import Motion, local_rotations
from ..motion.rotations import IDENTITY, Array, across, continuous, inverse, matrix_from_quat, multiply, normalize, quat_from_matrix, rotate
from .body import RigBody
from .pose import BonePose, placed
from .rig import Pole, Rig, Setting, next_in_limb

Limbs = Literal["fk", "ik", "both"]
LIMBS: tuple[Limbs, ...] = ("fk", "ik", "both")
STRAIGHT = 0.005  # sine of a bend that is too small to say in which plane a limb lies: its roll says so then. The elbow is within 1 mm of the line


def ways(limbs: Limbs) -> tuple[str, ...]:
    """Which kinematics are keyed, that which the rig is switched to the last."""
    return ("fk", "ik") if limbs == "both" else (limbs,)


def require_limbs(rig: Rig, limbs: Limbs) -> None:
    """InputError if the limbs of a rig cannot be keyed that way."""
    if limbs != "fk" and not rig.mapping.poles:
        raise InputError(rig.name, f"is {rig.mapping.table.title}, of which no inverse kinematics are known; key its limbs with fk")


def limb_settings(rig: Rig, limbs: Limbs) -> list[Setting]:
    """The custom properties that the keyed kinematics rely on."""
    found = {(item.bone, item.name): item for way in ways(limbs) for item in rig.mapping.settings if item.limbs in ("", way)}
    return list(found.values())


def hinged(rig: Rig, solved: RigBody, motion: Motion) -> Motion:
    """The motion with every limb that has a pole rolled about its own bones as a hinge has them. Its joints stay where they are."""
    world, positions = (values.astype(np.float64) for values in motion.forward())
    for pole in rig.mapping.poles:
        upper, middle, end = _limb(rig, solved, pole)
        rests = [_hinge_at_rest(rig, solved, joint, below) for joint, below in ((upper, middle), (middle, end))]
        ways = [normalize(positions[:, below] - positions[:, joint]) for joint, below in ((upper, middle), (middle, end))]
        rolled = matrix_from_quat(multiply(multiply(world[:, upper], solved.alignment[upper]), rests[0]))[..., 0]
        bend = np.cross(ways[0], ways[1])
        bend += np.maximum(0, STRAIGHT - np.linalg.norm(bend, axis=-1, keepdims=True)) * rolled
        for joint, rest, along in zip((upper, middle), rests, ways, strict=True):
            axis = normalize(across(bend, along))
            frame = quat_from_matrix(np.stack((axis, along, np.cross(axis, along)), axis=-1))
            world[:, joint] = multiply(frame, inverse(multiply(solved.alignment[joint], rest)))
    return replace(motion, rotations=continuous(local_rotations(motion.skeleton, world)).astype(motion.rotations.dtype))


def pole_poses(rig: Rig, solved: RigBody, motion: Motion) -> Iterator[BonePose]:
    """The poles of a motion as `hinged` leaves it: each as far from its knee or elbow as at rest, to the side to which the limb bends."""
    world, positions = (values.astype(np.float64) for values in motion.forward())
    still = np.broadcast_to(IDENTITY.astype(np.float64), (len(motion), 4))
    for pole in rig.mapping.poles:
        upper, middle, end = _limb(rig, solved, pole)
        line = normalize(positions[:, end] - positions[:, upper])
        rest = _hinge_at_rest(rig, solved, upper, middle)
        back = matrix_from_quat(multiply(multiply(world[:, upper], solved.alignment[upper]), rest))[..., 2]
        aside = -normalize(across(back, line))
        distance = np.linalg.norm(rig.head(pole.bone) - rig.head(rig.mapping.joints[pole.joint]))
        yield placed(rig, pole.bone, pole.lower, still, positions[:, middle] + distance * aside)


def _limb(rig: Rig, solved: RigBody, pole: Pole) -> tuple[int, int, int]:
    """The joints of a limb: where it begins, where it bends, where it ends."""
    upper, middle, end = (solved.body.index(str(joint)) for joint in (rig.mapping.parents[pole.joint], pole.joint, next_in_limb(pole.joint)))
    return upper, middle, end


def _hinge_at_rest(rig: Rig, solved: RigBody, joint: int, below: int) -> Array:
    """World rotation [4] at rest of a frame whose Y goes from a joint to the one below, and whose X is the X axis of the joint's bone."""
    bone, following = (rig.mapping.joints[solved.body.names[i]] for i in (joint, below))
    along = normalize(rig.head(following) - rig.head(bone))
    axis = rotate(multiply(rig.object_rotation, rig.rest_rotation(bone)), np.array([1.0, 0, 0]))
    axis = normalize(axis - axis @ along * along)
    return quat_from_matrix(np.stack((axis, along, np.cross(axis, along)), axis=-1))
