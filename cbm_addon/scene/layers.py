"""Actions that correct an animation from NLA tracks above it: what an earlier run wrote is left out of what the next one reads."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import bpy

from ..errors import InputError
from .action import curves_of, unlocked_animation
from .nla import PART
from .rig import require_editable


def require_layer(armature: bpy.types.Object) -> None:
    """InputError if an action on a track above could not be added, or would not play."""
    require_editable(armature)
    if armature.animation_data:
        unlocked_animation(armature)
        if any(track.is_solo for track in armature.animation_data.nla_tracks):
            raise InputError(armature.name, "one of its NLA tracks is played alone; switch that off, or a track of corrections would not play")


def own_tracks(armature: bpy.types.Object, part: str) -> list[bpy.types.NlaTrack]:
    """The tracks that hold nothing but actions that are marked as `part`."""
    data = armature.animation_data
    tracks = data.nla_tracks if data else ()
    return [track for track in tracks if track.strips and all(strip.action and strip.action.get(PART) == part for strip in track.strips)]


@contextmanager
def without_earlier(armature: bpy.types.Object, part: str) -> Iterator[None]:
    """Mutes what was written earlier, so that what the user animates is read."""
    tracks = [track for track in own_tracks(armature, part) if not track.mute]
    for track in tracks:
        track.mute = True
    try:
        yield
    finally:
        for track in tracks:
            track.mute = False


def remove_earlier(armature: bpy.types.Object, part: str, paths: set[str]) -> None:
    """Removes tracks of earlier runs that hold nothing but curves of `paths`; their actions stay in the file."""
    for track in own_tracks(armature, part):
        earlier = {curve.data_path for strip in track.strips for curve in curves_of(strip.action, getattr(strip, "action_slot", None))}
        if earlier <= paths:
            armature.animation_data.nla_tracks.remove(track)
