"""Actions with dense keys, each curve written once; on legacy actions (Blender 4.2, 4.3) as on slotted ones (4.4 and later)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import bpy
import numpy as np

from ..errors import InputError
from ..motion.rotations import Array, continuous, quat_from_matrix
from ..rigs.pose import rotation_values
from ..rigs.reduce import handles

LINEAR, BEZIER = 1, 2  # what RNA calls 'LINEAR' and 'BEZIER' in foreach_set
FREE = 0  # the same of handles


@dataclass(frozen=True)
class Channel:
    """What one property does: its RNA path on the object, values [T, N] (N components of the property) and the name of the curves' group.

    keyed  which of the T frames are keyed, with smooth curves between them (rigs/reduce.py); None: all, with straight lines
    """

    data_path: str
    values: Array
    group: str
    keyed: np.ndarray | None = None

    def keys(self) -> list[int]:
        """How many keys each component gets: one if it never changes."""
        count = len(self.values) if self.keyed is None else len(self.keyed)
        return [count if moves else 1 for moves in np.any(self.values != self.values[:1], axis=0)]


def pose_path(bone: str, attribute: str) -> str:
    """RNA path of a pose bone's attribute, for example "rotation_quaternion"."""
    return f'pose.bones["{bpy.utils.escape_identifier(bone)}"].{attribute}'


def setting_path(bone: bpy.types.PoseBone, name: str) -> str:
    """RNA path of a pose bone's custom property, or of its own property of that name."""
    return f'{pose_path(bone.name, "")[:-1]}["{bpy.utils.escape_identifier(name)}"]' if name in bone else pose_path(bone.name, name)


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
    """A new action with keys at `frames` [T], bound to the object. The action that was bound before stays in the file, unchanged.

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
    for channel in channels:
        group = bag.groups.get(channel.group) or bag.groups.new(channel.group)
        keyed = slice(None) if channel.keyed is None else channel.keyed
        keys = np.empty((len(frames[keyed]), 2), dtype=np.float32)
        keys[:, 0] = frames[keyed]
        for index, count in enumerate(channel.keys()):
            keys[:, 1] = channel.values[keyed, index]
            curve = bag.fcurves.new(channel.data_path, index=index)
            curve.group = group
            points = curve.keyframe_points
            points.add(count)
            points.foreach_set("co", keys[:count].ravel())
            if channel.keyed is None or count == 1:
                points.foreach_set("interpolation", np.full(count, LINEAR, dtype=np.int32))
            else:
                _bend(points, keys, *(slope[:, 0] for slope in handles(channel.values[:, index : index + 1], channel.keyed)))
            curve.update()


def _bend(points: bpy.types.FCurveKeyframePoints, keys: Array, leaving: Array, arriving: Array) -> None:
    """Makes cubic curves between keys [K, 2] that leave and arrive with slopes per frame [K - 1]. The handles lie a third of the way to the next
    key, so that time runs evenly along the curve."""
    third = np.diff(keys[:, 0]) / 3
    left, right = keys.astype(np.float64), keys.astype(np.float64)
    left[1:] -= np.stack((third, third * arriving), axis=-1)
    right[:-1] += np.stack((third, third * leaving), axis=-1)
    for name, handle in (("handle_left", left), ("handle_right", right)):
        points.foreach_set(f"{name}_type", np.full(len(keys), FREE, dtype=np.int32))
        points.foreach_set(name, handle.astype(np.float32).ravel())
    points.foreach_set("interpolation", np.full(len(keys), BEZIER, dtype=np.int32))


def action_curves(obj: bpy.types.Object) -> list[bpy.types.FCurve]:
    """The curves that animate the object: those of its action, in its slot."""
    data = obj.animation_data
    return curves_of(data.action, getattr(data, "action_slot", None)) if data and data.action else []


def animated_paths(obj: bpy.types.Object) -> set[str]:
    """Paths of what its action and the strips of its NLA animate."""
    tracks = obj.animation_data.nla_tracks if obj.animation_data else ()
    strips = [strip for track in tracks for strip in track.strips if strip.action]
    below = [curve for strip in strips for curve in curves_of(strip.action, getattr(strip, "action_slot", None))]
    return {curve.data_path for curve in (*action_curves(obj), *below)}


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
