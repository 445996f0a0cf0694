"""Controllers that sit otherwise than was thought: wrists that are carried along at a constant place beside the true ones, turned."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..motion.mirror import mirror_positions, mirror_rotations
from ..motion.rotations import Array, inverse, multiply, quat_from_rotvec, rotate, rotvec_from_quat
from .devices import Controller
from .take import LEFT, RIGHT, Take


@dataclass(frozen=True)
class Slip:
    """Where the left wrist is thought to be, seen from where it is: `offset` [3] metres, `turn` [3] a rotation vector, radians, both in the wrist's
    own frame. The right hand has the mirror image."""

    offset: Array
    turn: Array

    def undone(self) -> Slip:
        """The slip that takes this one back."""
        back = inverse(quat_from_rotvec(self.turn))
        return Slip(-rotate(back, self.offset), -self.turn)


def slipped(take: Take, slip: Slip) -> Take:
    """A take of joint poses with its wrists carried along at a slip."""
    offset, turn = np.asarray(slip.offset, np.float32), quat_from_rotvec(np.asarray(slip.turn, np.float32))
    positions, rotations = take.positions.copy(), take.rotations.copy()
    for hand, place, tilt in ((LEFT, offset, turn), (RIGHT, mirror_positions(offset), mirror_rotations(turn))):
        positions[:, hand] += rotate(take.rotations[:, hand], place)
        rotations[:, hand] = multiply(take.rotations[:, hand], tilt)
    return replace(take, positions=positions, rotations=rotations)


def mistaken(held: Controller, thought: Controller) -> Slip:
    """The slip of a recording with `held` controllers that is calibrated as one with other controllers."""
    to_wrist = inverse(held.wrist_rotation())
    offset = rotate(to_wrist, np.subtract(thought.wrist, held.wrist))
    return Slip(offset, rotvec_from_quat(multiply(to_wrist, thought.wrist_rotation())))
