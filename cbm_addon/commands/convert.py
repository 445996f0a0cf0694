"""`convert`: any readable take to the native take CSV, any readable mocap to the engine's BVH."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..console import Console
from ..errors import InputError
from .calibration import add_take_arguments, take_overrides

HELP = "convert a take to the native take CSV, or mocap to BVH"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("input", type=Path, metavar="IN", help="a take (.bsor, CSV) or mocap (BVH)")
    parser.add_argument("output", type=Path, metavar="OUT", help="a .csv for a take, a .bvh for mocap")
    add_take_arguments(parser)


def run(args: argparse.Namespace, console: Console) -> dict[str, Any]:
    from ..motion.bvh import read_bvh, write_bvh
    from ..outputs import replacing
    from ..takes import native_csv
    from ..takes.readers import is_bvh, read_take

    mocap = is_bvh(args.input)
    suffix = ".bvh" if mocap else ".csv"
    if args.output.suffix.lower() != suffix:
        raise InputError(args.output, f"{'mocap' if mocap else 'a take'} is written to a file that ends in {suffix}")
    with replacing(args.output, args.overwrite) as temporary:
        if mocap:
            samples = read_bvh(args.input)
            write_bvh(temporary, samples)
        else:
            samples = read_take(args.input, take_overrides(args))
            native_csv.write(temporary, samples)
    console.say(f"{args.output}: {len(samples)} {'frames' if mocap else 'samples'}, {samples.seconds:.2f} s")
    return {"input": args.input, "output": args.output, "samples": len(samples), "seconds": samples.seconds}
