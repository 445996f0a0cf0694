"""The manners of a model (solve/manner.py): in which ways its answers to whole clips that it never trained on are off."""

from __future__ import annotations

import numpy as np
import torch

from ..features import LOWER_BODY, LOWER_JOINTS
from ..motion.mirror import mirror_positions, twin
from ..motion.rotations import Array
from ..solve.manner import into_body
from .dataset import Dataset
from .networks import likeliest_codes
from .training import Networks, tensors

MANNERS = 4  # they hold 85 % of what clips are off by
EVERY = 5  # frames
BATCH = 1024  # frames


def manners(validation: Dataset, networks: Networks) -> Array:
    """The first MANNERS principal directions, float32 [M, 9, 3], of the mean errors of clips in the frame of the body, each as long as one
    deviation, in head heights. An error and its mirror image are as likely; a clip counts by the root of its length."""
    frames = np.arange(0, len(validation), EVERY)
    errors = np.concatenate([_errors(validation, networks, frames[start : start + BATCH]) for start in range(0, len(frames), BATCH)])
    clip = validation.first[frames]
    borders = np.unique(clip)
    means = np.stack([errors[clip == first].mean(axis=0) for first in borders])
    weights = np.sqrt([np.sum(clip == first) for first in borders])
    twins = [LOWER_JOINTS.index(twin(name)) for name in LOWER_JOINTS]
    both = np.concatenate((means, mirror_positions(means[:, twins]))).reshape(2 * len(means), -1)
    weighted = both * np.sqrt(np.tile(weights, 2) / (2 * weights.sum()))[:, None]
    _, sizes, directions = np.linalg.svd(weighted, full_matrices=False)
    return (sizes[:MANNERS, None] * directions[:MANNERS]).reshape(-1, len(LOWER_JOINTS), 3).astype(np.float32)


@torch.no_grad()
def _errors(data: Dataset, networks: Networks, frames: np.ndarray) -> Array:
    """Truth minus answer of the lower joints at anchor frames int [N], in the frame of the body that answered: [N, 9, 3]."""
    window, _, lower = tensors(data, frames, networks)
    restore, stage2 = networks.statistics["lower_body"].restore, networks.lower_body
    features = networks.trunk(window)
    likeliest = likeliest_codes(stage2.logits(stage2.estimator, features))
    now, count = networks.mode.sequence.index(0), len(LOWER_JOINTS)
    answer, truth = (
        restore(values).unflatten(-1, (-1, LOWER_BODY.size))[:, now, : 3 * count].unflatten(-1, (count, 3)).numpy()
        for values in (stage2.decode(likeliest, features), lower)
    )
    return into_body(answer, truth - answer)
