"""`convert`: any readable take to the native take CSV, any readable mocap to the engine's BVH."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..console import Console
from ..errors import InputError
from .calibration import add_take_arguments, is_mocap, read_any_take, take_overrides

if TYPE_CHECKING:
    from ..takes.take import Take

HELP = "convert a take to the native take CSV, or mocap to BVH"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("input", type=Path, metavar="IN", help="a take of any format, or mocap (BVH)")
    parser.add_argument("output", type=Path, metavar="OUT", help="a .csv for a take, a .bvh for mocap")
    split = "split a take where the head is lost for S seconds or jumps, into OUT_1.csv, OUT_2.csv …"
    parser.add_argument("--split", type=float, metavar="S", help=split)
    add_take_arguments(parser)


def run(args: argparse.Namespace, console: Console) -> dict[str, Any]:
    from ..outputs import replacing_all
    from ..takes import native_csv

    overrides = take_overrides(args)
    mocap = is_mocap(args.input, overrides)
    suffix = ".bvh" if mocap else ".csv"
    if args.output.suffix.lower() != suffix:
        raise InputError(args.output, f"{'mocap' if mocap else 'a take'} is written to a file that ends in {suffix}")
    if mocap:
        return _convert_mocap(args, console)
    take = read_any_take(args.input, overrides)
    pieces = {args.output: take} if args.split is None else _pieces(args, take)
    with replacing_all(pieces, args.overwrite) as temporaries:
        for temporary, piece in zip(temporaries, pieces.values(), strict=True):
            native_csv.write(temporary, piece)
    for output, piece in pieces.items():
        console.say(f"{output}: {len(piece)} samples, {piece.seconds:.2f} s")
    outputs = [{"output": output, "samples": len(piece), "seconds": piece.seconds} for output, piece in pieces.items()]
    return {"input": args.input, **(outputs[0] if args.split is None else {"pieces": outputs})}


def _convert_mocap(args: argparse.Namespace, console: Console) -> dict[str, Any]:
    from ..motion.bvh import read_bvh, write_bvh
    from ..outputs import replacing

    if args.split is not None:
        raise InputError("--split", "is for takes; mocap is one piece")
    with replacing(args.output, args.overwrite) as temporary:
        motion = read_bvh(args.input)
        write_bvh(temporary, motion)
    console.say(f"{args.output}: {len(motion)} frames, {motion.seconds:.2f} s")
    return {"input": args.input, "output": args.output, "samples": len(motion), "seconds": motion.seconds}


def _pieces(args: argparse.Namespace, take: Take) -> dict[Path, Take]:
    from ..takes.cleaning import split

    if not args.split > 0:
        raise InputError("--split", f"is {args.split:g}; a positive number of seconds is needed")
    pieces = split(take, args.split)
    return {args.output.with_stem(f"{args.output.stem}_{number}"): piece for number, piece in enumerate(pieces, start=1)}
