"""The bake: a calibrated take becomes a new action on an armature."""

from __future__ import annotations

import time
from collections.abc import Generator, Iterator
from dataclasses import dataclass, field, replace
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
from ..rigs.pose import BonePose, bone_poses
from ..rigs.rig import Rig
from ..rigs.tables import Table
from ..rigs.travel import Root, object_matrices, root_bone, root_pose, way_over_ground, without_way
from ..solve.fuse import fusing
from ..solve.models import Model
from ..solve.perform import SolveOptions, perform, sampled
from ..takes.calibrate import Calibrated
from ..takes.synthesize import TRACKED_JOINTS
from ..takes.take import DEVICES
from .action import Channel, location_channel, object_channels, pose_path, require_free, rotation_channel, scene_frames, scene_rate, write_action
from .nla import play_below
from .rig import read_rig, require_editable

MEASURED_FRAMES = 120  # on how many frames the evaluated rig is compared with the trackers
CLOSE = 0.01  # metres
PART = "cbm_part"  # custom property of a baked action


@dataclass(frozen=True)
class BakeOptions:
    """How a take is put on a rig.

    part   "full", or "lower": hips and legs are keyed, the animation of the rest stays what it is
    root   what carries the way over the ground: the hips, a bone above them, the armature's object, or nothing ("in-place")
    table  the user's map of the rig's bones; None recognises them
    """

    part: Literal["full", "lower"] = "full"
    solve: SolveOptions = field(default_factory=SolveOptions)
    root: Root = "hips"
    table: Table | None = None


@dataclass(frozen=True)
class TrackerError:
    """How far a joint of the evaluated rig is from its tracker, over the frames that were measured."""

    median_cm: float
    p95_cm: float
    max_cm: float
    share_within_1_cm: float


@dataclass(frozen=True)
class BakeReport:
    """What a bake made.

    scale              of the take, about the world origin, to the rig's size
    seconds            that the bake took, of which `frames_per_second` follows
    measured_frames    frames on which the evaluated rig was compared with the scaled trackers
    tracker_errors     by device; empty when only the lower body was baked, or in place
    """

    action: str
    frames: int
    fps: float
    scale: float
    seconds: float
    frames_per_second: float
    measured_frames: int
    tracker_errors: dict[str, TrackerError]


def bake(
    context: bpy.types.Context, armature: bpy.types.Object, calibrated: Calibrated, model: Model, options: BakeOptions
) -> Generator[Progress, None, BakeReport]:
    """Solves a take on the armature's own proportions and writes it as a new action; take time 0 is the scene's start frame.

    Nothing is changed before the last event. Then the armature has the new action; the one it had stays in the file, and with part "lower"
    it goes on as an NLA strip below. InputError if the armature cannot be baked onto.
    """
    started = time.perf_counter()
    scene = context.scene
    require_editable(armature)
    if options.part == "lower" and options.root != "hips":
        raise InputError(options.root, "cannot carry the way of the lower body alone, since the upper body would follow; keep it on the hips")
    rig = read_rig(armature, options.table)
    require_carrier(armature, rig, options.root)
    solved = rig_body(rig)
    scale = take_scale(solved, calibrated)
    motion = yield from part(solve_on_rig(solved, calibrated, model, options.solve, scene_rate(scene)), 0, 0.95)
    yield Progress(0.95, "writing keys")
    frames = scene_frames(scene, motion.times, scene.frame_start)
    name = f"{calibrated.take.name}_variation{options.solve.variation}"
    action = _write(armature, name, frames, list(rig_channels(armature, rig, solved, motion, options.part, options.root)), options.part)
    measured, errors = np.empty(0), {}
    if options.part == "full" and options.root != "in-place":
        measured = np.unique(np.linspace(0, len(frames) - 1, MEASURED_FRAMES).round().astype(int))
        trackers = sampled(calibrated.take, motion.times[measured]).positions * scale
        errors = _tracker_errors(context, armature, rig, frames[measured], trackers)
    seconds = time.perf_counter() - started
    return BakeReport(action.name, len(frames), scene_rate(scene), scale, seconds, len(frames) / seconds, len(measured), errors)


def take_scale(solved: RigBody, calibrated: Calibrated) -> float:
    """World units of the rig per metre of the take: both stand at the same height of the head joint."""
    return (solved.body.height_above_toes("Head") + solved.sole) / calibrated.calibration.head_height


def solve_on_rig(solved: RigBody, calibrated: Calibrated, model: Model, options: SolveOptions, rate: float) -> Generator[Progress, None, Motion]:
    """The motion of the rig's body at a steady rate, in world units.

    It is solved at the performer's size, where the engine's centimetres mean what they say, and then scaled.
    """
    take, head_height = calibrated.take, calibrated.calibration.head_height
    scale = take_scale(solved, calibrated)
    performance = yield from part(perform(take, head_height, model, options), 0, 0.6)
    times = frame_times(take.times[0], take.times[-1], rate)
    motion = yield from part(fusing(performance, take, times, solved.body.scaled(1 / scale), solved.sole / scale), 0.6, 1)
    return replace(motion, skeleton=solved.body, root=motion.root * np.float32(scale))


def require_carrier(armature: bpy.types.Object, rig: Rig, root: Root) -> None:
    """InputError if what is to carry the way over the ground cannot."""
    if root == "bone":
        root_bone(rig)
    elif root == "object":
        require_free(armature)


def rig_channels(armature: bpy.types.Object, rig: Rig, solved: RigBody, motion: Motion, part: str = "full", root: Root = "hips") -> Iterator[Channel]:
    """The curves that make the rig do a motion of its own body, and the switches that they rely on."""
    if root != "hips":
        way = way_over_ground(rig, solved, motion, root)
        motion = without_way(motion, way)
        if root == "bone":
            yield from _bone_channels(armature, root_pose(rig, way))
        elif root == "object":
            yield from object_channels(armature, object_matrices(rig, way))
    for pose in bone_poses(rig, solved, motion):
        if part == "full" or pose.lower:
            yield from _bone_channels(armature, pose)
    for setting in rig.mapping.settings:
        if (part == "full" or setting.lower) and setting.name in armature.pose.bones[setting.bone]:
            bone, name = (bpy.utils.escape_identifier(text) for text in (setting.bone, setting.name))
            yield Channel(f'pose.bones["{bone}"]["{name}"]', np.full((len(motion), 1), setting.value), setting.bone)


def _bone_channels(armature: bpy.types.Object, pose: BonePose) -> Iterator[Channel]:
    """The curves of one bone. What an earlier action has left of a location or a scale is keyed away: it would displace the bones below."""
    bone = armature.pose.bones[pose.bone]
    rest = np.zeros((len(pose.rotation), 3))
    yield rotation_channel(bone, pose.rotation)
    if pose.location is not None:
        yield location_channel(bone, pose.location)
    elif bone.location.length > 0:
        yield location_channel(bone, rest)
    if (bone.scale - mathutils.Vector((1, 1, 1))).length > 0:
        yield Channel(pose_path(bone.name, "scale"), rest + 1, bone.name)


def _write(armature: bpy.types.Object, name: str, frames: np.ndarray, channels: list[Channel], part: str) -> bpy.types.Action:
    data = armature.animation_data_create()
    previous, slot = data.action, getattr(data, "action_slot", None)
    action = write_action(armature, name, frames, channels)
    action[PART] = part
    if previous is not None and part == "lower" and previous.get(PART) != "lower":
        play_below(data, previous, slot, frames)
    elif previous is not None:
        previous.use_fake_user = True  # or it would leave the file with its last user
    return action


def _tracker_errors(context: bpy.types.Context, armature: bpy.types.Object, rig: Rig, frames: np.ndarray, trackers: Array) -> dict[str, TrackerError]:
    """Compares the evaluated bones with tracker positions [N, 3, 3] at frames [N]; the scene's frame is put back."""
    bones = [rig.mapping.joints[joint] for joint in TRACKED_JOINTS]
    distances = np.empty((len(frames), len(bones)))
    scene = context.scene
    frame, subframe = scene.frame_current, scene.frame_subframe
    try:
        for i, at in enumerate(frames):
            scene.frame_set(int(at // 1), subframe=float(at % 1))
            evaluated = armature.evaluated_get(context.evaluated_depsgraph_get())
            heads = [evaluated.matrix_world @ evaluated.pose.bones[bone].head for bone in bones]
            distances[i] = np.linalg.norm(np.array(heads) - trackers[i], axis=-1)
    finally:
        scene.frame_set(frame, subframe=subframe)
    return {
        device: TrackerError(
            median_cm=float(100 * np.median(values)),
            p95_cm=float(100 * np.percentile(values, 95)),
            max_cm=float(100 * values.max()),
            share_within_1_cm=float(np.mean(values < CLOSE)),
        )
        for device, values in zip(DEVICES, distances.T, strict=True)
    }
