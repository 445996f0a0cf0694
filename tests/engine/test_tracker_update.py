"""The measurement update: on a body whose bones are known, what head and wrists miss moves a lower body that was predicted in the wrong place."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cbm_addon.features import LOWER_JOINTS
from cbm_addon.motion.motion import Motion
from cbm_addon.motion.rotations import Array, multiply, quat_from_rotvec, quat_from_yaw, rotate
from cbm_addon.solve.fuse import fuse, world_rotations
from cbm_addon.solve.manner import out_of_body
from cbm_addon.solve.miscalibration import NONE, Miscalibration
from cbm_addon.solve.performance import Performance
from cbm_addon.solve.tracker_update import FAR_WRIST, HIPS, WRISTS, updated
from cbm_addon.takes.synthesize import synthesize
from cbm_addon.takes.take import DEVICES
from tests.performances import true_performance


def targets_of(motion: Motion) -> dict[str, tuple[Array, Array]]:
    take = synthesize(motion)
    return {name: (take.positions[:, i], take.rotations[:, i]) for i, name in enumerate(DEVICES)}


def updated_on(motion: Motion, performance: Performance, targets: dict[str, tuple[Array, Array]] | None = None) -> Performance:
    unit = np.float32(motion.skeleton.height_above_toes())
    return updated(performance, motion.skeleton, world_rotations(motion.skeleton, performance), unit, targets or targets_of(motion))


def moved_by(performance: Performance, offset: tuple[float, float, float]) -> Performance:
    return replace(performance, lower_positions=performance.lower_positions + np.array(offset, np.float32))


@pytest.fixture
def truth(body_motion: Motion) -> Performance:
    return true_performance(body_motion)


@pytest.mark.parametrize("offset", [(0.04, 0, 0), (0, -0.04, 0), (0.02, 0.03, 0), (0, 0, 0.03), (0, 0, -0.03)], ids=str)
def test_a_body_in_the_wrong_place_is_moved_toward_the_right_one(body_motion: Motion, truth: Performance, offset: tuple[float, float, float]) -> None:
    """Over the floor, or in height, as far as it was wrong there. A height alone may also be a spine that leans otherwise."""
    wrong, axes = moved_by(truth, offset), np.array(offset) != 0

    def error(performance: Performance) -> float:
        return float(np.linalg.norm((performance.lower_positions - truth.lower_positions)[:, HIPS, axes], axis=-1).mean())

    assert error(updated_on(body_motion, wrong)) < 0.7 * error(wrong)


def test_what_misses_nothing_hardly_moves(body_motion: Motion, truth: Performance) -> None:
    # the necks of a prediction are half-way between chest and head, which the truth's are not
    assert np.abs(updated_on(body_motion, truth).lower_positions - truth.lower_positions).max() < 0.02


def test_feet_and_hips_move_over_the_floor_alike_and_only_the_hips_up(body_motion: Motion, truth: Performance) -> None:
    moved = updated_on(body_motion, moved_by(truth, (0.02, 0.01, -0.02))).lower_positions - moved_by(truth, (0.02, 0.01, -0.02)).lower_positions
    np.testing.assert_allclose(moved[..., :2], np.broadcast_to(moved[:, :1, :2], moved[..., :2].shape), atol=1e-6)
    others = [i for i in range(len(LOWER_JOINTS)) if i != HIPS]
    assert not moved[:, others, 2].any()
    assert (moved[:, HIPS, 2] > 0).all()


def test_it_turns_with_the_take(body_motion: Motion, truth: Performance) -> None:
    """The same take after a turn about the vertical gives the same body after that turn."""
    turn = quat_from_yaw(np.float32(1.1))
    turned_motion = replace(body_motion, root=rotate(turn, body_motion.root), rotations=_root_turned(body_motion, turn))
    wrong = moved_by(truth, (0.03, -0.02, 0.01))
    there = moved_by(true_performance(turned_motion), tuple(rotate(turn, np.array((0.03, -0.02, 0.01), np.float32))))
    np.testing.assert_allclose(updated_on(turned_motion, there).lower_positions, rotate(turn, updated_on(body_motion, wrong).lower_positions), atol=1e-4)


def test_no_frame_knows_of_another(body_motion: Motion, truth: Performance) -> None:
    half = len(body_motion) // 2
    positions = truth.lower_positions.copy()
    positions[half:] += 0.05
    before, after = (updated_on(body_motion, replace(truth, lower_positions=p)).lower_positions[:half] for p in (truth.lower_positions, positions))
    np.testing.assert_array_equal(before, after)


@pytest.mark.parametrize("metres", [0.5, 5.0])
def test_a_tracker_that_is_far_off_does_not_take_the_body_along(body_motion: Motion, truth: Performance, metres: float) -> None:
    targets = targets_of(body_motion)
    position, rotation = targets["left"]
    targets["left"] = (position + np.array((metres, 0, 0), np.float32), rotation)
    moved = updated_on(body_motion, truth, targets).lower_positions - updated_on(body_motion, truth).lower_positions
    assert np.linalg.norm(moved, axis=-1).max() < WRISTS * FAR_WRIST / 2


def test_hips_on_the_floor_are_not_moved_into_it(body_motion: Motion, truth: Performance) -> None:
    sitting = truth.lower_positions.copy()
    sitting[:, HIPS, 2] = 0.05
    down = {device: (position - np.array((0, 0, 1.2), np.float32), rotation) for device, (position, rotation) in targets_of(body_motion).items()}
    moved = updated_on(body_motion, replace(truth, lower_positions=sitting), down).lower_positions
    np.testing.assert_allclose(moved[:, HIPS, 2], 0.05, atol=1e-6)


def test_who_lies_is_left_where_they_lie(body_motion: Motion, truth: Performance) -> None:
    """A spine along the floor says nothing of how high the hips are."""
    flat = quat_from_rotvec(np.array((np.pi / 2, 0, 0), np.float32))
    lying = replace(truth, lower_rotations=multiply(flat, truth.lower_rotations), upper_rotations=multiply(flat, truth.upper_rotations))
    moved = updated_on(body_motion, lying).lower_positions - lying.lower_positions
    assert np.abs(np.median(moved, axis=0)).max() < 0.01


def test_bones_of_a_height_that_was_believed_wrongly_are_those_of_the_performer(body_motion: Motion, truth: Performance) -> None:
    """Who is taken for a tenth taller is solved on bones that are too long, and yet is where the trackers are."""
    tall = replace(body_motion, skeleton=body_motion.skeleton.scaled(1.1))
    said = replace(truth.measured_in(tall.skeleton.height_above_toes()), miscalibration=Miscalibration(NONE.slip, 1 / 1.1))
    expected = updated_on(body_motion, truth).measured_in(said.head_height).lower_positions
    np.testing.assert_allclose(updated_on(tall, said, targets_of(body_motion)).lower_positions, expected, atol=1e-4)


def test_a_variation_keeps_its_manner(body_motion: Motion, truth: Performance) -> None:
    """Manners are errors on purpose: the update must not take them back."""
    offsets = np.zeros((len(LOWER_JOINTS), 3), np.float32)
    offsets[:, 1] = -0.03
    take, body = synthesize(body_motion), body_motion.skeleton
    plain, varied = (fuse(p, take, body_motion.times, body).positions()[:, body.index("LeftFoot")] for p in (truth, replace(truth, manner=offsets)))
    wanted = out_of_body(truth.lower_positions, offsets)[:, LOWER_JOINTS.index("LeftFoot")] * truth.head_height
    shift = (varied - plain)[..., :2].mean(axis=0)
    np.testing.assert_allclose(shift, wanted[..., :2].mean(axis=0), atol=0.012)


def _root_turned(motion: Motion, turn: Array) -> Array:
    rotations = motion.rotations.copy()
    rotations[:, 0] = multiply(turn, rotations[:, 0])
    return rotations
