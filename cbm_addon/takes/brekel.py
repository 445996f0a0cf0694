"""Brekel OpenVR Recorder text files: a section for each kind of device, in it a row for each device and time, tab-separated.

     Head Mounted Display(s)
    deviceID  timestamp  posX  posY  posZ  rotX  rotY  rotZ
     Controllers
    deviceID  timestamp  posX  posY  posZ  rotX  rotY  rotZ  System … axis4_Y

Seconds and metres; degrees, or the four numbers of a quaternion (a column rotW). An empty line ends a section. Nothing official says in
which order the angles turn. The order is assumed that FBX has, which the recorder writes too: about X first, Z last, in fixed axes.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..motion.rotations import Array, quat_from_euler
from .recording import Recording, TakeOverrides, take_from
from .take import HEAD, LEFT, RIGHT, Constant, Defect, Take
from .tracks import Track, at_head_times, track

NAME = "Brekel OpenVR Recorder text"
HEADSETS, CONTROLLERS = "Head Mounted Display(s)", "Controllers"
NEEDED = ("deviceID", "timestamp", "posX", "posY", "posZ", "rotX", "rotY", "rotZ")
ROTATION_ORDER = "ZYX"

HEADER = re.compile(rb"^deviceID\s+timestamp\s+posX\b", re.MULTILINE)


def recognises(head: bytes) -> bool:
    return HEADER.search(head) is not None


def read(path: Path, overrides: TakeOverrides) -> Take:
    sections = _sections(path)
    order = overrides.rotation_order or ROTATION_ORDER
    headsets, controllers = (_tracks(sections.get(kind, {}), order) for kind in (HEADSETS, CONTROLLERS))
    if not headsets:
        raise InputError(path, f"has no rows under {HEADSETS!r}; a take needs at least the head")
    unused = len(headsets) - 1 + len(controllers[2:])
    # Which controller is which hand is measured later.
    times, positions, rotations = at_head_times(dict(zip((HEAD, LEFT, RIGHT), (headsets[0], *controllers[:2]), strict=False)))
    recording = Recording(
        format=NAME,
        times=times,
        positions=positions,
        rotations=rotations,
        unit="m",
        likely_axes=("openxr", "unity"),
        usual_axes="openxr",
        constants={
            "rotation_order": Constant(order, "given") if overrides.rotation_order else Constant(order, "assumed", "as in FBX; the poses cannot tell"),
            "device": Constant("index", "assumed", "OpenVR gives the poses of controllers as SteamVR does"),
        },
        defects=(Defect("device_unused", unused, f"headsets and controllers beyond the first, left out: {unused}"),) if unused else (),
    )
    return take_from(recording, path, overrides)


def _sections(path: Path) -> dict[str, dict[str, np.ndarray]]:
    """Columns float64 [N] by name, by section."""
    sections: dict[str, dict[str, np.ndarray]] = {}
    title, names, rows = "", [], []

    def close() -> None:
        if rows:
            sections[title] = dict(zip(names, np.array(rows).T, strict=True))

    with path.open(encoding="utf-8-sig", errors="replace") as file:
        for number, line in enumerate(file, start=1):
            words = line.split()
            if words[:1] == ["deviceID"]:
                names, rows = words, []
                if missing := [name for name in NEEDED if name not in names]:
                    raise InputError(path, f"line {number} has no column {', '.join(missing)}; each device needs a position and a rotation")
            elif names and words:
                rows.append(_numbers(path, number, names, words))
            else:
                close()
                names, rows = [], []
                title = line.strip() or title
    close()
    return sections


def _numbers(path: Path, line: int, names: list[str], words: list[str]) -> list[float]:
    if len(words) != len(names):
        raise InputError(path, f"line {line} has {len(words)} fields, its header has {len(names)}; is the file complete?")
    try:
        return [float(word) for word in words]
    except ValueError:
        raise InputError(path, f"line {line} holds something that is not a number") from None


def _tracks(rows: dict[str, np.ndarray], order: str) -> list[Track]:
    """The tracks of the devices of a section, by their number."""
    if not rows:
        return []
    positions = np.column_stack([rows[f"pos{axis}"] for axis in "XYZ"])
    rotations = _rotations(rows, order)
    devices = [rows["deviceID"] == device for device in np.unique(rows["deviceID"])]
    return [track(rows["timestamp"][own], positions[own], rotations[own]) for own in devices]


def _rotations(rows: dict[str, np.ndarray], order: str) -> Array:
    if "rotW" in rows:
        return np.column_stack([rows[f"rot{part}"] for part in "WXYZ"])
    return quat_from_euler(np.radians(np.column_stack([rows[f"rot{axis}"] for axis in order])), order)
