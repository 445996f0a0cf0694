"""Blend files that a command reads and writes."""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import bpy
import numpy as np

from ..errors import InputError
from ..motion.rotations import yaw_from_quat
from ..takes.take import HEAD, Take
from .action import scene_rate
from .preview import ABOVE_HEAD, MARGIN, ROOM
from .rig import find_armature
from .rigify import rigify_human, rigify_metarig
from .silence import silence
from .stage import add_camera, add_floor

RATE = 30  # frames per second of a new file
PRESETS = {"rigify": rigify_human, "rigify-metarig": rigify_metarig}


@dataclass(frozen=True)
class Target:
    """What is baked onto, and whether its file is a new one of ours."""

    context: bpy.types.Context
    armature: bpy.types.Object
    is_new: bool


def open_blend(path: Path) -> None:
    """Opens a blend file; InputError if there is none or it cannot be read."""
    if not path.is_file():
        raise InputError(path, "does not exist; name a .blend file")
    try:
        with silence():
            bpy.ops.wm.open_mainfile(filepath=str(path.absolute()), load_ui=False)
    except RuntimeError as error:
        raise InputError(path, f"cannot be opened ({str(error).strip().splitlines()[-1]}); a .blend file is needed") from error


def opened() -> Path | None:
    """The file that is open; None if it is only what Blender starts with."""
    return Path(bpy.data.filepath) if bpy.data.filepath else None


def check_files(blend: Path | None, opened: Path | None, output: Path) -> None:
    """InputError if the file to read (`blend`, or the one that is open) is not there, or is the one to write, or if that is no blend file."""
    source = blend or opened
    if blend and not blend.is_file():
        raise InputError(blend, "does not exist; name a .blend file")
    if source and output.resolve() == source.resolve():
        raise InputError(output, "is the file that is read; write to another one")
    if output.suffix.lower() != ".blend":
        raise InputError(output, "must end in .blend")


def open_target(blend: Path | None, rig: str | None, preset: str | None, kept: Path | None = None) -> Target:
    """The armature called `rig`, or a new one of a preset, in `blend` or in the file that is open. InputError if it is not to be had.

    Where there is no file but only what Blender starts with, a preset gets an empty one.

    kept  a folder for new files, which are opened when their preset is asked for again, whatever file is open by then
    """
    if blend:
        open_blend(blend)
    if not preset:
        return Target(bpy.context, find_armature(rig or ""), is_new=False)
    if kept and not blend:
        file, name = _preset_file(preset, kept)
        open_blend(file)
        return Target(bpy.context, find_armature(name), is_new=True)
    is_new = opened() is None
    if is_new:
        _start_empty()
    return Target(bpy.context, _add_preset(preset), is_new)


def _add_preset(preset: str) -> bpy.types.Object:
    with silence():
        return PRESETS[preset](bpy.context)


@cache
def _preset_file(preset: str, folder: Path) -> tuple[Path, str]:
    """A file of a preset alone, and its armature's name. Making it takes seconds, and opening it does not."""
    empty, made = (folder / f"{name}.{os.getpid()}.blend" for name in ("empty", preset))
    if not empty.exists():
        _start_empty()
        save_blend(empty)
    open_blend(empty)
    armature = _add_preset(preset)
    save_blend(made)
    return made, armature.name


def _start_empty() -> None:
    """Empties the file that Blender started with. Reading an empty one instead would unregister the extension that runs this."""
    bpy.data.batch_remove([*bpy.data.objects, *bpy.data.collections])
    bpy.data.orphans_purge(do_recursive=True)
    scene = bpy.context.scene
    scene.render.fps, scene.render.fps_base, scene.frame_start = RATE, 1.0, 1


def furnish(scene: bpy.types.Scene, take: Take, scale: float, head_height: float) -> None:
    """What a new file with a bake needs to open well: its length, a floor, and a camera that sees the whole way, looked through.

    scale        world units per metre of the take
    head_height  standing height of the head joint, world units
    """
    scene.frame_end = scene.frame_start + int(take.seconds * scene_rate(scene))
    path = take.positions[:, HEAD] * np.float32(scale)
    corners = np.stack((path.min(0), path.max(0)))
    add_floor(scene.collection, corners, MARGIN * scale)
    span = float(np.max(corners[1, :2] - corners[0, :2]))
    facing = float(yaw_from_quat(take.rotations[0, HEAD]))
    camera = add_camera(scene, scene.collection, facing, span, ABOVE_HEAD * head_height, ROOM * scale)
    camera.location.xy = np.array(camera.location.xy) + corners[:, :2].mean(0)
    for screen in bpy.data.screens:
        for area in screen.areas:
            if area.type == "VIEW_3D":
                area.spaces.active.region_3d.view_perspective = "CAMERA"


def actions(names: list[str]) -> tuple[bpy.types.Action, ...]:
    """The actions of those names."""
    return tuple(bpy.data.actions[name] for name in names)


def save_blend(path: Path) -> None:
    """Saves a copy; what is open stays what it is."""
    with silence():
        bpy.ops.wm.save_as_mainfile(filepath=str(path.absolute()), copy=True, compress=True)
