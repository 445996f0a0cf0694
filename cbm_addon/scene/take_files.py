"""Takes in files that Blender reads: FBX and glTF by its importers, and the first scene of a .blend."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..errors import InputError
from ..takes.blender_formats import BLEND, FBX, GLTF, format_of
from ..takes.readers import Reader, read_head
from ..takes.recording import TakeOverrides
from ..takes.take import Take
from .importers import run_importer, scratch_scene
from .silence import silence
from .take_objects import objects_take

SUFFIXES = {FBX: (".fbx",), GLTF: (".glb", ".gltf")}


class _BlenderFiles:
    """The reader to register (takes/readers.py)."""

    NAME = "FBX, glTF, .blend"

    def recognises(self, head: bytes) -> bool:
        return format_of(head) is not None

    def read(self, path: Path, overrides: TakeOverrides) -> Take:
        """The take that a file's objects or bones play. Nothing of the file stays."""
        kind = format_of(read_head(path))
        assert kind is not None
        if kind == BLEND:
            return _read_blend(path, overrides)
        if path.suffix.lower() not in SUFFIXES[kind]:
            raise InputError(path, f"is {kind} by what it holds, and not by its name; Blender wants it to end in {' or '.join(SUFFIXES[kind])}")
        with scratch_scene(bpy.context) as scene:
            with silence():
                run_importer(path)
            return objects_take(scene, path, overrides, kind)


BLENDER_FILES: Reader = _BlenderFiles()


def _read_blend(path: Path, overrides: TakeOverrides) -> Take:
    if bpy.data.filepath and Path(bpy.data.filepath).resolve() == path.resolve():  # a file cannot be brought into itself
        return objects_take(bpy.context.scene, path, overrides, BLEND)
    with scratch_scene(bpy.context):
        try:
            with silence(), bpy.data.libraries.load(str(path.absolute())) as (there, here):
                here.scenes = there.scenes[:1]
        except OSError as error:
            raise InputError(path, f"cannot be opened ({error}); a .blend file is needed") from None
        (scene,) = here.scenes
        window = bpy.context.window or bpy.context.window_manager.windows[0]
        window.scene = scene
        return objects_take(scene, path, overrides, BLEND)
