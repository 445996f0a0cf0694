"""Finger posing: the fingers of an armature keep clear of what is around them, as an action of their own above everything else."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import bpy
import numpy as np

from ..errors import InputError
from ..hands.avoid import FingerOptions, FingerResult, avoiding
from ..hands.hand import Hand
from ..hands.model import DEFAULT_HANDS, load_hand_model
from ..hands.obstacle import Obstacle
from ..hands.poses import POSES, controller_pose
from ..hands.sensor import HAND_LENGTH
from ..hands.shapes import Capsules, Union, together
from ..motion.rotations import Array, angle, difference, quat_from_matrix
from ..progress import Progress, part
from ..rigs.fingers import FingerBones, finger_bones, finger_poses, finger_turns, hands_with_fingers, read_before
from ..rigs.rig import SIDES, Rig
from ..rigs.tables import Table
from ..takes.take import Take
from .action import Channel, curves_of, new_action, rotation_channel, scene_rate, unlocked_animation
from .bake import PART
from .colliders import BodyPart, body_parts, fitted_body
from .nla import play_above
from .obstacles import SceneObstacles
from .rig import read_rig, require_editable

FINGERS = "fingers"  # what the actions that are written here are marked with
OWN_ARM = ("Arm", "ForeArm", "Hand")
PIERCED = 1.0  # millimetres that show
REACH = 0.3  # in the hands' own space: what is further from a wrist cannot meet a finger
UNPOSED = np.radians(0.5)  # fingers that never turn by more are at rest, and relax
MEASURED_FRAMES = 120
FOLLOWS = 1.0  # degrees by which the evaluated fingers may be off what was solved


@dataclass(frozen=True)
class PoseOptions:
    """What is posed, and how.

    sides       of SIDES; by default those hands that have fingers
    collection  where the obstacles are; None for everything visible that does not belong to the character
    frames      first and last; None for those of the scene
    solve       strength, grasp, seed
    take        a recording whose triggers and grips the fingers follow; None lets them do what they do now, or relaxes them where that is nothing
    table       the user's map of the rig's bones; None recognises them
    """

    sides: tuple[str, ...] | None = None
    collection: bpy.types.Collection | None = None
    frames: tuple[int, int] | None = None
    solve: FingerOptions = field(default_factory=FingerOptions)
    take: Take | None = None
    table: Table | None = None


@dataclass(frozen=True)
class HandReport:
    """What became of one hand. Depths are those of its deepest finger, millimetres in the scene; frames in which the palm itself is inside are
    counted apart, because fingers cannot mend them."""

    wanted: str
    frames: int
    palm_inside: int
    pierced_before: int
    pierced_after: int
    mean_depth_before_mm: float
    mean_depth_after_mm: float
    max_depth_after_mm: float

    @property
    def summary(self) -> str:
        """In one line."""
        line = f"{self.pierced_before} of {self.frames} frames pierced, {self.pierced_after} do now, {self.max_depth_after_mm:.1f} mm at most"
        return line + (f"; the palm is inside in {self.palm_inside} more" if self.palm_inside else "")


@dataclass(frozen=True)
class FingerReport:
    """What finger posing made.

    obstacles      names of what came near a hand
    hands          by side
    off_by_deg     largest angle between a finger as it is evaluated and as it was solved, over the frames that were measured
    """

    action: str
    frames: int
    first_frame: int
    fps: float
    seconds: float
    obstacles: list[str]
    hands: dict[str, HandReport]
    off_by_deg: float

    @property
    def summary(self) -> str:
        """In one line."""
        met = ", ".join(self.obstacles) or "nothing but the body itself"
        line = f"{self.action}: {self.frames} frames in {self.seconds:.1f} s, near {met}"
        return line + (f"; something else moves the fingers, by {self.off_by_deg:.0f} degrees" if self.off_by_deg > FOLLOWS else "")


def pose_fingers(context: bpy.types.Context, armature: bpy.types.Object, options: PoseOptions) -> Generator[Progress, None, FingerReport]:
    """Poses fingers so that they touch what is around them without piercing it, and writes them as a new action on an NLA track above all others.

    Nothing is changed before the last event. An earlier result of the same fingers is left out of what is read, and gives way to the new one;
    its action stays in the file. InputError if the armature has no fingers or cannot be animated.
    """
    started = time.perf_counter()
    scene = context.scene
    posed = _prepared(armature, options)
    first, last = options.frames or (scene.frame_start, scene.frame_end)
    if last < first:
        raise InputError(f"frames {first} to {last}", "are none; the first must not be after the last")
    frames = np.arange(first, last + 1)
    with _without_earlier(armature):
        seen = yield from part(_read(context, posed, options.collection, frames), 0, 0.3)
    results: dict[str, FingerResult] = {}
    wanted = {side: _wanted(scene, posed, seen, side, frames, options.take) for side in posed.sides}
    model = load_hand_model() if DEFAULT_HANDS.is_dir() else None
    for i, side in enumerate(posed.sides):
        solved = {other: result.angles for other, result in results.items()}
        around = _around(posed, seen, side, {other: angles for other, (_, angles) in wanted.items()} | solved)
        job = avoiding(posed.hands[side], seen.wrists[side], wanted[side][1], around, scene_rate(scene), model, options.solve)
        share = 0.65 / len(posed.sides)
        results[side] = yield from part(job, 0.3 + share * i, 0.3 + share * (i + 1))
    yield Progress(0.95, "writing keys")
    turns = {side: posed.hands[side].turns(result.angles) for side, result in results.items()}
    action = _write(armature, frames, posed, seen, turns)
    off = _off_by(context, posed, frames, turns)
    reports = {side: _report(posed, wanted[side][0], result) for side, result in results.items()}
    seconds = time.perf_counter() - started
    return FingerReport(action.name, len(frames), int(first), scene_rate(scene), seconds, seen.obstacles.names, reports, off)


# What is posed


@dataclass(frozen=True)
class _Posed:
    """An armature and its hands; `unit`: world units per unit of the hands' own space, in which a hand is HAND_LENGTH long."""

    armature: bpy.types.Object
    rig: Rig
    sides: tuple[str, ...]
    fingers: dict[str, FingerBones]
    hands: dict[str, Hand]
    body: list[BodyPart]
    unit: float

    @property
    def bones(self) -> tuple[str, ...]:
        """The bones whose poses are read."""
        of_hands = (bone for fingers in self.fingers.values() for bone in read_before(self.rig, fingers))
        return tuple(dict.fromkeys([*of_hands, *(part.bone for part in self.body), self.rig.mapping.joints["Head"]]))


def _prepared(armature: bpy.types.Object, options: PoseOptions) -> _Posed:
    require_editable(armature)
    if armature.animation_data:
        unlocked_animation(armature)
        if any(track.is_solo for track in armature.animation_data.nla_tracks):
            raise InputError(armature.name, "one of its NLA tracks is played alone; switch that off, or the fingers' own track would not play")
    rig = read_rig(armature, options.table)
    there = hands_with_fingers(rig)
    sides = options.sides or there
    fingers = {side: finger_bones(rig, side) for side in dict.fromkeys((*(sides or SIDES), *there))}
    unit = float(np.mean([hand.length for hand in fingers.values()])) / HAND_LENGTH
    colliders, radii = fitted_body(armature, rig, list(fingers.values()))
    hands = {
        side: Hand.from_rest(side.lower(), bones.positions / unit, own / unit)  # type: ignore[arg-type]
        for (side, bones), own in zip(fingers.items(), radii, strict=True)
    }
    return _Posed(armature, rig, sides, fingers, hands, body_parts(armature, rig, colliders, unit), unit)


# What is read


@dataclass(frozen=True)
class _Seen:
    """The scene over T frames, in the hands' own space.

    rotations  of bones in the armature [T, 4]
    wrists     side -> positions [T, 3] and rotations [T, 4]
    body       what of the character's body is in reach of any hand, by frame: parts and the motion [4, 4] of their bones from rest
    """

    rotations: dict[str, Array]
    wrists: dict[str, tuple[Array, Array]]
    body: list[list[tuple[BodyPart, Array]]]
    obstacles: SceneObstacles


def _read(context: bpy.types.Context, posed: _Posed, collection: bpy.types.Collection | None, frames: np.ndarray) -> Generator[Progress, None, _Seen]:
    """Plays the frames once."""
    rig, bones = posed.rig, posed.bones
    shrink = np.diag([1 / posed.unit] * 3 + [1])
    to_rest = {part: np.linalg.inv(shrink @ rig.object_matrix @ rig.rest[rig.index(part.bone)]) for part in posed.body}
    obstacles = SceneObstacles(posed.armature, collection, posed.unit, REACH)
    local = np.empty((len(frames), len(bones), 4, 4))
    world = np.empty((len(frames), len(bones), 4, 4))
    body: list[list[tuple[BodyPart, Array]]] = []
    place = {bone: i for i, bone in enumerate(bones)}
    at_wrists = [place[fingers.wrist] for fingers in posed.fingers.values()]
    for i, depsgraph in enumerate(_played(context, frames)):
        yield Progress(i / len(frames), f"frame {frames[i]}")
        local[i], world[i] = bone_matrices(posed.armature.evaluated_get(depsgraph), bones)
        world[i] = shrink @ world[i]
        wrists = world[i, at_wrists, :3, 3]
        obstacles.look(depsgraph, wrists, world[i, place[rig.mapping.joints["Head"]], :3, 3])
        moved = [(part, world[i, place[part.bone]] @ to_rest[part]) for part in posed.body]
        body.append([(part, motion) for part, motion in moved if min(_nearest(part, motion, wrist) for wrist in wrists) < REACH])
    rotations = _rotations(local)
    turned = _rotations(world)
    return _Seen(
        rotations={bone: rotations[:, i] for bone, i in place.items()},
        wrists={
            side: (world[:, place[fingers.wrist], :3, 3].astype(np.float32), turned[:, place[fingers.wrist]].astype(np.float32))
            for side, fingers in posed.fingers.items()
        },
        body=body,
        obstacles=obstacles,
    )


def _nearest(part: BodyPart, motion: Array, wrist: Array) -> float:
    """How far a wrist is from a part of the body, at least."""
    return float(np.linalg.norm(motion[:3, :3] @ part.middle + motion[:3, 3] - wrist)) - part.size


def _played(context: bpy.types.Context, frames: np.ndarray) -> Iterator[bpy.types.Depsgraph]:
    """The evaluated scene at each of the frames; the current frame is put back."""
    scene = context.scene
    frame, subframe = scene.frame_current, scene.frame_subframe
    try:
        for at in frames:
            scene.frame_set(int(at))
            yield context.evaluated_depsgraph_get()
    finally:
        scene.frame_set(frame, subframe=subframe)


def bone_matrices(evaluated: bpy.types.Object, bones: tuple[str, ...]) -> tuple[Array, Array]:
    """Matrices [B, 4, 4] of an evaluated armature's bones, in the armature and in the world."""
    columns = np.empty(16 * len(evaluated.pose.bones), dtype=np.float32)
    evaluated.pose.bones.foreach_get("matrix", columns)
    order = [evaluated.pose.bones.find(bone) for bone in bones]
    local = columns.reshape(-1, 4, 4).transpose(0, 2, 1)[order].astype(np.float64)
    return local, np.array(evaluated.matrix_world, dtype=np.float64) @ local


def _rotations(matrices: Array) -> Array:
    """Quaternions of affine matrices [..., 4, 4], whatever their scale."""
    turns = matrices[..., :3, :3]
    return quat_from_matrix(turns / np.linalg.norm(turns, axis=-2, keepdims=True))


def _wanted(scene: bpy.types.Scene, posed: _Posed, seen: _Seen, side: str, frames: np.ndarray, take: Take | None) -> tuple[str, Array]:
    """Which pose the fingers are to have, in a word, and its angles [T, 20]."""
    names = [f"{control}_{side.lower()}" for control in ("trigger", "grip")]
    if take is not None and any(name in take.extras for name in names):
        seconds = (frames - scene.frame_start) / scene_rate(scene)
        pressed = [np.interp(seconds, take.times - take.times[0], take.extras.get(name, np.zeros(len(take)))) for name in names]
        return "controller", controller_pose(*pressed)
    turns = finger_turns(posed.fingers[side], seen.rotations)
    if angle(turns).max() < UNPOSED:
        return "relaxed", np.tile(POSES["relaxed"], (len(frames), 1))
    return "animation", posed.hands[side].angles_from_turns(turns.astype(np.float32))


def _around(posed: _Posed, seen: _Seen, side: str, angles: dict[str, Array]) -> Callable[[int], Obstacle]:
    """What a hand may meet at a frame: the scene, the body without the arm that it is on, and the other hand at its angles [T, 20]."""
    joints = posed.rig.mapping.joints
    own = {joints[side + joint] for joint in OWN_ARM if side + joint in joints}
    others = {other: posed.hands[other].capsules(angles[other], *seen.wrists[other]) for other in angles if other != side}

    def at(frame: int) -> Obstacle:
        wrist = seen.wrists[side][0][frame]
        near = [part.at(motion) for part, motion in seen.body[frame] if part.bone not in own and _nearest(part, motion, wrist) < REACH]
        for other, (starts, ends, radii) in others.items():
            if np.linalg.norm(wrist - seen.wrists[other][0][frame]) < 2 * REACH:
                near.append(Capsules(starts[frame], ends[frame], radii))
        lines = [part for part in near if isinstance(part, Capsules)]
        near = [part for part in near if not isinstance(part, Capsules)] + ([together(lines)] if lines else [])
        scene = seen.obstacles.at(frame)
        return Union((scene, *near)) if near else scene

    return at


# What is written


@contextmanager
def _without_earlier(armature: bpy.types.Object) -> Iterator[None]:
    """Mutes what was written earlier, so that what the user animates is read."""
    tracks = [track for track in _own_tracks(armature) if not track.mute]
    for track in tracks:
        track.mute = True
    try:
        yield
    finally:
        for track in tracks:
            track.mute = False


def _own_tracks(armature: bpy.types.Object) -> list[bpy.types.NlaTrack]:
    """The tracks that finger posing has made."""
    data = armature.animation_data
    tracks = data.nla_tracks if data else ()
    return [track for track in tracks if track.strips and all(strip.action and strip.action.get(PART) == FINGERS for strip in track.strips)]


def _write(armature: bpy.types.Object, frames: np.ndarray, posed: _Posed, seen: _Seen, turns: dict[str, Array]) -> bpy.types.Action:
    """The action of all posed fingers on a track of its own, in the place of earlier ones that hold nothing else."""
    data = unlocked_animation(armature)
    channels = [channel for side in turns for channel in _channels(posed, seen, side, turns[side])]
    action, slot = new_action(armature, f"{armature.name} Fingers", frames, channels)
    action[PART], action.use_fake_user = FINGERS, True
    paths = {channel.data_path for channel in channels}
    for track in _own_tracks(armature):
        earlier = {curve.data_path for strip in track.strips for curve in curves_of(strip.action, getattr(strip, "action_slot", None))}
        if earlier <= paths:
            data.nla_tracks.remove(track)
    play_above(armature, action, slot, frames)
    return action


def _channels(posed: _Posed, seen: _Seen, side: str, turns: Array) -> Iterator[Channel]:
    for pose in finger_poses(posed.rig, posed.fingers[side], turns, seen.rotations):
        yield rotation_channel(posed.armature.pose.bones[pose.bone], pose.rotation)


def _off_by(context: bpy.types.Context, posed: _Posed, frames: np.ndarray, turns: dict[str, Array]) -> float:
    """Largest angle, degrees, between the fingers as Blender evaluates them now and turns [T, 15, 4], over MEASURED_FRAMES."""
    chosen = np.unique(np.linspace(0, len(frames) - 1, MEASURED_FRAMES).round().astype(int))
    bones = posed.bones
    evaluated = [bone_matrices(posed.armature.evaluated_get(depsgraph), bones)[0] for depsgraph in _played(context, frames[chosen])]
    rotations = dict(zip(bones, _rotations(np.stack(evaluated, axis=1)), strict=True))
    apart = [difference(finger_turns(posed.fingers[side], rotations), wanted[chosen]).max() for side, wanted in turns.items()]
    return float(np.degrees(max(apart)))


def _report(posed: _Posed, wanted: str, result: FingerResult) -> HandReport:
    free = ~result.palm_inside
    before, after = (1000 * posed.unit * np.maximum(depths[free], 0) for depths in (result.depth_before, result.depth_after))
    return HandReport(
        wanted=wanted,
        frames=len(free),
        palm_inside=int((~free).sum()),
        pierced_before=int((before > PIERCED).sum()),
        pierced_after=int((after > PIERCED).sum()),
        mean_depth_before_mm=float(before.mean()) if len(before) else 0.0,
        mean_depth_after_mm=float(after.mean()) if len(after) else 0.0,
        max_depth_after_mm=float(after.max(initial=0)),
    )
