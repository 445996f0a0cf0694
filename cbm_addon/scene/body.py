"""Body avoidance: the whole pose of an armature keeps clear of the scene, as an action of its own above what animates it."""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, field, replace

import bpy
import numpy as np

from ..body.avoid import BodyOptions, BodyResult, avoiding
from ..body.model import load_body_model
from ..body.shape import BodyShape, Part, body_shape, standard_parts
from ..errors import InputError
from ..hands.obstacle import Obstacle
from ..hands.shapes import Scaled
from ..motion.motion import Motion, local_rotations
from ..motion.rotations import Array, continuous, inverse, multiply, rotate
from ..motion.skeleton import Skeleton
from ..progress import Progress, part
from ..rigs.body import RigBody, rig_body
from ..rigs.rig import Rig
from ..rigs.tables import Table
from ..rigs.travel import Way, without_way
from ..takes.synthesize import TRACKED_JOINTS
from .action import new_action, scene_rate, unlocked_animation
from .bake import rig_channels
from .colliders import fitted_body
from .layers import remove_earlier, require_layer, without_earlier
from .nla import PART, hold_unkeyed, play_above
from .obstacles import SceneObstacles
from .rig import read_rig
from .rigged_hands import bone_matrices, played, rotations_of

BODY = "body"  # what the actions that are written here are marked with
HEAD_HEIGHT = 1.6  # metres at which the engine's constants of the body mean what they say
COARSER = 5.0  # how much less exact the distances are than those that fingers need
REACH = 0.5  # metres from a joint: what is further away cannot meet the body
PIERCED = 0.01  # metres that show


@dataclass(frozen=True)
class ClearOptions:
    """What is cleared, and how.

    collection  where the obstacles are; None for everything visible that does not belong to the character
    frames      first and last; None for those of the scene
    solve       strength, hold, seed
    table       the user's map of the rig's bones; None recognises them
    """

    collection: bpy.types.Collection | None = None
    frames: tuple[int, int] | None = None
    solve: BodyOptions = field(default_factory=BodyOptions)
    table: Table | None = None


@dataclass(frozen=True)
class BodyReport:
    """What body avoidance made. Lengths are those of a person of ordinary size.

    action          "" if nothing had to be done
    pierced_before  frames in which the body is more than a centimetre inside
    moved           how far head and wrists were moved, by joint, the largest in centimetres
    """

    action: str
    frames: int
    first_frame: int
    fps: float
    seconds: float
    obstacles: list[str]
    pierced_before: int
    pierced_after: int
    max_depth_before_cm: float
    max_depth_after_cm: float
    moved: dict[str, float]

    @property
    def summary(self) -> str:
        """In one line."""
        if not self.action:
            return f"the body meets nothing in {self.frames} frames"
        moved = ", ".join(f"{joint} {value:.1f} cm" for joint, value in self.moved.items())
        line = f"{self.action}: {self.pierced_before} of {self.frames} frames pierced, {self.pierced_after} do now"
        return f"{line}, {self.max_depth_after_cm:.1f} cm at most (before {self.max_depth_before_cm:.1f}); moved at most: {moved}; {self.seconds:.1f} s"


def clear_body(context: bpy.types.Context, armature: bpy.types.Object, options: ClearOptions) -> Generator[Progress, None, BodyReport]:
    """Moves the body of an armature out of what it pierces, and writes that as a new action on an NLA track above all others, in strips over the
    frames that needed it.

    Nothing is changed before the last event. An earlier result is left out of what is read, and gives way to the new one; its action stays in
    the file. InputError if the armature is no body or cannot be animated.
    """
    started = time.perf_counter()
    scene = context.scene
    require_layer(armature)
    rig = read_rig(armature, options.table)
    solved = rig_body(rig)
    first, last = options.frames or (scene.frame_start, scene.frame_end)
    if last < first:
        raise InputError(f"frames {first} to {last}", "are none; the first must not be after the last")
    frames = np.arange(first, last + 1)
    unit = solved.body.height_above_toes() / HEAD_HEIGHT
    seen = _Seen(armature, rig, solved, SceneObstacles(armature, options.collection, COARSER * unit, REACH / COARSER), unit)
    with without_earlier(armature, BODY):
        for i, depsgraph in enumerate(played(context, frames)):
            yield Progress(0.3 * i / len(frames), f"reading frame {frames[i]}")
            seen.look(depsgraph)
    rate = scene_rate(scene)
    motion = seen.motion(frames / rate)
    shape = _shape(armature, rig, solved, unit)
    result = yield from part(avoiding(motion, shape, seen.around(), load_body_model(), options.solve), 0.3, 0.95)
    yield Progress(0.95, "writing keys")
    action = _write(armature, rig, solved, seen, frames, _in_world(result.motion, solved.body, unit), motion, result)
    return _report(action, frames, rate, time.perf_counter() - started, seen.obstacles.names, motion, result)


class _Seen:
    """Where the joints of an armature are and what is around them, once every frame was looked at; in metres of a person of ordinary size."""

    def __init__(self, armature: bpy.types.Object, rig: Rig, solved: RigBody, obstacles: SceneObstacles, unit: float) -> None:
        obstacles.begin()
        self.obstacles = obstacles
        self._armature, self._rig, self._solved, self._unit = armature, rig, solved, unit
        self._bones = tuple(rig.mapping.joints[joint] for joint in solved.body.names)
        self._root = rig.mapping.root
        self._world: list[Array] = []
        self._carried: list[Array] = []

    def look(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Takes in the scene at its current frame."""
        bones = (*self._bones, *([self._root] if self._root else []))
        evaluated = self._armature.evaluated_get(depsgraph)
        _, world = bone_matrices(evaluated, bones)
        carrier = np.array(evaluated.matrix_world, dtype=np.float64) @ np.linalg.inv(self._rig.object_matrix)
        if self._root:
            carrier = world[-1] @ np.linalg.inv(self._rig.object_matrix @ self._rig.rest[self._rig.index(self._root)])
        self._carried.append(carrier)
        world = world[: len(self._bones)]
        self._world.append(world)
        places = world[:, :3, 3] / (COARSER * self._unit)
        self.obstacles.look(depsgraph, places, places[self._solved.body.index("Head")])

    def motion(self, times: Array) -> Motion:
        """What the armature does, on its own body."""
        world = np.stack(self._world)
        rests = np.stack([multiply(self._rig.object_rotation, self._rig.rest_rotation(bone)) for bone in self._bones])
        rotations = multiply(multiply(rotations_of(world), inverse(rests)), inverse(self._solved.alignment))
        body = self._solved.body.scaled(1 / self._unit)
        local = continuous(local_rotations(body, rotations)).astype(np.float32)
        return Motion(body, times, (world[:, 0, :3, 3] / self._unit).astype(np.float32), local)

    def around(self) -> Callable[[int], Obstacle]:
        """What the body may meet at a frame."""
        scaled: dict[int, Obstacle] = {}

        def at(frame: int) -> Obstacle:
            obstacle = self.obstacles.at(frame)
            return scaled.setdefault(id(obstacle), Scaled(obstacle, COARSER))

        return at

    def carrier(self) -> Way:
        """What carries the body along in each frame: the bone above its hips, or the armature's object."""
        matrices = np.stack(self._carried)
        return Way(rotations_of(matrices), matrices[:, :3, 3])


def _shape(armature: bpy.types.Object, rig: Rig, solved: RigBody, unit: float) -> BodyShape:
    """The body as thick as the armature's skin has it, and standard hands."""
    body = solved.body.scaled(1 / unit)
    parts = []
    for collider in fitted_body(armature, rig, [])[0]:
        turn, head = solved.alignment[body.index(collider.joint)], rig.head(rig.mapping.joints[collider.joint])
        start, end = (rotate(turn, place - head) / unit for place in (collider.start, collider.end))
        first, second = collider.radii
        parts.append(Part(collider.joint, start, end, (first / unit, second / unit), rotate(turn, collider.beside) / unit))
    return body_shape(body, [*parts, *(part for part in standard_parts(body) if part.joint.endswith("Hand"))], solved.sole / unit)


def _in_world(motion: Motion, body: Skeleton, unit: float) -> Motion:
    return replace(motion, skeleton=body, root=motion.root * np.float32(unit))


def _write(
    armature: bpy.types.Object, rig: Rig, solved: RigBody, seen: _Seen, frames: np.ndarray, freed: Motion, motion: Motion, result: BodyResult
) -> bpy.types.Action | None:
    """The action of the stretches in which something was changed, on a track of its own; None if nothing was."""
    changed = np.any(result.motion.rotations != motion.rotations, axis=(1, 2)) | np.any(result.motion.root != motion.root, axis=-1)
    stretches = [(int(frames[start]), int(max(frames[end - 1], frames[start] + 1))) for start, end in _runs(changed)]  # no strip is shorter than a frame
    unlocked_animation(armature)
    if not stretches:
        remove_earlier(armature, BODY, {channel.data_path for channel in rig_channels(armature, rig, solved, freed)})
        return None
    channels = list(rig_channels(armature, rig, solved, without_way(freed, seen.carrier())))
    kept = np.concatenate([np.arange(start, min(end, frames[-1]) + 1) for start, end in stretches]) - frames[0]
    channels = [replace(channel, values=channel.values[kept]) for channel in channels]
    action, slot = new_action(armature, f"{armature.name} Body", frames[kept], channels)
    action[PART], action.use_fake_user = BODY, True
    remove_earlier(armature, BODY, {channel.data_path for channel in channels})
    hold_unkeyed(armature, f"{armature.name} Unkeyed", channels, frames)
    play_above(armature, action, slot, frames, stretches)
    return action


def _runs(mask: np.ndarray) -> Iterator[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate(([0], mask.astype(int), [0]))))
    return zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)


def _report(
    action: bpy.types.Action | None, frames: np.ndarray, rate: float, seconds: float, obstacles: list[str], motion: Motion, result: BodyResult
) -> BodyReport:
    tracked = motion.skeleton.indices(TRACKED_JOINTS)
    moved = np.linalg.norm(result.motion.positions()[:, tracked] - motion.positions()[:, tracked], axis=-1).max(0)
    return BodyReport(
        action=action.name if action else "",
        frames=len(frames),
        first_frame=int(frames[0]),
        fps=rate,
        seconds=seconds,
        obstacles=obstacles,
        pierced_before=int((result.before > PIERCED).sum()),
        pierced_after=int((result.after > PIERCED).sum()),
        max_depth_before_cm=float(100 * max(0, result.before.max())),
        max_depth_after_cm=float(100 * max(0, result.after.max())),
        moved={joint: float(100 * value) for joint, value in zip(TRACKED_JOINTS, moved, strict=True)},
    )
