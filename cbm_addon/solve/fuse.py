"""Stage 3: a performance becomes the motion of one body. Head and wrists meet the trackers, planted feet stay planted.

The body may be the engine's or a rig's: everything here uses the body's own bone lengths, so that nothing slides or misses after the fact.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..features import LOWER_JOINTS, UPPER_JOINTS
from ..motion.contacts import CONTACT_JOINTS
from ..motion.motion import Motion, local_rotations
from ..motion.rotations import IDENTITY, Array, across, continuous, inverse, multiply, normalize, quat_from_rotvec, rotate
from ..motion.skeleton import Skeleton
from ..progress import Job, Progress, part, run
from ..takes.take import DEVICES, Take
from .feet import plant_feet
from .foot_lock import solve_paths
from .ik import REACH, aim, bend_chain, clamp_reach, turned_toward, two_bone
from .manner import with_manner
from .perform import sampled
from .performance import Performance
from .reach import within_reach
from .spine import carried, chest_of, with_neck
from .tracker_update import doubted, updated

SHOULDER_LIMIT = np.radians(30)  # how far a shoulder may follow a hand that the arm does not reach
CHEST_LIMIT = np.radians(60)  # and the chest, where the shoulder is not enough
HEEL_LIMIT = np.radians(45)  # how far a foot may rise over its toes where the leg is too short
REACHING = 20  # steps in which the chest follows
FAR_SPINE = 0.02  # head heights: of a spine that is so much too long or short the hips take half, ever less of more: the height is believed wrongly
FORWARD = np.array([0, -1, 0], np.float32)


@dataclass(frozen=True)
class UpperBody:
    """An upper body that a motion must have, at its times: head and wrists as a calibrated take, and world rotations [T, J, 4] of the body's joints."""

    take: Take
    rotations: Array


def fuse(performance: Performance, take: Take, times: np.ndarray, body: Skeleton, sole: float = 0.0) -> Motion:
    """`fusing`, at once."""
    return run(fusing(performance, take, times, body, sole))


def fusing(performance: Performance, take: Take, times: np.ndarray, body: Skeleton, sole: float = 0.0, upper: UpperBody | None = None) -> Job[Motion]:
    """The motion [T] of `body` at `times`.

    take  calibrated (joint poses, metres); its trackers are scaled uniformly about the world origin to the body's standing head height
    sole  metres: height of the body's toe joints (of its ankles, if it has no toes) above the floor when it stands
    upper  is met instead of the trackers, and turned as it is instead of as predicted; hips and legs are where the trackers say all the same
    """
    scale = np.float32((body.height_above_toes("Head") + sole) / performance.head_height)
    trackers = sampled(take, times)
    performance = performance.at(times)
    unit = scale * np.float32(performance.head_height)
    world = world_rotations(body, performance)
    performance = with_manner(updated(performance, body, world, unit, _targets(performance.miscalibration.corrected(trackers), scale)))
    if upper:
        above = [i for i, name in enumerate(body.names) if name not in LOWER_JOINTS]
        world[:, above] = upper.rotations[:, above]
    targets = _targets(upper.take if upper else trackers, scale)
    rate = 1 / float(np.median(np.diff(times))) if len(times) > 1 else 1.0
    yield Progress(0.1, "planting feet")
    ankles = plant_feet(body, performance, world, unit, rate, sole)
    standing = {side: performance.contacts[:, [name.startswith(side) for name in CONTACT_JOINTS]].max(axis=1) for side in ankles}
    hips, ankles = within_reach(body, world, _hips_path(performance, rate) * unit, targets["head"][0], ankles, standing)
    yield Progress(0.3, "meeting the headset")
    hips = _along_spine(body, performance.miscalibration.height, world, hips, *targets["head"])
    hips = _meet_head(body, world, hips, *targets["head"])
    hips = yield from part(_follow_hands(body, world, hips, targets), 0.4, 0.8)
    world = normalize(world)  # after hundreds of small turns
    yield Progress(0.8, "meeting the controllers")
    for side in ("Left", "Right"):
        _meet_hand(body, world, hips, side, *targets[side.lower()])
        _meet_ankle(body, world, hips, side, ankles[side])
    yield Progress(0.95, "writing the motion")
    local = continuous(local_rotations(body, world))
    return Motion(body, np.asarray(times, np.float64), hips.astype(np.float32), local.astype(np.float32))


def _targets(trackers: Take, scale: np.float32) -> dict[str, tuple[Array, Array]]:
    """By device the positions [T, 3], metres on the body, and rotations [T, 4] of the joints that it tracks."""
    return {name: (trackers.positions[:, i] * scale, trackers.rotations[:, i]) for i, name in enumerate(DEVICES)}


def world_rotations(body: Skeleton, performance: Performance) -> Array:
    """World rotations [T, J, 4] of the body's joints as predicted, the head and hands still to come.

    The joint that carries the shoulders takes the rotation of the engine's upper chest ("Neck"), whatever it is called on this body; a
    neck above it is half-way between chest and head.
    """
    source = {name: performance.lower_rotations[:, i] for i, name in enumerate(LOWER_JOINTS)}
    source |= {name: performance.upper_rotations[:, i] for i, name in enumerate(UPPER_JOINTS)}
    chest = body.names[chest_of(body)]
    world = np.zeros((len(performance.times), len(body), 4), np.float32)
    for i, name in enumerate(body.names):
        world[:, i] = source["Neck" if name == chest else name] if name in source else IDENTITY
    return world


def _hips_path(performance: Performance, rate: float) -> Array:
    """The hips [T, 3] as predicted; looking ahead, the path whose velocities are those inside the sequences."""
    hips = slice(LOWER_JOINTS.index("Hips"), LOWER_JOINTS.index("Hips") + 1)
    positions = performance.lower_positions[:, hips]
    if not performance.causal:
        free = np.zeros(positions.shape[:2], dtype=bool)
        positions = solve_paths(positions, performance.lower_velocities[:, hips], free, rate)
    return positions[:, 0]


def _along_spine(body: Skeleton, height: float, world: Array, hips: Array, head: Array, rotation: Array) -> Array:
    """The hips [T, 3] moved along the spine, so that it leans to the head but keeps the length that it has as predicted, on bones of the performer's
    `height` as a share of the body's: nearly straight, a spine that took up a centimetre would bend by tens of degrees, and tremble."""
    spine = normalize(head - hips)
    end = carried(body.scaled(height), with_neck(body, world, rotation), hips, body.chain("Hips", "Head"))
    missed = np.sum((head - end) * spine, axis=-1, keepdims=True)
    return hips + spine * doubted(missed, FAR_SPINE * body.height_above_toes("Head"))


def _meet_head(body: Skeleton, world: Array, hips: Array, head: Array, rotation: Array) -> Array:
    """Bends the spine in `world` until the head joint is at `head`; shoulders go along. Returns the hips [T, 3].

    What the spine cannot do the hips do.
    """
    chain, chest = body.chain("Hips", "Head"), chest_of(body)
    bending = chain[1:-1]
    world[:] = with_neck(body, world, rotation)
    before = world[:, chest].copy()
    base = hips + rotate(world[:, chain[0]], body.offsets[bending[0]])
    world[:, bending], end = bend_chain(world[:, bending], body.offsets[[*bending[1:], chain[-1]]], base, head)
    turn = multiply(world[:, chest], inverse(before))
    for shoulder in (body.index(name) for name in ("LeftShoulder", "RightShoulder") if name in body):
        world[:, shoulder] = multiply(turn, world[:, shoulder])
    world[:, chain[-1]] = rotation
    return hips + (head - end)


def _follow_hands(body: Skeleton, world: Array, hips: Array, targets: dict[str, tuple[Array, Array]]) -> Job[Array]:
    """Turns and leans the torso in `world` toward wrists that the arms do not reach, the head staying. Returns the hips [T, 3]."""
    chain = body.chain("Hips", "Head")
    bending = chain[1 : chain.index(chest_of(body)) + 1]
    for step in range(REACHING):
        yield Progress(step / REACHING, "reaching")
        turn = np.zeros_like(hips)
        center = carried(body, world, hips, chain[: chain.index(bending[-1]) + 1])
        for side in ("Left", "Right"):
            wrist = targets[side.lower()][0]
            _, socket, length = _followed(body, world, hips, side, wrist)
            missing = wrist - clamp_reach(socket, wrist, length)
            arm = socket - center
            turn += np.cross(arm, missing) / np.maximum(np.sum(arm * arm, axis=-1, keepdims=True), 1e-6)
        if np.abs(turn).max(initial=0) < 1e-3:
            break
        size = np.linalg.norm(turn, axis=-1, keepdims=True)
        turn = turn * np.minimum(1, CHEST_LIMIT / REACHING / np.maximum(size, 1e-9))
        for i, joint in enumerate(bending):
            world[:, joint] = multiply(quat_from_rotvec(turn * ((i + 1) / len(bending))), world[:, joint])
        for side in ("Left", "Right"):
            for name in ("Shoulder", "Arm", "ForeArm"):
                if f"{side}{name}" in body:
                    joint = body.index(f"{side}{name}")
                    world[:, joint] = multiply(quat_from_rotvec(turn), world[:, joint])
        hips = _meet_head(body, world, hips, *targets["head"])
    return hips


def _followed(body: Skeleton, world: Array, hips: Array, side: str, wrist: Array) -> tuple[Array, Array, float]:
    """The shoulder's rotations [T, 4] once it has followed a wrist that is out of reach as far as it may, where the arm begins then, [T, 3], and the
    arm's length. On a body without shoulders the rotations are those of what carries the arm."""
    arm, forearm, hand = (body.index(f"{side}{name}") for name in ("Arm", "ForeArm", "Hand"))
    length = float(np.linalg.norm(body.offsets[forearm]) + np.linalg.norm(body.offsets[hand]))
    chain = body.chain("Hips", f"{side}Arm")
    shoulder, socket = chain[-2], carried(body, world, hips, chain)
    if f"{side}Shoulder" not in body:
        return world[:, shoulder], socket, length
    root = carried(body, world, hips, chain[:-1])
    turned = turned_toward(world[:, shoulder], body.offsets[arm], clamp_reach(wrist, socket, length) - root, SHOULDER_LIMIT)
    return turned, root + rotate(turned, body.offsets[arm]), length


def _meet_hand(body: Skeleton, world: Array, hips: Array, side: str, wrist: Array, rotation: Array) -> None:
    """Bends an arm in `world` so that the wrist is at `wrist`, the shoulder following where the arm is too short."""
    arm, forearm, hand = (body.index(f"{side}{name}") for name in ("Arm", "ForeArm", "Hand"))
    turned, socket, _ = _followed(body, world, hips, side, wrist)
    world[:, body.parents[arm]] = turned
    _bend_limb(body, world, (arm, forearm, hand), socket, wrist, -FORWARD)
    world[:, hand] = rotation


def _meet_ankle(body: Skeleton, world: Array, hips: Array, side: str, ankle: Array) -> None:
    """Bends a leg in `world` so that the ankle is at `ankle`. Where the leg is too short for that, the heel comes up over toes that stay where
    they are, instead of the whole foot being drawn away."""
    joints = body.index(f"{side}UpLeg"), body.index(f"{side}Leg"), body.index(f"{side}Foot")
    socket = carried(body, world, hips, body.chain("Hips", f"{side}UpLeg"))
    if f"{side}Toe" in body:
        foot, offset = joints[2], body.offsets[body.index(f"{side}Toe")]
        leg = float(np.linalg.norm(body.offsets[list(joints[1:])], axis=-1).sum()) * REACH
        toe = ankle + rotate(world[:, foot], offset)
        lifted = two_bone(socket, toe, leg, float(np.linalg.norm(offset)), ankle - socket)
        short = np.linalg.norm(ankle - socket, axis=-1) > leg
        ankle = np.where(short[:, None], lifted, ankle)
        world[short, foot] = turned_toward(world[short, foot], offset, (toe - ankle)[short], HEEL_LIMIT)
    _bend_limb(body, world, joints, socket, ankle, FORWARD)
    _make_hinge(body, world, joints, socket, ankle)


def _make_hinge(body: Skeleton, world: Array, joints: tuple[int, int, int], socket: Array, ankle: Array) -> None:
    """Turns a bent leg in `world` about its bones so that the knee bends forward and does nothing else.

    Thigh and shin are predicted each by itself: where they do not agree, on bodies unlike those that trained, shins would twist at the knee.
    """
    thigh, shin, foot = joints
    bone = rotate(world[:, thigh], body.offsets[shin])
    axis, out = normalize(bone), across(bone, ankle - socket)
    forward = across(rotate(world[:, thigh], FORWARD), bone)
    turn = np.arctan2(np.sum(np.cross(forward, out) * axis, axis=-1, keepdims=True), np.sum(forward * out, axis=-1, keepdims=True))
    world[:, thigh] = multiply(quat_from_rotvec(turn * axis), world[:, thigh])
    world[:, shin] = aim(world[:, thigh], body.offsets[foot], ankle - socket - bone)


def _bend_limb(body: Skeleton, world: Array, joints: tuple[int, int, int], socket: Array, target: Array, bend: Array) -> None:
    """Two-bone IK on the joints (upper, lower, end), bent as predicted in `world` and, where that is straight, toward `bend` (upper's frame)."""
    upper_joint, lower_joint, end_joint = joints
    upper, lower = (float(np.linalg.norm(body.offsets[joint])) for joint in (lower_joint, end_joint))
    target = clamp_reach(socket, target, upper + lower)
    middle = rotate(world[:, upper_joint], body.offsets[lower_joint])
    end = middle + rotate(world[:, lower_joint], body.offsets[end_joint])
    pole = across(middle, end) + np.float32(0.03 * upper) * rotate(world[:, upper_joint], bend)
    joint = two_bone(socket, target, upper, lower, pole)
    world[:, upper_joint] = aim(world[:, upper_joint], body.offsets[lower_joint], joint - socket)
    world[:, lower_joint] = aim(world[:, lower_joint], body.offsets[end_joint], target - joint)
