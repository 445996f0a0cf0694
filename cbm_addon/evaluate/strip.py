"""Solved motion beside the truth, as a strip of stick figures: what numbers do not show."""

from __future__ import annotations

import numpy as np

from ..motion.motion import Motion
from .metrics import Tracks, tracks

POSES = 10  # evenly spread over the clip
WIDTH, HEIGHT, SCALE = 150, 260, 105  # of a cell, pixels; pixels per metre
FLOOR = 30  # pixels below the floor
VIEWS = (("front", 0), ("side", 1))  # and the horizontal axis that each shows
TRUTH, SOLVED = "#999999", "#c03028"


def strip(truth: Motion, solved: Motion, title: str) -> str:
    """An SVG of POSES of both motions over each other, seen from the front and from the side of the world; each is centred on the truth."""
    true, ours = tracks(truth), tracks(solved)
    parts = [f'<text x="8" y="16">{title}: truth <tspan fill="{TRUTH}">grey</tspan>, solved <tspan fill="{SOLVED}">red</tspan></text>']
    for column, frame in enumerate(np.linspace(0, len(truth) - 1, POSES + 2)[1:-1].astype(int)):
        for row, (view, axis) in enumerate(VIEWS):
            x, y = WIDTH * (column + 0.5), 24 + HEIGHT * (row + 1) - FLOOR
            middle = true.positions[frame, :, axis].mean()
            parts.append(f'<g transform="translate({x} {y})"><line x1="{-WIDTH / 2}" x2="{WIDTH / 2}" stroke="#ddd"/>')
            parts += [_figure(motion, frame, axis, middle, colour) for motion, colour in ((true, TRUTH), (ours, SOLVED))]
            parts.append(f'<text x="{8 - WIDTH / 2}" y="20" fill="#666">{frame / truth.rate:.1f} s, {view}</text></g>')
    size = f'width="{WIDTH * POSES}" height="{24 + HEIGHT * len(VIEWS)}"'
    head = f'<svg xmlns="http://www.w3.org/2000/svg" {size} font-family="sans-serif" font-size="12">'
    return "\n".join([head, '<rect width="100%" height="100%" fill="white"/>', *parts, "</svg>", ""])


def _figure(motion: Tracks, frame: int, axis: int, middle: float, colour: str) -> str:
    """The bones of one pose as one path."""
    places = np.stack((motion.positions[frame, :, axis] - middle, -motion.positions[frame, :, 2]), -1) * SCALE
    bones = [(places[parent], places[joint]) for joint, parent in enumerate(motion.body.parents) if parent >= 0]
    path = "".join(f"M{a[0]:.0f} {a[1]:.0f}L{b[0]:.0f} {b[1]:.0f}" for a, b in bones)
    return f'<path d="{path}" stroke="{colour}" stroke-width="2" fill="none"/>'
