"""Meshes as obstacles: the distances are those of the shapes that they show, and whatever is wrong with a mesh, free space is free."""

from __future__ import annotations

import numpy as np
import pytest

from cbm_addon.hands.mesh import Mesh, Topology
from cbm_addon.hands.mesh_sides import BACK_FREE, BURIED, FRONT_FREE, SHEET, free_sides
from cbm_addon.hands.shapes import Box, Sphere
from tests import triangles as made

HALF = np.array([0.06, 0.04, 0.03])
PLATE = np.array([0.1, 0.08, 0.0015])


def obstacle(mesh: made.Mesh, free: np.ndarray | None = None) -> Mesh:
    return Mesh(mesh[0], Topology.of(*mesh, free), made.search)


def points_around(mesh: made.Mesh, count: int = 400, margin: float = 0.02, seed: int = 0) -> np.ndarray:
    low, high = mesh[0].min(axis=0) - margin, mesh[0].max(axis=0) + margin
    return np.random.default_rng(seed).uniform(low, high, (count, 3)).astype(np.float32)


@pytest.mark.parametrize(
    ("mesh", "shape", "within"),
    [
        (made.box(HALF), Box(np.zeros(3), HALF), 1e-6),
        (made.box(HALF, steps=5), Box(np.zeros(3), HALF), 1e-6),
        (made.box(PLATE, steps=6), Box(np.zeros(3), PLATE), 1e-6),
        (made.sphere(0.05), Sphere(np.zeros(3), 0.05), 3e-4),
    ],
    ids=["box", "box of many triangles", "plate thinner than the grid", "sphere"],
)
def test_distances_and_normals_are_those_of_the_shape(mesh, shape, within):
    points = points_around(mesh)
    distances, normals = obstacle(mesh).nearest(points)
    expected, expected_normals = shape.nearest(points)
    np.testing.assert_allclose(distances, expected, atol=within)
    assert np.percentile(np.sum(normals * expected_normals, axis=-1), 2) > 0.98  # where the nearest place is not the only one, either will do


def test_a_step_along_the_normal_is_that_much_further_out():
    mesh = made.mug()
    points, solid = points_around(mesh), obstacle(mesh)
    distances, normals = solid.nearest(points)
    further, _ = solid.nearest(points + 1e-4 * normals)
    assert np.mean(np.abs(further - distances - 1e-4) < 2e-5) > 0.97


def random_flips(mesh: made.Mesh) -> made.Mesh:
    flipped = np.random.default_rng(1).random(len(mesh[1])) < 0.5
    return mesh[0], np.where(flipped[:, None], mesh[1][:, ::-1], mesh[1])


def without_welds(mesh: made.Mesh) -> made.Mesh:
    return mesh[0][mesh[1]].reshape(-1, 3), np.arange(3 * len(mesh[1])).reshape(-1, 3)


@pytest.mark.parametrize(
    "spoilt",
    [
        lambda mesh: (mesh[0], mesh[1][:, ::-1]),
        random_flips,
        without_welds,
        lambda mesh: made.joined(mesh, mesh),
        lambda mesh: made.joined(mesh, (mesh[0], mesh[1][:, ::-1])),
        lambda mesh: (mesh[0], np.concatenate((mesh[1], [[0, 0, 1], [5, 5, 5]]))),
        lambda mesh: made.joined(mesh, (0.3 * mesh[0], mesh[1])),
    ],
    ids=["inside out", "wound at random", "unwelded", "doubled", "doubled inside out", "with triangles of no size", "with another one inside"],
)
def test_a_spoilt_box_is_the_same_box(spoilt):
    points = points_around(made.box(HALF))
    mesh = spoilt(made.box(HALF, steps=4))
    distances, _ = obstacle(mesh).nearest(points)
    np.testing.assert_allclose(distances, Box(np.zeros(3), HALF).nearest(points)[0], atol=1e-6)


def test_a_seam_that_gapes_a_little_does_not_let_space_in():
    vertices, triangles = without_welds(made.box(HALF))
    middles = vertices.reshape(-1, 3, 3).mean(axis=1, keepdims=True)
    gaping = (middles + 0.9999 * (vertices.reshape(-1, 3, 3) - middles)).reshape(-1, 3)
    assert obstacle((gaping, triangles)).nearest(np.zeros((1, 3), np.float32))[0] < -0.02


def test_a_sheet_has_no_inside():
    sheet = np.array([[-0.1, -0.1, 0], [0.1, -0.1, 0], [0.1, 0.1, 0], [-0.1, 0.1, 0]]), np.array([[0, 1, 2], [0, 2, 3]])
    points = points_around(sheet)
    distances, normals = obstacle(sheet).nearest(points)
    over = np.all(np.abs(points[:, :2]) < 0.1, axis=1)
    np.testing.assert_allclose(distances[over], np.abs(points[over, 2]), atol=1e-6)
    np.testing.assert_allclose(normals[over, 2], np.sign(points[over, 2]), atol=1e-5)
    assert (distances >= 0).all()


def test_a_bowl_is_open():
    points = points_around(made.bowl())
    points = points[points[:, 2] < -0.005]
    distances, normals = obstacle(made.bowl()).nearest(points)
    lengths = np.linalg.norm(points, axis=1)
    np.testing.assert_allclose(distances, np.abs(lengths - 0.05), atol=3e-4)
    clear = distances > 1e-3
    assert (np.sum(normals * points, axis=1) * (lengths - 0.05))[clear].min() > 0


def test_in_a_mug_there_is_room_and_its_wall_and_handle_are_solid():
    mug = obstacle(made.mug())
    places = {
        "in the cavity, away from the handle": ([-0.01, 0, 0.05], 0.026),
        "in the wall": ([-0.038, 0, 0.05], -0.002),
        "in the floor": ([0, 0, 0.002], -0.002),
        "in the handle outside": ([0.086, 0, 0.045], -0.006),
        "inside the ring of the handle": ([0.062, 0, 0.045], 0.018),
    }
    distances, _ = mug.nearest(np.array([place for place, _ in places.values()], np.float32))
    np.testing.assert_allclose(distances, [distance for _, distance in places.values()], atol=4e-4, err_msg=str(list(places)))


def test_a_closed_room_is_free_if_someone_stands_in_it():
    room = made.box(np.array([2.0, 3.0, 1.3]))
    inside = np.array([[0, 0, 0], [1.9, 0, 0]], np.float32)
    np.testing.assert_allclose(obstacle(room).nearest(inside)[0], [-1.3, -0.1], atol=1e-5)
    distances, normals = obstacle(room, free=np.array([[0.3, 0, 0.2]])).nearest(inside)
    np.testing.assert_allclose(distances, [1.3, 0.1], atol=1e-5)
    np.testing.assert_allclose(normals[1], [-1, 0, 0], atol=1e-5)


def test_triangles_face_free_space_with_the_sides_that_they_have():
    box = made.box(HALF, steps=3)
    assert set(free_sides(*box)) == {FRONT_FREE}
    assert set(free_sides(box[0], box[1][:, ::-1])) == {BACK_FREE}
    within = free_sides(*made.joined(box, (0.5 * box[0], box[1])))
    assert list(np.unique(within[: len(box[1])])) == [FRONT_FREE]
    assert list(np.unique(within[len(box[1]) :])) == [BURIED]
    assert set(free_sides(*made.bowl())) == {SHEET}


def test_a_mesh_that_is_bent_keeps_its_topology():
    vertices, triangles = made.box(HALF, steps=6)
    topology = Topology.of(vertices, triangles)
    bent = vertices + np.stack((0 * vertices[:, 0], 0 * vertices[:, 0], 5 * vertices[:, 0] ** 2), -1)
    points = points_around((bent, triangles))
    mended, _ = Mesh(bent, topology, made.search).nearest(points)
    afresh, _ = obstacle((bent, triangles)).nearest(points)
    np.testing.assert_array_equal(mended, afresh)
