"""Any motion capture on any rig: the skeleton of the motion is recognised like a rig, and its motion moves over joint by joint.

Where two rest poses differ (T, A, hanging), limbs are compared in the T-pose that both are brought to (rigs/body.py).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError
from ..motion.motion import Motion, local_rotations
from ..motion.rotations import IDENTITY, Array, continuous, inverse, matrix_from_quat, multiply, quat_between, rotate
from ..motion.skeleton import Skeleton
from ..motion.transfer import transfer
from .body import PLAUSIBLE_SOLE, RigBody, rig_body
from .recognize import recognized
from .rig import FINGER_JOINTS, SIDES, Bones, Rig

POSES_TRIED = 20  # of a motion without a sound rest pose
STANDS = 2  # percentile of the height of the lower ankle that is taken for standing
SAME = 0.01  # share of the legs' length by which a height may be off
FEET, THIGHS = ("LeftFoot", "RightFoot"), ("LeftUpLeg", "RightUpLeg")


def source_rig(name: str, motion: Motion) -> tuple[Rig, Motion]:
    """The skeleton of a motion as a rig, and the motion with respect to that rig's rest pose.

    Some files have no rest pose worth the name: all bones lie along one axis. Of such a motion the upright pose with the straightest limbs
    serves as one. InputError if there is none, or if the skeleton is no body.
    """
    try:
        return recognized(_bones(name, motion.skeleton)), motion
    except InputError as error:
        refusal = error
    found = []
    for frame in np.unique(np.linspace(0, len(motion) - 1, POSES_TRIED).astype(int)):
        rested = _with_rest_pose(motion, frame)
        try:
            rig = recognized(_bones(name, rested.skeleton))
        except InputError:
            continue
        found.append((rig, rested))
    if not found:
        raise refusal
    return max(found, key=lambda candidate: _straightness(candidate[0]))


@dataclass(frozen=True)
class Retargeted:
    """A motion on another body, in world units.

    solved  the target's body, with those fingers that both have
    motion  its joints turned as those of the source
    ankles  side -> float32 [T, 3]: where the source's ankles are, on the scale of the target. Feet that stand still there do so here, which
            turned joints alone do not give to legs of other proportions
    """

    solved: RigBody
    motion: Motion
    ankles: dict[str, Array]


def retarget(motion: Motion, source: Rig, target: Rig) -> Retargeted:
    """The motion of a source on a target, both as `source_rig` gives them.

    The way through the world is scaled about its origin, as long legs make long steps. A target that stands on its origin at rest is put
    on the floor z = 0 when the source stands.
    """
    played = rig_body(source, FINGER_JOINTS)
    solved = rig_body(target, source.mapping.fingers)
    performed = _of_joints(motion, source, played)
    scale = np.float32(_leg(solved.body) / _leg(played.body))
    moved = transfer(performed, solved.body)
    lift = np.zeros(3, np.float32)
    standing = solved.body.height_above_toes("LeftFoot") + solved.sole
    at_rest = min(target.head(target.mapping.joints[foot])[2] for foot in FEET) - target.object_matrix[2, 3]
    if abs(at_rest - standing) < SAME * _leg(solved.body):
        lift[2] = standing - scale * _ankle_height(performed)
    # Hip joints, not the hips' own, are brought along: how far above them that one is differs from rig to rig.
    root = moved.root + scale * _middle(performed, THIGHS) + lift - _middle(moved, THIGHS)
    ankles = performed.positions()[:, performed.skeleton.indices(list(FEET))] * scale + lift
    return Retargeted(solved, replace(moved, root=root), dict(zip(SIDES, ankles.swapaxes(0, 1), strict=True)))


def _middle(motion: Motion, joints: tuple[str, ...]) -> Array:
    """The point [T, 3] between some joints."""
    return motion.positions()[:, motion.skeleton.indices(list(joints))].mean(axis=1)


def _of_joints(motion: Motion, source: Rig, played: RigBody) -> Motion:
    """The motion of the joints that the source's bones play, on their own body in the T-pose."""
    bones = source.mapping.joints | source.mapping.fingers
    joints = motion.skeleton.indices([bones[joint] for joint in played.body.names])
    world, positions = motion.forward()
    turned = multiply(world[:, joints], inverse(played.alignment).astype(world.dtype))
    return Motion(played.body, motion.times, positions[:, joints[0]], continuous(local_rotations(played.body, turned)))


def _leg(body: Skeleton) -> float:
    return float(np.linalg.norm(body.offsets[body.indices(["LeftLeg", "LeftFoot", "RightLeg", "RightFoot"])], axis=-1).sum())


def _ankle_height(motion: Motion) -> float:
    """Height of the ankles above the floor z = 0 while the body stands, as far as that is plausible."""
    ankles = motion.positions()[:, motion.skeleton.indices(list(FEET)), 2].min(axis=1)
    return float(np.clip(np.percentile(ankles, STANDS), 0, PLAUSIBLE_SOLE * motion.skeleton.height_above_toes()))


def _with_rest_pose(motion: Motion, frame: int) -> Motion:
    """The same motion, its skeleton at rest as it is at a frame."""
    skeleton = motion.skeleton
    world, positions = (values[frame] for values in motion.forward())
    above = np.where((skeleton.parents >= 0)[:, None], world[skeleton.parents], IDENTITY)
    offsets = rotate(above, skeleton.offsets)
    offsets[skeleton.parents < 0] = positions[skeleton.parents < 0]
    rested = replace(skeleton, offsets=offsets, tips=rotate(world, skeleton.tips))
    rotations = multiply(multiply(above, motion.rotations), inverse(world))
    return replace(motion, skeleton=rested, rotations=rotations, offsets=None if motion.offsets is None else rotate(above, motion.offsets))


def _straightness(rig: Rig) -> float:
    """How straight the limbs are at rest, 1 for all of them."""
    limbs = [
        [rig.head(rig.mapping.joints[side + name]) for name in names] for side in SIDES for names in (("Arm", "ForeArm", "Hand"), ("UpLeg", "Leg", "Foot"))
    ]
    return float(np.mean([np.linalg.norm(c - a) / (np.linalg.norm(b - a) + np.linalg.norm(c - b)) for a, b, c in limbs]))


def _bones(name: str, skeleton: Skeleton) -> Bones:
    """A skeleton as an armature in the world; bones of leaf joints point to their tips."""
    count = len(skeleton)
    rest = np.tile(np.eye(4), (count, 1, 1))
    rest[:, :3, 3] = skeleton.rest_positions()
    tips = np.nan_to_num(skeleton.tips.astype(np.float64))
    rest[:, :3, :3] = matrix_from_quat(quat_between(np.array([0.0, 1, 0]), tips))
    return Bones(
        name=name,
        bones=skeleton.names,
        parents=skeleton.parents,
        rest=rest,
        lengths=np.linalg.norm(tips, axis=-1),
        inherits_rotation=np.ones(count, dtype=bool),
        local_location=np.ones(count, dtype=bool),
        constrained=np.zeros(count, dtype=bool),
        object_matrix=np.eye(4),
    )
