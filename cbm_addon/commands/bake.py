"""`bake`: takes -> actions on an armature, in a blend file."""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..console import Console
from ..errors import InputError
from .calibration import add_calibration_arguments, calibration_options, read_calibrated
from .solve import add_solve_arguments, solve_options

if TYPE_CHECKING:
    from ..solve.perform import SolveOptions
    from ..takes.calibrate import Calibrated

HELP = "bake takes onto an armature as new actions, and save a blend file"
PRESETS = ("rigify", "rigify-metarig")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from ..rigs.travel import ROOTS

    parser.add_argument("takes", type=Path, nargs="+", metavar="TAKE", help="three-point recordings; each becomes an action")
    target = parser.add_mutually_exclusive_group(required=True)
    target.add_argument("--rig", metavar="NAME", help="an armature of the file")
    target.add_argument("--preset", choices=PRESETS, help="add one of Blender's own humans")
    parser.add_argument("--blend", type=Path, metavar="IN.blend", help="the file with the armature (default: the one that is open); it is not changed")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="OUT.blend", help="the blend file to write")
    parser.add_argument("--map", type=Path, metavar="MAP.json", help="which bones play which joints, as `cbm rigs --save-map` writes it (default: recognised)")
    parser.add_argument("--root", choices=ROOTS, default="hips", help="what carries the way over the ground (default hips); in-place: nothing")
    parser.add_argument("--part", choices=("full", "lower"), default="full", help="lower: key hips and legs only, keep the animation of the rest")
    parser.add_argument("--variations", type=int, default=1, metavar="N", help="bake N variations of every take, from --variation on (default 1)")
    parser.add_argument("--preview", type=Path, action="append", default=[], metavar="OUT.mp4|OUT.png", help="render the first bake; may be repeated")
    add_solve_arguments(parser)
    add_calibration_arguments(parser)


def run(args: argparse.Namespace, console: Console) -> dict[str, Any]:
    try:
        from ..scene import blend_file
        from ..scene.bake import BakeOptions, bake
        from ..scene.preview import Shot, check_preview, render_preview
        from ..scene.proxy import add_proxy, meshes_of
    except ModuleNotFoundError as error:
        raise InputError(error.name or "bpy", "is not installed here; run `bake` inside Blender, or `pip install bpy`") from error
    from ..outputs import replacing_all
    from ..rigs.tables import load_table
    from ..solve.models import load_model

    started = time.perf_counter()
    options = solve_options(args)
    table = load_table(args.map) if args.map else None
    if args.variations < 1:
        raise InputError("--variations", f"is {args.variations}; at least 1 is needed")
    blend_file.check_files(args.blend, args.output)
    for preview in args.preview:
        check_preview(preview)
    with replacing_all([args.output, *args.preview], args.overwrite) as (blend, *previews):
        model = load_model(args.model)
        recordings = [read_calibrated(path, calibration_options(args)) for path in args.takes]
        for path, calibrated in zip(args.takes, recordings, strict=True):
            for warning in calibrated.calibration.warnings:
                console.say(f"{path}: {warning}")
        target = blend_file.open_target(args.blend, args.rig, args.preset)
        wanted = list(_wanted(args.takes, recordings, options, args.variations))
        bakes: list[dict[str, Any]] = []
        for path, calibrated, solve in reversed(wanted):  # so that the first is the one that the armature is left with
            job = bake(target.context, target.armature, calibrated, model, BakeOptions(args.part, solve, args.root, table))
            report = console.run(job)
            bakes.insert(0, {"take": path, "variation": solve.variation, **asdict(report), "calibration": calibrated.calibration.as_dict()})
        if not meshes_of(target.armature):
            add_proxy(target.armature, table)
        first, scale = recordings[0], bakes[0]["scale"]
        head_height = first.calibration.head_height * scale
        if target.is_new:
            blend_file.furnish(target.context.scene, first.take, scale, head_height)
        for preview in previews:
            console.run(render_preview(target.context.scene, Shot(target.armature, first.take, scale, head_height), preview))
        blend_file.save_blend(blend)
    seconds = time.perf_counter() - started
    for made in bakes:
        console.say(_summary(made))
    made = ", ".join(str(path) for path in (args.output, *args.preview))
    console.say(f"{made}: made in {seconds:.1f} s; open with `blender {args.output}`")
    return {
        "output": args.output,
        "previews": args.preview,
        "rig": target.armature.name,
        "part": args.part,
        "model": model.name,
        "mode": options.mode,
        "bakes": bakes,
        "total_seconds": seconds,
    }


def _wanted(paths: list[Path], recordings: list[Calibrated], options: SolveOptions, variations: int) -> Iterator[tuple[Path, Calibrated, SolveOptions]]:
    for path, calibrated in zip(paths, recordings, strict=True):
        for variation in range(options.variation, options.variation + variations):
            yield path, calibrated, replace(options, variation=variation)


def _summary(made: dict[str, Any]) -> str:
    line = f"{made['action']}: {made['frames']} frames at {made['fps']:g} fps baked in {made['seconds']:.1f} s"
    errors = made["tracker_errors"].values()
    if errors:
        median = max(error["median_cm"] for error in errors)
        share = min(error["share_within_1_cm"] for error in errors)
        line += f"; head and wrists within 1 cm of the trackers in {share:.1%} of measured frames or more (median {median:.2f} cm)"
    return line
