"""`python -m cbm_addon COMMAND`, also installed as `cbm`."""

from __future__ import annotations

import os
import sys
from typing import NoReturn

from .cli import main


def run() -> NoReturn:
    """Runs the command line and ends the process with its exit code."""
    code = main()
    if "bpy" in sys.modules:
        # Blender 4.2 as a Python module crashes, and 4.5 hangs, in its own teardown once Rigify was enabled. The work is done.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    sys.exit(code)


if __name__ == "__main__":
    run()
