"""The moment of a take in which somebody stands still with both arms stretched to the sides, if there is one."""

from __future__ import annotations

import numpy as np

from ..motion.rotations import inverse, quat_from_yaw, rotate, yaw_from_quat
from .take import HANDS, HEAD, LEFT, RIGHT, Take

SPAN = 0.9  # metres from hand to hand, at least
SIDEWAYS = 0.95  # of that, across the way that the head looks
LEVEL = 0.15  # metres from hand to hand, upward
UNDER_HEAD = (0.05, 0.45)  # metres
STILL = (0.15, 0.3)  # metres per second of the head and of a hand, at most
SHORTEST = 0.4  # seconds


def t_pose(take: Take) -> slice | None:
    """The samples of the longest T-pose; None if there is none. Works on poses of devices as on poses of joints."""
    facing = quat_from_yaw(yaw_from_quat(take.rotations[:, HEAD].astype(np.float64)))
    from_head = rotate(inverse(facing)[:, None], (take.positions[:, HANDS] - take.positions[:, [HEAD]]).astype(np.float64))
    across = from_head[:, LEFT - 1] - from_head[:, RIGHT - 1]
    span, below = np.linalg.norm(across, axis=-1), -from_head[..., 2]
    speed = np.linalg.norm(np.gradient(take.positions.astype(np.float64), take.times, axis=0), axis=-1)
    posed = (span > SPAN) & (across[:, 0] > SIDEWAYS * span) & (np.abs(across[:, 2]) < LEVEL)
    posed &= ((below > UNDER_HEAD[0]) & (below < UNDER_HEAD[1])).all(axis=1)
    posed &= (speed[:, HEAD] < STILL[0]) & (speed[:, HANDS] < STILL[1]).all(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], posed, [False])).astype(np.int8)))
    stretches = [slice(int(start), int(end)) for start, end in edges.reshape(-1, 2)]
    longest = max(stretches, key=lambda rows: take.times[rows.stop - 1] - take.times[rows.start], default=None)
    return longest if longest and take.times[longest.stop - 1] - take.times[longest.start] >= SHORTEST else None
