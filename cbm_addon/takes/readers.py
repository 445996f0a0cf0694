"""Reading a take, whatever its format: found by what the file holds, not by its name.

A format is one module with a NAME, `recognises` and `read` (see Reader), and its place in READERS.
"""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from ..errors import InputError
from . import brekel, bsor, bvh_trackers, native_csv, xr_csv
from .blender_formats import format_of
from .recording import TakeOverrides
from .take import Take

HEAD_BYTES = 65536
MEASURE = TakeOverrides()


class Reader(Protocol):
    """What a format's module offers."""

    @property
    def NAME(self) -> str: ...

    def recognises(self, head: bytes) -> bool: ...

    def read(self, path: Path, overrides: TakeOverrides) -> Take: ...


READERS: list[Reader] = [native_csv, bsor, xr_csv, brekel, bvh_trackers]
"""In the order in which they are asked. Where there is Blender, BLENDER_FILES of `scene/take_files.py` is registered too."""


def register(reader: Reader) -> None:
    """Adds a reader, in the place of the one of that name if there is one."""
    READERS[:] = [other for other in READERS if other.NAME != reader.NAME] + [reader]


def read_take(path: str | Path, overrides: TakeOverrides = MEASURE) -> Take:
    """The take in a file, in engine axes and metres, with a report of how it was read. InputError if it cannot be read."""
    path = Path(path)
    head = read_head(path)
    for reader in READERS:
        if reader.recognises(head):
            return reader.read(path, overrides)
    if name := format_of(head):
        raise InputError(path, f"is {name}, which takes Blender to read; run this inside Blender, or `pip install bpy`")
    raise InputError(path, f"is not a take; these are read: {', '.join(reader.NAME for reader in READERS)}")


def read_head(path: Path) -> bytes:
    """The first bytes of a file, to tell its format by. InputError if there is no such file or it is empty."""
    try:
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
    except OSError as error:
        raise InputError(path, f"cannot be read: {error.strerror}") from None
    if not head:
        raise InputError(path, "is empty; a recording is needed")
    return head
