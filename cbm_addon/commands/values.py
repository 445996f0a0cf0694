"""Values of options that are several numbers."""

from __future__ import annotations

import argparse
import math

COUNTS = {2: "two", 3: "three"}


def numbers(text: str, count: int) -> tuple[float, ...]:
    """That many finite numbers, written with commas between them."""
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) != count or not all(map(math.isfinite, values)):
        raise argparse.ArgumentTypeError(f"{text!r} is not {COUNTS[count]} numbers with commas between them")
    return values


def two_amounts(text: str) -> tuple[float, float]:
    """Two numbers from 0 on."""
    first, second = numbers(text, 2)
    if first < 0 or second < 0:
        raise argparse.ArgumentTypeError(f"{text!r} holds a negative amount")
    return first, second
