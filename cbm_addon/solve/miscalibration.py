"""What a calibration got wrong, told from a whole take: controllers that sit otherwise than was thought, a height that was misjudged.

A window of a second hardly tells it; the mean over a take does. Only the networks see the take corrected. Head and wrists are brought to the trackers
as they were calibrated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..features import STANDARD_PROPORTIONS, tracker_frames
from ..motion.rotations import Array
from ..takes.slip import Slip, slipped
from ..takes.take import HANDS, Take
from .models import ModeNetworks

WINDOWS = 600  # are seen of a take, evenly spread
OFFSET, HEIGHT = (0.045, 0.07), (0.025, 0.05)
"""Metres, and logarithm of the height: up to the first nothing is corrected, from the second on all of it. Of nine in ten takes that are exact less
than the first is told. Turns are corrected with the offset: alone they may as well be how somebody holds their hands."""
POSTURE = 0.18  # logarithm of the height: who is lower than that sits, kneels or lies, and is no smaller
WORTH_A_WORD = 0.08, 0.08  # metres of the controllers' offset, share of the height


@dataclass(frozen=True)
class Miscalibration:
    """slip: how the controllers sit, and `height`: the performer's true head height as a share of the one that was believed."""

    slip: Slip
    height: float

    def corrected(self, take: Take) -> Take:
        """The take as it would be with the controllers where they are."""
        return slipped(take, self.slip.undone())

    def warnings(self) -> list[str]:
        """What an animator should look at, a sentence each."""
        found = []
        if (offset := float(np.linalg.norm(self.slip.offset))) > WORTH_A_WORD[0]:
            found.append(f"the wrists seem to be {100 * offset:.0f} cm from where the calibration puts them; see whether --device names the controllers")
        if abs(np.log(self.height)) > WORTH_A_WORD[1]:
            found.append(f"the performer seems to be {self.height:.2f} times as tall as is believed; see whether --eye-height is theirs")
        return found


NONE = Miscalibration(Slip(np.zeros(3, np.float32), np.zeros(3, np.float32)), 1.0)


def find_miscalibration(take: Take, head_height: float, networks: ModeNetworks) -> Miscalibration:
    """The miscalibration of a calibrated take sampled at the engine's rate; NONE where the networks do not tell it, or never both hands were tracked.

    They are asked for the standard body, whatever moves: bones of a rig say nothing of how the performer was measured.
    """
    frames = np.flatnonzero(take.tracked[:, HANDS].all(axis=-1))
    if not networks.tells_miscalibration or not len(frames):
        return NONE
    frames = frames[np.unique(np.linspace(0, len(frames) - 1, WINDOWS).round().astype(int))]
    trackers, anchors = tracker_frames(take, head_height)
    windows = trackers.seen_from(anchors[frames], frames[:, None] + np.array(networks.mode.window))
    told = networks.miscalibration(networks.estimate(windows, STANDARD_PROPORTIONS).features).mean(axis=0)
    offset, turn, height = told[:3] * np.float32(head_height), told[3:6], told[6]
    slips, grown = _sure(offset, OFFSET), _sure(height, HEIGHT) * (abs(height) < POSTURE)
    return Miscalibration(Slip(slips * offset, slips * turn), float(np.exp(grown * height)))


def _sure(told: Array, limits: tuple[float, float]) -> np.float32:
    """0 to 1: how far the size of what is told is above what is told of takes that are exact."""
    return np.float32(np.clip((np.linalg.norm(told) - limits[0]) / (limits[1] - limits[0]), 0, 1))
