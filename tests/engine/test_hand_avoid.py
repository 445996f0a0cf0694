"""Fingers that touch without piercing: what must hold of every answer, whatever the hand, the solid and the time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cbm_addon.errors import InputError
from cbm_addon.hands.avoid import FingerOptions, FingerResult, avoiding
from cbm_addon.hands.contact import Probe, every_row, finger_depths
from cbm_addon.hands.hand import LIMITS, Hand, finger_angles
from cbm_addon.hands.model import HandModel, load_hand_model
from cbm_addon.hands.obstacle import Obstacle, empty, over_time
from cbm_addon.hands.path import cheapest_path
from cbm_addon.hands.poses import POSES, controller_pose
from cbm_addon.hands.project import _chain_solve, _eliminate, pushed_out
from cbm_addon.hands.sensor import Grid, reachable_grid, sense
from cbm_addon.hands.shapes import Box, Sphere
from cbm_addon.hands.standard import standard_hand
from cbm_addon.hands.sweep import swept, wrapped
from cbm_addon.motion.rotations import IDENTITY
from cbm_addon.progress import Progress, blocks, run

FRAMES, RATE = 60, 24.0
DEFAULT = FingerOptions()
seeds = st.integers(0, 10_000)


def still(frames: int = FRAMES) -> tuple[np.ndarray, np.ndarray]:
    """Wrists at the origin: the right hand's palm is down, its fingers point along +Y."""
    return np.zeros((frames, 3), np.float32), np.tile(IDENTITY, (frames, 1))


def rising_ball(frame: int) -> Obstacle:
    """Comes up under the fingers and goes again; it never reaches the palm."""
    height = -0.16 + 0.085 * np.sin(np.pi * frame / (FRAMES - 1))
    return Sphere(np.array([0.0, 0.13, height], np.float32), 0.05)


def freed(obstacles: Callable[[int], Obstacle], wanted: str, options: FingerOptions = DEFAULT, model: HandModel | None = None) -> FingerResult:
    angles = np.tile(POSES[wanted], (FRAMES, 1))
    return run(avoiding(standard_hand(), still(), angles, obstacles, RATE, model, options))


@pytest.fixture(scope="module")
def ball() -> FingerResult:
    return freed(rising_ball, "fist")


def test_what_pierced_is_free(ball: FingerResult) -> None:
    assert ball.before.max() > 0.01
    assert not ball.palm_inside.any()
    assert ball.after.max() < 0.0005


def test_the_depths_of_a_result_are_those_of_its_angles(ball: FingerResult) -> None:
    depths = finger_depths(standard_hand(), still(), over_time(rising_ball), ball.angles).max(-1)
    np.testing.assert_allclose(ball.after, depths, atol=1e-6)


def test_limits_hold(ball: FingerResult) -> None:
    assert (ball.angles >= LIMITS[:, 0] - 1e-5).all()
    assert (ball.angles <= LIMITS[:, 1] + 1e-5).all()


def test_fingertips_do_not_jump() -> None:
    result = freed(rising_ball, "relaxed")
    assert result.before.max() > 0.01
    tips = standard_hand().positions(result.angles)[:, 15:]
    assert np.linalg.norm(np.diff(tips, axis=0), axis=-1).max() < 0.025


def test_without_obstacle_nothing_changes() -> None:
    result = freed(lambda frame: empty(), "cup")
    np.testing.assert_array_equal(result.angles, np.tile(POSES["cup"], (FRAMES, 1)))
    assert (result.after < 0).all()


def test_far_from_the_contact_in_time_the_wanted_pose_stays() -> None:
    passing = lambda frame: rising_ball(29) if frame >= 50 else empty()  # noqa: E731
    result = freed(passing, "fist")
    np.testing.assert_allclose(result.angles[:25], np.tile(POSES["fist"], (25, 1)), atol=np.radians(1))


def test_strength_goes_from_the_wanted_to_the_free_pose(ball: FingerResult) -> None:
    none, half = (freed(rising_ball, "fist", FingerOptions(strength=strength)) for strength in (0.0, 0.5))
    np.testing.assert_allclose(none.angles, np.tile(POSES["fist"], (FRAMES, 1)), atol=1e-6)
    np.testing.assert_allclose(half.angles, (none.angles + ball.angles) / 2, atol=1e-5)


def test_the_same_seed_gives_the_same_fingers(ball: FingerResult) -> None:
    np.testing.assert_array_equal(freed(rising_ball, "fist").angles, ball.angles)


def test_a_grasp_rests_on_the_surface() -> None:
    """A ball in the palm: each finger that reaches it ends within a millimetre of its surface."""
    ball = Sphere(np.array([0.0, 0.105, -0.062], np.float32), 0.035)
    result = freed(lambda frame: ball, "spread", FingerOptions(grasp=True))
    depths = finger_depths(standard_hand(), still(), over_time(lambda frame: ball), result.angles)[FRAMES // 2]
    assert result.after.max() < 0.0005
    assert (np.abs(depths[1:4]) < 0.001).all(), "index, middle and ring touch"
    tips = standard_hand().positions(np.stack((result.angles[30], POSES["spread"])))[:, 16:19]
    assert np.linalg.norm(tips[0] - tips[1], axis=-1).min() > 0.02, "they closed to get there"


def test_a_palm_that_is_inside_is_said_and_counted_apart() -> None:
    table = Box(np.array([0, 0, -0.1], np.float32), np.array([1, 1, 0.1], np.float32))  # up to the height of the wrist
    assert freed(lambda frame: table, "flat").palm_inside.all()


def test_the_obstacle_is_asked_once_for_each_frame() -> None:
    asked: list[int] = []

    def counted(frame: int) -> Obstacle:
        asked.append(frame)
        return rising_ball(frame)

    freed(counted, "fist")
    assert sorted(asked) == list(range(FRAMES))


def test_the_job_says_how_far_it_is() -> None:
    job = avoiding(standard_hand(), still(), np.tile(POSES["fist"], (FRAMES, 1)), rising_ball, RATE, None, FingerOptions())
    events: list[Progress] = []
    run(job, events.append)
    shares = [event.share for event in events]
    assert shares == sorted(shares)
    assert len(shares) >= 4
    assert len(shares) > 40, "it can be stopped at any time"


@pytest.mark.parametrize("frames", [1, 2, 3])
def test_even_a_single_frame_is_freed(frames: int) -> None:
    wanted = np.tile(POSES["fist"], (frames, 1))
    result = run(avoiding(standard_hand(), still(frames), wanted, lambda frame: rising_ball(29), RATE, None, DEFAULT))
    assert result.before.min() > 0.01
    assert result.after.max() < 0.0005


def test_what_is_looked_at_at_once_grows_until_it_is_enough() -> None:
    found = list(blocks(20, 4))
    assert [block.stop - block.start for block in found] == [1, 2, 4, 4, 4, 4, 1]
    assert np.array_equal(np.concatenate([np.arange(20)[block] for block in found]), np.arange(20))
    assert not list(blocks(0, 4))


def test_wrong_shapes_are_named() -> None:
    with pytest.raises(InputError, match=r"wanted angles.*\(60, 20\)"):
        run(avoiding(standard_hand(), still(), np.zeros((59, 20), np.float32), rising_ball, RATE, None, FingerOptions()))


@given(seeds)
@settings(max_examples=20, deadline=None)
def test_slopes_are_the_derivatives_of_depths(seed: int) -> None:
    random = np.random.default_rng(seed)
    hand, (frames, fingers) = standard_hand("left"), every_row(4)
    ball = Sphere(random.normal(scale=0.1, size=3).astype(np.float32), 0.05)
    probe = Probe(hand, still(4), over_time(lambda frame: ball))
    angles = random.uniform(*finger_angles(LIMITS.T)[:, fingers]).astype(np.float32)
    depths, slopes = probe.contacts(frames, fingers, angles)
    np.testing.assert_allclose(depths, probe.depths(frames, fingers, angles), atol=1e-6)
    for number, step in enumerate(np.eye(4, dtype=np.float32) * 1e-3):
        rise = (probe.depths(frames, fingers, angles + step).astype(float) - probe.depths(frames, fingers, angles - step)) / 2e-3
        np.testing.assert_allclose(-rise, slopes[..., number], atol=5e-4)


@given(seeds)
@settings(max_examples=20, deadline=None)
def test_pushing_out_stays_within_the_limits_and_leaves_what_is_free(seed: int) -> None:
    random = np.random.default_rng(seed)
    hand, (frames, fingers) = standard_hand(), every_row(4)
    ball = Sphere(np.array([0, 0.12, -0.06], np.float32) + random.normal(scale=0.02, size=3).astype(np.float32), 0.03)
    probe = Probe(hand, still(4), over_time(lambda frame: ball))
    start = random.uniform(*finger_angles(LIMITS.T)[:, fingers]).astype(np.float32)
    moved, _ = pushed_out(probe, frames, fingers, start, 8)
    limits = finger_angles(LIMITS.T)[:, fingers]
    assert ((moved >= limits[0] - 1e-5) & (moved <= limits[1] + 1e-5)).all()
    free = probe.depths(frames, fingers, start).max(-1) < -0.001
    np.testing.assert_array_equal(moved[free], start[free])


def test_the_chain_is_solved_as_by_a_dense_solver() -> None:
    random = np.random.default_rng(0)
    count = 9
    blocks = random.normal(size=(count, 5, 4, 4))
    blocks = blocks @ blocks.swapaxes(-1, -2) + 8 * np.eye(4)
    right, links = random.normal(size=(count, 5, 4)), random.uniform(0.5, 1.5, size=(count - 1, 5))
    solved = _chain_solve(blocks, right, links)
    np.testing.assert_allclose(solved, _eliminate(blocks, right, links), atol=1e-9)
    for finger in range(5):
        dense = np.zeros((4 * count, 4 * count))
        for t in range(count):
            dense[4 * t : 4 * t + 4, 4 * t : 4 * t + 4] = blocks[t, finger]
        for t in range(count - 1):
            for i in range(4):
                dense[4 * t + i, 4 * t + 4 + i] = dense[4 * t + 4 + i, 4 * t + i] = -links[t, finger]
        np.testing.assert_allclose(solved[:, finger].reshape(-1), np.linalg.solve(dense, right[:, finger].reshape(-1)), atol=1e-9)


@given(seeds)
@settings(max_examples=20, deadline=None)
def test_no_path_is_cheaper_than_the_cheapest(seed: int) -> None:
    random = np.random.default_rng(seed)
    costs, transitions = random.random((5, 2, 3)), random.random((4, 2, 3, 3))

    def price(path: np.ndarray, chain: int) -> float:
        here = sum(costs[t, chain, c] for t, c in enumerate(path))
        return here + sum(transitions[t, chain, path[t], path[t + 1]] for t in range(4))

    chosen = cheapest_path(costs, transitions)
    every = np.stack(np.meshgrid(*[np.arange(3)] * 5), -1).reshape(-1, 5)
    for chain in range(2):
        assert price(chosen[:, chain], chain) == pytest.approx(min(price(path, chain) for path in every))


def test_a_sweep_stops_at_the_first_contact() -> None:
    hand, (frames, fingers) = standard_hand(), every_row(1)
    ball = Sphere(np.array([0, 0.13, -0.06], np.float32), 0.03)
    probe = Probe(hand, still(1), over_time(lambda frame: ball))
    start, end = (finger_angles(np.clip(POSES[name], *LIMITS.T))[fingers] for name in ("flat", "fist"))
    reached, met = swept(probe, frames, fingers, start, end)
    depths = probe.depths(frames, fingers, reached.astype(np.float32)).max(-1)
    assert met.any()
    assert (depths <= 0).all()
    assert (depths[met] > -0.002).all()
    np.testing.assert_allclose(reached[~met], end[~met], atol=1e-6)
    closed, met = wrapped(probe, frames, fingers, start, end)
    np.testing.assert_array_equal(closed[~met], start[~met])


def test_trigger_and_grip_close_their_fingers() -> None:
    angles = finger_angles(controller_pose(np.array([0, 1, 0, 1.0]), np.array([0, 0, 1, 1.0])))
    np.testing.assert_allclose(angles[0], finger_angles(POSES["relaxed"]), atol=1e-6)
    np.testing.assert_allclose(angles[3], finger_angles(POSES["fist"]), atol=1e-6)
    np.testing.assert_allclose(angles[1, 1], angles[3, 1], atol=1e-6)  # the index follows the trigger
    np.testing.assert_allclose(angles[1, 2:], angles[0, 2:], atol=1e-6)
    np.testing.assert_allclose(angles[2, 2:], angles[3, 2:], atol=1e-6)


def test_poses_are_within_the_limits() -> None:
    for name, pose in POSES.items():
        assert ((pose >= LIMITS[:, 0] - 1e-6) & (pose <= LIMITS[:, 1] + 1e-6)).all(), name


@pytest.fixture(scope="module")
def grid() -> Grid:
    return reachable_grid()


def test_the_grid_survives_its_card(grid: Grid) -> None:
    again = Grid.from_dict(grid.as_dict())
    np.testing.assert_array_equal(again.centres(), grid.centres())
    assert grid.cell * 0.19 <= 0.0101


def test_either_hand_of_any_size_senses_the_same(grid: Grid) -> None:
    """A ball before the palm, mirrored and scaled with the hand, fills the same cells."""
    seen = []
    for side, scale in (("right", 1.0), ("left", 1.0), ("right", 2.0)):
        hand = standard_hand(side, scale)  # type: ignore[arg-type]
        centre = hand.palm @ np.array([0.6, 0.05, 0.25], np.float32) * hand.length
        ball = Sphere(centre, 0.2 * hand.length)
        seen.append(sense(grid, hand, still(1), over_time(lambda frame, ball=ball: ball), np.array([0])))
    assert 0 < seen[0].mean() < 1
    np.testing.assert_allclose(seen[1], seen[0], atol=0.02)
    np.testing.assert_allclose(seen[2], seen[0], atol=0.02)


def test_cells_are_full_inside_and_empty_a_cell_away(grid: Grid) -> None:
    distances = np.array([-3, 0, 0.5, 1, 2]) * grid.cell
    np.testing.assert_allclose(grid.occupancy(distances), [1, 1, 0.5, 0, 0], atol=1e-6)


def test_a_hand_with_a_backward_bent_rest_pose_may_keep_it() -> None:
    rest = standard_hand()
    bent = rest.rest_angles.copy()
    bent[5] = np.radians(-12)
    hand = Hand.from_rest("right", rest.positions(bent[None])[0])
    assert hand.limits[5, 0] < LIMITS[5, 0]
    assert replace(hand).limits[4, 0] == LIMITS[4, 0]


def test_the_shipped_model_frees_fingers_too() -> None:
    model = load_hand_model(threads=1)
    result = freed(rising_ball, "fist", model=model)
    assert result.after.max() < 0.0005
    assert np.median(result.after) < 0
    alone = freed(rising_ball, "fist", FingerOptions(exact=False), model)
    assert ((alone.angles >= LIMITS[:, 0] - 1e-5) & (alone.angles <= LIMITS[:, 1] + 1e-5)).all()
    assert sum(entry["bytes"] for entry in model.card["files"].values()) < 4e6


def test_candidates_are_seeded() -> None:
    model = load_hand_model(threads=1)
    random = np.random.default_rng(0)
    seen, places = random.random((3, model.grid.count), np.float32), random.random((3, 60), np.float32)
    first, again, other = (model.propose(seen, places, 4, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    np.testing.assert_array_equal(first[0], other[0])  # the likeliest code does not depend on the seed
    assert np.abs(first[1:] - other[1:]).max() > 0
