"""Whole poses that keep clear of solids: from a motion to the nearest one that is free, smooth over time, with the trackers where they were.

Ways out are proposed for some frames: by the networks, which see the solids as voxels, and from stock (a crouch, a lean, a side-step). Each
settles for itself, the cheapest path through them is chosen, and the exact step moves all frames at once.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..hands.obstacle import Obstacle, over_time
from ..hands.path import cheapest_path
from ..motion.motion import Motion
from ..motion.rotations import Array, quat_from_yaw, rotate, yaw_from_quat
from ..progress import Job, Progress, part
from .contact import CLEARANCE, Surroundings
from .freedom import Freedom
from .model import BodyModel
from .shape import BodyShape
from .spline import Spline

MARGIN = 0.8  # seconds in which a correction comes and goes
HOP = 0.2  # seconds between frames for which ways out are proposed
CANDIDATES = 4  # of the networks
SETTLING = 8  # iterations for each candidate
FINISHING = 14  # of the exact step
LONGEST = 0.5  # in one iteration, in EASEs
SPEED, ACCELERATION = 4.0, 25.0  # EASEs per second, and per second squared, that cost as much as one EASE
DAMPING = 0.3
SHARES = (1.0, 0.5, 0.2, 0.05)  # of a step that are tried until one lowers the cost
ENOUGH = 1e-3  # share of the cost that an iteration must save for another
DEEP = 0.003  # metres of depth that cost as much as one EASE in the choice

# Ways out that need no network: a shift of the hips (left, back, up; metres) and a turn of the spine (about the body's left, back and up).
STOCK = (
    *((shift, (0.0, 0.0, 0.0)) for shift in ((0, 0, -0.15), (0, 0, -0.35), (0.15, 0, 0), (-0.15, 0, 0), (0, 0.15, 0), (0, -0.15, 0))),
    *(((0.0, 0.0, 0.0), turn) for turn in ((0.6, 0, 0), (-0.35, 0, 0), (0, 0.45, 0), (0, -0.45, 0))),
    ((0.0, 0.1, -0.2), (0.6, 0.0, 0.0)),
)  # fmt: skip


@dataclass(frozen=True)
class BodyOptions:
    """`strength` 0 leaves the body as it is, 1 is free. `hold` is how strongly head and wrists stay with their trackers. Without `exact` the answer
    is the choice among the candidates alone. The same `seed` gives the same body."""

    strength: float = 1.0
    hold: float = 1.0
    seed: int = 0
    exact: bool = True


@dataclass(frozen=True)
class BodyResult:
    """The motion, and how deep the deepest part of the body is inside in each frame [T] before and after, metres, negative where it is free."""

    motion: Motion
    before: Array
    after: Array


def avoiding(motion: Motion, shape: BodyShape, obstacles: Callable[[int], Obstacle], model: BodyModel | None, options: BodyOptions) -> Job[BodyResult]:
    """Frees a body over time.

    motion     of the shape's body, in metres of a person of ordinary size: its head joint stands at about 1.6
    obstacles  what must not be entered in each frame; asked once for a frame
    model      the networks; without them only the ways out of STOCK are tried
    Frames that are farther than MARGIN from any that touches stay as they are, to the bit.
    """
    yield Progress(0, "measuring")
    nearest, freedom = over_time(obstacles), Freedom(motion)
    around = Surroundings(freedom, shape, nearest, options.hold)
    every = np.arange(len(motion))
    changes = np.zeros((len(motion), len(freedom)))
    before = around.depths(every, changes).max(-1)
    spans = touching_spans(before > -CLEARANCE, motion.rate)
    for i, span in enumerate(spans):
        changes[span] = yield from part(_freed(around, span, model, options), 0.1 + 0.8 * i / len(spans), 0.1 + 0.8 * (i + 1) / len(spans))
    changes *= options.strength
    yield Progress(0.9, "measuring")
    freed = freedom.changed(changes)
    after = around.depths(every, changes).max(-1)
    return BodyResult(freed, before, after)


def touching_spans(touching: np.ndarray, rate: float) -> list[slice]:
    """The stretches of frames within MARGIN of one that is touching [T]."""
    reach = round(MARGIN * rate)
    wide = np.convolve(np.pad(touching.astype(int), reach), np.ones(2 * reach + 1, int), "valid") > 0
    edges = np.flatnonzero(np.diff(np.concatenate(([0], wide.astype(int), [0]))))
    return [slice(int(start), int(end)) for start, end in zip(edges[::2], edges[1::2], strict=True)]


def _freed(around: Surroundings, span: slice, model: BodyModel | None, options: BodyOptions) -> Job[Array]:
    """Changes [F, n] of the frames of a span."""
    freedom, rate = around.freedom, around.freedom.motion.rate
    frames = np.arange(span.start, span.stop)
    spline = Spline(len(frames), rate, span.start == 0, span.stop == len(freedom.motion))
    looked = np.unique(np.append(np.arange(0, len(frames), max(1, round(HOP * rate))), len(frames) - 1))
    yield Progress(0, "looking for ways out")
    chosen = _chosen(around, frames[looked], np.diff(looked) / rate, model, options)
    knots = spline.knots_near(looked, chosen)
    if options.exact:
        knots = yield from _finished(around, spline, frames, knots)
    return spline.values(knots)


def _chosen(around: Surroundings, frames: np.ndarray, seconds: Array, model: BodyModel | None, options: BodyOptions) -> Array:
    """Changes [F, n] at frames [F], `seconds` [F - 1] apart: the cheapest path through the candidates."""
    freedom = around.freedom
    starts = [np.zeros((len(frames), len(freedom))), *(stock_changes(freedom, frames) if options.exact else ())]
    if model:
        starts += model.propose(freedom, around.shape.unit, around.nearest, frames, CANDIDATES, options.seed)
    count, rows = len(starts), np.tile(frames, len(starts))
    moved = np.concatenate(starts)
    if options.exact:
        moved, cost = settled(around, rows, moved, SETTLING)
    else:
        cost = _cost(around, around.depths(rows, moved).max(-1), moved)
    moved, cost = moved.reshape(count, len(frames), -1), cost.reshape(count, -1)
    steps = (moved / freedom.ease).transpose(1, 0, 2)
    apart = ((steps[1:, None] - steps[:-1, :, None]) ** 2).sum(-1) / (seconds[:, None, None] * SPEED) ** 2
    chosen = cheapest_path(cost.T[:, None], apart[:, None])[:, 0]
    return moved[chosen, np.arange(len(frames))]


def stock_changes(freedom: Freedom, frames: np.ndarray) -> list[Array]:
    """Changes [F, n] of every way out of STOCK at frames [F]."""
    facing = quat_from_yaw(yaw_from_quat(freedom.motion.rotations[frames, 0].astype(np.float64)))
    spine = [freedom.body.index(name) for name in freedom.body.names if freedom.is_spine(name)]
    found = []
    for shift, turn in STOCK:
        changes = np.zeros((len(frames), len(freedom)))
        changes[:, :3] = rotate(facing, np.broadcast_to(np.array(shift, np.float64), (len(frames), 3)))
        axis = rotate(facing, np.broadcast_to(np.array(turn, np.float64), (len(frames), 3))) / len(spine)
        for joint in spine:
            changes[:, freedom.columns(joint)] = (np.swapaxes(freedom.world[frames, joint], -1, -2) @ axis[..., None])[..., 0]
        found.append(changes)
    return found


def settled(around: Surroundings, frames: np.ndarray, changes: Array, iterations: int) -> tuple[Array, Array]:
    """Rows of changes [R, n], each moved out for itself, and what they cost [R]."""
    prior = 1 / around.freedom.ease
    for _ in range(iterations):
        pull = around.pull(frames, changes)
        system = pull.curvature + (1 + DAMPING) * np.diag(prior**2)
        step = np.linalg.solve(system, (pull.slope - changes * prior**2)[..., None])[..., 0]
        changes = changes + _bounded(step, prior)
    pull = around.pull(frames, changes, curved=False)
    return changes, pull.cost + _cost(around, pull.depth, changes)


def _cost(around: Surroundings, depth: Array, changes: Array) -> Array:
    """What rows of changes [R, n] cost by themselves and by how deep [R] they leave the body."""
    return (np.maximum(depth + CLEARANCE / 2, 0) / DEEP) ** 2 + ((changes / around.freedom.ease) ** 2).sum(-1)


def _finished(around: Surroundings, spline: Spline, frames: np.ndarray, knots: Array) -> Job[Array]:
    """Knots of the changes of all frames, moved out together."""
    prior, limits = 1 / around.freedom.ease, (SPEED, ACCELERATION)

    def cost_of(knots: Array) -> float:
        return float(around.pull(frames, spline.values(knots), curved=False).cost.sum()) + spline.cost(prior, knots, limits)

    cost = cost_of(knots)
    for iteration in range(FINISHING):
        yield Progress(0.3 + 0.7 * iteration / FINISHING, "moving the body out")
        pull = around.pull(frames, spline.values(knots))
        step = _bounded(spline.step(pull.curvature, pull.slope, prior, knots, limits), prior)
        for share in SHARES:
            tried = knots + share * step
            found = cost_of(tried)
            if found < cost:
                break
        else:
            break
        done = found > cost * (1 - ENOUGH)
        knots, cost = tried, found
        if done:
            break
    return knots


def _bounded(step: Array, prior: Array) -> Array:
    """A step [R, n] of at most LONGEST in its largest change."""
    largest = np.abs(step * prior).max(-1, keepdims=True)
    return step * np.minimum(1, LONGEST / np.maximum(largest, 1e-9))
