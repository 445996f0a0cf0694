"""Changes over time as cubic splines, so that no correction pops, and least squares over all their knots at once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..motion.rotations import Array

KNOT = 0.12  # seconds between knots
REACH = 4  # knots that a frame depends on


@dataclass(frozen=True)
class Spline:
    """Uniform cubic B-splines over `count` frames at `rate` frames per second, K knots. Open ends are free, others begin or end at rest at zero."""

    count: int
    rate: float
    open_start: bool
    open_end: bool

    @property
    def stride(self) -> int:
        """Frames from one knot to the next."""
        return max(1, round(KNOT * self.rate))

    @property
    def intervals(self) -> int:
        return -(-self.count // self.stride)

    @property
    def knots(self) -> int:
        return self.intervals + REACH - 1

    @cached_property
    def weights(self) -> Array:
        """[stride, 4]: how much the frames of an interval take of its four knots."""
        u = np.arange(self.stride)[:, None] / self.stride
        return np.concatenate(((1 - u) ** 3, 3 * u**3 - 6 * u**2 + 4, -3 * u**3 + 3 * u**2 + 3 * u + 1, u**3), -1) / 6

    def values(self, knots: Array) -> Array:
        """[count, n] from knots [K, n]."""
        windows = np.stack([knots[i : i + self.intervals] for i in range(REACH)], 1)
        return np.einsum("hk,ikn->ihn", self.weights, windows).reshape(-1, knots.shape[-1])[: self.count]

    def knots_near(self, at: np.ndarray, values: Array) -> Array:
        """Knots [K, n] of a spline that follows values [F, n] at frames `at` [F], a little smoother."""
        places = (np.arange(self.knots) - 1) * self.stride
        knots = np.stack([np.interp(places, at, column) for column in values.T], -1)
        knots[self._fixed] = 0
        return knots

    @cached_property
    def _fixed(self) -> np.ndarray:
        fixed = np.zeros(self.knots, bool)
        fixed[:3] = not self.open_start
        fixed[self.count // self.stride :] |= not self.open_end  # at rest in the first frame beyond, although the last interval may go on
        return fixed

    def step(self, blocks: Array, pull: Array, prior: Array, knots: Array, limits: tuple[float, float]) -> Array:
        """The change of knots [K, n] that minimises, to second order, the sum over frames of a cost with curvature `blocks` [count, n, n] and
        downhill slope `pull` [count, n], of (values * prior)^2 and of their speed and acceleration over what `limits` allow per second.
        """
        size, spare = knots.shape[-1], self.intervals * self.stride - self.count
        blocks = np.concatenate((blocks, np.zeros((spare, size, size)))).reshape(self.intervals, self.stride, size, size)
        pull = np.concatenate((pull, np.zeros((spare, size)))).reshape(self.intervals, self.stride, size)
        band = np.zeros((REACH, self.knots, size, size))  # band[d, k]: between knots k and k + d
        right = np.zeros((self.knots, size))
        for i in range(REACH):
            right[i : i + self.intervals] += np.einsum("h,ihn->in", self.weights[:, i], pull)
            for j in range(i, REACH):
                band[j - i, i : i + self.intervals] += np.einsum("h,ihnm->inm", self.weights[:, i] * self.weights[:, j], blocks)
        for stencil, scale in self._regularity(limits):
            rows = self.knots - len(stencil) + 1
            for i, first in enumerate(stencil):
                for j, second in enumerate(stencil):
                    term = first * second * scale * prior**2
                    right[i : i + rows] -= term * knots[j : j + rows]
                    if j >= i:
                        band[j - i, i : i + rows, np.arange(size), np.arange(size)] += term[:, None]
        for d in range(REACH):
            band[d, : self.knots - d][self._fixed[: self.knots - d] | self._fixed[d:]] = 0
        band[0, self._fixed] = np.eye(size)
        right[self._fixed] = 0
        return _solve_banded(band, right)

    def cost(self, prior: Array, knots: Array, limits: tuple[float, float]) -> float:
        """What knots [K, n] cost by themselves."""
        total = 0.0
        for stencil, scale in self._regularity(limits):
            rows = self.knots - len(stencil) + 1
            difference = sum(value * knots[i : i + rows] for i, value in enumerate(stencil))
            total += scale * float(np.sum((difference * prior) ** 2))
        return total

    def _regularity(self, limits: tuple[float, float]) -> list[tuple[tuple[float, ...], float]]:
        """Differences of knots and what their squares cost: of the values themselves, of speed and of acceleration, as often as there are frames."""
        frequency, speed, acceleration = self.rate / self.stride, *limits  # of knots per second, 0 for a single pose
        mean = tuple(np.array([1, 4, 1]) / 6)
        differences = ((-1, 1), frequency / speed), ((1, -2, 1), frequency**2 / acceleration)
        return [(mean, self.stride), *((stencil, self.stride * size**2) for stencil, size in differences)]


def _solve_banded(band: Array, right: Array) -> Array:
    """x [K, n] of a symmetric positive system whose blocks band[d, k] join x[k] and x[k + d]: elimination on groups of three knots."""
    reach, count, size = len(band) - 1, *right.shape
    groups = -(-count // reach)
    width = reach * size
    diagonal, beside = np.zeros((groups, width, width)), np.zeros((groups, width, width))
    padded = np.zeros((groups * reach, size))
    padded[:count] = right
    for k in range(groups * reach):
        group, row = divmod(k, reach)
        rows = slice(row * size, (row + 1) * size)
        if k >= count:
            diagonal[group, rows, rows] = np.eye(size)
            continue
        for d in range(reach + 1):
            if k + d >= count:
                break
            other, column = divmod(k + d, reach)
            columns = slice(column * size, (column + 1) * size)
            if other == group:
                diagonal[group, rows, columns] = band[d, k]
                diagonal[group, columns, rows] = band[d, k].T
            else:
                beside[group, rows, columns] = band[d, k]
    carried = padded.reshape(groups, width)
    solved = np.empty_like(carried)
    links = np.empty_like(beside)
    for g in range(groups):
        if g:
            diagonal[g] -= beside[g - 1].T @ links[g - 1]
            carried[g] -= links[g - 1].T @ carried[g - 1]
        links[g] = np.linalg.solve(diagonal[g], beside[g])
    for g in reversed(range(groups)):
        solved[g] = np.linalg.solve(diagonal[g], carried[g])
        if g + 1 < groups:
            solved[g] -= links[g] @ solved[g + 1]
    return solved.reshape(-1, size)[:count]
