"""`evaluate --hands`: the fingers among solids of our own, ours beside baselines."""

from __future__ import annotations

import argparse
from contextlib import nullcontext
from typing import Any

from ..console import Console
from ..errors import InputError


def run(args: argparse.Namespace, console: Console) -> dict[str, Any]:
    from ..evaluate.hands.picture import before_and_after
    from ..evaluate.hands.report import PICTURED, evaluate_hands, markdown, worst_frame
    from ..evaluate.hands.scenes import scenes
    from ..evaluate.tracing import png
    from ..hands.model import load_hand_model
    from ..outputs import replacing_all

    if len(args.clips) > 1:
        raise InputError(args.clips[1], "is a second folder; --hands takes one, with hand poses and recordings")
    data = args.clips[0] if args.clips else None
    names = ["hands.md", *(f"hands_{scene.replace(' ', '_')}.png" for scene in PICTURED)]
    if args.report:
        args.report.mkdir(parents=True, exist_ok=True)
    with replacing_all([args.report / name for name in names], args.overwrite) if args.report else nullcontext() as report:
        model, rivals = load_hand_model(args.model, threads=1), [load_hand_model(folder, threads=1) for folder in args.rivals]
        found = console.run(evaluate_hands(model, rivals, data, args.seed))
        if report:
            tables, *pictures = report
            tables.write_text(markdown(found, f"Model '{model.name}', seed {args.seed}."), encoding="utf-8")
            made = {scene.name: scene for scene in scenes()}
            for name, path in zip(PICTURED, pictures, strict=True):
                path.write_bytes(png(before_and_after(made[name], found["angles"][name], worst_frame(made[name]))))
    for method, figures in found["summary"].items():
        console.say(f"{method}: {figures['pierced_percent']:.2f} % of frames pierce, {figures['mean_depth_mm']:.2f} mm deep on average")
    return {name: found[name] for name in ("summary", "scenes", "real")}
