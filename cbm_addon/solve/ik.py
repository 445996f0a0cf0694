"""Inverse kinematics on batches of poses: two-bone limbs in closed form, and a spine that bends evenly until the head is where it must be."""

from __future__ import annotations

import numpy as np

from ..motion.rotations import Array, across, multiply, normalize, quat_between, quat_from_rotvec, rotate, rotvec_from_quat

REACH = 0.9995  # share of its length to which a limb may straighten


def clamp_reach(origin: Array, target: Array, length: float | Array) -> Array:
    """Targets [..., 3] pulled toward the origins [..., 3] so that none is farther than `length` times REACH."""
    difference = target - origin
    distance = np.linalg.norm(difference, axis=-1, keepdims=True)
    limit = np.asarray(length, dtype=target.dtype)[..., None] * np.float32(REACH)
    return origin + difference * np.minimum(1, limit / np.maximum(distance, 1e-9))


def two_bone(origin: Array, target: Array, upper: float, lower: float, pole: Array) -> Array:
    """The middle joint [..., 3] of a limb from `origin` to `target` (within reach) with bones of those lengths, bent toward `pole`.

    `pole` [..., 3] is a direction from the line origin-target; its part along the line does not matter.
    """
    difference = target - origin
    distance = np.linalg.norm(difference, axis=-1, keepdims=True)
    along = difference / np.maximum(distance, 1e-9)
    side = normalize(across(pole, along))
    distance = np.clip(distance, abs(upper - lower) + 1e-6, upper + lower)
    cosine = np.clip((upper**2 + distance**2 - lower**2) / (2 * upper * distance), -1, 1)
    return origin + upper * (cosine * along + np.sqrt(1 - cosine**2) * side)


def aim(rotation: Array, offset: Array, direction: Array) -> Array:
    """World rotations [..., 4] turned by the least angle so that `offset` [3] (in the joint's frame) points along `direction` [..., 3]."""
    return multiply(quat_between(rotate(rotation, offset), direction), rotation)


def turned_toward(rotation: Array, offset: Array, direction: Array, limit: float) -> Array:
    """Like `aim`, but by at most `limit` radians."""
    turn = rotvec_from_quat(quat_between(rotate(rotation, offset), direction))
    size = np.linalg.norm(turn, axis=-1, keepdims=True)
    return multiply(quat_from_rotvec(turn * np.minimum(1, limit / np.maximum(size, 1e-9))), rotation)


def bend_chain(rotations: Array, offsets: Array, base: Array, target: Array, iterations: int = 12) -> tuple[Array, Array]:
    """Bends a chain evenly until its end meets `target`: damped least squares over the turns of its joints, where a joint far from the
    end turns more readily than one close to it, so that the last, short bone does not do the work of the whole chain.

    rotations  [T, N, 4] world rotations of the joints that bend, base first
    offsets    [N, 3] from each of these joints to the next (the last: to the end), in the joint's frame
    base       [T, 3] position of the first joint
    target     [T, 3]
    Returns the rotations and the end positions [T, 3], which are the target as far as the chain reaches.
    """
    rotations = rotations.copy()
    readiness = np.cumsum(np.linalg.norm(offsets, axis=-1)[::-1])[::-1].astype(rotations.dtype)[:, None]
    damping = np.float32(1e-4) * readiness.sum() ** 3 * np.eye(3, dtype=rotations.dtype)
    for _ in range(iterations):
        steps = rotate(rotations, offsets)
        arms = np.cumsum(steps[:, ::-1], axis=1)[:, ::-1]  # from each joint to the end
        error = target - base - arms[:, 0]
        if np.abs(error).max(initial=0) < 1e-4:
            break
        squares = np.sum(arms * arms, axis=-1)[..., None, None] * np.eye(3, dtype=arms.dtype) - arms[..., :, None] * arms[..., None, :]
        system = np.sum(readiness[..., None] * squares, axis=1) + damping
        force = np.linalg.solve(system, error[..., None])[..., 0]
        turns = readiness * np.cross(arms, force[:, None])
        turns *= np.minimum(1, 0.4 / np.maximum(np.linalg.norm(turns, axis=-1, keepdims=True), 1e-9))
        # A joint carries everything above it: its turn adds to theirs.
        rotations = multiply(quat_from_rotvec(np.cumsum(turns, axis=1)), rotations)
    return rotations, base + rotate(rotations, offsets).sum(axis=1)
