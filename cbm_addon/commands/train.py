"""`train`: clips -> a model folder."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..console import Console
from ..errors import InputError

HELP = "train a model on BVH clips that have the engine's joint names, that of the hands on free hand poses, or that of body avoidance on clips"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("data", type=Path, nargs="+", metavar="DATA", help="BVH files or folders of them; with --hands the folder of the hand poses")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="MODEL_DIR", help="the model folder to write")
    parser.add_argument("--config", type=Path, metavar="FILE", help="a TOML file with sizes, losses and schedule")
    parser.add_argument("--from", dest="start", type=Path, metavar="MODEL", help="train a model on, such as the shipped one on your own clips")
    other = parser.add_mutually_exclusive_group()
    other.add_argument("--hands", action="store_true", help="train the model of the hands")
    other.add_argument("--body", action="store_true", help="train the model of body avoidance")
    parser.add_argument("--resume", action="store_true", help="continue from the folder's checkpoints")


def run(args: argparse.Namespace, console: Console) -> dict[str, Any]:
    from ..learn.body.config import BodyConfig
    from ..learn.config import read_config, read_settings
    from ..learn.hands.config import HandConfig

    avoidance = HandConfig() if args.hands else BodyConfig() if args.body else None
    config = read_settings(args.config, avoidance) if avoidance else read_config(args.config)
    try:
        from ..learn.body.training import train_body
        from ..learn.hands.training import train_hands
        from ..learn.job import train_model
    except ImportError as error:
        raise InputError("torch and onnx", f"are needed for training ({error}); `pip install torch onnx` in the Python that trains") from error
    if avoidance and args.start:
        raise InputError("--from", "goes on from a model of the body; those that avoid are trained from nothing")
    if isinstance(config, HandConfig):
        if len(args.data) > 1:
            raise InputError(args.data[1], "is a second folder; the hands train on the poses of one")
        report = console.run(train_hands(args.data[0], args.output, config, args.resume, args.overwrite))
        console.say(f"{args.output}: model '{report['name']}' trained on {report['training']['poses']} hand poses")
    elif isinstance(config, BodyConfig):
        report = console.run(train_body(args.data, args.output, config, args.resume, args.overwrite))
        console.say(f"{args.output}: model '{report['name']}' trained on {report['training']['poses']} poses")
    else:
        report = console.run(train_model(args.data, args.output, config, args.resume, args.overwrite, args.start))
        console.say(f"{args.output}: model '{report['name']}' trained on {report['training']['clips']['train']} clips")
    return report
