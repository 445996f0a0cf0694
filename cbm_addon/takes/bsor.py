"""Beat Saber Open Replay (.bsor): binary, little-endian, Unity's axes, metres. The hands are poses of the sabers."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from ..errors import InputError
from .recording import Recording, TakeOverrides, take_from
from .take import Constant, Take

NAME = ".bsor (Beat Saber replay)"
MAGIC = struct.pack("<I", 0x442D3D69)
VERSION = 1
INFO_BLOCK, FRAMES_BLOCK = 0, 1

INFO_STRINGS = (
    "version", "game_version", "timestamp", "player_id", "player_name", "platform", "tracking_system", "hmd", "controller",
    "hash", "song", "mapper", "difficulty",
)  # fmt: skip
AFTER_SCORE = ("mode", "environment", "modifiers")
INFO_NUMBERS = "<f?ffff"  # jump distance, left-handed, height, start time, fail time, speed
LONGEST_STRING = 255  # bytes: less than the smallest number that a length and one printable character before it make

POSE = np.dtype([("position", "<f4", 3), ("rotation", "<f4", 4)])  # x y z, x y z w
FRAME = np.dtype([("time", "<f4"), ("fps", "<i4"), ("poses", POSE, 3)])


def recognises(head: bytes) -> bool:
    return head.startswith(MAGIC)


def read(path: Path, overrides: TakeOverrides) -> Take:
    cursor = _Cursor(path, path.read_bytes())
    cursor.take("<I")
    version = cursor.take("<B")
    if version != VERSION:
        raise InputError(path, f"is a .bsor of version {version}; this version reads {VERSION}")
    cursor.expect_block(INFO_BLOCK)
    info = cursor.strings(INFO_STRINGS)
    cursor.take("<i")  # score
    cursor.strings(AFTER_SCORE)
    cursor.take(INFO_NUMBERS)
    cursor.expect_block(FRAMES_BLOCK)
    frames = cursor.array(FRAME, cursor.take("<i"))
    recording = Recording(
        format=NAME,
        times=frames["time"].astype(np.float64),
        positions=frames["poses"]["position"].astype(np.float64),
        rotations=frames["poses"]["rotation"].astype(np.float64)[..., [3, 0, 1, 2]],
        axes="unity",
        unit="m",
        origin={"application": "Beat Saber", "headset": info["hmd"], "controllers": info["controller"], "runtime": info["tracking_system"]},
        constants={"device": Constant("saber", "format", "the hands of a .bsor are saber poses, not controllers")},
    )
    return take_from(recording, path, overrides)


class _Cursor:
    """Where the reader stands in the file; InputError when the file ends too early."""

    def __init__(self, path: Path, data: bytes) -> None:
        self.path, self.data, self.at = path, data, 0

    def _advance(self, size: int) -> int:
        start, self.at = self.at, self.at + size
        if size < 0 or self.at > len(self.data):
            raise InputError(self.path, f"is cut off: it ends at byte {len(self.data)}, inside its header or frames; a complete .bsor is needed")
        return start

    def take(self, format: str):
        """The first value of a struct format."""
        return struct.unpack_from(format, self.data, self._advance(struct.calcsize(format)))[0]

    def array(self, dtype: np.dtype, count: int) -> np.ndarray:
        return np.frombuffer(self.data, dtype, count, self._advance(count * dtype.itemsize))

    def expect_block(self, kind: int) -> None:
        found = self.take("<B")
        if found != kind:
            raise InputError(self.path, f"is damaged: block {found} where block {kind} should begin")

    def strings(self, names: tuple[str, ...]) -> dict[str, str]:
        """Strings one after the other: a length in bytes, then UTF-8.

        Some writers give the length of a name in UTF-16 units: where what follows cannot be the length of the next string, the name goes on.
        """
        values = {}
        for name in names:
            start = self._advance(self.take("<i"))
            while name != names[-1] and not self._at_string():
                self._advance(1)
            values[name] = self.data[start : self.at].decode("utf-8", errors="replace")
        return values

    def _at_string(self) -> bool:
        return int.from_bytes(self.data[self.at : self.at + 4], "little") <= LONGEST_STRING
