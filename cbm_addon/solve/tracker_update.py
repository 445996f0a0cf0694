"""Where the trackers say that the lower body is: a measurement update of what was predicted.

The networks say where the hips are, and how all above them is turned. On a body whose bones are known both together say where head and wrists are, and
the trackers know better. What is missed there tells what is wrong with the hips, most of all of performers and bodies that never trained. It is the update
of a Kalman filter with constant gains, chosen on validation clips; on clips of another data set the same gains come out best.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..features import LOWER_JOINTS
from ..motion.rotations import Array
from ..motion.skeleton import Skeleton
from .manner import out_of_body
from .performance import Performance
from .spine import carried, with_neck

WRISTS = 0.2  # the share of what each wrist is missed by that the body moves over the floor
HEAD = 0.6  # the share of the height that the head is missed by, that the hips move up or down
LEAN = 0.7  # and the share of it that the body moves back, where the bones carry the head too high: the spine leans farther, and forward where too low
FARTHEST = 0.1  # head heights: what misses by more is no error of the hips, but another body's arms, or a wrong tracker


def updated(performance: Performance, body: Skeleton, world: Array, unit: np.float32, targets: dict[str, tuple[Array, Array]]) -> Performance:
    """The performance [T] with its lower joints moved so that the body, turned as `world` [T, J, 4] says, carries head and wrists nearer to their trackers.

    unit     metres in a head height
    targets  by device the positions [T, 3], metres, and rotations [T, 4] of "head", "left" and "right"
    """
    hips = performance.lower_positions[:, LOWER_JOINTS.index("Hips")] * unit
    world = with_neck(body, world, targets["head"][1])

    def missed(device: str, joint: str) -> Array:
        miss = (targets[device][0] - carried(body, world, hips, body.chain("Hips", joint))) / unit
        return miss * np.minimum(1, FARTHEST / np.maximum(np.linalg.norm(miss, axis=-1, keepdims=True), 1e-9)).astype(np.float32)

    up = missed("head", "Head")[:, 2]
    wrists = missed("left", "LeftHand") + missed("right", "RightHand")
    back = np.zeros((len(hips), 1, 3), np.float32)
    back[:, 0, 1] = -LEAN * up
    moved = performance.lower_positions + out_of_body(performance.lower_positions, back)
    moved[..., :2] += np.float32(WRISTS) * wrists[:, None, :2]
    moved[:, LOWER_JOINTS.index("Hips"), 2] += np.float32(HEAD) * up
    return replace(performance, lower_positions=moved)
