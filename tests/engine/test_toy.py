"""The toy problem: its measures on answers that are known, its methods by what they can and cannot do, its figures, and the command."""

from __future__ import annotations

import json
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from torch import Tensor  # noqa: E402

from cbm_addon import cli  # noqa: E402
from cbm_addon.commands.toy import REPORT_FILES  # noqa: E402
from cbm_addon.evaluate.toy import experiment  # noqa: E402
from cbm_addon.evaluate.toy.drawing import HEAD, HEIGHT, MARGIN, WIDTH, curve_panels, error_lines  # noqa: E402
from cbm_addon.evaluate.toy.experiment import DRAWN, FARTHER, NETWORKS, Outcome, compare, examine  # noqa: E402
from cbm_addon.evaluate.toy.function import GAP, POINTS, TIMES, branch, spread_evenly, training_pairs  # noqa: E402
from cbm_addon.evaluate.toy.measures import branch_errors, coherent_share, parabola_share, positive_share, reconstruction_error, steepness  # noqa: E402
from cbm_addon.evaluate.toy.methods import CHANNELS, CLASSES, Database, Matching, Regressor  # noqa: E402
from cbm_addon.evaluate.toy.report import TITLES, figures, markdown  # noqa: E402
from cbm_addon.evaluate.toy.training import train  # noqa: E402
from cbm_addon.progress import run  # noqa: E402


class Exact:
    """Answers with either branch, as likely; what it is shown it gives back."""

    def draw(self, x: Tensor) -> Tensor:
        return (torch.randint(2, (len(x), 1)) * 2 - 1) * branch(x)

    def rebuild(self, x: Tensor, y: Tensor) -> Tensor:
        return y


class MeanOfBranches:
    """The best answer in the least-squares sense: zero."""

    def draw(self, x: Tensor) -> Tensor:
        return torch.zeros(len(x), POINTS)

    def rebuild(self, x: Tensor, y: Tensor) -> Tensor:
        return self.draw(x)


class OneBranch(Exact):
    """Coherent, but it knows of no other answer."""

    def draw(self, x: Tensor) -> Tensor:
        return branch(x)


class SignByX(Exact):
    """As many positive answers as negative ones, but never both to the same X."""

    def draw(self, x: Tensor) -> Tensor:
        return torch.where(x < x.median(), 1.0, -1.0) * branch(x)


def test_an_exact_sampler_meets_every_measure() -> None:
    found = examine(Exact(), 0).measures
    assert found["coherent"] == found["beyond_parabolas"] == 1
    assert found["reconstruction_error"] == found["gap_error"] == 0
    assert 0.48 < found["positive"] < 0.52
    assert 0.44 < found["positive_least"] < 0.5 < found["positive_most"] < 0.56
    assert found["beyond_steepness"] == pytest.approx(FARTHER, rel=1e-2)


def test_the_mean_of_the_branches_is_no_answer() -> None:
    found = examine(MeanOfBranches(), 0).measures
    assert found["coherent"] == 0
    assert np.isnan(found["positive"])
    assert found["reconstruction_error"] == found["gap_error"] == 1


def test_coherence_without_both_branches_is_seen() -> None:
    assert examine(OneBranch(), 0).measures["positive"] == 1
    found = examine(SignByX(), 0).measures
    assert found["positive"] == pytest.approx(0.5, abs=0.01)
    assert (found["positive_least"], found["positive_most"]) == (0, 1)


def test_an_answer_is_coherent_up_to_fifteen_per_cent_of_the_branch() -> None:
    x = spread_evenly(0, 1, 100)
    y = branch(x)
    torch.testing.assert_close(branch_errors(x, -1.1 * y), torch.full((100,), 0.1), rtol=1e-4, atol=0)
    assert coherent_share(x, -1.149 * y) == 1
    assert coherent_share(x, 0.849 * y) == 0
    assert coherent_share(x, torch.where(torch.arange(100)[:, None] < 25, y, 0 * y)) == 0.25


def test_an_answer_that_changes_sides_is_neither_coherent_nor_a_parabola() -> None:
    y = branch(torch.ones(1, 1)) * torch.sign(TIMES)
    assert coherent_share(torch.ones(1, 1), y) == 0
    assert parabola_share(y) == 0


def test_steepness_is_what_the_branch_was_made_with() -> None:
    x = torch.tensor([[0.2], [-3.0], [8.0]])
    torch.testing.assert_close(steepness(branch(x)), x[:, 0])
    assert parabola_share(branch(x)) == 1
    noise = torch.randn(3, POINTS, generator=torch.Generator().manual_seed(0))
    assert parabola_share(branch(x) + noise * x.abs()) == 0


def test_reconstruction_error_is_relative_to_all_sequences_at_once() -> None:
    y = torch.tensor([[3.0, 4.0], [0.0, 0.0]])
    assert reconstruction_error(y, y * 1.2) == pytest.approx(0.2)
    assert reconstruction_error(y, torch.zeros(2, 2)) == 1


def test_positive_share_counts_coherent_answers_only() -> None:
    x = torch.ones(4, 1)
    y = branch(torch.tensor([[1.0], [1.0], [-1.0], [0.4]]))
    assert positive_share(x, y) == pytest.approx(2 / 3)


def test_training_pairs_hold_both_signs_of_steepnesses_outside_the_gap() -> None:
    x, y = training_pairs(1)
    assert not ((x > GAP[0]) & (x < GAP[1])).any()
    assert (x.diff(dim=0) >= 0).all()
    assert x.min() < 0.001
    assert x.max() > 0.999
    torch.testing.assert_close(steepness(y[::2]), x[::2, 0])
    torch.testing.assert_close(y[1::2], -y[::2])
    assert torch.equal(training_pairs(1)[0], x)
    assert not torch.equal(training_pairs(2)[0], x)


def test_a_database_answers_with_what_it_holds() -> None:
    x, y = training_pairs(1)
    database = Database(x, y)
    picked = torch.randperm(len(x))[:500]
    torch.testing.assert_close(database.rebuild(x[picked], y[picked]), y[picked])
    assert set(torch.sign(steepness(database.draw(x[:1].expand(50, 1)))).tolist()) == {1, -1}


def test_a_database_cannot_interpolate_nor_extrapolate() -> None:
    database = Database(*training_pairs(1))
    gap = spread_evenly(*GAP, 100)
    edge = torch.where(gap < sum(GAP) / 2, GAP[0], GAP[1])
    torch.testing.assert_close(branch_errors(gap, database.draw(gap)), ((gap - edge).abs() / gap)[:, 0], atol=2e-3, rtol=0)
    found = examine(database, 0).measures
    assert found["coherent"] == found["beyond_parabolas"] == 1
    assert 0.04 < found["gap_error"] < 0.06
    assert 0.99 < found["beyond_steepness"] <= 1.0001


@pytest.mark.parametrize("name", NETWORKS)
def test_every_network_learns_and_answers_in_the_shape_of_the_function(name: str) -> None:
    torch.manual_seed(0)
    x, y = training_pairs(0)
    network, sample = NETWORKS[name](), torch.randint(len(x), (1000,))
    with torch.no_grad():
        before = network.loss(x[sample], y[sample])
        assert network.draw(x[sample]).shape == network.rebuild(x[sample], y[sample]).shape == (1000, POINTS)
    run(train(network, x, y, 60, name))
    assert not network.training
    with torch.no_grad():
        assert network.loss(x[sample], y[sample]) < before


def test_a_regressor_learns_the_mean_of_the_branches() -> None:
    torch.manual_seed(0)
    network = Regressor()
    run(train(network, *training_pairs(0), 200, "mlp"))
    found = examine(network, 0).measures
    assert found["coherent"] == 0
    assert found["reconstruction_error"] == pytest.approx(1, abs=0.02)


@pytest.mark.parametrize("sees_x", [True, False])
def test_the_decoder_of_codebook_matching_sees_x_or_the_code_only(sees_x: bool) -> None:
    network = Matching("kl", 0.01, sees_x).eval()
    codes = torch.nn.functional.one_hot(torch.zeros(1, CHANNELS, dtype=torch.long), CLASSES).float()
    with torch.no_grad():
        one, other = (network.network.decode(codes, torch.tensor([[x]])) for x in (0.2, 0.9))
    assert torch.equal(one, other) != sees_x


@pytest.fixture(scope="module")
def outcomes() -> dict[str, Outcome]:
    return run(compare(3, 1))


@pytest.mark.parametrize("seed", [1, 2])
def test_only_the_same_seed_gives_the_same_outcomes(outcomes: dict[str, Outcome], monkeypatch: pytest.MonkeyPatch, seed: int) -> None:
    chosen = ("mlp", "cm-kl")
    monkeypatch.setattr(experiment, "NETWORKS", {name: NETWORKS[name] for name in chosen})
    again = run(compare(3, seed))
    assert list(again) == ["database", *chosen]
    for name in again:
        same = torch.equal(again[name].outside, outcomes[name].outside)
        assert same == (seed == 1)
        assert (again[name].measures["gap_error"] == outcomes[name].measures["gap_error"]) == same


def test_an_abandoned_comparison_gives_the_processor_back_its_small_numbers() -> None:
    job = compare(1000, 1)
    next(job)
    job.close()
    assert torch.tensor(1e-40) * 1 != 0


def path_of(element: ElementTree.Element) -> np.ndarray:
    """Points [P, 2] of a path of one move and relative lines."""
    numbers = np.array([int(number) for number in re.findall(r"-?\d+", element.get("d", ""))])
    return numbers.reshape(-1, 2).cumsum(axis=0)


def test_a_curve_is_drawn_where_it_is() -> None:
    curves = np.array([np.linspace(-1, 1, 50), np.full(50, 0.5)])
    svg = ElementTree.fromstring(curve_panels([("a < b", curves), ("c", curves[:1])], 2, 1.0, 1.0))
    panels = svg.findall("{*}svg")
    assert [(panel.get("x"), panel.get("y")) for panel in panels] == [(str(MARGIN), str(HEAD)), (str(2 * MARGIN + WIDTH), str(HEAD))]
    rising, level = (path_of(path) for path in panels[0].findall("{*}path"))
    np.testing.assert_array_equal(rising[[0, -1]], [(0, 10 * HEIGHT), (10 * WIDTH, 0)])
    np.testing.assert_allclose(rising[:, 1], 10 * HEIGHT * np.linspace(1, 0, 50), atol=0.5)
    assert set(level[:, 1]) == {10 * HEIGHT // 4}
    assert len({path.get("stroke") for path in panels[0].findall("{*}path")}) == 2
    assert [text.text for text in svg.findall("{*}text")] == ["a < b", "c"]


def test_errors_are_drawn_over_a_shaded_gap() -> None:
    svg = ElementTree.fromstring(error_lines([("low", np.zeros(9)), ("high", np.full(9, 0.1))], (0.4, 0.6), GAP, 0.1))
    (panel,) = svg.findall("{*}svg")
    low, high = (path_of(path) for path in panel.findall("{*}path"))
    assert set(low[:, 1]) == {10 * HEIGHT}
    assert set(high[:, 1]) == {0}
    (shade,) = panel.findall("{*}rect")
    assert (int(shade.get("x", "")), int(shade.get("width", ""))) == (10 * WIDTH // 4, 10 * WIDTH // 2)


def test_the_report_has_a_row_for_every_method_and_small_figures(outcomes: dict[str, Outcome]) -> None:
    text = markdown(outcomes, {"steps": 3})
    assert text.startswith("steps 3.\n")
    assert [line.split(" | ")[0] for line in text.splitlines() if line.startswith("| ")][2:] == [f"| {name}" for name in outcomes]
    assert "| database | 100.0 |" in text
    assert "| mlp | 0.0 | – |" in text
    drawn = figures(outcomes)
    assert list(drawn) == list(REPORT_FILES[1:])
    for svg in drawn.values():
        assert len(svg) < 150_000
    panels = ElementTree.fromstring(drawn["toy_answers.svg"]).findall("{*}svg")
    assert [len(panel.findall("{*}path")) for panel in panels] == [DRAWN] * len(TITLES)


def toy(*words: object) -> int:
    return cli.main(["toy", "--quiet", *map(str, words)])


def test_the_command_writes_its_report_and_says_the_budget(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert toy("--steps", 2, "--seed", 3, "--report", tmp_path / "report", "--json", tmp_path / "toy.json") == 0
    report = json.loads((tmp_path / "toy.json").read_text())
    assert (report["steps"], report["seed"]) == (2, 3)
    assert report["methods"]["mlp"]["positive"] is None
    assert sorted(path.name for path in (tmp_path / "report").iterdir()) == sorted(REPORT_FILES)
    assert "database: coherent 1.000" in capsys.readouterr().out
    assert toy("--steps", 2, "--report", tmp_path / "report") == 2


@pytest.mark.parametrize(("words", "said"), [(["--steps", 0], "error: --steps: is 0"), (["--seed", -1], "error: --seed: is -1")])
def test_bad_options_are_one_line_and_nothing_is_written(tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[object], said: str) -> None:
    assert toy(*words, "--report", tmp_path / "report") == 2
    assert capsys.readouterr().err.startswith(said)
    assert not (tmp_path / "report").exists()
