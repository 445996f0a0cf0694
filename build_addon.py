"""Builds the extension as a zip for Blender, and runs a built zip in a fresh Blender.

    python build_addon.py               dist/cbm-VERSION.zip for this platform and Blender 4.2 to 5.0
    python build_addon.py --all         one zip per platform, for Blender 4.2 to 5.2
    python build_addon.py --check       only says which system libraries the bpy module misses here
    python -I build_addon.py --run ZIP COMMAND …   installs ZIP through Blender's extension API and runs `cbm COMMAND …` in it

Needs an environment that holds bpy (`pip install bpy`): the zip is written and validated by the tool inside it.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NoReturn

REPOSITORY = Path(__file__).resolve().parent
PACKAGE = "bl_ext.user_default.cbm"
CONTENT = ("__init__.py", "LICENSE", "cbm_addon", "operators", "panels")
"""What goes into the zip beside the manifest and the wheels. Never numpy (Blender has its own) nor torch (training has its own process)."""

PLATFORMS = {"linux-x64": "manylinux_2_28_x86_64", "windows-x64": "win_amd64", "macos-arm64": "macosx_14_0_arm64"}
"""Blender's name of a platform, and the wheel tag that pip downloads for it."""

PYTHONS = ("3.11", "3.13")
"""Blender 4.2 to 5.0 runs Python 3.11, Blender 5.1 and 5.2 run 3.13."""

DEBIAN_PACKAGES = {
    "libX11.so.6": "libx11-6",
    "libXext.so.6": "libxext6",
    "libXrender.so.1": "libxrender1",
    "libXfixes.so.3": "libxfixes3",
    "libXi.so.6": "libxi6",
    "libxkbcommon.so.0": "libxkbcommon0",
    "libSM.so.6": "libsm6",
    "libICE.so.6": "libice6",
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
}
"""The system libraries that bpy links to, or opens to render (libEGL), and what brings them on Debian and Ubuntu."""


class BuildError(Exception):
    """Something outside this project is missing; the message says what to do, in one line."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    job = parser.add_mutually_exclusive_group()
    job.add_argument("--all", action="store_true", help="every platform and Python, one zip per platform")
    job.add_argument("--check", action="store_true", help="name the system libraries that bpy misses here")
    job.add_argument("--run", nargs=argparse.REMAINDER, metavar="ZIP COMMAND", help="install a zip in a fresh Blender and run its command")
    parser.add_argument("-o", "--output", type=Path, default=REPOSITORY / "dist", metavar="FOLDER", help="where the zips go (default: dist)")
    args = parser.parse_args()
    try:
        if args.check:
            check_libraries()
        elif args.run:
            leave(run_installed(Path(args.run[0]), args.run[1:]))
        elif args.all:
            for name in PLATFORMS:
                print(build(args.output, name, PYTHONS, f"-{name.replace('-', '_')}"))
        else:
            print(build(args.output, this_platform(), PYTHONS[:1]))
    except BuildError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


def build(output: Path, platform_name: str, pythons: tuple[str, ...], suffix: str = "") -> Path:
    """Writes and validates the zip of one platform, with a wheel for each Python; returns its path."""
    wheels = [fetch_wheel(platform_name, python) for python in pythons]
    output.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="cbm-build-") as folder:
        stage, built = Path(folder, "stage"), Path(folder, "built")
        built.mkdir()
        fill_stage(stage, platform_name, wheels)
        blender_ext("build", "--source-dir", stage, "--output-dir", built)
        (zip_file,) = built.iterdir()
        blender_ext("validate", zip_file)
        return Path(shutil.move(zip_file, output / f"{zip_file.stem}{suffix}.zip"))


def fetch_wheel(platform_name: str, python: str) -> Path:
    """The onnxruntime wheel that constraints.txt pins, downloaded to wheels/ unless it is there."""
    pins = (REPOSITORY / "constraints.txt").read_text(encoding="utf-8")
    version = re.findall(r"^onnxruntime==(\S+)$", pins, re.MULTILINE)[0]
    folder, tag = REPOSITORY / "wheels", PLATFORMS[platform_name]
    pattern = f"onnxruntime-{version}-cp{python.replace('.', '')}-*{tag}.whl"
    if not list(folder.glob(pattern)):
        pip = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--only-binary=:all:", "--implementation=cp"]
        done = subprocess.run([*pip, f"--python-version={python}", f"--platform={tag}", f"--dest={folder}", f"onnxruntime=={version}"], check=False)
        if done.returncode:
            raise BuildError(f"pip cannot download onnxruntime {version} for {platform_name} and Python {python}; is the network there?")
    return next(folder.glob(pattern))


def fill_stage(stage: Path, platform_name: str, wheels: list[Path]) -> None:
    """Lays out the extension as the zip will hold it; its manifest lists exactly the wheels beside it."""
    (stage / "wheels").mkdir(parents=True)
    for name in CONTENT:
        source = REPOSITORY / name
        if source.is_dir():
            shutil.copytree(source, stage / name, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy2(source, stage / name)
    for wheel in wheels:
        shutil.copy2(wheel, stage / "wheels" / wheel.name)
    contents = {"platforms": [platform_name], "wheels": [f"./wheels/{wheel.name}" for wheel in wheels]}
    lists = [f"{key} = {json.dumps(values)}\n" for key, values in contents.items()]
    manifest = (REPOSITORY / "blender_manifest.toml").read_text(encoding="utf-8")
    (stage / "blender_manifest.toml").write_text("".join(lists) + manifest, encoding="utf-8")


def this_platform() -> str:
    machine = {"AMD64": "x64", "x86_64": "x64", "arm64": "arm64", "aarch64": "arm64"}.get(platform.machine(), platform.machine())
    system = {"win32": "windows", "darwin": "macos"}.get(sys.platform, sys.platform)
    name = f"{system}-{machine}"
    if name not in PLATFORMS:
        raise BuildError(f"no wheels are known for {name}; build_addon.py knows {', '.join(PLATFORMS)}")
    return name


def bpy_library() -> Path:
    """The shared library of the bpy module, found without importing it."""
    spec = importlib.util.find_spec("bpy")
    if spec is None or spec.origin is None:
        raise BuildError(f"{sys.executable} has no bpy; pip install bpy==5.0.1")
    return Path(spec.origin)


def blender_ext(*arguments: str | Path) -> None:
    """Runs Blender's own packaging tool; shows what it says only when it fails."""
    tool = next(bpy_library().parent.glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py"))
    done = subprocess.run([sys.executable, tool, *arguments], capture_output=True, text=True, check=False)
    if done.returncode:
        raise BuildError(" ".join(f"Blender refuses the extension: {done.stdout} {done.stderr}".split()))


def check_libraries() -> None:
    """Raises BuildError that names the Debian packages of the system libraries that bpy misses here."""
    if sys.platform != "linux":
        return
    linked = subprocess.run(["ldd", bpy_library()], capture_output=True, text=True, check=False).stdout
    missing: set[str] = set(re.findall(r"(\S+) => not found", linked))
    known = subprocess.run(["/sbin/ldconfig", "-p"], capture_output=True, text=True, check=False).stdout
    if "libEGL.so.1" not in known:
        missing.add("libEGL.so.1")
    if missing:
        raise BuildError(f"Blender needs system libraries; apt-get install {' '.join(sorted(DEBIAN_PACKAGES.get(name, name) for name in missing))}")


def run_installed(zip_file: Path, argv: list[str]) -> int:
    """Installs and enables the zip in this process, beside no other user setting, and returns the command's exit code."""
    check_libraries()
    with tempfile.TemporaryDirectory(prefix="cbm-blender-", ignore_cleanup_errors=True) as folder:
        os.environ["BLENDER_USER_RESOURCES"] = folder
        import bpy

        bpy.ops.extensions.package_install_files(filepath=str(zip_file.resolve()), repo="user_default", enable_on_install=False)
        bpy.ops.preferences.addon_enable(module=PACKAGE)
        return sys.modules[PACKAGE].run_command(argv)


def leave(code: int) -> NoReturn:
    """Ends the process without Blender's own teardown, which crashes in the bpy module of Blender 4.2 once Rigify was enabled."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


if __name__ == "__main__":
    sys.exit(main())
