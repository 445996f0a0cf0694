"""`evaluate`: motion capture clips -> a score card of the solver and of the baselines."""

from __future__ import annotations

import argparse
from collections import Counter
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from ..console import Console
from ..errors import InputError
from ..evaluate import METHODS
from . import body_report, hands_report

HELP = "measure the solver and the baselines against motion capture clips"

MODES = ("lookahead", "causal")
SPLITS = ("test", "validation", "all")
REPORT_FILES = ("results.md", "score_card.svg")
SUMMARY_LINE = ("lower_mpjpe_cm", "hips_cm", "detail_ratio", "jitter_ratio", "slide_truth_contact_cm_s", "contact_f1", "ms_per_frame")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("clips", type=Path, nargs="*", metavar="CLIP", help="BVH files or folders of them, with the engine's joint names")
    parser.add_argument("--hands", action="store_true", help="measure the fingers instead; CLIP may be a folder of hand poses and recordings to compare with")
    parser.add_argument("--body", action="store_true", help="measure whole bodies among solids instead, a scene for each of the CLIPs")
    parser.add_argument("--methods", nargs="+", choices=METHODS, default=["ours", "legs-carried"], help="what to compare (default: ours legs-carried)")
    parser.add_argument("--mode", nargs="+", choices=MODES, default=["lookahead"], help="use the whole take, only what came before each frame, or both")
    parser.add_argument("--model", type=Path, metavar="DIR", help="model folder (default: the shipped one)")
    parser.add_argument("--seed", type=int, default=0, help="the same seed gives the same motions")
    parser.add_argument("--database", type=Path, nargs="+", default=[], metavar="FOLDER", help="clips for motion-matching; only those that train are used")
    parser.add_argument("--split", choices=SPLITS, default="all", help="only the clips of this split (default: all that are given)")
    parser.add_argument("--limit", type=int, metavar="N", help="at most N clips, evenly spread in order of name")
    parser.add_argument("--best-of-16", action="store_true", help="also the error of the best of 16 variations of ours (slow)")
    parser.add_argument("--rivals", type=Path, nargs="+", default=[], metavar="DIR", help="other model folders, each a row by the name in its card")
    parser.add_argument("--disturb", action="store_true", help="also the error of ours on badly tracked takes (four more solves per clip)")
    parser.add_argument("--strips", action="store_true", help="also draw the first method's answer to every clip beside the truth, into the report")
    parser.add_argument("--report", type=Path, metavar="DIR", help=f"write {' and '.join(REPORT_FILES)} to this folder")


def run(args: argparse.Namespace, console: Console) -> dict[str, Any]:
    if args.hands:
        return hands_report.run(args, console)
    if not args.clips:
        raise InputError("CLIP", "is missing; name BVH files or folders of them")
    if args.body:
        return body_report.run(args, console, choose_clips(args.clips, args.split, args.limit)[0])
    from ..evaluate.methods import OF_A_MODEL, prepare_methods, rival_methods
    from ..evaluate.report import drawing, markdown
    from ..evaluate.score_card import score_card, strips
    from ..outputs import replacing_all
    from ..solve.models import load_model
    from ..solve.perform import SolveOptions

    if args.seed < 0:
        raise InputError("--seed", f"is {args.seed}; it is a number from 0")
    clips, splits = choose_clips(args.clips, args.split, args.limit)
    methods, modes = list(dict.fromkeys(args.methods)), list(dict.fromkeys(args.mode))
    if args.strips and not args.report:
        raise InputError("--strips", "are drawn into the report; name its folder with --report")
    drawings = [f"strip_{clip.stem}.svg" for clip in clips] if args.strips else []
    if args.report:
        args.report.mkdir(parents=True, exist_ok=True)
    with replacing_all([args.report / name for name in (*REPORT_FILES, *drawings)], args.overwrite) if args.report else nullcontext() as report:
        model = load_model(args.model) if set(methods) & set(OF_A_MODEL) else None
        prepared = console.run(prepare_methods(methods, modes, model, args.database))
        prepared |= rival_methods([load_model(folder) for folder in args.rivals], modes)
        options = [SolveOptions(mode=mode, seed=args.seed) for mode in modes]
        ours = ("ours",)
        card = console.run(score_card(clips, prepared, options, ours if args.best_of_16 else (), ours if args.disturb else ()))
        facts = {"model": model.name if model else None, "clips": len(clips), "seconds_of_clips": _seconds(card), "splits": splits}
        if report:
            tables, chart, *pictures = report
            tables.write_text(markdown(card, _about(facts, modes, options[0])), encoding="utf-8")
            chart.write_text(drawing(card), encoding="utf-8")
            if pictures:
                for path, picture in zip(pictures, console.run(strips(clips, next(iter(prepared.values())), options[0])), strict=True):
                    path.write_text(picture, encoding="utf-8")
    for method, by_mode in card["summary"].items():
        for mode, metrics in by_mode.items():
            console.say(f"{method}, {mode}: " + ", ".join(f"{name} {metrics[name]:.2f}" for name in SUMMARY_LINE))
    return facts | card


def choose_clips(sources: list[Path], split: str, limit: int | None) -> tuple[list[Path], dict[str, int]]:
    """The clips to measure, and how many are of which split; InputError if none is left."""
    from ..learn.dataset import find_clips
    from ..learn.split import read_split, split_of

    if limit is not None and limit < 1:
        raise InputError("--limit", f"is {limit}; at least 1 clip is needed")
    known = read_split()
    clips = [clip for clip in find_clips(sources) if split in ("all", split_of(clip.stem, known))]
    if not clips:
        raise InputError(sources[0], f"gives no clip of the split '{split}'; choose other clips or --split all")
    if limit and limit < len(clips):
        clips = [clips[i * len(clips) // limit] for i in range(limit)]
    return clips, dict(Counter(split_of(clip.stem, known) for clip in clips))


def _seconds(card: dict[str, Any]) -> float:
    return sum({row["clip"]: row["seconds"] for row in card["rows"]}.values())


def _about(facts: dict[str, Any], modes: list[str], options: Any) -> str:
    splits = ", ".join(f"{count} {name}" for name, count in facts["splits"].items())
    model = f"model '{facts['model']}', {options.candidates} candidates, " if facts["model"] else ""
    return f"{facts['clips']} clips ({splits}), {facts['seconds_of_clips']:.0f} s; {model}mode {' and '.join(modes)}, seed {options.seed}."
