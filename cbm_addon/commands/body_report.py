"""`evaluate --body`: whole bodies among solids in their way, ours beside baselines."""

from __future__ import annotations

import argparse
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from ..console import Console

REPORT_FILES = ("body.md", "body.png")


def run(args: argparse.Namespace, console: Console, clips: list[Path]) -> dict[str, Any]:
    from ..body.model import load_body_model
    from ..evaluate.body.picture import sheet
    from ..evaluate.body.report import evaluate_body, markdown
    from ..evaluate.tracing import png
    from ..outputs import replacing_all

    if args.report:
        args.report.mkdir(parents=True, exist_ok=True)
    with replacing_all([args.report / name for name in REPORT_FILES], args.overwrite) if args.report else nullcontext() as report:
        model, rivals = load_body_model(args.model, threads=1), [load_body_model(folder, threads=1) for folder in args.rivals]
        found = console.run(evaluate_body(clips, model, rivals, args.seed))
        if report:
            tables, picture = report
            tables.write_text(markdown(found, f"Model '{model.name}', seed {args.seed}, {len(found['scenes'])} clips."), encoding="utf-8")
            picture.write_bytes(png(sheet(found["made"])))
    for method, figures in found["summary"].items():
        console.say(f"{method}: {figures['reduced_percent']:.2f} % less of the body is inside, {figures['max_depth_cm']:.1f} cm at the deepest")
    return {name: found[name] for name in ("summary", "scenes")}
