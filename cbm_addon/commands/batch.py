"""`batch`: many takes onto many rigs, in several processes."""

from __future__ import annotations

import argparse
import sys
import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ..console import Console
from ..errors import InputError
from ..outputs import plain

HELP = "bake many takes onto many rigs, as a TOML file says"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("job", type=Path, nargs="?", metavar="JOB.toml", help="takes, rigs and options")
    parser.add_argument("--workers", type=int, default=1, metavar="N", help="processes that bake side by side; each takes about 1 GB (default 1)")
    parser.add_argument("--worker", type=Path, help=argparse.SUPPRESS)  # this process is one of them, and keeps its files in that folder
    parser.add_argument("--threads", type=int, default=0, help=argparse.SUPPRESS)


def run(args: argparse.Namespace, console: Console) -> dict[str, Any]:
    from .batch_job import read_job
    from .batch_workers import Outcome, work, working

    if find_spec("bpy") is None:
        raise InputError("bpy", "is not installed here; run `batch` inside Blender, or `pip install bpy`")
    if args.worker:
        work(args.worker, args.threads, plain)
        return {}
    if args.job is None:
        raise InputError("JOB.toml", "is not given; name the TOML file of a batch")
    if args.workers < 1:
        raise InputError("--workers", f"is {args.workers}; at least 1 is needed")
    started = time.perf_counter()
    tasks = read_job(args.job)
    kept = [] if args.overwrite else [task for task in tasks if task.is_made]
    outcomes = console.run(working([task for task in tasks if task not in kept], args.workers, args.overwrite))
    failed = [outcome for outcome in outcomes if outcome.error]
    seconds = time.perf_counter() - started
    for outcome in failed:
        console.say(f"{outcome.task.name}: failed: {outcome.error}")
        if outcome.traceback:
            print(outcome.traceback, file=sys.stderr)
    console.say(f"{args.job}: {len(outcomes) - len(failed)} baked, {len(kept)} kept as they were, {len(failed)} failed, in {seconds:.1f} s")
    made = {outcome.task: outcome for outcome in outcomes}
    report: dict[str, Any] = {
        "job": args.job,
        "workers": args.workers,
        "baked": len(outcomes) - len(failed),
        "kept": len(kept),
        "failed": len(failed),
        "total_seconds": seconds,
        "tasks": [_facts(made.get(task, Outcome(task)), task in kept) for task in tasks],
    }
    if failed:
        report["error"] = f"{args.job}: {len(failed)} of {len(tasks)} tasks failed; see the lines above, and run it again for these alone once they are mended"
    return report


def _facts(outcome: Any, kept: bool) -> dict[str, Any]:
    state = "kept" if kept else "failed" if outcome.error else "done"
    facts = {"name": outcome.task.name, "take": outcome.task.take, "outputs": outcome.task.outputs, "state": state}
    return facts | ({"error": outcome.error} if outcome.error else {}) | ({"report": outcome.report} if outcome.report else {})
