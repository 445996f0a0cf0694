"""The hands of an armature in its scene: what they are, where they are at each frame, and what is around them then.

All is in the hands' own space: the world's axes and origin, in units in which a hand is as long as that of an adult, so that the engine's
millimetres mean what they say on a child and on a giant.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import bpy
import numpy as np

from ..hands.hand import Hand
from ..hands.obstacle import Obstacle
from ..hands.sensor import HAND_LENGTH
from ..hands.shapes import Capsules, Union, together
from ..motion.rotations import Array, quat_from_matrix
from ..rigs.fingers import FingerBones, finger_bones, finger_turns, hands_with_fingers, read_before
from ..rigs.rig import SIDES, Rig
from ..rigs.tables import Table
from .colliders import BodyPart, body_parts, fitted_body
from .obstacles import SceneObstacles
from .rig import read_rig

REACH = 0.3  # from a wrist: what is further away cannot meet a finger
OWN_ARM = ("Arm", "ForeArm", "Hand")


@dataclass(frozen=True)
class RiggedHands:
    """An armature with fingers.

    sides  whose fingers are to be posed; `fingers` and `hands` hold the other one too, if it has any
    body   the parts that hands must not enter
    unit   world units per unit of the hands' own space
    """

    armature: bpy.types.Object
    rig: Rig
    sides: tuple[str, ...]
    fingers: dict[str, FingerBones]
    hands: dict[str, Hand]
    body: list[BodyPart]
    unit: float

    @property
    def bones(self) -> tuple[str, ...]:
        """The bones whose poses are read."""
        of_hands = (bone for fingers in self.fingers.values() for bone in read_before(self.rig, fingers))
        return tuple(dict.fromkeys([*of_hands, *(part.bone for part in self.body), self.rig.mapping.joints["Head"]]))


def rigged_hands(armature: bpy.types.Object, sides: tuple[str, ...] | None = None, table: Table | None = None) -> RiggedHands:
    """The hands of an armature on `sides`, by default those that have fingers; InputError if there are none."""
    rig = read_rig(armature, table)
    there = hands_with_fingers(rig)
    sides = sides or there or SIDES
    fingers = {side: finger_bones(rig, side) for side in dict.fromkeys((*sides, *there))}
    unit = float(np.mean([bones.length for bones in fingers.values()])) / HAND_LENGTH
    colliders, radii = fitted_body(armature, rig, list(fingers.values()))
    hands = {
        side: Hand.from_rest(side.lower(), bones.positions / unit, own / unit)  # type: ignore[arg-type]
        for (side, bones), own in zip(fingers.items(), radii, strict=True)
    }
    return RiggedHands(armature, rig, sides, fingers, hands, body_parts(armature, rig, colliders, unit), unit)


def obstacles_of(rigged: RiggedHands, collection: bpy.types.Collection | None) -> SceneObstacles:
    """What the hands may meet: the meshes of a collection, or all that are visible and not of the character."""
    return SceneObstacles(rigged.armature, collection, rigged.unit, REACH)


class Surroundings:
    """Where the bones of the hands are and what is around them, once every frame was looked at; T frames.

    obstacles  they begin anew, but keep what they have found out about the shapes of things
    """

    def __init__(self, rigged: RiggedHands, obstacles: SceneObstacles) -> None:
        obstacles.begin()
        self.obstacles = obstacles
        self._rigged = rigged
        self._local: list[Array] = []
        self._world: list[Array] = []
        self._bones = {bone: i for i, bone in enumerate(rigged.bones)}
        self._shrink = np.diag([1 / rigged.unit] * 3 + [1])
        rest = self._shrink @ rigged.rig.object_matrix @ rigged.rig.rest
        self._to_rest = [np.linalg.inv(rest[rigged.rig.index(part.bone)]) for part in rigged.body]

    def look(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Takes in the scene at its current frame."""
        rigged = self._rigged
        local, world = bone_matrices(rigged.armature.evaluated_get(depsgraph), tuple(self._bones))
        world = self._shrink @ world
        wrists = world[[self._bones[fingers.wrist] for fingers in rigged.fingers.values()], :3, 3]
        self.obstacles.look(depsgraph, wrists, world[self._bones[rigged.rig.mapping.joints["Head"]], :3, 3])
        self._local.append(local)
        self._world.append(world)

    @cached_property
    def rotations(self) -> dict[str, Array]:
        """Of the bones in the armature, [T, 4]."""
        found = rotations_of(np.stack(self._local))
        return {bone: found[:, i] for bone, i in self._bones.items()}

    @cached_property
    def wrists(self) -> dict[str, tuple[Array, Array]]:
        """Side -> positions [T, 3] and rotations [T, 4], float32."""
        world = np.stack(self._world)
        bones = {side: self._bones[fingers.wrist] for side, fingers in self._rigged.fingers.items()}
        return {side: (world[:, i, :3, 3].astype(np.float32), rotations_of(world[:, i]).astype(np.float32)) for side, i in bones.items()}

    def turns(self, side: str) -> Array:
        """How far the joints of a hand are turned from rest, [T, 15, 4]."""
        return finger_turns(self._rigged.fingers[side], self.rotations)

    def around(self, side: str, angles: dict[str, Array]) -> Callable[[int], Obstacle]:
        """What a hand may meet at a frame: the scene, the body without the arm that it is on, and the other hand at its angles [T, 20]."""
        joints = self._rigged.rig.mapping.joints
        own = {joints[side + joint] for joint in OWN_ARM}
        parts = [(part, motions) for part, motions in self._motions if part.bone not in own]
        near_parts = [_nearest(part, motions, self.wrists[side][0]) < REACH for part, motions in parts]
        others = {other: self._rigged.hands[other].capsules(angles[other], *self.wrists[other]) for other in angles if other != side}

        def at(frame: int) -> Obstacle:
            wrist = self.wrists[side][0][frame]
            near = [part.at(motions[frame]) for (part, motions), is_near in zip(parts, near_parts, strict=True) if is_near[frame]]
            for other, (starts, ends, radii) in others.items():
                if np.linalg.norm(wrist - self.wrists[other][0][frame]) < 2 * REACH:
                    near.append(Capsules(starts[frame], ends[frame], radii))
            lines = [part for part in near if isinstance(part, Capsules)]
            near = [part for part in near if not isinstance(part, Capsules)] + ([together(lines)] if lines else [])
            scene = self.obstacles.at(frame)
            return Union((scene, *near)) if near else scene

        return at

    def body(self, frame: int) -> Iterator[tuple[BodyPart, Array]]:
        """The parts of the body and how their bones are moved from rest [4, 4]."""
        for part, motions in self._motions:
            yield part, motions[frame]

    @cached_property
    def _motions(self) -> list[tuple[BodyPart, Array]]:
        """The parts of the body and how their bones are moved from rest [T, 4, 4]."""
        world = np.stack(self._world)
        return [(part, world[:, self._bones[part.bone]] @ to_rest) for part, to_rest in zip(self._rigged.body, self._to_rest, strict=True)]


def _nearest(part: BodyPart, motions: Array, wrists: Array) -> Array:
    """How far wrists [T, 3] are from a part of the body, at least [T]."""
    return np.linalg.norm(motions[:, :3, :3] @ part.middle + motions[:, :3, 3] - wrists, axis=-1) - part.size


def played(context: bpy.types.Context, frames: np.ndarray) -> Iterator[bpy.types.Depsgraph]:
    """The evaluated scene at each of the frames; the current frame is put back."""
    scene = context.scene
    frame, subframe = scene.frame_current, scene.frame_subframe
    try:
        for at in frames:
            scene.frame_set(int(at))
            yield context.evaluated_depsgraph_get()
    finally:
        scene.frame_set(frame, subframe=subframe)


def bone_matrices(evaluated: bpy.types.Object, bones: tuple[str, ...]) -> tuple[Array, Array]:
    """Matrices [B, 4, 4] of an evaluated armature's bones, in the armature and in the world."""
    columns = np.empty(16 * len(evaluated.pose.bones), dtype=np.float32)
    evaluated.pose.bones.foreach_get("matrix", columns)
    order = [evaluated.pose.bones.find(bone) for bone in bones]
    local = columns.reshape(-1, 4, 4).transpose(0, 2, 1)[order].astype(np.float64)
    return local, np.array(evaluated.matrix_world, dtype=np.float64) @ local


def rotations_of(matrices: Array) -> Array:
    """Quaternions of affine matrices [..., 4, 4], whatever their scale."""
    turns = matrices[..., :3, :3]
    return quat_from_matrix(turns / np.linalg.norm(turns, axis=-2, keepdims=True))
