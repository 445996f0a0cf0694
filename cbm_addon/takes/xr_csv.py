"""CSV files of XR research (Who Is Alyx, Kinematic Maze and their kin), read by column names."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ..errors import InputError
from .csv_table import read_table, require
from .recording import Recording, TakeOverrides, check_rate, take_from
from .take import DEVICES, Constant, Take

NAME = "XR research CSV"
PREFIXES = {"head": ("head", "hmd"), "left": ("left_hand", "left_controller"), "right": ("right_hand", "right_controller")}
PARTS = [f"pos_{axis}" for axis in "xyz"] + [f"rot_{axis}" for axis in "wxyz"]
SECONDS = {"delta_time_s": 1.0, "delta_time_ms": 0.001}
TIME_OF_UNKNOWN_UNIT = ("timestamp", "time")
ASSUMED_RATE = 72.0

COLUMN = re.compile(rf"\b({'|'.join(name for names in PREFIXES.values() for name in names)})_(pos|rot)_[wxyz]\b")


def recognises(head: bytes) -> bool:
    return COLUMN.search(head.decode("utf-8", errors="replace").partition("\n")[0]) is not None


def read(path: Path, overrides: TakeOverrides) -> Take:
    table = read_table(path)
    poses = np.stack([_poses(path, table, device) for device in DEVICES], axis=1)
    times, time = _times(table, len(poses))
    if overrides.rate is None:
        check_rate(times, path)
    constants = {
        "time": time,
        "device": Constant("index", "assumed", "most such recordings hold controller poses as SteamVR gives them"),
    }
    return take_from(Recording(NAME, times, poses[..., :3], poses[..., 3:], usual_axes="openxr", constants=constants), path, overrides)


def _poses(path: Path, table: dict[str, np.ndarray], device: str) -> np.ndarray:
    """Position and rotation (w first) of one device [T, 7]; NaN for a hand that the file does not have at all."""
    for prefix in PREFIXES[device]:
        names = [f"{prefix}_{part}" for part in PARTS]
        if any(name in table for name in names):
            require(path, table, names)
            return np.stack([table[name] for name in names], axis=-1)
    if device == "head":
        raise InputError(path, "has no column head_pos_x or hmd_pos_x; a take needs at least the head")
    return np.full((len(next(iter(table.values()))), len(PARTS)), np.nan)


def _times(table: dict[str, np.ndarray], count: int) -> tuple[np.ndarray, Constant]:
    """Seconds [T] and which column they are from."""
    for name, seconds in SECONDS.items():
        if name in table:
            return table[name] * seconds, Constant(name, "format")
    for name in TIME_OF_UNKNOWN_UNIT:
        if name in table:
            step = float(np.nanmedian(np.diff(table[name])))
            seconds, unit = (0.001, "milliseconds") if step > 1 else (1.0, "seconds")
            return table[name] * seconds, Constant(f"{name} in {unit}", "measured", f"its median step is {step:.4g}")
    why = "no time column; give the rate (--rate), or a column delta_time_s (seconds since the start)"
    return np.arange(count) / ASSUMED_RATE, Constant(f"{ASSUMED_RATE:.0f} samples a second", "assumed", why)
