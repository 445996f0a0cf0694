"""`toy`: the ambiguous function of the paper's appendix A, answered by every method."""

from __future__ import annotations

import argparse
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from ..console import Console
from ..errors import InputError

HELP = "compare codebook matching with other methods on the ambiguous function of the paper's appendix"

REPORT_FILES = ("results.md", "toy_function.svg", "toy_answers.svg", "toy_beyond.svg", "toy_gap.svg")
SUMMARY_LINE = ("coherent", "positive", "reconstruction_error", "gap_error")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--report", type=Path, metavar="DIR", help="write the table and the figures to this folder")
    parser.add_argument("--seed", type=int, default=1, help="the same seed gives the same networks and answers")
    parser.add_argument("--steps", type=int, default=10000, metavar="N", help="training steps of every method (default: 10000)")


def run(args: argparse.Namespace, console: Console) -> dict[str, Any]:
    from ..outputs import replacing_all

    try:
        from ..evaluate.toy.experiment import budget, compare
        from ..evaluate.toy.report import figures, markdown
    except ImportError as error:
        raise InputError("torch", f"is needed to train ({error}); `pip install torch`") from error
    if args.seed < 0:
        raise InputError("--seed", f"is {args.seed}; it is a number from 0")
    if args.steps < 1:
        raise InputError("--steps", f"is {args.steps}; at least 1 step is needed")
    if args.report:
        args.report.mkdir(parents=True, exist_ok=True)
    with replacing_all([args.report / name for name in REPORT_FILES], args.overwrite) if args.report else nullcontext() as report:
        outcomes = console.run(compare(args.steps, args.seed))
        facts = budget(args.steps, args.seed)
        if report:
            for path, text in zip(report, [markdown(outcomes, facts), *figures(outcomes).values()], strict=True):
                path.write_text(text, encoding="utf-8")
    for name, outcome in outcomes.items():
        console.say(f"{name}: " + ", ".join(f"{key} {outcome.measures[key]:.3f}" for key in SUMMARY_LINE))
    return facts | {"methods": {name: outcome.measures for name, outcome in outcomes.items()}}
