"""Every take format and every kind of rig, in pairs that are baked: `python benchmarks/pairs.py` in an environment with bpy (Linux).

Each format is written from its description by the code that tests its reader, out of the sample take; `--takes FOLDER` adds real recordings.
Rigs are those of benchmarks/rigs.py, the generated Rigify rig also through its own inverse kinematics. Formats and rigs take turns until both
have had theirs; `--all` pairs each with each.

head, wrists  distance to the tracker over frames, median and largest, cm, and the largest angle to it, degrees (the wrists: the worse)
slide         median speed over the floor of ankles and toes in contact, cm/s at the performer's size: on the rig, and on the engine's own body
exact         largest distance of an evaluated bone from where its joint was solved, millimetres at the performer's size, and what is allowed:
              0.1 through forward kinematics, 1 through the rig's own inverse kinematics
"""

from __future__ import annotations

import argparse
import json
import os
import struct
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
from rigs import REPOSITORY, Baked, Case, baked, cases, motion_of_the_engine, new_file

SUFFIXES = (".csv", ".bsor", ".txt", ".bvh", ".fbx", ".glb", ".gltf")
SKIPPED = 2.0  # seconds at the start of a long take
FK, IK = 0.1, 1.0  # millimetres


@dataclass(frozen=True)
class Source:
    """A take that is read by `read` in an empty scene."""

    name: str
    read: Callable[[], object]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=6.0, help="how much of each take is baked (default: 6)")
    parser.add_argument("--takes", type=Path, metavar="FOLDER", help="real recordings, all that are found below a folder")
    parser.add_argument("--all", action="store_true", help="every take with every rig")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as resources, tempfile.TemporaryDirectory() as folder:
        os.environ["BLENDER_USER_RESOURCES"] = resources
        sys.path.insert(0, str(REPOSITORY))
        failures = show([*written(Path(folder)), *(found(args.takes) if args.takes else ())], args.seconds, args.all)
    print(f"{failures} of the pairs are not as exact as they must be" if failures else "all pairs are as exact as they must be", flush=True)
    os._exit(min(failures, 1))  # Blender 4.5 as a Python module hangs at its exit when classes of an add-on are left


def show(sources: list[Source], seconds: float, everything: bool) -> int:
    """Prints a row a pair; how many were not exact."""
    from cbm_addon.scene.silence import silence
    from cbm_addon.solve.models import load_model

    model = load_model()
    performed = list(performances(sources, seconds, model))
    print(f"\n{'take':<26}{'read as':<28}{'rig':<36}{'head':>18}{'wrists':>19}{'slide':>13}{'exact':>10}")
    failures = 0
    for (name, calibrated, engine), (case, limbs) in pairs(performed, list(rig_cases()), everything):
        with silence():
            new_file()
            made = baked(case.add(), calibrated, model, engine, limbs)
        failures += made.exact > (FK if limbs == "fk" else IK)
        report = calibrated.take.report
        rig = case.name + (", IK" if limbs == "ik" else "")
        print(f"{name:<26}{report.format if report else '-':<28}{rig:<36}{row(made)}", flush=True)
    return failures


def performances(sources: list[Source], seconds: float, model) -> Iterator[tuple]:
    """Name, calibrated take and the motion of the engine's own body, of every take that is read; what is refused is printed."""
    from cbm_addon.errors import InputError
    from cbm_addon.scene.silence import silence

    for source in sources:
        try:
            with silence():
                new_file()
                calibrated = piece(source.read(), seconds)
                engine = motion_of_the_engine(calibrated, model)
        except InputError as refusal:
            print(f"refused: {refusal}", flush=True)
            continue
        yield source.name, calibrated, engine


def row(made: Baked) -> str:
    apart, off = 100 * made.apart, made.off
    columns = (f"{np.median(apart[:, which], axis=0).max():.2f} {apart[:, which].max():.2f} {off[:, which].max():.1f}°" for which in ([0], [1, 2]))
    return "".join(f"{column:>18} " for column in columns) + f"{made.slide:>6.1f} ({made.engine_slide:.1f}){made.exact:>10.3f}"


def rig_cases() -> Iterator[tuple[Case, str]]:
    for case in cases():
        yield case, "fk"
        if case.name == "Rigify, generated":
            yield case, "ik"


def pairs(takes: list[tuple], rigs: list[tuple[Case, str]], everything: bool) -> Iterator[tuple[tuple, tuple[Case, str]]]:
    if everything:
        yield from product(takes, rigs)
        return
    for i in range(max(len(takes), len(rigs))):
        yield takes[i % len(takes)], rigs[i % len(rigs)]


def piece(take, seconds: float):
    """Some seconds of a take, calibrated on all of it, its time from 0."""
    from cbm_addon.solve.perform import sampled
    from cbm_addon.takes.calibrate import calibrate

    calibrated = calibrate(take)
    take = calibrated.take
    start = take.times[0] + (SKIPPED if take.seconds > SKIPPED + seconds else 0)
    cut = sampled(take, np.arange(start, min(start + seconds, take.times[-1]), 1 / 72))
    return replace(calibrated, take=replace(cut, times=cut.times - cut.times[0]))


# Takes


def found(folder: Path) -> Iterator[Source]:
    from cbm_addon.commands.calibration import read_any_take
    from cbm_addon.takes.recording import TakeOverrides

    for path in sorted(path for path in folder.rglob("*") if path.suffix.lower() in SUFFIXES):
        yield Source(path.stem[:25], partial(read_any_take, path, TakeOverrides()))


def written(folder: Path) -> Iterator[Source]:
    """The sample take in every format."""
    from cbm_addon.commands.calibration import read_any_take
    from cbm_addon.takes import native_csv
    from cbm_addon.takes.recording import TakeOverrides
    from cbm_addon.takes.sample_motion import sample_take
    from tests.engine import test_take_brekel, test_take_bvh, test_take_vmc, test_take_xr_csv
    from tests.scene import test_take_objects

    native_csv.write(folder / "native.csv", sample_take())
    (folder / "replay.bsor").write_bytes(bsor())
    test_take_xr_csv.write(folder / "research.csv", test_take_xr_csv.columns())
    (folder / "brekel.txt").write_text(test_take_brekel.text())
    (folder / "trackers.bvh").write_text(test_take_bvh.text())
    (folder / "nodes.gltf").write_text(json.dumps(test_take_objects.gltf()))
    for name in ("native.csv", "replay.bsor", "research.csv", "brekel.txt", "trackers.bvh", "nodes.gltf"):
        yield Source(name, partial(read_any_take, folder / name, TakeOverrides()))
    yield Source("nulls.fbx", partial(with_blender, folder / "nulls.fbx"))
    yield Source("recorded.blend", partial(with_blender, folder / "recorded.blend"))
    yield Source("animated objects", partial(with_blender, None))
    yield Source("VMC packets", lambda: test_take_vmc.received(folder, [test_take_vmc.frame(i) for i in range(test_take_vmc.COUNT)]))


def bsor() -> bytes:
    """The sample take as a replay: metres, Y up, looking along +Z."""
    from cbm_addon.motion.rotations import matrix_from_quat, quat_from_matrix
    from cbm_addon.takes.frames import AXES
    from cbm_addon.takes.sample_motion import sample_take
    from tests.engine.test_take_bsor import header

    take, c = sample_take(), AXES["unity"]
    places = take.positions.astype(np.float64) @ c
    turns = quat_from_matrix(c.T @ matrix_from_quat(take.rotations.astype(np.float64)) @ c)[..., [1, 2, 3, 0]]
    rows = np.concatenate((places, turns), axis=-1).reshape(len(take), 21)
    frames = b"".join(struct.pack("<fi21f", time, 72, *values) for time, values in zip(take.times, rows, strict=True))
    return header() + b"\1" + struct.pack("<i", len(take)) + frames + b"".join(bytes([block]) + struct.pack("<i", 0) for block in (2, 3, 4, 5))


def with_blender(path: Path | None):
    """Empties that do what the trackers do, read from a file that Blender wrote of them, or from the scene."""
    import bpy

    from cbm_addon.commands.calibration import read_any_take
    from cbm_addon.scene.take_objects import objects_take
    from cbm_addon.takes.recording import TakeOverrides
    from tests.scene.test_take_objects import TRUTH, empties, record

    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, len(TRUTH)
    record(empties(scene, ("HMD", "MotionControllerLeft", "MotionControllerRight")), scene)
    if path is None:
        return objects_take(scene, Path("scene"), TakeOverrides())
    if path.suffix == ".fbx":
        bpy.ops.export_scene.fbx(
            filepath=str(path), object_types={"EMPTY"}, bake_anim_simplify_factor=0, bake_anim_use_nla_strips=False, bake_anim_use_all_actions=False
        )
    else:
        bpy.ops.wm.save_as_mainfile(filepath=str(path))
    new_file()
    return read_any_take(path, TakeOverrides())


if __name__ == "__main__":
    main()
