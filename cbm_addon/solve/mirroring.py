"""The same take asked twice: as it is, and as its mirror image. What the networks get wrong on one side they seldom get wrong on the other in
the same way, so the mean of the two answers is better than either."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..features import LOWER_JOINTS, UPPER_JOINTS
from ..motion.contacts import CONTACT_JOINTS
from ..motion.mirror import mirror_positions, mirror_rotations, twin
from ..motion.rotations import Array, normalize
from ..takes.take import DEVICES, Take
from .performance import Performance


def mirror_take(take: Take) -> Take:
    """The take with its sides exchanged; twice gives the original."""
    twins = _twins(DEVICES)
    return replace(
        take, positions=mirror_positions(take.positions[:, twins]), rotations=mirror_rotations(take.rotations[:, twins]), tracked=take.tracked[:, twins]
    )


def mirror_performance(performance: Performance) -> Performance:
    """The performance with its sides exchanged; twice gives the original."""
    lower, upper, contacts = (_twins(names) for names in (LOWER_JOINTS, UPPER_JOINTS, CONTACT_JOINTS))
    return replace(
        performance,
        lower_positions=mirror_positions(performance.lower_positions[:, lower]),
        lower_velocities=mirror_positions(performance.lower_velocities[:, lower]),
        lower_rotations=mirror_rotations(performance.lower_rotations[:, lower]),
        upper_rotations=mirror_rotations(performance.upper_rotations[:, upper]),
        contacts=performance.contacts[:, contacts],
    )


def mean(answers: list[Performance]) -> Performance:
    """What lies in the middle of answers to the same take, in the same unit."""

    def middle(name: str) -> Array:
        return sum(getattr(answer, name) for answer in answers) / np.float32(len(answers))

    def turned(name: str) -> Array:
        first = getattr(answers[0], name)
        turns = [getattr(answer, name) for answer in answers]
        return normalize(sum(turn * np.where(np.sum(turn * first, axis=-1, keepdims=True) < 0, -1, 1).astype(np.float32) for turn in turns))

    means = {name: middle(name) for name in ("lower_positions", "lower_velocities", "contacts")}
    turns = {name: turned(name) for name in ("lower_rotations", "upper_rotations")}
    return replace(answers[0], **means, **turns)


def _twins(names: tuple[str, ...]) -> np.ndarray:
    """For each name the index of its twin on the other side."""
    return np.array([names.index(twin(name)) for name in names])
