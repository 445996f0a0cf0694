"""A take before and after cleaning as a drawing (SVG): a panel for each device, a curve for each coordinate over time."""

from __future__ import annotations

import numpy as np

from ..motion.rotations import Array
from .take import DEVICES, Take

WIDTH, PANEL = 900, 200  # pixels of the drawing's plots
LEFT_MARGIN, RIGHT_MARGIN, TOP, GAP = 60, 20, 40, 40
COLOURS = {"x": "#c0392b", "y": "#27793f", "z": "#2b5fa8"}
BEFORE, LOST = "#b8b8b8", "#fbe9d0"
TICKS = 6


def drawing(before: Take, after: Take) -> str:
    """Joint positions as they were recorded (grey dots), as they are used (lines), and where nothing usable was recorded (shaded)."""
    seconds = max(float(after.times[-1]), 1e-9)
    bottom = TOP + len(DEVICES) * (PANEL + GAP)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{LEFT_MARGIN + WIDTH + RIGHT_MARGIN}" height="{bottom}" font-family="sans-serif" font-size="12">',
        '<rect width="100%" height="100%" fill="white"/>',
        f'<text x="{LEFT_MARGIN}" y="16">metres over seconds; grey: as recorded; shaded: lost, and filled</text>',
        *(
            f'<text x="{LEFT_MARGIN + WIDTH - 90 + 36 * i}" y="16" fill="{colour}" font-weight="bold">{axis}</text>'
            for i, (axis, colour) in enumerate(COLOURS.items())
        ),
    ]
    for device, name in enumerate(DEVICES):
        parts += _panel(name, before, after, device, TOP + device * (PANEL + GAP), seconds)
    return "\n".join([*parts, "</svg>", ""])


def _panel(name: str, before: Take, after: Take, device: int, top: int, seconds: float) -> list[str]:
    values = np.concatenate((before.positions[:, device], after.positions[:, device]))
    low, high = float(np.nanmin(values)), float(np.nanmax(values))
    high = max(high, low + 0.1)

    def x(times: np.ndarray) -> np.ndarray:
        return LEFT_MARGIN + WIDTH * times / seconds

    def y(metres: Array) -> Array:
        return top + PANEL * (high - metres) / (high - low)

    parts = [f'<text x="8" y="{top - 8}" font-weight="bold">{name}</text>']
    for start, end in _lost(after.times, after.tracked[:, device]):
        left, right = x(np.array([start, end]))
        parts.append(f'<rect x="{left:.1f}" y="{top}" width="{max(right - left, 1):.1f}" height="{PANEL}" fill="{LOST}"/>')
    for metres in np.linspace(low, high, 3):
        parts.append(f'<line x1="{LEFT_MARGIN}" x2="{LEFT_MARGIN + WIDTH}" y1="{y(metres):.1f}" y2="{y(metres):.1f}" stroke="#e0e0e0"/>')
        parts.append(f'<text x="{LEFT_MARGIN - 6}" y="{y(metres) + 4:.1f}" text-anchor="end">{metres:.2f}</text>')
    ticks = np.linspace(0, seconds, TICKS)
    parts += [f'<text x="{x(time):.1f}" y="{top + PANEL + 16}" text-anchor="middle">{time:.1f}</text>' for time in ticks]
    for axis, colour in enumerate(COLOURS.values()):
        parts += _dots(x(before.times), y(before.positions[:, device, axis]))
        parts.append(_line(x(after.times), y(after.positions[:, device, axis]), colour))
    return parts


def _lost(times: np.ndarray, tracked: np.ndarray) -> list[tuple[float, float]]:
    """Stretches of time between tracked samples."""
    edges = np.flatnonzero(np.diff(np.concatenate(([True], tracked, [True])).astype(np.int8))).reshape(-1, 2)
    return [(float(times[max(start - 1, 0)]), float(times[min(end, len(times) - 1)])) for start, end in edges]


def _dots(x: np.ndarray, y: Array) -> list[str]:
    """One path of dots, no two on the same pixel."""
    seen = np.isfinite(y)
    pixels = np.unique(np.stack((x[seen], y[seen]), axis=-1).round().astype(int), axis=0)
    if not len(pixels):
        return []
    marks = "".join(f"M{across} {down}h0" for across, down in pixels)
    return [f'<path d="{marks}" stroke="{BEFORE}" stroke-width="3" stroke-linecap="round" fill="none"/>']


def _line(x: np.ndarray, y: Array, colour: str) -> str:
    """A curve with at most its first, lowest, highest and last sample in each column of pixels: what a finer one would show."""
    column = np.floor(x).astype(int)
    first = np.flatnonzero(np.diff(column, prepend=column[0] - 1))
    kept = {0, len(x) - 1}
    for start, end in zip(first, [*first[1:], len(x)], strict=True):
        kept |= {int(start), int(end) - 1, int(start + np.argmin(y[start:end])), int(start + np.argmax(y[start:end]))}
    points = " ".join(f"{x[i]:.1f},{y[i]:.1f}" for i in sorted(kept))
    return f'<polyline points="{points}" stroke="{colour}" fill="none" stroke-width="1"/>'
