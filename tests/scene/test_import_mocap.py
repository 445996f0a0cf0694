"""`bpy.ops.cbm.import_mocap`: files become actions in real time, and nothing else in the file changes."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import pytest

from cbm_addon.motion.bvh import read_bvh, write_bvh
from cbm_addon.motion.contacts import contact_labels
from cbm_addon.motion.motion import Motion
from cbm_addon.motion.resample import resample
from cbm_addon.motion.rotations import normalize, quat_from_rotvec, rotate
from cbm_addon.motion.skeleton import STANDARD_BODY, Skeleton
from cbm_addon.scene.action import action_curves, key_frames, scene_frames, write_action
from cbm_addon.scene.armature import motion_from_armature, new_armature, pose_channels
from cbm_addon.scene.importers import import_mocap
from cbm_addon.takes.sample_motion import sample_motion
from tests.sample_rigs import SAMPLE_RIGS, add_armature, bones_at_rest, with_lengths

pytestmark = pytest.mark.usefixtures("extension")

FBX_AND_GLTF = ["fbx", "glb"]


def dance(frames: int = 30, rate: float = 30, skeleton: Skeleton = STANDARD_BODY) -> Motion:
    """Every joint swings about all its axes while the body walks a circle."""
    times = np.arange(frames) / rate
    random = np.random.default_rng(1)
    speeds, phases = random.uniform(2, 6, (len(skeleton), 3)), random.uniform(0, 6, (len(skeleton), 3))
    swing = 0.3 * np.sin(times[:, None, None] * speeds + phases)
    root = np.stack((np.cos(times), np.sin(times), 0.9 + 0.05 * np.sin(3 * times)), axis=-1)
    return Motion(skeleton, times, root.astype(np.float32), quat_from_rotvec(swing).astype(np.float32))


@pytest.fixture
def bvh(tmp_path: Path) -> Callable[..., Path]:
    def write(motion: Motion, name: str = "dance") -> Path:
        path = tmp_path / f"{name}.bvh"
        write_bvh(path, motion)
        return path

    return write


def heads(armature: bpy.types.Object, frame: int, names: tuple[str, ...]) -> np.ndarray:
    """World positions [J, 3] of bones, as Blender evaluates them."""
    bpy.context.scene.frame_set(frame)
    posed = armature.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return np.array([posed.matrix_world @ posed.pose.bones[name].head for name in names])


def assert_follows(armature: bpy.types.Object, motion: Motion, frame_start: int = 1, within: float = 1e-3) -> None:
    """At each whole frame of the motion's span every bone is where its joint is then."""
    scene = bpy.context.scene
    rate = scene.render.fps / scene.render.fps_base
    last = int(np.floor(motion.seconds * rate + 1e-6))
    frames = sorted({0, 1, last // 2, last})
    expected = resample(motion, np.array(frames) / rate).positions()
    for frame, positions in zip(frames, expected, strict=True):
        assert np.abs(heads(armature, frame_start + frame, motion.skeleton.names) - positions).max() < within


def blocks() -> set[int]:
    return {block.session_uid for block in bpy.data.user_map()}


def added_since(before: set[int]) -> list[str]:
    return sorted(type(block).__name__ for block in bpy.data.user_map() if block.session_uid not in before)


# A new armature


def test_a_file_becomes_an_armature_that_does_the_motion(bvh):
    motion = dance()
    bpy.context.scene.render.fps = 30
    assert bpy.ops.cbm.import_mocap(filepath=str(bvh(motion))) == {"FINISHED"}
    armature = bpy.context.object
    assert (armature.type, armature.name, armature.animation_data.action.name) == ("ARMATURE", "dance", "dance")
    assert_follows(armature, motion)


def test_bones_lie_along_the_rest_pose(bvh):
    bpy.ops.cbm.import_mocap(filepath=str(bvh(dance())))
    bones = bpy.context.object.data.bones
    rest = STANDARD_BODY.rest_positions()
    for name, parent, position in zip(STANDARD_BODY.names, STANDARD_BODY.parents, rest, strict=True):
        assert np.allclose(bones[name].head_local, position, atol=1e-5)
        assert (bones[name].parent.name if bones[name].parent else None) == (STANDARD_BODY.names[parent] if parent >= 0 else None)
        assert bones[name].length > 0.01
    assert np.allclose(bones["LeftForeArm"].tail_local, bones["LeftHand"].head_local, atol=1e-5)
    assert np.allclose(bones["LeftLeg"].matrix_local.col[2][:3], [0, -1, 0], atol=0.05)  # Z to the front, so that knees bend about X


def test_joints_at_the_place_of_their_parent_get_bones_too(bvh):
    """Blender deletes bones of no length."""
    offsets = STANDARD_BODY.offsets.copy()
    offsets[[1, 5, 9]] = 0
    body = replace(STANDARD_BODY, offsets=offsets, tips=np.full_like(offsets, np.nan))
    motion = dance(skeleton=body)
    bpy.ops.cbm.import_mocap(filepath=str(bvh(motion)))
    assert [bone.name for bone in bpy.context.object.data.bones if bone.length < 0.005] == []
    assert_follows(bpy.context.object, motion)


def test_joints_that_move_in_their_parent_move_their_bones(bvh):
    motion = dance()
    offsets = np.repeat(STANDARD_BODY.offsets[None], len(motion), axis=0)
    offsets[:, 2] += np.linspace(0, 0.1, len(motion), dtype=np.float32)[:, None]
    motion = replace(motion, offsets=offsets)
    bpy.ops.cbm.import_mocap(filepath=str(bvh(motion)))
    armature = bpy.context.object
    assert_follows(armature, motion)
    assert {curve.data_path for curve in action_curves(armature) if "location" in curve.data_path} == {
        'pose.bones["Hips"].location',
        'pose.bones["Spine1"].location',
    }


def test_a_second_root_gets_a_bone_and_moves_too(bvh):
    """An actor and a ball."""
    ball = len(STANDARD_BODY)
    nowhere = np.full((1, 3), np.nan, dtype=np.float32)
    skeleton = Skeleton(
        names=(*STANDARD_BODY.names, "Ball"),
        parents=np.append(STANDARD_BODY.parents, -1),
        offsets=np.append(STANDARD_BODY.offsets, [[1, -1, 0]], axis=0).astype(np.float32),
        tips=np.append(STANDARD_BODY.tips, nowhere, axis=0),
    )
    motion = dance(skeleton=skeleton)
    offsets = np.repeat(skeleton.offsets[None], len(motion), axis=0)
    offsets[:, ball, 2] += np.abs(np.sin(9 * motion.times)).astype(np.float32)
    motion = replace(motion, offsets=offsets)
    bpy.context.scene.render.fps = 30
    bpy.ops.cbm.import_mocap(filepath=str(bvh(motion)))
    assert_follows(bpy.context.object, motion)


@pytest.mark.parametrize(("rate", "fps", "base"), [(60, 24, 1.0), (30, 60, 1.0), (120, 30, 1.001), (30, 25, 1.0)])
def test_a_second_of_the_file_is_a_second_of_the_scene(bvh, rate, fps, base):
    scene = bpy.context.scene
    scene.render.fps, scene.render.fps_base = fps, base
    motion = dance(2 * rate, rate)
    bpy.ops.cbm.import_mocap(filepath=str(bvh(motion)))
    frames = key_frames(bpy.context.object)
    assert np.array_equal(frames, np.arange(1, len(frames) + 1))  # whole frames
    assert abs((len(frames) - 1) * base / fps - motion.seconds) < 1 / fps
    assert_follows(bpy.context.object, motion, within=5e-3)  # swings are cut a little between samples of 30 per second


def test_the_motion_starts_at_the_scenes_start_or_where_it_is_told_to(bvh):
    path = str(bvh(dance()))
    bpy.context.scene.frame_start = 11
    bpy.ops.cbm.import_mocap(filepath=path)
    assert key_frames(bpy.context.object)[0] == 11
    bpy.ops.cbm.import_mocap(filepath=path, frame_start=-5)
    assert key_frames(bpy.context.object)[0] == -5


def test_several_files_become_several_armatures(bvh, tmp_path):
    bvh(dance(), "walk")
    bvh(dance(40), "run")
    bpy.ops.cbm.import_mocap(directory=str(tmp_path), files=[{"name": "walk.bvh"}, {"name": "run.bvh"}])
    assert {obj.name: obj.animation_data.action.name for obj in bpy.data.objects} == {"walk": "walk", "run": "run"}


def test_blenders_own_importer_agrees(bvh):
    motion = dance()
    path = str(bvh(motion))
    bpy.context.scene.render.fps = 30
    bpy.ops.cbm.import_mocap(filepath=path)
    ours = bpy.context.object
    bpy.ops.preferences.addon_enable(module="io_anim_bvh")
    bpy.ops.import_anim.bvh(filepath=path, global_scale=0.01, axis_forward="-Z", axis_up="Y")
    theirs = bpy.context.object
    for frame in (1, 2, 17, 30):
        assert np.abs(heads(ours, frame, STANDARD_BODY.names) - heads(theirs, frame, STANDARD_BODY.names)).max() < 1e-4


def test_import_works_while_another_object_is_posed(bvh):
    posed = new_armature(bpy.context, "Other", STANDARD_BODY)
    bpy.ops.object.mode_set(mode="POSE")
    motion = dance()
    bpy.ops.cbm.import_mocap(filepath=str(bvh(motion)))
    assert bpy.context.object != posed
    assert_follows(bpy.context.object, motion)


# What must not change


def test_only_the_armature_and_its_action_are_added_and_the_scene_stays_as_it_was(bvh):
    scene = bpy.context.scene
    scene.render.fps, scene.frame_start, scene.frame_end = 25, 3, 77
    scene.frame_set(42)
    before = blocks()
    bpy.ops.cbm.import_mocap(filepath=str(bvh(dance())))
    assert added_since(before) == ["Action", "Armature", "Object"]
    assert (scene.render.fps, scene.frame_start, scene.frame_end, scene.frame_current) == (25, 3, 77, 42)


def test_the_action_that_was_on_the_armature_is_kept(bvh):
    motion = dance()
    path = str(bvh(motion))
    bpy.ops.cbm.import_mocap(filepath=path)
    armature = bpy.context.object
    first = armature.animation_data.action
    keys = [tuple(point.co for point in curve.keyframe_points) for curve in action_curves(armature)]
    bpy.ops.cbm.import_mocap(filepath=path, armature=armature.name, frame_start=100)
    assert armature.animation_data.action != first
    armature.animation_data.action = first
    if hasattr(first, "slots"):
        armature.animation_data.action_slot = first.slots[0]
    assert [tuple(point.co for point in curve.keyframe_points) for curve in action_curves(armature)] == keys


@pytest.mark.parametrize("name", ["missing.bvh", "broken.bvh", "notes.txt", "broken.fbx", "broken.glb"])
def test_what_cannot_be_read_is_one_error_and_leaves_nothing(bvh, tmp_path, name):
    text = bvh(dance(), "broken").read_text()
    for suffix in ("bvh", "fbx", "glb"):
        (tmp_path / f"broken.{suffix}").write_text(text[: len(text) // 2] + "cut")
    (tmp_path / "notes.txt").write_text("notes")
    bvh(dance(), "sound")
    before, scene = blocks(), bpy.context.scene
    with pytest.raises(RuntimeError, match=name) as error:
        bpy.ops.cbm.import_mocap(directory=str(tmp_path), files=[{"name": "sound.bvh"}, {"name": name}])
    assert len(str(error.value).strip().splitlines()) == 1
    assert added_since(before) == []
    assert bpy.context.window.scene == scene


# An existing armature


def test_bones_with_a_namespace_on_a_turned_and_scaled_armature_follow_in_the_world(bvh):
    """As game engines' skeletons come: centimetres, Y up, "mixamorig:Hips"; the object turns and scales them to stand upright in metres."""
    to_y_up = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], dtype=np.float32)
    armature = new_armature(bpy.context, "Character", replace(STANDARD_BODY, offsets=100 * STANDARD_BODY.offsets @ to_y_up.T))
    for bone in armature.data.bones:
        bone.name = f"mixamorig:{bone.name}"
    armature.scale = (0.01, 0.01, 0.01)
    armature.rotation_euler.x = np.pi / 2
    bpy.context.view_layer.update()
    motion = dance()
    bpy.ops.cbm.import_mocap(filepath=str(bvh(motion)), use_new_armature=False)
    names = replace(STANDARD_BODY, names=tuple(f"mixamorig:{name}" for name in STANDARD_BODY.names))
    assert_follows(armature, replace(motion, skeleton=names))
    assert len(bpy.data.objects) == 1


@pytest.mark.parametrize("yaw", [0.1, 1.0, 3.1])
def test_the_place_and_heading_of_the_motion_are_the_worlds_wherever_the_armature_stands(bvh, yaw):
    armature = new_armature(bpy.context, "Rig", STANDARD_BODY)
    armature.rotation_euler.z = yaw
    armature.location = (4, 5, 0)
    bpy.context.view_layer.update()
    motion = dance()
    bpy.ops.cbm.import_mocap(filepath=str(bvh(motion)), armature="Rig")
    assert_follows(armature, motion)


def test_a_taller_armature_takes_longer_steps(bvh):
    armature = new_armature(bpy.context, "Tall", STANDARD_BODY.scaled(1.2))
    motion = dance()
    bpy.ops.cbm.import_mocap(filepath=str(bvh(motion)), armature="Tall")
    assert_follows(armature, replace(motion, skeleton=STANDARD_BODY.scaled(1.2), root=motion.root * np.float32(1.2)))


def test_an_a_pose_armature_takes_the_poses_of_a_t_pose_file(bvh):
    """Arms that hang 45 degrees at rest lie where the file's arms lie, from their first frame on."""
    angles = {"Left": np.pi / 4, "Right": -np.pi / 4}
    offsets, tips = STANDARD_BODY.offsets.copy(), STANDARD_BODY.tips.copy()
    for side, angle in angles.items():
        lower = quat_from_rotvec(np.array([0, angle, 0], dtype=np.float32))
        below = STANDARD_BODY.indices([f"{side}ForeArm", f"{side}Hand"])
        offsets[below] = rotate(lower, offsets[below])
        tips[STANDARD_BODY.index(f"{side}Hand")] = rotate(lower, tips[STANDARD_BODY.index(f"{side}Hand")])
    armature = new_armature(bpy.context, "A-pose", replace(STANDARD_BODY, offsets=offsets, tips=tips))
    motion = dance()
    bpy.ops.cbm.import_mocap(filepath=str(bvh(motion)), armature="A-pose")
    assert_follows(armature, motion)


def test_bones_between_those_that_follow_stay_at_rest(bvh):
    """An armature with a root bone above, one vertebra less, and a sword: nothing but the bones of that name is keyed."""
    armature = new_armature(bpy.context, "Knight", STANDARD_BODY)
    bpy.ops.object.mode_set(mode="EDIT")
    edit = armature.data.edit_bones
    root, sword = edit.new("Root"), edit.new("Sword")
    root.tail, sword.head, sword.tail = (0, 0.3, 0), edit["LeftHand"].tail, (2, 0, 0.5)
    edit["Hips"].parent, sword.parent = root, edit["LeftHand"]
    edit["Spine2"].name = "Vertebra"
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.context.scene.render.fps = 30
    motion = dance()
    motion.rotations[:, STANDARD_BODY.index("Spine2")] = 1, 0, 0, 0
    bpy.ops.cbm.import_mocap(filepath=str(bvh(motion)), armature="Knight")
    keyed = {curve.data_path.split('"')[1] for curve in action_curves(armature)}
    assert keyed == set(STANDARD_BODY.names) - {"Spine2"}
    without = tuple(name for name in STANDARD_BODY.names if name != "Spine2")
    for frame in (1, 10, 20):
        assert np.abs(heads(armature, frame, without) - motion.positions()[frame - 1, STANDARD_BODY.indices(without)]).max() < 1e-3


@pytest.mark.parametrize("mode", ["XYZ", "ZXY", "AXIS_ANGLE"])
def test_bones_keep_their_rotation_mode(bvh, mode):
    armature = new_armature(bpy.context, "Rig", STANDARD_BODY)
    for bone in armature.pose.bones:
        bone.rotation_mode = mode
    motion = dance()
    bpy.ops.cbm.import_mocap(filepath=str(bvh(motion)), armature="Rig")
    assert {bone.rotation_mode for bone in armature.pose.bones} == {mode}
    assert_follows(armature, motion)


def test_bones_that_do_not_inherit_rotation_follow_too(bvh):
    armature = new_armature(bpy.context, "Rig", STANDARD_BODY)
    armature.data.bones["Head"].use_inherit_rotation = False
    motion = dance()
    bpy.ops.cbm.import_mocap(filepath=str(bvh(motion)), armature="Rig")
    assert_follows(armature, motion)
    free = motion_from_armature(armature, np.array([9.0]))
    bpy.ops.cbm.import_mocap(filepath=str(bvh(motion)))
    bound = motion_from_armature(bpy.context.object, np.array([9.0]))
    assert np.allclose(np.abs(free.forward()[0]), np.abs(bound.forward()[0]), atol=1e-3)


def dwarf(armature: bpy.types.Object) -> str:
    for bone in armature.data.bones:
        bone.name = f"Part {bone.name}"
    bpy.ops.object.mode_set(mode="EDIT")
    for name in ("LeftArm", "RightArm", "LeftUpLeg", "RightUpLeg"):
        armature.data.edit_bones.remove(armature.data.edit_bones[f"Part {name}"])
    bpy.ops.object.mode_set(mode="OBJECT")
    return "lacks bones for LeftArm"


def mirrored(armature: bpy.types.Object) -> str:
    armature.scale.x = -1
    return "mirrored"


def edited(armature: bpy.types.Object) -> str:
    bpy.ops.object.mode_set(mode="EDIT")
    return "leave edit mode"


@pytest.mark.parametrize("spoil", [dwarf, mirrored, edited])
def test_an_armature_that_does_not_fit_is_refused_in_one_line(bvh, spoil):
    armature = new_armature(bpy.context, "Rig", STANDARD_BODY)
    reason = spoil(armature)
    before = blocks()
    with pytest.raises(RuntimeError, match="Rig: .*" + reason) as error:
        bpy.ops.cbm.import_mocap(filepath=str(bvh(dance())), armature="Rig")
    assert len(str(error.value).strip().splitlines()) == 1
    assert added_since(before) == []
    assert armature.animation_data is None


@pytest.mark.parametrize("target", [{"armature": "Nobody"}, {"use_new_armature": False}])
def test_a_target_that_is_not_there_is_an_error(bvh, target):
    with pytest.raises(RuntimeError, match=r"Nobody: is not an armature|Armature: none is active"):
        bpy.ops.cbm.import_mocap(filepath=str(bvh(dance())), **target)


# A rig of any kind


def rig_of(name: str, pose: str = "A") -> bpy.types.Object:
    return add_armature(bones_at_rest(next(sample for sample in SAMPLE_RIGS if sample.name == name), pose))


def limb_directions(armature: bpy.types.Object, frame: int, joints: dict[str, str]) -> np.ndarray:
    chains = [(side + a, side + b) for side in ("Left", "Right") for a, b in (("Arm", "ForeArm"), ("ForeArm", "Hand"))]
    ends = heads(armature, frame, tuple(joints[joint] for chain in chains for joint in chain)).reshape(-1, 2, 3)
    return normalize(ends[:, 1] - ends[:, 0])


@pytest.mark.parametrize("sample", [sample for sample in SAMPLE_RIGS if sample.name != "motion capture"], ids=lambda sample: sample.name)
def test_a_file_moves_a_rig_of_any_kind(bvh, sample):
    """Arms point where the file's arms point, and the ankles go as far as the legs are long."""
    armature = add_armature(bones_at_rest(sample, "A"))
    bpy.context.scene.render.fps = 30
    motion = dance()
    assert bpy.ops.cbm.import_mocap(filepath=str(bvh(motion)), armature=armature.name) == {"FINISHED"}
    assert armature.animation_data.action.name == "dance"
    own = {name: name for name in STANDARD_BODY.names}
    shown = new_armature(bpy.context, "Shown", motion.skeleton)
    write_action(shown, "shown", scene_frames(bpy.context.scene, motion.times, 1), pose_channels(shown, motion))
    for frame in (1, 15, 30):
        np.testing.assert_allclose(limb_directions(armature, frame, sample.joints), limb_directions(shown, frame, own), atol=2e-3)
    ways = [np.array([heads(obj, frame, (ankle,))[0] for frame in range(1, 31)]) for obj, ankle in ((armature, sample.joints["LeftFoot"]), (shown, "LeftFoot"))]
    np.testing.assert_allclose(ways[0] - ways[0][0], ways[1] - ways[1][0], atol=0.03)


@pytest.mark.parametrize("factors", [{"Leg": 1.25, "Foot": 0.85}, {"Leg": 0.8, "Foot": 1.2}, {"Leg": 0.6, "Foot": 0.6}], ids=["thighs", "shins", "short"])
def test_feet_that_stand_in_the_file_stand_on_legs_of_other_proportions(bvh, factors):
    """The median speed over the floor of ankles in contact is no larger than in the file, in relation to the length of the legs."""
    bpy.context.scene.render.fps = 30
    sample = next(sample for sample in SAMPLE_RIGS if sample.name == "Unreal 4")
    armature = add_armature(with_lengths(sample, "A", factors))
    motion = resample(sample_motion(), np.arange(2, 6, 1 / 30))
    motion = replace(motion, times=motion.times - motion.times[0])
    bpy.ops.cbm.import_mocap(filepath=str(bvh(motion)), armature=armature.name)
    contacts = contact_labels(motion.skeleton, motion.positions(), 30)[:, [0, 2]]
    speeds = []
    of_file = motion.positions()[:, motion.skeleton.indices(["LeftFoot", "RightFoot"])]
    of_rig = np.array([heads(armature, i + 1, ("foot_l", "foot_r")) for i in range(len(motion))])
    for ankles in (of_file, of_rig):
        speed = 30 * np.linalg.norm(np.diff(ankles[..., :2], axis=0), axis=-1)
        speeds.append(np.median(speed[contacts[1:]]))
    legs = sum(factors.values()) / 2
    assert contacts.mean() > 0.3
    assert speeds[1] <= speeds[0] * max(legs, 1) + 0.01


def test_many_files_become_actions_of_one_rig_with_the_files_names(bvh, tmp_path):
    armature = rig_of("Unreal 5")
    names = [f"clip_{i:02}" for i in range(20)]
    for name in names:
        bvh(dance(8), name)
    bpy.ops.cbm.import_mocap(directory=str(tmp_path), files=[{"name": f"{name}.bvh"} for name in names], armature=armature.name)
    assert sorted(bpy.data.actions.keys()) == names
    assert all(action.use_fake_user for action in bpy.data.actions)
    assert [obj.name for obj in bpy.data.objects] == [armature.name]


def test_one_unsound_file_among_many_leaves_nothing(bvh, tmp_path):
    armature = rig_of("Unreal 5")
    bvh(dance(8), "sound")
    (tmp_path / "broken.bvh").write_text("HIERARCHY")
    before = blocks()
    with pytest.raises(RuntimeError, match=r"broken\.bvh"):
        bpy.ops.cbm.import_mocap(directory=str(tmp_path), files=[{"name": "sound.bvh"}, {"name": "broken.bvh"}], armature=armature.name)
    assert added_since(before) == []


@pytest.mark.parametrize("root", ["bone", "object", "in-place"])
def test_the_way_of_a_file_can_be_carried_by_root_or_object_or_left_out(bvh, root):
    armature = rig_of("Unreal 4")
    bpy.ops.cbm.import_mocap(filepath=str(bvh(dance())), armature=armature.name, root=root)
    moved = {curve.data_path for curve in action_curves(armature) if "location" in curve.data_path}
    assert moved == {"bone": {'pose.bones["root"].location', 'pose.bones["pelvis"].location'}, "object": {"location", 'pose.bones["pelvis"].location'}}.get(
        root, {'pose.bones["pelvis"].location'}
    )
    places = np.array([heads(armature, frame, ("pelvis",))[0] for frame in (1, 10, 20)])
    assert (np.ptp(places[:, :2]) < 1e-4) == (root == "in-place") or np.ptp(places[:, 0]) > 0.05


def test_a_map_of_bones_is_used_where_one_is_given(bvh, tmp_path):
    sample = next(sample for sample in SAMPLE_RIGS if sample.name == "Unreal 5")
    (tmp_path / "map.json").write_text(json.dumps({"joints": sample.joints | {"Spine1": "spine_04"}}))
    armature = rig_of("Unreal 5")
    bpy.ops.cbm.import_mocap(filepath=str(bvh(dance())), armature=armature.name, map=str(tmp_path / "map.json"))
    keyed = {curve.data_path.split('"')[1] for curve in action_curves(armature)}
    assert "spine_04" in keyed
    assert "spine_02" not in keyed


def test_a_file_that_is_no_body_is_refused_on_a_rig_of_other_names(bvh):
    ball = Skeleton(("Ball",), np.array([-1]), np.zeros((1, 3), np.float32), np.full((1, 3), np.nan, np.float32))
    armature = rig_of("Unreal 5")
    with pytest.raises(RuntimeError, match="dance: has neither the names of a known rig nor the shape of a person"):
        bpy.ops.cbm.import_mocap(filepath=str(bvh(dance(skeleton=ball))), armature=armature.name)
    assert not bpy.data.actions


@pytest.mark.needs_data
def test_every_real_body_moves_a_generated_rig_on_the_floor(data_folder, human):
    """Of the files from a dozen systems; the one of a hand alone is left out."""
    paths = [path for path in sorted((data_folder / "mocap" / "import_tests").glob("*.bvh")) if "clenching" not in path.name]
    for result in import_mocap(bpy.context, paths, human, 1):
        human.animation_data.action = result.action
        if hasattr(result.action, "slots"):
            human.animation_data.action_slot = result.action.slots[0]
        frames = np.unique(np.linspace(*result.action.frame_range, 30).astype(int))
        toes = np.array([heads(human, int(frame), ("ORG-toe.L", "ORG-toe.R", "ORG-spine.006")) for frame in frames])
        assert np.isfinite(toes).all()
        if result.action.name != "upc__example_2":  # its recordings do not have the floor at z = 0
            assert toes[:, :2, 2].min() == pytest.approx(0.017, abs=0.05), result.action.name
            assert toes[:, 2, 2].max() > 1.3


# Armatures as motions


def test_an_armature_gives_back_the_motion_that_was_put_on_it(bvh):
    motion = dance()
    bpy.context.scene.render.fps = 30
    bpy.ops.cbm.import_mocap(filepath=str(bvh(motion)))
    bpy.context.scene.frame_set(12)
    found = motion_from_armature(bpy.context.object, np.arange(1, 31))
    assert bpy.context.scene.frame_current == 12
    assert found.skeleton.names == motion.skeleton.names
    assert np.allclose(found.skeleton.rest_positions(), STANDARD_BODY.rest_positions(), atol=1e-5)
    assert np.allclose(found.times, motion.times)
    assert found.offsets is None
    assert np.allclose(found.positions(), motion.positions(), atol=1e-4)


def test_motion_of_the_object_counts_as_motion():
    armature = new_armature(bpy.context, "Rig", STANDARD_BODY)
    for frame, place in ((1, 0.0), (11, 5.0)):
        armature.location.x = place
        armature.keyframe_insert("location", frame=frame)
    found = motion_from_armature(armature, np.array([1.0, 11.0]))
    assert np.allclose(found.root[1] - found.root[0], [5, 0, 0], atol=1e-5)


# FBX and glTF


def exported(tmp_path: Path, motion: Motion, suffix: str) -> Path:
    """The motion as Blender itself writes it, from a scene that is empty again afterwards."""
    path = tmp_path / f"clip.{suffix}"
    armature = new_armature(bpy.context, "Actor", motion.skeleton)
    write_action(armature, "Take", scene_frames(bpy.context.scene, motion.times, 1), pose_channels(armature, motion), fake_user=False)
    bpy.context.scene.frame_end = len(motion)
    if suffix == "fbx":
        bpy.ops.export_scene.fbx(filepath=str(path), add_leaf_bones=False, bake_anim_simplify_factor=0)
    else:
        bpy.ops.export_scene.gltf(filepath=str(path))
    bpy.data.batch_remove([armature.animation_data.action, armature.data, armature])
    return path


@pytest.mark.parametrize("suffix", FBX_AND_GLTF)
def test_what_blender_exports_comes_back_in_real_time(tmp_path, suffix):
    scene = bpy.context.scene
    scene.render.fps = 30
    motion = dance()
    path = exported(tmp_path, motion, suffix)
    scene.render.fps, scene.frame_start, scene.frame_end = 60, 1, 99
    before = blocks()
    assert bpy.ops.cbm.import_mocap(filepath=str(path)) == {"FINISHED"}
    assert added_since(before) == ["Action", "Armature", "Object"]
    assert (scene.render.fps, scene.frame_start, scene.frame_end, bpy.context.window.scene) == (60, 1, 99, scene)
    armature = bpy.context.object
    assert len(key_frames(armature)) == 59  # 29 / 30 s at 60 per second
    assert_follows(armature, motion, within=5e-3)


@pytest.mark.parametrize("suffix", FBX_AND_GLTF)
def test_a_file_with_nothing_animated_is_refused(tmp_path, suffix):
    path = tmp_path / f"still.{suffix}"
    armature = new_armature(bpy.context, "Actor", STANDARD_BODY)
    bpy.ops.export_scene.fbx(filepath=str(path), bake_anim=False) if suffix == "fbx" else bpy.ops.export_scene.gltf(filepath=str(path))
    bpy.data.batch_remove([armature.data, armature])
    before = blocks()
    with pytest.raises(RuntimeError, match="no animated armature"):
        bpy.ops.cbm.import_mocap(filepath=str(path))
    assert added_since(before) == []


# Real files


@pytest.mark.needs_data
def test_every_real_file_becomes_an_armature_that_does_its_motion(data_folder):
    for path in sorted((data_folder / "mocap" / "import_tests").glob("*.bvh")):
        motion = read_bvh(path)
        bpy.context.scene.render.fps = max(1, round(motion.rate))
        bpy.ops.cbm.import_mocap(filepath=str(path))
        assert_follows(bpy.context.object, motion)
