"""Performances of motions that are known."""

from __future__ import annotations

import numpy as np

from cbm_addon.features import LOWER_JOINTS, RATE, UPPER_JOINTS
from cbm_addon.motion.contacts import contact_labels
from cbm_addon.motion.motion import Motion
from cbm_addon.solve.performance import Performance


def true_performance(motion: Motion, causal: bool = False) -> Performance:
    """What perfect networks would say of a motion."""
    height = motion.skeleton.height_above_toes()
    rotations, positions = motion.forward()
    lower, upper = motion.skeleton.indices(list(LOWER_JOINTS)), motion.skeleton.indices(list(UPPER_JOINTS))
    normal = positions[:, lower] / np.float32(height)
    velocities = np.diff(normal, axis=0, prepend=normal[:1]) * np.float32(RATE)
    contacts = contact_labels(motion.skeleton, positions, RATE).astype(np.float32)
    return Performance(motion.times, normal, velocities, rotations[:, lower], rotations[:, upper], contacts, height, causal)
