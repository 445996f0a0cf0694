"""A bake on a generated Rigify rig beside Blender's own nla.bake of the same bones and frames: `python benchmarks/nla_bake.py` in an environment
with bpy (Linux).

Blender's bake steps the dependency graph through the frames and keys what it sees; it solves nothing. Beside it stand both what does the same
work (a solved motion becomes keys) and the whole bake, from the take to keys that were compared with the trackers.

seconds        wall time, one run each
ms per frame   the same per frame
times          how many times as long Blender's own bake takes
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[1]
RATE = 30
BAR = 50


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=1000, help="how many frames of the sample take are baked (default: 1000)")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as resources:
        os.environ["BLENDER_USER_RESOURCES"] = resources
        sys.path.insert(0, str(REPOSITORY))
        ratio = compare(args.frames)
    sys.stdout.flush()
    os._exit(0 if ratio >= BAR else 1)  # Blender 4.5 as a Python module hangs at its exit when classes of an add-on are left


def compare(frames: int) -> float:
    """Prints the table; how many times faster the keys are made."""
    import bpy
    import numpy as np

    from cbm_addon.progress import run
    from cbm_addon.rigs.body import rig_body
    from cbm_addon.scene.action import action_curves, write_action
    from cbm_addon.scene.bake import BakeOptions, bake, rig_channels, solve_on_rig
    from cbm_addon.scene.rig import read_rig
    from cbm_addon.scene.rigify import rigify_human
    from cbm_addon.scene.silence import silence
    from cbm_addon.solve.models import load_model
    from cbm_addon.solve.perform import SolveOptions, sampled
    from cbm_addon.takes.calibrate import calibrate
    from cbm_addon.takes.sample_motion import sample_take

    with silence():
        bpy.ops.wm.read_factory_settings(use_empty=True)
        human = rigify_human(bpy.context)
    scene, model = bpy.context.scene, load_model()
    scene.render.fps = RATE
    calibrated = calibrate(sample_take())
    take = sampled(calibrated.take, calibrated.take.times[0] + np.arange(0, (frames - 1) / RATE + 1e-6, 1 / 72))
    calibrated = replace(calibrated, take=replace(take, times=take.times - take.times[0]))
    rig = read_rig(human)
    solved = rig_body(rig)
    motion = run(solve_on_rig(solved, calibrated, model, SolveOptions(), RATE))
    at = 1.0 + np.arange(len(motion))

    keys = timed(lambda: write_action(human, "keys", at, list(rig_channels(human, rig, solved, motion))))
    whole = timed(lambda: run(bake(bpy.context, human, calibrated, model, BakeOptions())))
    keyed = {curve.data_path.split('"')[1] for curve in action_curves(human)}
    select(human, keyed)
    with silence():
        blender = timed(lambda: nla_bake(len(motion)))
    print(f"Rigify's human, {len(motion)} frames, {len(keyed)} bones keyed\n{'':<46}{'seconds':>8}{'ms per frame':>14}{'times':>7}")
    for what, seconds in (("nla.bake, of those bones", blender), ("the whole bake: solved, keyed and measured", whole), ("a solved motion becomes keys", keys)):
        print(f"{what:<46}{seconds:>8.2f}{1000 * seconds / len(motion):>14.2f}{blender / seconds:>7.0f}")
    return blender / keys


def timed(work: Callable[[], object]) -> float:
    started = time.perf_counter()
    work()
    return time.perf_counter() - started


def select(armature, bones: set[str]) -> None:
    import bpy

    bpy.ops.object.mode_set(mode="POSE")
    for bone in armature.pose.bones:
        (bone if hasattr(bone, "select") else bone.bone).select = bone.name in bones


def nla_bake(frames: int) -> None:
    import bpy

    done = bpy.ops.nla.bake(frame_start=1, frame_end=frames, only_selected=True, visual_keying=True, use_current_action=False, bake_types={"POSE"})
    assert done == {"FINISHED"}, done


if __name__ == "__main__":
    main()
