"""Motion capture into the scene: BVH by the engine's reader, FBX and glTF by Blender's own importers, then one path to an armature."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np

from ..errors import InputError
from ..motion.bvh import read_bvh_file
from ..motion.motion import Motion
from ..motion.resample import frame_times, resample
from .action import key_frames, scene_frames, scene_rate, write_action
from .armature import motion_from_armature, new_armature, pose_channels


@dataclass(frozen=True)
class Imported:
    """A motion that was put on an armature as a new action, and what there is to say about its file."""

    armature: bpy.types.Object
    action: bpy.types.Action
    notes: tuple[str, ...]


def import_mocap(context: bpy.types.Context, paths: list[Path], armature: bpy.types.Object | None, frame_start: int) -> list[Imported]:
    """Puts the motion of each file on `armature`, or on a new armature of its own, as a new action named after the file.

    Keys lie on whole frames of the scene, whose rate stays what it is: a second of the file is a second of the scene. InputError
    before anything has changed, if a file is not sound or does not fit the armature.
    """
    if armature is not None and armature.mode == "EDIT":
        raise InputError(armature.name, "its bones are being edited; leave edit mode first")
    read = [_read(context, path) for path in paths]
    prepared = []
    for path, (motion, notes) in zip(paths, read, strict=True):
        motion = _at_rate(motion, scene_rate(context.scene))
        obj = armature or new_armature(context, path.stem, motion.skeleton)
        prepared.append((path.stem, obj, scene_frames(context.scene, motion.times, frame_start), pose_channels(obj, motion), notes))
    return [Imported(obj, write_action(obj, name, frames, channels), notes) for name, obj, frames, channels, notes in prepared]


def _at_rate(motion: Motion, rate: float) -> Motion:
    """The motion from time 0 on, with samples at a steady rate."""
    times = frame_times(0, motion.seconds, rate)
    start = motion.times[0]
    if len(times) == len(motion) and np.allclose(motion.times - start, times, rtol=0, atol=1e-3 / rate):
        return Motion(motion.skeleton, times, motion.root, motion.rotations, motion.offsets)
    resampled = resample(motion, times + start)
    return Motion(motion.skeleton, times, resampled.root, resampled.rotations, resampled.offsets)


# Reading


def _read(context: bpy.types.Context, path: Path) -> tuple[Motion, tuple[str, ...]]:
    match path.suffix.lower():
        case ".bvh":
            file = read_bvh_file(path)
            return file.motion, (*file.warnings, f"unit {file.unit}: {file.unit_reason}", f"{file.up_axis} up: {file.up_axis_reason}")
        case ".fbx" | ".glb" | ".gltf":
            return _read_with_blender(context, path), ()
        case _:
            raise InputError(path, "is not motion capture by its name; give a .bvh, .fbx, .glb or .gltf file")


def _read_with_blender(context: bpy.types.Context, path: Path) -> Motion:
    """The motion of the armature in a file with the most keys, as Blender's own importer brings it in. Nothing of the import stays."""
    if not path.is_file():
        raise InputError(path, "no such file; give an existing one")
    with _scratch_scene(context) as scene:
        _run_importer(path)
        armatures = [obj for obj in scene.objects if obj.type == "ARMATURE"]
        keyed = max(armatures, key=lambda obj: len(key_frames(obj)), default=None)
        keys = key_frames(keyed) if keyed else np.empty(0)
        if not len(keys):
            raise InputError(path, "holds no animated armature; export the skeleton together with its animation")
        # Files may have keys between frames, or few of them with smooth curves in between.
        frames = np.concatenate((keys, np.arange(np.ceil(keys[0]), keys[-1])))
        return motion_from_armature(keyed, np.unique(frames.round(4)))


@contextmanager
def _scratch_scene(context: bpy.types.Context) -> Iterator[bpy.types.Scene]:
    """A scene of its own in the window. Whatever was added to the file meanwhile is removed, the user's scene comes back untouched.

    Importers change the frame rate, the frame range, the selection and the mode; here they change this scene's.
    """
    before = {block.session_uid for block in bpy.data.user_map()}
    window = context.window or context.window_manager.windows[0]
    shown = window.scene
    try:
        scene = bpy.data.scenes.new("CBM import")
        window.scene = scene
        yield scene
    finally:
        window.scene = shown
        bpy.data.batch_remove([block for block in bpy.data.user_map() if block.session_uid not in before])


def _run_importer(path: Path) -> None:
    if path.suffix.lower() != ".fbx":
        importer = bpy.ops.import_scene.gltf
    elif "fbx_import" in dir(bpy.ops.wm):  # Blender 4.5 and later
        importer = bpy.ops.wm.fbx_import
    else:
        importer = bpy.ops.import_scene.fbx
    try:
        done = importer(filepath=str(path)) == {"FINISHED"}
    except AttributeError:
        raise InputError(path, "Blender's importer for this format is disabled; enable its add-on") from None
    except RuntimeError as error:
        reasons = [line.strip().removeprefix("Error: ") for line in str(error).splitlines() if line.strip() and not line.startswith("Location:")]
        raise InputError(path, f"Blender's own importer cannot read it ({reasons[-1]}); export the file again") from None
    if not done:
        raise InputError(path, "Blender's own importer cannot read it; export the file again")
