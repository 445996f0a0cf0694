"""Finger posing: the fingers of an armature keep clear of what is around them, as an action of their own above everything else."""

from __future__ import annotations

import time
from collections.abc import Generator, Iterator
from dataclasses import dataclass, field

import bpy
import numpy as np

from ..errors import InputError
from ..hands.avoid import FingerOptions, FingerResult, avoiding
from ..hands.model import load_hand_model
from ..hands.poses import POSES, controller_pose
from ..motion.rotations import Array, angle, quat_between, rotate
from ..progress import Progress, part
from ..rigs.fingers import finger_poses, finger_turns, hands_with_fingers
from ..rigs.tables import Table
from ..takes.take import Take
from .action import Channel, new_action, rotation_channel, scene_rate, unlocked_animation
from .bake import PART
from .layers import remove_earlier, require_layer, without_earlier
from .nla import play_above
from .rig import read_rig
from .rigged_hands import RiggedHands, Surroundings, bone_matrices, obstacles_of, played, rigged_hands, rotations_of

FINGERS = "fingers"  # what the actions that are written here are marked with
PIERCED = 1.0  # millimetres that show
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
    require_layer(armature)
    rigged = rigged_hands(armature, options.sides, options.table)
    first, last = options.frames or (scene.frame_start, scene.frame_end)
    if last < first:
        raise InputError(f"frames {first} to {last}", "are none; the first must not be after the last")
    frames = np.arange(first, last + 1)
    seen = Surroundings(rigged, obstacles_of(rigged, options.collection))
    with without_earlier(armature, FINGERS):
        for i, depsgraph in enumerate(played(context, frames)):
            yield Progress(0.3 * i / len(frames), f"reading frame {frames[i]}")
            seen.look(depsgraph)
    wanted = {side: _wanted(scene, rigged, seen, side, frames, options.take) for side in rigged.hands}
    angles = {side: wished for side, (_, wished) in wanted.items()}
    model = load_hand_model()
    results: dict[str, FingerResult] = {}
    share = 0.65 / len(rigged.sides)
    for i, side in enumerate(rigged.sides):
        job = avoiding(rigged.hands[side], seen.wrists[side], angles[side], seen.around(side, angles), scene_rate(scene), model, options.solve)
        results[side] = yield from part(job, 0.3 + share * i, 0.3 + share * (i + 1))
        angles[side] = results[side].angles
    yield Progress(0.95, "writing keys")
    turns = {side: rigged.hands[side].turns(result.angles) for side, result in results.items()}
    action = _write(rigged, frames, seen, turns)
    off = _off_by(context, rigged, frames, turns)
    reports = {side: _report(rigged.unit, wanted[side][0], result) for side, result in results.items()}
    seconds = time.perf_counter() - started
    return FingerReport(action.name, len(frames), int(first), scene_rate(scene), seconds, seen.obstacles.names, reports, off)


def has_fingers(armature: bpy.types.Object, table: Table | None = None) -> bool:
    """Whether there is a hand whose fingers can be posed."""
    return bool(hands_with_fingers(read_rig(armature, table)))


def _wanted(scene: bpy.types.Scene, rigged: RiggedHands, seen: Surroundings, side: str, frames: np.ndarray, take: Take | None) -> tuple[str, Array]:
    """Which pose the fingers are to have, in a word, and its angles [T, 20]."""
    names = [f"{control}_{side.lower()}" for control in ("trigger", "grip")]
    if take is not None and any(name in take.extras for name in names):
        seconds = (frames - scene.frame_start) / scene_rate(scene)
        pressed = [np.interp(seconds, take.times - take.times[0], take.extras.get(name, np.zeros(len(take)))) for name in names]
        return "controller", controller_pose(*pressed)
    turns = seen.turns(side)
    if angle(turns).max() < UNPOSED:
        return "relaxed", np.tile(POSES["relaxed"], (len(frames), 1))
    return "animation", rigged.hands[side].angles_from_turns(turns.astype(np.float32))


# What is written


def _write(rigged: RiggedHands, frames: np.ndarray, seen: Surroundings, turns: dict[str, Array]) -> bpy.types.Action:
    """The action of all posed fingers on a track of its own, in the place of earlier ones that hold nothing else."""
    armature = rigged.armature
    unlocked_animation(armature)
    channels = [channel for side in turns for channel in _channels(rigged, seen, side, turns[side])]
    action, slot = new_action(armature, f"{armature.name} Fingers", frames, channels)
    action[PART], action.use_fake_user = FINGERS, True
    paths = {channel.data_path for channel in channels}
    remove_earlier(armature, FINGERS, paths)
    play_above(armature, action, slot, frames)
    return action


def _channels(rigged: RiggedHands, seen: Surroundings, side: str, turns: Array) -> Iterator[Channel]:
    for pose in finger_poses(rigged.rig, rigged.fingers[side], turns, seen.rotations):
        yield rotation_channel(rigged.armature.pose.bones[pose.bone], pose.rotation)


def _off_by(context: bpy.types.Context, rigged: RiggedHands, frames: np.ndarray, turns: dict[str, Array]) -> float:
    """Largest angle, degrees, between where phalanges point as Blender evaluates them now and at turns [T, 15, 4], over MEASURED_FRAMES."""
    chosen = np.unique(np.linspace(0, len(frames) - 1, MEASURED_FRAMES).round().astype(int))
    bones = rigged.bones
    evaluated = [bone_matrices(rigged.armature.evaluated_get(depsgraph), bones)[0] for depsgraph in played(context, frames[chosen])]
    rotations = dict(zip(bones, rotations_of(np.stack(evaluated, axis=1)), strict=True))
    apart = []
    for side, solved in turns.items():
        fingers = rigged.fingers[side]
        pointing = (rotate(of, fingers.directions) for of in (finger_turns(fingers, rotations), solved[chosen]))
        apart.append(angle(quat_between(*pointing)).max())
    return float(np.degrees(max(apart)))


def _report(unit: float, wanted: str, result: FingerResult) -> HandReport:
    free = ~result.palm_inside
    before, after = (1000 * unit * np.maximum(depths[free], 0) for depths in (result.before, result.after))
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
