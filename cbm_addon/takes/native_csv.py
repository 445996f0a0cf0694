"""The native take CSV: seconds, metres, engine axes; an empty field means "not tracked"."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np

from ..errors import InputError
from .csv_table import read_table, require
from .recording import Recording, TakeOverrides, take_from
from .take import DEVICES, EXTRAS, Take

NAME = "native take CSV"
MAGIC = "# cbm-take"
VERSION = "1"
KINDS: dict[str, Literal["device", "joint"]] = {"poses=device": "device", "poses=joint": "joint"}
POSE = ("px", "py", "pz", "qw", "qx", "qy", "qz")
COLUMNS = [f"{device}_{part}" for device in DEVICES for part in POSE]


def recognises(head: bytes) -> bool:
    return head.removeprefix(b"\xef\xbb\xbf").startswith(MAGIC.encode())


def read(path: Path, overrides: TakeOverrides) -> Take:
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        words = file.readline().removeprefix(MAGIC).split()
    if words[:1] != [VERSION]:
        raise InputError(path, f"is a take of version {' '.join(words[:1]) or '(none)'}; this version reads {MAGIC} {VERSION}")
    kind = KINDS.get(" ".join(words[1:]))
    if kind is None:
        raise InputError(path, f"its first line ends in {' '.join(words[1:])!r}; poses=device or poses=joint would be right")
    table = read_table(path, skip_lines=1)
    require(path, table, ["time", *COLUMNS])
    poses = np.stack([table[name] for name in COLUMNS], axis=-1).reshape(-1, len(DEVICES), len(POSE))
    recording = Recording(
        format=NAME,
        times=table["time"],
        positions=poses[..., :3],
        rotations=poses[..., 3:],
        kind=kind,
        extras={name: table[name] for name in EXTRAS if name in table},
        axes="engine",
        unit="m",
    )
    return take_from(recording, path, overrides)


def write(path: Path, take: Take) -> None:
    """Writes a take; times, metres and quaternions with six decimals."""
    extras = [name for name in EXTRAS if name in take.extras]
    poses = np.concatenate((take.positions, take.rotations), axis=-1).reshape(len(take), -1)
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(f"{MAGIC} {VERSION} poses={take.kind}\n")
        file.write(",".join(["time", *COLUMNS, *extras]) + "\n")
        for time, row, *more in zip(take.times, poses, *(take.extras[name] for name in extras), strict=True):
            file.write(",".join("" if np.isnan(value) else f"{value:.6f}" for value in (time, *row, *more)) + "\n")
