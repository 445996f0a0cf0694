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
    thinned: list[tuple[BoneCurves, list[Channel]]] = []
    dense = set[str]()
    for control in rig.mapping.controls:
        found = [] if control.carrier in dense else _curves(armature, rig, control, paths)
        thinned += found
        if not found and any(pose_path(control.bone, name) in paths for name in ("location", _rotation(armature, control))):
            dense.add(control.bone)
    if not thinned:
        count = sum(sum(channel.keys()) for channel in channels)
        return channels, ReductionReport(count, count, 0.0, 0.0)
    feet = [joint for joint in CONTACT_JOINTS if joint in motion.skeleton]
    standing = contact_labels(motion.skeleton, motion.positions() / np.float32(scale), motion.rate, feet)
    planted = dict(zip(feet, standing.T, strict=True))
    reduced = yield from reducing(rig, [curves for curves, _ in thinned], planted, _held(rig, [curves.control for curves, _ in thinned], paths), tolerance)
    frames = {channel.data_path: keyed for (_, own), keyed in zip(thinned, reduced.frames, strict=True) for channel in own}
    fewer = [replace(channel, keyed=frames.get(channel.data_path)) for channel in channels]
    before, after = (sum(sum(channel.keys()) for channel in some) for some in (channels, fewer))
    return fewer, ReductionReport(before, after, 1000 * reduced.position / unit, float(np.degrees(reduced.angle)))


def _held(rig: Rig, thinned: list[Control], paths: dict[str, Channel]) -> set[str]:
    """The joints of limbs that are placed by their ends: those of controls that are moved themselves, up to what is thinned, and what hangs off them."""
    parents, turned = rig.mapping.parents, {control.joint for control in thinned}
    held = set()
    for control in rig.mapping.controls:
        if control.anchor and control not in thinned and pose_path(control.bone, "location") in paths:
            joint = control.joint
            while joint is not None and joint not in turned:
                held.add(joint)
                joint = parents[joint]
    for joint in rig.mapping.joints:  # parents first
        if parents[joint] in held:
            held.add(joint)
    return held


def _rotation(armature: bpy.types.Object, control: Control) -> str:
    """The property that a control's rotation mode uses."""
    named = {"QUATERNION": "rotation_quaternion", "AXIS_ANGLE": "rotation_axis_angle"}
    return named.get(armature.pose.bones[control.bone].rotation_mode, "rotation_euler")


def _curves(armature: bpy.types.Object, rig: Rig, control: Control, paths: dict[str, Channel]) -> list[tuple[BoneCurves, list[Channel]]]:
    """The curves of a control and its channels, if it is keyed and only turns, or is the one that moves the hips."""
    mode = armature.pose.bones[control.bone].rotation_mode
    rotation, location = (paths.get(pose_path(control.bone, name)) for name in (_rotation(armature, control), "location"))
    if rotation is None or control.joint not in rig.mapping.joints:
        return []
    mover = next(item for item in rig.mapping.controls if item.anchor)
    if control is mover and location is not None:
        return [(BoneCurves(control, mode, rotation.values, location.values), [rotation, location])]
    return [(BoneCurves(control, mode, rotation.values, None), [rotation])] if control.anchor is None else []
