"""How long finger posing takes for one hand and frame: `python benchmarks/fingers.py` in an environment with bpy.

A hand closes and opens on a mug of 20,000 triangles while the arm swings, as Blender evaluates it. All times are milliseconds of one core.
`avoiding` is the whole of it, `sweep` what live engines do instead, on the same hand, obstacle and frames: every finger bends from flat
toward the wanted pose until it touches. What is done once for an obstacle is given apart; so is playing the scene.
"""

from __future__ import annotations

import os

os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = "1"

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

REPOSITORY = Path(__file__).resolve().parents[1]
AROUND = 476  # corners around the mug, for 20,000 triangles


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--frames", type=int, default=480, help="frames of the scene (default: 480, which is 20 seconds)")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as resources:
        os.environ["BLENDER_USER_RESOURCES"] = resources
        sys.path.insert(0, str(REPOSITORY))
        show(args.frames)
    os._exit(0)  # Blender 4.5 as a Python module hangs at its exit when classes of an add-on are left


def timed(call: Callable[[], Any]) -> tuple[Any, float]:
    """What a call returns, and the milliseconds of processor time that it took."""
    started = time.process_time()
    result = call()
    return result, 1000 * (time.process_time() - started)


def show(frames: int) -> None:
    import bpy

    from cbm_addon.hands.avoid import FingerOptions, avoiding
    from cbm_addon.hands.contact import Probe, every_row, finger_depths
    from cbm_addon.hands.hand import finger_angles
    from cbm_addon.hands.model import load_hand_model
    from cbm_addon.hands.obstacle import over_time
    from cbm_addon.hands.poses import POSES
    from cbm_addon.hands.sweep import swept
    from cbm_addon.progress import run
    from cbm_addon.scene.rigged_hands import Surroundings, obstacles_of, played, rigged_hands
    from tests import triangles as made
    from tests.hand_scenes import SCENES, add_things, animate
    from tests.sample_rigs import SAMPLE_RIGS, add_armature, bones_at_rest

    bpy.ops.wm.read_factory_settings(use_empty=True)
    armature = add_armature(bones_at_rest(next(sample for sample in SAMPLE_RIGS if sample.name == "Mixamo"), "A"))
    ((_, *where),) = SCENES["mug"].things()
    shown = replace(SCENES["mug"], things=lambda: [(made.mug(AROUND), *where)])
    rig = animate(armature, shown, frames)
    add_things(armature, rig, shown)
    rigged = rigged_hands(armature, ("Left",))
    seen = Surroundings(rigged, obstacles_of(rigged, None))
    _, reading = timed(lambda: [seen.look(depsgraph) for depsgraph in played(bpy.context, 1 + np.arange(frames))])
    hand, wrists = rigged.hands["Left"], seen.wrists["Left"]
    wanted = hand.angles_from_turns(seen.turns("Left").astype(np.float32))
    around = seen.around("Left", {"Left": wanted})
    nearest, model = over_time(around), load_hand_model(threads=1)

    def avoid():
        return run(avoiding(hand, wrists, wanted, around, 24, model, FingerOptions()))

    def sweep():
        rows = every_row(frames)
        flat, closed = (finger_angles(np.broadcast_to(pose, wanted.shape))[rows] for pose in (POSES["flat"], wanted))
        return swept(Probe(hand, wrists, nearest), *rows, flat, closed)[0].reshape(wanted.shape)

    _, first = timed(avoid)
    result, again = min((timed(avoid) for _ in range(3)), key=lambda run: run[1])
    stopped, swept_in = min((timed(sweep) for _ in range(3)), key=lambda run: run[1])
    print(f"{len(made.mug(AROUND)[1])} triangles, {frames} frames\n")
    print(f"{'':<10}{'ms per hand-frame':>18}{'pierced before':>16}{'after':>8}{'deepest':>10}{'moved':>9}")
    for name, took, angles in (("avoiding", again, result.angles), ("sweep", swept_in, stopped)):
        depths = finger_depths(hand, wrists, nearest, angles).max(-1)
        moved = np.linalg.norm(np.diff(hand.positions(angles)[:, 15:], axis=0), axis=-1).max()
        free = ~result.palm_inside
        before = (result.before[free] > 1e-3).mean()
        print(f"{name:<10}{took / frames:>18.2f}{before:>16.0%}{(depths[free] > 1e-3).mean():>8.1%}{1000 * depths[free].max():>7.2f} mm{1000 * moved:>6.0f} mm")
    print(f"\nonce for the obstacle: {first - again:.0f} ms; playing the scene: {reading / frames:.1f} ms per frame")
    print("deepest: of any finger in any frame; moved: furthest that a fingertip moves in the palm from one frame to the next")


if __name__ == "__main__":
    main()
