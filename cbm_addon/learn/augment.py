"""What recordings have and clips have not: other bodies and tempi, heads that look around, hands that are lost, devices that sit askew, heights that
are misjudged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..features import Layout
from ..motion.motion import Motion
from ..motion.resample import frame_times, resample
from ..motion.rotations import Array, multiply, quat_from_yaw, rotate
from ..takes.gaps import fill
from ..takes.slip import Slip, slipped
from ..takes.take import HANDS, HEAD, Take

PROPORTION = 0.07  # the deviation of what legs, torso and arms each are of their length, as logarithm
TEMPO = 0.1  # and of the speed of the whole clip
HIPS = (-0.03, 0.09)  # head heights: where skeletons have their hips, over the joints of their legs
ARMS = ("Arm", "ForeArm", "Hand")
SLIP, TILT = 0.06, np.radians(8)  # metres per axis and radians per axis (deviations): how a controller sits otherwise than was thought
LOOK = np.radians(35)  # the deviation of the angles to which the head turns
STRAIGHT = 0.4  # how often it turns back to where the body looks
TURNING, RESTING = (0.4, 1.5), (0.2, 2.5)  # seconds that a turn takes, and the rest after it
NEVER = 0.1  # how often a hand is not tracked at all
SEEN = 4.0  # seconds, the mean of how long a hand is seen between two losses
LOST = (0.3, 6.0)  # seconds that a loss lasts


def vary(motion: Motion, seed: int) -> Motion:
    """The same performance by a body of other proportions, with its hips at another place in the same pelvis, at another tempo, sampled at the same rate.

    Hips, legs and the way over the ground grow by one factor, so that planted feet stay planted; torso and arms by factors of their own.
    """
    random = np.random.default_rng(seed)
    legs, torso, arms, tempo = np.exp(random.normal(size=4) * (PROPORTION, PROPORTION, PROPORTION, TEMPO)).astype(np.float32)
    names = motion.skeleton.names
    upper = set(motion.skeleton.chain("Hips", "Head")[1:]) | {i for i, name in enumerate(names) if name.endswith("Shoulder")}
    factors = np.array([arms if name.endswith(ARMS) else torso if i in upper else legs for i, name in enumerate(names)], np.float32)
    skeleton = replace(motion.skeleton, offsets=motion.skeleton.offsets * factors[:, None])
    offsets = None if motion.offsets is None else motion.offsets * factors[:, None]
    varied = replace(motion, skeleton=skeleton, root=motion.root * legs, times=motion.times / tempo, offsets=offsets)
    rise = random.uniform(*HIPS) * skeleton.height_above_toes("Head") + skeleton.offsets[skeleton.index("LeftUpLeg"), 2]
    return resample(move_hips(varied, rise), frame_times(varied.times[0], varied.times[-1], motion.rate))


def move_hips(motion: Motion, rise: float) -> Motion:
    """The same motion with its first joint, the hips, farther up in the same pelvis by `rise`, metres at rest; all other joints stay where they are."""
    up = np.array([0, 0, rise], np.float32)
    below = (motion.skeleton.parents == 0)[:, None]
    skeleton = replace(motion.skeleton, offsets=np.where(below, motion.skeleton.offsets - up, motion.skeleton.offsets))
    offsets = None if motion.offsets is None else np.where(below, motion.offsets - up, motion.offsets)
    return replace(motion, skeleton=skeleton, root=motion.root + rotate(motion.rotations[:, 0], up), offsets=offsets)


def roughen(take: Take, stature: float, seed: int) -> Take:
    """The same performance by somebody who looks around, with controllers that sit askew and hands that are lost now and then."""
    random = np.random.default_rng(seed)
    looking = look_around(take, random)
    return lose_hands(slipped(looking, draw_slip(random)), stature, random)


def draw_slip(random: np.random.Generator, share: float = 1.0) -> Slip:
    """How controllers of another kind, or held otherwise, may sit; `share` of the usual deviations."""
    offset, turn = (random.normal(scale=share * scale, size=3).astype(np.float32) for scale in (SLIP, TILT))
    return Slip(offset, turn)


def look_around(take: Take, random: np.random.Generator) -> Take:
    """A take whose head also turns to the sides and back, about the vertical through its joint: the body must not turn with it."""
    times, angles = [float(take.times[0])], [0.0]
    while times[-1] < take.times[-1]:
        aim = 0.0 if random.random() < STRAIGHT else random.normal(scale=LOOK)
        for angle, seconds in ((aim, random.uniform(*TURNING)), (aim, random.uniform(*RESTING))):
            times.append(times[-1] + seconds)
            angles.append(angle)
    key = np.clip(np.searchsorted(times, take.times, side="right") - 1, 0, len(times) - 2)
    start, end = np.array(times)[key], np.array(times)[key + 1]
    share = (take.times - start) / (end - start)
    share = share * share * (3 - 2 * share)
    yaw = np.array(angles)[key] * (1 - share) + np.array(angles)[key + 1] * share
    rotations = take.rotations.copy()
    rotations[:, HEAD] = multiply(quat_from_yaw(yaw).astype(np.float32), rotations[:, HEAD])
    return replace(take, rotations=rotations)


def lose_hands(take: Take, stature: float, random: np.random.Generator) -> Take:
    """A take whose hands are lost now and then, each by itself, and filled in as calibration fills a recording."""
    tracked = np.ones(take.tracked.shape, dtype=bool)
    for hand in HANDS:
        if random.random() < NEVER:
            tracked[:, hand] = False
        time = random.exponential(SEEN)
        while time < take.times[-1]:
            end = time + random.uniform(*LOST)
            tracked[(take.times >= time) & (take.times < end), hand] = False
            time = end + random.exponential(SEEN)
    positions, rotations = fill(take.times, take.positions, take.rotations, tracked, stature)
    return replace(take, positions=positions, rotations=rotations)


def misjudge_height(layout: Layout, features: Array, factors: Array) -> Array:
    """Features [N, O, layout.size] in units of a head height that is wrong by the factors [N]."""
    return np.where(layout.lengths, features * factors[:, None, None], features)
