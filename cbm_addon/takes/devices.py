"""Where the joints are, seen from the devices: constants of the hardware and of how it is worn and held.

All in the device's own frame, written in engine axes: +X to the wearer's left, -Y where the device points, +Z up. A controller's values
are those of the left hand; the right hand has their mirror image.

The headset's pose is the point between the eyes. The head joint of a skeleton is the base of the skull.

The controllers come in these conventions:

grip    The OpenXR grip pose: the origin is the centre of the fist, -Z of OpenXR runs along the handle toward the thumb, X is normal to the
        palm. In engine axes: -Y toward the thumb, +X out of the back of the left hand, +Z (about) toward the wrist.
raw     The pose that SteamVR gives: the origin is at the front of the controller, before the hand. Beat Saber's sabers are near it too.
touch   The same of Quest and Rift S controllers, whose origin and handle are elsewhere.

The first two are from the hand that SteamVR's skeletal input places on an Index controller, and the offset from its raw pose to its grip
pose; Vive wands have no published grip pose, and are taken to be held like these. The third is the grip pose in the render models that
SteamVR has of Quest controllers ("openxr_grip": 0.1019 m behind the raw origin, tilted by 20.6°). As a check, the point that moves least
while the hand turns (the wrist, drawn toward the elbow) lies 0.14-0.22 m behind the origin in recordings of raw poses.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..motion.mirror import mirror_positions, mirror_rotations
from ..motion.rotations import Array, inverse, multiply, quat_from_matrix, rotate
from ..motion.skeleton import STANDARD_BODY, STANDARD_STATURE
from .take import HEAD, LEFT, RIGHT

HEAD_JOINT_SHARE = STANDARD_BODY.height_above_toes() / STANDARD_STATURE
"""Standing height of the head joint as a share of stature."""

HEADSET_TO_HEAD = (0.0, 0.09, -0.07)
"""Metres from the point between the eyes to the head joint, for a stature of 1.75 m: behind and below.

In recordings of headsets the point that moves least while the head turns lies 0.05-0.10 m behind the eyes and, where people look up and
down, 0.04-0.09 m below.
"""

EYE_SHARE = HEAD_JOINT_SHARE - HEADSET_TO_HEAD[2] / STANDARD_STATURE
"""Standing eye height as a share of stature."""


@dataclass(frozen=True)
class Controller:
    """How a controller is held. The wrist's rotation is relative to the T-pose: the arm along +X, the palm down, the thumb to -Y.

    wrist  metres from the device's origin to the left wrist, in the device's frame
    tilt   radians between the handle and the normal of the hand in the plane of the palm: 0 is a hammer grip (the fingers point to -Z of
           the device), a quarter turn points the fingers along the handle
    """

    wrist: tuple[float, float, float]
    tilt: float

    def wrist_rotation(self) -> Array:
        """The left wrist's frame in the device's frame, a quaternion float64 [4]: its +X are the fingers, +Z the back of the hand, -Y the thumb."""
        s, c = np.sin(self.tilt), np.cos(self.tilt)
        fingers, toward_little_finger, back_of_hand = (0, -s, -c), (0, c, -s), (1, 0, 0)
        return quat_from_matrix(np.stack((fingers, toward_little_finger, back_of_hand), axis=-1).astype(np.float64))


GRIP = Controller(wrist=(0.033, 0.021, 0.059), tilt=np.radians(36.5))
RAW = Controller(wrist=(0.034, 0.165, 0.036), tilt=np.radians(52.0))
TOUCH = Controller(wrist=(0.026, 0.142, 0.046), tilt=np.radians(36.5 + 20.6))

CONTROLLERS = {"quest2": GRIP, "quest3": GRIP, "rift-s": GRIP, "grip": GRIP, "index": RAW, "vive": RAW, "touch-steamvr": TOUCH, "saber": RAW}
"""By name: headsets whose own runtimes give grip poses, the grip pose of anything (OpenXR), and what SteamVR gives as raw poses."""
DEFAULT_DEVICE = "quest2"
"""Assumed where a take does not say."""
NO_DEVICE = "none"
"""Instead of one: the poses are those of the joints."""


@dataclass(frozen=True)
class Mounting:
    """The joints of head, left and right wrist in the frames of their devices: offsets float64 [3, 3], rotations float64 [3, 4]."""

    offsets: Array
    rotations: Array

    def joints(self, positions: Array, rotations: Array) -> tuple[Array, Array]:
        """Joint poses from device poses [..., 3, 3] and [..., 3, 4]."""
        return positions + rotate(rotations, self.offsets), multiply(rotations, self.rotations)

    def devices(self, positions: Array, rotations: Array) -> tuple[Array, Array]:
        """The inverse: device poses from joint poses."""
        rotations = multiply(rotations, inverse(self.rotations))
        return positions - rotate(rotations, self.offsets), rotations


def mounting(controller: Controller, head_offset: tuple[float, float, float]) -> Mounting:
    """A headset with the head joint at `head_offset` (metres, in its frame) and a pair of controllers."""
    wrist, rotation = np.array(controller.wrist), controller.wrist_rotation()
    offsets, rotations = np.zeros((3, 3)), np.zeros((3, 4))
    offsets[HEAD], rotations[HEAD] = head_offset, (1, 0, 0, 0)
    offsets[LEFT], rotations[LEFT] = wrist, rotation
    offsets[RIGHT], rotations[RIGHT] = mirror_positions(wrist), mirror_rotations(rotation)
    return Mounting(offsets, rotations)


def head_offset(stature: float) -> tuple[float, float, float]:
    """HEADSET_TO_HEAD for a person of that stature, metres."""
    x, y, z = (float(value) * stature / STANDARD_STATURE for value in HEADSET_TO_HEAD)
    return x, y, z


def held(controller: Controller, wrist: tuple[float, float, float] | None) -> Controller:
    """The controller with another place for the left wrist, if one is given."""
    return replace(controller, wrist=wrist) if wrist else controller
