"""Choosing among candidates: Viterbi finds the best path, the causal choice looks at nothing later."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from cbm_addon.solve.candidates import TRANSITION, agreement, choose_next, choose_path, gumbel_noise


def test_the_path_is_the_best_of_all_paths() -> None:
    """An independent oracle: every path, counted out."""
    random = np.random.default_rng(3)
    hops, candidates, sequence, hop = 5, 3, 7, 3
    own = random.random((hops, candidates))
    paths = random.normal(size=(hops, candidates, sequence, 2, 3))

    def cost(path: tuple[int, ...]) -> float:
        total = sum(own[h, k] for h, k in enumerate(path))
        for h in range(1, hops):
            earlier, later = paths[h - 1, path[h - 1], hop:], paths[h, path[h], : sequence - hop]
            total += TRANSITION * np.square(earlier - later).sum(-1).mean()
        return total

    best = min(itertools.product(range(candidates), repeat=hops), key=cost)
    assert tuple(choose_path(own, paths, hop)) == best


def test_the_causal_choice_continues_the_current_sequence() -> None:
    random = np.random.default_rng(4)
    current = random.normal(size=(8, 9, 3))
    paths = random.normal(size=(5, 8, 9, 3))
    paths[3, :-1] = current[1:]
    assert choose_next(np.zeros(5), paths, current) == 3
    assert choose_next(np.array([3.0, 1.0, 2.0, 4.0, 5.0]), paths, None) == 1


def test_noise_is_seeded_and_the_first_candidate_of_the_main_answer_is_the_most_probable() -> None:
    np.testing.assert_array_equal(gumbel_noise(4, 6, 8, 1, 0), gumbel_noise(4, 6, 8, 1, 0))
    assert not gumbel_noise(4, 6, 8, 1, 0)[0].any()
    assert gumbel_noise(4, 6, 8, 1, 1)[0].any()
    assert not np.array_equal(gumbel_noise(4, 6, 8, 1, 1), gumbel_noise(4, 6, 8, 1, 2))


def test_candidates_that_agree_with_the_chosen_one_share_its_weight_and_others_have_none() -> None:
    paths = np.zeros((4, 15, 9, 3), np.float32)
    paths[1] += 0.01
    paths[3] += 0.4
    weights = agreement(paths, 0)
    assert weights.sum() == pytest.approx(1)
    np.testing.assert_allclose(weights[:3], 1 / 3, atol=0.02)
    assert weights[3] < 1e-6
