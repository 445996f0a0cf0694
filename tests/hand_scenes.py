"""Scenes in which fingers pierce something: a rig whose arms and fingers are animated, and what is in their way.

Things are placed in the frame of the left wrist in the first of the arm's poses, for a hand of 19 cm: X along the hand, -Y to its thumb, Z out of
its back.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import bpy
import numpy as np

from cbm_addon.hands.hand import Hand
from cbm_addon.hands.poses import POSES
from cbm_addon.hands.sensor import HAND_LENGTH
from cbm_addon.motion.motion import Motion
from cbm_addon.motion.rotations import IDENTITY, matrix_from_quat, multiply, quat_from_rotvec, slerp
from cbm_addon.rigs.body import rig_body
from cbm_addon.rigs.fingers import finger_bones, finger_poses, read_before
from cbm_addon.rigs.rig import Rig
from cbm_addon.scene.action import rotation_channel, scene_rate, write_action
from cbm_addon.scene.bake import rig_channels
from cbm_addon.scene.rig import read_rig
from cbm_addon.scene.rigged_hands import rotations_of
from tests import triangles as made

Turn = tuple[float, float, float]


@dataclass(frozen=True)
class HandScene:
    """What a user may have made.

    arm      joint of the left arm -> rotation vectors [3] in degrees between which it goes to and fro, against the T-pose; the right one does
             the same in a mirror if `both`
    curl     the poses between which the fingers go
    things   meshes, and how they are turned and where they are
    """

    arm: dict[str, tuple[Turn, Turn]]
    curl: tuple[str, str]
    things: Callable[[], list[tuple[made.Mesh, Turn, Turn]]] = list
    both: bool = False


def box(x: float, y: float, z: float, steps: int = 1) -> made.Mesh:
    return made.box(np.array([x, y, z]), steps)


SCENES = {
    "sphere": HandScene({"Arm": ((0, 0, 0), (0, 2, 0))}, ("relaxed", "fist"), lambda: [(made.sphere(0.045), (0, 0, 0), (0.115, -0.01, -0.072))]),
    "cube": HandScene({"Arm": ((0, 0, 0), (0, 1.5, 0))}, ("relaxed", "fist"), lambda: [(box(0.03, 0.05, 0.03), (0, 0, 0), (0.125, 0, -0.06))]),
    "mug": HandScene({"Arm": ((-80, 0, 0), (-80, 0, 1.5))}, ("relaxed", "fist"), lambda: [(made.mug(), (90, 0, 0), (0.115, 0.045, -0.066))]),
    "plate edge": HandScene({"Arm": ((0, 0, 0), (0, 1.2, 0))}, ("relaxed", "fist"), lambda: [(box(0.08, 0.1, 0.0025, 8), (0, 0, 0), (0.2, 0, -0.04))]),
    "table top": HandScene({"Arm": ((0, 0, 0), (0, 1.5, 0))}, ("flat", "relaxed"), lambda: [(box(0.25, 0.25, 0.02, 4), (0, 0, 0), (0.15, 0, -0.055))]),
    "two hands": HandScene({"Arm": ((0, 0, -101), (0, 0, -105)), "Hand": ((-80, 0, 0), (-80, 0, 0))}, ("flat", "relaxed"), both=True),
    "thigh": HandScene({"Arm": ((0, 84, 0), (0, 92, 0)), "Hand": ((0, 0, 0), (0, 0, 0))}, ("flat", "relaxed")),
}  # fmt: skip


def turned_by(degrees: Turn) -> np.ndarray:
    """A quaternion."""
    return quat_from_rotvec(np.radians(np.array(degrees, float)))


def to_and_fro(frames: int) -> np.ndarray:
    """Shares [T] from 0 to 1 and back."""
    return 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(frames) / max(frames - 1, 1))


def animate(armature: bpy.types.Object, shown: HandScene, frames: int) -> Rig:
    """Gives an armature an action of arms and fingers, as a user's own, from the scene's first frame on."""
    context, scene = bpy.context, bpy.context.scene
    rig = read_rig(armature)
    solved = rig_body(rig)
    share = to_and_fro(frames)
    turns = np.zeros((frames, len(solved.body), 4), np.float32)
    turns[..., 0] = 1
    for joint, between in shown.arm.items():
        first, second = map(turned_by, between)
        turns[:, solved.body.index(f"Left{joint}")] = slerp(np.tile(first, (frames, 1)), np.tile(second, (frames, 1)), share)
        if shown.both:
            turns[:, solved.body.index(f"Right{joint}")] = turns[:, solved.body.index(f"Left{joint}")] * [1, 1, -1, -1]
    times = np.arange(frames) / scene_rate(scene)
    root = np.tile(rig.head(rig.mapping.joints["Hips"]), (frames, 1)).astype(np.float32)
    motion = Motion(solved.body, times, root, turns)
    numbers = scene.frame_start + np.arange(frames)
    scene.frame_end = int(numbers[-1])
    channels = list(rig_channels(armature, rig, solved, motion))
    body = write_action(armature, "body", numbers, channels, fake_user=False)
    for side in ("Left", "Right"):
        fingers = finger_bones(rig, side)
        hand = Hand.from_rest(side.lower(), fingers.positions)
        start, end = (POSES[name] for name in shown.curl)
        bent = hand.turns((start + share[:, None] * (end - start)).astype(np.float32))
        to_armature = np.linalg.inv(rig.object_matrix)
        matrices = evaluated_matrices(armature, read_before(rig, fingers), numbers)
        rotations = {bone: rotations_of(to_armature @ world) for bone, world in matrices.items()}
        keyed = finger_poses(rig, fingers, bent, rotations)
        channels += [rotation_channel(armature.pose.bones[pose.bone], pose.rotation) for pose in keyed]
    known = {channel.data_path: channel for channel in channels}
    write_action(armature, "user", numbers, list(known.values()))
    bpy.data.actions.remove(body)
    context.view_layer.update()
    return rig


def strip_curves(armature: bpy.types.Object, unwanted: Callable[[bpy.types.FCurve], bool]) -> None:
    """Removes curves of an armature's action."""
    data = armature.animation_data
    curves = data.action.fcurves if not hasattr(data.action, "slots") else data.action.layers[0].strips[0].channelbag(data.action_slot).fcurves
    for curve in [curve for curve in curves if unwanted(curve)]:
        curves.remove(curve)


def evaluated_matrices(armature: bpy.types.Object, bones, numbers: np.ndarray) -> dict[str, np.ndarray]:
    """World matrices [T, 4, 4] of pose bones from the dependency graph."""
    found: dict[str, list] = {bone: [] for bone in bones}
    for number in numbers:
        bpy.context.scene.frame_set(int(number))
        posed = armature.evaluated_get(bpy.context.evaluated_depsgraph_get())
        for bone in bones:
            found[bone].append(np.array(posed.matrix_world @ posed.pose.bones[bone].matrix))
    return {bone: np.array(matrices) for bone, matrices in found.items()}


def add_things(armature: bpy.types.Object, rig: Rig, shown: HandScene) -> list[bpy.types.Object]:
    """The scene's things, where the left wrist is at its first frame."""
    scene = bpy.context.scene
    fingers = finger_bones(rig, "Left")
    scale = fingers.length / HAND_LENGTH
    wrist = evaluated_matrices(armature, [fingers.wrist], np.array([scene.frame_start]))[fingers.wrist][0]
    turn = multiply(*(turned_by(shown.arm[joint][0]) if joint in shown.arm else IDENTITY for joint in ("Arm", "Hand")))
    things = []
    for (vertices, triangles), turned, place in shown.things():
        local = vertices @ matrix_from_quat(turned_by(turned)).T + np.array(place)
        mesh = bpy.data.meshes.new("Thing")
        mesh.from_pydata((scale * local @ matrix_from_quat(turn).T + wrist[:3, 3]).tolist(), [], triangles.tolist())
        things.append(bpy.data.objects.new("Thing", mesh))
        scene.collection.objects.link(things[-1])
    return things
