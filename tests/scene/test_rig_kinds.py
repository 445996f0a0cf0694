"""Every kind of rig in Blender: recognised, and its evaluated bones stand where the solved body has its joints."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from cbm_addon.errors import InputError
from cbm_addon.motion.motion import Motion
from cbm_addon.motion.rotations import matrix_from_quat, multiply, quat_from_rotvec, quat_from_yaw
from cbm_addon.progress import run
from cbm_addon.rigs.body import RigBody, rig_body
from cbm_addon.rigs.rig import FINGER_JOINTS, Rig
from cbm_addon.scene.action import action_curves, write_action
from cbm_addon.scene.bake import BakeOptions, bake, rig_channels
from cbm_addon.scene.rig import read_rig
from cbm_addon.solve.models import load_model
from cbm_addon.solve.perform import sampled
from cbm_addon.takes.calibrate import Calibrated, calibrate
from cbm_addon.takes.sample_motion import sample_take
from tests.evaluated import evaluated
from tests.sample_rigs import SAMPLE_RIGS, SampleRig, add_armature, bones_at_rest, renamed, transform

pytestmark = pytest.mark.usefixtures("empty_scene")

FRAMES = 4
TENTH_OF_A_MILLIMETRE = 1e-4
MODES = ("QUATERNION", "XYZ", "ZYX", "YXZ", "AXIS_ANGLE")


def sample_called(name: str) -> SampleRig:
    return next(sample for sample in SAMPLE_RIGS if sample.name == name)


def a_motion(solved: RigBody) -> Motion:
    random = np.random.default_rng(4)
    rotations = quat_from_rotvec(random.uniform(-0.5, 0.5, (FRAMES, len(solved.body), 3))).astype(np.float32)
    root = random.uniform(-1, 1, (FRAMES, 3)) * solved.body.height_above_toes()
    return Motion(solved.body, np.arange(FRAMES) / 24, root.astype(np.float32), rotations)


def put_on(armature: bpy.types.Object, root: str = "hips") -> tuple[Rig, RigBody, Motion]:
    rig = read_rig(armature)
    solved = rig_body(rig, FINGER_JOINTS)
    motion = a_motion(solved)
    write_action(armature, "test", np.arange(FRAMES) + 1.0, list(rig_channels(armature, rig, solved, motion, root=root)))
    return rig, solved, motion


def assert_exact(armature: bpy.types.Object, rig: Rig, solved: RigBody, motion: Motion) -> None:
    """The evaluated bones are where the joints were solved, to a tenth of a millimetre of a body of human size, and turned as them."""
    bones = [(rig.mapping.joints | rig.mapping.fingers)[name] for name in solved.body.names]
    matrices = evaluated(armature, bones, FRAMES)
    world, positions = motion.forward()
    size = solved.body.height_above_toes() / 1.6
    np.testing.assert_allclose(matrices[..., :3, 3], positions, atol=TENTH_OF_A_MILLIMETRE * size)
    rest = np.stack([multiply(rig.object_rotation, rig.rest_rotation(bone)) for bone in bones])
    expected = matrix_from_quat(multiply(multiply(world, solved.alignment), rest))
    np.testing.assert_allclose(matrices[..., :3, :3] / rig.scale, expected, atol=1e-3)


@pytest.mark.parametrize("pose", ["T", "A"])
@pytest.mark.parametrize("sample", SAMPLE_RIGS, ids=lambda sample: sample.name)
def test_every_kind_of_rig_is_known_and_lands_where_it_was_solved(sample, pose):
    armature = add_armature(bones_at_rest(sample, pose, seed=7))
    for i, bone in enumerate(armature.pose.bones):
        bone.rotation_mode = MODES[i % len(MODES)]
    rig, solved, motion = put_on(armature)
    assert rig.mapping.kind == sample.kind
    assert rig.mapping.joints | rig.mapping.fingers == sample.joints
    assert_exact(armature, rig, solved, motion)


@pytest.mark.parametrize("sample", [sample_called("Mixamo"), sample_called("Unreal 5"), sample_called("CMU")], ids=lambda sample: sample.name)
def test_a_rig_whose_names_say_nothing_lands_too(sample):
    armature = add_armature(renamed(bones_at_rest(sample, "hanging")))
    rig, solved, motion = put_on(armature)
    assert rig.mapping.kind == "shape"
    assert_exact(armature, rig, solved, motion)


def test_fingers_of_a_generated_rig_land_too(human):
    rig, solved, motion = put_on(human)
    assert len(rig.mapping.fingers) == 30
    bones = [rig.mapping.fingers[name] for name in FINGER_JOINTS]
    positions = evaluated(human, bones, FRAMES)[..., :3, 3]
    np.testing.assert_allclose(positions, motion.positions()[:, solved.body.indices(FINGER_JOINTS)], atol=TENTH_OF_A_MILLIMETRE)


# Transforms of the object


def parented(armature: bpy.types.Object) -> None:
    parent = add_armature(bones_at_rest(sample_called("SMPL")))
    parent.location, parent.rotation_euler, parent.scale = (3, -1, 0.5), (0, 0, 2), (2, 2, 2)
    armature.parent = parent


def under_a_bone(armature: bpy.types.Object) -> None:
    stands = armature.matrix_world.copy()
    armature.parent, armature.parent_type, armature.parent_bone = add_armature(bones_at_rest(sample_called("SMPL"))), "BONE", "Spine1"
    bpy.context.view_layer.update()
    armature.matrix_world = stands


def scaled_and_turned(armature: bpy.types.Object) -> None:
    """Centimetres and Y up, as exporters for game engines write."""
    armature.data.transform(Matrix(transform(quat_from_rotvec(np.array([-np.pi / 2, 0, 0])), np.zeros(3), 100)))
    armature.scale, armature.rotation_euler = (0.01, 0.01, 0.01), (np.pi / 2, 0, 0)


def far_and_small(armature: bpy.types.Object) -> None:
    armature.scale, armature.location = (0.3, 0.3, 0.3), (10, 10, 2)


@pytest.mark.parametrize("root", ["hips", "bone", "object"])
@pytest.mark.parametrize("place", [parented, under_a_bone, scaled_and_turned, far_and_small])
def test_transforms_of_the_object_do_not_matter_wherever_the_way_lies(place, root):
    armature = add_armature(bones_at_rest(sample_called("Unreal 4"), "A", transform(quat_from_yaw(np.asarray(0.4)), np.zeros(3))))
    place(armature)
    rig, solved, motion = put_on(armature, root)
    assert_exact(armature, rig, solved, motion)


@pytest.mark.parametrize(("scale", "message"), [((-1, 1, 1), "negative scale"), ((-1, -1, -1), "negative scale"), ((1, 1, 2), "same positive number")])
def test_scales_that_cannot_be_animated_exactly_are_refused(scale, message):
    armature = add_armature(bones_at_rest(sample_called("Mixamo")))
    armature.scale = scale
    with pytest.raises(InputError, match=message) as error:
        read_rig(armature)
    assert "\n" not in str(error.value)


def test_a_sheared_rig_is_refused():
    armature = add_armature(bones_at_rest(sample_called("Mixamo")))
    parent = bpy.data.objects.new("Parent", None)
    bpy.context.scene.collection.objects.link(parent)
    parent.scale = (1, 2, 1)
    armature.parent, armature.rotation_euler = parent, (0, 0, 0.7)
    with pytest.raises(InputError, match="unsheared"):
        read_rig(armature)


# Flags of bones


@pytest.mark.parametrize("inherit_scale", ["NONE", "ALIGNED", "AVERAGE"])
def test_inherited_scale_does_not_matter(inherit_scale):
    armature = add_armature(bones_at_rest(sample_called("Daz Genesis 8"), "A"))
    for bone in armature.data.bones:
        bone.inherit_scale = inherit_scale
    assert_exact(armature, *put_on(armature))


@pytest.mark.parametrize("loose", ["spine_01", "spine_02", "head", "hand_l", "neck_02", "all"])
def test_bones_that_do_not_inherit_rotation_land_too(loose):
    bones = bones_at_rest(sample_called("Unreal 5"), "A")
    inherits = np.array([name != loose and loose != "all" for name in bones.bones])
    armature = add_armature(replace(bones, inherits_rotation=inherits))
    assert_exact(armature, *put_on(armature))


@pytest.mark.parametrize("root", ["hips", "bone"])
def test_locations_that_are_not_local_land_too(root):
    bones = bones_at_rest(sample_called("Unreal 5"), "A")
    armature = add_armature(replace(bones, local_location=np.zeros(len(bones.bones), bool)))
    assert_exact(armature, *put_on(armature, root))


def test_connected_bones_land_too():
    armature = add_armature(bones_at_rest(sample_called("Mixamo"), "A"))
    bpy.ops.object.mode_set(mode="EDIT")
    for bone in armature.data.edit_bones:
        bone.use_connect = bone.parent is not None and (bone.parent.tail - bone.head).length < 1e-4
    bpy.ops.object.mode_set(mode="OBJECT")
    assert any(bone.use_connect for bone in armature.data.bones)
    assert_exact(armature, *put_on(armature))


def test_what_an_earlier_animation_left_on_the_bones_does_not_displace_them():
    armature = add_armature(bones_at_rest(sample_called("Mixamo"), "A"))
    for bone in armature.pose.bones:
        bone.location, bone.scale = (0.1, 0.2, 0.3), (1.2, 0.9, 1.1)
    unmapped = [bone for bone in armature.pose.bones if bone.name.endswith(("End", "4"))]
    assert_exact(armature, *put_on(armature))
    assert all(bone.location.x == pytest.approx(0.1) for bone in unmapped), "what is not mapped is left alone"


# The way over the ground


def test_the_root_bone_of_a_generated_rig_carries_the_way(human):
    rig, solved, motion = put_on(human, "bone")
    assert rig.mapping.root == "root"
    bones = [rig.mapping.joints[name] for name in solved.body.names if name in rig.mapping.joints]
    indices = solved.body.indices([name for name in solved.body.names if name in rig.mapping.joints])
    np.testing.assert_allclose(evaluated(human, bones, FRAMES)[..., :3, 3], motion.positions()[:, indices], atol=TENTH_OF_A_MILLIMETRE)
    roots = evaluated(human, ["root"], FRAMES)[:, 0, :3, 3]
    assert np.ptp(roots[:, :2], axis=0).min() > 0.1
    np.testing.assert_allclose(roots[:, 2], 0, atol=1e-6)


@pytest.mark.parametrize("mode", ["QUATERNION", "XYZ", "AXIS_ANGLE"])
def test_an_object_carries_the_way_in_its_own_rotation_mode(mode):
    armature = add_armature(bones_at_rest(sample_called("Mixamo"), "A"))
    armature.rotation_mode = mode
    rig, solved, motion = put_on(armature, "object")
    assert armature.rotation_mode == mode
    assert_exact(armature, rig, solved, motion)
    assert {"location"} <= {curve.data_path for curve in action_curves(armature)}


def test_in_place_the_hips_do_not_leave_their_spot():
    armature = add_armature(bones_at_rest(sample_called("Mixamo"), "A"))
    rig, _, motion = put_on(armature, "in-place")
    hips = evaluated(armature, [rig.mapping.joints["Hips"]], FRAMES)[:, 0, :3, 3]
    np.testing.assert_allclose(hips[:, :2], 0, atol=1e-5)
    np.testing.assert_allclose(hips[:, 2], motion.positions()[:, 0, 2], atol=1e-5)


def constrained_object(armature: bpy.types.Object) -> None:
    armature.constraints.new("LIMIT_LOCATION")


def delta_location(armature: bpy.types.Object) -> None:
    armature.delta_location = (1, 0, 0)


@pytest.mark.parametrize("spoil", [constrained_object, delta_location])
def test_an_object_that_something_else_moves_cannot_carry_the_way(spoil):
    armature = add_armature(bones_at_rest(sample_called("Mixamo")))
    spoil(armature)
    with pytest.raises(InputError, match="keep the way on the hips"):
        put_on(armature, "object")
    assert not bpy.data.actions


# Whole bakes


@pytest.fixture(scope="module")
def model():
    return load_model()


@pytest.fixture(scope="module")
def calibrated() -> Calibrated:
    """A second of the sample take."""
    take = sampled(sample_take(), 2 + np.arange(0, 1, 1 / 72))
    return calibrate(replace(take, name="walk", times=take.times - take.times[0]))


@pytest.mark.parametrize("root", ["hips", "bone", "object"])
def test_head_and_wrists_meet_the_trackers_whatever_carries_the_way(model, calibrated, root):
    armature = add_armature(bones_at_rest(sample_called("Unreal 4"), "A"))
    report = run(bake(bpy.context, armature, calibrated, model, BakeOptions(root=root)))
    assert min(error.share_within_1_cm for error in report.tracker_errors.values()) >= 0.95


@pytest.mark.parametrize(("spoil", "root"), [(lambda armature: None, "bone"), (constrained_object, "object")], ids=["no root bone", "constrained object"])
def test_a_carrier_that_cannot_be_is_refused_before_anything_is_solved(model, calibrated, spoil, root):
    armature = add_armature(bones_at_rest(sample_called("Mixamo"), "A"))
    spoil(armature)
    with pytest.raises(InputError, match="keep the way on the hips"):
        next(bake(bpy.context, armature, calibrated, model, BakeOptions(root=root)))


def test_in_place_no_tracker_is_measured(model, calibrated):
    armature = add_armature(bones_at_rest(sample_called("Unreal 4"), "A"))
    assert run(bake(bpy.context, armature, calibrated, model, BakeOptions(root="in-place"))).tracker_errors == {}


def test_the_lower_part_alone_cannot_be_carried_by_root_or_object(model, calibrated):
    armature = add_armature(bones_at_rest(sample_called("Unreal 4"), "A"))
    with pytest.raises(InputError, match="keep it on the hips"):
        run(bake(bpy.context, armature, calibrated, model, BakeOptions("lower", root="object")))
    assert not bpy.data.actions


def test_an_action_that_two_armatures_share_stays_on_the_other_as_it_was(model, calibrated):
    armatures = [add_armature(bones_at_rest(sample_called("Mixamo"))) for _ in range(2)]
    run(bake(bpy.context, armatures[0], calibrated, model, BakeOptions()))
    shared = armatures[0].animation_data.action
    armatures[1].animation_data_create().action = shared
    if hasattr(shared, "slots"):
        armatures[1].animation_data.action_slot = shared.slots[0]
    before = evaluated(armatures[1], ["mixamorig:Hips", "mixamorig:LeftHand"], FRAMES)
    run(bake(bpy.context, armatures[0], calibrated, model, BakeOptions()))
    assert armatures[0].animation_data.action != shared
    assert armatures[1].animation_data.action == shared
    np.testing.assert_array_equal(evaluated(armatures[1], ["mixamorig:Hips", "mixamorig:LeftHand"], FRAMES), before)


# Libraries


@pytest.fixture
def library(tmp_path: Path) -> Path:
    """A file with a rig to link."""
    add_armature(bones_at_rest(sample_called("Mixamo"), "A"))
    path = tmp_path / "library.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    return path


def linked(library: Path) -> bpy.types.Object:
    with bpy.data.libraries.load(str(library), link=True) as (there, here):
        here.objects = there.objects
    bpy.context.scene.collection.objects.link(here.objects[0])
    return here.objects[0]


def test_a_linked_rig_is_refused_with_what_to_do(library, model, calibrated):
    armature = linked(library)
    with pytest.raises(InputError, match=r"linked from .*library\.blend; make a library override") as error:
        run(bake(bpy.context, armature, calibrated, model, BakeOptions()))
    assert "\n" not in str(error.value)
    assert not bpy.data.actions


def test_an_overridden_rig_is_baked_and_keeps_its_action_when_the_file_is_saved(library, model, calibrated, tmp_path):
    armature = linked(library).override_create(remap_local_usages=True)
    report = run(bake(bpy.context, armature, calibrated, model, BakeOptions()))
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    armature = next(obj for obj in bpy.data.objects if obj.override_library)
    assert armature.animation_data.action.name == report.action
    rig = read_rig(armature)
    head = evaluated(armature, [rig.mapping.joints["Head"]], FRAMES)[0, 0, :3, 3]
    np.testing.assert_allclose(head, sampled(calibrated.take, np.zeros(1)).positions[0, 0] * report.scale, atol=1e-3)


def test_a_rig_of_local_bones_and_linked_data_is_baked(library, model, calibrated):
    """The object is the file's own, its armature data the library's: only the rest pose is read."""
    armature = linked(library).copy()
    bpy.context.scene.collection.objects.link(armature)
    report = run(bake(bpy.context, armature, calibrated, model, BakeOptions()))
    assert min(error.share_within_1_cm for error in report.tracker_errors.values()) >= 0.95
