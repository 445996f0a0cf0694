"""Armatures and motion: a new armature for a skeleton, a motion as keys of an armature's bones, and an armature's poses as a motion.

Turns are transferred in the world: a bone turns from its rest pose as its joint turns from its own. Where the two rest poses differ
(a T-pose and an A-pose), the bone is first laid along its joint's bone.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import bpy
import mathutils
import numpy as np

from ..errors import InputError
from ..motion.motion import Motion, local_rotations
from ..motion.rotations import Array, angle, inverse, multiply, normalize, quat_between, quat_from_matrix, quat_from_yaw, rotate
from ..motion.skeleton import Skeleton
from .action import Channel, location_channel, rotation_channel, scene_rate

SAME_POSE = np.radians(20)  # rest poses that differ by less differ in proportions, not in pose
STILL = 1e-4  # a joint that moves in its parent by less than this share of the skeleton's size does not move


# A new armature


def new_armature(context: bpy.types.Context, name: str, skeleton: Skeleton) -> bpy.types.Object:
    """A new armature in the active collection with one bone per joint, at rest where the joints are at rest.

    A bone points to its joint's children, or its tip; its Z axis to the front (-Y), or up if it points there itself. The new object
    becomes the selected and active one, as after every import, and the mode becomes object mode.
    """
    if context.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    for other in context.selected_objects:
        other.select_set(False)
    obj = bpy.data.objects.new(name, bpy.data.armatures.new(name))
    context.collection.objects.link(obj)
    obj.select_set(True)
    context.view_layer.objects.active = obj
    bpy.ops.object.mode_set(mode="EDIT")
    heads = skeleton.rest_positions()
    bones: list[bpy.types.EditBone] = []
    for joint, bone_vector in enumerate(_bone_vectors(skeleton)):
        bone = obj.data.edit_bones.new(skeleton.names[joint])
        bone.head = heads[joint]
        bone.tail = heads[joint] + bone_vector
        bone.align_roll((0, 0, 1) if abs(bone_vector[1]) > 0.9 * np.linalg.norm(bone_vector) else (0, -1, 0))
        if skeleton.parents[joint] >= 0:
            bone.parent = bones[skeleton.parents[joint]]
        bones.append(bone)
    bpy.ops.object.mode_set(mode="OBJECT")
    return obj


def _bone_vectors(skeleton: Skeleton) -> Array:
    """From each bone's head to its tail [J, 3]: to the middle of the children or to the tip; else on from the parent, half as long."""
    size = np.ptp(skeleton.rest_positions(), axis=0).max() or 1.0
    vectors = np.zeros((len(skeleton), 3), dtype=np.float32)
    for joint, parent in enumerate(skeleton.parents):
        children = skeleton.offsets[skeleton.parents == joint]
        vector = children.mean(axis=0) if len(children) else np.nan_to_num(skeleton.tips[joint])
        if np.linalg.norm(vector) < 0.01 * size:
            vector = vectors[parent] / 2 if parent >= 0 else np.array([0, 0, 0.1 * size])
        vectors[joint] = vector
    return vectors


# A motion as keys


@dataclass(frozen=True)
class _Link:
    """A bone that follows a joint.

    bone    the pose bone
    joint   index of its joint
    anchor  index of the joint of the nearest bone above it that follows one too; -1 for none, or if it does not inherit rotation
    before, after  quaternions: with G the turn of a joint in the world, the bone's own rotation is before G(anchor)⁻¹ G(joint) after
    moves_freely   no bone above it follows a joint: it is also put where its joint is
    """

    bone: bpy.types.PoseBone
    joint: int
    anchor: int
    before: Array
    after: Array
    moves_freely: bool


def pose_channels(obj: bpy.types.Object, motion: Motion) -> Iterator[Channel]:
    """The channels that make the armature's bones follow the joints of the same name. Bones without a joint get none.

    Names match exactly, or else without regard to case and namespace ("mixamorig:Hips"). On an armature of another size the way
    through the world is scaled about the world's origin. InputError if no bone, or none for the root, has a joint.
    """
    if obj.matrix_world.determinant() <= 0:
        raise InputError(obj.name, "the object is mirrored or has no size; apply its scale first")
    joints = match_names([bone.name for bone in obj.data.bones], motion.skeleton.names)
    _require_root(obj, motion.skeleton, joints)
    links, scale = _link(obj, motion.skeleton, joints)
    return _channels(obj, motion, links, scale)


def match_names(bones: list[str], joints: tuple[str, ...]) -> dict[str, int]:
    """Bone name -> index of the joint of that name: exactly, or without case and namespace where that is unambiguous on both sides."""

    def plain(name: str) -> str:
        return name.rsplit(":", 1)[-1].lower()

    def only(names: list[str], name: str) -> bool:
        return [plain(other) for other in names].count(plain(name)) == 1

    joint_names = [name.encode()[:63].decode(errors="ignore") for name in joints]  # as Blender cuts long names
    matched = {name: joint_names.index(name) for name in bones if name in joint_names}
    free = {plain(name): i for i, name in enumerate(joint_names) if name not in matched and only(joint_names, name)}
    matched |= {name: free[plain(name)] for name in bones if name not in matched and plain(name) in free and only(bones, name)}
    return matched


def _require_root(obj: bpy.types.Object, skeleton: Skeleton, joints: dict[str, int]) -> None:
    """The root of the motion is its first joint, or one below it as long as nothing forks."""
    if not joints:
        raise InputError(obj.name, f"no bone has the name of a joint of the motion; they are {', '.join(skeleton.names)}")
    roots = [0]
    while np.sum(skeleton.parents == roots[-1]) == 1:
        roots.append(int(np.flatnonzero(skeleton.parents == roots[-1])[0]))
    if not set(roots) & set(joints.values()):
        raise InputError(obj.name, f"no bone has the name of the motion's root; name one {' or '.join(skeleton.names[i] for i in roots)}")


def _link(obj: bpy.types.Object, skeleton: Skeleton, joints: dict[str, int]) -> tuple[list[_Link], float]:
    """The bones that follow joints, parents first, and the size of the armature in the world over that of the skeleton."""
    bones = {bone.name: bone for bone in obj.data.bones if bone.name in joints}
    world = _matrix(obj.matrix_world)
    object_turn = _rotations(world)
    source = skeleton.rest_positions()
    target = {name: world[:3, :3] @ np.array(bone.head_local) for name, bone in bones.items()}
    rests = {name: _rotations(_matrix(bone.matrix_local)) for name, bone in bones.items()}
    above: dict[str, str | None] = {name: next((p.name for p in bone.parent_recursive if p.name in joints), None) for name, bone in bones.items()}

    links = []
    lengths = np.zeros(2)
    alignments: dict[str | None, Array] = {None: _heading(source[[joints[name] for name in bones]], np.stack(list(target.values())))}
    afters: dict[str, Array] = {}
    for name, bone in bones.items():
        children = [child for child, parent in above.items() if parent == name]
        source_ways = np.array([source[joints[child]] - source[joints[name]] for child in children]).reshape(-1, 3)
        target_ways = np.array([target[child] - target[name] for child in children]).reshape(-1, 3)
        lengths += np.linalg.norm(source_ways, axis=-1).sum(), np.linalg.norm(target_ways, axis=-1).sum()
        alignments[name] = _align(alignments[above[name]], source_ways, target_ways)
        afters[name] = multiply(multiply(alignments[name], object_turn), rests[name])
        parent = above[name] if bone.use_inherit_rotation else None
        frame = multiply(inverse(rests[parent]), rests[name]) if parent else rests[name]  # of the bone at rest in the parent, in the armature
        before = inverse(multiply(afters[parent] if parent else object_turn, frame))
        links.append(
            _Link(
                bone=obj.pose.bones[name],
                joint=joints[name],
                anchor=joints[parent] if parent else -1,
                before=before.astype(np.float32),
                after=afters[name].astype(np.float32),
                moves_freely=above[name] is None,
            )
        )
    return links, float(lengths[1] / lengths[0]) if lengths.all() else 1.0


def _heading(source: Array, target: Array) -> Array:
    """The turn about Z that brings a body [N, 3] at rest to face where the same body's joints face at rest."""
    (sx, sy, _), (tx, ty, _) = (source - source.mean(axis=0)).T, (target - target.mean(axis=0)).T
    return quat_from_yaw(np.arctan2(np.sum(tx * sy - ty * sx), np.sum(tx * sx + ty * sy)))


def _align(parent: Array, source: Array, target: Array) -> Array:
    """The rotation that lays a bone's ways to its children [N, 3] along those of its joint, starting from its parent's; the parent's if that is near."""
    apart = np.minimum(np.linalg.norm(source, axis=-1), np.linalg.norm(target, axis=-1)) > 1e-6
    if not apart.any():
        return parent
    source, target = normalize(source[apart]), rotate(parent, normalize(target[apart]))
    u, spread, vt = np.linalg.svd(source.T @ target)
    if spread[1] < 0.1 * spread[0]:  # all in one direction
        turn = quat_between(target.mean(axis=0), source.mean(axis=0))
    else:
        turn = quat_from_matrix(np.matmul(u * np.array([1, 1, np.sign(np.linalg.det(u @ vt))]), vt))
    return parent if angle(turn) < SAME_POSE else multiply(turn, parent)


def _channels(obj: bpy.types.Object, motion: Motion, links: list[_Link], scale: float) -> Iterator[Channel]:
    skeleton = motion.skeleton
    parents = skeleton.parents
    to_armature = _matrix(obj.matrix_world.inverted())
    shrink = scale * np.cbrt(np.linalg.det(to_armature[:3, :3]))
    # On an armature that was made for the skeleton, every turn is a joint's own, and only the first joint moves freely.
    own = all(link.anchor == parents[link.joint] and link.moves_freely == (link.joint == 0) for link in links)
    turns, positions = (motion.rotations, motion.root[:, None]) if own else motion.forward()

    def turn_in(anchor: int, joint: int) -> Array:
        """The turn of `joint` as seen from `anchor`."""
        if anchor == parents[joint]:
            return motion.rotations[:, joint]
        return multiply(inverse(turns[:, anchor]), turns[:, joint]) if anchor >= 0 else turns[:, joint]

    for link in links:
        parent = int(parents[link.joint])
        if link.moves_freely:
            rest = _matrix(link.bone.bone.matrix_local)
            head = scale * positions[:, link.joint] @ to_armature[:3, :3].T + to_armature[:3, 3]
            yield location_channel(link.bone, (head - rest[:3, 3]) @ rest[:3, :3])
        elif motion.offsets is not None and not link.bone.bone.use_connect:
            shift = motion.offsets[:, link.joint] - skeleton.offsets[link.joint]
            if shift.any():
                shift = shift if parent == link.anchor else rotate(turn_in(link.anchor, parent), shift)
                yield location_channel(link.bone, rotate(link.before, shift) * shrink)
        yield rotation_channel(link.bone, multiply(multiply(link.before, turn_in(link.anchor, link.joint)), link.after))


# An armature's poses as a motion


def motion_from_armature(obj: bpy.types.Object, frames: np.ndarray) -> Motion:
    """What the armature's bones do in the world at those frames [T] of the context's scene, whatever moves them.

    Its rest pose is the armature's, as the object stands at the first frame; times count from there. The current frame is restored.
    """
    scene = bpy.context.scene
    current, subframe = scene.frame_current, scene.frame_subframe

    def at(frame: float) -> bpy.types.Object:
        scene.frame_set(int(frame // 1), subframe=float(frame % 1))
        return obj.evaluated_get(bpy.context.evaluated_depsgraph_get())

    try:
        skeleton, rests = _rest(at(frames[0]))
        rotations = np.empty((len(frames), len(skeleton), 4), dtype=np.float32)
        positions = np.empty((len(frames), len(skeleton), 3), dtype=np.float32)
        order = [obj.pose.bones.find(name) for name in skeleton.names]
        columns = np.empty(16 * len(skeleton), dtype=np.float32)
        for i, frame in enumerate(frames):
            posed = at(frame)
            posed.pose.bones.foreach_get("matrix", columns)
            matrices = _matrix(posed.matrix_world) @ columns.reshape(-1, 4, 4).transpose(0, 2, 1)[order]
            rotations[i] = multiply(_rotations(matrices), inverse(rests))
            positions[i] = matrices[:, :3, 3]
    finally:
        scene.frame_set(current, subframe=subframe)
    parents = skeleton.parents
    offsets = positions.copy()
    below = parents >= 0
    offsets[:, below] = rotate(inverse(rotations[:, parents[below]]), positions[:, below] - positions[:, parents[below]])
    offsets[:, 0] = skeleton.offsets[0]
    still = np.abs(offsets - skeleton.offsets).max() < STILL * np.ptp(skeleton.rest_positions(), axis=0).max()
    times = (np.asarray(frames, dtype=np.float64) - frames[0]) / scene_rate(scene)
    return Motion(skeleton, times, positions[:, 0].copy(), local_rotations(skeleton, rotations), None if still else offsets)


def _rest(obj: bpy.types.Object) -> tuple[Skeleton, Array]:
    """The armature's skeleton at rest in the world, and the world rotations [B, 4] of its bones at rest."""
    bones = list(obj.data.bones)
    names = [bone.name for bone in bones]
    parents = np.array([names.index(bone.parent.name) if bone.parent else -1 for bone in bones])
    world = _matrix(obj.matrix_world)
    rest = world @ np.stack([_matrix(bone.matrix_local) for bone in bones])
    heads = rest[:, :3, 3]
    tails = np.stack([world[:3, :3] @ bone.tail_local + world[:3, 3] for bone in bones])
    offsets = np.where(parents[:, None] >= 0, heads - heads[parents], heads)
    tips = np.where([[len(bone.children) == 0] for bone in bones], tails - heads, np.nan)
    return Skeleton(tuple(names), parents, offsets.astype(np.float32), tips.astype(np.float32)), _rotations(rest)


def _matrix(matrix: mathutils.Matrix) -> Array:
    return np.array(matrix, dtype=np.float64)


def _rotations(matrices: Array) -> Array:
    """Quaternions of affine matrices [..., 4, 4], whatever their scale."""
    turns = matrices[..., :3, :3]
    return quat_from_matrix(turns / np.linalg.norm(turns, axis=-2, keepdims=True))
