"""Joint frames that a conversion left turned: legs that bend backwards in their own frames, rest poses on tiptoe, feet rolled onto their backs.

The joints of such clips are where they should be, so nothing is moved. But rotations mean something only if the rest pose is one of standing, as on
other bodies: what learns from them, and every height that is taken from the rest pose, would be wrong.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .motion import Motion, local_rotations
from .rotations import Array, across, inverse, multiply, normalize, quat_between, rotate
from .skeleton import STANDARD_BODY, Skeleton

BENT = 0.04  # of its length: how far a leg's knee is off the line from hip to ankle where the way that it bends is told
UNLIKE = np.cos(np.radians(60))  # a foot or shoulder that points farther than that from where the standard body's does is not at rest
FORWARD, UP = np.array([0, -1, 0], np.float32), np.array([0, 0, 1], np.float32)
LASTING = 1.0  # seconds; a foot that is rolled for less is badly tracked, and stays as it is
ABOUT = np.array([0, 0, 0, 1], np.float32)  # half a turn about the vertical


def repaired(motion: Motion) -> Motion:
    """The same motion of a body with the engine's joints, every joint where it was, its legs, feet and shoulders turned as on a body that stands at
    rest. Sound clips, and those whose joints also translate, stay as they are."""
    if motion.offsets is not None:
        return motion
    world, positions = motion.forward()
    before, skeleton = world.copy(), motion.skeleton
    for side in ("Left", "Right"):
        skeleton = _stand(skeleton, world, f"{side}Shoulder", f"{side}Arm")
        skeleton = _turn_leg(skeleton, world, positions, side)
        skeleton = _stand(skeleton, world, f"{side}Foot", f"{side}Toe")
        _roll_foot(skeleton, world, positions, motion.rate, side)
    return motion if np.array_equal(world, before) else replace(motion, skeleton=skeleton, rotations=local_rotations(skeleton, world))


def _turned(skeleton: Skeleton, world: Array, joint: int, turn: Array) -> Skeleton:
    """The skeleton with a joint's frame turned by `turn` [4] at rest, what hangs from it staying where it is; turns it in `world` [T, J, 4]."""
    world[:, joint] = multiply(world[:, joint], turn)
    offsets, tips, back = skeleton.offsets.copy(), skeleton.tips.copy(), inverse(turn)
    for child in np.flatnonzero(skeleton.parents == joint):
        offsets[child] = rotate(back, offsets[child])
    tips[joint] = rotate(back, tips[joint])
    return replace(skeleton, offsets=offsets, tips=tips)


def _stand(skeleton: Skeleton, world: Array, joint: str, end: str) -> Skeleton:
    """A rest pose whose bone from `joint` to `end` points about where the standard body's does. A toe that ends there turns along."""
    bone, standard = skeleton.offsets[skeleton.index(end)], normalize(STANDARD_BODY.offsets[STANDARD_BODY.index(end)])
    if normalize(bone) @ standard > UNLIKE:
        return skeleton
    turn = quat_between(standard, bone)
    turned = _turned(skeleton, world, skeleton.index(joint), turn)
    return _turned(turned, world, skeleton.index(end), turn) if end.endswith("Toe") else turned


def _turn_leg(skeleton: Skeleton, world: Array, positions: Array, side: str) -> Skeleton:
    """A leg whose knee bends forward in the frame of its thigh, in most of the frames in which it is bent."""
    thigh, shin, foot = (skeleton.index(f"{side}{name}") for name in ("UpLeg", "Leg", "Foot"))
    off = across(positions[:, shin] - positions[:, thigh], positions[:, foot] - positions[:, thigh])
    length = np.linalg.norm(skeleton.offsets[shin]) + np.linalg.norm(skeleton.offsets[foot])
    bent = np.linalg.norm(off, axis=-1) > BENT * length
    forward = np.sum(off * rotate(world[:, thigh], FORWARD), axis=-1)[bent]
    if np.sum(forward < 0) <= len(forward) / 2:
        return skeleton
    return _turned(_turned(skeleton, world, thigh, ABOUT), world, shin, ABOUT)


def _roll_foot(skeleton: Skeleton, world: Array, positions: Array, rate: float, side: str) -> None:
    """Rolls foot and toe by half a turn about the foot where its back is away from the shin for LASTING seconds, which no ankle can do."""
    shin, foot, toe = (skeleton.index(f"{side}{name}") for name in ("Leg", "Foot", "Toe"))
    bone = normalize(skeleton.offsets[toe])
    along = rotate(world[:, foot], bone)
    rolled = np.sum(across(positions[:, shin] - positions[:, foot], along) * across(rotate(world[:, foot], UP), along), axis=-1) < 0
    rolled = _lasting(rolled, LASTING * rate)
    half = np.concatenate(([0], bone)).astype(np.float32)
    for joint in (foot, toe):
        world[rolled, joint] = multiply(world[rolled, joint], half)


def _lasting(true: np.ndarray, least: float) -> np.ndarray:
    """The frames of bool [T] that are true for at least `least` frames together."""
    edges = np.flatnonzero(np.diff(true.astype(np.int8), prepend=0, append=0))
    lasting = np.zeros_like(true)
    for start, end in zip(edges[::2], edges[1::2], strict=True):
        lasting[start:end] = end - start >= least
    return lasting
