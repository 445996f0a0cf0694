"""The training curves as a picture: what `train` leaves beside a model."""

from __future__ import annotations

from xml.sax.saxutils import escape

WIDTH, HEIGHT, MARGIN, KEY = 300, 180, 40, 190  # of a panel, pixels
COLOURS = ("#2846aa", "#d2691e", "#2e8b57", "#8b3a8b", "#777777")
TRAINED = {"control": "control", "regression": "regression", "reconstruction": "reconstruction"}
VALIDATED = {"sample_cm": "a drawn code", "mean_of_8_cm": "mean of 8 codes", "regression_cm": "regression", "best_of_8_cm": "best of 8 codes"}


def curves(histories: dict[str, list[dict[str, float]]]) -> str:
    """An SVG with two panels for each mode's history (training.py): the losses in training, and the error on the validation clips by epoch."""
    parts = []
    for row, (mode, history) in enumerate(histories.items()):
        parts.append(_panel(f"{mode}: squared error in training", history, TRAINED, 0, row))
        parts.append(_panel(f"{mode}: validation, cm", history, VALIDATED, 1, row))
    width, height = 2 * (WIDTH + MARGIN + KEY), len(histories) * (HEIGHT + 2 * MARGIN)
    head = f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" font-family="sans-serif" font-size="12">'
    return "\n".join([head, '<rect width="100%" height="100%" fill="white"/>', *parts, "</svg>", ""])


def _panel(title: str, history: list[dict[str, float]], lines: dict[str, str], column: int, row: int) -> str:
    """Lines over the epochs, the vertical axis from 0 to the largest value after the first epoch, which is far above the rest."""
    x, y = MARGIN + column * (WIDTH + MARGIN + KEY), MARGIN + row * (HEIGHT + 2 * MARGIN)
    shown = history[1:] or history
    top = 1.05 * max(epoch[name] for epoch in shown for name in lines)
    parts = [
        f'<g transform="translate({x} {y})">',
        f'<text y="-10" font-weight="bold">{escape(title)}</text>',
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="none" stroke="#888"/>',
        f'<text x="-6" y="10" text-anchor="end">{top:.3g}</text><text x="-6" y="{HEIGHT}" text-anchor="end">0</text>',
        f'<text y="{HEIGHT + 16}">epoch 1</text><text x="{WIDTH}" y="{HEIGHT + 16}" text-anchor="end">{len(history)}</text>',
    ]
    for colour, (name, label) in zip(COLOURS, lines.items(), strict=False):
        points = " ".join(f"{WIDTH * i / max(len(history) - 1, 1):.1f},{HEIGHT * (1 - min(epoch[name] / top, 1)):.1f}" for i, epoch in enumerate(history))
        parts.append(f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="1.5"/>')
        parts.append(f'<text x="{WIDTH + 8}" y="{16 + 18 * list(lines).index(name)}" fill="{colour}">{escape(label)} {history[-1][name]:.3g}</text>')
    return "\n".join([*parts, "</g>"])
