"""What a model has to beat: legs carried along under estimated hips, and its own decoder fed with the codes of other frames."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from ..features import LOWER_JOINTS, RATE, UPPER_JOINTS
from ..motion.contacts import CONTACT_JOINTS
from ..motion.rotations import Array, quat_from_yaw, rotate
from ..motion.skeleton import Skeleton
from ..solve.models import Estimate, Model, ModeNetworks
from ..solve.perform import at_rate
from ..solve.performance import Performance
from ..takes.take import HEAD, LEFT, RIGHT, Take

HEADING_SECONDS = 0.3  # over which the heading is smoothed
FORWARD = np.array([0, -1, 0], np.float32)


def carry_legs(take: Take, body: Skeleton, causal: bool) -> Performance:
    """Nothing is learned: the body at rest hangs below the head, turned to where head and hands point on average.

    The legs are stiff and the feet never planted; where the head is low, stage 3 bends the knees to keep the feet above the floor.
    """
    take = at_rate(take)
    head_height = body.height_above_toes("Head")
    facing = _smoothed(_facing(take), causal)
    heading = quat_from_yaw(np.arctan2(facing[:, 0], -facing[:, 1]))
    rest = body.rest_positions()
    offsets = rest[body.indices(LOWER_JOINTS)] - rest[body.index("Head")]
    positions = (take.positions[:, HEAD, None] + rotate(heading[:, None], offsets)) / np.float32(head_height)
    count = len(take.times)
    return Performance(
        times=take.times,
        lower_positions=positions.astype(np.float32),
        lower_velocities=np.diff(positions, axis=0, prepend=positions[:1]).astype(np.float32) * np.float32(RATE),
        lower_rotations=np.repeat(heading[:, None], len(LOWER_JOINTS), axis=1).astype(np.float32),
        upper_rotations=np.repeat(heading[:, None], len(UPPER_JOINTS), axis=1).astype(np.float32),
        contacts=np.zeros((count, len(CONTACT_JOINTS)), np.float32),
        head_height=head_height,
        causal=causal,
    )


def _facing(take: Take) -> Array:
    """Where the body faces, [T, 3], metres: a metre along the head's forward, and as far across the line between the hands as they are apart."""
    ahead = rotate(take.rotations[:, HEAD], FORWARD)
    across = take.positions[:, LEFT] - take.positions[:, RIGHT]
    return ahead + np.stack((across[:, 1], -across[:, 0], np.zeros(len(across), across.dtype)), axis=-1)


def _smoothed(values: Array, causal: bool) -> Array:
    """Values [T, N] averaged with a Gaussian around each frame or, causally, with weights that fade into the past."""
    span = round(3 * HEADING_SECONDS * RATE)
    age = np.arange(-span, span + 1) / (HEADING_SECONDS * RATE)
    weights = np.where(age >= 0, np.exp(-np.abs(age)), 0) if causal else np.exp(-0.5 * age**2)
    padded = np.pad(values, ((span, span), (0, 0)), mode="edge")
    return np.stack([np.convolve(column, weights / weights.sum(), mode="valid") for column in padded.T], axis=-1)


@dataclass(frozen=True)
class ShuffledNetworks(ModeNetworks):
    """Networks whose codes of each batch of anchors are dealt to other anchors of the batch: all the rest stays as it is."""

    seed: int

    def estimate(self, windows: Array, proportions: Array) -> Estimate:
        own = super().estimate(windows, proportions)
        return replace(own, logits=own.logits[np.random.default_rng(self.seed).permutation(len(windows))])


def shuffle_codes(model: Model, seed: int) -> Model:
    """The model with codes that belong to other frames. If it does as well as the model, the codes say nothing."""
    values = {name: {field.name: getattr(networks, field.name) for field in fields(ModeNetworks)} for name, networks in model.modes.items()}
    return replace(model, modes={name: ShuffledNetworks(**given, seed=seed) for name, given in values.items()})
