"""The house's rules: who may know whom, and where the heavy libraries live (docs/architecture.md)."""

from __future__ import annotations

import ast
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

import cbm_addon
from cbm_addon.cli import COMMANDS

REPOSITORY = Path(__file__).resolve().parents[2]
ENGINE = REPOSITORY / "cbm_addon"

COMMON = {"errors", "progress", "outputs", "model_folder"}
ROOMS_KNOWN = {
    "motion": set(),
    "takes": {"motion"},
    "features": {"motion", "takes"},
    "learn": {"motion", "takes", "features", "solve", "hands", "body"},  # it exports the cards that their models read
    "solve": {"motion", "takes", "features"},
    "rigs": {"motion", "takes", "features"},
    "hands": {"motion"},
    "body": {"motion", "hands"},
    "evaluate": {"motion", "takes", "features", "learn", "solve", "rigs", "hands", "body"},
    "scene": {"motion", "takes", "solve", "rigs", "hands", "body"},
    "commands": {"motion", "takes", "features", "learn", "solve", "rigs", "hands", "body", "evaluate", "scene"},
}
LIBRARIES_KNOWN = {
    "bpy": {"scene", "operators", "panels", "__init__"},
    "torch": {"learn", "evaluate"},
    "onnxruntime": {"model_folder"},
}
"""Which rooms may import a library anywhere in their files."""


@dataclass(frozen=True)
class Import:
    """One import statement, its target written from the repository root: `cbm_addon.motion.bvh`, `bpy`, `numpy`."""

    file: Path
    line: int
    target: str
    absolute: bool

    def __str__(self) -> str:
        return f"{self.file.relative_to(REPOSITORY)}:{self.line} imports {self.target}"


def imports_of(file: Path) -> Iterator[Import]:
    package = file.relative_to(REPOSITORY).parent.parts
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (Import(file, node.lineno, alias.name, absolute=True) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - node.level + 1] if node.level else ()
            base = [*above, node.module] if node.module else above
            yield from (Import(file, node.lineno, ".".join([*base, alias.name]), absolute=not node.level) for alias in node.names)


def room_of(file: Path) -> str:
    parts = file.relative_to(REPOSITORY).with_suffix("").parts
    return parts[1] if parts[0] == "cbm_addon" else parts[0]


ENGINE_FILES = sorted(ENGINE.rglob("*.py"))
EXTENSION_FILES = [REPOSITORY / "__init__.py", *sorted(REPOSITORY.glob("operators/*.py")), *sorted(REPOSITORY.glob("panels/*.py"))]
IMPORTS = [statement for file in ENGINE_FILES + EXTENSION_FILES for statement in imports_of(file)]


def test_every_room_has_a_rule():
    rooms = {room_of(file) for file in ENGINE_FILES if file.parent != ENGINE}
    assert rooms <= set(ROOMS_KNOWN)


def test_rooms_know_only_the_rooms_before_them():
    wrong = []
    for statement in IMPORTS:
        room, target = room_of(statement.file), statement.target.split(".")
        if room in ROOMS_KNOWN and target[0] == "cbm_addon":
            known = ROOMS_KNOWN[room] | COMMON | {room} | ({"console"} if room == "commands" else set())
            if target[1] not in known and target[1:] != ["__version__"]:
                wrong.append(str(statement))
    assert wrong == []


def test_engine_knows_nothing_above_itself():
    wrong = [
        str(statement) for statement in IMPORTS if statement.file in ENGINE_FILES and not statement.absolute and not statement.target.startswith("cbm_addon.")
    ]
    assert wrong == []


def test_extension_and_engine_import_themselves_relatively():
    """Installed, the engine is `bl_ext.user_default.cbm.cbm_addon`: an absolute import would miss it."""
    ours = {"cbm_addon", "operators", "panels"}
    assert [str(statement) for statement in IMPORTS if statement.absolute and statement.target.split(".")[0] in ours] == []


def test_operators_do_not_know_panels():
    wrong = [str(statement) for statement in IMPORTS if room_of(statement.file) == "operators" and statement.target.startswith("panels")]
    assert wrong == []


@pytest.mark.parametrize("library", LIBRARIES_KNOWN)
def test_heavy_libraries_stay_in_their_rooms(library):
    wrong = [str(statement) for statement in IMPORTS if statement.target.split(".")[0] == library and room_of(statement.file) not in LIBRARIES_KNOWN[library]]
    assert wrong == []


def modules_after(statement: str) -> set[str]:
    """The names of the top-level modules in a fresh process that ran one statement."""
    code = f"import sys; {statement}; print(*{{name.split('.')[0] for name in sys.modules}})"
    done = subprocess.run([sys.executable, "-c", code], cwd=REPOSITORY, capture_output=True, text=True, check=True)
    return set(done.stdout.split())


def test_importing_the_package_imports_nothing_heavy():
    assert not modules_after("import cbm_addon") & {"numpy", "onnxruntime", "torch", "bpy"}


def test_showing_the_command_line_imports_no_engine_library():
    assert not modules_after("from cbm_addon.cli import build_parser; build_parser()") & {"onnxruntime", "torch", "bpy"}


def test_every_command_that_stands_is_on_the_command_line():
    assert sorted(COMMANDS) == sorted(file.stem for file in (ENGINE / "commands").glob("*.py") if "\nHELP = " in file.read_text(encoding="utf-8"))


def test_version_is_one_fact():
    manifest = tomllib.loads((REPOSITORY / "blender_manifest.toml").read_text(encoding="utf-8"))
    assert manifest["version"] == cbm_addon.__version__
