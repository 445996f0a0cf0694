"""The path of least squares, against a dense solver."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cbm_addon.solve.tridiagonal import follow


@given(st.integers(0, 1000), st.integers(1, 12))
def test_the_path_is_the_one_that_a_dense_solver_finds(seed: int, count: int) -> None:
    random = np.random.default_rng(seed)
    values, trust, stiffness = random.normal(size=(count, 2, 3)), random.uniform(0.1, 2, count), random.uniform(0, 5, (count - 1, 2))
    steps = random.normal(size=(count - 1, 2, 3))
    path = follow(values, trust, stiffness, steps)
    difference = np.diff(np.eye(count), axis=0)
    for point in range(2):
        weights = np.diag(stiffness[:, point])
        normal = np.diag(trust) + difference.T @ weights @ difference
        right = trust[:, None] * values[:, point] + difference.T @ weights @ steps[:, point]
        np.testing.assert_allclose(path[:, point], np.linalg.solve(normal, right), atol=1e-9)


def test_without_stiffness_the_path_is_what_it_follows() -> None:
    values = np.arange(12.0).reshape(4, 3)
    np.testing.assert_array_equal(follow(values, np.ones(4), np.zeros(3)), values)
