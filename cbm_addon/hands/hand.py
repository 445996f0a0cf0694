"""The hand of a rig as angles of its joints: measured from any rest pose, bent within the limits of a human hand.

One layout for every finger. A finger lies in a plane, which turns sideways by the spread about an axis of the palm; within the plane
its three phalanges bend about one axis, one after the other. The thumb is the same with axes of its own: its first phalanx is the
metacarpal bone, and its spread carries it away from the palm.

    direction of phalanx k at angles a = turn(spread axis, a[3]) turn(flex axis, a[0] + ... + a[k]) zero direction

At angles of zero the fingers are straight in the plane of the palm, a little fanned.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from ..errors import InputError
from ..motion.rotations import Array, inverse, multiply, normalize, quat_from_axis_angle, rotate

FINGERS = ("Thumb", "Index", "Middle", "Ring", "Little")
PHALANGES = 3
JOINTS = tuple(f"{finger}{phalanx + 1}" for finger in FINGERS for phalanx in range(PHALANGES))
TIPS = tuple(f"{finger}Tip" for finger in FINGERS)
ANGLES = tuple(f"{finger}{kind}" for finger in FINGERS for kind in ("Flex1", "Flex2", "Flex3", "Spread"))

LIMITS = np.radians(
    [
        [-45, 25], [-5, 70], [-20, 80], [-30, 40],
        [-25, 90], [-5, 110], [-5, 80], [-20, 25],
        [-25, 90], [-5, 110], [-5, 80], [-20, 20],
        [-25, 90], [-5, 110], [-5, 80], [-15, 20],
        [-25, 95], [-5, 110], [-5, 80], [-15, 30],
    ]
).astype(np.float32)  # fmt: skip
"""Least and greatest angle [20, 2] in radians. Fingers: the normal ranges of the American Academy of Orthopaedic Surgeons (Joint Motion,
1965; Norkin and White, Measurement of Joint Motion): MCP 0 to 90 and 20 to 45 backwards, PIP 0 to 100 or 110, DIP 0 to 80 or 90, spread
about 20 to each side. Thumb: MCP 0 to 50 and more, IP 0 to 80, and at its saddle joint what the free hand poses show."""

RADII = np.array([[0.066, 0.055, 0.046], [0.050, 0.044, 0.038], [0.050, 0.044, 0.038], [0.047, 0.042, 0.036], [0.042, 0.037, 0.033]], np.float32).reshape(-1)
"""Half the thickness of the phalanges [15] as a share of the length of the hand: 19, 17 and 14 mm at the index of a hand of 190 mm."""
PALM_RADIUS = 0.055

Side = Literal["left", "right"]
EVERY = slice(None)


def finger_angles(angles: Array) -> Array:
    """Angles [..., 20] by finger: [..., 5, 4], the bends of the three joints and the spread."""
    return angles.reshape(*angles.shape[:-1], len(FINGERS), PHALANGES + 1)


@dataclass(frozen=True)
class Hand:
    """A hand at rest and the axes of its joints, all in the wrist's frame, metres.

    rest_positions   float32 [20, 3], in the order JOINTS, TIPS; the wrist is the origin
    radii        float32 [15] of the phalanges
    palm         float32 [3, 3], columns: along the middle metacarpal, to the side of the thumb, out of the palm
    zero, spread_axis, flex_axis   float32 [5, 3], see the module
    rest_angles  float32 [20]
    limits       float32 [20, 2]: LIMITS, widened where the rest pose of the rig is beyond them
    """

    side: Side
    rest_positions: Array
    radii: Array
    palm: Array
    zero: Array
    spread_axis: Array
    flex_axis: Array
    rest_angles: Array
    limits: Array

    @classmethod
    def from_rest(cls, side: Side, positions: Array, radii: Array | None = None) -> Hand:
        """Finds axes and angles from the geometry of any rest pose; InputError where that is no hand.

        positions  [20, 3] in the wrist's frame, in the order JOINTS, TIPS
        radii      [15], by default RADII times the length of the hand
        """
        positions = np.asarray(positions, np.float32).reshape(len(JOINTS) + len(TIPS), 3)
        directions = _directions(positions)
        palm = _palm(side, positions)
        zero, spread_axis, flex_axis = _axes(palm)
        angles, roll = _fit(directions[None], zero, spread_axis, flex_axis, finger_angles(LIMITS.T), rolls=True)
        flex_axis = rotate(quat_from_axis_angle(zero, roll[0]), flex_axis)
        rest = angles[0].reshape(-1).astype(np.float32)
        limits = np.stack((np.minimum(LIMITS[:, 0], rest), np.maximum(LIMITS[:, 1], rest)), -1)
        if radii is None:
            radii = RADII * _length(positions)
        axes = (axis.astype(np.float32) for axis in (zero, spread_axis, flex_axis))
        return cls(side, positions, np.asarray(radii, np.float32), palm, *axes, rest, limits)

    @property
    def length(self) -> float:
        """From the wrist to the tip of the straight middle finger, metres."""
        return _length(self.rest_positions)

    def turns(self, angles: Array) -> Array:
        """Quaternions [T, 15, 4]: from the rest to the posed orientation of each joint, in the wrist's frame, at angles [T, 20].

        The world orientation of joint j is wrist * turns[j] * rest[j], where rest[j] is its orientation relative to the wrist at rest.
        """
        turns = multiply(self._orientations(angles), inverse(self._orientations(self.rest_angles)))
        return turns.reshape(*turns.shape[:-3], len(JOINTS), 4)

    def positions(self, angles: Array) -> Array:
        """Positions [T, 20, 3] in the wrist's frame at angles [T, 20]."""
        by_finger = finger_angles(np.asarray(angles))
        chains = self.chains(by_finger)
        joints = chains[..., :PHALANGES, :].reshape(*by_finger.shape[:-2], len(JOINTS), 3)
        return np.concatenate((joints, chains[..., PHALANGES, :]), -2).astype(np.float32)

    def chains(self, angles: Array, fingers: np.ndarray | slice = EVERY) -> Array:
        """The three joints and the tip of fingers [..., R, 4, 3] at their angles [..., R, 4]; `fingers` int [R] says which they are."""
        bends = np.cumsum(angles[..., :PHALANGES], -1)[..., None]
        along, across, sideways = (part[fingers] for part in self._bent_steps)
        steps = self.spread(angles[..., 3], along + across * np.cos(bends) + sideways * np.sin(bends), fingers)
        bases = np.broadcast_to(self.rest_positions[: len(JOINTS) : PHALANGES, None][fingers], (*steps.shape[:-2], 1, 3))
        return np.cumsum(np.concatenate((bases, steps), -2), -2)

    def spread(self, angles: Array, vectors: Array, fingers: np.ndarray | slice = EVERY) -> Array:
        """Vectors [..., R, M, 3] of fingers turned by their spread [..., R] (Rodrigues' formula)."""
        axis = self.spread_axis[fingers][:, None]
        cosine, sine = np.cos(angles)[..., None, None], np.sin(angles)[..., None, None]
        along = (vectors * axis).sum(-1, keepdims=True) * axis
        return along + (vectors - along) * cosine + (vectors @ _cross_matrix(self.spread_axis)[fingers]) * sine

    @cached_property
    def _bent_steps(self) -> tuple[Array, Array, Array]:
        """Rodrigues' formula for steps [5, 3, 3] that bend about the flex axes: what stays, what goes with the cosine, what with the sine."""
        steps = self._local_steps.reshape(len(FINGERS), PHALANGES, 3)
        axis = self.flex_axis[:, None]
        along = (steps * axis).sum(-1, keepdims=True) * axis
        return along, steps - along, np.cross(axis, steps)

    @cached_property
    def _local_steps(self) -> Array:
        """From each joint to the next, or to the tip [15, 3], in the frame that bends with the phalanx."""
        rest = self._orientations(self.rest_angles).reshape(len(JOINTS), 4)
        return rotate(inverse(rest), _steps(self.rest_positions)).astype(np.float32)

    def angles_from_turns(self, turns: Array) -> Array:
        """The angles [T, 20] within the limits whose phalanges point, in the sense of least squares, where turns [T, 15, 4] point them."""
        return self.angles_from_directions(rotate(turns, normalize(_steps(self.rest_positions))))

    def angles_from_positions(self, positions: Array) -> Array:
        """The angles [T, 20] within the limits whose phalanges are nearest to parallel to those of positions [T, 20, 3] in the wrist's frame.

        The phalanges may have other lengths than this hand's.
        """
        directions = _directions(positions).reshape(*positions.shape[:-2], len(JOINTS), 3)
        return self.angles_from_directions(directions)

    def angles_from_directions(self, directions: Array) -> Array:
        """As `angles_from_positions`, from unit vectors along the phalanges [T, 15, 3]."""
        bent = normalize(self._local_steps)
        by_finger = directions.reshape(-1, len(FINGERS), PHALANGES, 3).astype(np.float64)
        angles, _ = _fit(by_finger, self.zero, self.spread_axis, self.flex_axis, finger_angles(self.limits.T), bent=bent.reshape(len(FINGERS), PHALANGES, 3))
        return angles.reshape(*directions.shape[:-2], len(ANGLES)).astype(np.float32)

    def capsules(self, angles: Array, wrist_positions: Array, wrist_rotations: Array, palm: bool = True) -> tuple[Array, Array, Array]:
        """The hand in the world as capsules: starts and ends [T, C, 3], radii [C].

        The first 15 are the phalanges, in the order of JOINTS; the last of each finger ends so that its cap touches the tip. Those of the
        `palm` follow, from the wrist to the first joint of each finger.
        """
        chains = self.chains(finger_angles(np.asarray(angles)))
        starts, ends = (part.reshape(-1, len(JOINTS), 3).astype(np.float32) for part in (chains[..., :PHALANGES, :], self.axis_ends(chains)))
        radii = self.radii
        if palm:
            bases = starts[:, ::PHALANGES]
            starts, ends = np.concatenate((starts, np.zeros_like(bases)), 1), np.concatenate((ends, bases), 1)
            radii = np.concatenate((radii, np.full(len(FINGERS), PALM_RADIUS * self.length, np.float32)))
        rotations = wrist_rotations[:, None]
        return rotate(rotations, starts) + wrist_positions[:, None], rotate(rotations, ends) + wrist_positions[:, None], radii

    def axis_ends(self, chains: Array, fingers: np.ndarray | slice = EVERY) -> Array:
        """Where the axes of phalanges end [..., R, 3, 3]: at the next joint, and one radius before the tip."""
        ends = chains[..., 1:, :].copy()
        last = chains[..., PHALANGES, :] - chains[..., PHALANGES - 1, :]
        lengths = np.linalg.norm(last, axis=-1, keepdims=True)
        ends[..., -1, :] -= last * np.minimum(self.radii[PHALANGES - 1 :: PHALANGES, None][fingers] / np.maximum(lengths, 1e-9), 0.7)
        return ends

    def _orientations(self, angles: Array) -> Array:
        """Orientation [..., 5, 3, 4] of each phalanx against the straight finger at angles of zero."""
        by_finger = finger_angles(np.asarray(angles))
        return _bend(by_finger, self.spread_axis, self.flex_axis).astype(np.float32)


def _chain(positions: Array) -> Array:
    """Positions [..., 20, 3] by finger [..., 5, 4, 3]: its three joints and its tip."""
    joints = positions[..., : len(JOINTS), :].reshape(*positions.shape[:-2], len(FINGERS), PHALANGES, 3)
    return np.concatenate((joints, positions[..., len(JOINTS) :, None, :]), -2)


def _steps(positions: Array) -> Array:
    """From each joint to the next, or to the tip [15, 3]."""
    return np.diff(_chain(positions), axis=-2).reshape(len(JOINTS), 3)


def _directions(positions: Array) -> Array:
    """Unit vectors along the phalanges [..., 5, 3, 3]; InputError if one has no length."""
    steps = np.diff(_chain(np.asarray(positions, np.float64)), axis=-2)
    short = np.argwhere(~(np.linalg.norm(steps, axis=-1) > 1e-6))
    if len(short):
        raise InputError(JOINTS[int(short[0][-2]) * PHALANGES + int(short[0][-1])], "has no length; a phalanx goes from its joint to the next or to the tip")
    return normalize(steps)


def _length(positions: Array) -> float:
    chain = _chain(positions)[FINGERS.index("Middle")]
    return float(np.linalg.norm(chain[0]) + np.linalg.norm(np.diff(chain, axis=0), axis=-1).sum())


def _cross_matrix(axes: Array) -> Array:
    """Matrices [..., 3, 3] with v @ matrix = axis x v."""
    x, y, z = np.moveaxis(axes, -1, 0)
    zero = np.zeros_like(x)
    return np.stack((zero, z, -y, -z, zero, x, y, -x, zero), -1).reshape(*axes.shape[:-1], 3, 3)


def _palm(side: Side, positions: Array) -> Array:
    """The palm's axes as columns, from the wrist and the knuckles."""
    index, middle, little = (positions[JOINTS.index(f"{finger}1")].astype(np.float64) for finger in ("Index", "Middle", "Little"))
    forward = normalize(middle)
    out = np.cross(index - little, forward) * (1 if side == "right" else -1)
    if np.linalg.norm(out) < 0.1 * np.linalg.norm(middle):
        raise InputError(f"{side} hand", "has its wrist and knuckles on one line; at rest they span the palm")
    out = normalize(out)
    across = np.cross(forward, out) * (1 if side == "right" else -1)
    return np.stack((forward, across, out), -1).astype(np.float32)


# In the palm's frame: along, to the side of the thumb, out of the palm. Fitted to the free hand poses, whose phalanges these axes leave
# within 3 degrees on average: where a straight finger points, where it bends to (fingers converge when they close), where it spreads to.
ZERO = ((0.85, 0.33, 0.41), (1.0, -0.03, 0.0), (0.99, -0.16, 0.0), (0.96, -0.28, 0.0), (0.92, -0.39, 0.0))
BEND = ((0.37, -0.93, -0.02), (0.0, -0.18, 0.98), (0.0, -0.12, 0.99), (0.0, -0.02, 1.0), (0.0, 0.14, 0.99))
OUTWARD = ((-0.30, -0.33, 0.90), (0.0, 1.0, 0.0), (0.0, 1.0, 0.0), (0.0, -1.0, 0.0), (0.0, -1.0, 0.0))


def _axes(palm: Array) -> tuple[Array, Array, Array]:
    """Zero directions, spread axes and flex axes [5, 3] of the fingers of a hand with this palm."""
    zero, bend, outward = (normalize(np.array(vectors) @ palm.T.astype(np.float64)) for vectors in (ZERO, BEND, OUTWARD))
    return zero, normalize(np.cross(zero, outward)), normalize(np.cross(zero, bend))


def _bend(angles: Array, spread_axis: Array, flex_axis: Array) -> Array:
    """Orientations [..., 5, 3, 4] at angles [..., 5, 4]."""
    spread = quat_from_axis_angle(spread_axis, angles[..., 3])[..., None, :]
    flexed = quat_from_axis_angle(flex_axis[..., None, :], np.cumsum(angles[..., :3], -1))
    return multiply(spread, flexed)


def _fit(
    directions: Array, zero: Array, spread_axis: Array, flex_axis: Array, limits: Array, bent: Array | None = None, rolls: bool = False, iterations: int = 30
) -> tuple[Array, Array]:
    """Angles [T, 5, 4] and rolls [T, 5] of flex axes about the zero directions, by damped least squares on directions [T, 5, 3, 3].

    A weak pull toward no spread and no roll decides what the directions leave open: the spread of a finger that points out of the palm, the
    plane of a straight one. `bent` [5, 3, 3] is where phalanges point in their own bent frames (by default along `zero`).
    """
    zero, spread_axis, flex_axis = (np.asarray(value, np.float64) for value in (zero, spread_axis, flex_axis))
    pointing = np.broadcast_to(zero[:, None], (len(FINGERS), PHALANGES, 3)) if bent is None else bent.astype(np.float64)
    prior = np.array([0, 0, 0, 0.05, 0.3 if rolls else 1e3])
    bounds = np.concatenate((limits[..., :4], np.broadcast_to(np.array([[[-0.6]], [[0.6]]]), (2, len(FINGERS), 1))), -1).astype(np.float64)
    if rolls:
        bounds[:, :, :3] += np.array([-0.3, 0.3])[:, None, None]  # a rig's rest pose may be beyond the limits of a human hand

    def residuals(values: Array) -> Array:
        flex = flex_axis if not rolls else rotate(quat_from_axis_angle(zero, values[..., 4]), flex_axis)
        model = rotate(_bend(values[..., :4], spread_axis, flex), pointing)
        return np.concatenate(((model - directions).reshape(*values.shape[:-1], 9), values * prior), -1)

    bend = np.cross(flex_axis, zero)
    cumulative = np.arctan2(np.einsum("tfki,fi->tfk", directions, bend), np.einsum("tfki,fi->tfk", directions, zero))
    first = np.where(cumulative[..., :1] < -np.pi / 2, cumulative[..., :1] + 2 * np.pi, cumulative[..., :1])
    later = np.mod(np.diff(cumulative, axis=-1) + np.pi / 3, 2 * np.pi) - np.pi / 3
    values = np.concatenate((first, later, np.zeros((*first.shape[:-1], 2))), -1)
    values = np.clip(values, *bounds)
    error = residuals(values)
    damping = np.full(values.shape[:-1], 1e-3)
    for _ in range(iterations):
        perturbed = residuals(values + (np.eye(5) * 1e-6).reshape(5, *(1,) * (values.ndim - 1), 5))
        jacobian = np.moveaxis((perturbed - error) / 1e-6, 0, -1)
        normal = np.einsum("...ri,...rj->...ij", jacobian, jacobian) + damping[..., None, None] * np.eye(5)
        slope = np.einsum("...ri,...r->...i", jacobian, error)
        held = ((values <= bounds[0]) & (slope > 0)) | ((values >= bounds[1]) & (slope < 0))
        normal = np.where(held[..., :, None] | held[..., None, :], np.eye(5), normal)
        step = -np.linalg.solve(normal, np.where(held, 0, slope)[..., None])[..., 0]
        moved = np.clip(values + step, *bounds)
        found = residuals(moved)
        better = (found**2).sum(-1) < (error**2).sum(-1)
        values, error = np.where(better[..., None], moved, values), np.where(better[..., None], found, error)
        damping = np.where(better, damping / 5, damping * 5).clip(1e-9, 1e3)
        if np.abs(step).max() < 1e-6:
            break
    return values[..., :4], values[..., 4]
