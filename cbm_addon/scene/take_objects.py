"""Animated objects and bones of a scene as a take: what recorders inside Blender leave behind, and what its importers bring in."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from ..errors import InputError
from ..motion.rotations import Array, quat_from_matrix
from ..takes.names import choose_devices, is_body, poses_of
from ..takes.recording import Recording, TakeOverrides, take_from
from ..takes.take import Take
from .action import key_frames, scene_rate

NAME = "animated objects"
AXES = ("blender", "fbx", "zup", "engine")
"""What the frames of devices are like in Blender, where Z is up."""

ROLE, KIND, OFFSET = "role_string", "ref_type", "offset"
"""Custom properties of the Tracking Toolkit: which device an object or bone stands for, and that it is only a child to be adjusted."""


@dataclass(frozen=True)
class Mover:
    """An object, or a bone of one, and what it is called."""

    name: str
    obj: bpy.types.Object
    bone: str | None = None

    def matrix(self, depsgraph: bpy.types.Depsgraph) -> Array:
        """Its matrix in the world as it is evaluated, float64 [4, 4]."""
        evaluated = self.obj.evaluated_get(depsgraph)
        world = np.array(evaluated.matrix_world, dtype=np.float64)
        return world @ np.array(evaluated.pose.bones[self.bone].matrix, dtype=np.float64) if self.bone else world


def objects_take(scene: bpy.types.Scene, path: Path, overrides: TakeOverrides, format: str = NAME) -> Take:
    """The take that a scene's objects or bones play, called after `path`: those that the user names, or that are called like devices.

    Sampled at their keys, and on the whole frames where these are far apart; the scene must be the window's, whose current frame is restored. Bones of a
    body count only if they are named. InputError if there are none, or if they do not move.
    """
    movers = _movers(scene.objects, {overrides.head, overrides.left, overrides.right})
    devices, trackers = choose_devices(path, [mover.name for mover in movers], overrides)
    chosen = [movers[index] for index in devices.values()]
    frames = _frames(scene, {mover.obj for mover in chosen})
    positions, rotations = poses_of({device: i for i, device in enumerate(devices)}, *_sampled(scene, chosen, frames))
    if np.ptp(positions[:, 0], axis=0).max() == 0:
        raise InputError(path, f"{chosen[0].name} does not move; name what does (--head, --left, --right), or unmute its recording")
    recording = Recording(format, frames / scene_rate(scene), positions, rotations, likely_axes=AXES, constants={"trackers": trackers})
    return take_from(recording, path, overrides)


def _movers(objects: Iterable[bpy.types.Object], named: set[str | None]) -> list[Mover]:
    """Everything that may be a device, objects before bones."""
    objects = list(objects)
    movers = [Mover(obj.get(ROLE, obj.name), obj) for obj in objects if obj.get(KIND) != OFFSET]
    for obj in objects:
        bones = list(obj.pose.bones) if obj.type == "ARMATURE" else []
        body = is_body([bone.name for bone in bones])
        movers += [Mover(bone.get(ROLE, bone.name), obj, bone.name) for bone in bones if bone.get(KIND) != OFFSET and (not body or bone.name in named)]
    return movers


def _frames(scene: bpy.types.Scene, objects: set[bpy.types.Object]) -> np.ndarray:
    """The frames to sample: every key of the objects and of what they hang off, and the whole frames where keys are farther apart than a
    frame; the scene's, without keys."""
    for obj in list(objects):
        while obj := obj.parent:
            objects.add(obj)
    keys = np.concatenate([key_frames(obj) for obj in objects])
    strips = [strip for obj in objects if obj.animation_data for track in obj.animation_data.nla_tracks if not track.mute for strip in track.strips]
    keys = np.append(keys, [edge for strip in strips for edge in (strip.frame_start, strip.frame_end)])
    if len(keys) < 2:
        keys = np.array([scene.frame_start, scene.frame_end], dtype=np.float64)
    keys = np.unique(keys.round(4))
    whole = np.arange(np.floor(keys[0]) + 1, keys[-1])
    after = np.searchsorted(keys, whole)
    return np.union1d(keys, whole[keys[after] - keys[after - 1] > 1])


def _sampled(scene: bpy.types.Scene, movers: list[Mover], frames: np.ndarray) -> tuple[Array, Array]:
    """World positions [T, N, 3] and rotations [T, N, 4] at those frames."""
    current, subframe = scene.frame_current, scene.frame_subframe
    matrices = np.empty((len(frames), len(movers), 4, 4))
    try:
        for i, frame in enumerate(frames):
            scene.frame_set(int(frame // 1), subframe=float(frame % 1))
            depsgraph = bpy.context.evaluated_depsgraph_get()
            matrices[i] = [mover.matrix(depsgraph) for mover in movers]
    finally:
        scene.frame_set(current, subframe=subframe)
    mirrored = [mover.name for mover, matrix in zip(movers, matrices[0], strict=True) if np.linalg.det(matrix[:3, :3]) <= 0]
    if mirrored:
        raise InputError(mirrored[0], "is mirrored or has no size; apply its scale first")
    turns = matrices[..., :3, :3] / np.linalg.norm(matrices[..., :3, :3], axis=-2, keepdims=True)
    return matrices[..., :3, 3], quat_from_matrix(turns)
