"""What a cache of distances remembers is what the obstacle said."""

from __future__ import annotations

import numpy as np
import pytest

from cbm_addon.hands.distance_cache import NEAR, REACH, CachedDistances
from cbm_addon.hands.shapes import Box, Capsules, Sphere, Union

HALF = np.array([0.05, 0.04, 0.02], np.float32)
SHAPES = {
    "sphere": Sphere(np.zeros(3), 0.05),
    "box": Box(np.zeros(3), HALF),
    "thin plate": Box(np.zeros(3), np.array([0.05, 0.05, 0.002], np.float32)),
    "ridge between two spheres": Union((Sphere(np.array([-0.02, 0, 0]), 0.03), Sphere(np.array([0.02, 0, 0]), 0.03))),
    "handle": Capsules(np.array([[-0.04, 0, 0]], np.float32), np.array([[0.04, 0, 0]], np.float32), np.array([0.006], np.float32)),
}
BOUND = np.full(3, 0.05, np.float32)


class Counting:
    """An obstacle that counts how many points it was asked about."""

    def __init__(self, obstacle):
        self.obstacle, self.asked = obstacle, 0

    def nearest(self, points):
        self.asked += len(points)
        return self.obstacle.nearest(points)


def points(count: int = 3000, reach: float = 0.09) -> np.ndarray:
    return np.random.default_rng(0).uniform(-reach, reach, (count, 3)).astype(np.float32)


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
def test_near_the_surface_distances_are_right_to_a_fraction_of_a_millimetre(shape):
    true, true_normals = shape.nearest(points())
    near = np.abs(true) < NEAR - 0.001
    distances, normals = CachedDistances(shape, -BOUND, BOUND).nearest(points())
    errors = np.abs(distances - true)[near]
    assert errors.mean() < 5e-5
    assert errors.max() < 5.5e-4  # at the bottom of creases, and half-way inside of something thin
    outside = near & (true > 0)  # inside, where several places are as near, the normal may be that of any
    assert np.percentile(np.sum(normals * true_normals, axis=-1)[outside], 2) > 0.98


@pytest.mark.parametrize("shape", SHAPES.values(), ids=SHAPES)
def test_far_from_the_surface_no_point_seems_near(shape):
    true, _ = shape.nearest(points())
    distances, _ = CachedDistances(shape, -BOUND, BOUND).nearest(points())
    far = np.abs(true) > NEAR + 0.001
    assert (np.sign(distances) == np.sign(true))[far].all()
    assert np.abs(distances)[far].min() > NEAR - 0.002


def test_beyond_its_reach_the_distance_is_that_to_the_box_and_nothing_is_asked():
    counting = Counting(SHAPES["box"])
    distances, normals = CachedDistances(counting, -HALF, HALF).nearest(np.array([[0.05 + REACH + 0.1, 0, 0]], np.float32))
    assert distances[0] == pytest.approx(REACH + 0.1)
    np.testing.assert_allclose(normals[0], [1, 0, 0])
    assert counting.asked == 0


def test_asking_again_asks_the_obstacle_only_at_creases():
    counting = Counting(SHAPES["sphere"])
    cache = CachedDistances(counting, -BOUND, BOUND)
    first, _ = cache.nearest(points())
    counting.asked = 0
    again, _ = cache.nearest(points())
    np.testing.assert_array_equal(again, first)
    assert counting.asked < 0.02 * len(points())


def test_the_order_in_which_places_are_asked_does_not_matter():
    shape, all_points = SHAPES["box"], points()
    one = CachedDistances(shape, -HALF, HALF)
    for start in range(0, len(all_points), 100):
        one.nearest(all_points[::-1][start : start + 100])
    np.testing.assert_array_equal(one.nearest(all_points)[0], CachedDistances(shape, -HALF, HALF).nearest(all_points)[0])
