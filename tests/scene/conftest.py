"""The scene tier runs inside the bpy module, with the checkout linked as an installed extension."""

from __future__ import annotations

import os
import sys
import tempfile
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    import bpy

REPOSITORY = Path(__file__).resolve().parents[2]
EXTENSION = "bl_ext.user_default.cbm"

# Blender reads this once, when bpy is first imported: no test may see or change the user's own Blender.
user_resources = tempfile.TemporaryDirectory(prefix="cbm-scene-tests-")
os.environ["BLENDER_USER_RESOURCES"] = user_resources.name


@pytest.fixture(scope="session")
def linked_extension() -> str:
    """The module name of the checkout, linked where Blender looks for installed extensions."""
    folder = Path(user_resources.name, "extensions", "user_default")
    folder.mkdir(parents=True)
    (folder / "cbm").symlink_to(REPOSITORY, target_is_directory=True)
    return EXTENSION


@pytest.fixture
def empty_scene() -> bpy.types.Scene:
    """The scene of a new, empty file with factory settings. Reading it unregisters every extension: ask for `extension` where one is needed."""
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    return bpy.context.scene


@pytest.fixture
def extension(empty_scene: bpy.types.Scene, linked_extension: str) -> ModuleType:
    """The root package of the extension, registered in an empty scene."""
    import addon_utils

    assert addon_utils.enable(linked_extension, default_set=True), f"{linked_extension} did not register"
    return sys.modules[linked_extension]


@pytest.fixture(scope="session")
def human_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file with a generated Rigify human, which takes seconds to make."""
    import bpy

    from cbm_addon.scene.rigify import rigify_human

    bpy.ops.wm.read_factory_settings(use_empty=True)
    rigify_human(bpy.context)
    path = tmp_path_factory.mktemp("rigs") / "human.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


@pytest.fixture
def human(human_file: Path, empty_scene: bpy.types.Scene) -> bpy.types.Object:
    """The generated Rigify human in a file of its own."""
    import bpy

    bpy.ops.wm.open_mainfile(filepath=str(human_file))
    return bpy.data.objects["Human"]


@pytest.fixture
def metarig(empty_scene: bpy.types.Scene) -> bpy.types.Object:
    """Rigify's human metarig in an empty scene."""
    import bpy

    from cbm_addon.scene.rigify import rigify_metarig

    return rigify_metarig(bpy.context)
