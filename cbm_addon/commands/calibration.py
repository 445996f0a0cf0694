"""The calibration options that the commands share. Each overrides a measurement or an assumption, for the whole take."""

from __future__ import annotations

import argparse
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from .values import numbers

if TYPE_CHECKING:
    from ..takes.calibrate import Calibrated, CalibrationOptions
    from ..takes.recording import TakeOverrides
    from ..takes.take import Take


def add_take_arguments(parser: argparse.ArgumentParser | argparse._ArgumentGroup) -> None:
    """What a take's reader measures: unit, axes, times, which device is which, what is wrong."""
    from ..takes.frames import AXES, METRES
    from ..takes.recording import ROTATION_ORDERS

    parser.add_argument("--unit", choices=METRES, help="unit of the take's positions (default: measured)")
    parser.add_argument("--axes", choices=AXES, help="axes of the take (default: from its format, or measured)")
    parser.add_argument("--swap-hands", action=argparse.BooleanOptionalAction, default=None, help="exchange left and right (default: measured)")
    parser.add_argument("--rate", type=_rate, metavar="HZ", help="samples a second, where the file's times are missing or wrong")
    parser.add_argument("--rotation-order", choices=ROTATION_ORDERS, help="in which order Euler angles turn (intrinsic), where the format does not say")
    parser.add_argument("--keep-outliers", action="store_true", help="keep samples that no hand or head can have reached")
    parser.add_argument("--join-teleports", action="store_true", help="go on where the head was when the tracking space jumps")
    for device, what in (("head", "the headset"), ("left", "the left controller"), ("right", "the right controller")):
        parser.add_argument(f"--{device}", metavar="NAME", help=f"the object, bone or joint that is {what}, in a file of many (default: found by name)")


def add_calibration_arguments(parser: argparse.ArgumentParser) -> None:
    """What a take's reader measures, and what calibration measures or assumes."""
    from ..takes.devices import CONTROLLERS, NO_DEVICE

    group = parser.add_argument_group("calibration", "constants of the take; the report says where each came from")
    add_take_arguments(group)
    group.add_argument("--eye-height", type=float, metavar="M", help="standing eye height above the floor, metres (default: measured)")
    group.add_argument("--floor", type=float, metavar="M", help="height of the floor in the take, metres (default: its origin)")
    devices = (*CONTROLLERS, NO_DEVICE)
    group.add_argument("--device", choices=devices, help=f"which controllers were held, and so where the wrists are; {NO_DEVICE}: poses of the joints")
    group.add_argument("--head-offset", type=_vector, metavar="X,Y,Z", help="headset to head joint, metres to the left, back and up in the headset's frame")
    group.add_argument("--wrist-offset", type=_vector, metavar="X,Y,Z", help="left controller to left wrist, the same in the controller's frame; mirrored")
    group.add_argument("--seated", action="store_true", help="the performer sits throughout")


def take_overrides(args: argparse.Namespace) -> TakeOverrides:
    from ..takes.recording import TakeOverrides

    names = ("unit", "axes", "swap_hands", "rate", "rotation_order", "keep_outliers", "join_teleports", "head", "left", "right")
    return TakeOverrides(**{name: getattr(args, name) for name in names})


def calibration_options(args: argparse.Namespace) -> tuple[TakeOverrides, CalibrationOptions]:
    """What the arguments say to the reader and to calibration, for `read_calibrated`."""
    from ..takes.calibrate import CalibrationOptions

    options = CalibrationOptions(args.eye_height, args.floor, args.device, args.head_offset, args.wrist_offset, args.seated)
    return take_overrides(args), options


def is_mocap(path: Path, overrides: TakeOverrides) -> bool:
    """Whether a file is motion capture of a body and nobody has named trackers in it. InputError if there is no such file or it is empty."""
    from ..takes.bvh_trackers import is_mocap
    from ..takes.readers import read_head

    return is_mocap(read_head(path)) and overrides.head is None


def read_any_take(path: Path, overrides: TakeOverrides) -> Take:
    """The take in a file of any format, those that Blender reads too where there is Blender. InputError if it cannot be read."""
    from ..takes.blender_formats import format_of
    from ..takes.readers import read_head, read_take, register

    if format_of(read_head(path)):
        with suppress(ModuleNotFoundError):
            from ..scene.take_files import BLENDER_FILES

            register(BLENDER_FILES)
    return read_take(path, overrides)


def read_calibrated(path: Path, options: tuple[TakeOverrides, CalibrationOptions]) -> Calibrated:
    """The take in a file, calibrated. InputError if it cannot be read or an option makes no sense."""
    from ..takes.calibrate import calibrate

    overrides, calibration = options
    return calibrate(read_any_take(path, overrides), calibration)


def _rate(text: str) -> float:
    try:
        rate = float(text)
    except ValueError:
        rate = 0.0
    if not 1 <= rate <= 10_000:
        raise argparse.ArgumentTypeError(f"{text!r} is no number of samples a second")
    return rate


def _vector(text: str) -> tuple[float, float, float]:
    x, y, z = numbers(text, 3)
    return x, y, z
