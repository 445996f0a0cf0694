"""The way of a body over the ground, taken out of its hips: to be carried by a bone above them, by the object, or by nothing (in place)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ..errors import InputError
from ..motion.ground_frame import root_frame
from ..motion.motion import Motion
from ..motion.rotations import IDENTITY, Array, inverse, matrix_from_quat, multiply, rotate
from .body import RigBody
from .pose import BonePose, placed
from .rig import Rig

Root = Literal["hips", "bone", "object", "in-place"]
ROOTS: tuple[Root, ...] = ("hips", "bone", "object", "in-place")


@dataclass(frozen=True)
class Way:
    """What takes a body from where its rig stands at rest to where it is: rotations float64 [T, 4] about Z, translations float64 [T, 3]."""

    rotations: Array
    translations: Array

    def of(self, point: Array) -> Array:
        """A world point [3] of the rig at rest, taken along: [T, 3]."""
        return rotate(self.rotations, point) + self.translations


def way_over_ground(rig: Rig, solved: RigBody, motion: Motion, root: Root) -> Way:
    """Where the body goes and faces; of a motion that is to be in place, only where it goes."""
    bones = rig.mapping.joints | rig.mapping.fingers
    rest = root_frame(solved.body, np.stack([rig.head(bones[joint]) for joint in solved.body.names]))
    path = root_frame(solved.body, motion.positions().astype(np.float64))
    turned = np.broadcast_to(IDENTITY.astype(np.float64), path.rotation.shape) if root == "in-place" else multiply(path.rotation, inverse(rest.rotation))
    return Way(turned, path.origin - rotate(turned, rest.origin))


def without_way(motion: Motion, way: Way) -> Motion:
    """The motion as seen by what is carried along the way."""
    back = inverse(way.rotations)
    local = motion.rotations.copy()
    local[:, 0] = multiply(back, motion.rotations[:, 0])
    return replace(motion, root=rotate(back, motion.root - way.translations).astype(np.float32), rotations=local)


def root_bone(rig: Rig) -> str:
    """The bone above the hips that can carry the way; InputError if there is none, or if it would not carry all that is keyed."""
    root = rig.mapping.root
    if root is None:
        raise InputError(rig.name, "has no bone above its hips that could carry the way; keep the way on the hips, or put it on the object")
    for control in rig.mapping.controls:
        for bone in (control.bone, *rig.ancestors(control.bone)):
            if bone == root:
                break
            if not rig.inherits_rotation[rig.index(bone)]:
                raise InputError(rig.name, f"its bone {bone} does not inherit rotation, so that {root} cannot carry it; keep the way on the hips")
    return root


def root_pose(rig: Rig, way: Way) -> BonePose:
    """The pose of the rig's root bone that carries everything below it along the way."""
    root, object_rotation = root_bone(rig), rig.object_rotation
    turn = multiply(multiply(inverse(object_rotation), way.rotations), object_rotation)
    return placed(rig, root, True, turn, way.of(rig.head(root)))


def object_matrices(rig: Rig, way: Way) -> Array:
    """World matrices float64 [T, 4, 4] of the armature's object along the way."""
    matrices = np.tile(np.eye(4), (len(way.rotations), 1, 1))
    matrices[:, :3, :3] = matrix_from_quat(way.rotations) @ rig.object_matrix[:3, :3]
    matrices[:, :3, 3] = way.of(rig.object_matrix[:3, 3])
    return matrices
