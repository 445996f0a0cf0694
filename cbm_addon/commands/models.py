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
    from ..body import model as body
    from ..hands import model as hands
    from ..model_folder import find_models, read_json_card, verify_files
    from ..solve import models as controllers

    found = []
    for folder in args.folders or find_models():
        declared = read_json_card(folder).get("format")
        kind = next((kind for kind in (hands, body) if declared == kind.CARD_FORMAT), controllers)
        card = kind.read_card(folder)
        verify_files(folder, card)
        console.say(f"{folder}: {kind.describe(card)}")
        found.append({"folder": folder, "card": card})
    if not found:
        console.say("no models found")
    return {"models": found}
