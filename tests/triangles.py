"""Meshes whose true distances are known, and a search for nearest places that tries every triangle."""

from __future__ import annotations

import numpy as np

Mesh = tuple[np.ndarray, np.ndarray]
"""Vertices float64 [V, 3] and triangles int [F, 3], wound so that normals point out."""


def search(vertices: np.ndarray, triangles: np.ndarray):
    """Nearest places by looking at the inside, the sides and the corners of all triangles."""
    a, b, c = np.asarray(vertices, float)[triangles].transpose(1, 0, 2)

    def on_segments(points, start, end):
        along = end - start
        share = np.einsum("nfi,fi->nf", points[:, None] - start, along) / np.maximum((along**2).sum(-1), 1e-30)
        return start + np.clip(share, 0, 1)[..., None] * along

    def on_insides(points):
        normal = np.cross(b - a, c - a)
        area = np.maximum((normal**2).sum(-1), 1e-30)
        beside = points[:, None] - a
        v = np.einsum("nfi,fi->nf", np.cross(beside, (c - a)[None]), normal) / area
        w = np.einsum("nfi,fi->nf", np.cross((b - a)[None], beside), normal) / area
        place = a + v[..., None] * (b - a) + w[..., None] * (c - a)
        return np.where(((v >= 0) & (w >= 0) & (v + w <= 1))[..., None], place, np.inf)

    def closest(points):
        places, found = np.empty((len(points), 3)), np.empty(len(points), int)
        for start in range(0, len(points), 64):
            chunk = np.asarray(points[start : start + 64], float)
            tried = np.stack([on_insides(chunk), *(on_segments(chunk, *side) for side in ((a, b), (b, c), (c, a)))], axis=2)
            distances = np.linalg.norm(tried - chunk[:, None, None], axis=-1)
            best = distances.reshape(len(chunk), -1).argmin(axis=1)
            found[start : start + 64] = best // 4
            places[start : start + 64] = tried.reshape(len(chunk), -1, 3)[np.arange(len(chunk)), best]
        return places, found

    return closest


def lathe(profile: np.ndarray, around: int = 32) -> Mesh:
    """A closed profile [N, 2] of radii and heights, counter-clockwise, turned about Z; radii of 0 give poles."""
    turn = 2 * np.pi * np.arange(around) / around
    ring = np.stack((np.cos(turn), np.sin(turn), np.zeros(around)), -1)
    vertices = np.concatenate([radius * ring + [0, 0, height] for radius, height in profile])
    here = np.arange(len(vertices)).reshape(len(profile), around)
    up, next_ = np.roll(here, -1, axis=0), np.roll(here, -1, axis=1)
    quads = np.stack((here, next_, np.roll(up, -1, axis=1), up), -1).reshape(-1, 4)
    triangles = np.concatenate((quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]))
    corners = vertices[triangles]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=-1)
    return vertices, triangles[areas > 1e-12]


def sphere(radius: float = 0.05, steps: int = 24) -> Mesh:
    polar = np.linspace(-np.pi / 2, np.pi / 2, steps + 1)
    return lathe(radius * np.stack((np.cos(polar) * (np.abs(polar) < np.pi / 2 - 1e-9), np.sin(polar)), -1), 2 * steps)


def bowl(radius: float = 0.05, steps: int = 16) -> Mesh:
    """The lower half of a sphere: one sheet, open above."""
    vertices, triangles = sphere(radius, 2 * steps)
    return vertices, triangles[vertices[triangles][..., 2].max(axis=1) < 1e-9]


def box(half: np.ndarray, steps: int = 1) -> Mesh:
    vertices, triangles = [], []
    for axis in range(3):
        for sign in (-1, 1):
            first = len(vertices)
            for i in np.linspace(-1, 1, steps + 1):
                vertices += [np.roll([sign, i, j], axis) * half for j in np.linspace(-1, 1, steps + 1)]
            for i in range(steps):
                for j in range(steps):
                    corner = first + i * (steps + 1) + j
                    quad = [corner, corner + steps + 1, corner + steps + 2, corner + 1][::sign]
                    triangles += [[quad[0], quad[1], quad[2]], [quad[0], quad[2], quad[3]]]
    return np.array(vertices, float), np.array(triangles)


def joined(*meshes: Mesh) -> Mesh:
    """Several meshes as one, as they are: where they overlap, each goes on inside the other."""
    firsts = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])
    return np.concatenate([mesh[0] for mesh in meshes]), np.concatenate([mesh[1] + first for mesh, first in zip(meshes, firsts, strict=False)])


MUG_RADIUS, MUG_HEIGHT, MUG_WALL = 0.04, 0.09, 0.004
HANDLE_RADIUS, HANDLE_THICKNESS = 0.028, 0.006


def mug(around: int = 48) -> Mesh:
    """A cup with a thick wall, open above, and a ring beside it as a handle, half of which is inside the wall and the cavity."""
    outer, inner, floor = MUG_RADIUS, MUG_RADIUS - MUG_WALL, MUG_WALL
    cup = lathe(np.array([[0, 0], [outer, 0], [outer, MUG_HEIGHT], [inner, MUG_HEIGHT], [inner, floor], [0, floor]]), around)
    turn = 2 * np.pi * np.arange(16) / 16
    ring, triangles = lathe(np.stack((HANDLE_RADIUS + HANDLE_THICKNESS * np.cos(turn), HANDLE_THICKNESS * np.sin(turn)), -1), around)
    return joined(cup, (ring[:, [0, 2, 1]] * [1, -1, 1] + [MUG_RADIUS + 0.018, 0, MUG_HEIGHT / 2], triangles))
