"""`train`: clips -> a model folder."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..console import Console
from ..errors import InputError

HELP = "train a model on BVH clips that have the engine's joint names"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("data", type=Path, nargs="+", metavar="DATA", help="BVH files or folders of them")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="MODEL_DIR", help="the model folder to write")
    parser.add_argument("--config", type=Path, metavar="FILE", help="a TOML file with sizes, losses and schedule")
    parser.add_argument("--from", dest="start", type=Path, metavar="MODEL", help="train a model on, such as the shipped one on your own clips")
    parser.add_argument("--resume", action="store_true", help="continue from the folder's checkpoints")


def run(args: argparse.Namespace, console: Console) -> dict[str, Any]:
    from ..learn.config import read_config

    config = read_config(args.config)
    try:
        from ..learn.job import train_model
    except ImportError as error:
        raise InputError("torch and onnx", f"are needed for training ({error}); `pip install torch onnx` in the Python that trains") from error
    report = console.run(train_model(args.data, args.output, config, args.resume, args.overwrite, args.start))
    console.say(f"{args.output}: model '{report['name']}' trained on {report['training']['clips']['train']} clips")
    return report
