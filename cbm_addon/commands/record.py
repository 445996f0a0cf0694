"""`record`: a take from a program that sends poses of devices over the network (VMC protocol)."""

from __future__ import annotations

import argparse
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

from ..console import Console
from ..errors import InputError
from .calibration import add_take_arguments, take_overrides

HELP = "record a take from a program that sends the VMC protocol"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from ..takes.vmc import HOST, PORT

    parser.add_argument("-o", "--output", type=Path, required=True, metavar="TAKE.csv", help="the take to write")
    parser.add_argument("--host", default=HOST, metavar="ADDRESS", help=f"address to receive at (default {HOST}: this machine only)")
    parser.add_argument("--port", type=int, default=PORT, help=f"port to receive at (default {PORT})")
    parser.add_argument("--seconds", type=float, metavar="S", help="length, from the first pose of a headset on (default: until Ctrl-C)")
    add_take_arguments(parser)


def run(args: argparse.Namespace, console: Console) -> dict[str, Any]:
    from ..outputs import replacing
    from ..takes import native_csv
    from ..takes.vmc import VmcRecorder, listen, record

    if args.seconds is not None and not args.seconds > 0:
        raise InputError("--seconds", f"is {args.seconds:g}; a positive number is needed")
    recorder = VmcRecorder()
    with replacing(args.output, args.overwrite) as temporary:
        with closing(listen(args.host, args.port)) as receiver, suppress(KeyboardInterrupt):  # which ends a recording, and keeps it
            console.run(record(receiver, recorder, args.seconds))
        take = recorder.take(args.output, take_overrides(args))
        native_csv.write(temporary, take)
    assert take.report is not None
    console.say(f"{args.output}: {len(take)} samples, {take.seconds:.2f} s, {take.rate:.1f} a second")
    for defect in take.report.defects:
        console.say(f"  ! {defect.message}")
    return {
        "output": args.output,
        "samples": len(take),
        "seconds": take.seconds,
        "rate_hz": take.rate,
        "defects": [defect.kind for defect in take.report.defects],
    }
