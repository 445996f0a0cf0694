"""Takes from what moves in Blender: empties and bones as recorders leave them, and files that Blender itself reads."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import bpy
import mathutils
import numpy as np
import pytest

from cbm_addon.commands.calibration import read_any_take
from cbm_addon.errors import InputError
from cbm_addon.motion.rotations import continuous, difference, matrix_from_quat, quat_from_matrix
from cbm_addon.scene.take_objects import objects_take
from cbm_addon.solve.perform import sampled
from cbm_addon.takes.frames import AXES, device_axes
from cbm_addon.takes.recording import TakeOverrides
from cbm_addon.takes.sample_motion import sample_take
from cbm_addon.takes.take import DEVICES, Take

FPS = 30
SECONDS = 6.0
TRUTH = sampled(sample_take(), np.arange(round(SECONDS * FPS)) / FPS)
SCENE = Path("scene")
MEASURE = TakeOverrides()


def poses(axes: str = "blender") -> Iterator[tuple[int, int, mathutils.Matrix]]:
    """Row, device and world matrix of the truth, the devices' own frames being those of `axes`."""
    turns = matrix_from_quat(TRUTH.rotations.astype(np.float64)) @ device_axes(axes)
    for row in range(len(TRUTH)):
        for device in range(len(DEVICES)):
            yield row, device, mathutils.Matrix.LocRotScale(mathutils.Vector(TRUTH.positions[row, device]), mathutils.Matrix(turns[row, device]), None)


def record(things: list, scene: bpy.types.Scene, axes: str = "blender") -> None:
    """Keys objects or pose bones as a recorder does, a key a frame from the scene's first."""
    for thing in things:
        thing.rotation_mode = "QUATERNION"
    for row, device, matrix in poses(axes):
        thing = things[device]
        if isinstance(thing, bpy.types.PoseBone):
            thing.matrix_basis = thing.bone.matrix_local.inverted() @ matrix
        else:
            thing.matrix_basis = matrix
        for path in ("location", "rotation_quaternion"):
            thing.keyframe_insert(path, frame=scene.frame_start + row)


def empties(scene: bpy.types.Scene, names: tuple[str, ...]) -> list[bpy.types.Object]:
    made = [bpy.data.objects.new(name, None) for name in names]
    for empty in made:
        scene.collection.objects.link(empty)
    return made


@pytest.fixture
def scene(empty_scene: bpy.types.Scene) -> bpy.types.Scene:
    empty_scene.render.fps, empty_scene.frame_start, empty_scene.frame_end = FPS, 1, 250
    return empty_scene


def assert_same(take: Take, metres: float = 1e-4, degrees: float = 0.1) -> None:
    assert len(take) == len(TRUTH)
    np.testing.assert_allclose(take.times, TRUTH.times, atol=1e-4)
    np.testing.assert_allclose(take.positions, TRUTH.positions, atol=metres)
    assert np.degrees(difference(take.rotations, TRUTH.rotations).max()) < degrees


@pytest.mark.parametrize("axes", ["blender", "fbx", "zup", "engine"])
def test_empties_are_a_take_whatever_way_they_look(scene: bpy.types.Scene, axes: str) -> None:
    record(empties(scene, ("head", "left_hand", "right_hand")), scene, axes)
    scene.frame_set(7)
    take = objects_take(scene, SCENE, MEASURE)
    assert_same(take)
    assert take.report is not None
    assert take.report.constants["axes"].value == axes
    assert take.kind == "device"
    assert scene.frame_current == 7


def test_recorded_bones_are_found_by_their_role(scene: bpy.types.Scene) -> None:
    """As the Tracking Toolkit leaves them: bones with nicknames below a root, each with an offset to be adjusted."""
    armature = bpy.data.objects.new("XR Trackers", bpy.data.armatures.new("XR Trackers"))
    scene.collection.objects.link(armature)
    bpy.context.view_layer.objects.active = armature
    bpy.ops.object.mode_set(mode="EDIT")
    for name in ("root", "Anna", "Anna Offset", "L", "L Offset", "R", "R Offset"):
        bone = armature.data.edit_bones.new(name)
        bone.tail = (0, 1, 0)
    bpy.ops.object.mode_set(mode="OBJECT")
    bones = armature.pose.bones
    for name, role in (("Anna", "head"), ("L", "left_hand"), ("R", "right_hand")):
        bones[name]["role_string"] = bones[f"{name} Offset"]["role_string"] = role
        bones[name]["ref_type"], bones[f"{name} Offset"]["ref_type"] = "tracker", "offset"
    record([bones["Anna"], bones["L"], bones["R"]], scene)
    assert_same(objects_take(scene, SCENE, MEASURE))


def test_what_hangs_off_a_moved_parent_is_where_it_is_seen(scene: bpy.types.Scene) -> None:
    made = empties(scene, ("XR Root", "head", "left_hand", "right_hand"))
    record(made[1:], scene)
    for empty in made[1:]:
        empty.parent = made[0]
    made[0].location = (3, -2, 0)
    take = objects_take(scene, SCENE, MEASURE)
    np.testing.assert_allclose(take.positions, TRUTH.positions + np.array([3, -2, 0]), atol=1e-4)


def test_a_recording_on_an_nla_track_is_sampled_over_its_strips(scene: bpy.types.Scene) -> None:
    made = empties(scene, ("head", "left_hand", "right_hand"))
    record(made, scene)
    for empty in made:
        data = empty.animation_data
        track = data.nla_tracks.new()
        track.strips.new("take", 1, data.action)
        data.action = None
    assert_same(objects_take(scene, SCENE, MEASURE))


def test_keys_between_frames_are_kept(scene: bpy.types.Scene) -> None:
    made = empties(scene, ("head", "left_hand", "right_hand"))
    record(made, scene)
    scene.render.fps = 12  # a take of 30 a second on the timeline of a slower scene, as recorders write it
    for empty in made:
        for curve in _curves(empty):
            for key in curve.keyframe_points:
                key.co.x = 1 + (key.co.x - 1) * 12 / FPS
                key.interpolation = "LINEAR"
    take = objects_take(scene, SCENE, MEASURE)
    assert take.seconds == pytest.approx(TRUTH.seconds, abs=1e-3)
    assert len(take) == len(TRUTH)


def _curves(obj: bpy.types.Object) -> list[bpy.types.FCurve]:
    from cbm_addon.scene.action import action_curves

    return action_curves(obj)


def test_the_user_names_what_cannot_be_found(scene: bpy.types.Scene) -> None:
    record(empties(scene, ("Empty", "Empty.001", "Empty.002")), scene)
    with pytest.raises(InputError, match="--head"):
        objects_take(scene, SCENE, MEASURE)
    assert_same(objects_take(scene, SCENE, TakeOverrides(head="Empty", left="Empty.001", right="Empty.002")))
    empties(scene, ("Headset",))
    with pytest.raises(InputError, match="Headset does not move"):
        objects_take(scene, SCENE, MEASURE)


def test_a_character_in_the_scene_is_not_taken_for_trackers(metarig: bpy.types.Object) -> None:
    scene = bpy.context.scene
    scene.render.fps, scene.frame_start = FPS, 1
    with pytest.raises(InputError, match="nothing in it is called like a headset"):
        objects_take(scene, SCENE, MEASURE)
    record(empties(scene, ("head", "left_hand", "right_hand")), scene)
    assert_same(objects_take(scene, SCENE, MEASURE))


# Files


def blocks() -> set[tuple[str, str]]:
    return {(type(block).__name__, block.name) for block in bpy.data.user_map()}


def gltf() -> dict:
    """A glTF 2.0 file with three animated nodes, as the specification has it: Y up, metres, devices that look along -Z."""
    c = AXES["openxr"]
    times = TRUTH.times.astype("<f4")
    places = (TRUTH.positions.astype(np.float64) @ c).astype("<f4")
    turns = continuous(quat_from_matrix(c.T @ matrix_from_quat(TRUTH.rotations.astype(np.float64)) @ c))[..., [1, 2, 3, 0]].astype("<f4")
    chunks, views, accessors, channels, samplers = [times.tobytes()], [], [], [], []
    count = len(times)
    accessors.append({"bufferView": 0, "componentType": 5126, "count": count, "type": "SCALAR", "min": [float(times[0])], "max": [float(times[-1])]})
    for device in range(3):
        for path, values, kind in (("translation", places, "VEC3"), ("rotation", turns, "VEC4")):
            chunks.append(np.ascontiguousarray(values[:, device]).tobytes())
            accessors.append({"bufferView": len(accessors), "componentType": 5126, "count": count, "type": kind})
            channels.append({"sampler": len(samplers), "target": {"node": device, "path": path}})
            samplers.append({"input": 0, "output": len(accessors) - 1, "interpolation": "LINEAR"})
    start = 0
    for chunk in chunks:
        views.append({"buffer": 0, "byteOffset": start, "byteLength": len(chunk)})
        start += len(chunk)
    uri = "data:application/octet-stream;base64," + base64.b64encode(b"".join(chunks)).decode()
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0, 1, 2]}],
        "nodes": [{"name": name} for name in ("HMD", "ControllerLeft", "ControllerRight")],
        "animations": [{"channels": channels, "samplers": samplers}],
        "buffers": [{"uri": uri, "byteLength": start}],
        "bufferViews": views,
        "accessors": accessors,
    }


def test_gltf_nodes_are_a_take_and_leave_nothing_behind(scene: bpy.types.Scene, tmp_path: Path) -> None:
    path = tmp_path / "take.gltf"
    path.write_text(json.dumps(gltf()))
    before, rate = blocks(), scene.render.fps
    take = read_any_take(path, MEASURE)
    assert take.report is not None
    assert (take.report.format, take.report.constants["axes"].value) == ("glTF", "zup")
    assert take.seconds == pytest.approx(TRUTH.seconds, abs=0.05)
    truth = sampled(TRUTH, take.times)
    # The importer puts the first key at time 0 of the scene; actors that look along -Z in glTF look along +Y in Blender.
    flat = truth.positions * np.array([-1, -1, 1])
    np.testing.assert_allclose(take.positions, flat, atol=0.01)
    assert (blocks(), bpy.context.scene.render.fps) == (before, rate)


def test_fbx_nulls_are_a_take(scene: bpy.types.Scene, tmp_path: Path) -> None:
    path = tmp_path / "take.fbx"
    record(empties(scene, ("HMD", "MotionControllerLeft", "MotionControllerRight")), scene)
    scene.frame_end = len(TRUTH)
    bpy.ops.export_scene.fbx(
        filepath=str(path), object_types={"EMPTY"}, bake_anim_simplify_factor=0, bake_anim_use_nla_strips=False, bake_anim_use_all_actions=False
    )
    bpy.ops.wm.read_factory_settings(use_empty=True)
    before = blocks()
    take = read_any_take(path, MEASURE)
    assert take.report is not None
    assert take.report.format == "FBX"
    truth = sampled(TRUTH, take.times)
    assert take.seconds == pytest.approx(TRUTH.seconds, abs=0.05)
    np.testing.assert_allclose(take.positions, truth.positions, atol=0.01)
    assert np.degrees(np.percentile(difference(take.rotations, truth.rotations), 99)) < 1
    assert blocks() == before


def test_a_blend_file_is_a_take_open_or_not(scene: bpy.types.Scene, tmp_path: Path) -> None:
    path = tmp_path / "recorded.blend"
    record(empties(scene, ("head", "left_hand", "right_hand")), scene)
    bpy.ops.wm.save_as_mainfile(filepath=str(path), compress=True)
    assert_same(read_any_take(path, MEASURE))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.render.fps = 24
    before = blocks()
    take = read_any_take(path, MEASURE)
    assert_same(take)
    assert (take.name, blocks(), bpy.context.scene.render.fps) == ("recorded", before, 24)


def test_files_that_are_not_what_they_seem_are_refused(empty_scene: bpy.types.Scene, tmp_path: Path) -> None:
    (tmp_path / "cut.blend").write_bytes(b"BLENDER-v500" + bytes(100))
    (tmp_path / "take.txt").write_bytes(b"Kaydara FBX Binary  \0" + bytes(100))
    (tmp_path / "take.fbx").write_bytes(b"Kaydara FBX Binary  \0" + bytes(100))
    before = blocks()
    for name in ("cut.blend", "take.txt", "take.fbx"):
        with pytest.raises(InputError, match=name):
            read_any_take(tmp_path / name, MEASURE)
    assert blocks() == before


# The operator


def test_the_operator_takes_animated_objects_and_keeps_them_where_they_are(extension: ModuleType) -> None:
    scene = bpy.context.scene
    scene.render.fps = FPS
    made = empties(scene, ("Viewer", "Hand L", "Hand R"))
    record(made, scene)
    assert bpy.ops.cbm.import_take(source="OBJECTS") == {"FINISHED"}
    assert "blender" in scene.cbm.take_summary
    assert Path(scene.cbm.take).is_file()
    scene.frame_set(100)
    bpy.context.view_layer.update()
    head = next(obj for obj in bpy.data.objects if obj.name.endswith(" head"))
    assert (head.matrix_world.translation.xy - made[0].matrix_world.translation.xy).length < 0.15, "the joint is within a head of the headset"
    assert bpy.ops.cbm.import_take(source="OBJECTS", head="Viewer", left="Hand R", right="Hand L") == {"FINISHED"}
    assert "trackers: Viewer, Hand R, Hand L (given" in scene.cbm.take_summary
    with pytest.raises(RuntimeError, match="holds no 'Nobody'"):
        bpy.ops.cbm.import_take(source="OBJECTS", head="Nobody")
