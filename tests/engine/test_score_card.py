"""The score card: every method on every clip, weighted by seconds, grouped by behaviour, and written as tables and a drawing."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from cbm_addon.errors import InputError
from cbm_addon.evaluate.baselines import carry_legs
from cbm_addon.evaluate.behaviours import behaviours_of
from cbm_addon.evaluate.methods import legs_carried, rival_methods
from cbm_addon.evaluate.metrics import measure
from cbm_addon.evaluate.report import BETTER, DRAWN, drawing, markdown
from cbm_addon.evaluate.robustness import DISTURBANCES, disturbed
from cbm_addon.evaluate.score_card import by_behaviour, score_card, summarize
from cbm_addon.features import RATE
from cbm_addon.motion.bvh import write_bvh
from cbm_addon.motion.motion import Motion
from cbm_addon.motion.skeleton import BODY_JOINTS, Skeleton
from cbm_addon.progress import Progress, run
from cbm_addon.solve.models import load_model
from cbm_addon.solve.perform import SolveOptions
from cbm_addon.solve.performance import Performance
from cbm_addon.takes.synthesize import synthesize
from cbm_addon.takes.take import Take


def part_of(motion: Motion, start: int, end: int) -> Motion:
    return Motion(motion.skeleton, np.arange(end - start) / RATE, motion.root[start:end], motion.rotations[start:end])


@pytest.fixture(scope="module")
def clips(tmp_path_factory: pytest.TempPathFactory, body_motion: Motion) -> list[Path]:
    folder = tmp_path_factory.mktemp("library") / "walks"
    folder.mkdir()
    paths = [folder / "lab__short.bvh", folder / "lab__long.bvh"]
    for path, (start, end) in zip(paths, ((60, 91), (60, 151)), strict=True):
        write_bvh(path, part_of(body_motion, start, end))
    (folder.parent / "manifest.csv").write_text("file,tags\nwalks/lab__short.bvh,walk turn\nwalks/lab__other.bvh,run\n")
    return paths


def off_by_variation(take: Take, body: Skeleton, options: SolveOptions) -> Generator[Progress, None, Performance]:
    """Carried legs whose feet are predicted 5 cm too far aside for each step of the variation away from 3."""
    yield Progress(0, "guessing")
    said = carry_legs(take, body, causal=False)
    positions = said.lower_positions.copy()
    positions[:, 1:, 0] += np.float32(0.05 * abs(options.variation - 3))
    return replace(said, lower_positions=positions)


def test_there_is_a_row_for_every_clip_method_and_mode(clips: list[Path]) -> None:
    options = [SolveOptions(mode=mode, seed=7) for mode in ("lookahead", "causal")]
    card = run(score_card(clips, {"legs-carried": legs_carried}, options))
    assert [(row["clip"], row["method"], row["mode"]) for row in card["rows"]] == [
        (clip.stem, "legs-carried", mode) for clip in clips for mode in ("lookahead", "causal")
    ]
    for row in card["rows"]:
        assert row["seed"] == 7
        assert row["metrics"]["ms_per_frame"] > 0
        assert set(row["metrics"]) <= set(BETTER)
    assert set(card["summary"]["legs-carried"]) == {"lookahead", "causal"}


def test_the_summary_weighs_clips_by_their_seconds(clips: list[Path]) -> None:
    card = run(score_card(clips, {"legs-carried": legs_carried}, [SolveOptions()]))
    short, long = (row["metrics"]["lower_mpjpe_cm"] for row in card["rows"])
    assert card["summary"]["legs-carried"]["lookahead"]["lower_mpjpe_cm"] == pytest.approx((short * 1 + long * 3) / 4)


def test_the_best_of_sixteen_is_the_best_variation(clips: list[Path]) -> None:
    card = run(score_card(clips[:1], {"guess": off_by_variation}, [SolveOptions()], best_of=("guess",)))
    best = run(score_card(clips[:1], {"guess": off_by_variation}, [SolveOptions(variation=3)]))
    metrics = card["rows"][0]["metrics"]
    assert metrics["best_of_16_lower_mpjpe_cm"] == best["rows"][0]["metrics"]["lower_mpjpe_cm"]
    assert metrics["best_of_16_lower_mpjpe_cm"] < metrics["lower_mpjpe_cm"]


def test_a_clip_too_short_to_measure_is_refused(tmp_path: Path, body_motion: Motion) -> None:
    write_bvh(tmp_path / "blink.bvh", part_of(body_motion, 0, 3))
    with pytest.raises(InputError, match="3 frames.*at least 4"):
        run(score_card([tmp_path / "blink.bvh"], {"legs-carried": legs_carried}, [SolveOptions()]))


def test_behaviours_come_from_the_manifest_beside_the_folder_or_else_from_the_name(clips: list[Path]) -> None:
    assert behaviours_of(clips[0]) == ("walk", "turn")
    assert behaviours_of(clips[1]) == ("lab",)


def test_a_manifest_of_another_kind_is_passed_over(tmp_path: Path) -> None:
    (tmp_path / "manifest.csv").write_text("name,speed\nx,3\n")
    assert behaviours_of(tmp_path / "clips" / "lab__a.bvh") == ("lab",)


def rows() -> list[dict]:
    def row(clip: str, behaviours: tuple[str, ...], seconds: float, method: str, error: float) -> dict:
        metrics = dict.fromkeys(BETTER, error)
        return {"clip": clip, "behaviours": behaviours, "seconds": seconds, "method": method, "mode": "lookahead", "metrics": metrics}

    return [
        row("a", ("walk",), 10, "ours", 1.0),
        row("a", ("walk",), 10, "legs-carried", 5.0),
        row("b", ("walk", "turn"), 30, "ours", 3.0),
        row("b", ("walk", "turn"), 30, "legs-carried", float("nan")),
    ]


def test_a_clip_with_two_behaviours_counts_for_both() -> None:
    groups = by_behaviour(rows())
    assert {name: (group["clips"], group["seconds"]) for name, group in groups.items()} == {"turn": (1, 30), "walk": (2, 40)}
    assert groups["walk"]["summary"]["ours"]["lookahead"]["hips_cm"] == pytest.approx(2.5)
    assert groups["turn"]["summary"]["ours"]["lookahead"]["hips_cm"] == 3


def test_tables_hold_what_was_measured() -> None:
    card = {"rows": rows(), "summary": summarize(rows()), "by_behaviour": by_behaviour(rows())}
    lines = markdown(card, "Two clips.").splitlines()
    assert lines[0] == "Two clips."
    assert "| metric | better | ours | legs-carried |" in lines
    assert "| hips_cm | less | 2.50 | 5.00 |" in lines
    assert "| turn | 1 | 30 | 3.00 | – |" in lines
    assert [line.split(" | ")[0].strip("| ") for line in lines if " | less | " in line] == [name for name in BETTER if BETTER[name] == "less"]


def test_the_drawing_has_a_bar_for_every_value_and_none_is_longer_than_the_largest() -> None:
    card = {"summary": summarize(rows())}
    drawn = ElementTree.fromstring(drawing(card))
    bars = [float(rect.get("width")) for rect in drawn.iter("{http://www.w3.org/2000/svg}rect") if rect.get("fill") != "white"]
    assert len(bars) == 2 * len(DRAWN)
    assert bars[0] == pytest.approx(max(bars) / 2, abs=0.1)


def test_badly_tracked_takes_are_solved_too_where_it_is_asked(clips: list[Path]) -> None:
    card = run(score_card(clips[1:], {"legs-carried": legs_carried}, [SolveOptions()], disturb=("legs-carried",)))
    metrics = card["rows"][0]["metrics"]
    assert all(np.isfinite(metrics[f"{name}_lower_mpjpe_cm"]) for name in DISTURBANCES)


def test_a_disturbance_does_what_its_name_says(body_motion: Motion) -> None:
    body, clean = body_motion.skeleton.subset(BODY_JOINTS), synthesize(body_motion)
    takes = {name: disturbed(name, body_motion, body) for name in DISTURBANCES}
    wrist = {name: np.linalg.norm(take.positions - clean.positions, axis=-1)[:, 1] for name, (take, _) in takes.items()}
    assert 0.005 < np.median(wrist["offsets"]) < 0.15
    assert 0.005 < np.median(wrist["noise"]) < 0.04
    assert takes["height"][1].height_above_toes() == pytest.approx(1.1 * body.height_above_toes(), rel=1e-5)
    lost = ~takes["lost_hand"][0].tracked[:, 1]
    assert 3.5 * RATE < lost.sum() < 5.5 * RATE
    assert wrist["lost_hand"][~lost].max() < 1e-4
    assert all(np.isfinite(take.positions).all() for take, _ in takes.values())


def test_a_truth_that_stands_still_is_no_measure_of_detail(body_motion: Motion) -> None:
    still = part_of(body_motion, 0, 30)
    still = replace(still, root=still.root[:1].repeat(30, 0), rotations=still.rotations[:1].repeat(30, 0))
    metrics = measure(part_of(body_motion, 60, 90), still)
    assert np.isnan(metrics["detail_ratio"])
    assert np.isnan(metrics["jitter_ratio"])


def test_other_models_are_rows_by_their_names(small_model_folder: Path) -> None:
    model = load_model(small_model_folder)
    assert list(rival_methods([model], ["causal"])) == ["small"]
    with pytest.raises(InputError, match="small"):
        rival_methods([model, model], ["causal"])
