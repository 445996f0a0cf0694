"""The evaluation of body avoidance as one job, and its tables."""

from __future__ import annotations

import time
from collections.abc import Generator
from pathlib import Path
from typing import Any

from ...body.model import BodyModel
from ...errors import InputError
from ...learn.dataset import read_body_motion
from ...motion.motion import Motion
from ...progress import Progress, part
from .measures import Measured, measured, summed
from .methods import methods
from .scenes import Scene, scenes

COLUMNS = {
    "pierced_percent": "frames > 1 cm inside, %",
    "volume_litres": "inside, litres",
    "reduced_percent": "less volume inside, %",
    "max_depth_cm": "max depth, cm",
    "planted_p99_cm": "planted feet moved, p99 cm",
    "planted_max_cm": "planted feet moved, max cm",
    "near_tracker_percent": "free head and wrists within 5 cm, %",
    "tracker_p95_cm": "free head and wrists moved, p95 cm",
    "jitter_ratio": "jitter ÷ recorded",
    "ms_per_frame": "ms per frame",
}


def evaluate_body(clips: list[Path], model: BodyModel, rivals: list[BodyModel], seed: int) -> Generator[Progress, None, dict[str, Any]]:
    """Every method on a scene of each clip. Returns `summary` {method: figures}, `scenes` {scene: {method: figures}}, and `made`, a list of the scenes
    with our answers."""
    yield Progress(0, "putting solids in the way")
    made = list(scenes([(path.stem, read_body_motion(path)) for path in clips]))
    if not made:
        raise InputError(clips[0], "leaves no room for anything that gets in its way and out again; longer clips are needed")
    ways = methods(model, rivals, seed)
    rows: dict[str, list[Measured]] = {"before": [measured(scene, scene.motion) for scene in made]}
    seconds, ours = dict.fromkeys(ways, 0.0), list[tuple[Scene, Motion]]()
    for number, (name, method) in enumerate(ways.items()):
        rows[name] = []
        for scene in made:
            done, every = number * len(made) + len(rows[name]), len(ways) * len(made)
            yield Progress(done / every, f"{name}: {scene.name}")
            started = time.process_time()
            motion = yield from part(method(scene), done / every, (done + 1) / every)
            seconds[name] += time.process_time() - started
            rows[name].append(measured(scene, motion))
            if name == "ours":
                ours.append((scene, motion))
    frames = sum(len(scene.motion) for scene in made)
    summary = {
        name: summed(found, rows["before"]) | ({"ms_per_frame": 1000 * seconds[name] / frames} if name in seconds else {}) for name, found in rows.items()
    }
    by_scene = {scene.name: {name: summed([found[i]], [rows["before"][i]]) for name, found in rows.items()} for i, scene in enumerate(made)}
    return {"summary": summary, "scenes": by_scene, "made": ours}


def markdown(found: dict[str, Any], about: str) -> str:
    """The tables of a report."""
    lines = [about, "", _line(["method", *COLUMNS.values()]), _line(["---"] + ["---:"] * len(COLUMNS))]
    lines += [_line([method, *(_figure(figures.get(name)) for name in COLUMNS)]) for method, figures in found["summary"].items()]
    lines += ["", _line(["scene", "before, litres", "after", "max depth before, cm", "after", "planted feet moved, max cm", "within 5 cm, %"])]
    lines.append(_line(["---"] + ["---:"] * 6))
    for scene, by_method in found["scenes"].items():
        start, end = by_method["before"], by_method["ours"]
        figures = [start["volume_litres"], end["volume_litres"], start["max_depth_cm"], end["max_depth_cm"], end["planted_max_cm"], end["near_tracker_percent"]]
        lines.append(_line([scene, *map(_figure, figures)]))
    return "\n".join([*lines, ""])


def _line(cells: list[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _figure(value: float | None) -> str:
    return "" if value is None else f"{value:.3f}" if value < 1 else f"{value:.2f}" if value < 10 else f"{value:.1f}"
