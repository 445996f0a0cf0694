"""Takes in the scene: objects that move as the calibrated head and wrists do."""

from __future__ import annotations

import bpy
import numpy as np

from ..takes.take import DEVICES, Take
from .action import Channel, scene_frames, write_action

EMPTY_SIZE = 0.1  # metres
TAKE = "cbm_take"  # custom property of a collection of trackers: the name of the take that it shows


def tracker_empties(context: bpy.types.Context, take: Take) -> bpy.types.Collection:
    """A collection in the scene with three empties, animated with a calibrated take from the scene's start frame, below one that sizes them.

    It takes the place of the one that showed the same take before.
    """
    for earlier in [collection for collection in context.scene.collection.children if collection.get(TAKE) == take.name]:
        actions = {obj.animation_data.action for obj in earlier.objects if obj.animation_data}
        bpy.data.batch_remove([*earlier.objects, earlier, *(action for action in actions if action)])
    collection = bpy.data.collections.new(f"{take.name} trackers")
    collection[TAKE] = take.name
    context.scene.collection.children.link(collection)
    origin = bpy.data.objects.new(f"{take.name} origin", None)
    origin.empty_display_size = EMPTY_SIZE
    collection.objects.link(origin)
    for device in DEVICES:
        empty = bpy.data.objects.new(f"{take.name} {device}", None)
        empty.parent = origin
        empty.empty_display_type = "ARROWS"
        empty.empty_display_size = EMPTY_SIZE
        collection.objects.link(empty)
        animate_tracker(empty, context.scene, take, device)
    return collection


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
