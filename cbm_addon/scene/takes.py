"""Takes in the scene: objects that move as the calibrated head and wrists do."""

from __future__ import annotations

import bpy
import numpy as np

from ..takes.take import DEVICES, Take
from .action import Channel, scene_frames, write_action

EMPTY_SIZE = 0.1  # metres
TAKE = "cbm_take"  # custom property of a collection of trackers: the name of the take that it shows
DEVICE = "cbm_device"  # custom property of a tracker in it


def tracker_empties(context: bpy.types.Context, take: Take) -> bpy.types.Collection:
    """A collection in the scene with three empties, animated with a calibrated take from the scene's start frame, below one that sizes them.

    Where the same take is shown already, its empties get the new animation and stay what they are: selected, scaled, wherever they are linked.
    """
    shown = (collection for collection in context.scene.collection.children if collection.get(TAKE) == take.name)
    collection = next(shown, None) or _new_trackers(context.scene, take.name)
    for device in DEVICES:
        empty = next((obj for obj in collection.objects if obj.get(DEVICE) == device), None) or _new_tracker(collection, take.name, device)
        before = empty.animation_data.action if empty.animation_data else None
        animate_tracker(empty, context.scene, take, device)
        if before:
            name = before.name
            bpy.data.actions.remove(before)
            empty.animation_data.action.name = name
    return collection


def _new_trackers(scene: bpy.types.Scene, take: str) -> bpy.types.Collection:
    collection = bpy.data.collections.new(f"{take} trackers")
    collection[TAKE] = take
    scene.collection.children.link(collection)
    origin = bpy.data.objects.new(f"{take} origin", None)
    origin.empty_display_size = EMPTY_SIZE
    collection.objects.link(origin)
    return collection


def _new_tracker(collection: bpy.types.Collection, take: str, device: str) -> bpy.types.Object:
    empty = bpy.data.objects.new(f"{take} {device}", None)
    empty[DEVICE] = device
    empty.parent = next((obj for obj in collection.objects if obj.parent is None), None)
    empty.empty_display_type, empty.empty_display_size = "ARROWS", EMPTY_SIZE
    empty.show_name = empty.show_in_front = True
    collection.objects.link(empty)
    return empty


def scale_trackers(scene: bpy.types.Scene, take: str, scale: float) -> None:
    """Scales the trackers that are shown of a take about the world origin, so that they are where a bake has met them."""
    for collection in scene.collection.children:
        if collection.get(TAKE) == take:
            for obj in collection.objects:
                if obj.parent is None:
                    obj.scale = (scale, scale, scale)


def animate_tracker(obj: bpy.types.Object, scene: bpy.types.Scene, take: Take, device: str, scale: float = 1.0) -> bpy.types.Action:
    """A new action that moves an object as one device of a calibrated take, scaled about the world origin."""
    index = DEVICES.index(device)
    obj.rotation_mode = "QUATERNION"
    channels = [
        Channel("location", take.positions[:, index] * np.float32(scale), "Transform"),
        Channel("rotation_quaternion", take.rotations[:, index], "Transform"),
    ]
    return write_action(obj, f"{take.name} {device}", scene_frames(scene, take.times, scene.frame_start), channels, fake_user=False)
