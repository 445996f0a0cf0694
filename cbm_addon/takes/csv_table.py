"""Tables of numbers in CSV files, with errors that name the line and the column."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from ..errors import InputError


def read_table(path: Path, skip_lines: int = 0) -> dict[str, np.ndarray]:
    """Columns float64 [T] by name; NaN for empty fields. InputError for ragged rows, text where a number should be, or no rows."""
    with path.open(newline="", encoding="utf-8-sig", errors="replace") as file:
        for _ in range(skip_lines):
            file.readline()
        reader = csv.reader(file)
        try:
            names = [name.strip() for name in next(reader, [])]
            rows = [_numbers(path, reader.line_num + skip_lines, names, row) for row in reader if row]
        except csv.Error as error:
            raise InputError(path, f"line {reader.line_num + skip_lines} is not CSV: {error}") from None
    if not rows:
        raise InputError(path, "has a header but no rows; a take needs samples")
    return dict(zip(names, np.array(rows, dtype=np.float64).T, strict=True))


def require(path: Path, table: dict[str, np.ndarray], names: list[str]) -> None:
    """InputError that lists the missing columns, if any."""
    missing = [name for name in names if name not in table]
    if missing:
        raise InputError(path, f"has no column {', '.join(missing)}; each device needs a position (x y z) and a rotation (w x y z)")


def _numbers(path: Path, line: int, names: list[str], row: list[str]) -> list[float]:
    if len(row) != len(names):
        raise InputError(path, f"line {line} has {len(row)} fields, the header has {len(names)}; is the file complete?")
    try:
        return [float(field) if field else np.nan for field in row]
    except ValueError:
        column = next(name for name, field in zip(names, row, strict=True) if not _is_number(field))
        raise InputError(path, f"line {line}: column {column!r} is not a number") from None


def _is_number(field: str) -> bool:
    try:
        float(field or "nan")
    except ValueError:
        return False
    return True
