"""Foot contacts: which foot joints rest on the floor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .rotations import Array
from .skeleton import Skeleton

CONTACT_JOINTS = ("LeftFoot", "LeftToe", "RightFoot", "RightToe")
CONTACT_HEIGHT = 0.04  # metres above the joint's own resting height
CONTACT_SPEED = 0.4  # metres per second, horizontal


def contact_labels(skeleton: Skeleton, positions: Array, rate: float, joints: Sequence[str] = CONTACT_JOINTS) -> np.ndarray:
    """Contacts bool [T, 4] of CONTACT_JOINTS, or of others, from world positions [T, J, 3] at a steady rate.

    In contact: less than CONTACT_HEIGHT above the joint's own 5th percentile height, and slower than CONTACT_SPEED over the floor.
    """
    feet = positions[:, skeleton.indices(list(joints))]
    low = feet[..., 2] < np.percentile(feet[..., 2], 5, axis=0) + CONTACT_HEIGHT
    velocity = np.gradient(feet[..., :2], axis=0) * rate if len(feet) > 1 else np.zeros_like(feet[..., :2])
    return low & (np.linalg.norm(velocity, axis=-1) < CONTACT_SPEED)
