"""Output files: written under a temporary name in their own folder and renamed at the end, so that none is ever half-written."""

from __future__ import annotations

import math
import os
from collections.abc import Generator, Iterable
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from .errors import InputError


@contextmanager
def replacing(path: str | Path, overwrite: bool) -> Generator[Path, None, None]:
    """Yields the temporary path to write to; see `replacing_all`."""
    with replacing_all([path], overwrite) as (temporary,):
        yield temporary


@contextmanager
def replacing_all(paths: Iterable[str | Path], overwrite: bool) -> Generator[list[Path], None, None]:
    """Yields one temporary path per output, absolute, beside it and with its suffix, for the body to write to.

    When the body ends well every file takes its final name; when it raises (Ctrl-C too) the temporary files are removed
    and what stood there before is untouched. Raises InputError before the body runs if an output cannot be made.
    """
    outputs = [Path(path) for path in paths]
    for output in outputs:
        _check(output, overwrite)
    if len({output.resolve() for output in outputs}) < len(outputs):
        raise InputError(outputs[0], "is named twice as an output; give every output its own name")
    temporaries = [_temporary(output, os.getpid()) for output in outputs]
    try:
        yield temporaries
        for temporary in temporaries:
            if not temporary.exists():
                raise FileNotFoundError(temporary)
        for temporary, output in zip(temporaries, outputs, strict=True):
            temporary.replace(output)
    finally:
        for temporary in temporaries:
            temporary.unlink(missing_ok=True)


def remove_temporaries(paths: Iterable[Path], process: int) -> None:
    """Removes what a process that was ended in the middle of `replacing_all` has left."""
    for path in paths:
        _temporary(path, process).unlink(missing_ok=True)


def plain(value: Any) -> Any:
    """The value in JSON's own types: arrays as lists, paths as text, numbers that are not finite as null."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def _temporary(output: Path, process: int) -> Path:
    return output.absolute().with_name(f".{output.stem}.{process}{output.suffix}")


def _check(output: Path, overwrite: bool) -> None:
    if output.is_dir():
        raise InputError(output, "is a folder; name a file in it")
    if not output.parent.is_dir():
        raise InputError(output, "its folder does not exist; make it first")
    if not os.access(output.parent, os.W_OK):
        raise InputError(output, "its folder cannot be written to")
    if output.exists() and not overwrite:
        raise InputError(output, "exists; pass --overwrite to replace it")
