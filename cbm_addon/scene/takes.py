"""Takes in the scene: objects that move as the calibrated head and wrists do."""

from __future__ import annotations

import bpy
import numpy as np

from ..takes.take import DEVICES, Take
from .action import Channel, scene_frames, write_action

EMPTY_SIZE = 0.1  # metres


def tracker_empties(context: bpy.types.Context, take: Take) -> bpy.types.Collection:
    """A collection in the scene with three empties, animated with a calibrated take from the scene's start frame.

    What an earlier call made of the same take is replaced.
    """
    name = f"{take.name} trackers"
    if (earlier := context.scene.collection.children.get(name)) is not None:
        _remove(earlier)
    collection = bpy.data.collections.new(name)
    context.scene.collection.children.link(collection)
    for device in DEVICES:
        empty = bpy.data.objects.new(f"{take.name} {device}", None)
        empty.empty_display_type = "ARROWS"
        empty.empty_display_size = EMPTY_SIZE
        collection.objects.link(empty)
        animate_tracker(empty, context.scene, take, device)
    return collection


def animate_tracker(obj: bpy.types.Object, scene: bpy.types.Scene, take: Take, device: str, scale: float = 1.0) -> bpy.types.Action:
    """A new action that moves an object as one device of a calibrated take, scaled about the world origin."""
    index = DEVICES.index(device)
    obj.rotation_mode = "QUATERNION"
    channels = [
        Channel("location", take.positions[:, index] * np.float32(scale), "Transform"),
        Channel("rotation_quaternion", take.rotations[:, index], "Transform"),
    ]
    return write_action(obj, f"{take.name} {device}", scene_frames(scene, take.times, scene.frame_start), channels, fake_user=False)


def _remove(collection: bpy.types.Collection) -> None:
    actions = [empty.animation_data.action for empty in collection.objects if empty.animation_data]
    bpy.data.batch_remove([*collection.objects, *(action for action in actions if action), collection])
