"""Actions as strips of the NLA: below the one that is edited, and above it."""

from __future__ import annotations

from dataclasses import replace

import bpy
import numpy as np

from ..motion.rotations import Array
from .action import Channel, action_curves, animated_paths, curves_of, new_action

PART = "cbm_part"  # custom property of a baked action: "full", "lower", or "upper" for what goes with a lower one


def play_below(data: bpy.types.AnimData, action: bpy.types.Action, slot: bpy.types.ActionSlot | None, frames: np.ndarray) -> bpy.types.NlaStrip:
    """Plays an action as an NLA strip below the active one, which replaces it where it has curves of its own.

    A strip, and not a copy of its curves, because the animator's action stays the one that is edited and ours stays free of their keys.
    """
    start = min(action.frame_range[0], frames[0])
    end = max(action.frame_range[1], frames[-1], start + 1)
    return add_strip(data, action, slot, start, end)


def play_above(
    obj: bpy.types.Object, action: bpy.types.Action, slot: bpy.types.ActionSlot | None, frames: np.ndarray, stretches: list[tuple[int, int]] | None = None
) -> list[bpy.types.NlaStrip]:
    """Plays an action over `frames` [T], or only over some stretches of them, as NLA strips above everything else that moves the object.

    The object's own action stays the active one, and below ours where they differ. If it has curves of the same properties it becomes a
    strip itself, because Blender evaluates the active action last.
    """
    data = obj.animation_data
    ours = {curve.data_path for curve in curves_of(action, slot)}
    if data.action is not None and ours & {curve.data_path for curve in action_curves(obj)}:
        below, slot_below, blending = data.action, getattr(data, "action_slot", None), data.action_blend_type
        data.action = None
        play_below(data, below, slot_below, frames).blend_type = blending
    track, strips = None, []
    for start, end in stretches or [(int(frames[0]), int(max(frames[-1], frames[0] + 1)))]:
        strip = add_strip(data, action, slot, start, end, track)
        strip.extrapolation = "NOTHING"
        strips.append(strip)
        track = data.nla_tracks[-1]
    data.use_nla = True
    return strips


def hold_unkeyed(obj: bpy.types.Object, name: str, channels: list[Channel], frames: np.ndarray) -> None:
    """Plays what properties of `channels` that nothing animates have now, as a strip below those that will animate them: where no strip does,
    Blender would give them their defaults, and what it played last is left in them when strips are muted."""
    known = animated_paths(obj)
    held = [replace(channel, values=_value(obj, channel.data_path)) for channel in channels if channel.data_path not in known]
    if held:
        action, slot = new_action(obj, name, frames[:1], held)
        add_strip(obj.animation_data, action, slot, frames[0], max(frames[-1], frames[0] + 1))


def _value(obj: bpy.types.Object, path: str) -> Array:
    """What a property is now, [1, C]."""
    return np.atleast_1d(np.array(obj.path_resolve(path), dtype=np.float64))[None]


def play_upper(obj: bpy.types.Object, name: str, frames: np.ndarray, channels: list[Channel]) -> None:
    """Plays what spine and arms do over hips and legs that were baked, so that head and wrists stay where they are: a strip of its own, above the
    animation that it corrects, so that the action of hips and legs holds nothing else. An earlier one is muted."""
    for track in upper_tracks(obj):
        track.mute = True
    action, slot = new_action(obj, name, frames, channels)
    action[PART] = "upper"
    add_strip(obj.animation_data, action, slot, frames[0], max(frames[-1], frames[0] + 1))


def upper_tracks(obj: bpy.types.Object) -> list[bpy.types.NlaTrack]:
    """The tracks that `play_upper` made."""
    tracks = obj.animation_data.nla_tracks if obj.animation_data else ()
    return [track for track in tracks if any(strip.action and strip.action.get(PART) == "upper" for strip in track.strips)]


def push_down(data: bpy.types.AnimData, action: bpy.types.Action, slot: bpy.types.ActionSlot | None) -> None:
    """Keeps an action as a muted NLA track, to be seen by unmuting it."""
    start, end = action.frame_range
    add_strip(data, action, slot, start, max(end, start + 1))
    data.nla_tracks[-1].mute = True


def add_strip(
    data: bpy.types.AnimData,
    action: bpy.types.Action,
    slot: bpy.types.ActionSlot | None,
    start: float,
    end: float,
    track: bpy.types.NlaTrack | None = None,
) -> bpy.types.NlaStrip:
    """A strip of an action, whose frames from `start` to `end` play where they are, on a new track above the others or on one that has room."""
    if track is None:
        track = data.nla_tracks.new()
        track.name = action.name
    after = int(max((strip.frame_end for strip in track.strips), default=start - 1)) + 1  # a new strip is as long as its action, and must find room
    strip = track.strips.new(action.name, after, action)
    if slot is not None:
        strip.action_slot = slot
    strip.action_frame_start, strip.action_frame_end = start, end  # wide enough for the curves' own extrapolation to show
    for _ in range(2):  # neither end may pass the other on its way
        strip.frame_start, strip.frame_end = start, end
    return strip
