"""`bake`: takes -> actions on an armature, in a blend file."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..console import Console
from ..errors import InputError
from .calibration import add_calibration_arguments, calibration_options, read_calibrated
from .solve import add_solve_arguments, solve_options
from .values import two_amounts

if TYPE_CHECKING:
    from ..solve.models import Model

HELP = "bake takes onto an armature as new actions, and save a blend file"
PRESETS = ("rigify", "rigify-metarig")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from ..rigs.limbs import LIMBS
    from ..rigs.travel import ROOTS

    parser.add_argument("takes", type=Path, nargs="+", metavar="TAKE", help="three-point recordings; each becomes an action")
    target = parser.add_mutually_exclusive_group(required=True)
    target.add_argument("--rig", metavar="NAME", help="an armature of the file")
    target.add_argument("--preset", choices=PRESETS, help="add one of Blender's own humans")
    parser.add_argument("--blend", type=Path, metavar="IN.blend", help="the file with the armature (default: the one that is open); it is not changed")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="OUT.blend", help="the blend file to write")
    parser.add_argument("--map", type=Path, metavar="MAP.json", help="which bones play which joints, as `cbm rigs --save-map` writes it (default: recognised)")
    parser.add_argument("--root", choices=ROOTS, default="hips", help="what carries the way over the ground (default hips); in-place: nothing")
    parser.add_argument("--limbs", choices=LIMBS, default="fk", help="on a generated Rigify rig: key the FK or the IK controls of arms and legs, or both")
    parser.add_argument(
        "--part", choices=("full", "lower"), default="full", help="lower: hips and legs follow the take, head and wrists stay where an animation has them"
    )
    parser.add_argument("--variations", type=int, default=1, metavar="N", help="bake N variations of every take, from --variation on (default 1)")
    parser.add_argument("--reduce", type=two_amounts, metavar="MM,DEG", help="thin the keys, so far as joints stay that near the full bake (5,1 is unseen)")
    parser.add_argument("--push-down", action="store_true", help="keep the armature's earlier action, and all bakes but the first, as muted NLA tracks")
    parser.add_argument("--no-fake-user", dest="fake_user", action="store_false", help="let Blender drop the new action once the armature has another")
    parser.add_argument("--preview", type=Path, action="append", default=[], metavar="OUT.mp4|OUT.png", help="render the first take, variations side by side")
    add_solve_arguments(parser)
    add_calibration_arguments(parser)


def run(args: argparse.Namespace, console: Console) -> dict[str, Any]:
    from ..solve.models import load_model

    return bake_file(args, console, load_model)


def bake_file(args: argparse.Namespace, console: Console, models: Callable[[Path | None], Model], kept: Path | None = None) -> dict[str, Any]:
    """Bakes what the arguments say and returns the report.

    models  gives the model of a folder
    kept    a folder in which the new file of a preset is kept for the next bake
    """
    try:
        from ..scene import blend_file
        from ..scene.bake import BakeOptions, bake_variations
        from ..scene.preview import Shot, check_preview, render_preview
        from ..scene.proxy import add_proxy, meshes_of
        from ..scene.reduction import Reduction
    except ModuleNotFoundError as error:
        raise InputError(error.name or "bpy", "is not installed here; run `bake` inside Blender, or `pip install bpy`") from error
    from ..outputs import replacing_all
    from ..rigs.tables import load_table

    started = time.perf_counter()
    options = solve_options(args)
    table = load_table(args.map) if args.map else None
    reduction = Reduction(*args.reduce) if args.reduce else None
    _check(args)
    blend_file.check_files(args.blend, None if kept else blend_file.opened(), args.output)
    for preview in args.preview:
        check_preview(preview)
    with replacing_all([args.output, *args.preview], args.overwrite) as (blend, *previews):
        model = models(args.model)
        recordings = [read_calibrated(path, calibration_options(args)) for path in args.takes]
        for path, calibrated in zip(args.takes, recordings, strict=True):
            for warning in calibrated.calibration.warnings:
                console.say(f"{path}: {warning}")
        target = blend_file.open_target(args.blend, args.rig, args.preset, kept)
        how = BakeOptions(args.part, options, args.root, table, args.limbs, reduction, args.fake_user, args.push_down)
        bakes: list[dict[str, Any]] = []
        for path, calibrated in reversed(list(zip(args.takes, recordings, strict=True))):  # so that the first is the one that the armature is left with
            reports = console.run(bake_variations(target.context, target.armature, calibrated, model, how, args.variations))
            for warning in reports[0].warnings:
                console.say(f"{path}: {warning}")
            bakes = [{"take": path, **asdict(report), "calibration": calibrated.calibration.as_dict()} for report in reports] + bakes
        if not meshes_of(target.armature):
            add_proxy(target.armature, table)
        first, scale = recordings[0], bakes[0]["scale"]
        head_height = first.calibration.head_height * scale
        if target.is_new:
            blend_file.furnish(target.context.scene, first.take, scale, head_height)
        compared = [made["action"] for made in bakes[: args.variations]] if args.variations > 1 else []
        shot = Shot(target.armature, first.take, scale, head_height, blend_file.actions(compared))
        for preview in previews:
            console.run(render_preview(target.context.scene, shot, preview))
        blend_file.save_blend(blend)
    seconds = time.perf_counter() - started
    for made in bakes:
        console.say(_summary(made, args.part))
    made = ", ".join(str(path) for path in (args.output, *args.preview))
    console.say(f"{made}: made in {seconds:.1f} s; open with `blender {args.output}`")
    return {
        "output": args.output,
        "previews": args.preview,
        "rig": target.armature.name,
        "part": args.part,
        "limbs": args.limbs,
        "model": model.name,
        "mode": options.mode,
        "bakes": bakes,
        "total_seconds": seconds,
    }


def _check(args: argparse.Namespace) -> None:
    if args.variations < 1:
        raise InputError("--variations", f"is {args.variations}; at least 1 is needed")
    if args.reduce and not all(args.reduce):
        raise InputError("--reduce", f"allows {args.reduce[0]:g} mm and {args.reduce[1]:g} degrees; both must be more than 0")


def _summary(made: dict[str, Any], part: str) -> str:
    line = f"{made['action']}: {made['frames']} frames at {made['fps']:g} fps baked in {made['seconds']:.1f} s"
    errors = made["tracker_errors"].values()
    if errors:
        median = max(error["median_cm"] for error in errors)
        share = min(error["share_within_1_cm"] for error in errors)
        where = "the trackers" if part == "full" else "where the animation has them"
        line += f"; head and wrists within 1 cm of {where} in {share:.1%} of measured frames or more (median {median:.2f} cm)"
    elif part == "lower":
        line += "; hips and legs carry the upper body along, which is not animated where the take is"
    if thinned := made["reduction"]:
        away = f"{thinned['largest_mm']:.1f} mm and {thinned['largest_deg']:.1f}°"
        line += f"; {thinned['keys_before']} keys thinned to {thinned['keys_after']}, joints at most {away} away"
    return line
