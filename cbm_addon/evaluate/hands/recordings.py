"""Real finger motion to compare with: hand BVH files whose joints are named as in ManipNet."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...errors import InputError
from ...hands.hand import Hand, Side
from ...motion.bvh import read_bvh
from ...motion.motion import forward_kinematics
from ...motion.resample import frame_times, resample
from ...motion.rotations import Array, inverse, rotate

_JOINTS = [
    ["THUMB_CMC_AA", "THUMB_MCP_FE", "THUMB_IP_FE"],
    *([f"{finger}_MCP", f"{finger}_PIP_FE", f"{finger}_DIP_FE"] for finger in ("INDEX", "MIDDLE", "RING", "PINKY")),
]
SIDES: tuple[Side, ...] = ("left", "right")
_TIP = 0.85  # length of a last phalanx as a share of the one before, where a file does not say


def recorded_angles(path: Path, rate: float) -> Array:
    """Angles [T, 20] of a recorded hand at `rate` frames per second.

    Which side it is follows from where its fingers bend to: files of programs with left-handed axes hold mirrored hands.
    """
    motion = read_bvh(path)
    motion = resample(motion, frame_times(float(motion.times[0]), float(motion.times[-1] - motion.times[0]), rate))
    skeleton = motion.skeleton
    missing = [name for finger in _JOINTS for name in finger if name not in skeleton.names]
    if missing:
        raise InputError(path, f"has no joint {missing[0]}; hands with the joint names of ManipNet are read")
    joints = [[skeleton.names.index(name) for name in finger] for finger in _JOINTS]
    rest = np.tile(np.array([1, 0, 0, 0], np.float32), (1, len(skeleton.names), 1))
    poses = []
    for root, rotations in ((motion.root[:1] * 0, rest), (motion.root, motion.rotations)):
        world, positions = forward_kinematics(skeleton, root, rotations)
        chain = positions[:, np.array(joints)] - positions[:, :1, None]
        bones = skeleton.offsets[np.array(joints)[:, 2]]
        tips = chain[:, :, 2] + rotate(world[:, np.array(joints)[:, 2]], bones) * _TIP
        in_wrist = rotate(inverse(world[:, :1, None]), np.concatenate((chain, tips[:, :, None]), 2))
        poses.append(np.concatenate((in_wrist[:, :, :3].reshape(len(in_wrist), -1, 3), in_wrist[:, :, 3]), 1))
    hands = [Hand.from_rest(side, poses[0][0]) for side in SIDES]
    some = poses[1][:: max(1, len(poses[1]) // 10)]
    return max(hands, key=lambda hand: hand.angles_from_positions(some)[:, 4:].mean()).angles_from_positions(poses[1])
