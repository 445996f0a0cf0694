"""Motion capture into the scene: BVH by the engine's reader, FBX and glTF by Blender's own importers, then one path to an armature."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import bpy
import numpy as np

from ..errors import InputError
from ..motion.bvh import read_bvh_file
from ..motion.motion import Motion, local_rotations
from ..motion.resample import frame_times, resample
from ..motion.rotations import across, continuous, rotate
from ..rigs.limbs import Limbs, require_limbs
from ..rigs.retarget import Retargeted, retarget, source_rig
from ..rigs.rig import Rig
from ..rigs.tables import Table
from ..rigs.travel import Root
from ..solve.ik import aim, clamp_reach, two_bone
from .action import Channel, key_frames, scene_frames, scene_rate, write_action
from .armature import match_names, motion_from_armature, new_armature, pose_channels
from .bake import require_carrier, rig_channels
from .rig import read_rig, require_editable

FORWARD = np.array([0, -1, 0], dtype=np.float32)
STRAIGHT_KNEE = np.float32(0.03)  # share of the thigh's length by which a knee is at least taken to be bent, to the front


@dataclass(frozen=True)
class Imported:
    """A motion that was put on an armature as a new action, and what there is to say about its file."""

    armature: bpy.types.Object
    action: bpy.types.Action
    notes: tuple[str, ...]


def import_mocap(
    context: bpy.types.Context,
    paths: list[Path],
    armature: bpy.types.Object | None,
    frame_start: int,
    table: Table | None = None,
    root: Root = "hips",
    limbs: Limbs = "fk",
) -> list[Imported]:
    """Puts the motion of each file on `armature`, or on a new armature of its own, as a new action named after the file.

    Bones of an armature that has the names of all the file's joints do what the joints do. On any other armature that is a body the motion
    is retargeted; `table` is the user's map of its bones, `root` what carries the way over the ground (rigs/travel.py), `limbs` which kinematics
    of the limbs are keyed (rigs/limbs.py). Keys lie on whole
    frames of the scene, whose rate stays what it is: a second of the file is a second of the scene. InputError before anything has
    changed, if a file is not sound or does not fit the armature.
    """
    if armature is not None:
        require_editable(armature)
    read = [_read(context, path) for path in paths]
    prepared = []
    for path, (motion, notes) in zip(paths, read, strict=True):
        motion = _at_rate(motion, scene_rate(context.scene))
        obj = armature or new_armature(context, path.stem, motion.skeleton)
        channels, done = _channels(obj, path.stem, motion, table, root, limbs) if armature else (pose_channels(obj, motion), ())
        prepared.append((path.stem, obj, scene_frames(context.scene, motion.times, frame_start), channels, (*notes, *done)))
    return [Imported(obj, write_action(obj, name, frames, channels), notes) for name, obj, frames, channels, notes in prepared]


def _channels(
    armature: bpy.types.Object, name: str, motion: Motion, table: Table | None, root: Root, limbs: Limbs
) -> tuple[Iterable[Channel], tuple[str, ...]]:
    """The curves of a motion on an existing armature, and how they were found."""
    named = match_names([bone.name for bone in armature.data.bones], motion.skeleton.names)
    plain = table is None and root == "hips" and limbs == "fk"
    if plain and len(named) == len(motion.skeleton):
        return pose_channels(armature, motion), ()
    try:
        source, motion_at_rest = source_rig(name, motion)
        target = read_rig(armature, table)
    except InputError:
        if not (plain and named):
            raise
        return pose_channels(armature, motion), (f"{len(named)} bones follow the joints of their name; the others are left alone",)
    require_carrier(armature, target, root)
    require_limbs(target, limbs)
    titles = source.mapping.table.title, target.mapping.table.title
    return _retargeted(armature, motion_at_rest, source, target, root, limbs), (f"retargeted from {titles[0]} to {titles[1]}",)


def _retargeted(armature: bpy.types.Object, motion: Motion, source: Rig, target: Rig, root: Root, limbs: Limbs) -> Iterator[Channel]:
    """Lazily, since hundreds of files may wait to be written."""
    moved = retarget(motion, source, target)
    yield from rig_channels(armature, target, moved.solved, meet_ankles(moved), root=root, limbs=limbs)


def meet_ankles(moved: Retargeted) -> Motion:
    """The motion with its legs bent, as little as needed, so that the ankles are where the source has them; feet keep their rotations."""
    body = moved.motion.skeleton
    world, positions = moved.motion.forward()
    for side, ankle in moved.ankles.items():
        thigh, shin, foot = (body.index(side + name) for name in ("UpLeg", "Leg", "Foot"))
        upper, lower = (float(np.linalg.norm(body.offsets[joint])) for joint in (shin, foot))
        socket = positions[:, thigh]
        target = clamp_reach(socket, ankle, upper + lower)
        bend = across(positions[:, shin] - socket, positions[:, foot] - socket)
        straight = np.maximum(0, STRAIGHT_KNEE * upper - np.linalg.norm(bend, axis=-1, keepdims=True))
        knee = two_bone(socket, target, upper, lower, bend + straight * rotate(world[:, thigh], FORWARD))
        world[:, thigh] = aim(world[:, thigh], body.offsets[shin], knee - socket)
        world[:, shin] = aim(world[:, shin], body.offsets[foot], target - knee)
    return replace(moved.motion, rotations=continuous(local_rotations(body, world)))


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
    with scratch_scene(context) as scene:
        run_importer(path)
        armatures = [obj for obj in scene.objects if obj.type == "ARMATURE"]
        keyed = max(armatures, key=lambda obj: len(key_frames(obj)), default=None)
        keys = key_frames(keyed) if keyed else np.empty(0)
        if not len(keys):
            raise InputError(path, "holds no animated armature; export the skeleton together with its animation")
        # Files may have keys between frames, or few of them with smooth curves in between.
        frames = np.concatenate((keys, np.arange(np.ceil(keys[0]), keys[-1])))
        return motion_from_armature(keyed, np.unique(frames.round(4)))


@contextmanager
def scratch_scene(context: bpy.types.Context) -> Iterator[bpy.types.Scene]:
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


def run_importer(path: Path) -> None:
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
