"""`solve`: a take -> a BVH on the engine's skeleton, without Blender."""

from __future__ import annotations

import argparse
import time
from pathlib import Path
from typing import Any

from ..console import Console
from ..errors import InputError
from .calibration import add_calibration_arguments, calibration_options, read_calibrated

HELP = "solve a take for the engine's own body and write a BVH"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("take", type=Path, metavar="TAKE", help="a three-point recording")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="OUT.bvh", help="the BVH to write")
    add_solve_arguments(parser)
    body = parser.add_mutually_exclusive_group()
    body.add_argument("--stature", type=float, metavar="M", help="height of the body in metres (default: measured from the take)")
    body.add_argument("--skeleton", type=Path, metavar="CLIP.bvh", help="take the bone offsets of this file's body")
    parser.add_argument("--fps", type=float, default=30.0, help="frames per second of the BVH (default 30)")
    add_calibration_arguments(parser)


def add_solve_arguments(parser: argparse.ArgumentParser) -> None:
    """The options that `solve` and `bake` share."""
    parser.add_argument("--model", type=Path, metavar="DIR", help="model folder (default: the shipped one)")
    parser.add_argument("--mode", choices=("lookahead", "causal"), default="lookahead", help="use the whole take, or only what came before each frame")
    parser.add_argument("--candidates", type=int, default=16, metavar="K", help="futures drawn from the codebook at a time (default 16)")
    parser.add_argument("--variation", type=int, default=0, metavar="N", help="0 is the most agreed answer, others are different ones")
    parser.add_argument("--seed", type=int, default=0, help="the same seed gives the same motion")


def solve_options(args: argparse.Namespace) -> Any:
    """SolveOptions from parsed arguments; InputError for values that make no sense."""
    from ..solve.perform import SolveOptions

    if args.candidates < 1:
        raise InputError("--candidates", f"is {args.candidates}; at least 1 is needed")
    if args.variation < 0 or args.seed < 0:
        raise InputError("--variation and --seed", "are numbers from 0")
    return SolveOptions(args.mode, args.candidates, args.variation, args.seed)


def run(args: argparse.Namespace, console: Console) -> dict[str, Any]:
    from ..features import proportions_of
    from ..learn.dataset import read_body_motion
    from ..motion.bvh import write_bvh
    from ..motion.resample import frame_times
    from ..motion.skeleton import BODY_JOINTS, STANDARD_BODY, standard_body
    from ..outputs import replacing
    from ..solve.fuse import fuse
    from ..solve.models import load_model
    from ..solve.perform import calibration_warnings, perform

    if args.fps <= 0:
        raise InputError("--fps", f"is {args.fps:g}; a positive number is needed")
    options = solve_options(args)
    with replacing(args.output, args.overwrite) as temporary:
        model = load_model(args.model)
        calibrated = read_calibrated(args.take, calibration_options(args))
        take, calibration = calibrated.take, calibrated.calibration
        if args.skeleton:
            body = read_body_motion(args.skeleton).skeleton.subset(BODY_JOINTS)
        elif args.stature:
            body = standard_body(args.stature)
        else:
            body = STANDARD_BODY.scaled(calibration.head_height / STANDARD_BODY.height_above_toes("Head"))
        # The body is the person's own: its head height is the take's, so that the world stays that of the take.
        head_height, proportions = body.height_above_toes("Head"), proportions_of(body)
        warnings = [*calibration.warnings, *calibration_warnings(take, head_height, model, options)]
        for warning in warnings:
            console.say(f"{args.take}: {warning}")
        started = time.perf_counter()
        performance = console.run(perform(take, head_height, proportions, model, options))
        motion = fuse(performance, take, frame_times(take.times[0], take.times[-1], args.fps), body)
        seconds = time.perf_counter() - started
        write_bvh(temporary, motion)
    console.say(f"{args.output}: {len(motion)} frames at {args.fps:g} fps solved in {seconds:.1f} s with model '{model.name}' ({options.mode})")
    return {
        "take": args.take,
        "output": args.output,
        "frames": len(motion),
        "fps": args.fps,
        "model": model.name,
        "mode": options.mode,
        "solve_seconds": seconds,
        "calibration": calibration.as_dict(),
        "warnings": warnings,
    }
