"""What recordings do to takes: the same clip, tracked badly in one way at a time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..motion.motion import Motion
from ..motion.skeleton import Skeleton
from ..takes.calibrate import CalibrationOptions, calibrate
from ..takes.synthesize import synthesize
from ..takes.take import LEFT, Take

DISTURBANCES = ("offsets", "noise", "height", "lost_hand")

NOISE = (10.0, 1.0)  # millimetres, degrees
WRONG_HEIGHT = 1.1  # the believed stature as a share of the true one
LOST = 5.0  # seconds


def disturbed(name: str, truth: Motion, body: Skeleton) -> tuple[Take, Skeleton]:
    """The take of a clip under one of DISTURBANCES, and the body that it is solved for.

    offsets    recorded with Index controllers, calibrated as Quest 2 ones
    noise      white noise of NOISE on every pose
    height     the performer is believed to be a tenth taller than they are
    lost_hand  the left hand is not tracked for LOST seconds in the middle (for half of a shorter clip)
    """
    if name == "offsets":
        return calibrate(synthesize(truth, device="index"), CalibrationOptions(device="quest2")).take, body
    if name == "noise":
        return synthesize(truth, noise=NOISE), body
    if name == "height":
        return synthesize(truth), body.scaled(WRONG_HEIGHT)
    take = synthesize(truth)
    middle, span = take.times[-1] / 2, min(LOST, take.times[-1] / 2)
    tracked = take.tracked.copy()
    tracked[abs(take.times - middle) < span / 2, LEFT] = False
    positions, rotations = (np.where(tracked[..., None], values, np.nan) for values in (take.positions, take.rotations))
    return calibrate(replace(take, tracked=tracked, positions=positions, rotations=rotations)).take, body
