"""The shape of a simple figure around a rig's bones: rounded pieces, one for each deforming bone that matters."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..motion.rotations import normalize
from ..rigs.body import rig_body
from ..rigs.rig import Rig

CORNERS = 12  # of a ring
PALE, LEFT, RIGHT, DARK = range(4)
UP = np.array([0.0, 0, 1])

Profile = tuple[tuple[float, float, float], ...]

# All sizes are shares of the standing height of the head joint (1.6 m in an adult): half width and half depth along a part, from its
# joint (0) to the next (1).
LIMBS: dict[str, Profile] = {
    "Shoulder": ((0.0, 0.010, 0.010), (0.5, 0.024, 0.024), (1.0, 0.034, 0.036)),
    "Arm": ((0.0, 0.034, 0.034), (0.35, 0.033, 0.034), (1.0, 0.024, 0.025)),
    "ForeArm": ((0.0, 0.025, 0.026), (0.3, 0.027, 0.026), (1.0, 0.017, 0.016)),
    "UpLeg": ((0.0, 0.054, 0.058), (0.3, 0.053, 0.056), (1.0, 0.034, 0.036)),
    "Leg": ((0.0, 0.034, 0.036), (0.3, 0.035, 0.040), (1.0, 0.021, 0.023)),
    "Neck": ((0.0, 0.036, 0.036), (1.0, 0.033, 0.035)),
}
# The trunk, by height from the hip joints (0) to the arm joints (1).
TRUNK: Profile = (
    (-0.12, 0.082, 0.062), (0.05, 0.100, 0.070), (0.35, 0.086, 0.060), (0.75, 0.104, 0.072),
    (0.93, 0.106, 0.066), (1.02, 0.084, 0.054), (1.12, 0.042, 0.038),
)  # fmt: skip
PALM: Profile = ((0.0, 0.018, 0.012), (0.5, 0.026, 0.013), (1.0, 0.024, 0.010))
FINGER: Profile = ((0.0, 0.0055, 0.0055), (1.0, 0.0045, 0.0045))
# From the ankle (0) to the ball of the foot (1), and of the toes from their joint to their end: half width, and height as a share of the ankle's.
FOOT: Profile = ((-0.42, 0.020, 0.5), (-0.36, 0.024, 0.85), (0.0, 0.026, 1.1), (0.35, 0.028, 0.85), (1.0, 0.031, 0.42))
TOES: Profile = ((-0.15, 0.028, 0.36), (0.0, 0.031, 0.40), (0.6, 0.029, 0.38), (0.95, 0.023, 0.30))
HEAD = (0.050, 0.062, 0.078)  # half width, depth and height
ALIGNED = 0.7  # cosine between a bone and the part that it runs along
BESIDE = 0.04  # how far the bone's ends may be from the part
SHORTEST = 0.025  # length of a bone that gets a piece, outside of the hands


@dataclass(frozen=True)
class Piece:
    """What one bone moves: a closed tube of rings float64 [N, CORNERS, 3], world units at rest."""

    bone: str
    rings: np.ndarray
    material: int


@dataclass(frozen=True)
class _Cover:
    """A bone that gets a piece: the part of the body that it belongs to, by the joint at which that begins, and the stretch that it covers."""

    bone: str
    joint: str
    head: np.ndarray
    tail: np.ndarray


def figure(rig: Rig, deforming: list[str]) -> list[Piece]:
    """The pieces of a figure that the deforming bones of a rig carry."""
    body = _Body(rig)
    return [piece for cover in _covers(body, deforming) for piece in _pieces(body, cover)]


class _Body:
    """Where the rig's joints are at rest, where the part at each of them ends, and how large it all is."""

    def __init__(self, rig: Rig) -> None:
        self.rig, joints = rig, rig.mapping.joints
        self.heads = {joint: rig.head(bone) for joint, bone in joints.items()}
        self.ends = {joint: self._end(joint) for joint in joints}
        lowest = min(self.heads.get(f"{side}Toe", self.heads[f"{side}Foot"])[2] for side in ("Left", "Right"))
        self.floor = lowest - rig_body(rig).sole
        self.unit = self.heads["Head"][2] - self.floor
        self.left = normalize((self.heads["LeftUpLeg"] - self.heads["RightUpLeg"]) * [1, 1, 0])
        self.front = np.cross(self.left, UP)

    def _end(self, joint: str) -> np.ndarray:
        """The next joint of a part's own chain, or the tail of its bone; of a hand or toe whose bone points elsewhere, straight on."""
        side, parents = joint.removesuffix(_part(joint)), self.rig.mapping.parents
        for child, parent in parents.items():
            if parent == joint and child.removesuffix(_part(child)) == side:
                return self.heads[child]
        tail, start = self.rig.tail(self.rig.mapping.joints[joint]), self.heads[joint]
        before = self.heads[parents[joint] or joint]
        if side and np.dot(normalize(tail - start), normalize(start - before)) < ALIGNED:
            return start + np.linalg.norm(tail - start) * normalize(start - before)
        return tail


def _part(joint: str) -> str:
    return joint.removeprefix("Left").removeprefix("Right")


def _distance(point: np.ndarray, start: np.ndarray, end: np.ndarray) -> float:
    """From a point to the line between two."""
    along = end - start
    share = np.clip(np.dot(point - start, along) / max(np.dot(along, along), 1e-12), 0, 1)
    return float(np.linalg.norm(point - start - share * along))


def _covers(body: _Body, deforming: list[str]) -> Iterator[_Cover]:
    """Joints whose own bone deforms are covered by it; the others by the bones along their part. In hands every bone counts."""
    rig, joints = body.rig, body.rig.mapping.joints
    own = {joint: bone for joint, bone in joints.items() if bone in deforming}
    for joint, bone in own.items():
        yield _Cover(bone, joint, body.heads[joint], body.ends[joint])
    skulls = []
    for bone in (bone for bone in deforming if bone not in own.values()):
        head, tail = rig.head(bone), rig.tail(bone)
        joint = min(joints, key=lambda name: _distance((head + tail) / 2, body.heads[name], body.ends[name]))
        cover = _Cover(bone, joint, head, tail)
        if joint.endswith("Hand"):
            yield cover
        elif joint == "Head":
            skulls.append(cover)
        elif joint not in own and _runs_along(body, cover):
            yield cover
    if skulls and "Head" not in own:
        yield max(skulls, key=lambda cover: float(np.linalg.norm(cover.tail - cover.head)))


def _runs_along(body: _Body, cover: _Cover) -> bool:
    start, end = body.heads[cover.joint], body.ends[cover.joint]
    along = cover.tail - cover.head
    beside = max(_distance(cover.head, start, end), _distance(cover.tail, start, end)) < BESIDE * body.unit
    return beside and np.linalg.norm(along) > SHORTEST * body.unit and abs(np.dot(normalize(along), normalize(end - start))) > ALIGNED


def _pieces(body: _Body, cover: _Cover) -> Iterator[Piece]:
    part, head, tail = _part(cover.joint), cover.head, cover.tail
    start, end = body.heads[cover.joint], body.ends[cover.joint]
    sided = part != "Shoulder"
    material = LEFT if sided and cover.joint.startswith("Left") else RIGHT if sided and cover.joint.startswith("Right") else PALE
    if part == "Head":
        yield Piece(cover.bone, _skull(body), PALE)
        yield Piece(cover.bone, _visor(body), DARK)
    elif part in ("Foot", "Toe"):
        yield Piece(cover.bone, _foot(body, cover), material)
    elif part == "Hand":
        palm = _distance(head, start, start) < 0.01 * body.unit
        yield Piece(cover.bone, _tube(head, tail, PALM if palm else FINGER, body.unit, body.front), material)
    elif part in LIMBS:
        across = body.left if part in ("UpLeg", "Leg", "Neck") else body.front
        yield Piece(cover.bone, _tube(head, tail, _between(LIMBS[part], start, end, head, tail), body.unit, across), material)
    else:
        bottom, top = ((body.heads[f"Left{name}"] + body.heads[f"Right{name}"]) / 2 for name in ("UpLeg", "Arm"))
        head, tail = head - 0.1 * (tail - head), tail + 0.1 * (tail - head)  # pieces overlap, so that a bent trunk shows no gaps
        if part == "Hips":  # the pelvis reaches below its joint
            head = np.array([head[0], head[1], min(head[2], bottom[2]) - 0.04 * body.unit])
        yield Piece(cover.bone, _tube(head, tail, _between(TRUNK, bottom, top, head, tail), body.unit, body.left, roundness=0.25), material)


def _between(profile: Profile, start: np.ndarray, end: np.ndarray, head: np.ndarray, tail: np.ndarray) -> Profile:
    """The stretch of a part's profile that one bone covers, its shares counted from the bone's head (0) to its tail (1)."""
    along = (end - start) / np.dot(end - start, end - start)
    first, last = float(np.dot(head - start, along)), float(np.dot(tail - start, along))
    if abs(last - first) < 1e-6:
        first, last = 0.0, 1.0
    shares, widths, depths = np.array(profile).T
    inner = shares[(shares > min(first, last)) & (shares < max(first, last))]
    at = np.concatenate(([first], inner if last > first else inner[::-1], [last]))
    own = (at - first) / (last - first)
    return tuple(zip(own.tolist(), np.interp(at, shares, widths).tolist(), np.interp(at, shares, depths).tolist(), strict=True))


def _tube(head: np.ndarray, tail: np.ndarray, profile: Profile, unit: float, width_axis: np.ndarray, roundness: float = 0.6) -> np.ndarray:
    """Rings from head to tail with rounded ends; `width_axis` is made perpendicular to them."""
    along = tail - head
    direction = normalize(along)
    wide = normalize(width_axis - np.dot(width_axis, direction) * direction)
    deep = np.cross(direction, wide)
    angles = 2 * np.pi * np.arange(CORNERS) / CORNERS

    def ring(centre: np.ndarray, width: float, depth: float) -> np.ndarray:
        return centre + unit * (np.cos(angles)[:, None] * wide * width + np.sin(angles)[:, None] * deep * depth)

    def cap(outward: np.ndarray, share: float, width: float, depth: float) -> list[np.ndarray]:
        """Begins with the ring at the edge once more, so that the shading of the tube does not bend into the cap."""
        edge, bulge = head + share * along, roundness * min(width, depth) * unit
        turns = np.radians((0, 35, 65, 85))
        return [ring(edge + outward * bulge * np.sin(turn), width * np.cos(turn), depth * np.cos(turn)) for turn in turns]

    rings = [ring(head + share * along, width, depth) for share, width, depth in profile]
    return np.stack([*cap(-direction, *profile[0])[::-1], *rings, *cap(direction, *profile[-1])])


def _box(centre: np.ndarray, wide: np.ndarray, high: np.ndarray) -> np.ndarray:
    """A ring with the outline of a rounded box, whose half sides are the vectors `wide` and `high`."""
    angles = 2 * np.pi * (np.arange(CORNERS) + 0.5) / CORNERS
    across, up = (np.sign(value) * np.sqrt(np.abs(value) / np.abs(value).max()) for value in (np.cos(angles), np.sin(angles)))
    return centre + across[:, None] * wide + up[:, None] * high


def _foot(body: _Body, cover: _Cover) -> np.ndarray:
    """A foot from heel to ball, or its toes: flat on the floor of the rest pose."""
    ankle = body.heads[cover.joint.replace("Toe", "Foot")]
    begin, end = body.heads[cover.joint], body.ends[cover.joint]
    along = (end - begin) * [1, 1, 0]
    side = np.cross(UP, normalize(along))
    rings = []
    for share, width, tall in TOES if cover.joint.endswith("Toe") else FOOT:
        half = tall * (ankle[2] - body.floor) / 2
        at = begin + share * along
        rings.append(_box(np.array([at[0], at[1], body.floor + half]), side * width * body.unit, UP * half))
    return np.stack(rings)


def _skull(body: _Body) -> np.ndarray:
    width, depth, height = (size * body.unit for size in HEAD)
    angles = 2 * np.pi * np.arange(CORNERS) / CORNERS
    circle = np.cos(angles)[:, None] * body.left * width - np.sin(angles)[:, None] * body.front * depth
    turns = np.radians(np.linspace(-88, 88, 9))
    return np.stack([_skull_centre(body) + np.cos(turn) * circle + np.sin(turn) * UP * height for turn in turns])


def _visor(body: _Body) -> np.ndarray:
    """The headset, which shows where the head faces."""
    width, depth, height = (size * body.unit for size in HEAD)
    eyes = _skull_centre(body) + 0.75 * depth * body.front + 0.12 * height * UP
    stations = ((-0.3, 1.0), (0.25, 0.98), (0.55, 0.85))
    return np.stack([_box(eyes + share * depth * body.front, size * width * body.left, 0.36 * size * height * UP) for share, size in stations])


def _skull_centre(body: _Body) -> np.ndarray:
    return body.heads["Head"] + 0.016 * body.unit * body.front + 0.72 * HEAD[2] * body.unit * UP
