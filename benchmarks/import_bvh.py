"""CBM's BVH import beside Blender's own, on the same files of 10,000 frames: `python benchmarks/import_bvh.py` in an environment with bpy (Linux).

Every import runs in a fresh process, and the importers take turns. Each is called by the function behind its operator.

seconds    wall time until the scene shows the motion, evaluation included; the shortest of the runs
added MB   how far the peak of the process's memory rises until the importer returns; the median of the runs
evaluated  the same after the scene has been evaluated. Blender then holds a second copy of all keys, whoever wrote them (its own importer
           evaluates the scene while it runs): at 72 bytes per key, two copies are a floor that no importer can go below.

Every joint turns about all its axes in every frame, so that no key is redundant.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median
from typing import NamedTuple

import numpy as np

REPOSITORY = Path(__file__).resolve().parents[1]
FRAMES = 10_000
FILE_RATE = 60
NEW_SCENE_RATE = 24  # Blender's default
IMPORTERS = ("CBM", "Blender NATIVE", "Blender QUATERNION")  # Blender's default are the file's own Euler angles; CBM writes quaternions


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=3, help="runs per importer (default: 3)")
    runs = parser.parse_args().runs
    with tempfile.TemporaryDirectory() as folder:
        files = write_files(Path(folder))
        for scene_rate, title in (
            (FILE_RATE, f"scene at the file's {FILE_RATE} fps: one key per frame of the file from every importer"),
            (NEW_SCENE_RATE, f"scene at {NEW_SCENE_RATE} fps, real time kept: CBM's keys on whole frames, Blender's between them"),
        ):
            print(f"\n{title}\n{'file':<12}{'importer':<20}{'seconds':>8}{'added MB':>10}{'evaluated':>10}{'keys':>12}   CBM to Blender")
            for file in files:
                compare(file, scene_rate, runs)


def compare(file: Path, scene_rate: int, runs: int) -> None:
    results = [{importer: measure(importer, file, scene_rate) for importer in IMPORTERS} for _ in range(runs)]
    ours = summary([result["CBM"] for result in results])
    for importer in IMPORTERS:
        row = summary([result[importer] for result in results])
        ratio = "" if importer == "CBM" else f"   {row.seconds / ours.seconds:.1f} times faster, {ours.added / row.added:.2f} of the memory"
        print(f"{file.stem:<12}{importer:<20}{row.seconds:>8.2f}{row.added:>10.0f}{row.evaluated:>10.0f}{row.keys:>12,}{ratio}", flush=True)


class Measured(NamedTuple):
    seconds: float
    added: float  # MB
    evaluated: float  # MB
    keys: int


def summary(runs: list[Measured]) -> Measured:
    seconds, added, evaluated, keys = zip(*runs, strict=True)
    return Measured(min(seconds), median(added), median(evaluated), keys[0])


def measure(importer: str, file: Path, scene_rate: int) -> Measured:
    """One import in a fresh process."""
    with tempfile.TemporaryDirectory() as resources:
        environment = {name: value for name, value in os.environ.items() if name != "OPENBLAS_CORETYPE"}  # numpy at its own speed
        environment["BLENDER_USER_RESOURCES"] = resources
        command = [sys.executable, __file__, "in-blender", importer, str(file), str(scene_rate)]
        done = subprocess.run(command, env=environment, capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(done.stdout + done.stderr)
    return Measured(*json.loads(done.stdout.splitlines()[-1]))


def import_in_blender(importer: str, file: str, scene_rate: str) -> None:
    import bpy
    from bpy_extras.io_utils import axis_conversion
    from io_anim_bvh import import_bvh

    from cbm_addon.scene.action import action_curves
    from cbm_addon.scene.importers import import_mocap

    context = bpy.context
    context.scene.render.fps = int(scene_rate)
    before, start = memory("VmRSS"), time.perf_counter()
    if importer == "CBM":
        import_mocap(context, [Path(file)], None, 1)
    else:
        import_bvh.load(
            context,
            file,
            rotate_mode=importer.split()[1],
            use_fps_scale=int(scene_rate) != FILE_RATE,
            global_matrix=axis_conversion(from_forward="-Z", from_up="Y").to_4x4(),
        )
    added = memory("VmHWM") - before
    context.view_layer.update()
    seconds, evaluated = time.perf_counter() - start, memory("VmHWM") - before
    keys = sum(len(curve.keyframe_points) for curve in action_curves(context.object))
    print(json.dumps(Measured(seconds, added, evaluated, keys)))


def memory(of: str) -> float:
    """VmRSS (now) or VmHWM (the peak so far) of this process in MB."""
    (line,) = (line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith(of))
    return int(line.split()[1]) * 1024 / 1e6


def write_files(folder: Path) -> list[Path]:
    """A body of 22 joints, and one of 55 with fingers, jaw and eyes."""
    from cbm_addon.motion.bvh import write_bvh
    from cbm_addon.motion.motion import Motion
    from cbm_addon.motion.rotations import quat_from_rotvec
    from cbm_addon.motion.skeleton import STANDARD_BODY, Skeleton

    names, parents, offsets = list(STANDARD_BODY.names), list(STANDARD_BODY.parents), list(STANDARD_BODY.offsets)
    for side, sign in (("Left", 1), ("Right", -1)):
        for finger, across in (("Thumb", -0.04), ("Index", -0.03), ("Middle", -0.01), ("Ring", 0.01), ("Pinky", 0.03)):
            for phalanx in (1, 2, 3):
                parents.append(STANDARD_BODY.index(side + "Hand") if phalanx == 1 else len(names) - 1)
                offsets.append((sign * 0.08, across, 0) if phalanx == 1 else (sign * 0.03, 0, 0))
                names.append(f"{side}Hand{finger}{phalanx}")
    for name, offset in (("Jaw", (0, -0.05, 0.02)), ("LeftEye", (0.03, -0.08, 0.06)), ("RightEye", (-0.03, -0.08, 0.06))):
        parents.append(STANDARD_BODY.index("Head"))
        offsets.append(offset)
        names.append(name)
    detailed = Skeleton(tuple(names), np.array(parents), np.array(offsets, dtype=np.float32), np.full((len(names), 3), np.nan, dtype=np.float32))

    random = np.random.default_rng(0)
    times = np.arange(FRAMES) / FILE_RATE
    paths = []
    for skeleton in (STANDARD_BODY, detailed):
        speeds, phases = random.uniform(0.5, 5, (len(skeleton), 3)), random.uniform(0, 2 * np.pi, (len(skeleton), 3))
        turns = 0.4 * np.sin(times[:, None, None] * speeds + phases) + random.normal(0, 0.005, (FRAMES, len(skeleton), 3))
        root = np.stack((np.cos(times), np.sin(times), 0.95 + 0.02 * np.sin(5 * times)), axis=-1)
        paths.append(folder / f"{len(skeleton)}_joints.bvh")
        write_bvh(paths[-1], Motion(skeleton, times, root.astype(np.float32), quat_from_rotvec(turns).astype(np.float32)))
    return paths


if __name__ == "__main__":
    sys.path.insert(0, str(REPOSITORY))
    if sys.argv[1:2] == ["in-blender"]:
        import_in_blender(*sys.argv[2:])
    else:
        main()
