"""The figures as SVG: panels of curves, each coloured by its X, and errors over X."""

from __future__ import annotations

from collections.abc import Sequence
from xml.sax.saxutils import escape

import numpy as np

WIDTH, HEIGHT, MARGIN, HEAD = 280, 170, 14, 26  # of a panel, pixels
FOOT = 34  # below the panels, for the key
FINE = 10  # steps per pixel of what is drawn inside a panel
COLOURS = np.array([[40, 70, 170], [170, 50, 150], [240, 130, 30]])  # of the least, the middle and the largest X

Drawn = Sequence[tuple[str, np.ndarray]]


def curve_panels(panels: Drawn, columns: int, limit: float, last_x: float, band: float | None = None) -> str:
    """Titled panels of curves [N, P] over evenly spaced points, for X evenly spread over 0 to last_x.

    Every panel shows -limit to limit; from -band to band it is shaded.
    """
    parts = []
    for i, (title, curves) in enumerate(panels):
        inside = [f'<line x1="0" x2="{WIDTH * FINE}" y1="{HEIGHT * FINE // 2}" y2="{HEIGHT * FINE // 2}" stroke="#bbb" stroke-width="{FINE}"/>']
        if band is not None:
            half = HEIGHT * FINE / 2 * band / limit
            inside.insert(0, f'<rect y="{HEIGHT * FINE / 2 - half:.0f}" width="{WIDTH * FINE}" height="{2 * half:.0f}" fill="#e4e8ec"/>')
        heights = (1 - curves / limit) / 2
        inside += [_curve(heights[k], _colour(k / max(len(curves) - 1, 1))) for k in range(len(curves))]
        parts.append(_panel(title, inside, i % columns, i // columns))
    rows = -(-len(panels) // columns)
    key = [f'<rect x="{64 + 2 * k}" y="12" width="2" height="12" fill="{_colour(k / 79)}"/>' for k in range(80)]
    key += [f'<text x="{MARGIN}" y="22">X = 0</text>', f'<text x="232" y="22">{last_x:g}</text>']
    return _document(columns, rows, parts, key)


def error_lines(lines: Drawn, span: tuple[float, float], gap: tuple[float, float], limit: float) -> str:
    """Named errors [N] at X evenly spread over `span`, from 0 to `limit`; the gap is shaded."""
    left, right = ((x - span[0]) / (span[1] - span[0]) * WIDTH * FINE for x in gap)
    inside = [f'<rect x="{left:.0f}" width="{right - left:.0f}" height="{HEIGHT * FINE}" fill="#e4e8ec"/>']
    key = []
    for k, (name, errors) in enumerate(lines):
        colour = _colour(k / max(len(lines) - 1, 1))
        inside.append(_curve(1 - errors / limit, colour))
        key.append(f'<text x="{MARGIN + k * WIDTH // len(lines)}" y="22" fill="{colour}">{escape(name)}</text>')
    title = f"Error, 0 to {limit:.0%}, at X = {span[0]:g} to {span[1]:g}"
    return _document(1, 1, [_panel(title, inside, 0, 0)], key)


def _document(columns: int, rows: int, parts: list[str], key: list[str]) -> str:
    """An SVG of panels, and a key below them."""
    width, top = columns * (WIDTH + MARGIN) + MARGIN, rows * (HEIGHT + HEAD)
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{top + FOOT}" font-family="sans-serif" font-size="13">',
            '<rect width="100%" height="100%" fill="white"/>',
            *parts,
            f'<g transform="translate(0 {top})">', *key, "</g>",
            "</svg>", "",
        ]
    )  # fmt: skip


def _panel(title: str, inside: list[str], column: int, row: int) -> str:
    """What is inside is in steps of 1 / FINE pixels and is cut off at the frame."""
    x, y = MARGIN + column * (WIDTH + MARGIN), HEAD + row * (HEIGHT + HEAD)
    return "\n".join(
        [
            f'<text x="{x}" y="{y - 8}" font-weight="bold">{escape(title)}</text>',
            f'<svg x="{x}" y="{y}" width="{WIDTH}" height="{HEIGHT}" viewBox="0 0 {WIDTH * FINE} {HEIGHT * FINE}" fill="none" stroke-width="{FINE}">',
            *inside,
            "</svg>",
            f'<rect x="{x}" y="{y}" width="{WIDTH}" height="{HEIGHT}" fill="none" stroke="#888"/>',
        ]
    )


def _curve(heights: np.ndarray, colour: str) -> str:
    """A path from left to right; heights [P] are 0 at the top of the panel and 1 at its bottom. Whole numbers and differences keep it short."""
    x = np.rint(np.linspace(0, WIDTH * FINE, len(heights))).astype(int)
    y = np.rint(heights * HEIGHT * FINE).astype(int)
    steps = " ".join(f"{dx} {dy}" for dx, dy in zip(np.diff(x), np.diff(y), strict=True))
    return f'<path d="M{x[0]} {y[0]}l{steps.replace(" -", "-")}" stroke="{colour}"/>'


def _colour(share: float) -> str:
    """The colour at `share` of the way through COLOURS."""
    red, green, blue = (int(np.interp(share, (0, 0.5, 1), COLOURS[:, k])) for k in range(3))
    return f"#{red:02x}{green:02x}{blue:02x}"
