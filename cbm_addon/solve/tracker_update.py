"""Where the trackers say that the lower body is: a measurement update of what was predicted.

The networks say where the hips are, and how all above them is turned. On a body whose bones are known both together say where head and wrists are, and
the trackers know better. What is missed there tells what is wrong with the hips, most of all on bodies with other bones than those that trained. It is the
update of a Kalman filter with constant gains, chosen on validation clips (docs/model.md says for whom they help, and for whom not).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..features import LOWER_JOINTS
from ..motion.rotations import Array, normalize
from ..motion.skeleton import Skeleton
from .manner import out_of_body
from .performance import Performance
from .spine import carried, with_neck

HIPS = LOWER_JOINTS.index("Hips")
WRISTS = 0.2  # the share of what each wrist is missed by that the body moves over the floor
HEAD = 0.6  # causally, the share of the height that the head is missed by, that the hips move up or down; looking ahead they take all of it
LEAN = 0.35  # the share of it that the body moves back, where the bones carry the head too high: the spine leans farther, and forward where too low
UPRIGHT = 2.0  # a spine that leans less than 60 degrees counts in full, one that lies not at all: its hips are on the floor
SEAT = 0.06  # head heights over the floor: hips that sit there are moved no lower
FAR_WRIST, FAR_HEAD = 0.15, 0.05  # head heights: of such a miss half counts, and ever less of greater ones; they are other arms, or a wrong calibration


def updated(performance: Performance, body: Skeleton, world: Array, unit: np.float32, targets: dict[str, tuple[Array, Array]]) -> Performance:
    """The performance [T] with its lower joints moved so that the body, turned as `world` [T, J, 4] says, carries head and wrists nearer to their trackers.

    unit     metres in a head height
    targets  by device the positions [T, 3], metres, and rotations [T, 4] of "head", "left" and "right", as they are without the take's miscalibration
    """
    bones = body.scaled(performance.miscalibration.height)  # the performer's, where the body has a height that was believed wrongly
    hips = performance.lower_positions[:, HIPS] * unit
    world = with_neck(body, world, targets["head"][1])

    def reached(joint: str) -> Array:
        return carried(bones, world, hips, bones.chain("Hips", joint))

    spine = normalize(reached("Head") - hips)
    upright = np.clip(UPRIGHT * spine[:, 2:], 0, 1)

    def missed(device: str, joint: str) -> Array:
        return upright * (targets[device][0] - reached(joint)) / unit

    up = missed("head", "Head")[:, 2:]
    sure = doubted(up, FAR_HEAD)
    # Looking ahead, the performer's height was asked about (miscalibration.py), so that what is left is the bones of another body.
    rise = HEAD * sure if performance.causal else up
    wrists = doubted(missed("left", "LeftHand"), FAR_WRIST) + doubted(missed("right", "RightHand"), FAR_WRIST)
    back = np.zeros((len(hips), 1, 3), np.float32)
    back[:, 0, 1:2] = -LEAN * sure
    moved = performance.lower_positions + out_of_body(performance.lower_positions, back)
    moved[..., :2] += np.float32(WRISTS) * wrists[:, None, :2]
    height = performance.lower_positions[:, HIPS, 2:]
    moved[:, HIPS, 2:] = np.maximum(height + rise, np.minimum(height, SEAT))
    return replace(performance, lower_positions=moved)


def doubted(misses: Array, far: float) -> Array:
    """Misses [T, N] weighted by a Cauchy kernel."""
    return misses / (1 + np.sum(np.square(misses / np.float32(far)), axis=-1, keepdims=True))
