"""The evaluation of the hands as one job, and its tables."""

from __future__ import annotations

import time
from collections.abc import Generator
from pathlib import Path
from typing import Any

import numpy as np

from ...hands.contact import finger_depths
from ...hands.model import HandModel
from ...hands.obstacle import over_time
from ...progress import Progress, part
from .measures import Manifold, Measured, before, measured, summed
from .methods import methods
from .recordings import recorded_angles
from .scenes import RATE, Scene, scenes

PICTURED = ("sphere", "cube", "mug", "plate", "table", "two hands")
COLUMNS = {
    "pierced_percent": "frames > 1 mm inside, %",
    "mean_depth_mm": "mean depth, mm",
    "max_depth_mm": "max depth, mm",
    "free_moved_mm": "moved where free, mm",
    "moved_mm": "moved, mm",
    "smooth_step_mm": "largest tip step on smooth solids, mm",
    "smooth_step_over_25_percent": "frames with a tip step > 25 mm there, %",
    "speed_p995": "angle speed p99.5, °/s",
    "too_fast_percent": "faster than real p99.5, %",
    "manifold_deg": "from training poses, °",
    "ms_per_frame": "ms per hand-frame",
}


def evaluate_hands(model: HandModel, rivals: list[HandModel], data: Path | None, seed: int) -> Generator[Progress, None, dict[str, Any]]:
    """Every method on every scene. With the folder `data` of hand poses and recordings also how near to real hands the answers are.

    Returns `summary` {method: figures}, `scenes` {scene: {method: figures}}, `real` (figures of real hands) and `angles` {scene: ours}.
    """
    yield Progress(0, "reading real hands")
    manifold, real = _real_hands(data) if data else (None, {})
    limit = real.get("speed_p995")
    made, ways = scenes(), methods(model, rivals, seed)
    starts = [before(scene) for scene in made]
    rows: dict[str, list[Measured]] = {"before": [measured(scene, start, scene.wanted, manifold) for scene, start in zip(made, starts, strict=True)]}
    seconds, ours = dict.fromkeys(ways, 0.0), {}
    for number, (name, method) in enumerate(ways.items()):
        rows[name] = []
        for scene, start in zip(made, starts, strict=True):
            done, every = number * len(made) + len(rows[name]), len(ways) * len(made)
            yield Progress(done / every, f"{name}: {scene.name}")
            started = time.process_time()
            angles = yield from part(method(scene), done / every, (done + 1) / every)
            seconds[name] += time.process_time() - started
            rows[name].append(measured(scene, start, angles, manifold))
            if name == "ours":
                ours[scene.name] = angles
    frames = sum(len(scene) for scene in made)
    summary = {name: summed(found, limit) | ({"ms_per_frame": 1000 * seconds[name] / frames} if name in seconds else {}) for name, found in rows.items()}
    by_scene = {scene.name: {name: summed([found[i]], limit) for name, found in rows.items()} for i, scene in enumerate(made)}
    return {"summary": summary, "scenes": by_scene, "real": real, "angles": ours}


def _real_hands(data: Path) -> tuple[Manifold, dict[str, float]]:
    """The poses that train, and how far from them and how fast real hands are."""
    from ...learn.hands.free_poses import held_out, read_free_poses
    from ...learn.hands.pose_bank import interpolated

    trained, kept = held_out(read_free_poses(data))
    manifold = Manifold(interpolated(trained.angles, 20_000, np.random.default_rng(0)))
    real = {"held_out_deg": float(manifold.distances(kept.angles).mean())}
    recordings = [recorded_angles(path, RATE) for path in sorted(Path(data).rglob("*Hand.bvh"))]
    if recordings:
        speeds = np.concatenate([np.abs(np.diff(angles, axis=0)) for angles in recordings]) * RATE
        real["recordings"] = len(recordings)
        real["speed_p995"] = float(np.degrees(np.percentile(speeds, 99.5)))
        real["recordings_deg"] = float(np.concatenate([manifold.distances(angles[::24]) for angles in recordings]).mean())
    return manifold, real


def worst_frame(scene: Scene) -> int:
    """The frame in which the wanted fingers are deepest inside."""
    return int(finger_depths(scene.hand, scene.wrists, over_time(scene.obstacles), scene.wanted).max(-1).argmax())


def markdown(found: dict[str, Any], about: str) -> str:
    """The tables of a report."""
    columns = [name for name in COLUMNS if any(figures.get(name) is not None for figures in found["summary"].values())]
    lines = [about, "", _line(["method", *(COLUMNS[name] for name in columns)]), _line(["---"] + ["---:"] * len(columns))]
    lines += [_line([method, *(_figure(figures.get(name)) for name in columns)]) for method, figures in found["summary"].items()]
    wanted = found["summary"]["before"]
    lines += ["", f"{wanted['frames']} frames, in {wanted['palm_inside']} of them the palm itself is inside; these are not counted in the depths."]
    broken = max(figures["beyond_limits_deg"] for name, figures in found["summary"].items() if name != "before")
    lines += [f"Joint limits are broken by {broken:.2f}° at most."]
    if real := found["real"]:
        lines += ["", "Real hands: " + ", ".join(f"{name} {value:.1f}" for name, value in real.items()) + "."]
    lines += ["", _line(["scene", "before, %", "before, mean mm", "after, %", "after, max mm", "without exact step, %", "sweep, %", "gradient, %"])]
    lines.append(_line(["---"] + ["---:"] * 7))
    for scene, by_method in found["scenes"].items():
        wanted, end = by_method["before"], by_method["ours"]
        figures = [wanted["pierced_percent"], wanted["mean_depth_mm"], end["pierced_percent"], end["max_depth_mm"]]
        figures += [by_method[name]["pierced_percent"] for name in ("networks alone", "sweep", "gradient")]
        lines.append(_line([scene, *map(_figure, figures)]))
    return "\n".join([*lines, ""])


def _line(cells: list[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _figure(value: float | None) -> str:
    return "" if value is None else f"{value:.2f}" if value < 10 else f"{value:.1f}" if value < 100 else f"{value:.0f}"
