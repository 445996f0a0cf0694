"""A score card as Markdown tables and as a drawing."""

from __future__ import annotations

import math
from typing import Any
from xml.sax.saxutils import escape

# What is better of each metric: less, more, or closer to 1; the truth's own values have no better.
BETTER = {
    "lower_mpjpe_cm": "less", "best_of_16_lower_mpjpe_cm": "less",
    "offsets_lower_mpjpe_cm": "less", "noise_lower_mpjpe_cm": "less", "height_lower_mpjpe_cm": "less", "lost_hand_lower_mpjpe_cm": "less",
    "hips_cm": "less", "feet_cm": "less", "mpjpe_cm": "less",
    "mpjre_deg": "less", "root_cm": "less", "root_deg": "less", "tracker_cm": "less", "tracker_deg": "less",
    "raw_lower_mpjpe_cm": "less", "raw_tracker_cm": "less",
    "detail_ratio": "1", "detail_gt_deg_s": "", "jitter_ratio": "1", "jitter_gt_100m_s3": "",
    "upper_detail_ratio": "1", "upper_jitter_ratio": "1",
    "slide_cm_s": "less", "slide_truth_contact_cm_s": "less", "slide_gt_cm_s": "", "contact_f1": "more",
    "penetration_p99_cm": "less", "penetration_gt_p99_cm": "", "ms_per_frame": "less",
}  # fmt: skip
BY_BEHAVIOUR = "lower_mpjpe_cm"
DRAWN = ("lower_mpjpe_cm", "hips_cm", "slide_truth_contact_cm_s", "contact_f1", "detail_ratio", "jitter_ratio")

WIDTH, BAR, NAMES, GAP = 720, 18, 220, 40  # of the drawing, pixels


def markdown(card: dict[str, Any], about: str) -> str:
    """Tables of a score card: by method, and the error of the lower body by behaviour; `about` says what was measured."""
    columns = _columns(card["summary"])
    names = [name for name in BETTER if any(name in metrics for metrics in columns.values())]
    by_method = [[name, BETTER[name], *(_number(metrics.get(name)) for metrics in columns.values())] for name in names]
    by_behaviour = [
        [name, str(group["clips"]), f"{group['seconds']:.0f}", *(_number(metrics.get(BY_BEHAVIOUR)) for metrics in _columns(group["summary"]).values())]
        for name, group in card["by_behaviour"].items()
    ]
    return "\n".join(
        [
            about, "",
            "### By method", "", *_table(["metric", "better", *columns], by_method), "",
            f"### By behaviour: {BY_BEHAVIOUR}", "",
            "A clip that shows several behaviours counts for each.", "",
            *_table(["behaviour", "clips", "seconds", *columns], by_behaviour), "",
        ]
    )  # fmt: skip


def drawing(card: dict[str, Any]) -> str:
    """An SVG with one group of bars for each of DRAWN."""
    columns = _columns(card["summary"])
    parts, top = [], GAP
    for metric in DRAWN:
        values = {column: metrics.get(metric, math.nan) for column, metrics in columns.items()}
        longest = max((value for value in values.values() if math.isfinite(value)), default=0) or 1
        wish = f" (better: {'closer to 1' if BETTER[metric] == '1' else BETTER[metric]})"
        parts.append(f'<text x="0" y="{top - 8}" font-weight="bold">{metric}{wish}</text>')
        for column, value in values.items():
            length = (WIDTH - NAMES - 80) * value / longest if math.isfinite(value) else 0
            parts.append(
                f'<text x="{NAMES - 8}" y="{top + 13}" text-anchor="end">{escape(column)}</text>'
                f'<rect x="{NAMES}" y="{top}" width="{length:.1f}" height="{BAR - 4}" fill="#4878a8"/>'
                f'<text x="{NAMES + length + 6:.1f}" y="{top + 13}">{_number(value)}</text>'
            )
            top += BAR
        top += GAP
    head = f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{top - GAP // 2}" font-family="sans-serif" font-size="13">'
    return "\n".join([head, '<rect width="100%" height="100%" fill="white"/>', *parts, "</svg>", ""])


def _columns(summary: dict[str, dict[str, Any]]) -> dict[str, dict[str, float]]:
    """Metrics by the name of a column: the method, and the mode too if there is more than one."""
    several = len({mode for modes in summary.values() for mode in modes}) > 1
    return {f"{method}, {mode}" if several else method: metrics for method, modes in summary.items() for mode, metrics in modes.items()}


def _table(head: list[str], rows: list[list[str]]) -> list[str]:
    return ["| " + " | ".join(cells) + " |" for cells in (head, ["---"] * len(head), *rows)]


def _number(value: float | None) -> str:
    return "–" if value is None or not math.isfinite(value) else f"{value:.2f}"
