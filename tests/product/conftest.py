"""The product tier: the built zip, installed in a fresh Blender process whose environment holds bpy alone.

`make test` makes that environment (.venv-blender, Blender 5.0). CBM_BLENDER_PYTHONS names others, separated as in PATH,
so that one command checks several versions of Blender.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
PYTHONS = os.environ.get("CBM_BLENDER_PYTHONS") or str(REPOSITORY / ".venv-blender" / "bin" / "python")

INSTALL = """
import bpy, sys
bpy.ops.extensions.package_install_files(filepath=sys.argv[1], repo="user_default", enable_on_install=False)
"""
ENABLE = """
import bpy, sys
import addon_utils  # stands once bpy is imported
answer, extension = None, addon_utils.enable("bl_ext.user_default.cbm", default_set=True)
"""
RUN_COMMAND = """
import os
code = extension.run_command(sys.argv[1:])
sys.stdout.flush()
sys.stderr.flush()
os._exit(code)  # without the teardown of the bpy module, which crashes in Blender 4.2 once Rigify was enabled
"""
ANSWER = """
import json
print("\\nanswer: " + json.dumps(answer), flush=True)
"""


@dataclass(frozen=True)
class Blender:
    """A Python that holds bpy, with a folder of user settings of its own. The checkout is not on its path."""

    python: str
    user_resources: Path

    def run(self, code: str, *argv: str | Path, folder: Path | None = None) -> subprocess.CompletedProcess[str]:
        """Runs code in a new process that works in `folder`; code reads `argv` as sys.argv[1:]."""
        environment = os.environ | {"BLENDER_USER_RESOURCES": str(self.user_resources)}
        command = [self.python, "-I", "-c", code, *map(str, argv)]
        return subprocess.run(command, cwd=folder or self.user_resources, env=environment, capture_output=True, text=True, check=False)

    def script(self, code: str, *argv: str | Path) -> Any:
        """Runs code beside the enabled `extension` and returns what it left in `answer`; fails the test if it raises."""
        done = self.run(ENABLE + code + ANSWER, *argv)
        assert done.returncode == 0, done.stderr
        return json.loads(next(line for line in done.stdout.splitlines() if line.startswith("answer: ")).removeprefix("answer: "))

    def cbm(self, *argv: str | Path, folder: Path) -> subprocess.CompletedProcess[str]:
        """Runs `cbm ARGV…` as `blender --command cbm` does, through the function that the extension registers."""
        return self.run(ENABLE + RUN_COMMAND, *argv, folder=folder)


@pytest.fixture(scope="session")
def built_zip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The zip that build_addon.py makes for this platform."""
    folder = tmp_path_factory.mktemp("dist")
    done = subprocess.run([sys.executable, REPOSITORY / "build_addon.py", "--output", folder], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return Path(done.stdout.strip())


@pytest.fixture(scope="session", params=PYTHONS.split(os.pathsep), ids=lambda python: Path(python).parents[1].name)
def blender(request: pytest.FixtureRequest, built_zip: Path, tmp_path_factory: pytest.TempPathFactory) -> Blender:
    """A Blender in which the zip is installed."""
    assert Path(request.param).exists(), f"{request.param} does not exist: `make test` makes it; CBM_BLENDER_PYTHONS names others"
    blender = Blender(request.param, tmp_path_factory.mktemp("blender"))
    assert blender.run("import onnxruntime").returncode != 0, f"{request.param} holds onnxruntime: it would hide a missing wheel"
    done = blender.run(INSTALL, built_zip)
    assert done.returncode == 0, done.stderr
    return blender
