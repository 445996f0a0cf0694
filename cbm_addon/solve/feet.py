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
    ankles = {}
    for i, side in enumerate(("Left", "Right")):
        point = slice(2 * i, 2 * i + 2)
        ankles[side] = _plant_foot(body, world, side, paths[:, point], locked[:, point], rate, sole, performance.causal) if toes else paths[:, 2 * i]
    return ankles


def _plant_foot(body: Skeleton, world: Array, side: str, paths: Array, locked: np.ndarray, rate: float, sole: float, causal: bool) -> Array:
    """The ankle [T, 3] of one foot with the `paths` [T, 2, 3] of ankle and toe, `locked` bool [T, 2]; turns foot and toe in `world`."""
    foot, toe = body.index(f"{side}Foot"), body.index(f"{side}Toe")
    offset = body.offsets[toe]
    bend = multiply(inverse(world[:, foot]), world[:, toe])
    flat = locked.all(axis=-1)
    missing = rotvec_from_quat(quat_between(rotate(world[:, foot], offset), paths[:, 1] - paths[:, 0]))
    turn = _steady(missing, flat, rate, causal)
    world[:, foot] = multiply(quat_from_rotvec(turn), world[:, foot])
    world[:, toe] = multiply(world[:, foot], bend)
    along = rotate(world[:, foot], offset)
    by_toe = _steady(np.where(locked[:, 1], 1, np.where(locked[:, 0], 0, 0.5))[:, None], locked.any(axis=-1), rate, causal)
    tip = paths[:, 0] + along + by_toe * (paths[:, 1] - paths[:, 0] - along)
    tip[:, 2] = np.maximum(tip[:, 2], sole)
    return tip - along


def _steady(values: Array, sure: np.ndarray, rate: float, causal: bool) -> Array:
    """Values [T, N] that change steadily between frames where they are `sure` bool [T]; float32."""
    if not causal:
        stiffness = np.full(len(values) - 1, STEADY * (rate / 30) ** 2)
        return follow(values, np.where(sure, FLAT, 1), stiffness).astype(np.float32)
    steady, gain = values.astype(np.float32), np.float32(1 - 0.5 ** (1 / (HALFWAY * rate)))
    for t in range(1, len(values)):
        steady[t] = steady[t - 1] + gain * (steady[t] - steady[t - 1])
    return steady
