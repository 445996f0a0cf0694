"""The bake: a calibrated take becomes a new action on an armature."""

from __future__ import annotations

import time
from collections.abc import Generator, Iterator
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Literal

import bpy
import mathutils
import numpy as np

from ..errors import InputError
from ..motion.motion import Motion
from ..motion.resample import frame_times
from ..motion.rotations import Array
from ..progress import Progress, part
from ..rigs.body import RigBody, rig_body
from ..rigs.limbs import Limbs, hinged, limb_settings, pole_poses, require_limbs, ways
from ..rigs.pose import BonePose, bone_poses
from ..rigs.rig import Rig
from ..rigs.tables import Table
from ..rigs.travel import Root, object_matrices, root_bone, root_pose, way_over_ground, without_way
from ..solve.fuse import UpperBody, fusing
from ..solve.models import Model
from ..solve.perform import SolveOptions, calibration_warnings, perform, sampled
from ..takes.calibrate import Calibrated
from ..takes.synthesize import TRACKED_JOINTS
from ..takes.take import DEVICES
from .action import (
    Channel,
    animated_paths,
    location_channel,
    object_channels,
    pose_path,
    require_free,
    rotation_channel,
    scene_frames,
    scene_rate,
    setting_path,
    write_action,
)
from .kept import Kept, posed_at, reading_upper_body
from .nla import PART, play_below, play_upper, push_down
from .reduction import Reduction, ReductionReport, reducing_channels
from .rig import read_rig, require_editable

MEASURED_FRAMES = 120  # on how many frames the evaluated rig is compared with the trackers
CLOSE = 0.01  # metres
APART = 0.25  # head heights that the head of an animation may be from the take's if it is to stay where it is


@dataclass(frozen=True)
class BakeOptions:
    """How a take is put on a rig.

    part   "full", or "lower": hips and legs follow the take. Under an animation that is where the take is, head and wrists stay where they are,
           and what is between them and the hips is keyed to allow it; else hips and legs alone are keyed, and carry what is above them along
    root   what carries the way over the ground: the hips, a bone above them, the armature's object, or nothing ("in-place")
    table  the user's map of the rig's bones; None recognises them
    limbs  which kinematics of the limbs are keyed, of a rig that has both: "fk", "ik", or "both", which agree
    reduction  how much the keys may be thinned; None keys every frame
    fake_user  whether the new action is kept when nothing uses it
    push_down  whether the action that the armature had becomes a muted NLA track
    """

    part: Literal["full", "lower"] = "full"
    solve: SolveOptions = field(default_factory=SolveOptions)
    root: Root = "hips"
    table: Table | None = None
    limbs: Limbs = "fk"
    reduction: Reduction | None = None
    fake_user: bool = True
    push_down: bool = False


@dataclass(frozen=True)
class TrackerError:
    """How far a joint of the evaluated rig is from its tracker (part "lower": from where the animation had it), over the frames that were measured."""

    median_cm: float
    p95_cm: float
    max_cm: float
    share_within_1_cm: float


@dataclass(frozen=True)
class BakeReport:
    """What a bake made.

    scale              of the take, about the world origin, to the rig's size
    seconds            that the bake took (of several variations, its share), of which `frames_per_second` follows
    measured_frames    frames on which the evaluated rig was compared with the scaled trackers
    tracker_errors     by device; empty in place, and of a lower body that carries the upper one along
    reduction          what was thinned, if that was asked for
    warnings           what looks wrong with the calibration to the model, a sentence each
    """

    action: str
    variation: int
    frames: int
    fps: float
    scale: float
    seconds: float
    frames_per_second: float
    measured_frames: int
    tracker_errors: dict[str, TrackerError]
    reduction: ReductionReport | None = None
    warnings: tuple[str, ...] = ()


def bake(
    context: bpy.types.Context, armature: bpy.types.Object, calibrated: Calibrated, model: Model, options: BakeOptions
) -> Generator[Progress, None, BakeReport]:
    """Solves a take on the armature's own proportions and writes it as a new action; take time 0 is the scene's start frame.

    Nothing is changed before the last event. Then the armature has the new action; the one it had stays in the file, and with part "lower"
    it goes on as an NLA strip below. InputError if the armature cannot be baked onto.
    """
    reports = yield from bake_variations(context, armature, calibrated, model, options, 1)
    return reports[0]


def bake_variations(
    context: bpy.types.Context, armature: bpy.types.Object, calibrated: Calibrated, model: Model, options: BakeOptions, count: int
) -> Generator[Progress, None, list[BakeReport]]:
    """The same for so many variations from that of the options on, each an action; the armature is left with the first."""
    started = time.perf_counter()
    scene = context.scene
    require_editable(armature)
    if options.part == "lower" and options.root != "hips":
        raise InputError(options.root, "cannot carry the way of the lower body alone, since the upper body would follow; keep it on the hips")
    rig = read_rig(armature, options.table)
    require_carrier(armature, rig, options.root)
    require_limbs(rig, options.limbs)
    solved = rig_body(rig)
    scale = take_scale(solved, calibrated)
    times = frame_times(calibrated.take.times[0], calibrated.take.times[-1], scene_rate(scene))
    frames = scene_frames(scene, times, scene.frame_start)
    trackers = sampled(calibrated.take, times).positions * scale
    kept, read = None, 0.2 if options.part == "lower" else 0.0
    if options.part == "lower":
        kept = yield from part(reading_upper_body(context, armature, rig, solved, frames), 0, read)
    if kept and not _together(kept.positions, trackers, solved):
        kept = None
    trackers = kept.positions if kept else trackers
    warnings = tuple(calibration_warnings(calibrated.take, calibrated.calibration.head_height, model, options.solve))
    made = []
    for i in range(count):
        solve = replace(options.solve, variation=options.solve.variation + i)
        job = _animated(scene, armature, rig, solved, calibrated, model, replace(options, solve=solve), kept)
        start, end = (read + (0.95 - read) * share / count for share in (i, i + 1))
        made.append((solve.variation, *(yield from part(job, start, end))))
    yield Progress(0.95, "writing keys")
    reports = []
    for variation, channels, thinned in reversed(made):
        lower, upper = _parted(rig, channels) if kept else (channels, [])
        action = _write(armature, f"{calibrated.take.name}_variation{variation}", frames, lower, options)
        if upper:
            play_upper(armature, f"{action.name}_upper", frames, upper)
        measured, errors = np.empty(0), {}
        if (options.part == "full" or kept) and options.root != "in-place":
            measured = np.unique(np.linspace(0, len(frames) - 1, MEASURED_FRAMES).round().astype(int))
            errors = _tracker_errors(context, armature, rig, frames[measured], trackers[measured])
        seconds = (time.perf_counter() - started) / count
        speed = len(frames) / seconds
        report = BakeReport(action.name, variation, len(frames), scene_rate(scene), scale, seconds, speed, len(measured), errors, thinned, warnings)
        reports.insert(0, report)
    return reports


def _animated(
    scene: bpy.types.Scene,
    armature: bpy.types.Object,
    rig: Rig,
    solved: RigBody,
    calibrated: Calibrated,
    model: Model,
    options: BakeOptions,
    kept: Kept | None,
) -> Generator[Progress, None, tuple[list[Channel], ReductionReport | None]]:
    """The channels that a take becomes, and what was thinned of them; `kept` is an upper body that stays."""
    share = 0.6 if options.reduction else 1.0
    motion = yield from part(solve_on_rig(solved, calibrated, model, options.solve, scene_rate(scene), kept), 0, share)
    channels, thinned = list(rig_channels(armature, rig, solved, motion, "full" if kept else options.part, options.root, options.limbs)), None
    if options.reduction:
        scale = take_scale(solved, calibrated)
        channels, thinned = yield from part(reducing_channels(armature, rig, motion, channels, options.reduction, scale), share, 1)
    return channels, thinned


def take_scale(solved: RigBody, calibrated: Calibrated) -> float:
    """World units of the rig per metre of the take: both stand at the same height of the head joint."""
    return (solved.body.height_above_toes("Head") + solved.sole) / calibrated.calibration.head_height


def solve_on_rig(
    solved: RigBody, calibrated: Calibrated, model: Model, options: SolveOptions, rate: float, kept: Kept | None = None
) -> Generator[Progress, None, Motion]:
    """The motion of the rig's body at a steady rate, in world units; `kept` is an upper body that it must have at the frames of that rate.

    It is solved at the performer's size, where the engine's centimetres mean what they say, and then scaled.
    """
    take, head_height = calibrated.take, calibrated.calibration.head_height
    scale = take_scale(solved, calibrated)
    performance = yield from part(perform(take, head_height, solved.proportions, model, options), 0, 0.6)
    times = frame_times(take.times[0], take.times[-1], rate)
    upper = None
    if kept:
        at, rotations = sampled(take, times), kept.rotations[:, solved.body.indices(TRACKED_JOINTS)]
        own = replace(at, positions=kept.positions / np.float32(scale), rotations=rotations, tracked=np.ones_like(at.tracked))
        upper = UpperBody(own, kept.rotations)
    job = fusing(performance, take, times, solved.body.scaled(1 / scale), solved.sole / scale, upper)
    motion = yield from part(job, 0.6, 1)
    return replace(motion, skeleton=solved.body, root=motion.root * np.float32(scale))


def _together(kept: Array, trackers: Array, solved: RigBody) -> bool:
    """Whether the head of an animation, [T, 3, 3] of head and wrists, keeps near that of the take: legs could not follow both otherwise."""
    apart = np.linalg.norm(kept[:, 0] - trackers[:, 0], axis=-1)
    return float(np.percentile(apart, 95)) < APART * solved.body.height_above_toes("Head")


def require_carrier(armature: bpy.types.Object, rig: Rig, root: Root) -> None:
    """InputError if what is to carry the way over the ground cannot."""
    if root == "bone":
        root_bone(rig)
    elif root == "object":
        require_free(armature)


def rig_channels(
    armature: bpy.types.Object, rig: Rig, solved: RigBody, motion: Motion, part: str = "full", root: Root = "hips", limbs: Limbs = "fk"
) -> Iterator[Channel]:
    """The curves that make the rig do a motion of its own body, and the switches that they rely on."""
    animated = animated_paths(armature)
    if root != "hips":
        way = way_over_ground(rig, solved, motion, root)
        motion = without_way(motion, way)
        if root == "bone":
            yield from _bone_channels(armature, root_pose(rig, way), animated)
        elif root == "object":
            yield from object_channels(armature, object_matrices(rig, way))
    if limbs != "fk":
        motion = hinged(rig, solved, motion)
    for pose in chain(bone_poses(rig, solved, motion, ways(limbs)), pole_poses(rig, solved, motion) if limbs != "fk" else ()):
        if part == "full" or pose.lower:
            yield from _bone_channels(armature, pose, animated)
    for setting in limb_settings(rig, limbs):
        bone = armature.pose.bones[setting.bone]
        if (part == "full" or setting.lower) and (setting.name in bone or hasattr(bone, setting.name)):
            yield Channel(setting_path(bone, setting.name), np.full((len(motion), 1), setting.value), setting.bone)


def _bone_channels(armature: bpy.types.Object, pose: BonePose, animated: set[str]) -> Iterator[Channel]:
    """The curves of one bone. What an earlier action has left of a location or a scale, or gives it from below (`animated` paths), is keyed
    away: it would displace the bones below."""
    bone = armature.pose.bones[pose.bone]
    rest = np.zeros((len(pose.rotation), 3))
    yield rotation_channel(bone, pose.rotation)
    if pose.location is not None:
        yield location_channel(bone, pose.location)
    elif bone.location.length > 0 or pose_path(bone.name, "location") in animated:
        yield location_channel(bone, rest)
    if (bone.scale - mathutils.Vector((1, 1, 1))).length > 0 or pose_path(bone.name, "scale") in animated:
        yield Channel(pose_path(bone.name, "scale"), rest + 1, bone.name)


def _write(armature: bpy.types.Object, name: str, frames: np.ndarray, channels: list[Channel], options: BakeOptions) -> bpy.types.Action:
    data = armature.animation_data_create()
    previous, slot = data.action, getattr(data, "action_slot", None)
    action = write_action(armature, name, frames, channels, options.fake_user)
    action[PART] = options.part
    if previous is not None and options.part == "lower" and previous.get(PART) != "lower":
        play_below(data, previous, slot, frames)
    elif previous is not None and options.push_down:
        push_down(data, previous, slot)
    elif previous is not None:
        previous.use_fake_user = True  # or it would leave the file with its last user
    return action


def _parted(rig: Rig, channels: list[Channel]) -> tuple[list[Channel], list[Channel]]:
    """The channels of hips and legs, and those of the rest."""
    lower = {item.bone for item in (*rig.mapping.controls, *rig.mapping.settings) if item.lower}
    return [channel for channel in channels if channel.group in lower], [channel for channel in channels if channel.group not in lower]


def _tracker_errors(context: bpy.types.Context, armature: bpy.types.Object, rig: Rig, frames: np.ndarray, trackers: Array) -> dict[str, TrackerError]:
    """Compares the evaluated bones with tracker positions [N, 3, 3] at frames [N]."""
    bones = [rig.mapping.joints[joint] for joint in TRACKED_JOINTS]
    heads = [[posed.matrix_world @ posed.pose.bones[bone].head for bone in bones] for posed in posed_at(context, armature, frames)]
    distances = np.linalg.norm(np.array(heads) - trackers, axis=-1)
    return {
        device: TrackerError(
            median_cm=float(100 * np.median(values)),
            p95_cm=float(100 * np.percentile(values, 95)),
            max_cm=float(100 * values.max()),
            share_within_1_cm=float(np.mean(values < CLOSE)),
        )
        for device, values in zip(DEVICES, distances.T, strict=True)
    }
