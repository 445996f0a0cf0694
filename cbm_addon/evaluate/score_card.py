"""The score card: every method on every clip, solved for the clip's own body from a take made of the clip itself."""

from __future__ import annotations

import time
from collections.abc import Generator
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..learn.dataset import read_body_motion
from ..motion.motion import Motion
from ..motion.skeleton import BODY_JOINTS, Skeleton
from ..progress import Progress, run
from ..solve.fuse import fuse
from ..solve.perform import SolveOptions
from ..solve.performance import Performance
from ..takes.synthesize import synthesize
from ..takes.take import Take
from .behaviours import behaviours_of
from .methods import Method
from .metrics import LEAST_FRAMES, measure, measure_raw, weighted_means
from .robustness import DISTURBANCES, disturbed
from .strip import strip

Row = dict[str, Any]

VARIATIONS = 16


def score_card(
    clips: list[Path], methods: dict[str, Method], options: list[SolveOptions], best_of: tuple[str, ...] = (), disturb: tuple[str, ...] = ()
) -> Generator[Progress, None, dict[str, Any]]:
    """Solves every clip by every method with every one of `options` (one per mode) and measures the results against the clip.

    best_of  methods whose VARIATIONS are all solved, for the error of the best of them
    disturb  methods that also solve badly tracked takes (DISTURBANCES)
    Returns the rows, their summary {method: {mode: metrics}} and the same summary by behaviour.
    """
    rows: list[Row] = []
    for i, path in enumerate(clips):
        truth = read_truth(path)
        for name, method in methods.items():
            for option in options:
                yield Progress(i / len(clips), f"{path.stem}: {name}, {option.mode}")
                metrics = solve_and_measure(truth, method, option)
                if name in best_of:
                    metrics[f"best_of_{VARIATIONS}_lower_mpjpe_cm"] = best_error(truth, method, option)
                if name in disturb:
                    metrics |= disturbed_errors(truth, method, option)
                rows.append(
                    {
                        "clip": path.stem,
                        "behaviours": behaviours_of(path),
                        "seconds": truth.seconds,
                        "frames": len(truth),
                        "method": name,
                        "mode": option.mode,
                        "seed": option.seed,
                        "metrics": metrics,
                    }
                )
    return {"body": "each clip's own", "rows": rows, "summary": summarize(rows), "by_behaviour": by_behaviour(rows)}


def read_truth(path: Path) -> Motion:
    """A clip on the engine's joints at the engine's rate; InputError if it is too short to be measured."""
    truth = read_body_motion(path)
    if len(truth) < LEAST_FRAMES:
        raise InputError(path, f"has {len(truth)} frames at {truth.rate:.0f} a second; at least {LEAST_FRAMES} are needed")
    return truth


def solve_and_measure(truth: Motion, method: Method, options: SolveOptions) -> dict[str, float]:
    """The metrics of one method on one clip; the milliseconds count stages 1 to 3."""
    body, take = _body_and_take(truth)
    started = time.perf_counter()
    performance, solved = _solve(body, take, method, options)
    milliseconds = 1000 * (time.perf_counter() - started)
    return measure(solved, truth) | measure_raw(performance, truth) | {"ms_per_frame": milliseconds / len(truth)}


def strips(clips: list[Path], method: Method, options: SolveOptions) -> Generator[Progress, None, list[str]]:
    """A drawing of one method's answer beside the truth for each clip (strip.py)."""
    drawn = []
    for i, path in enumerate(clips):
        yield Progress(i / len(clips), f"drawing {path.stem}")
        truth = read_truth(path)
        drawn.append(strip(truth, _solve(*_body_and_take(truth), method, options)[1], f"{path.stem}, {options.mode}"))
    return drawn


def best_error(truth: Motion, method: Method, options: SolveOptions) -> float:
    """The error of the lower joints of the best of VARIATIONS answers to a whole clip, cm."""
    body, take = _body_and_take(truth)
    answers = (_solve(body, take, method, replace(options, variation=variation))[1] for variation in range(VARIATIONS))
    return min(measure(answer, truth)["lower_mpjpe_cm"] for answer in answers)


def disturbed_errors(truth: Motion, method: Method, options: SolveOptions) -> dict[str, float]:
    """The error of the lower joints under each of DISTURBANCES, cm."""
    errors = {}
    for name in DISTURBANCES:
        take, body = disturbed(name, truth, truth.skeleton.subset(BODY_JOINTS))
        _, solved = _solve(body, take, method, options)
        errors[f"{name}_lower_mpjpe_cm"] = measure(solved, truth)["lower_mpjpe_cm"]
    return errors


def _body_and_take(truth: Motion) -> tuple[Skeleton, Take]:
    return truth.skeleton.subset(BODY_JOINTS), synthesize(truth)


def _solve(body: Skeleton, take: Take, method: Method, options: SolveOptions) -> tuple[Performance, Motion]:
    performance = run(method(take, body, options))
    return performance, fuse(performance, take, take.times, body)


def summarize(rows: list[Row]) -> dict[str, dict[str, dict[str, float]]]:
    """{method: {mode: metrics}}: means over clips weighted by their seconds."""
    groups: dict[tuple[str, str], list[Row]] = {}
    for row in rows:
        groups.setdefault((row["method"], row["mode"]), []).append(row)
    summary: dict[str, dict[str, dict[str, float]]] = {}
    for (method, mode), members in groups.items():
        summary.setdefault(method, {})[mode] = weighted_means([row["metrics"] for row in members], [row["seconds"] for row in members])
    return summary


def by_behaviour(rows: list[Row]) -> dict[str, dict[str, Any]]:
    """{behaviour: {clips, seconds, summary}} in order of name; a clip that shows several counts for each."""
    result = {}
    for behaviour in sorted({behaviour for row in rows for behaviour in row["behaviours"]}):
        members = [row for row in rows if behaviour in row["behaviours"]]
        lengths = {row["clip"]: row["seconds"] for row in members}
        result[behaviour] = {"clips": len(lengths), "seconds": sum(lengths.values()), "summary": summarize(members)}
    return result
