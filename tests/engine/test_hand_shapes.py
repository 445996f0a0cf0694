"""Shapes: the distance is that to the surface, and the normal is its gradient."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cbm_addon.hands.obstacle import FAR, Obstacle, empty, nearest_of
from cbm_addon.hands.shapes import Box, Capsules, Cylinder, HalfSpace, Moved, Sphere, Union, capsule
from cbm_addon.motion.rotations import normalize, quat_from_rotvec, rotate

seeds = st.integers(0, 10_000)


def shape(kind: str, random: np.random.Generator) -> Obstacle:
    centre = random.normal(size=3).astype(np.float32) * 0.1
    rotation = quat_from_rotvec(random.normal(size=3)).astype(np.float32)
    a, b, c = random.uniform(0.02, 0.2, 3)
    match kind:
        case "sphere":
            return Sphere(centre, a)
        case "half space":
            return HalfSpace(centre, normalize(random.normal(size=3)))
        case "box":
            return Box(centre, np.array([a, b, c], np.float32), rotation)
        case "cylinder":
            return Cylinder(centre, a, b, rotation)
        case "capsules":
            return Capsules(*random.normal(size=(2, 4, 3)).astype(np.float32) * 0.2, random.uniform(0.01, 0.05, 4))
        case "moved":
            return Moved(shape("box", random), centre, rotation)
        case "union":
            return Union((shape("sphere", random), shape("box", random)))
    raise AssertionError(kind)


KINDS = ("sphere", "half space", "box", "cylinder", "capsules", "moved", "union")


@pytest.mark.parametrize("kind", KINDS)
@given(seed=seeds)
@settings(max_examples=20, deadline=None)
def test_the_normal_is_the_gradient_of_the_distance(kind: str, seed: int) -> None:
    random = np.random.default_rng(seed)
    obstacle, points = shape(kind, random), random.normal(size=(200, 3)) * 0.3
    distance, normals = obstacle.nearest(points)
    step = 1e-4
    ahead, behind = (np.stack([(obstacle.nearest(points + sign * step * axis)[0] - distance) / (sign * step) for axis in np.eye(3)], -1) for sign in (1, -1))
    smooth = np.abs(ahead - behind).max(-1) < 0.02  # on a ridge of the distance the slope is that of neither side
    assert smooth.mean() > 0.9
    np.testing.assert_allclose(ahead[smooth], normals[smooth], atol=0.03)


@pytest.mark.parametrize("kind", KINDS)
@given(seed=seeds)
@settings(max_examples=20, deadline=None)
def test_a_point_outside_goes_to_the_surface_against_its_normal(kind: str, seed: int) -> None:
    random = np.random.default_rng(seed)
    obstacle, points = shape(kind, random), random.normal(size=(200, 3)) * 0.3
    distance, normals = obstacle.nearest(points)
    outside = distance > 0
    on_surface, _ = obstacle.nearest((points - normals * distance[:, None])[outside])
    np.testing.assert_allclose(on_surface, 0, atol=2e-4)
    farther, _ = obstacle.nearest((points + normals * 0.01)[outside])
    assert (farther <= distance[outside] + 0.01 + 1e-4).all(), "a distance never grows faster than the way"


@given(seed=seeds)
@settings(max_examples=20, deadline=None)
def test_a_shape_that_moves_takes_its_distances_with_it(seed: int) -> None:
    random = np.random.default_rng(seed)
    obstacle, points = shape("box", random), random.normal(size=(50, 3)).astype(np.float32)
    rotation, position = quat_from_rotvec(random.normal(size=3)).astype(np.float32), random.normal(size=3).astype(np.float32)
    distance, normals = obstacle.nearest(points)
    moved, moved_normals = Moved(obstacle, position, rotation).nearest(rotate(rotation, points) + position)
    np.testing.assert_allclose(moved, distance, atol=1e-5)
    np.testing.assert_allclose(moved_normals, rotate(rotation, normals), atol=2e-3)


def test_known_distances() -> None:
    points = np.array([[0.3, 0, 0], [0, 0, 0], [0.2, 0.2, 0]], np.float32)
    np.testing.assert_allclose(Sphere(np.zeros(3), 0.1).nearest(points)[0], [0.2, -0.1, np.sqrt(0.08) - 0.1], atol=1e-6)
    np.testing.assert_allclose(Box(np.zeros(3), np.full(3, 0.1)).nearest(points)[0], [0.2, -0.1, np.sqrt(0.02)], atol=1e-6)
    np.testing.assert_allclose(Cylinder(np.zeros(3), 0.1, 0.05).nearest(points)[0], [0.2, -0.05, np.sqrt(0.08) - 0.1], atol=1e-6)
    np.testing.assert_allclose(capsule(np.zeros(3), np.array([0, 0, 1]), 0.1).nearest(points)[0], [0.2, -0.1, np.sqrt(0.08) - 0.1], atol=1e-6)


def test_without_obstacle_everything_is_far() -> None:
    distance, normals = empty().nearest(np.zeros((5, 3), np.float32))
    assert (distance >= FAR).all()
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1)
    assert (Union(()).nearest(np.zeros((5, 3), np.float32))[0] >= FAR).all()


@given(seed=seeds)
@settings(max_examples=20, deadline=None)
def test_obstacles_that_are_asked_together_answer_as_each_by_itself(seed: int) -> None:
    random = np.random.default_rng(seed)

    def somewhere(obstacle: Obstacle) -> Moved:
        return Moved(obstacle, random.normal(size=3).astype(np.float32), quat_from_rotvec(random.normal(size=3)).astype(np.float32))

    def lines(count: int) -> Capsules:
        ends = random.normal(size=(2, count, 3)).astype(np.float32) * 0.2
        return Capsules(*ends, random.uniform(0.01, 0.1, count).astype(np.float32))

    ball = shape("sphere", random)
    obstacles = [ball, lines(3), lines(3), lines(2), somewhere(ball), somewhere(lines(3)), Union((ball, lines(2))), Union((somewhere(ball), ball)), ball]
    which, points = random.integers(0, len(obstacles), 300), random.normal(size=(300, 3)).astype(np.float32) * 0.3
    distances, normals = nearest_of(obstacles, which, points)
    for index, obstacle in enumerate(obstacles):
        of = which == index
        expected, expected_normals = obstacle.nearest(points[of])
        np.testing.assert_allclose(distances[of], expected, atol=1e-6)
        np.testing.assert_allclose(normals[of], expected_normals, atol=1e-5)
