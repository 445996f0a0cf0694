"""The feature vectors of every stage, by name. Training and solving both use these definitions and no others.

Everything is a set of 3-vectors per frame (positions, velocities, the two first axes of rotations), seen from the *anchor*: the head's
ground frame at the frame that is being solved, with lengths divided by the standing height of the head joint. An anchor only turns
vectors about Z and moves positions over the floor, so one gather and one 2D rotation make a feature vector.

The networks also see the PROPORTIONS of the body that they move: performers differ in build, and rigs in where their joints are.

Stage 1, control:      tracker window, proportions -> root and upper body over a sequence      (paper, eq. 6)
Stage 2, lower body:   tracker window, proportions -> hips, legs and contacts over a sequence  (paper, eq. 8)
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .motion.contacts import CONTACT_JOINTS, contact_labels
from .motion.ground_frame import GroundFrame, ground_frame, root_frame
from .motion.motion import Motion
from .motion.rotations import Array, rotate, sixd_from_quat
from .motion.skeleton import STANDARD_BODY, Skeleton, chest_of
from .takes.take import DEVICES, Take

RATE = 30.0  # frames per second of everything that is learned
TRACKED_JOINTS = ("Head", "LeftHand", "RightHand")
UPPER_JOINTS = (
    "Spine", "Spine1", "Spine2", "Neck",
    "LeftShoulder", "LeftArm", "LeftForeArm",
    "RightShoulder", "RightArm", "RightForeArm",
)  # fmt: skip
LOWER_JOINTS = ("Hips", "LeftUpLeg", "LeftLeg", "LeftFoot", "LeftToe", "RightUpLeg", "RightLeg", "RightFoot", "RightToe")


PROPORTIONS = (
    "hips.height", "hip.height", "ankle.height", "hip.width", "thigh", "shin", "foot",
    "back", "neck", "shoulder.width", "upper_arm", "forearm",
)  # fmt: skip
AVERAGE_FOOT = float(np.linalg.norm(STANDARD_BODY.offsets[STANDARD_BODY.index("LeftToe")])) / STANDARD_BODY.height_above_toes("Head")  # of bodies without toes


@dataclass(frozen=True)
class Mode:
    """How much of the take a network sees and what span it predicts: frame offsets from the anchor frame at RATE."""

    name: str
    window: tuple[int, ...]
    sequence: tuple[int, ...]

    @property
    def looks_ahead(self) -> bool:
        return self.window[-1] > 0


MODES = {
    "lookahead": Mode("lookahead", tuple(range(-18, 19, 2)), tuple(range(-7, 8))),
    "causal": Mode("causal", tuple(range(-30, 1, 2)), tuple(range(15))),
}


@dataclass(frozen=True)
class Layout:
    """The names of what stands in one frame of a feature vector, in order: points (moved and turned by an anchor), directions
    (turned only), then plain scalars."""

    points: tuple[str, ...]
    directions: tuple[str, ...]
    scalars: tuple[str, ...] = ()

    @property
    def size(self) -> int:
        return 3 * len(self.points) + 3 * len(self.directions) + len(self.scalars)

    def index(self, name: str) -> int:
        """Which vector of a frame has that name."""
        return (*self.points, *self.directions).index(name)

    @property
    def lengths(self) -> np.ndarray:
        """Bool [size]: which numbers are lengths or speeds, and so change with the unit of length."""
        vectors = [name.endswith((".position", ".velocity")) for name in (*self.points, *self.directions)]
        return np.concatenate((np.repeat(vectors, 3), np.zeros(len(self.scalars), bool)))

    def names(self, offsets: tuple[int, ...]) -> list[str]:
        """The name of every number of the vector over these frame offsets, for example `head.position.z@-18`."""
        one = [f"{name}.{axis}" for name in (*self.points, *self.directions) for axis in "xyz"]
        return [f"{name}@{offset:+d}" for offset in offsets for name in (*one, *self.scalars)]


def _axes(names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(f"{name}.rotation.{axis}" for name in names for axis in ("first", "second"))


TRACKERS = Layout(
    points=tuple(f"{name}.position" for name in DEVICES),
    directions=(*_axes(DEVICES), *(f"{name}.velocity" for name in DEVICES)),
)
CONTROL = Layout(
    points=("root.position", "Hips.position"),
    directions=("root.facing", *_axes(("Hips", *UPPER_JOINTS))),
)
LOWER_BODY = Layout(
    points=tuple(f"{name}.position" for name in LOWER_JOINTS),
    directions=_axes(LOWER_JOINTS),
    scalars=tuple(f"{name}.contact" for name in CONTACT_JOINTS),
)


@dataclass(frozen=True)
class Frames:
    """Per-frame values of a layout in world axes: vectors float32 [T, points + directions, 3], scalars float32 [T, S]."""

    layout: Layout
    vectors: Array
    scalars: Array

    def __len__(self) -> int:
        return len(self.vectors)

    def seen_from(self, anchors: GroundFrame, frames: np.ndarray) -> Array:
        """Feature vectors [N, O, layout.size] of the frames int [N, O] (clamped to the ends) from N anchors."""
        frames = np.clip(frames, 0, len(self) - 1)
        vectors = self.vectors[frames]
        count = len(self.layout.points)
        vectors[:, :, :count, :2] -= anchors.origin[:, None, None, :2]
        return _pack(_turn(vectors, anchors, -1), self.scalars[frames])

    @staticmethod
    def to_world(layout: Layout, features: Array, anchors: GroundFrame) -> tuple[Array, Array]:
        """The inverse: vectors [..., V, 3] in world axes and scalars [..., S] from features [N, ..., layout.size] and N anchors."""
        count = 3 * (len(layout.points) + len(layout.directions))
        vectors = features[..., :count].reshape(*features.shape[:-1], -1, 3)
        turned = _turn(vectors, anchors, 1)
        origin = anchors.origin.reshape(len(anchors.origin), *[1] * (turned.ndim - 2), 3)
        turned[..., : len(layout.points), :2] += origin[..., :2]
        return turned, features[..., count:]


def proportions_of(body: Skeleton, sole: float = 0.0) -> Array:
    """The PROPORTIONS of a body, float32 [P]: heights over the floor at rest and lengths, in head heights.

    sole  height of the body's toe joints over the floor, in its unit of length
    """
    rest = body.rest_positions()
    rest[:, 2] += sole + body.height_above_toes("Head") - rest[body.index("Head"), 2]

    def apart(a: str, b: str) -> float:
        return float(np.linalg.norm(rest[body.index(a)] - rest[body.index(b)]))

    def height(joint: str) -> float:
        return float(rest[body.index(joint), 2])

    chest = body.names[chest_of(body)]
    unit = height("Head")
    foot = apart("LeftFoot", "LeftToe") if "LeftToe" in body else AVERAGE_FOOT * unit
    lengths = [
        height("Hips"), height("LeftUpLeg"), height("LeftFoot"), apart("LeftUpLeg", "RightUpLeg"),
        apart("LeftUpLeg", "LeftLeg"), apart("LeftLeg", "LeftFoot"), foot,
        apart("Hips", chest), apart(chest, "Head"), apart("LeftArm", "RightArm"), apart("LeftArm", "LeftForeArm"), apart("LeftForeArm", "LeftHand"),
    ]  # fmt: skip
    return (np.array(lengths) / unit).astype(np.float32)


STANDARD_PROPORTIONS = proportions_of(STANDARD_BODY)


def network_input(windows: Array, proportions: Array) -> Array:
    """What the networks see, flat [N, O * TRACKERS.size + P]: tracker windows [N, O, TRACKERS.size], then proportions [N, P], or [P] of them all."""
    return np.concatenate((windows.reshape(len(windows), -1), np.broadcast_to(proportions, (len(windows), len(PROPORTIONS)))), axis=-1)


def _turn(vectors: Array, anchors: GroundFrame, sign: int) -> Array:
    """Vectors [N, ..., 3] turned about Z into (-1) or out of (+1) the anchors' headings."""
    facing = anchors.rotation.reshape(len(anchors.rotation), *[1] * (vectors.ndim - 2), 4)
    w, z = facing[..., 0], facing[..., 3]
    cosine, sine = w * w - z * z, sign * 2 * w * z
    turned = np.empty_like(vectors)
    turned[..., 0] = cosine * vectors[..., 0] - sine * vectors[..., 1]
    turned[..., 1] = sine * vectors[..., 0] + cosine * vectors[..., 1]
    turned[..., 2] = vectors[..., 2]
    return turned


def _pack(vectors: Array, scalars: Array) -> Array:
    return np.concatenate((vectors.reshape(*vectors.shape[:-2], -1), scalars), axis=-1)


def _rotation_axes(rotations: Array) -> Array:
    """The first two axes of rotations [T, J, 4] as directions [T, 2 J, 3]."""
    return sixd_from_quat(rotations).reshape(len(rotations), -1, 3)


def tracker_frames(take: Take, head_height: float) -> tuple[Frames, GroundFrame]:
    """Tracker values of a calibrated take sampled at RATE, and the anchor of every frame, in units of `head_height`."""
    positions = (take.positions / np.float32(head_height)).astype(np.float32)
    velocity = np.zeros_like(positions)
    if len(positions) > 1:  # backward differences: they know nothing of the future
        velocity[1:] = np.diff(positions, axis=0) * np.float32(RATE)
        velocity[0] = velocity[1]
    vectors = np.concatenate((positions, _rotation_axes(take.rotations), velocity), axis=1)
    frames = Frames(TRACKERS, vectors, np.zeros((len(vectors), 0), np.float32))
    return frames, ground_frame(positions[:, 0], take.rotations[:, 0])


def control_frames(motion: Motion, head_height: float) -> Frames:
    """Root and upper body of a motion sampled at RATE, in units of `head_height`."""
    rotations, positions = motion.forward()
    positions = positions / np.float32(head_height)
    skeleton = motion.skeleton
    root = root_frame(skeleton, positions)
    facing = rotate(root.rotation, np.array([0, -1, 0], np.float32))
    joints = skeleton.indices(["Hips", *UPPER_JOINTS])
    vectors = np.concatenate((root.origin[:, None], positions[:, skeleton.indices(["Hips"])], facing[:, None], _rotation_axes(rotations[:, joints])), axis=1)
    return Frames(CONTROL, vectors.astype(np.float32), np.zeros((len(vectors), 0), np.float32))


def lower_body_frames(motion: Motion, head_height: float) -> Frames:
    """Hips, legs and foot contacts of a motion sampled at RATE, in units of `head_height`."""
    rotations, positions = motion.forward()
    joints = motion.skeleton.indices(list(LOWER_JOINTS))
    vectors = np.concatenate((positions[:, joints] / np.float32(head_height), _rotation_axes(rotations[:, joints])), axis=1)
    contacts = contact_labels(motion.skeleton, positions, RATE)
    return Frames(LOWER_BODY, vectors.astype(np.float32), contacts.astype(np.float32))
