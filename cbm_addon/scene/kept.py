"""The upper body that a rig's animation has already, for a bake of hips and legs below it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import bpy
import mathutils
import numpy as np

from ..motion.rotations import Array, inverse, multiply, quat_from_matrix
from ..progress import Job, Progress
from ..rigs.body import RigBody
from ..rigs.rig import Rig
from ..takes.synthesize import TRACKED_JOINTS
from .action import action_curves, curves_of
from .nla import PART, upper_tracks

READ_AT_A_TIME = 60  # frames between two events


@dataclass(frozen=True)
class Kept:
    """Where an animation has the head and the wrists, and how it turns every joint, at T frames.

    positions  float32 [T, 3, 3]: world, of TRACKED_JOINTS
    rotations  float32 [T, J, 4]: world rotations of the joints of the rig's body
    """

    positions: Array
    rotations: Array


def reading_upper_body(context: bpy.types.Context, armature: bpy.types.Object, rig: Rig, solved: RigBody, frames: np.ndarray) -> Job[Kept | None]:
    """What animates the armature at the scene's frames [T], whatever that is, without a lower body that was baked before; None if nothing does.

    Only here Blender is stepped through the frames: no curve says what constraints, drivers and strips make of it. Between two events the
    scene is as it was.
    """
    with _own_part_aside(armature):
        if not _animated(armature):
            return None
    matrices = np.empty((len(frames), len(solved.body), 4, 4))
    bones = [rig.mapping.joints[name] for name in solved.body.names]
    for start in range(0, len(frames), READ_AT_A_TIME):
        yield Progress(start / len(frames), "reading the upper body")
        with _own_part_aside(armature):
            for i, posed in enumerate(posed_at(context, armature, frames[start : start + READ_AT_A_TIME]), start):
                matrices[i] = [posed.matrix_world @ posed.pose.bones[bone].matrix for bone in bones]
    rests = np.stack([multiply(rig.object_rotation, rig.rest_rotation(bone)) for bone in bones])
    axes = matrices[..., :3, :3] / np.linalg.norm(matrices[..., :3, :3], axis=-2, keepdims=True)
    rotations = multiply(multiply(quat_from_matrix(axes), inverse(rests)), inverse(solved.alignment))
    tracked = solved.body.indices(TRACKED_JOINTS)
    return Kept(matrices[..., :3, 3][:, tracked].astype(np.float32), rotations.astype(np.float32))


def posed_at(context: bpy.types.Context, armature: bpy.types.Object, frames: np.ndarray) -> Iterator[bpy.types.Object]:
    """The evaluated armature at frames [T]; the scene's frame is put back."""
    scene = context.scene
    frame, subframe = scene.frame_current, scene.frame_subframe
    try:
        for at in frames:
            scene.frame_set(int(at // 1), subframe=float(at % 1))
            yield armature.evaluated_get(context.evaluated_depsgraph_get())
    finally:
        scene.frame_set(frame, subframe=subframe)


@contextmanager
def _own_part_aside(armature: bpy.types.Object) -> Iterator[None]:
    """Meanwhile an active action that is a lower body of ours, and what goes with it, do nothing, and the bones that they key are at rest for what
    else moves them."""
    data = armature.animation_data
    own = data.action if data else None
    if own is None or own.get(PART) != "lower":
        yield
        return
    slot = getattr(data, "action_slot", None)
    tracks = [track for track in upper_tracks(armature) if not track.mute]
    strips = [strip for track in tracks for strip in track.strips]
    curves = action_curves(armature) + [curve for strip in strips for curve in curves_of(strip.action, getattr(strip, "action_slot", None))]
    keyed = {curve.data_path.split('"')[1] for curve in curves if '"' in curve.data_path}
    posed = [bone for bone in armature.pose.bones if bone.name in keyed]
    poses = [bone.matrix_basis.copy() for bone in posed]
    data.action = None
    for track in tracks:
        track.mute = True
    for bone in posed:
        bone.matrix_basis = mathutils.Matrix()
    try:
        yield
    finally:
        data.action = own
        if slot is not None:
            data.action_slot = slot
        for track in tracks:
            track.mute = False
        for bone, pose in zip(posed, poses, strict=True):
            bone.matrix_basis = pose


def _animated(armature: bpy.types.Object) -> bool:
    data = armature.animation_data
    return data is not None and (data.action is not None or any(track.strips and not track.mute for track in data.nla_tracks))
