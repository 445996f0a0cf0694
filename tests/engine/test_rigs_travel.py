"""The way over the ground can be carried by a root bone, by the object, or left out: what is carried by it does the rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cbm_addon.errors import InputError
from cbm_addon.motion.motion import Motion
from cbm_addon.motion.rotations import matrix_from_quat, quat_from_rotvec, quat_from_yaw
from cbm_addon.rigs.body import rig_body
from cbm_addon.rigs.pose import bone_poses
from cbm_addon.rigs.recognize import recognized
from cbm_addon.rigs.rig import Rig
from cbm_addon.rigs.travel import object_matrices, root_pose, way_over_ground, without_way
from tests.sample_rigs import SAMPLE_RIGS, bones_at_rest, evaluate, transform

FRAMES = 12
TURNED = transform(quat_from_rotvec(np.array([0, 0, 0.8])), np.array([2.0, -1, 0]), 0.5)


def a_rig(name: str = "Unreal 4") -> Rig:
    return recognized(bones_at_rest(next(sample for sample in SAMPLE_RIGS if sample.name == name), "A", TURNED))


def a_walk(solved) -> Motion:
    """A body that goes around a circle, swaying."""
    times = np.arange(FRAMES) / 10
    sway = 0.2 * np.sin(times[:, None, None] * np.linspace(2, 7, 3 * len(solved.body)).reshape(-1, 3))
    sway[:, 0, 2] += 2 * times
    root = np.stack((3 * np.cos(2 * times), 3 * np.sin(2 * times), 0.4 + 0.05 * np.sin(9 * times)), axis=-1)
    return Motion(solved.body, times, root.astype(np.float32), quat_from_rotvec(sway).astype(np.float32))


def heads(rig: Rig, solved, matrices: np.ndarray) -> np.ndarray:
    return matrices[:, [rig.index(rig.mapping.joints[name]) for name in solved.body.names]][..., :3, 3]


def test_a_root_bone_that_carries_the_way_leaves_every_bone_where_it_was_solved():
    rig = a_rig()
    solved = rig_body(rig)
    motion = a_walk(solved)
    way = way_over_ground(rig, solved, motion, "bone")
    matrices = evaluate(rig, FRAMES, [root_pose(rig, way), *bone_poses(rig, solved, without_way(motion, way))])
    np.testing.assert_allclose(heads(rig, solved, matrices), motion.positions(), atol=5e-6)
    root, hips = (matrices[:, rig.index(bone), :3, 3] for bone in ("root", "pelvis"))
    np.testing.assert_allclose(root[:, 2], rig.head("root")[2], atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm((root - hips)[:, :2], axis=-1), np.linalg.norm((rig.head("root") - rig.head("pelvis"))[:2]), atol=1e-5)


def test_an_object_that_carries_the_way_leaves_every_bone_where_it_was_solved():
    rig = a_rig("Mixamo")
    solved = rig_body(rig)
    motion = a_walk(solved)
    way = way_over_ground(rig, solved, motion, "object")
    local = evaluate(replace(rig, object_matrix=np.eye(4)), FRAMES, bone_poses(rig, solved, without_way(motion, way)))
    objects = object_matrices(rig, way)
    np.testing.assert_allclose(heads(rig, solved, objects[:, None] @ local), motion.positions(), atol=5e-6)
    np.testing.assert_allclose(np.linalg.norm(objects[:, :3, :3], axis=-2), rig.scale, atol=1e-9)
    np.testing.assert_allclose(objects[:, 2, 3], TURNED[2, 3], atol=1e-9)


def test_in_place_the_hips_stay_over_the_spot_where_the_rig_stands_and_the_rest_is_as_before():
    rig = a_rig()
    solved = rig_body(rig)
    motion = a_walk(solved)
    way = way_over_ground(rig, solved, motion, "in-place")
    placed = heads(rig, solved, evaluate(rig, FRAMES, bone_poses(rig, solved, without_way(motion, way))))
    hips = rig.head(rig.mapping.joints["Hips"])
    np.testing.assert_allclose(placed[:, 0, :2], np.tile(hips[:2], (FRAMES, 1)), atol=1e-5)
    expected = motion.positions() - motion.positions()[:, :1] * [1, 1, 0]
    np.testing.assert_allclose(placed - placed[:, :1] * [1, 1, 0], expected, atol=1e-5)


def test_what_stands_at_rest_has_no_way():
    rig = a_rig()
    solved = rig_body(rig)
    hips = rig.head(rig.mapping.joints["Hips"])
    facing = quat_from_yaw(np.full(FRAMES, 0.8))
    still = Motion(solved.body, np.arange(FRAMES) / 10, np.tile(hips, (FRAMES, 1)), np.tile([1.0, 0, 0, 0], (FRAMES, len(solved.body), 1)))
    still.rotations[:, 0] = facing
    way = way_over_ground(rig, solved, still, "object")
    np.testing.assert_allclose(way.translations, 0, atol=1e-6)
    np.testing.assert_allclose(matrix_from_quat(way.rotations), np.tile(np.eye(3), (FRAMES, 1, 1)), atol=1e-6)


def test_a_rig_without_a_bone_above_its_hips_cannot_carry_the_way_on_one():
    rig = a_rig("Mixamo")
    solved = rig_body(rig)
    with pytest.raises(InputError, match="no bone above its hips"):
        root_pose(rig, way_over_ground(rig, solved, a_walk(solved), "bone"))


def test_a_bone_that_does_not_inherit_rotation_is_not_carried_by_a_root_bone():
    rig = a_rig()
    loose = recognized(replace(rig, inherits_rotation=np.array([name != "head" for name in rig.bones])))
    solved = rig_body(loose)
    with pytest.raises(InputError, match="head does not inherit rotation"):
        root_pose(loose, way_over_ground(loose, solved, a_walk(solved), "bone"))
