"""The outcomes as a Markdown table and as the figures of the appendix."""

from __future__ import annotations

import math
from typing import Any

import torch

from .drawing import curve_panels, error_lines
from .experiment import DRAWN, FARTHER, NEAR_GAP, Outcome
from .function import GAP, branch, spread_evenly

TITLES = {"mlp": "MLP", "database": "Database", "vae": "VAE", "cvae": "CVAE", "vq": "VQ", "cm-kl": "CM (KL, decoder sees X)"}
"""The methods of Fig. 17 and 19 in their order there: direct ones on the left, those that know of Y's distribution on the right."""

COLUMNS = {
    "coherent": "coherent %",
    "positive": "positive %",
    "positive_least": "least in a tenth of X %",
    "positive_most": "most in a tenth of X %",
    "reconstruction_error": "reconstruction error %",
    "gap_error": "error in the gap %",
    "beyond_parabolas": "parabolas at 8 X %",
    "beyond_steepness": "largest steepness at 8 X",
}
SHARES = COLUMNS.keys() - {"beyond_steepness"}  # written as per cent


def markdown(outcomes: dict[str, Outcome], facts: dict[str, Any]) -> str:
    """One row per method, below what all of them had in common."""
    rows = [["method", *COLUMNS.values()], ["---"] * (len(COLUMNS) + 1)]
    rows += [[name, *(_cell(key, outcome.measures[key]) for key in COLUMNS)] for name, outcome in outcomes.items()]
    about = ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in facts.items())
    return "\n".join([f"{about}.", "", *("| " + " | ".join(row) + " |" for row in rows), ""])


def figures(outcomes: dict[str, Outcome]) -> dict[str, str]:
    """SVGs by file name: the function (Fig. 18), answers inside the data (Fig. 19) and beyond it (Fig. 17), and errors around the gap."""
    signs = torch.tensor([1.0, -1.0]).repeat(DRAWN)[:, None]
    function = signs * branch(spread_evenly(0, 1, DRAWN).repeat_interleave(2, dim=0))
    top = float(branch(torch.ones(1, 1)).max())
    inside = [(title, outcomes[name].inside.numpy()) for name, title in TITLES.items()]
    outside = [(title, outcomes[name].outside.numpy()) for name, title in TITLES.items()]
    near_gap = [(TITLES[name], outcomes[name].near_gap.numpy()) for name in ("database", "cvae", "cm-kl")]
    return {
        "toy_function.svg": curve_panels([("Y = ± X t²", function.numpy())], 1, 1.1 * top, 1),
        "toy_answers.svg": curve_panels(inside, 2, 1.1 * top, 1),
        "toy_beyond.svg": curve_panels(outside, 2, 1.1 * FARTHER * top, FARTHER, band=top),
        "toy_gap.svg": error_lines(near_gap, NEAR_GAP, GAP, 0.12),
    }


def _cell(key: str, value: float) -> str:
    if math.isnan(value):
        return "–"
    return f"{100 * value:.1f}" if key in SHARES else f"{value:.2f}"
