"""A proxy body for an armature without a mesh: one mesh, one rounded piece for each deforming bone that matters."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import bpy
import numpy as np

from ..motion.rotations import normalize
from ..rigs.rig import Rig
from .rig import read_rig

SIDES = 12  # corners of a ring
PALE, LEFT, RIGHT, DARK = range(4)
COLOURS = {
    "CBM Proxy": (0.70, 0.68, 0.65, 1),
    "CBM Proxy Left": (0.20, 0.45, 0.78, 1),
    "CBM Proxy Right": (0.85, 0.40, 0.16, 1),
    "CBM Proxy Visor": (0.05, 0.05, 0.06, 1),
}

# All sizes are shares of the standing height of the head joint (1.6 m in an adult): half width and half depth along a part, from its
# joint (0) to the next (1).
LIMBS = {
    "Shoulder": ((0.0, 0.010, 0.010), (0.5, 0.024, 0.024), (1.0, 0.034, 0.036)),
    "Arm": ((0.0, 0.034, 0.034), (0.35, 0.033, 0.034), (1.0, 0.024, 0.025)),
    "ForeArm": ((0.0, 0.025, 0.026), (0.3, 0.027, 0.026), (1.0, 0.017, 0.016)),
    "UpLeg": ((0.0, 0.054, 0.058), (0.3, 0.053, 0.056), (1.0, 0.034, 0.036)),
    "Leg": ((0.0, 0.034, 0.036), (0.3, 0.035, 0.040), (1.0, 0.021, 0.023)),
    "Neck": ((0.0, 0.036, 0.036), (1.0, 0.033, 0.035)),
}
# The trunk, by height from the hip joints (0) to the arm joints (1).
TRUNK = ((-0.12, 0.082, 0.062), (0.05, 0.100, 0.070), (0.35, 0.086, 0.060), (0.75, 0.104, 0.072), (0.93, 0.106, 0.066), (1.02, 0.084, 0.054), (1.12, 0.042, 0.038))
PALM = ((0.0, 0.018, 0.012), (0.5, 0.026, 0.013), (1.0, 0.024, 0.010))
FINGER = 0.0055
HEAD = (0.050, 0.062, 0.078)  # half sizes
ALIGNED = 0.7  # cosine between a bone and the part that it runs along
BESIDE = 0.04  # how far its ends may be from the part
SHORTEST = 0.025


@dataclass(frozen=True)
class Piece:
    """A part of the mesh that one bone moves: rings float64 [N, SIDES, 3] from end to end, world units at rest."""

    bone: str
    rings: np.ndarray
    material: int


def has_mesh(armature: bpy.types.Object) -> bool:
    """Whether a mesh of the file follows the armature."""
    return bool(meshes_of(armature))


def meshes_of(armature: bpy.types.Object) -> list[bpy.types.Object]:
    """The meshes that an armature deforms or carries."""
    return [
        obj
        for obj in bpy.data.objects
        if obj.type == "MESH" and (obj.parent == armature or any(mod.type == "ARMATURE" and mod.object == armature for mod in obj.modifiers))
    ]


def add_proxy(armature: bpy.types.Object) -> bpy.types.Object:
    """A new mesh object beside the armature that follows its deforming bones. The armature itself is not changed."""
    rig = read_rig(armature)
    deforming = [bone.name for bone in armature.data.bones if bone.use_deform]
    pieces = list(_pieces(rig, deforming))
    mesh = bpy.data.meshes.new("CBM Proxy")
    corners, faces = _surface(pieces)
    mesh.from_pydata(rig.to_armature(corners).tolist(), [], faces)
    for name, colour in COLOURS.items():
        material = bpy.data.materials.get(name) or bpy.data.materials.new(name)
        material.diffuse_color = colour
        mesh.materials.append(material)
    per_piece = [len(piece.rings) for piece in pieces]
    mesh.polygons.foreach_set("material_index", np.repeat([piece.material for piece in pieces], [_face_count(count) for count in per_piece]))
    mesh.polygons.foreach_set("use_smooth", np.ones(len(faces), dtype=bool))
    proxy = bpy.data.objects.new("CBM Proxy", mesh)
    proxy.parent = armature
    (armature.users_collection or (bpy.context.scene.collection,))[0].objects.link(proxy)
    first = 0
    for piece in pieces:
        group = proxy.vertex_groups.get(piece.bone) or proxy.vertex_groups.new(name=piece.bone)
        count = len(piece.rings) * SIDES
        group.add(range(first, first + count), 1.0, "REPLACE")
        first += count
    proxy.modifiers.new("Armature", "ARMATURE").object = armature
    return proxy


def _face_count(rings: int) -> int:
    return (rings - 1) * SIDES + 2


def _surface(pieces: list[Piece]) -> tuple[np.ndarray, list[list[int]]]:
    """Corners [V, 3] and faces of all pieces: bands between rings, and a cap at each end."""
    faces: list[list[int]] = []
    first = 0
    around = np.arange(SIDES)
    for piece in pieces:
        for ring in range(len(piece.rings) - 1):
            low = first + ring * SIDES + around
            faces += np.stack((low, np.roll(low, -1), np.roll(low, -1) + SIDES, low + SIDES), axis=-1).tolist()
        last = first + (len(piece.rings) - 1) * SIDES
        faces += [(first + around[::-1]).tolist(), (last + around).tolist()]
        first = last + SIDES
    return np.concatenate([piece.rings.reshape(-1, 3) for piece in pieces]), faces


class _Body:
    """Where the rig's joints are at rest, and how large it is."""

    def __init__(self, rig: Rig) -> None:
        self.rig = rig
        joints = rig.mapping.joints
        self.heads = {joint: rig.head(bone) for joint, bone in joints.items()}
        self.children = {joint: [below for below, above in rig.mapping.parents.items() if above == joint] for joint in joints}
        self.floor = min(rig.object_matrix[2, 3], self.heads["LeftFoot"][2], self.heads["RightFoot"][2])
        self.unit = self.heads["Head"][2] - self.floor
        across = self.heads["LeftUpLeg"] - self.heads["RightUpLeg"]
        self.left = normalize(across * [1, 1, 0])
        self.front = np.cross(self.left, [0, 0, 1.0])

    def end(self, joint: str) -> np.ndarray:
        """Where the part that begins at a joint ends: the next joint of its chain, or the tail of its bone."""
        side = next((side for side in ("Left", "Right") if joint.startswith(side)), "")
        chain = [f"{side}{name}" for name in ("Shoulder", "Arm", "ForeArm", "Hand", "UpLeg", "Leg", "Foot", "Toe")]
        following = [child for child in self.children[joint] if side == "" or child in chain]
        spine = [child for child in following if not child.startswith(("Left", "Right"))]
        if joint == "Head" or not following:
            return self.rig.tail(self.rig.mapping.joints[joint])
        return self.heads[(spine or following)[0]]


def _pieces(rig: Rig, deforming: list[str]) -> Iterator[Piece]:
    body = _Body(rig)
    joints = list(rig.mapping.joints)
    ends = {joint: body.end(joint) for joint in joints}
    parts: dict[str, list[str]] = {joint: [] for joint in joints}
    for bone in deforming:
        middle = (rig.head(bone) + rig.tail(bone)) / 2
        nearest = min(joints, key=lambda joint: _distance(middle, body.heads[joint], ends[joint]))
        parts[nearest].append(bone)
    for joint, bones in parts.items():
        for bone in _that_matter(body, joint, ends[joint], bones):
            yield from _piece(body, joint, ends[joint], bone)


def _distance(point: np.ndarray, start: np.ndarray, end: np.ndarray) -> float:
    along = end - start
    share = np.clip(np.dot(point - start, along) / max(np.dot(along, along), 1e-12), 0, 1)
    return float(np.linalg.norm(point - start - share * along))


def _that_matter(body: _Body, joint: str, end: np.ndarray, bones: list[str]) -> list[str]:
    """The bones of a part that get a piece: all of a hand's, the longest of the head's, elsewhere those that run along the part."""
    rig, start = body.rig, body.heads[joint]
    if joint.endswith("Hand"):
        return bones
    if joint == "Head":
        return sorted(bones, key=lambda bone: -rig.lengths[rig.index(bone)])[:1]

    def along(bone: str) -> bool:
        head, tail = rig.head(bone), rig.tail(bone)
        beside = max(_distance(head, start, end), _distance(tail, start, end)) < BESIDE * body.unit
        return beside and np.linalg.norm(tail - head) > SHORTEST * body.unit and abs(np.dot(normalize(tail - head), normalize(end - start))) > ALIGNED

    return [bone for bone in bones if along(bone)]


def _piece(body: _Body, joint: str, end: np.ndarray, bone: str) -> Iterator[Piece]:
    rig, unit = body.rig, body.unit
    head, tail, start = rig.head(bone), rig.tail(bone), body.heads[joint]
    material = PALE if joint.endswith("Shoulder") else LEFT if joint.startswith("Left") else RIGHT if joint.startswith("Right") else PALE
    name = joint.removeprefix("Left").removeprefix("Right")
    if name == "Head":
        yield from _head(body, bone)
    elif name in ("Foot", "Toe"):
        yield Piece(bone, _sole_rings(body, joint, bone), material)
    elif name == "Hand":
        own = bone == rig.mapping.joints[joint] or _distance(head, start, start) < 0.01 * unit
        profile = PALM if own else ((0.0, FINGER, FINGER), (1.0, 0.8 * FINGER, 0.8 * FINGER))
        yield Piece(bone, _tube(head, tail, _scaled(profile, unit), body.front), material)
    elif name in LIMBS:
        yield Piece(bone, _tube(head, tail, _scaled(_between(LIMBS[name], start, end, head, tail), unit), body.left), material)
    else:
        bottom = (body.heads["LeftUpLeg"] + body.heads["RightUpLeg"]) / 2
        top = (body.heads["LeftArm"] + body.heads["RightArm"]) / 2
        head, tail = head - 0.1 * (tail - head), tail + 0.1 * (tail - head)  # pieces overlap, so that a bent trunk shows no gaps
        if name == "Hips":  # the pelvis reaches below its bone
            head = head - np.array([0, 0, 0.04 * unit])
        yield Piece(bone, _tube(head, tail, _scaled(_between(TRUNK, bottom, top, head, tail), unit), body.left, 0.25), material)


Profile = tuple[tuple[float, float, float], ...]


def _scaled(profile: Profile, unit: float) -> Profile:
    return tuple((share, width * unit, depth * unit) for share, width, depth in profile)


def _between(profile: Profile, start: np.ndarray, end: np.ndarray, head: np.ndarray, tail: np.ndarray) -> Profile:
    """The stretch of a part's profile that one bone covers, its shares counted from the bone's head (0) to its tail (1)."""
    along = (end - start) / np.dot(end - start, end - start)
    first, last = np.dot(head - start, along), np.dot(tail - start, along)
    shares, widths, depths = np.array(profile).T
    inner = shares[(shares > min(first, last)) & (shares < max(first, last))]
    at = np.concatenate(([first], inner if last > first else inner[::-1], [last]))
    own = (at - first) / (last - first) if last != first else np.linspace(0, 1, len(at))
    return tuple(zip(own.tolist(), np.interp(at, shares, widths).tolist(), np.interp(at, shares, depths).tolist(), strict=True))


def _tube(head: np.ndarray, tail: np.ndarray, profile: Profile, width_axis: np.ndarray, roundness: float = 0.6) -> np.ndarray:
    """Rings of a tube from head to tail with rounded ends; `width_axis` is made perpendicular to it."""
    along = tail - head
    length = np.linalg.norm(along)
    direction = along / max(length, 1e-9)
    wide = normalize(width_axis - np.dot(width_axis, direction) * direction)
    deep = np.cross(direction, wide)
    angles = 2 * np.pi * np.arange(SIDES) / SIDES
    circle = np.cos(angles)[:, None] * wide, np.sin(angles)[:, None] * deep

    def ring(centre: np.ndarray, width: float, depth: float) -> np.ndarray:
        return centre + circle[0] * width + circle[1] * depth

    rings = [ring(head + share * along, width, depth) for share, width, depth in profile]
    for outward, (share, width, depth) in ((-direction, profile[0]), (direction, profile[-1])):
        centre, bulge = head + share * along, roundness * min(width, depth)
        cap = [ring(centre + outward * bulge * np.sin(turn), width * np.cos(turn), depth * np.cos(turn)) for turn in np.radians((35, 65, 85))]
        # The ring at the edge is there twice, so that the cap does not bend the shading of the tube.
        rings = [*cap[::-1], rings[0], *rings] if outward is not direction else [*rings, rings[-1], *cap]
    return np.stack(rings)


def _box_ring(centre: np.ndarray, wide: np.ndarray, high: np.ndarray) -> np.ndarray:
    """A ring with the outline of a rounded box, whose half sides are the vectors `wide` and `high`."""
    angles = 2 * np.pi * (np.arange(SIDES) + 0.5) / SIDES
    across, up = (np.sign(value) * np.abs(value) ** 0.5 for value in (np.cos(angles), np.sin(angles)))
    return centre + across[:, None] * wide + up[:, None] * high


def _sole_rings(body: _Body, joint: str, bone: str) -> np.ndarray:
    """A foot from heel to ball, or its toes: flat on the floor of the rest pose."""
    ankle = body.heads[joint.replace("Toe", "Foot")]
    ball = body.heads[joint] if joint.endswith("Toe") else body.end(joint)
    along = (ball - ankle) * [1, 1, 0]
    height = ankle[2] - body.floor
    if joint.endswith("Toe"):
        toes = np.linalg.norm(body.rig.tail(bone) - body.rig.head(bone)) * normalize(along)
        stations = [(ball + share * toes, 0.031 * size, 0.40 * height * size) for share, size in ((-0.15, 0.9), (0, 1.0), (0.6, 0.95), (0.95, 0.75))]
    else:
        sizes = ((-0.42, 0.020, 0.5), (-0.36, 0.024, 0.85), (0.0, 0.026, 1.1), (0.35, 0.028, 0.85), (1.0, 0.031, 0.42))
        stations = [(ankle + share * along, width, tall * height) for share, width, tall in sizes]
    side = np.cross([0, 0, 1.0], normalize(along))
    rings = []
    for at, width, tall in stations:
        centre = np.array([at[0], at[1], body.floor + tall / 2])
        rings.append(_box_ring(centre, side * width * body.unit, np.array([0, 0, tall / 2])))
    return np.stack(rings)


def _head(body: _Body, bone: str) -> Iterator[Piece]:
    """A skull, and over its eyes the headset that shows where it faces."""
    width, depth, height = (size * body.unit for size in HEAD)
    centre = body.heads["Head"] + body.front * 0.016 * body.unit + np.array([0, 0, 0.72 * height])
    turns = np.radians(np.linspace(-88, 88, 9))
    angles = 2 * np.pi * np.arange(SIDES) / SIDES
    circle = np.cos(angles)[:, None] * body.left * width - np.sin(angles)[:, None] * body.front * depth
    yield Piece(bone, np.stack([centre + np.cos(turn) * circle + [0, 0, np.sin(turn) * height] for turn in turns]), PALE)
    eyes = centre + body.front * 0.75 * depth + [0, 0, 0.12 * height]
    rings = [
        _box_ring(eyes + body.front * share * depth, body.left * size * width, np.array([0, 0, 0.36 * size * height]))
        for share, size in ((-0.3, 1.0), (0.25, 0.98), (0.55, 0.85))
    ]
    yield Piece(bone, np.stack(rings), DARK)
