"""`synthesize`: a three-point take from mocap, or the shipped sample take."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..console import Console
from ..errors import InputError
from .values import two_amounts

HELP = "make a three-point take from mocap"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from ..takes.devices import CONTROLLERS

    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("clip", type=Path, nargs="?", metavar="CLIP.bvh", help="mocap with the engine's joint names")
    source.add_argument("--sample", action="store_true", help="the procedural motion behind the shipped sample take")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="TAKE.csv", help="the take to write")
    parser.add_argument("--device", choices=("none", *CONTROLLERS), default="none", help="poses of these controllers and a headset (default: of the joints)")
    parser.add_argument("--noise", type=two_amounts, metavar="MM,DEG", help="white noise: standard deviations per axis")
    parser.add_argument("--hmd-only", action="store_true", help="the hands are not tracked")
    parser.add_argument("--seed", type=int, default=0, help="the same seed gives the same noise")


def run(args: argparse.Namespace, console: Console) -> dict[str, Any]:
    from ..motion.bvh import read_bvh
    from ..outputs import replacing
    from ..takes import native_csv
    from ..takes.sample_motion import sample_motion
    from ..takes.synthesize import synthesize

    if args.seed < 0:
        raise InputError("--seed", f"is {args.seed}; a number from 0 is needed")
    with replacing(args.output, args.overwrite) as temporary:
        motion = sample_motion() if args.sample else read_bvh(args.clip)
        take = synthesize(motion, args.device, args.noise, args.hmd_only, args.seed, name="sample" if args.sample else str(args.clip))
        native_csv.write(temporary, take)
    console.say(f"{args.output}: {len(take)} samples, {take.seconds:.2f} s, poses of {'the joints' if take.kind == 'joint' else args.device}")
    return {"source": "sample" if args.sample else args.clip, "output": args.output, "samples": len(take), "seconds": take.seconds, "poses": take.kind}
