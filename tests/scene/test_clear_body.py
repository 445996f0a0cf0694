"""Bodies that make way in a scene: what Blender evaluates afterwards pierces nothing, and what the user animated is as it was."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import bpy
import numpy as np
import pytest
from mathutils import Matrix

from cbm_addon.body.avoid import BodyOptions
from cbm_addon.cli import main
from cbm_addon.errors import InputError
from cbm_addon.hands.shapes import Box
from cbm_addon.motion.motion import Motion
from cbm_addon.motion.resample import frame_times, resample
from cbm_addon.motion.rotations import quat_from_rotvec, quat_from_yaw
from cbm_addon.motion.thickness import HEAD, SKULL
from cbm_addon.motion.transfer import transfer
from cbm_addon.progress import run
from cbm_addon.rigs.body import rig_body
from cbm_addon.scene.action import curves_of, write_action
from cbm_addon.scene.bake import rig_channels
from cbm_addon.scene.body import BodyReport, ClearOptions, clear_body
from cbm_addon.scene.rig import read_rig
from cbm_addon.takes.sample_motion import sample_motion
from tests.hand_scenes import evaluated_matrices, strip_curves
from tests.sample_rigs import SAMPLE_RIGS, add_armature, bones_at_rest, renamed, transform

RATE, FIRST, FRAMES = 24, 11, 60
MET = 36  # frames after the first in which the head is under the beam
PIERCED = 0.01  # metres of a person of ordinary size that are called so


def sample(name: str, pose: str = "A", scale: float = 1.0, object_matrix: np.ndarray | None = None) -> bpy.types.Object:
    return add_armature(bones_at_rest(next(sample for sample in SAMPLE_RIGS if sample.name == name), pose, object_matrix, scale))


@dataclass(frozen=True)
class Walker:
    """An armature that walks, as a user animated it.

    size     what a metre of an adult is for it
    upright  the head bone's world matrix [4, 4] in the rest pose, in which the head is upright
    tall     height of the head joint above the ankles, by which a rig without skin is thick
    """

    armature: bpy.types.Object
    bones: dict[str, str]
    size: float
    upright: np.ndarray
    tall: float

    @classmethod
    def of(cls, armature: bpy.types.Object) -> Walker:
        rig = read_rig(armature)
        bones = rig.mapping.joints
        head, feet = rig.head(bones["Head"]), [rig.head(bones[f"{side}Foot"]) for side in ("Left", "Right")]
        upright = rig.object_matrix @ rig.rest[rig.index(bones["Head"])]
        return cls(armature, bones, rig_body(rig).body.height_above_toes() / 1.6, upright, head[2] - min(foot[2] for foot in feet))

    def heads(self, *joints: str, frames: np.ndarray | None = None) -> np.ndarray:
        """Where bones begin [T, J, 3], as Blender evaluates them."""
        return self.matrices(*joints, frames=frames)[..., :3, 3]

    def matrices(self, *joints: str, frames: np.ndarray | None = None) -> np.ndarray:
        names = [self.bones[joint] for joint in joints or self.bones]
        found = evaluated_matrices(self.armature, names, FIRST + np.arange(FRAMES) if frames is None else frames)
        return np.stack(list(found.values()), 1)


def walking(armature: bpy.types.Object, root: str = "hips", limbs: str = "fk") -> Walker:
    """The armature walks over the scene's origin, 2.5 s of the procedural walk; its action is the user's."""
    scene = bpy.context.scene
    scene.render.fps, scene.frame_start, scene.frame_end = RATE, FIRST, FIRST + FRAMES - 1
    walker, rig = Walker.of(armature), read_rig(armature)
    solved = rig_body(rig)
    walk = resample(sample_motion(), frame_times(2.5, 2.5 + FRAMES / RATE, RATE))
    walk = Motion(walk.skeleton, walk.times[:FRAMES], walk.root[:FRAMES], walk.rotations[:FRAMES])
    motion = transfer(walk, solved.body, solved.body.height_above_toes() / walk.skeleton.height_above_toes())
    write_action(armature, "user", FIRST + np.arange(FRAMES), list(rig_channels(armature, rig, solved, motion, root=root, limbs=limbs)), fake_user=False)
    bpy.context.view_layer.update()
    return walker


def add_box(name: str, centre: np.ndarray, half: np.ndarray) -> Box:
    """A mesh in the scene, and the same as a shape."""
    bpy.ops.mesh.primitive_cube_add(size=2, location=centre)
    bpy.context.object.name, bpy.context.object.scale = name, half
    bpy.context.view_layer.update()
    return Box(np.asarray(centre, np.float32), np.asarray(half, np.float32))


def add_beam(walker: Walker, above: float = 0.14) -> Box:
    """Across the way, its underside so many metres above the head joint where the walker passes: lower than the top of the head."""
    head = walker.heads("Head", frames=np.array([FIRST + MET]))[0, 0]
    return add_box("Beam", head + walker.size * np.array([0, 0, above + 0.1]), walker.size * np.array([1.2, 0.1, 0.1]))


def skull_depths(walker: Walker, solid: Box, frames: np.ndarray | None = None) -> np.ndarray:
    """How deep the head is in a solid in each frame [T], metres of a person of ordinary size: the balls along its axis, carried by the bone."""
    matrices = walker.matrices("Head", frames=frames)[:, 0] @ np.linalg.inv(walker.upright)
    deepest = np.full(len(matrices), -np.inf)
    for share in np.linspace(0, 1, 8):
        centre = walker.upright[:3, 3] + [0, 0, walker.tall * (SKULL[0] + share * (SKULL[1] - SKULL[0]))]
        radius = walker.tall * (HEAD[0] + share * (HEAD[1] - HEAD[0]))
        points = matrices[:, :3, :3] @ centre + matrices[:, :3, 3]
        deepest = np.maximum(deepest, radius - solid.nearest(points.astype(np.float32))[0])
    return deepest / walker.size


def clear(armature: bpy.types.Object, **options) -> BodyReport:
    return run(clear_body(bpy.context, armature, ClearOptions(**options)))


def keys_of(action: bpy.types.Action) -> dict[tuple[str, int], list[tuple[float, float]]]:
    slot = action.slots[0] if hasattr(action, "slots") else None
    return {(curve.data_path, curve.array_index): [tuple(point.co) for point in curve.keyframe_points] for curve in curves_of(action, slot)}


def strips_of(armature: bpy.types.Object) -> list[str]:
    """Actions that play, from the lowest track to the highest."""
    return [strip.action.name for track in armature.animation_data.nla_tracks if not track.mute for strip in track.strips]


def y_up(armature: bpy.types.Object) -> bpy.types.Object:
    """The same armature in the world, with an object that is turned and scaled, as FBX files bring them."""
    matrix = Matrix(transform(quat_from_rotvec(np.array([0.5 * np.pi, 0, 0])), np.zeros(3), 0.01))
    armature.data.transform(matrix.inverted())
    armature.matrix_world = matrix
    bpy.context.view_layer.update()
    return armature


RIGS: dict[str, Callable[[], bpy.types.Object]] = {
    "Mixamo": lambda: sample("Mixamo"),
    "Unreal 5, arms hanging": lambda: sample("Unreal 5", "hanging"),
    "VRM, a child": lambda: sample("VRM 1", "T", 0.6),
    "Mixamo in centimetres, Y up": lambda: y_up(sample("Mixamo", "T")),
    "motion capture, another way to face": lambda: sample("motion capture", "T", 1.0, transform(quat_from_yaw(np.asarray(0.9)), np.array([2.0, 1, 0]))),
    "bones without names": lambda: add_armature(renamed(bones_at_rest(next(sample for sample in SAMPLE_RIGS if sample.name == "Unreal 5"), "A"))),
}


@pytest.fixture
def mixamo(empty_scene: bpy.types.Scene) -> Walker:
    return walking(sample("Mixamo"))


def assert_cleared(armature: bpy.types.Object, root: str = "hips", limbs: str = "fk") -> None:
    walker = walking(armature, root, limbs)
    bpy.context.scene.frame_set(FIRST + MET)
    beam = add_beam(walker)
    before, places = skull_depths(walker, beam), walker.heads("LeftFoot", "RightFoot", "LeftHand", "RightHand")
    assert before.max() > 0.05, "the scene must have something to mend"
    report = clear(armature)
    assert report.obstacles == ["Beam"]
    after, moved = skull_depths(walker, beam), np.linalg.norm(walker.heads("LeftFoot", "RightFoot", "LeftHand", "RightHand") - places, axis=-1)
    assert after.max() < PIERCED
    assert report.pierced_before == pytest.approx((before > PIERCED).sum(), abs=1)
    assert report.pierced_after == 0
    assert report.max_depth_after_cm == pytest.approx(100 * max(0, after.max()), abs=0.3)
    speed = np.linalg.norm(np.gradient(places[:, :2], axis=0), axis=-1) * RATE / walker.size
    assert moved[:, :2][speed < 0.05].max() < 0.01 * walker.size, "feet that stand stay"
    assert moved[:, 2:].max() < 0.05 * walker.size, "wrists are free and stay with their trackers"
    assert moved.max() > 0


@pytest.mark.parametrize("add", RIGS.values(), ids=RIGS)
def test_a_head_that_was_in_a_beam_is_under_it(empty_scene, add):
    assert_cleared(add())


def test_a_metarig_ducks(metarig):
    assert_cleared(metarig)


@pytest.mark.parametrize("limbs", ["fk", "ik"])
def test_a_generated_rig_ducks(human, limbs):
    """Whichever of its controls the user animated."""
    assert_cleared(human, limbs=limbs)


@pytest.mark.parametrize("root", ["object", "bone"])
def test_what_carries_the_body_along_goes_on_carrying_it(empty_scene, root):
    """The way is on the armature's object or on the bone above its hips, and the current frame is in the middle of it."""
    armature = sample("Unreal 4", object_matrix=transform(quat_from_yaw(np.asarray(0.4)), np.array([0.3, 0, 0])))
    assert_cleared(armature, root)
    action = armature.animation_data.nla_tracks[-1].strips[0].action
    hips = [values for (path, _), values in keys_of(action).items() if path == f'pose.bones["{read_rig(armature).mapping.joints["Hips"]}"].location']
    assert max(np.ptp([value for _, value in keys]) for keys in hips) < 0.5, "hips that are carried go nowhere by themselves"
    again = clear(armature)
    assert again.pierced_after == 0


def test_the_users_action_is_as_it_was_and_plays_below(mixamo):
    user = mixamo.armature.animation_data.action
    add_beam(mixamo)
    before = keys_of(user)
    report = clear(mixamo.armature)
    assert keys_of(user) == before
    assert set(strips_of(mixamo.armature)) == {"user", report.action}
    assert strips_of(mixamo.armature)[0] == "user"


def test_frames_outside_the_strips_are_as_before_and_nothing_pops_at_their_ends(mixamo):
    add_beam(mixamo)
    before = mixamo.matrices()
    clear(mixamo.armature)
    after = mixamo.matrices()
    ours = list(mixamo.armature.animation_data.nla_tracks[-1].strips)
    inside = np.zeros(FRAMES, bool)
    for strip in ours:
        inside[int(strip.frame_start) - FIRST : int(strip.frame_end) - FIRST + 1] = True
    assert inside[MET]
    assert (~inside).sum() > 10
    np.testing.assert_allclose(after[~inside], before[~inside], atol=1e-5)
    shift = (after - before)[..., :3, 3]
    assert np.abs(shift[inside]).max() > 0.03
    assert np.linalg.norm(np.diff(shift, axis=0), axis=-1).max() < 0.05
    edges = np.flatnonzero(np.diff(inside.astype(int)))
    assert np.linalg.norm(np.diff(shift, axis=0)[edges], axis=-1).max() < 2e-3


def test_what_the_user_posed_without_a_key_stays_where_no_strip_is(mixamo):
    """A bone that no curve moves keeps what the user gave it by hand, also outside of the strips that key it."""
    armature, bone = mixamo.armature, mixamo.bones["Spine1"]
    strip_curves(armature, lambda curve: f'"{bone}"' in curve.data_path)
    armature.pose.bones[bone].rotation_mode = "QUATERNION"
    armature.pose.bones[bone].rotation_quaternion = quat_from_rotvec(np.array([0, 0.2, 0.0]))
    add_beam(mixamo)
    before = mixamo.matrices()
    for _ in range(2):
        clear(armature)
        bpy.context.scene.frame_set(FIRST + MET)
        after = mixamo.matrices(frames=np.array([FIRST, FIRST + MET, FIRST + 3]))
        np.testing.assert_allclose(after[[0, 2]], before[[0, 3]], atol=1e-5)
        assert np.abs(after[1] - before[MET])[..., :3, 3].max() > 0.03


def test_limbs_that_the_user_switched_to_fk_without_a_key_stay_fk(human):
    """The switch of a generated rig has IK for its default."""
    walker = walking(human)
    strip_curves(human, lambda curve: "IK_FK" in curve.data_path)
    switched = [bone for bone in human.pose.bones if "IK_FK" in bone]
    for bone in switched:
        bone["IK_FK"] = 1.0
    add_beam(walker)
    before = walker.matrices()
    clear(human)
    assert len(switched) == 4
    np.testing.assert_allclose(walker.matrices(frames=np.array([FIRST + MET, FIRST, FIRST + 3]))[1:], before[[0, 3]], atol=1e-5)


def test_running_it_again_reads_the_users_animation_and_leaves_one_track(mixamo):
    beam = add_beam(mixamo)
    first = clear(mixamo.armature)
    posed = skull_depths(mixamo, beam)
    again = clear(mixamo.armature)
    assert again.pierced_before == first.pierced_before > 0
    np.testing.assert_allclose(skull_depths(mixamo, beam), posed, atol=1e-4)
    assert [track.name for track in mixamo.armature.animation_data.nla_tracks] == ["user", again.action]
    assert first.action in bpy.data.actions


def test_a_beam_that_was_taken_away_takes_the_correction_with_it(mixamo):
    before = mixamo.matrices()
    add_beam(mixamo)
    clear(mixamo.armature)
    bpy.data.objects.remove(bpy.data.objects["Beam"])
    report = clear(mixamo.armature)
    assert report.action == ""
    assert strips_of(mixamo.armature) == ["user"]
    np.testing.assert_allclose(mixamo.matrices(), before, atol=1e-5)


def test_a_floor_alone_changes_nothing(mixamo):
    before = mixamo.matrices()
    bpy.ops.mesh.primitive_plane_add(size=20, location=(0, 0, mixamo.heads("LeftToe", "RightToe")[..., 2].min() - 0.025))
    report = clear(mixamo.armature)
    assert report.action == ""
    assert report.summary == f"the body meets nothing in {FRAMES} frames"
    assert not mixamo.armature.animation_data.nla_tracks
    assert mixamo.armature.animation_data.action.name == "user"
    np.testing.assert_array_equal(mixamo.matrices(), before)


def test_strength_zero_changes_nothing(mixamo):
    add_beam(mixamo)
    report = clear(mixamo.armature, solve=BodyOptions(strength=0))
    assert (report.action, report.pierced_after) == ("", report.pierced_before)
    assert strips_of(mixamo.armature) == []


def test_the_same_seed_gives_the_same_keys(mixamo):
    add_beam(mixamo)
    first, again = (keys_of(bpy.data.actions[clear(mixamo.armature, solve=BodyOptions(seed=3)).action]) for _ in range(2))
    assert first == again


def test_only_the_collection_is_in_the_way_if_one_is_chosen(mixamo):
    add_beam(mixamo)
    walls = bpy.data.collections.new("Walls")
    bpy.context.scene.collection.children.link(walls)
    assert clear(mixamo.armature, collection=walls).action == ""
    walls.objects.link(bpy.data.objects["Beam"])
    assert clear(mixamo.armature, collection=walls).pierced_before > 0


def test_only_the_frames_that_are_asked_for_are_changed(mixamo):
    add_beam(mixamo)
    before = mixamo.matrices()
    report = clear(mixamo.armature, frames=(FIRST + MET - 2, FIRST + MET + 3))
    assert (report.first_frame, report.frames) == (FIRST + MET - 2, 6)
    changed = np.abs(mixamo.matrices() - before).max((1, 2, 3)) > 1e-4
    assert changed[MET - 2 : MET + 4].all()
    assert not changed[: MET - 2].any()
    assert not changed[MET + 4 :].any()


def test_a_single_frame_can_be_cleared(mixamo):
    beam, met = add_beam(mixamo), np.array([FIRST + MET])
    report = clear(mixamo.armature, frames=(FIRST + MET, FIRST + MET))
    assert (report.frames, report.pierced_before, report.pierced_after) == (1, 1, 0)
    assert skull_depths(mixamo, beam, met).max() < PIERCED


def test_a_moving_obstacle_is_met_where_it_is(mixamo):
    """A box comes down on somebody who stands in the way."""
    heads = mixamo.heads("Head")[:, 0]
    add_box("Falling", np.zeros(3), np.array([0.3, 0.3, 0.1]))
    thing = bpy.data.objects["Falling"]
    places = heads + [0, 0, 0.24]
    places[:, 2] += 0.004 * np.abs(np.arange(FRAMES) - MET) + 0.02
    for frame, place in enumerate(places):
        thing.location = place
        thing.keyframe_insert("location", frame=FIRST + frame)
    boxes = [Box(place.astype(np.float32), np.array([0.3, 0.3, 0.1], np.float32)) for place in places]

    def deepest() -> float:
        return max(skull_depths(mixamo, box, np.array([FIRST + frame]))[0] for frame, box in enumerate(boxes))

    before = deepest()
    report = clear(mixamo.armature)
    assert report.obstacles == ["Falling"]
    assert before > 0.02
    assert deepest() < PIERCED


def test_cancelling_changes_nothing(mixamo):
    add_beam(mixamo)
    clear(mixamo.armature)
    tracks = [(track.name, track.mute) for track in mixamo.armature.animation_data.nla_tracks]
    actions, frame = bpy.data.actions.keys(), bpy.context.scene.frame_current
    for events in (1, FRAMES // 2, FRAMES + 3):
        job = clear_body(bpy.context, mixamo.armature, ClearOptions())
        for _ in range(events):
            next(job)
        job.close()
        assert [(track.name, track.mute) for track in mixamo.armature.animation_data.nla_tracks] == tracks
        assert (bpy.data.actions.keys(), bpy.context.scene.frame_current) == (actions, frame)


def test_an_armature_that_nothing_animates_is_cleared_too(empty_scene):
    armature = sample("Mixamo")
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = 1, 3
    size = read_rig(armature).head("mixamorig:Head")[2]
    beam = add_box("Beam", np.array([0, 0, size + 0.22]), np.array([1.0, 0.3, 0.1]))
    walker = Walker.of(armature)
    report = clear(armature)
    assert report.pierced_before == 3
    assert skull_depths(walker, beam, np.arange(1, 4)).max() < PIERCED


def test_what_cannot_be_cleared_is_refused_in_one_line_before_anything_changes(mixamo):
    add_beam(mixamo)
    for options, message in (({"frames": (9, 3)}, "frames 9 to 3: are none"),):
        with pytest.raises(InputError, match=message):
            clear(mixamo.armature, **options)
    clear(mixamo.armature)
    mixamo.armature.animation_data.nla_tracks[0].is_solo = True
    with pytest.raises(InputError, match="played alone") as caught:
        clear(mixamo.armature)
    assert "\n" not in str(caught.value)
    bpy.ops.object.armature_add()
    stick = bpy.context.object
    with pytest.raises(InputError) as caught:
        clear(stick)
    assert "\n" not in str(caught.value)
    assert stick.animation_data is None


# The command and the operator


@pytest.fixture
def folder(empty_scene: bpy.types.Scene, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working folder with the file scene.blend, in which Hero has fingers and Bare has none."""
    for name, kind in (("Bare", "CMU"), ("Hero", "Mixamo")):
        armature = sample(kind)
        armature.name = name
        walker = walking(armature)
    add_beam(walker)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(("rig", "hands"), [("Hero", ["Left", "Right"]), ("Bare", None)])
def test_the_command_clears_the_body_and_then_the_fingers_if_there_are_any(folder, capsys, rig, hands):
    content = (folder / "scene.blend").read_bytes()
    argv = ["fingers", "--body", "--blend", "scene.blend", "--rig", rig, "-o", "out.blend", "--json", "out.json", "--hold", "0.5"]
    assert main(argv) == 0
    assert (folder / "scene.blend").read_bytes() == content
    report = json.loads((folder / "out.json").read_text())
    assert report["body"]["pierced_before"] > report["body"]["pierced_after"] == 0
    assert (list(report["hands"]) if "hands" in report else None) == hands
    assert "body: " in capsys.readouterr().out
    bpy.ops.wm.open_mainfile(filepath=str(folder / "out.blend"))
    playing = strips_of(bpy.data.objects[rig])
    assert playing[0].startswith("user")
    assert playing[1] == report["body"]["action"]
    assert len(set(playing)) == (3 if hands else 2)


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["--hold", "-1"], "--hold: is -1; it is from 0"),
        (["--strength", "2"], "--strength: is 2; it is from 0 to 1"),
        (["--frames", "9:3"], "frames 9 to 3: are none"),
        (["--obstacles", "Walls"], "Walls: is not a collection of this file"),
    ],
)
def test_the_command_refuses_in_one_line_and_writes_nothing(folder, capsys, argv, message):
    assert main(["fingers", "--body", "--blend", "scene.blend", "--rig", "Hero", "-o", "out.blend", "--quiet", *argv]) == 2
    said = [line for line in capsys.readouterr().err.splitlines() if line.startswith("error: ")]
    assert len(said) == 1
    assert message in said[0]
    assert {path.name for path in folder.iterdir()} == {"scene.blend"}


def test_the_operator_clears_the_panels_rig_and_says_what_became_of_it(extension: ModuleType):
    walker = walking(sample("Mixamo"))
    beam = add_beam(walker)
    settings = bpy.context.scene.cbm
    settings.rig = walker.armature
    settings.fingers.use_range, settings.fingers.frame_start, settings.fingers.frame_end = True, FIRST, FIRST + FRAMES - 1
    assert bpy.ops.cbm.clear_body() == {"FINISHED"}
    assert skull_depths(walker, beam).max() < PIERCED
    assert f"of {FRAMES} frames pierced, 0 do now" in settings.fingers.body_summary
    assert len(settings.fingers.body_summary.splitlines()) == 1
    settings.fingers.strength = 0
    assert bpy.ops.cbm.clear_body() == {"FINISHED"}
    assert skull_depths(walker, beam).max() > 0.05


def test_the_operator_says_what_is_missing(extension: ModuleType):
    with pytest.raises(RuntimeError, match="choose an armature"):
        bpy.ops.cbm.clear_body()
    bpy.ops.object.armature_add()
    with pytest.raises(RuntimeError):
        bpy.ops.cbm.clear_body(rig=bpy.context.object.name)
    assert not bpy.data.actions
