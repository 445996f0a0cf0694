"""Clips whose joint frames a conversion has turned are as they were before it; sound clips stay."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cbm_addon.motion.motion import Motion, local_rotations
from cbm_addon.motion.repair import repaired
from cbm_addon.motion.rotations import Array, difference, inverse, multiply, quat_from_rotvec, rotate

X, Z = np.eye(3, dtype=np.float32)[[0, 2]]


def turned(motion: Motion, joints: tuple[str, ...], turn: Array, frames: slice = slice(None), rest: bool = True) -> Motion:
    """The motion with frames of joints turned by `turn` [4], where `rest` in the rest pose too, so that all joints stay where they are."""
    world, skeleton = motion.forward()[0], motion.skeleton
    offsets = skeleton.offsets.copy()
    for joint in skeleton.indices(joints):
        world[frames, joint] = multiply(world[frames, joint], turn)
        if rest:
            for child in np.flatnonzero(skeleton.parents == joint):
                offsets[child] = rotate(inverse(turn), offsets[child])
    skeleton = replace(skeleton, offsets=offsets)
    return replace(motion, skeleton=skeleton, rotations=local_rotations(skeleton, world))


def assert_like(found: Motion, sound: Motion, degrees: float = 0.1) -> None:
    world, positions = found.forward()
    true_world, true_positions = sound.forward()
    np.testing.assert_allclose(positions, true_positions, atol=1e-4)
    assert np.degrees(difference(world, true_world)).max() < degrees


def test_sound_clips_stay_as_they_are(body_motion: Motion) -> None:
    assert repaired(body_motion) is body_motion


def test_legs_on_backwards_are_turned(body_motion: Motion) -> None:
    broken = turned(body_motion, ("LeftUpLeg", "LeftLeg"), quat_from_rotvec(np.pi * Z))
    assert_like(repaired(broken), body_motion)


@pytest.mark.parametrize("side", ["Left", "Right"])
def test_a_foot_that_rests_on_tiptoe_stands(body_motion: Motion, side: str) -> None:
    broken = turned(body_motion, (f"{side}Foot", f"{side}Toe"), quat_from_rotvec(np.radians(-120) * X))
    assert_like(repaired(broken), body_motion, degrees=15)  # the toe rests where the standard body's does, not where this one's did
    assert abs(repaired(broken).skeleton.height_above_toes() - body_motion.skeleton.height_above_toes()) < 0.03


def test_an_arm_that_rests_upward_is_brought_to_the_side(body_motion: Motion) -> None:
    broken = turned(body_motion, ("RightShoulder",), quat_from_rotvec(np.radians(90) * np.array([0, 1, 0], np.float32)))
    assert_like(repaired(broken), body_motion, degrees=5)


def test_a_foot_on_its_back_is_rolled_where_that_lasts(body_motion: Motion) -> None:
    toe = body_motion.skeleton.offsets[body_motion.skeleton.index("LeftToe")]
    roll = quat_from_rotvec(np.pi * toe / np.linalg.norm(toe))
    second = round(body_motion.rate)
    long, short = (turned(body_motion, ("LeftFoot", "LeftToe"), roll, slice(10, 10 + count), rest=False) for count in (2 * second, second // 2))
    assert_like(repaired(long), body_motion)
    assert repaired(short) is short


def test_nothing_is_moved(body_motion: Motion) -> None:
    broken = turned(body_motion, ("LeftUpLeg", "LeftLeg", "RightUpLeg", "RightLeg"), quat_from_rotvec(np.pi * Z))
    broken = turned(broken, ("LeftFoot", "LeftToe"), quat_from_rotvec(np.radians(-120) * X))
    np.testing.assert_allclose(repaired(broken).positions(), broken.positions(), atol=2e-4)
