"""What stages 1 and 2 say of a take, before it is put on a body."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ..features import LOWER_JOINTS
from ..motion.resample import brackets, lerp_samples, slerp_samples
from ..motion.rotations import Array


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
            return Performance(
                times,
                self.lower_positions[frames] + self.lower_velocities[frames] * (times - self.times[frames])[:, None, None].astype(np.float32),
                self.lower_velocities[frames], self.lower_rotations[frames], self.upper_rotations[frames], self.contacts[frames],
                self.head_height, True, self.manner,
            )  # fmt: skip
        return Performance(
            times,
            lerp_samples(self.times, self.lower_positions, times),
            lerp_samples(self.times, self.lower_velocities, times),
            slerp_samples(self.times, self.lower_rotations, times),
            slerp_samples(self.times, self.upper_rotations, times),
            lerp_samples(self.times, self.contacts, times),
            self.head_height, False, self.manner,
        )  # fmt: skip
