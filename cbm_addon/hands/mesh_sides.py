"""Which sides of a mesh's triangles face free space, whatever their winding: open, doubled, overlapping and inside-out meshes too.

Free space is flooded from around the mesh over the edges of a grid that no triangle crosses. Where edges do cross the surface, their ends
tell both sides of the triangles there, and triangles that no edge meets follow their neighbours. A wall between two free places is solid
if it has two surfaces, however thin, and a sheet if it has one.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ..motion.rotations import Array

BURIED, BACK_FREE, FRONT_FREE, SHEET = range(4)
"""Which sides of a triangle face free space: neither, the one behind its normal, the one before it, both. As bits: front 2, back 1."""

NODES = 400_000
ALONG = 128  # nodes of the grid along its longest side, at most
SAME_PLACE = 1e-3  # cells: surfaces that are closer are one
PAIRS = 1_000_000  # of triangles and lines of the grid at a time
SPREAD = 64  # rounds in which triangles that no edge meets ask their neighbours


def free_sides(vertices: Array, triangles: np.ndarray, free: Array | None = None) -> np.ndarray:
    """For each triangle BURIED, BACK_FREE, FRONT_FREE or SHEET, int8 [F].

    vertices   [V, 3]
    triangles  int [F, 3]
    free       [N, 3] points that are known to be in free space, such as a place in the room that encloses it; beside the surroundings of the mesh
    """
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    cell = max((high - low).max() / ALONG, np.cbrt(np.prod(np.maximum(high - low, 1e-9)) / NODES), 1e-6)
    origin = low - cell * np.array([1.31, 1.37, 1.43])  # off the planes that modelled objects are made of
    shape = np.ceil((high - origin) / cell).astype(int) + 2
    corners = ((vertices - origin) / cell)[triangles]
    crossings = [_crossings(corners, axis) for axis in range(3)]
    outside = np.zeros(shape, bool)
    outside[[0, -1]] = outside[:, [0, -1]] = outside[:, :, [0, -1]] = True
    if free is not None:
        nodes = np.round((free - origin) / cell).astype(int)
        inside_grid = np.all((nodes >= 0) & (nodes < shape), axis=-1)
        outside[tuple(nodes[inside_grid].T)] = True
    _flood(outside, [_blocked(crossing, shape, axis) for axis, crossing in enumerate(crossings)])
    votes = sum(_votes(crossing, outside, axis, len(triangles)) for axis, crossing in enumerate(crossings))
    return _ask_neighbours(np.asarray(votes), vertices, triangles)


class _Crossings(NamedTuple):
    """Where triangles cross the lines of the grid along one axis; C crossings.

    lines      int [C, 2]: indices of the line along the two axes that follow
    places     [C]: along the axis, in cells
    triangles  int [C]
    slopes     [C]: twice the area of the triangle as seen along the axis, positive where its normal points along it
    """

    lines: np.ndarray
    places: Array
    triangles: np.ndarray
    slopes: Array


def _crossings(corners: Array, axis: int) -> _Crossings:
    """The crossings of triangles [F, 3, 3] in cells, in the order of their lines and places."""
    found = [_crossings_of(corners, chunk, axis) for chunk in _chunks(corners, axis)]
    lines, places, triangles, slopes = (np.concatenate(values) for values in zip(*found, strict=True))
    order = np.lexsort((places, lines[:, 1], lines[:, 0]))
    return _Crossings(lines[order], places[order], triangles[order], slopes[order])


def _bounds(corners: Array, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """First line and number of lines [F, 2] that the box around a triangle meets, along the two axes that follow."""
    flat = corners[:, :, [(axis + 1) % 3, (axis + 2) % 3]]
    first = np.ceil(flat.min(axis=1)).astype(int)
    return first, np.maximum(np.floor(flat.max(axis=1)).astype(int) - first + 1, 0)


def _chunks(corners: Array, axis: int) -> Iterator[slice]:
    """Runs of triangles with few enough candidates to look at together."""
    counts = np.cumsum(_bounds(corners, axis)[1].prod(axis=-1))
    edges = np.unique(np.concatenate(([0], np.searchsorted(counts, np.arange(PAIRS, counts[-1] if len(counts) else 0, PAIRS)), [len(corners)])))
    yield from (slice(start, end) for start, end in pairwise(edges))


def _crossings_of(corners: Array, chunk: slice, axis: int) -> _Crossings:
    corners = corners[chunk]
    first, count = _bounds(corners, axis)
    total = count.prod(axis=-1)
    of = np.repeat(np.arange(len(corners)), total)
    nth = np.arange(len(of)) - np.repeat(np.cumsum(total) - total, total)
    lines = first[of] + np.stack((nth // np.maximum(count[of, 1], 1), nth % np.maximum(count[of, 1], 1)), axis=-1)
    flat = corners[:, :, [(axis + 1) % 3, (axis + 2) % 3]]
    sides = np.roll(flat, -1, axis=1) - flat
    areas = sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0]
    beside = lines[:, None] - flat[of]
    weights = sides[of, :, 0] * beside[..., 1] - sides[of, :, 1] * beside[..., 0]  # of the corner opposite to each side
    met = np.all(weights * np.sign(areas[of])[:, None] >= 0, axis=-1) & (areas[of] != 0)
    of, lines, weights = of[met], lines[met], weights[met]
    opposite = np.roll(corners[:, :, axis], 1, axis=1)[of]
    return _Crossings(lines, (weights * opposite).sum(axis=-1) / areas[of], of + (chunk.start or 0), areas[of])


def _edges(crossing: _Crossings, axis: int) -> tuple[np.ndarray, ...]:
    """The nodes [C] x 3 before the crossings, as an index in the order of the array's axes."""
    nodes = [np.empty(0)] * 3
    nodes[axis], nodes[(axis + 1) % 3], nodes[(axis + 2) % 3] = np.floor(crossing.places).astype(int), *crossing.lines.T
    return tuple(nodes)


def _blocked(crossing: _Crossings, shape: np.ndarray, axis: int) -> np.ndarray:
    """Whether something crosses the edge from a node to the next along an axis."""
    blocked = np.zeros(shape, bool)
    blocked[_edges(crossing, axis)] = True
    return blocked


def _flood(outside: np.ndarray, blocked: list[np.ndarray]) -> None:
    """Spreads `outside` over the edges that nothing crosses."""
    count = -1
    while count != (count := np.count_nonzero(outside)):
        for axis in range(3):
            flooded, open_ = np.moveaxis(outside, axis, 0), ~np.moveaxis(blocked[axis], axis, 0)
            for i in range(len(flooded) - 1):
                flooded[i + 1] |= flooded[i] & open_[i]
            for i in range(len(flooded) - 1, 0, -1):
                flooded[i - 1] |= flooded[i] & open_[i - 1]


def _votes(crossing: _Crossings, outside: np.ndarray, axis: int, count: int) -> Array:
    """How much speaks for each answer of each triangle [F, 4]: its crossings by how straight they are.

    Along an edge everything between the first and the last surface is solid, and a single surface is between its two ends.
    """
    before = _edges(crossing, axis)
    after = tuple(nodes + (i == axis) for i, nodes in enumerate(before))
    new_edge = np.concatenate(([True], np.any([nodes[1:] != nodes[:-1] for nodes in before], axis=0)))[: len(crossing.places)]
    new_surface = new_edge | np.concatenate(([True], np.diff(crossing.places) > SAME_PLACE))[: len(crossing.places)]
    edge, surface = np.cumsum(new_edge) - 1, np.cumsum(new_surface)
    first, last = surface[new_edge], surface[np.concatenate((np.flatnonzero(new_edge)[1:] - 1, [-1]))] if len(surface) else surface
    free_before, free_after = outside[before] & (surface == first[edge]), outside[after] & (surface == last[edge])
    front_after = crossing.slopes > 0
    answer = FRONT_FREE * np.where(front_after, free_after, free_before) + BACK_FREE * np.where(front_after, free_before, free_after)
    return np.bincount(crossing.triangles * 4 + answer, np.abs(crossing.slopes), count * 4).reshape(count, 4).astype(np.float64)


def _ask_neighbours(votes: Array, vertices: Array, triangles: np.ndarray) -> np.ndarray:
    """The answer with most votes; of a triangle without any, that of its neighbours as seen from their common winding; else SHEET."""
    first, second, same_winding = neighbours(weld(vertices, triangles))
    ways = np.concatenate((np.stack((first, second)), np.stack((second, first))), axis=1)
    turned = np.array([BURIED, FRONT_FREE, BACK_FREE, SHEET])
    same_winding = np.concatenate((same_winding, same_winding))
    known = votes.sum(axis=1) > 0
    for _ in range(SPREAD):
        asked = known[ways[0]] & ~known[ways[1]]
        if not asked.any():
            break
        said = np.argmax(votes, axis=1)[ways[0, asked]]
        said = np.where(same_winding[asked], said, turned[said])
        np.add.at(votes, (ways[1, asked], said), 1)
        known[ways[1, asked]] = True
    return np.where(known, np.argmax(votes, axis=1), SHEET).astype(np.int8)


def weld(vertices: Array, triangles: np.ndarray) -> np.ndarray:
    """The triangles [F, 3] with one index for all vertices that are within a micrometre."""
    _, same = np.unique(np.round(vertices, 6), axis=0, return_inverse=True)
    return same.reshape(-1)[triangles]


def neighbours(triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pairs of triangles that share a side, int [N] and [N], and whether they are wound the same way, bool [N]."""
    starts, ends = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    owners = np.repeat(np.arange(len(triangles)), 3)
    forward = starts < ends
    order = np.lexsort((np.maximum(starts, ends), np.minimum(starts, ends)))
    low, high, owners, forward = np.minimum(starts, ends)[order], np.maximum(starts, ends)[order], owners[order], forward[order]
    shared = np.flatnonzero((low[1:] == low[:-1]) & (high[1:] == high[:-1]))
    return owners[shared], owners[shared + 1], forward[shared] != forward[shared + 1]
