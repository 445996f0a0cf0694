"""The calibration options that the commands share. Each overrides a measurement or an assumption, for the whole take."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..takes.calibrate import Calibrated, CalibrationOptions
    from ..takes.recording import TakeOverrides


def add_take_arguments(parser: argparse.ArgumentParser | argparse._ArgumentGroup) -> None:
    """What a take's reader measures: unit, axes, swapped hands."""
    from ..takes.frames import AXES, METRES

    parser.add_argument("--unit", choices=METRES, help="unit of the take's positions (default: measured)")
    parser.add_argument("--axes", choices=AXES, help="axes of the take (default: from its format, or measured)")
    parser.add_argument("--swap-hands", action=argparse.BooleanOptionalAction, default=None, help="exchange left and right (default: measured)")


def add_calibration_arguments(parser: argparse.ArgumentParser) -> None:
    """What a take's reader measures, and what calibration measures or assumes."""
    from ..takes.devices import CONTROLLERS

    group = parser.add_argument_group("calibration", "constants of the take; the report says where each came from")
    add_take_arguments(group)
    group.add_argument("--eye-height", type=float, metavar="M", help="standing eye height above the floor, metres (default: measured)")
    group.add_argument("--floor", type=float, metavar="M", help="height of the floor in the take, metres (default: its origin)")
    group.add_argument("--device", choices=CONTROLLERS, help="which controllers were held, and so where the wrists are")
    group.add_argument("--head-offset", type=_vector, metavar="X,Y,Z", help="headset to head joint, metres to the left, back and up in the headset's frame")
    group.add_argument("--wrist-offset", type=_vector, metavar="X,Y,Z", help="left controller to left wrist, the same in the controller's frame; mirrored")
    group.add_argument("--seated", action="store_true", help="the performer sits throughout")


def take_overrides(args: argparse.Namespace) -> TakeOverrides:
    from ..takes.recording import TakeOverrides

    return TakeOverrides(args.unit, args.axes, args.swap_hands)


def calibration_options(args: argparse.Namespace) -> tuple[TakeOverrides, CalibrationOptions]:
    """What the arguments say to the reader and to calibration, for `read_calibrated`."""
    from ..takes.calibrate import CalibrationOptions

    options = CalibrationOptions(args.eye_height, args.floor, args.device, args.head_offset, args.wrist_offset, args.seated)
    return take_overrides(args), options


def read_calibrated(path: Path, options: tuple[TakeOverrides, CalibrationOptions]) -> Calibrated:
    """The take in a file, calibrated. InputError if it cannot be read or an option makes no sense."""
    from ..takes.calibrate import calibrate
    from ..takes.readers import read_take

    overrides, calibration = options
    return calibrate(read_take(path, overrides), calibration)


def _vector(text: str) -> tuple[float, float, float]:
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not three numbers with commas between them") from None
    return x, y, z
