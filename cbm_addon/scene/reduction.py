"""Fewer keys for a bake: its channels thinned to what a tolerance allows."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, replace

import bpy
import numpy as np

from ..motion.contacts import CONTACT_JOINTS, contact_labels
from ..motion.motion import Motion
from ..progress import Progress
from ..rigs.reduce import BoneCurves, Tolerance, reducing
from ..rigs.rig import Control, Rig
from .action import Channel, pose_path

PLANTED = 0.0002  # metres at the performer's size by which a joint of a foot that stands may leave its place


@dataclass(frozen=True)
class Reduction:
    """How far a joint may leave where the dense bake has it: millimetres at the performer's size, and degrees."""

    millimetres: float
    degrees: float


@dataclass(frozen=True)
class ReductionReport:
    """What a reduction made: keys of all components before and after, and the largest deviations of joints over all frames."""

    keys_before: int
    keys_after: int
    largest_mm: float
    largest_deg: float


def reducing_channels(
    armature: bpy.types.Object, rig: Rig, motion: Motion, channels: list[Channel], reduction: Reduction, scale: float
) -> Generator[Progress, None, tuple[list[Channel], ReductionReport]]:
    """The same channels with as few keys as the tolerance allows.

    Only bones whose pose follows from their own keys and those of their carriers are thinned; others keep every key.

    motion  what the rig does in the world, on its own body
    scale   world units per metre of the take
    """
    unit = scale / rig.scale  # armature units per metre at the performer's size
    tolerance = Tolerance(reduction.millimetres / 1000 * unit, PLANTED * unit, np.radians(reduction.degrees))
    paths = {channel.data_path: channel for channel in channels}
    thinned = [(curves, own) for control in rig.mapping.controls for curves, own in _curves(armature, rig, control, paths)]
    feet = [joint for joint in CONTACT_JOINTS if joint in motion.skeleton]
    standing = contact_labels(motion.skeleton, motion.positions() / np.float32(scale), motion.rate, feet)
    planted = dict(zip(feet, standing.T, strict=True))
    reduced = yield from reducing(rig, [curves for curves, _ in thinned], planted, tolerance)
    frames = {channel.data_path: keyed for (_, own), keyed in zip(thinned, reduced.frames, strict=True) for channel in own}
    fewer = [replace(channel, keyed=frames.get(channel.data_path)) for channel in channels]
    before, after = (sum(sum(channel.keys()) for channel in some) for some in (channels, fewer))
    return fewer, ReductionReport(before, after, 1000 * reduced.position / unit, float(np.degrees(reduced.angle)))


def _curves(armature: bpy.types.Object, rig: Rig, control: Control, paths: dict[str, Channel]) -> list[tuple[BoneCurves, list[Channel]]]:
    """The curves of a control and its channels, if it is keyed and only turns, or is the one that moves the hips."""
    bone = armature.pose.bones[control.bone]
    names = {"QUATERNION": "rotation_quaternion", "AXIS_ANGLE": "rotation_axis_angle"}
    rotation = paths.get(pose_path(bone.name, names.get(bone.rotation_mode, "rotation_euler")))
    location = paths.get(pose_path(bone.name, "location"))
    if rotation is None or control.joint not in rig.mapping.joints:
        return []
    mover = next(item for item in rig.mapping.controls if item.anchor)
    if control is mover and location is not None:
        return [(BoneCurves(control, bone.rotation_mode, rotation.values, location.values), [rotation, location])]
    return [(BoneCurves(control, bone.rotation_mode, rotation.values, None), [rotation])] if control.anchor is None else []
