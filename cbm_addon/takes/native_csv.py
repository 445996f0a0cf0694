"""The native take CSV: seconds, metres, engine axes; an empty field means "not tracked".

First line: `# cbm-take 1 poses=device` or `# cbm-take 1 poses=joint`. Device poses of controllers other than OpenXR grip poses add their
name: `# cbm-take 1 poses=device device=index`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np

from ..errors import InputError
from .csv_table import read_table, require
from .devices import CONTROLLERS, DEFAULT_DEVICE
from .recording import Recording, TakeOverrides, take_from
from .take import DEVICES, EXTRAS, Constant, Take

NAME = "native take CSV"
MAGIC = "# cbm-take"
VERSION = "1"
KINDS: dict[str, Literal["device", "joint"]] = {"device": "device", "joint": "joint"}
POSE = ("px", "py", "pz", "qw", "qx", "qy", "qz")
COLUMNS = [f"{device}_{part}" for device in DEVICES for part in POSE]


def recognises(head: bytes) -> bool:
    return head.removeprefix(b"\xef\xbb\xbf").startswith(MAGIC.encode())


def read(path: Path, overrides: TakeOverrides) -> Take:
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        version, *words = file.readline().removeprefix(MAGIC).split() or [""]
    if version != VERSION:
        raise InputError(path, f"is a take of version {version or '(none)'}; this version reads {MAGIC} {VERSION}")
    facts = {key: value for key, _, value in (word.partition("=") for word in words)}
    kind = KINDS.get(facts.get("poses", ""))
    if kind is None:
        raise InputError(path, f"its first line says {' '.join(words) or 'nothing'} of the poses; poses=device or poses=joint would be right")
    device = facts.get("device")
    if device is not None and device not in CONTROLLERS:
        raise InputError(path, f"its first line names the device {device!r}; {', '.join(CONTROLLERS)} are known")
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
        constants={"device": Constant(device, "format")} if device else {},
    )
    return take_from(recording, path, overrides)


def write(path: Path, take: Take) -> None:
    """Writes a take; times, metres and quaternions with six decimals."""
    device = take.report.constants.get("device") if take.report and take.kind == "device" else None
    controllers = "" if device is None or device.value == DEFAULT_DEVICE else f" device={device.value}"
    extras = [name for name in EXTRAS if name in take.extras]
    poses = np.concatenate((take.positions, take.rotations), axis=-1).reshape(len(take), -1)
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(f"{MAGIC} {VERSION} poses={take.kind}{controllers}\n")
        file.write(",".join(["time", *COLUMNS, *extras]) + "\n")
        for time, row, *more in zip(take.times, poses, *(take.extras[name] for name in extras), strict=True):
            file.write(",".join("" if np.isnan(value) else f"{value:.6f}" for value in (time, *row, *more)) + "\n")
