"""The command `evaluate`: what it chooses, writes and refuses."""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from cbm_addon import cli
from cbm_addon.commands.evaluate import choose_clips
from cbm_addon.errors import InputError
from cbm_addon.evaluate.strip import POSES
from cbm_addon.features import RATE
from cbm_addon.learn.split import split_of
from cbm_addon.motion.bvh import write_bvh
from cbm_addon.motion.motion import Motion

WITHOUT_MODEL = ["--methods", "legs-carried", "motion-matching", "--quiet"]


def named(split: str, count: int) -> list[str]:
    """Clip names that fall into a split by the rule for clips that no split file knows."""
    names = (f"made__{i:03d}" for i in range(1000))
    return [name for name in names if split_of(name, {}) == split][:count]


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory, body_motion: Motion) -> Path:
    """Three clips that train and two that test, 2 s each."""
    folder = tmp_path_factory.mktemp("library")
    for i, name in enumerate([*named("train", 3), *named("test", 2)]):
        chosen = slice(30 * i, 30 * i + 60)
        write_bvh(folder / f"{name}.bvh", Motion(body_motion.skeleton, np.arange(60) / RATE, body_motion.root[chosen], body_motion.rotations[chosen]))
    return folder


@pytest.fixture
def evaluate(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(cli, "COMMANDS", ("evaluate",))
    return lambda *words: cli.main(["evaluate", *map(str, words)])


def test_it_measures_the_clips_of_the_split_and_writes_the_score_card(evaluate, library: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    report = tmp_path / "report"
    words = [library, "--split", "test", *WITHOUT_MODEL, "--mode", "lookahead", "causal", "--database", library]
    assert evaluate(*words, "--report", report, "--json", tmp_path / "card.json") == 0
    card = json.loads((tmp_path / "card.json").read_text())
    assert card["clips"] == 2
    assert card["splits"] == {"test": 2}
    assert {row["clip"] for row in card["rows"]} == set(named("test", 2))
    assert {(method, mode) for method, modes in card["summary"].items() for mode in modes} == {
        (method, mode) for method in ("legs-carried", "motion-matching") for mode in ("lookahead", "causal")
    }
    assert sorted(path.name for path in report.iterdir()) == ["results.md", "score_card.svg"]
    assert "| lower_mpjpe_cm | less |" in (report / "results.md").read_text()
    assert "legs-carried, causal: lower_mpjpe_cm" in capsys.readouterr().out


def test_the_same_words_give_the_same_numbers(evaluate, library: Path, tmp_path: Path) -> None:
    def metrics(name: str) -> list[dict[str, float]]:
        assert evaluate(library, "--split", "test", *WITHOUT_MODEL, "--database", library, "--json", tmp_path / name) == 0
        rows = json.loads((tmp_path / name).read_text())["rows"]
        return [{key: value for key, value in row["metrics"].items() if key != "ms_per_frame"} for row in rows]

    assert metrics("first.json") == metrics("second.json")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["LIBRARY", "--methods", "motion-matching"], "error: --database: is missing"),
        (["LIBRARY", "--methods", "ours", "--model", "LIBRARY"], "card.json"),
        (["LIBRARY", "--methods", "legs-carried", "--split", "validation"], "gives no clip of the split 'validation'"),
        (["LIBRARY", "--methods", "legs-carried", "--limit", "0"], "error: --limit: is 0"),
        (["LIBRARY/none.bvh", "--methods", "legs-carried"], "does not exist"),
        (["LIBRARY", "--methods", "the-best"], "invalid choice"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_written(
    evaluate, library: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], said: str
) -> None:
    report = tmp_path / "report"
    report.mkdir()
    assert evaluate(*(word.replace("LIBRARY", str(library)) for word in words), "--quiet", "--report", report) == 2
    errors = capsys.readouterr().err.splitlines()
    assert len(errors) == 1
    assert said in errors[0]
    assert list(report.iterdir()) == []


def test_a_report_that_exists_is_replaced_only_when_told_to(evaluate, library: Path, tmp_path: Path) -> None:
    (tmp_path / "results.md").write_text("mine")
    words = [library, "--limit", 1, "--methods", "legs-carried", "--quiet", "--report", tmp_path]
    assert evaluate(*words) == 2
    assert (tmp_path / "results.md").read_text() == "mine"
    assert evaluate(*words, "--overwrite") == 0
    assert "legs-carried" in (tmp_path / "results.md").read_text()


def test_a_limit_spreads_the_clips_evenly(library: Path) -> None:
    clips, _ = choose_clips([library], "all", None)
    assert choose_clips([library], "all", 2)[0] == [clips[0], clips[2]]
    assert choose_clips([library], "all", 9)[0] == clips
    with pytest.raises(InputError, match="--limit"):
        choose_clips([library], "all", 0)


def test_strips_show_every_clip_beside_the_truth(evaluate, library: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    report = tmp_path / "report"
    words = [library, "--split", "test", "--methods", "legs-carried", "--quiet", "--strips"]
    assert evaluate(*words) == 2
    assert "--report" in capsys.readouterr().err
    assert evaluate(*words, "--report", report) == 0
    for name in named("test", 2):
        picture = ElementTree.parse(report / f"strip_{name}.svg").getroot()
        figures = [path for path in picture.iter() if path.tag.endswith("path")]
        assert len(figures) == 2 * 2 * POSES
        assert len({path.get("d") for path in figures}) > POSES
