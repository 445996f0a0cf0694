"""What stages 1 and 2 say of a take, before it is put on a body."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ..features import LOWER_JOINTS
from ..motion.resample import brackets, lerp_samples, slerp_samples
from ..motion.rotations import Array
from .miscalibration import NONE, Miscalibration


@dataclass(frozen=True)
class Performance:
    """A body-free performance over T frames. Lengths are in standing head heights (1 = the head joint of a standing person above the floor).

    times             float64 [T], seconds of the take
    lower_positions   float32 [T, 9, 3] world positions of LOWER_JOINTS
    lower_velocities  float32 [T, 9, 3] their velocities per second, as the sequences have them
    lower_rotations   float32 [T, 9, 4] world rotations of LOWER_JOINTS
    upper_rotations   float32 [T, 10, 4] world rotations of UPPER_JOINTS
    contacts          float32 [T, 4] probabilities of contact of CONTACT_JOINTS
    head_height       metres: the unit
    causal            nothing at a time was computed from later samples
    manner            float32 [9, 3] offsets of LOWER_JOINTS in the frame of the body (manner.py), which `lower_positions` are without
    miscalibration    what was wrong with the calibration of the take; the networks saw it corrected
    """

    times: np.ndarray
    lower_positions: Array
    lower_velocities: Array
    lower_rotations: Array
    upper_rotations: Array
    contacts: Array
    head_height: float
    causal: bool
    manner: Array = field(default_factory=lambda: np.zeros((len(LOWER_JOINTS), 3), np.float32))
    miscalibration: Miscalibration = NONE

    def measured_in(self, head_height: float) -> Performance:
        """The same in units of another head height, metres."""
        share = np.float32(self.head_height / head_height)
        return replace(
            self,
            lower_positions=self.lower_positions * share,
            lower_velocities=self.lower_velocities * share,
            head_height=head_height,
            manner=self.manner * share,
        )

    def at(self, times: np.ndarray) -> Performance:
        """The same at other times; a causal performance holds the share of the frame before (it must not look ahead)."""
        if self.causal:
            before, share = brackets(self.times, times)
            frames = np.where(share >= 1, before + 1, before)
            since = (times - self.times[frames])[:, None, None].astype(np.float32)
            moved = {"lower_positions": self.lower_positions[frames] + self.lower_velocities[frames] * since}
            held = {name: getattr(self, name)[frames] for name in ("lower_velocities", "lower_rotations", "upper_rotations", "contacts")}
            return replace(self, times=times, **moved, **held)
        paths = {name: lerp_samples(self.times, getattr(self, name), times) for name in ("lower_positions", "lower_velocities", "contacts")}
        turns = {name: slerp_samples(self.times, getattr(self, name), times) for name in ("lower_rotations", "upper_rotations")}
        return replace(self, times=times, **paths, **turns)
