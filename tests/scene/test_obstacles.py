"""What hands may meet in a scene: which objects, and where their surfaces are at each frame."""

from __future__ import annotations

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from cbm_addon.errors import InputError
from cbm_addon.hands.shapes import Box, Sphere
from cbm_addon.motion.rotations import quat_from_rotvec
from cbm_addon.scene.colliders import add_colliders, collider_collection
from cbm_addon.scene.obstacles import SceneObstacles, find_collection
from cbm_addon.scene.rigged_hands import RiggedHands, Surroundings, obstacles_of, played, rigged_hands
from tests.sample_rigs import SAMPLE_RIGS, add_armature, bones_at_rest

REACH = 0.5
FREE = np.array([0, 0, 5.0])


@pytest.fixture
def armature(empty_scene: bpy.types.Scene) -> bpy.types.Object:
    return add_armature(bones_at_rest(next(sample for sample in SAMPLE_RIGS if sample.name == "Mixamo"), "T"))


def points(count: int = 300, reach: float = 0.12, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-reach, reach, (count, 3)).astype(np.float32)


def seen(armature: bpy.types.Object, frames: int = 1, collection=None, unit: float = 1.0, wrist=(0, 0, 0), reach: float = REACH) -> SceneObstacles:
    obstacles = SceneObstacles(armature, collection, unit, reach)
    for depsgraph in played(bpy.context, 1 + np.arange(frames)):
        obstacles.look(depsgraph, np.array([wrist], float), FREE)
    return obstacles


def cube(half: float = 0.05, name: str = "Cube", **transform) -> bpy.types.Object:
    bpy.ops.mesh.primitive_cube_add(size=2 * half)
    obj = bpy.context.object
    obj.name = name
    for key, value in transform.items():
        setattr(obj, key, value)
    return obj


def distances(obstacles: SceneObstacles, frame: int = 0) -> np.ndarray:
    return obstacles.at(frame).nearest(points())[0]


def test_a_turned_and_stretched_object_is_where_blender_shows_it(armature):
    turn = np.array([0.3, -0.5, 0.8])
    obj = cube(0.05)
    obj.matrix_world = Matrix.LocRotScale((0.02, 0.01, -0.03), Matrix.Identity(3), (1.4, 0.6, 0.8))
    obj.rotation_mode = "QUATERNION"
    obj.rotation_quaternion = quat_from_rotvec(turn)
    expected = Box(np.array([0.02, 0.01, -0.03]), 0.05 * np.array([1.4, 0.6, 0.8]), quat_from_rotvec(turn)).nearest(points())[0]
    near = np.abs(expected) < 0.018
    np.testing.assert_allclose(distances(seen(armature))[near], expected[near], atol=4e-4)


def test_sizes_are_those_of_an_average_hand(armature):
    cube(0.1)
    found = distances(seen(armature, unit=2.0))
    expected = Box(np.zeros(3), np.full(3, 0.05)).nearest(points())[0]
    near = np.abs(expected) < 0.018
    np.testing.assert_allclose(found[near], expected[near], atol=4e-4)


def test_an_object_that_moves_is_one_obstacle_that_moves(armature):
    obj = cube(0.05)
    for frame, place in ((1, -0.03), (5, 0.05)):
        obj.location.x, obj.rotation_euler.z = place, place * 10
        obj.keyframe_insert("location", frame=frame)
        obj.keyframe_insert("rotation_euler", frame=frame)
    obstacles = seen(armature, frames=5)
    for frame in range(5):
        bpy.context.scene.frame_set(1 + frame)
        turn = quat_from_rotvec(np.array([0, 0, obj.rotation_euler.z]))
        expected = Box(np.array(obj.location), np.full(3, 0.05), turn).nearest(points())[0]
        near = np.abs(expected) < 0.018
        np.testing.assert_allclose(distances(obstacles, frame)[near], expected[near], atol=4e-4)


def test_frames_in_which_nothing_moves_share_one_obstacle(armature):
    cube(0.05)
    cube(0.02, location=(0.1, 0, 0))
    obstacles = seen(armature, frames=3)
    assert obstacles.at(0) is obstacles.at(1) is obstacles.at(2)


def test_a_mesh_that_bends_is_followed(armature):
    obj = cube(0.05)
    obj.shape_key_add(name="Basis")
    grown = obj.shape_key_add(name="grown")
    for point in grown.data:
        point.co *= 1.4
    for frame, value in ((1, 0.0), (5, 1.0)):
        grown.value = value
        grown.keyframe_insert("value", frame=frame)
    obstacles = seen(armature, frames=5)
    for frame in range(5):
        bpy.context.scene.frame_set(1 + frame)
        expected = Box(np.zeros(3), np.full(3, 0.05 * (1 + 0.4 * grown.value))).nearest(points())[0]
        near = np.abs(expected) < 0.018
        np.testing.assert_allclose(distances(obstacles, frame)[near], expected[near], atol=4e-4)


def test_modifiers_count(armature):
    obj = cube(0.02)
    array = obj.modifiers.new("Array", "ARRAY")
    array.count, array.use_relative_offset, array.use_constant_offset = 2, False, True
    array.constant_offset_displace = 0.08, 0, 0
    found = seen(armature).at(0).nearest(np.array([[0, 0, 0], [0.08, 0, 0], [0.04, 0, 0]], np.float32))[0]
    np.testing.assert_allclose(found, [-0.02, -0.02, 0.02], atol=1e-4)


def test_instances_of_a_collection_count(armature):
    part = cube(0.02, location=(0, 0, 0))
    source = bpy.data.collections.new("Source")
    bpy.context.scene.collection.objects.unlink(part)
    source.objects.link(part)
    for place in (-0.06, 0.06):
        empty = bpy.data.objects.new("Instance", None)
        empty.instance_type, empty.instance_collection, empty.location = "COLLECTION", source, (place, 0, 0)
        bpy.context.scene.collection.objects.link(empty)
    found = seen(armature).at(0).nearest(np.array([[-0.06, 0, 0], [0.06, 0, 0], [0, 0, 0]], np.float32))[0]
    np.testing.assert_allclose(found, [-0.02, -0.02, 0.04], atol=1e-4)


def test_curves_and_text_that_show_a_surface_count(armature):
    curve = bpy.data.curves.new("Wire", "CURVE")
    curve.dimensions, curve.bevel_depth, curve.bevel_resolution = "3D", 0.01, 8
    spline = curve.splines.new("POLY")
    spline.points.add(1)
    spline.points[0].co, spline.points[1].co = (-0.1, 0, 0, 1), (0.1, 0, 0, 1)
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Wire", curve))
    found = seen(armature).at(0).nearest(np.array([[0, 0, 0.02], [0, 0.03, 0]], np.float32))[0]
    np.testing.assert_allclose(found, [0.01, 0.02], atol=3e-4)


def test_the_character_and_what_it_carries_are_left_out_unless_asked_for(armature):
    skin, held, child = cube(0.05, "Skin"), cube(0.04, "Held"), cube(0.03, "Child")
    skin.modifiers.new("Armature", "ARMATURE").object = armature
    constraint = held.constraints.new("CHILD_OF")
    constraint.target, constraint.subtarget = armature, "mixamorig:LeftHand"
    constraint.set_inverse_pending = True
    child.parent, child.parent_type, child.parent_bone = armature, "BONE", "mixamorig:LeftHand"
    child.matrix_parent_inverse = (armature.matrix_world @ armature.pose.bones["mixamorig:LeftHand"].matrix).inverted()
    cage, ball = cube(0.2, "Cage", display_type="WIRE"), cube(0.02, "Ball")
    assert seen(armature).names == [ball.name]
    asked = bpy.data.collections.new("Props")
    bpy.context.scene.collection.children.link(asked)
    for obj in (skin, child, cage):
        asked.objects.link(obj)
    assert seen(armature, collection=find_collection("Props")).names == [cage.name, child.name]


def test_only_what_is_near_a_wrist_is_looked_at(armature):
    cube(0.05, "Near", location=(0.3, 0, 0))
    cube(0.05, "Far", location=(2, 0, 0))
    assert seen(armature, wrist=(0, 0, 0), reach=0.26).names == ["Near"]


def test_a_collection_that_is_not_there_is_named_with_those_that_are(armature):
    bpy.data.collections.new("Props")
    with pytest.raises(InputError, match="Table: is not a collection of this file; its collections are: Props"):
        find_collection("Table")


# The body


@pytest.fixture
def rigged(armature: bpy.types.Object) -> RiggedHands:
    return rigged_hands(armature)


def around(rigged: RiggedHands, side: str, points_: np.ndarray) -> np.ndarray:
    """Distances of world points from what a hand may meet at the scene's frame, in the world's units."""
    surroundings = Surroundings(rigged, obstacles_of(rigged, None))
    surroundings.look(bpy.context.evaluated_depsgraph_get())
    return surroundings.around(side, {})(0).nearest((points_ / rigged.unit).astype(np.float32))[0] * rigged.unit


def bend(armature: bpy.types.Object, side: str) -> np.ndarray:
    """Lowers an arm to the thigh and returns the place of its wrist."""
    bone = armature.pose.bones[f"mixamorig:{side}Arm"]
    rest = bone.bone.matrix_local.to_quaternion()
    turn = Matrix.Rotation(np.radians(85 if side == "Left" else -85), 4, "Y").to_quaternion()
    bone.rotation_quaternion = rest.inverted() @ turn @ rest
    bpy.context.view_layer.update()
    return np.array(armature.matrix_world @ armature.pose.bones[f"mixamorig:{side}Hand"].head)


def test_a_hand_meets_the_thigh_but_not_the_arm_that_carries_it(armature, rigged):
    wrist = bend(armature, "Left")
    thigh = np.array(armature.pose.bones["mixamorig:LeftUpLeg"].head) * 0.5 + np.array(armature.pose.bones["mixamorig:LeftUpLeg"].tail) * 0.5
    assert around(rigged, "Left", thigh[None])[0] < -0.05
    assert around(rigged, "Left", wrist[None])[0] > -0.02


def test_skin_tells_how_thick_the_body_and_the_fingers_are(armature):
    rig = rigged_hands(armature).rig
    bone, end = rig.head("mixamorig:LeftUpLeg"), rig.head("mixamorig:LeftLeg")
    turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    ring = 0.07 * np.stack((np.cos(turn), np.sin(turn), 0 * turn), -1)
    skin = bpy.data.meshes.new("Skin")
    skin.from_pydata((np.linspace(bone, end, 12)[:, None] + ring).reshape(-1, 3).tolist(), [], [])
    obj = bpy.data.objects.new("Skin", skin)
    bpy.context.scene.collection.objects.link(obj)
    obj.modifiers.new("Armature", "ARMATURE").object = armature
    rigged = rigged_hands(armature)
    bend(armature, "Left")
    middle = (bone + end) / 2
    np.testing.assert_allclose(around(rigged, "Left", np.array([middle + [0.09, 0, 0]])), [0.02], atol=4e-3)


def test_colliders_to_edit_are_where_the_body_is_and_edits_count(armature, rigged):
    bend(armature, "Left")
    thigh = armature.pose.bones["mixamorig:LeftUpLeg"]
    probes = np.array(thigh.head + thigh.tail) / 2 + points(60, 0.1)
    before = around(rigged, "Left", probes)
    collection = add_colliders(bpy.context, armature, rigged.rig, list(rigged.fingers.values()))
    assert collider_collection(armature) == collection
    again = rigged_hands(armature)
    near = np.abs(before) < 0.02
    np.testing.assert_allclose(around(again, "Left", probes)[near], before[near], atol=6e-3)
    collection.objects.unlink(next(obj for obj in collection.objects if obj.parent_bone == thigh.name))
    assert around(rigged_hands(armature), "Left", probes).min() > before.min() + 0.02


def test_adding_colliders_again_replaces_them(armature, rigged):
    for _ in range(2):
        add_colliders(bpy.context, armature, rigged.rig, list(rigged.fingers.values()))
    assert len(bpy.data.collections) == 1
    assert len(bpy.data.collections[0].objects) == len(rigged.body)


def test_a_ball_is_met_where_it_is(armature):
    bpy.ops.mesh.primitive_uv_sphere_add(segments=96, ring_count=64, radius=0.06)
    expected = Sphere(np.zeros(3), 0.06).nearest(points())[0]
    near = np.abs(expected) < 0.018
    np.testing.assert_allclose(distances(seen(armature))[near], expected[near], atol=4e-4)
