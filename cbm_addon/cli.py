"""The command line: one parser for `python -m cbm_addon COMMAND`, `cbm COMMAND` and `blender -b --command cbm COMMAND`."""

from __future__ import annotations

import argparse
import json
import sys
import time
import traceback
from contextlib import nullcontext
from importlib import import_module
from pathlib import Path
from typing import NoReturn

from . import __version__
from .console import Console
from .errors import InputError
from .outputs import plain, replacing

COMMANDS = ("info", "convert", "record", "synthesize", "train", "solve", "bake", "batch", "fingers", "rigs", "evaluate", "toy", "models")

DONE, OUR_FAULT, BAD_INPUT, CANCELLED = 0, 1, 2, 130


class UsageError(Exception):
    """The command line itself does not parse."""


class Parser(argparse.ArgumentParser):
    """Raises UsageError where argparse would print the usage and leave the process."""

    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message} (see {self.prog} --help)")


def main(argv: list[str] | None = None) -> int:
    """Runs one command and returns the exit code: 0 done, 1 a fault of ours, 2 bad usage or input, 130 cancelled."""
    try:
        args = build_parser().parse_args(argv)
        with replacing(args.json, overwrite=True) if args.json else nullcontext() as report_file:
            started = time.perf_counter()
            report = args.run(args, Console(args.quiet, args.json_lines))
            if report_file:
                facts = {"command": args.command, "version": __version__, "seconds": time.perf_counter() - started}
                report_file.write_text(json.dumps(plain(facts | report), indent=2) + "\n", encoding="utf-8")
    except (InputError, UsageError) as error:
        print("error:", " ".join(str(error).split()), file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        print("cancelled", file=sys.stderr)
        return CANCELLED
    except SystemExit as leave:  # --help and --version: inside Blender they must not end the process
        return DONE if leave.code is None else int(leave.code)
    except Exception:
        traceback.print_exc()
        return OUR_FAULT
    if "error" in report:  # some of it failed, and the report says what became of the rest
        print("error:", report["error"], file=sys.stderr)
        return BAD_INPUT
    return DONE


def build_parser() -> Parser:
    """The parser of every command in COMMANDS; parsed arguments carry the command's `run`."""
    parser = Parser(prog="cbm", description="From a headset and two controllers to a full-body performance on any Blender armature.")
    parser.add_argument("--version", action="version", version=__version__)
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for name in COMMANDS:
        command = import_module(f".commands.{name}", __package__)
        options = commands.add_parser(name, help=command.HELP, description=command.HELP)
        command.add_arguments(options)
        options.add_argument("--json", type=Path, metavar="FILE", help="write a machine-readable report")
        options.add_argument("--quiet", action="store_true", help="hide the progress bar")
        options.add_argument("--json-lines", action="store_true", help="print progress as JSON lines, for a program that drives this one")
        options.add_argument("--overwrite", action="store_true", help="replace outputs that exist")
        options.set_defaults(run=command.run)
    return parser
