"""Ways around: where a finger's path leaps, because it changes sides of a solid at once, it is sought again among poses all over its limits, by
steps that a hand can make.

The finger then leaves early, goes round by poses that nobody asked for, such as an open one, and comes back late. The poses are those of a grid,
and a step goes to one that is near, by way of the pose between, so that no step leads through a solid.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ..motion.rotations import Array
from ..progress import Job, Progress
from .contact import Probe, axis_points, point_radii
from .hand import finger_angles
from .project import EASE, FASTEST_TIP, SETTLING, TOUCH, fastest_steps, pushed_out, tip_steps
from .sensor import Grid, surroundings

REACH = 0.5  # seconds that a finger may at first leave early, and come back late
GIVEN_UP = 20.0  # seconds that are sought again at most
COUNTS = (8, 7, 8), *[(13, 11, 3)] * 4  # poses in the grid of each finger: of the first bend, of the other two together, and of the spread
STRIDES = (2, 2, 2), *[(2, 2, 1)] * 4  # how far a step may go
SHARES = (0.5, 1.0)  # where along a phalanx it is looked
LEAP = 0.2  # radians of a step, from which it is looked what is on the way
SOLID = 0.003  # metres of depth that the poses of the grid are not near enough to explain
WALL = 1e4  # the cost of a pose or a step that is deeper inside
THROUGH = 0.002  # metres that a step may be deeper inside than its ends
BETWEEN = (0.25, 0.5, 0.75)  # where along a step


@dataclass(frozen=True)
class Rough:
    """Distances around the palm as the sensor's grid has them: quick to ask for many poses, right to a few millimetres."""

    probe: Probe
    grid: Grid
    seen: dict[int, Array] = field(default_factory=dict)

    def values(self, frames: np.ndarray) -> Array:
        """Distance and normal of every cell [F, C, 4], metres, in the palm's axes. They are kept, in as little memory as they need."""
        new = np.array([frame for frame in frames.tolist() if frame not in self.seen], int)
        if len(new):
            distances, normals = surroundings(self.grid, self.probe.hand, self.probe.wrists, self.probe.nearest, new)
            values = np.concatenate((np.minimum(distances, 1)[..., None], normals), -1).astype(np.float16)
            self.seen.update(zip(new.tolist(), values, strict=True))
        return np.stack([self.seen[frame] for frame in frames.tolist()])

    def weights(self, points: Array) -> tuple[np.ndarray, Array]:
        """Of which cells [P, 8] the values are summed up, and with which weights [P, 8, 4], for the distances of points [P, 3] in the wrist's frame:
        each cell sees a plane. Points that no cell is near get no weights."""
        hand, grid = self.probe.hand, self.grid
        numbers = np.full(np.array(grid.inside.shape) + 2, -1)
        numbers[1:-1, 1:-1, 1:-1][grid.inside] = np.arange(grid.count)
        places = points @ hand.palm / (hand.length * grid.cell) - grid.corner + 0.5
        places = np.clip(places, 0, np.array(numbers.shape) - 1.001)
        corners = np.floor(places).astype(int)[:, None] + np.argwhere(np.ones((2, 2, 2), bool))
        beside = places[:, None] - corners
        cells = numbers[tuple(np.moveaxis(corners, -1, 0))]
        shares = np.where(cells >= 0, (1 - np.abs(beside)).prod(-1), 0)
        shares /= np.maximum(shares.sum(-1, keepdims=True), 1e-9)
        planes = np.concatenate((np.ones((*shares.shape, 1)), beside * grid.cell * hand.length), -1)
        return np.maximum(cells, 0), (shares[..., None] * planes).astype(np.float32)


@dataclass(frozen=True)
class Detours:
    """The grid of one finger's poses, and the steps between them.

    seconds    that a step takes
    stiffness  what a step costs, for a squared radian
    """

    rough: Rough
    finger: int
    seconds: float
    stiffness: float

    @property
    def probe(self) -> Probe:
        return self.rough.probe

    @cached_property
    def poses(self) -> Array:
        """[S, 4], all over the limits; the last two joints bend together, as they do in a hand."""
        least, greatest = self._limits
        shares = self._places / (np.array(COUNTS[self.finger]) - 1)
        return (least + shares[:, [0, 1, 1, 2]] * (greatest - least)).astype(np.float32)

    @property
    def _limits(self) -> Array:
        return finger_angles(self.probe.hand.limits.T)[:, self.finger]

    @property
    def _places(self) -> np.ndarray:
        """Where in the grid the poses are, int [S, 3]."""
        return np.argwhere(np.ones(COUNTS[self.finger], bool))

    @property
    def _fastest(self) -> float:
        return FASTEST_TIP * self.probe.hand.length * self.seconds

    @cached_property
    def steps(self) -> tuple[np.ndarray, np.ndarray, Array]:
        """For each pose from which poses it may be reached, int [S, N], by way of which, and at what cost: infinite where that is too far."""
        counts, stride = COUNTS[self.finger], np.array(STRIDES[self.finger])
        here = self._places[:, None]
        before = here + np.argwhere(np.ones(2 * stride + 1, bool)) - stride
        valid = ((before >= 0) & (before < counts)).all(-1)
        before = np.where(valid[..., None], before, here)
        between = (before + here) // 2
        before, between = (np.ravel_multi_index(tuple(np.moveaxis(places, -1, 0)), counts) for places in (before, between))
        tips = self._tips(self.poses)
        valid &= np.linalg.norm(tips[before] - tips[:, None], axis=-1) <= self._fastest
        costs = ((self.poses[before] - self.poses[:, None]) ** 2).sum(-1) * self.stiffness
        return before, between, np.where(valid, costs, np.inf).astype(np.float32)

    def _tips(self, angles: Array) -> Array:
        return self.probe.hand.chains(angles, np.full(len(angles), self.finger))[:, -1]

    def path(self, frames: np.ndarray, wanted: Array, start: Array | None, end: Array | None) -> tuple[Array, bool]:
        """The cheapest path [K, 4] at `frames` int [K] near the wanted angles [K, 4], from `start` [4] to `end` [4] where these are given, and
        whether it is free."""
        count, (before, between, steps) = len(self.poses), self.steps
        depths = self.depths(frames)
        inside = (np.maximum(depths, 0) / TOUCH) ** 2 + WALL * (depths > SOLID + np.maximum(depths.min(1, keepdims=True), 0))
        costs = inside + ((self.poses - wanted[:, None]) ** 2).sum(-1) / EASE**2
        best, came_from = np.zeros(count, np.float32) if start is None else self._joining(start), np.zeros((len(frames), count), int)
        first, last = int(start is not None), len(frames) - int(end is not None)
        best = best + costs[first]
        for t in range(first + 1, last):
            total = best[before] + steps + inside[t][between]
            choice = total.argmin(-1)
            came_from[t] = before[np.arange(count), choice]
            best = total[np.arange(count), choice] + costs[t]
        best = best if end is None else best + self._joining(end)
        at, free = int(best.argmin()), bool(best.min() < WALL)
        path = np.empty((len(frames), 4), np.float32)
        for t in range(last - 1, first - 1, -1):
            path[t] = self.poses[at]
            at = came_from[t][at]
        if start is not None:
            path[0] = start
        if end is not None:
            path[-1] = end
        return path, free

    def depths(self, frames: np.ndarray) -> Array:
        """How deep each pose is inside at frames [F, S]."""
        rows, weights, radii = self._sensing
        values = np.ascontiguousarray(self.rough.values(frames).reshape(len(frames), -1).T, np.float32)
        distances = np.zeros((len(radii), len(frames)), np.float32)
        for row, weight in zip(rows, weights, strict=True):
            distances += weight[:, None] * values[row]
        return (radii[:, None] - distances).reshape(len(self.poses), -1, len(frames)).max(1).T

    @cached_property
    def _sensing(self) -> tuple[np.ndarray, Array, Array]:
        """Which values of a frame, int [32, P], are summed up with which weights [32, P] for the distances of the points of all poses, and radii [P]."""
        of = np.full(len(self.poses), self.finger)
        points = axis_points(self.probe.hand, self.probe.hand.chains(self.poses, of), SHARES, of).reshape(-1, 3)
        cells, weights = self.rough.weights(points)
        rows = (4 * cells[..., None] + np.arange(4)).reshape(len(points), -1)
        radii = np.tile(point_radii(self.probe.hand, SHARES)[self.finger], len(self.poses))
        return rows.T.copy(), weights.reshape(len(points), -1).T.copy(), np.where(weights[..., 0].sum(-1) > 0, radii, -1).astype(np.float32)

    def _joining(self, pose: Array) -> Array:
        """What the step between a pose [4] and each of the grid costs [S]."""
        least, greatest = self._limits
        apart = np.abs((pose - self.poses) / (greatest - least))[:, [0, 1, 3]] * (np.array(COUNTS[self.finger]) - 1)
        far = (apart > STRIDES[self.finger]).any(-1) | (np.linalg.norm(self._tips(self.poses) - self._tips(pose[None]), axis=-1) > self._fastest)
        return ((self.poses - pose) ** 2).sum(-1) * self.stiffness + WALL * far


def leaping(probe: Probe, frames: np.ndarray, path: Array, wanted: Array, seconds: float) -> np.ndarray:
    """bool [K - 1, 5]: where fingers on a path [K, 5, 4] at `frames` int [K] are too fast, or go through something."""
    leaps = tip_steps(probe.hand, path) > fastest_steps(probe.hand, wanted, seconds)
    steps, fingers = np.nonzero(~leaps & (np.abs(np.diff(path, axis=0)).max(-1) > LEAP))
    start, way = path[steps, fingers], path[steps + 1, fingers] - path[steps, fingers]
    places = np.concatenate([start + share * way for share in (0.0, *BETWEEN, 1.0)]).astype(np.float32)
    times = np.round(np.concatenate([frames[steps] + share * (frames[steps + 1] - frames[steps]) for share in (0.0, *BETWEEN, 1.0)])).astype(int)
    depths = probe.depths(times, np.tile(fingers, len(BETWEEN) + 2), places).max(-1).reshape(len(BETWEEN) + 2, -1)
    leaps[steps, fingers] = depths[1:-1].max(0) > np.maximum(depths[[0, -1]].max(0), 0) + THROUGH
    return leaps


def windows(leaps: np.ndarray, reach: int) -> list[tuple[int, int]]:
    """First and last index of what is within `reach` steps of each leap bool [K - 1]; where they meet they are one."""
    found: list[tuple[int, int]] = []
    for at in np.flatnonzero(leaps).tolist():
        start, end = max(0, at - reach), min(len(leaps), at + 1 + reach)
        if found and start < found[-1][1]:
            start = found.pop()[0]
        found.append((start, end))
    return found


def around(detours: Detours, frames: np.ndarray, path: Array, wanted: Array, leaps: np.ndarray) -> Job[Array]:
    """A path [K, 4] of a finger at `frames` int [K] with other ways around its leaps bool [K - 1]. Where there is no free way, more of it is sought
    again: a finger that could only get where it is through a solid must not be there."""
    path, last, most = path.copy(), len(path) - 1, GIVEN_UP / detours.seconds
    todo = windows(leaps, round(REACH / detours.seconds))
    while todo:
        start, end = todo.pop(0)
        yield Progress(start / len(path), "looking for ways around")
        here = slice(start, end + 1)
        way, free = detours.path(frames[here], wanted[here], path[start] if start > 0 else None, path[end] if end < last else None)
        if free or end - start >= min(last, most):
            path[here], _ = pushed_out(detours.probe, frames[here], np.full(len(way), detours.finger), way, SETTLING)
        else:
            longer = end - start
            end = todo.pop(0)[1] if todo else min(last, end + longer)
            todo.insert(0, (max(0, start - longer), end))
    return path
