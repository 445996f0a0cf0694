"""The motion behind the shipped sample take: a procedural body that walks, turns, stops, crouches, waves and points.

Nothing here is recorded. A path over the floor is integrated from speeds and headings; feet are planted where the path is in the middle of
each stance, and swing in between; the pelvis rides as high as both legs allow; pelvis, chest and arms follow from the feet; gestures are
targets for the hands. Legs and arms are two-bone inverse kinematics on the standard body.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..motion.motion import Motion, forward_kinematics, local_rotations
from ..motion.rotations import (
    Array,
    across,
    continuous,
    inverse,
    multiply,
    normalize,
    quat_from_axis_angle,
    quat_from_matrix,
    quat_from_yaw,
    rotate,
    slerp,
)
from ..motion.skeleton import STANDARD_BODY
from .synthesize import synthesize
from .take import Take

RATE = 72.0
SECONDS = 36.0
X, Y, Z = np.eye(3)

Keys = tuple[tuple[float, float], ...]  # (seconds, value): smooth in between, constant outside


@dataclass(frozen=True)
class Walk:
    """Steps from `start` until the last foot is down at `end` (seconds), at `speed` (m/s), turning by `turn` (radians, left) over `turning`."""

    start: float
    end: float
    speed: float
    turn: float
    turning: tuple[float, float]


WALKS = (
    Walk(1.5, 10.7, 0.95, np.pi, (3.6, 8.6)),  # out, around and back
    Walk(12.0, 14.3, 0.0, -1.8, (12.1, 14.2)),  # on the spot
    Walk(28.5, 33.5, 0.85, 1.3, (29.5, 32.5)),
)
CROUCH: Keys = ((14.6, 0), (16.1, 1), (18.0, 1), (19.6, 0))
WAVE: Keys = ((20.3, 0), (21.1, 1), (24.0, 1), (24.8, 0))  # the right hand
POINT: Keys = ((24.6, 0), (25.4, 1), (27.3, 1), (28.2, 0))  # the left hand
LOOK: Keys = ((10.8, 0), (11.3, -0.5), (11.5, -0.5), (12.0, 0), (24.6, 0), (25.4, 0.35), (27.3, 0.35), (28.2, 0))  # radians to the left

STEP = 0.54  # seconds from one step to the next
SWING = 0.76 * STEP
HEEL_OFF = 0.22  # seconds before a foot swings in which its heel rises
FULL_STRIDE = 0.9  # metres from a footprint to the next of the same foot, at which the heel rises by HEEL_PITCH
HEEL_PITCH = 0.6  # radians
FOOTPRINT = np.array([0.08, -0.08, 0.0])  # metres: the ball of the left foot, seen from the path
LEG_STRETCH = 0.99  # of the leg's length: knees are never quite straight
ARM_STRETCH = 0.955


def sample_take() -> Take:
    """The shipped sample: `sample_motion` as a headset and Quest 2 controllers would record it."""
    return synthesize(sample_motion(), device="quest2", name="walk_turn_crouch")


def sample_motion() -> Motion:
    """The whole body on the standard skeleton, 36 s at 72 samples a second."""
    body = STANDARD_BODY
    times = np.arange(round(SECONDS * RATE)) / RATE
    path, heading = _path(times)
    facing = quat_from_yaw(heading)
    crouch = _keyed(times, CROUCH)
    feet = {side: _foot(times, path, heading, side) for side in ("Left", "Right")}

    ahead = {side: np.sum((foot.ankle - path) * rotate(facing, -Y), axis=-1) for side, foot in feet.items()}
    stride = _smooth(ahead["Left"] - ahead["Right"], 0.05)
    weight = _smooth(feet["Right"].swings * 1.0 - feet["Left"].swings, 0.1)  # 1: all on the left foot
    speed = np.linalg.norm(np.gradient(path, times, axis=0), axis=-1)
    lean = 0.05 * speed + 0.85 * crouch + 0.012 * np.sin(1.6 * times)

    pelvis = multiply(quat_from_yaw(heading - 0.16 * stride), multiply(_about(X, 0.35 * lean), _about(Y, 0.05 * weight)))
    chest = multiply(quat_from_yaw(heading + 0.12 * stride), _about(X, lean))
    glance = np.interp(times + 0.35, times, heading) + _keyed(times, LOOK) + 0.04 * np.sin(0.7 * times)
    head = multiply(quat_from_yaw(glance), _about(X, 0.06 + 0.5 * crouch + 0.03 * np.sin(1.1 * times)))

    world = np.repeat(chest[:, None], len(body), axis=1)
    for joint, share in (("Hips", 0.0), ("Spine", 0.25), ("Spine1", 0.5), ("Spine2", 0.75)):
        world[:, body.index(joint)] = slerp(pelvis, chest, share)
    world[:, body.index("Head")] = head

    sideways = 0.03 * weight + 0.008 * np.sin(0.8 * times)
    root = path + rotate(facing, np.stack((sideways, 0.12 * crouch, np.zeros_like(times)), axis=-1))
    root[:, 2] = _pelvis_height(root, pelvis, feet) - 0.42 * crouch
    positions = forward_kinematics(body, root, local_rotations(body, world))[1]
    for side, foot in feet.items():
        hip = positions[:, body.index(side + "UpLeg")]
        thigh, shin = _two_bones(hip, foot.ankle, _lengths(side, "Leg", "Foot"), rotate(foot.rotation, -Y), -Z, X)
        for joint, rotation in (("UpLeg", thigh), ("Leg", shin), ("Foot", foot.rotation), ("Toe", foot.toe_rotation)):
            world[:, body.index(side + joint)] = rotation
    for side, sign in (("Left", 1.0), ("Right", -1.0)):
        shoulder = positions[:, body.index(side + "Arm")]
        target, pole = _hand(times, sign, -0.33 * sign * stride, crouch)
        lengths = _lengths(side, "ForeArm", "Hand")
        arm, forearm = _two_bones(shoulder, shoulder + rotate(facing, target), lengths, rotate(facing, pole), sign * X, -sign * Z)
        for joint, rotation in (("Arm", arm), ("ForeArm", forearm), ("Hand", forearm)):
            world[:, body.index(side + joint)] = rotation
    return Motion(body, times, root.astype(np.float32), continuous(local_rotations(body, world)).astype(np.float32))


def _path(times: np.ndarray) -> tuple[Array, Array]:
    """The way over the floor [T, 3] and the heading [T] in radians (0 faces -Y)."""
    speed, heading = np.zeros_like(times), np.zeros_like(times)
    for walk in WALKS:
        speed += _keyed(times, ((walk.start, 0), (walk.start + 1, walk.speed), (walk.end - 1, walk.speed), (walk.end, 0)))
        heading += _keyed(times, ((walk.turning[0], 0), (walk.turning[1], walk.turn)))
    velocity = rotate(quat_from_yaw(heading), -Y) * speed[:, None]
    return np.cumsum(velocity, axis=0) / RATE, heading


@dataclass(frozen=True)
class Foot:
    """A foot over time: swings bool [T]; ankle [T, 3]; rotation of the foot and of its toe [T, 4]."""

    swings: np.ndarray
    ankle: Array
    rotation: Array
    toe_rotation: Array


def _foot(times: np.ndarray, path: Array, heading: Array, side: str) -> Foot:
    start = np.concatenate([_swing_starts(walk)[0 if side == "Left" else 1 :: 2] for walk in WALKS])
    end = start + SWING
    middle = (np.append(0.0, end) + np.append(start, SECONDS)) / 2  # of each stance
    yaw = np.interp(middle, times, heading)
    prints = np.stack([np.interp(middle, times, path[:, axis]) for axis in range(3)], axis=-1)
    prints += rotate(quat_from_yaw(yaw), FOOTPRINT * [1 if side == "Left" else -1, 1, 1])

    step = np.searchsorted(start, times, side="right")  # how many swings have begun
    last = np.maximum(step - 1, 0)
    swung = np.where(step > 0, np.clip((times - start[last]) / SWING, 0, 1), 1)  # 1: on the floor
    eased = swung**3 * (10 - 15 * swung + 6 * swung**2)
    ball = prints[last] + (prints[step] - prints[last]) * eased[:, None]
    ball[:, 2] += 0.06 * np.sin(np.pi * swung) ** 2
    turned = quat_from_yaw(yaw[last] + (yaw[step] - yaw[last]) * eased)

    effort = np.minimum(np.linalg.norm(np.diff(prints, axis=0), axis=-1) / FULL_STRIDE, 1)  # of each swing
    until = np.append(start, np.inf)[step] - times
    rising = _ease(np.clip(1 - until / HEEL_OFF, 0, 1)) * np.append(effort, 0)[step]
    falling = _keyed(swung, ((0, 1), (0.8, -0.15), (1, 0))) * effort[last]
    pitch = HEEL_PITCH * np.where(swung < 1, falling, rising)
    rotation = multiply(turned, _about(X, pitch))
    toe = STANDARD_BODY.offsets[STANDARD_BODY.index(side + "Toe")].astype(np.float64)
    return Foot(swung < 1, ball - rotate(rotation, toe), rotation, multiply(turned, _about(X, np.minimum(pitch, 0))))


def _swing_starts(walk: Walk) -> np.ndarray:
    """When the feet leave the floor, left and right in turn; the last one is down at the walk's end."""
    return np.linspace(walk.start, walk.end - SWING, round((walk.end - SWING - walk.start) / STEP) + 1)


def _pelvis_height(root: Array, pelvis: Array, feet: dict[str, Foot]) -> Array:
    """As high as both legs reach, smoothed from below [T]."""
    heights = []
    for side, foot in feet.items():
        hip = rotate(pelvis, STANDARD_BODY.offsets[STANDARD_BODY.index(side + "UpLeg")].astype(np.float64))
        across = np.sum((root + hip - foot.ankle)[:, :2] ** 2, axis=-1)
        leg = LEG_STRETCH * sum(_lengths(side, "Leg", "Foot"))
        heights.append(foot.ankle[:, 2] + np.sqrt(leg**2 - across) - hip[:, 2])
    reachable = np.min(heights, axis=0)
    around = round(0.12 * RATE)
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(reachable, around, mode="edge"), 2 * around + 1)
    return _smooth(windows.min(axis=1), 0.06)


def _hand(times: np.ndarray, sign: float, swing: Array, crouch: Array) -> tuple[Array, Array]:
    """Where a hand is, from its shoulder, and where the elbow points, both [T, 3] in the heading's frame; `swing` [T] metres forward; `sign` is
    1 for the left hand."""
    arm = ARM_STRETCH * sum(_lengths("Left", "ForeArm", "Hand"))
    still = np.zeros_like(times)
    hanging = arm * normalize(np.stack((still + 0.08 * sign, -0.05 - swing / arm, still - 1), axis=-1))
    if sign > 0:
        gesture, weight = arm * normalize(np.array([0.45, -1, 0.05])), _keyed(times, POINT)
        elbow, floor = np.array([0.35, 0.2, -1]), np.array([0.02, -0.18, -0.36])
    else:
        side_to_side = 0.11 * np.sin(2 * np.pi * 1.4 * times)
        gesture, weight = np.stack((side_to_side - 0.2, still - 0.24, still + 0.26), axis=-1), _keyed(times, WAVE)
        elbow, floor = np.array([-0.5, 0.2, -1]), np.array([0.0, -0.25, -0.44])
    target = hanging + (gesture - hanging) * weight[:, None] + (floor - hanging) * crouch[:, None]
    behind = np.array([0.25 * sign, 1, 0])
    return target, behind + (elbow - behind) * weight[:, None]


def _two_bones(start: Array, end: Array, lengths: tuple[float, float], pole: Array, bone: Array, hinge: Array) -> tuple[Array, Array]:
    """World rotations [T, 4] of two bones from `start` [T, 3] that reach for `end` and bend toward `pole`; at rest both lie along the
    direction `bone` and the second folds about `hinge`."""
    upper, lower = lengths
    distance = np.linalg.norm(end - start, axis=-1, keepdims=True)
    axis = (end - start) / distance
    distance = np.clip(distance, abs(upper - lower) + 1e-6, upper + lower - 1e-6)
    bend = normalize(across(pole, axis))
    cosine = (upper**2 + distance**2 - lower**2) / (2 * upper * distance)
    first = cosine * axis + np.sqrt(1 - cosine**2) * bend
    second = (distance * axis - upper * first) / lower
    normal = np.cross(bend, axis)
    at_rest = inverse(_frame(bone, hinge))
    return multiply(_frame(first, normal), at_rest), multiply(_frame(second, normal), at_rest)


def _frame(along: Array, normal: Array) -> Array:
    """The rotation whose first two axes are these perpendicular unit vectors [..., 3]."""
    return quat_from_matrix(np.stack((along, normal, np.cross(along, normal)), axis=-1))


def _lengths(side: str, middle: str, end: str) -> tuple[float, float]:
    """The lengths of the two bones of a limb, metres."""
    upper, lower = (float(np.linalg.norm(STANDARD_BODY.offsets[STANDARD_BODY.index(side + joint)])) for joint in (middle, end))
    return upper, lower


def _about(axis: Array, angle: Array) -> Array:
    return quat_from_axis_angle(np.broadcast_to(axis, (*np.shape(angle), 3)), angle)


def _ease(share: Array) -> Array:
    return share * share * (3 - 2 * share)


def _keyed(times: Array, keys: Keys) -> Array:
    at, values = np.array(keys, dtype=np.float64).T
    before = np.clip(np.searchsorted(at, times, side="right") - 1, 0, len(at) - 2)
    share = np.clip((times - at[before]) / (at[before + 1] - at[before]), 0, 1)
    return values[before] + (values[before + 1] - values[before]) * _ease(share)


def _smooth(values: Array, seconds: float) -> Array:
    """Values [T] under a Gaussian of that standard deviation."""
    radius = round(3 * seconds * RATE)
    kernel = np.exp(-0.5 * (np.arange(-radius, radius + 1) / (seconds * RATE)) ** 2)
    return np.convolve(np.pad(values, radius, mode="edge"), kernel / kernel.sum(), mode="valid")
