"""Bodies by their shape: the joints of a person, found from topology and rest positions alone, whatever the bones are called.

Legs are the two chains that come down to the floor side by side; arms the two that hang off the spine above them; the head is what the
spine leads up to. Where along a chain its joints are is told by human proportions (Drillis and Contini 1966). What is found must then look
like a person who stands upright.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations

import numpy as np

from ..errors import InputError
from ..motion.rotations import normalize
from .bone_tree import BoneTree, Pair
from .rig import SIDES, Bones

REQUIRED = ("Hips", "Head", *(side + name for side in SIDES for name in ("Arm", "ForeArm", "Hand", "UpLeg", "Leg", "Foot")))

UP = np.array([0.0, 0, 1])
FORWARD = np.array([0.0, -1, 0])  # where a body faces whose feet do not tell
UPRIGHT, STANDING = np.cos(np.radians(55)), np.cos(np.radians(45))  # of a spine, and of thighs and shins, at rest

# Proportions, as quotients, and how far a body may be from them: standard deviations of their logarithms
SHIN_TO_THIGH = 1.0, 0.25
HIP_TO_LEG = 0.1, 0.5  # from the middle to the hip joint
FOREARM_TO_UPPER_ARM = 0.8, 0.3
ARM_TO_LEG = 0.67, 0.3  # to the wrist and to the ankle
SHOULDERS_TO_HIPS = 2.0, 0.5  # widths, from joint to joint

HIGHEST_HEAD = 1.16  # height of the head joint above the floor over that of the arms, at most: what is higher is the top of the head
ODDEST = 10  # squared deviations of a limb that is still taken for one; those of real rigs are below 3
CLOSE = 0.1  # share of the thigh within which a bone before it is only a helper
BALL = 0.7  # where the toes begin, as a share of the way from the ankle to the tip of the foot
RIVAL = 0.7  # a second pair of chains of this share of the length of the first could be the limbs as well


def find_joints(bones: Bones) -> dict[str, str]:
    """Body joint -> bone of a person who stands upright at rest; InputError that says what of a person the armature lacks."""
    try:
        joints = {joint: bones.bones[bone] for joint, bone in _joints(BoneTree(bones)).items()}
    except _NoPersonError as error:
        raise InputError(bones.name, str(error)) from None
    if reason := misshapen(bones, joints):
        raise InputError(bones.name, reason)
    return joints


def misshapen(bones: Bones, joints: dict[str, str]) -> str | None:
    """What keeps bones that play joints from being a person who stands upright at rest; None if nothing does."""
    at = {joint: bones.head(bone) for joint, bone in joints.items()}
    floor = min(at[f"{side}Foot"][2] for side in SIDES)
    height = at["Head"][2] - floor
    if height <= 0 or normalize(at["Head"] - at["Hips"])[2] < UPRIGHT:
        return "its spine is not upright at rest"
    limbs = {}
    for side in SIDES:
        for limb, (start, middle, end) in (("leg", ("UpLeg", "Leg", "Foot")), ("arm", ("Arm", "ForeArm", "Hand"))):
            upper, lower = (float(np.linalg.norm(at[side + b] - at[side + a])) for a, b in ((start, middle), (middle, end)))
            if not height / 50 < upper < 4 * lower < 16 * upper:
                return f"the bones of its {side.lower()} {limb} have no human lengths"
            limbs[side, limb] = upper + lower
        if min(normalize(at[f"{side}{a}"] - at[f"{side}{b}"])[2] for a, b in (("UpLeg", "Leg"), ("Leg", "Foot"))) < STANDING:
            return f"its {side.lower()} leg does not point down at rest"
        if at[f"{side}Hand"][2] < floor + 0.15 * height:
            return f"its {side.lower()} hand is on the floor at rest"
    for limb in ("leg", "arm"):
        if not 0.7 < limbs["Left", limb] / limbs["Right", limb] < 1.4:
            return f"its {limb}s are not of one length"
    if not 0.25 < limbs["Left", "arm"] / limbs["Left", "leg"] < 3:
        return "its arms and legs are not of human lengths"
    across = np.sum([at[f"Left{name}"] - at[f"Right{name}"] for name in ("UpLeg", "Arm")], axis=0)
    feet = np.sum([at[f"{side}Toe"] - at[f"{side}Foot"] for side in SIDES if f"{side}Toe" in at] or [[0, 0, 0]], axis=0)
    if np.dot(normalize(feet * [1, 1, 0]), np.cross(normalize(across * [1, 1, 0]), UP)) < -0.3:
        return "its feet point backward, as if left and right were exchanged"
    return None


class _NoPersonError(Exception):
    """What of a person is not there."""


def _require(reason: str, fulfilled: bool) -> None:
    if not fulfilled:
        raise _NoPersonError(reason)


def _joints(tree: BoneTree) -> dict[str, int]:
    legs = _legs(tree)
    leg_joints = _leg_joints(tree, legs)
    arms = _arms(tree, legs)
    if np.dot(tree.across(arms), tree.across(legs)) < 0:
        arms = arms.swapped()
    arm_joints = _arm_joints(tree, arms, legs, leg_joints)
    trunk = tree.shared(legs.parent, arms.parent)
    _require("its arms and legs do not hang off one skeleton", len(trunk) > 0)
    hips, spine = trunk[-1], tree.down_to(arms.parent)[len(trunk) :]
    _require("its arms hang off the same bone as its legs", len(spine) > 0)
    neck, head = _head(tree, arms, max(tree.heads[joints["Arm"], 2] for joints in arm_joints))
    found = {"Hips": hips, "Head": head, **_spine_joints(spine, neck)}
    sides = SIDES if _left_first(tree, legs, leg_joints) else SIDES[::-1]
    for side, leg, arm in zip(sides, leg_joints, arm_joints, strict=True):
        found |= {side + name: bone for name, bone in (leg | arm).items()}
    return found


def _only(pairs: list[Pair], lengths: list[float], limbs: str) -> Pair:
    """The pair of the longest chains, if no other is nearly as long."""
    _require(f"no two chains of bones could be its {limbs}", len(pairs) > 0)
    rivals = [pair for pair, length in zip(pairs, lengths, strict=True) if length > RIVAL * max(lengths)]
    _require(f"more than two chains of bones could be its {limbs}", len({chain[0] for pair in rivals for chain in pair.chains}) == 2)
    return rivals[0]


# Legs


def _legs(tree: BoneTree) -> Pair:
    """The pair of chains that comes down to the floor."""

    def descent(pair: Pair) -> float:
        return min(float(tree.heads[chain[0], 2] - tree.heads[chain, 2].min()) for chain in pair.chains)

    def lowest(pair: Pair) -> float:
        return min(float(tree.heads[chain, 2].min()) for chain in pair.chains)

    down = [pair for pair in tree.pairs() if descent(pair) > 0.6 * min(tree.reach[chain[0]] for chain in pair.chains)]
    floor = min((lowest(pair) for pair in down), default=0)
    standing = [pair for pair in down if lowest(pair) < floor + 0.2 * descent(pair)]
    return _only(standing, [descent(pair) for pair in standing], "legs")


def _leg_joints(tree: BoneTree, legs: Pair) -> list[dict[str, int]]:
    """UpLeg, Leg, Foot and, where one bone can be it, Toe, of both legs."""

    def oddity(which: int, thigh: int, knee: int, ankle: int) -> float:
        chain = legs.chains[which]
        steps = np.diff(tree.heads[chain], axis=0)
        descent = np.concatenate(([0.0], np.cumsum(-steps[:, 2] - np.linalg.norm(steps[:, :2], axis=-1))))  # a foot goes forward more than down
        too_high = 1 - (descent[ankle] - descent[thigh]) / max(np.ptp(descent[thigh:]), 1e-9)
        lengths = _lengths(tree, chain, thigh, knee, ankle)
        hip = sum(lengths), tree.beside(legs, which)[thigh]
        return _off(lengths, SHIN_TO_THIGH) + _off(hip, HIP_TO_LEG) + 12 * too_high + _bends(tree, chain, thigh, knee, ankle)

    joints = []
    for chain, (thigh, knee, ankle) in zip(legs.chains, _least_odd(legs, oddity), strict=True):
        while thigh + 1 < knee and tree.distance(chain[thigh], chain[thigh + 1]) < CLOSE * tree.distance(chain[thigh], chain[knee]):
            thigh += 1
        toe = _toe(tree, chain[ankle:])
        joints.append({"UpLeg": chain[thigh], "Leg": chain[knee], "Foot": chain[ankle]} | ({} if toe is None else {"Toe": toe}))
    return joints


def _toe(tree: BoneTree, foot: list[int]) -> int | None:
    """The bone of a chain from the ankle on at which all toes bend; None where every toe has a bone of its own."""
    if len(foot) < 2 or tree.branches(foot[0]) > 2:
        return None
    ways = np.linalg.norm((tree.heads[foot[1:]] - tree.heads[foot[0]])[:, :2], axis=-1)
    return foot[1 + int(np.argmin(np.abs(ways / max(ways[-1], 1e-9) - BALL)))] if len(ways) > 1 else foot[1]


def _left_first(tree: BoneTree, legs: Pair, joints: list[dict[str, int]]) -> bool:
    """Whether the first of the legs is the left one, going by where the feet point."""
    front = np.cross(tree.across(legs), UP)
    pointing = np.zeros(3)
    for chain, leg in zip(legs.chains, joints, strict=True):
        tip = tree.tails[leg["Foot"]] if chain[-1] == leg["Foot"] else tree.heads[chain[-1]]
        pointing += tip - tree.heads[leg["Foot"]]
    pointing = normalize(pointing * [1, 1, 0])
    return bool(np.dot(pointing if abs(np.dot(pointing, front)) > 0.5 else FORWARD, front) > 0)


# Arms


def _arms(tree: BoneTree, legs: Pair) -> Pair:
    """The pair of long chains that hangs off the skeleton above the legs."""
    leg = max(tree.reach[chain[0]] for chain in legs.chains)
    hips = max(tree.heads[chain[0], 2] for chain in legs.chains)
    found = [pair for pair in tree.pairs() if all(tree.reach[chain[0]] > 0.3 * leg and tree.heads[chain[0], 2] > hips + 0.1 * leg for chain in pair.chains)]
    return _only(found, [min(tree.reach[chain[0]] for chain in pair.chains) for pair in found], "arms")


def _arm_joints(tree: BoneTree, arms: Pair, legs: Pair, leg_joints: list[dict[str, int]]) -> list[dict[str, int]]:
    """Arm, ForeArm, Hand and, where something carries the arm, Shoulder, of both arms. A bone with three fingers is a hand."""
    leg = leg_joints[0]
    hip = tree.beside(legs, 0)[legs.chains[0].index(leg["UpLeg"])]
    leg_length = tree.distance(leg["UpLeg"], leg["Leg"]) + tree.distance(leg["Leg"], leg["Foot"])

    def oddity(which: int, shoulder: int, elbow: int, hand: int) -> float:
        chain = arms.chains[which]
        fingered = [tree.branches(bone) >= 3 for bone in chain[2:]]
        if any(fingered) and hand != 2 + fingered.index(True):
            return np.inf
        thumbless = len(tree.children[chain[hand]]) < 2
        lengths = _lengths(tree, chain, shoulder, elbow, hand)
        widths = hip, tree.beside(arms, which)[shoulder]
        proportions = _off(lengths, FOREARM_TO_UPPER_ARM) + _off((leg_length, sum(lengths)), ARM_TO_LEG) + _off(widths, SHOULDERS_TO_HIPS)
        return proportions + 2 * thumbless + _bends(tree, chain, shoulder, elbow, hand)

    joints = []
    for chain, (shoulder, elbow, hand) in zip(arms.chains, _least_odd(arms, oddity), strict=True):
        joints.append({"Arm": chain[shoulder], "ForeArm": chain[elbow], "Hand": chain[hand]} | ({"Shoulder": chain[0]} if shoulder else {}))
    return joints


# Limbs


def _least_odd(pair: Pair, oddity: Callable[..., float]) -> list[tuple[int, int, int]]:
    """Where on each chain of a pair a limb has its three joints; at the same bones of both, if they have the same number."""
    places = [list(combinations(range(len(chain)), 3)) for chain in pair.chains]
    if len(places[0]) == len(places[1]):
        best = [min(places[0], key=lambda place: oddity(0, *place) + oddity(1, *place))] * 2
    else:
        best = [min(places[which], key=lambda place, which=which: oddity(which, *place)) for which in (0, 1)]
    _require("its limbs have not the proportions of a person's", max(oddity(which, *best[which]) for which in (0, 1)) < ODDEST)
    return best


def _lengths(tree: BoneTree, chain: list[int], start: int, middle: int, end: int) -> tuple[float, float]:
    return tree.distance(chain[start], chain[middle]), tree.distance(chain[middle], chain[end])


def _bends(tree: BoneTree, chain: list[int], start: int, middle: int, end: int) -> float:
    """How far the bones between the ends of the two parts of a limb are off the straight line: 6 for a tenth of its length."""
    ways = np.linalg.norm(np.diff(tree.heads[chain[start : end + 1]], axis=0), axis=-1)
    return 60 * float(ways.sum() / max(sum(_lengths(tree, chain, start, middle, end)), 1e-9) - 1)


def _off(lengths: tuple[float, float], proportion: tuple[float, float]) -> float:
    """Squared deviations of the second length over the first from a proportion."""
    mean, deviation = proportion
    return float(np.log(max(lengths[1], 1e-9) / max(lengths[0], 1e-9) / mean) / deviation) ** 2


# Spine and head


def _head(tree: BoneTree, arms: Pair, shoulders: float) -> tuple[int | None, int]:
    """The neck, where there is one, and the head: what goes on upward between the arms, up to where it branches into a face."""
    floor = tree.heads[:, 2].min()
    chain = [arms.parent]
    while above := [child for child in tree.children[chain[-1]] if child not in (arms.chains[0][0], arms.chains[1][0])]:
        following = max(above, key=lambda child: tree.top[child])
        way = tree.heads[following] - tree.heads[chain[-1]]
        rise = way[2] - np.linalg.norm(way[:2])  # what goes forward more than up belongs to the face
        too_high = tree.heads[following, 2] - floor > HIGHEST_HEAD * (shoulders - floor)
        face_begins = len(chain) > 1 and tree.heads[chain[-1], 2] > shoulders and (len(above) > 1 or rise < 1e-6)
        if too_high or rise < -1e-6 or face_begins:
            break
        chain.append(following)
    _require("it has no head above its arms", len(chain) > 1)
    return (chain[1] if len(chain) > 2 else None), chain[-1]


def _spine_joints(spine: list[int], neck: int | None) -> dict[str, int]:
    """The joints of a spine from above the hips to the bone that carries the arms; of a long one some between are left out, evenly."""
    names = ("Spine", "Spine1", "Spine2", "Neck") if neck is None else ("Spine", "Spine1", "Spine2")
    count = min(len(names), len(spine))
    places = np.linspace(0, len(spine) - 1, count).round().astype(int) if count > 1 else [len(spine) - 1]
    joints: dict[str, int] = {name: spine[i] for name, i in zip(names, places, strict=False)}
    return joints if neck is None else joints | {"Neck": neck}
