"""Actions with dense keys, each curve written once; on legacy actions (Blender 4.2, 4.3) as on slotted ones (4.4 and later)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import bpy
import numpy as np

from ..errors import InputError
from ..motion.rotations import Array, continuous, quat_from_matrix
from ..rigs.pose import rotation_values

LINEAR = 1  # what RNA calls 'LINEAR' in foreach_set


@dataclass(frozen=True)
class Channel:
    """What one property does: its RNA path on the object, values [T, N] (N components of the property) and the name of the curves' group."""

    data_path: str
    values: Array
    group: str


def pose_path(bone: str, attribute: str) -> str:
    """RNA path of a pose bone's attribute, for example "rotation_quaternion"."""
    return f'pose.bones["{bpy.utils.escape_identifier(bone)}"].{attribute}'


def location_channel(bone: bpy.types.PoseBone, locations: Array) -> Channel:
    """Locations [T, 3] in the bone's own space."""
    return Channel(pose_path(bone.name, "location"), locations, bone.name)


def rotation_channel(bone: bpy.types.PoseBone, quaternions: Array) -> Channel:
    """Rotations [T, 4] in the bone's own space, smooth over time, in the rotation mode that the bone has."""
    attribute, values = rotation_values(continuous(quaternions), bone.rotation_mode)
    return Channel(pose_path(bone.name, attribute), values, bone.name)


def require_free(obj: bpy.types.Object) -> None:
    """InputError if something else than its own location and rotation moves an object, so that keys cannot put it at a place."""
    deltas = *obj.delta_location, *obj.delta_rotation_euler, *obj.delta_rotation_quaternion[1:]
    if any(deltas) or any(not constraint.mute for constraint in obj.constraints):
        raise InputError(obj.name, "constraints or delta transforms move its object, which cannot carry the way then; keep the way on the hips")


def object_channels(obj: bpy.types.Object, matrices: Array) -> list[Channel]:
    """The channels that put an object at world matrices [T, 4, 4], all of the size that it has, while what it hangs off stays."""
    require_free(obj)
    before = np.array(obj.matrix_world @ obj.matrix_basis.inverted(), dtype=np.float64)
    basis = np.linalg.inv(before) @ matrices
    turns = basis[:, :3, :3] / np.linalg.norm(basis[:, :3, :3], axis=-2, keepdims=True)
    attribute, values = rotation_values(continuous(quat_from_matrix(turns)), obj.rotation_mode)
    return [Channel("location", basis[:, :3, 3], "Object Transforms"), Channel(attribute, values, "Object Transforms")]


def scene_rate(scene: bpy.types.Scene) -> float:
    """Frames per second."""
    return scene.render.fps / scene.render.fps_base


def scene_frames(scene: bpy.types.Scene, seconds: np.ndarray, frame_start: float) -> np.ndarray:
    """The scene's frames at those seconds, if second 0 is `frame_start`."""
    return frame_start + np.asarray(seconds) * scene_rate(scene)


def write_action(obj: bpy.types.Object, name: str, frames: np.ndarray, channels: Iterable[Channel], fake_user: bool = True) -> bpy.types.Action:
    """A new action with linear keys at `frames` [T], bound to the object. The action that was bound before stays in the file, unchanged.

    A component that never changes gets one key instead of T. InputError if the object's animation cannot be changed now.
    """
    data = unlocked_animation(obj)
    action, slot = new_action(obj, name, frames, channels)
    action.use_fake_user = fake_user
    data.action = action
    if slot is not None:
        data.action_slot = slot
    return action


def unlocked_animation(obj: bpy.types.Object) -> bpy.types.AnimData:
    """The object's animation; InputError if it cannot be changed now."""
    data = obj.animation_data_create()
    if data is None or data.use_tweak_mode:
        raise InputError(obj.name, "its animation is locked; leave the NLA's tweak mode, or make a linked object local")
    return data


def new_action(obj: bpy.types.Object, name: str, frames: np.ndarray, channels: Iterable[Channel]) -> tuple[bpy.types.Action, bpy.types.ActionSlot | None]:
    """A new action for the object, as `write_action` writes it, and its slot, which legacy actions do not have. Nothing is bound to it yet."""
    action = bpy.data.actions.new(name)
    slotted = hasattr(action, "slots")
    slot = action.slots.new("OBJECT", obj.name) if slotted else None
    bag = action.layers.new("Layer").strips.new(type="KEYFRAME").channelbag(slot, ensure=True) if slotted else action
    _write_curves(bag, frames, channels)
    return action, slot


def _write_curves(bag: bpy.types.ActionChannelbag | bpy.types.Action, frames: np.ndarray, channels: Iterable[Channel]) -> None:
    keys = np.empty((len(frames), 2), dtype=np.float32)
    keys[:, 0] = frames
    linear = np.full(len(frames), LINEAR, dtype=np.int32)
    for channel in channels:
        group = bag.groups.get(channel.group) or bag.groups.new(channel.group)
        for index, column in enumerate(channel.values.T):
            keys[:, 1] = column
            count = len(keys) if np.any(keys[:, 1] != keys[0, 1]) else 1
            curve = bag.fcurves.new(channel.data_path, index=index)
            curve.group = group
            curve.keyframe_points.add(count)
            curve.keyframe_points.foreach_set("co", keys[:count].ravel())
            curve.keyframe_points.foreach_set("interpolation", linear[:count])
            curve.update()


def action_curves(obj: bpy.types.Object) -> list[bpy.types.FCurve]:
    """The curves that animate the object: those of its action, in its slot."""
    data = obj.animation_data
    if data is None or data.action is None:
        return []
    return curves_of(data.action, getattr(data, "action_slot", None))


def curves_of(action: bpy.types.Action, slot: bpy.types.ActionSlot | None) -> list[bpy.types.FCurve]:
    """The curves of an action, in a slot of it."""
    if not hasattr(action, "slots"):
        return list(action.fcurves)
    bags = (strip.channelbag(slot) for layer in action.layers for strip in layer.strips if slot)
    return [curve for bag in bags if bag for curve in bag.fcurves]


def key_frames(obj: bpy.types.Object) -> np.ndarray:
    """Every frame at which a curve of the object has a key, float64, increasing."""
    frames = [np.empty(0, dtype=np.float32)]
    for curve in action_curves(obj):
        keys = np.empty(2 * len(curve.keyframe_points), dtype=np.float32)
        curve.keyframe_points.foreach_get("co", keys)
        frames.append(keys[::2])
    return np.unique(np.concatenate(frames).astype(np.float64))
