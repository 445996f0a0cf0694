"""The body of a rig as capsules around its bones: what hands must not enter of the character itself."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ..motion.rotations import Array, multiply, normalize, rotate
from ..motion.thickness import FOOT, HEAD, LIMBS, NECK, NEXT, SKULL, TRUNK
from .fingers import FingerBones
from .rig import SIDES, Rig

SKIN = 75  # percentile of the distances of the skin around a part that is taken for its radius
AROUND = 0.4, 2.0  # shares of the expected radius between which skin belongs to a part
ENOUGH = 12  # vertices that tell a radius


@dataclass(frozen=True)
class Collider:
    """A part of the body: a tapered capsule that a bone carries, or two side by side.

    joint       where it begins
    start, end  float64 [3]: world, at rest
    radii       at the start and at the end, world units
    beside      float64 [3]: from its middle to one of two capsules; zeros if there is one
    """

    bone: str
    joint: str
    start: Array
    end: Array
    radii: tuple[float, float]
    beside: Array


def body_colliders(rig: Rig) -> list[Collider]:
    """The parts of a body of a rig's size, without its hands."""
    joints, above = rig.mapping.joints, rig.mapping.parents
    at = {joint: rig.head(bone) for joint, bone in joints.items()}
    unit = at["Head"][2] - min(at[f"{side}{name}"][2] for side in SIDES for name in ("Foot", "Toe") if f"{side}{name}" in at)
    left = normalize((at["LeftUpLeg"] - at["RightUpLeg"]) * [1, 1, 0])

    def part(joint: str, end: Array, sizes: tuple[float, float, float], start: Array | None = None) -> Collider:
        begins, ends, beside = (unit * size for size in sizes)
        return Collider(joints[joint], joint, at[joint] if start is None else start, end, (begins, ends), beside * left)

    spine = ["Head"]
    while (parent := above[spine[-1]]) is not None:
        spine.append(parent)
    up = np.array([0.0, 0, unit])
    parts = [part("Head", at["Head"] + SKULL[1] * up, HEAD, at["Head"] + SKULL[0] * up)]
    for upper, lower in pairwise(spine):
        sizes = NECK if lower == "Neck" or (upper == "Head" and "Neck" not in joints) else TRUNK
        parts.append(part(lower, at[upper], sizes))
    for side in SIDES:
        for limb, sizes in LIMBS.items():
            following = side + NEXT[limb]
            end = at[following] if following in at else at[side + limb] + FOOT * unit * np.cross(left, [0.0, 0, 1])
            parts.append(part(side + limb, end, sizes))
    return parts


def fitted(colliders: list[Collider], skin: Array) -> list[Collider]:
    """The same parts, as thick as the skin [V, 3] (world, at rest) around them; those around which there is too little keep their size."""
    owners = np.full(len(skin), -1)
    nearest = np.full(len(skin), np.inf)
    shares, distances = [], []
    for i, collider in enumerate(colliders):
        share, distance = _around(collider, skin)
        expected = np.interp(share, (0, 1), collider.radii)
        closer = np.abs(distance - expected) < nearest
        owners[closer], nearest[closer] = i, np.abs(distance - expected)[closer]
        shares.append(share)
        distances.append(distance)
    result = []
    for i, collider in enumerate(colliders):
        own = (owners == i) & (shares[i] > 0) & (shares[i] < 1)
        expected = np.interp(shares[i], (0, 1), collider.radii)
        own &= (distances[i] > AROUND[0] * expected) & (distances[i] < AROUND[1] * expected)
        halves = [own & (shares[i] <= 0.5), own & (shares[i] >= 0.5)]
        if min(half.sum() for half in halves) < ENOUGH:
            result.append(collider)
            continue
        quarter, third = (float(np.percentile(distances[i][half], SKIN)) for half in halves)
        radii = 1.5 * quarter - 0.5 * third, 1.5 * third - 0.5 * quarter  # at the ends, from the middles of the halves
        result.append(replace(collider, radii=tuple(max(radius, 0.5 * min(quarter, third)) for radius in radii)))
    return result


def _around(collider: Collider, points: Array) -> tuple[Array, Array]:
    """Where along a part points [N, 3] are, from 0 to 1, and how far from its middle line or lines."""
    along = collider.end - collider.start
    best_share, best = np.zeros(len(points)), np.full(len(points), np.inf)
    for beside in (collider.beside, -collider.beside):
        offset = points - collider.start - beside
        share = np.clip(offset @ along / max(along @ along, 1e-12), 0, 1)
        distance = np.linalg.norm(offset - share[:, None] * along, axis=-1)
        best_share, best = np.where(distance < best, share, best_share), np.minimum(best, distance)
    return best_share, best


def finger_colliders(rig: Rig, fingers: FingerBones, radii: Array, palm: float) -> list[Collider]:
    """The phalanges of a hand [15], as thick as `radii` [15], and the palm from the wrist to the first joints [5], `palm` thick; world units."""
    wrist = multiply(rig.object_rotation, rig.rest_rotation(fingers.wrist))
    places = rotate(wrist, fingers.positions) + rig.head(fingers.wrist)
    chains = np.concatenate((places[:15].reshape(5, 3, 3), places[15:, None]), axis=1)
    ends = zip(chains[:, :3].reshape(-1, 3), chains[:, 1:].reshape(-1, 3), radii.tolist(), strict=True)
    phalanges = [Collider(fingers.wrist, "Finger", start, end, (radius, radius), np.zeros(3)) for start, end, radius in ends]
    return phalanges + [Collider(fingers.wrist, "Palm", rig.head(fingers.wrist), base, (palm, palm), np.zeros(3)) for base in chains[:, 0]]
