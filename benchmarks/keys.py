"""Fewer keys: what a tolerance saves, and what it costs. `python benchmarks/keys.py` in an environment with bpy (Linux).

The sample take, or another, is baked onto Rigify's metarig at 30 frames a second and thinned to each tolerance. Everything is measured on what
Blender's dependency graph makes of the action, at every frame.

keys     left of those of the full bake
away     the largest distance, mm, and angle, degrees, between a joint of the two, at the performer's size
slide    mean and median speed over the floor of ankles and toes in contact, cm/s: before and after
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

REPOSITORY = Path(__file__).resolve().parents[1]
SAMPLE = REPOSITORY / "cbm_addon" / "takes" / "sample" / "walk_turn_crouch.csv"
TOLERANCES = ((2, 0.5), (5, 1), (10, 2))
RATE = 30


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("take", type=Path, nargs="?", default=SAMPLE, help="a take (default: the sample)")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as resources:
        os.environ["BLENDER_USER_RESOURCES"] = resources
        sys.path.insert(0, str(REPOSITORY))
        show(args.take)
    os._exit(0)  # Blender 4.5 as a Python module hangs at its exit when classes of an add-on are left


def show(path: Path) -> None:
    import bpy

    from cbm_addon.motion.contacts import CONTACT_JOINTS, contact_labels
    from cbm_addon.progress import run
    from cbm_addon.rigs.body import rig_body
    from cbm_addon.scene.action import write_action
    from cbm_addon.scene.bake import rig_channels, solve_on_rig, take_scale
    from cbm_addon.scene.reduction import Reduction, reducing_channels
    from cbm_addon.scene.rig import read_rig
    from cbm_addon.scene.rigify import rigify_metarig
    from cbm_addon.scene.silence import silence
    from cbm_addon.solve.models import load_model
    from cbm_addon.solve.perform import SolveOptions
    from cbm_addon.takes.calibrate import calibrate
    from cbm_addon.takes.readers import read_take

    with silence():
        bpy.ops.wm.read_factory_settings(use_empty=True)
        bpy.context.scene.render.fps = RATE
        armature = rigify_metarig(bpy.context)
    calibrated = calibrate(read_take(path))
    rig = read_rig(armature)
    solved = rig_body(rig)
    scale = take_scale(solved, calibrated)
    motion = run(solve_on_rig(solved, calibrated, load_model(), SolveOptions(), RATE))
    dense = list(rig_channels(armature, rig, solved, motion))
    feet = solved.body.indices(list(CONTACT_JOINTS))
    standing = contact_labels(solved.body, motion.positions() / np.float32(scale), RATE)
    standing = standing[1:] & standing[:-1]

    def played(channels) -> tuple[np.ndarray, np.ndarray, tuple[float, float]]:
        """World positions [T, J, 3] and rotations [T, J, 3, 3] of joints at the performer's size, and the slide."""
        write_action(armature, "bake", 1.0 + np.arange(len(motion)), channels)
        matrices = evaluated(armature, [rig.mapping.joints[joint] for joint in solved.body.names], len(motion))
        heads = matrices[..., :3, 3] / scale
        speed = 100 * RATE * np.linalg.norm(np.diff(heads[:, feet, :2], axis=0), axis=-1)[standing]
        return heads, matrices[..., :3, :3] / rig.scale, (speed.mean(), float(np.median(speed)))

    heads, turns, slide = played(dense)
    print(f"{path.name}: {len(motion)} frames, slide {slide[0]:.2f} ({slide[1]:.2f}) cm/s with every key")
    print(f"{'tolerance':<16}{'keys':>16}{'share':>8}{'away':>18}{'slide':>18}{'seconds':>9}")
    for millimetres, degrees in TOLERANCES:
        started = time.perf_counter()
        thinned, report = run(reducing_channels(armature, rig, motion, dense, Reduction(millimetres, degrees), scale))
        seconds = time.perf_counter() - started
        fewer, turned, slide = played(thinned)
        far = 1000 * np.linalg.norm(fewer - heads, axis=-1).max()
        angle = np.degrees(2 * np.arcsin(np.linalg.norm(turned - turns, axis=(-1, -2)) / np.sqrt(8))).max()
        keys = f"{report.keys_after} of {report.keys_before}"
        share = report.keys_after / report.keys_before
        tolerance, away, slides = f"{millimetres} mm, {degrees}°", f"{far:.2f} mm, {angle:.2f}°", f"{slide[0]:.2f} ({slide[1]:.2f})"
        print(f"{tolerance:<16}{keys:>16}{share:>8.0%}{away:>18}{slides:>18}{seconds:>9.1f}", flush=True)


def evaluated(armature, bones: list[str], frames: int) -> np.ndarray:
    """World matrices [T, B, 4, 4] of pose bones from the dependency graph."""
    import bpy

    matrices = np.empty((frames, len(bones), 4, 4))
    for i in range(frames):
        bpy.context.scene.frame_set(i + 1)
        posed = armature.evaluated_get(bpy.context.evaluated_depsgraph_get())
        matrices[i] = [posed.matrix_world @ posed.pose.bones[bone].matrix for bone in bones]
    return matrices


if __name__ == "__main__":
    main()
