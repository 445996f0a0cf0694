"""What finger posing works with, drawn over the 3D view: the capsules of hands and body, and the cells around the hands that something fills."""

from __future__ import annotations

from typing import Any, ClassVar

import bpy
import numpy as np
from bpy.app.handlers import persistent

from ..hands.model import DEFAULT_HANDS, read_card
from ..hands.obstacle import over_time
from ..hands.sensor import Grid, sense
from ..hands.shapes import Capsules
from ..motion.rotations import Array, normalize, rotate
from ..rigs.tables import Table
from .obstacles import SceneObstacles
from .rigged_hands import RiggedHands, Surroundings, obstacles_of, rigged_hands

AROUND = 12  # corners of a capsule's rings
COLOURS = {"hands": (0.35, 0.75, 1.0, 0.9), "body": (1.0, 0.75, 0.25, 0.6), "cells": (1.0, 0.3, 0.2, 0.45)}
FULL = 0.3, 0.99  # how full the cells are that are drawn: those at the surface

_CUBE = np.array([[0, 1], [1, 3], [3, 2], [2, 0], [4, 5], [5, 7], [7, 6], [6, 4], [0, 4], [1, 5], [2, 6], [3, 7]])
_CORNERS = np.stack(np.meshgrid([-0.5, 0.5], [-0.5, 0.5], [-0.5, 0.5], indexing="ij"), axis=-1).reshape(-1, 3)

Lines = dict[str, Array]
"""By the names of COLOURS: pairs of world points float32 [N, 2, 3]."""


def overlay_lines(depsgraph: bpy.types.Depsgraph, rigged: RiggedHands, obstacles: SceneObstacles, grid: Grid) -> Lines:
    """What there is to draw at the scene's current frame."""
    seen = Surroundings(rigged, obstacles)
    seen.look(depsgraph)
    angles = {side: hand.angles_from_turns(seen.turns(side).astype(np.float32)) for side, hand in rigged.hands.items()}
    hands, cells = [], []
    for side in rigged.sides:
        hand, wrists = rigged.hands[side], seen.wrists[side]
        starts, ends, radii = hand.capsules(angles[side], *wrists)
        hands.append(capsule_lines(starts[0], ends[0], radii))
        filled = sense(grid, hand, wrists, over_time(seen.around(side, angles)), np.array([0]))[0]
        corners = (grid.centres()[(filled > FULL[0]) & (filled < FULL[1])][:, None] + _CORNERS * grid.cell) * hand.length
        world = rotate(wrists[1][0], corners @ hand.palm.T) + wrists[0][0]
        cells.append(world[:, _CUBE].reshape(-1, 2, 3))
    body = [shape for part, motion in seen.body(0) if isinstance(shape := part.at(motion), Capsules)]
    found = {"hands": hands, "body": [capsule_lines(part.starts, part.ends, part.radii) for part in body], "cells": cells}
    unit = np.float32(rigged.unit)
    return {name: unit * np.concatenate([np.empty((0, 2, 3), np.float32), *lines]).astype(np.float32) for name, lines in found.items()}


def capsule_lines(starts: Array, ends: Array, radii: Array) -> Array:
    """Rings at both ends of capsules [C, 3], and lines along them: pairs of points [N, 2, 3]."""
    along = normalize(ends - starts)
    across = normalize(np.cross(along, np.eye(3)[np.argmin(np.abs(along), axis=-1)]))
    turn = 2 * np.pi * np.arange(AROUND) / AROUND
    circle = np.cos(turn)[:, None] * across[:, None] + np.sin(turn)[:, None] * np.cross(along, across)[:, None]
    rings = [centres[:, None] + radii[:, None, None] * circle for centres in (starts, ends)]
    sides = np.stack(rings, axis=2)[:, :: AROUND // 4]
    return np.concatenate([np.stack((ring, np.roll(ring, -1, axis=1)), axis=2).reshape(-1, 2, 3) for ring in rings] + [sides.reshape(-1, 2, 3)])


class Overlay:
    """The overlay that is shown, if one is. Its lines are made when something has changed and the animation does not play."""

    shown: ClassVar[Overlay | None] = None

    def __init__(self, armature: bpy.types.Object, collection: bpy.types.Collection | None, table: Table | None) -> None:
        self._rigged, self._grid = rigged_hands(armature, None, table), Grid.from_dict(read_card(DEFAULT_HANDS)["features"]["grid"])
        self._obstacles = obstacles_of(self._rigged, collection)
        self._batches: dict[str, Any] | None = None
        self._handle = bpy.types.SpaceView3D.draw_handler_add(self._draw, (), "WINDOW", "POST_VIEW")

    @classmethod
    def show(cls, armature: bpy.types.Object, collection: bpy.types.Collection | None, table: Table | None) -> None:
        """Draws the hands of an armature and what is around them, until `hide`; InputError if it has no hands. Without a window nothing is drawn."""
        cls.hide()
        if not bpy.app.background:
            cls.shown = cls(armature, collection, table)
            bpy.app.handlers.depsgraph_update_post.append(_outdate)
            bpy.app.handlers.frame_change_post.append(_outdate)

    @classmethod
    def hide(cls) -> None:
        shown, cls.shown = cls.shown, None
        if shown is not None:
            bpy.types.SpaceView3D.draw_handler_remove(shown._handle, "WINDOW")
            bpy.app.handlers.depsgraph_update_post.remove(_outdate)
            bpy.app.handlers.frame_change_post.remove(_outdate)

    def outdate(self) -> None:
        self._batches = None

    def _draw(self) -> None:
        """Called by Blender for every 3D view."""
        context = bpy.context
        playing = context.screen is not None and context.screen.is_animation_playing
        try:
            if self._batches is None and not playing:
                lines = overlay_lines(context.evaluated_depsgraph_get(), self._rigged, self._obstacles, self._grid)
                self._batches = _batches(lines)
        except ReferenceError:  # the armature was removed, or another file was loaded
            self._batches = {}
            bpy.app.timers.register(Overlay.hide)
        if self._batches and not playing:
            _draw_batches(self._batches)


def _batches(lines: Lines) -> dict[str, Any]:
    import gpu
    from gpu_extras.batch import batch_for_shader

    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    return {name: batch_for_shader(shader, "LINES", {"pos": pairs.reshape(-1, 3)}) for name, pairs in lines.items() if len(pairs)}


def _draw_batches(batches: dict[str, Any]) -> None:
    import gpu

    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    gpu.state.blend_set("ALPHA")
    for name, batch in batches.items():
        shader.bind()
        shader.uniform_float("color", COLOURS[name])
        batch.draw(shader)
    gpu.state.blend_set("NONE")


@persistent
def _outdate(*_: Any) -> None:
    if Overlay.shown is not None:
        Overlay.shown.outdate()
