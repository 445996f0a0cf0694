"""Planting feet: where ankles go and how feet are turned, so that what is in contact stands still."""

from __future__ import annotations

import numpy as np

from ..features import LOWER_JOINTS
from ..motion.contacts import CONTACT_JOINTS
from ..motion.rotations import Array, inverse, multiply, quat_between, quat_from_rotvec, rotate, rotvec_from_quat
from ..motion.skeleton import STANDARD_BODY, Skeleton
from .foot_lock import CAUSAL_OFF, CAUSAL_ON, contact_states, lock_causally, lowered, solve_paths, without_blips
from .performance import Performance
from .tridiagonal import follow

SIDES = ("Left", "Right")
AVERAGE_ANKLE = np.float32(STANDARD_BODY.height_above_toes("LeftFoot") / STANDARD_BODY.height_above_toes("Head"))  # over the toes, in head heights
FLAT = 1e4  # how much what planted points say counts, against what the others say
STEADY = 30.0  # what a change of how a foot is turned otherwise than predicted costs from frame to frame, likewise, at 30 frames per second
HALFWAY = 0.05  # seconds in which it comes half-way, without looking ahead


def plant_feet(body: Skeleton, performance: Performance, world: Array, unit: np.float32, rate: float, sole: float) -> dict[str, Array]:
    """Turns feet and toes in the world rotations `world` [T, J, 4] and returns where the ankles go, [T, 3] by side.

    A point in contact stands still. While both points of a foot do, it points from one to the other; else it is turned as predicted, and only slowly
    otherwise, since the paths of its two points would make it tremble.

    unit  metres in a head height
    sole  metres: height of the toe joints (of the ankles, if there are no toes) above the floor when the body stands
    """
    joints = [LOWER_JOINTS.index(name) for name in CONTACT_JOINTS]
    predicted = performance.lower_positions[:, joints] * unit
    toes = "LeftToe" in body
    predicted[..., 2] += np.float32(sole) - (0 if toes else AVERAGE_ANKLE * unit)
    if performance.causal:
        rest = np.array([body.height_above_toes(name) if toes and name.endswith("Foot") else 0 for name in CONTACT_JOINTS], np.float32) + np.float32(sole)
        locked = contact_states(performance.contacts, CAUSAL_ON, CAUSAL_OFF)
        paths = lock_causally(lowered(predicted, performance.contacts, rest), locked, rate, float(unit))
    else:
        locked = without_blips(contact_states(performance.contacts))
        paths = solve_paths(predicted, performance.lower_velocities[:, joints] * unit, locked, rate)
    pairs = paths.reshape(len(paths), 2, 2, 3)
    ankles = _plant_toed(body, world, pairs, locked.reshape(-1, 2, 2), rate, sole, performance.causal) if toes else pairs[:, :, 0]
    return {side: ankles[:, i] for i, side in enumerate(SIDES)}


def _plant_toed(body: Skeleton, world: Array, paths: Array, locked: np.ndarray, rate: float, sole: float, causal: bool) -> Array:
    """The ankles [T, 2, 3] of feet with the `paths` [T, 2, 2, 3] of ankle and toe, `locked` bool [T, 2, 2]; turns feet and toes in `world`."""
    feet, toes = (body.indices([f"{side}{name}" for side in SIDES]) for name in ("Foot", "Toe"))
    offsets, (ankle, toe) = body.offsets[toes], np.moveaxis(paths, 2, 0)
    bend = multiply(inverse(world[:, feet]), world[:, toes])
    missing = rotvec_from_quat(quat_between(rotate(world[:, feet], offsets), toe - ankle))
    by_toe = np.where(locked[..., 1], 1, np.where(locked[..., 0], 0, 0.5))[..., None]  # the share of what the toe says of where the foot is
    sure = np.concatenate((locked.all(axis=-1), locked.any(axis=-1)), axis=-1)
    steady = _steady(np.concatenate((missing, np.broadcast_to(by_toe, missing.shape)), axis=1), sure, rate, causal)
    world[:, feet] = multiply(quat_from_rotvec(steady[:, :2]), world[:, feet])
    world[:, toes] = multiply(world[:, feet], bend)
    along = rotate(world[:, feet], offsets)
    tip = ankle + along + steady[:, 2:] * (toe - ankle - along)
    tip[..., 2] = np.maximum(tip[..., 2], sole)
    return tip - along


def _steady(values: Array, sure: np.ndarray, rate: float, causal: bool) -> Array:
    """Values [T, N, 3] that change steadily between frames where they are `sure` bool [T, N]; float32."""
    if not causal:
        stiffness = np.full(len(values) - 1, STEADY * (rate / 30) ** 2)
        return follow(values, np.where(sure, FLAT, 1), stiffness).astype(np.float32)
    steady, gain = values.astype(np.float32), np.float32(1 - 0.5 ** (1 / (HALFWAY * rate)))
    for t in range(1, len(values)):
        steady[t] = steady[t - 1] + gain * (steady[t] - steady[t - 1])
    return steady
