"""`models`: what models there are, and whether they are sound."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..console import Console

HELP = "list, verify and describe the models found"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folders", type=Path, nargs="*", metavar="MODEL_DIR", help="model folders (default: the shipped ones)")


def run(args: argparse.Namespace, console: Console) -> dict[str, Any]:
    from ..solve.models import find_models, read_card, verify_files

    found = []
    for folder in args.folders or find_models():
        card = read_card(folder)
        verify_files(folder, card)
        size = sum(entry["bytes"] for entry in card["files"].values())
        clips = card["training"].get("clips", {}).get("train", "?")
        console.say(
            f"{folder}: '{card['name']}' {card.get('version', '')}, modes {', '.join(card['modes'])}, {size / 1e6:.1f} MB, trained on {clips} clips, {card['licence']}"
        )
        found.append({"folder": folder, "bytes": size, "card": card})
    if not found:
        console.say("no models found")
    return {"models": found}
