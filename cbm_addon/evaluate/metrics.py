"""What is measured of a solved motion beside the truth. Positions are compared in the world: nothing is aligned first.

Every value is a mean over the frames of one clip, NaN where it is not defined (no contact, no motion to divide by).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..features import LOWER_JOINTS, TRACKED_JOINTS, UPPER_JOINTS
from ..motion.contacts import CONTACT_JOINTS, contact_labels
from ..motion.ground_frame import root_frame
from ..motion.motion import Motion, forward_kinematics, local_rotations
from ..motion.rotations import Array, difference
from ..motion.skeleton import BODY_JOINTS, Skeleton
from ..solve.fuse import world_rotations
from ..solve.performance import Performance

CM = 100.0  # per metre
LEAST_FRAMES = 4  # for a third difference
LEAST_DETAIL, LEAST_JITTER = 2.0, 0.05  # degrees per second, 100 m/s³: a truth that moves less is no measure of how much there should be


@dataclass(frozen=True)
class Tracks:
    """What is measured of a motion: BODY_JOINTS at a steady rate. World and local rotations [T, 22, 4], world positions [T, 22, 3]."""

    body: Skeleton
    rate: float
    world: Array
    local: Array
    positions: Array

    def of(self, joints: tuple[str, ...]) -> Array:
        """World positions [T, N, 3] of these joints."""
        return self.positions[:, self.body.indices(joints)]


def tracks(motion: Motion) -> Tracks:
    """The tracks of a motion that has all BODY_JOINTS and at least LEAST_FRAMES frames."""
    joints = motion.skeleton.indices(BODY_JOINTS)
    body = motion.skeleton.subset(BODY_JOINTS)
    world, positions = motion.forward()
    return Tracks(body, motion.rate, world[:, joints], local_rotations(body, world[:, joints]), positions[:, joints])


def measure(solved: Motion, clip: Motion) -> dict[str, float]:
    """All metrics of a solved motion against the clip, which is the truth, sampled at the same times; docs/results.md defines them."""
    ours, truth = tracks(solved), tracks(clip)
    distance = CM * np.linalg.norm(ours.positions - truth.positions, axis=-1)
    turn = np.degrees(difference(ours.world, truth.world))

    def over(values: Array, joints: tuple[str, ...]) -> float:
        return float(values[:, truth.body.indices(joints)].mean())

    root, true_root = root_frame(ours.body, ours.positions), root_frame(truth.body, truth.positions)
    contacts, true_contacts = contacts_of(ours), contacts_of(truth)
    return {
        "lower_mpjpe_cm": over(distance, LOWER_JOINTS),
        "hips_cm": over(distance, ("Hips",)),
        "feet_cm": over(distance, CONTACT_JOINTS),
        "mpjpe_cm": over(distance, BODY_JOINTS),
        "mpjre_deg": float(np.degrees(difference(ours.local, truth.local)).mean()),
        "root_cm": float(CM * np.linalg.norm(root.origin - true_root.origin, axis=-1).mean()),
        "root_deg": float(np.degrees(difference(root.rotation, true_root.rotation)).mean()),
        "tracker_cm": over(distance, TRACKED_JOINTS),
        "tracker_deg": over(turn, TRACKED_JOINTS),
        "detail_ratio": _ratio(detail(ours), detail(truth), LEAST_DETAIL),
        "detail_gt_deg_s": detail(truth),
        "jitter_ratio": _ratio(jitter(ours), jitter(truth), LEAST_JITTER),
        "jitter_gt_100m_s3": jitter(truth),
        "upper_detail_ratio": _ratio(detail(ours, UPPER_JOINTS), detail(truth, UPPER_JOINTS), LEAST_DETAIL),
        "upper_jitter_ratio": _ratio(jitter(ours, UPPER_JOINTS), jitter(truth, UPPER_JOINTS), LEAST_JITTER),
        "slide_cm_s": slide(ours, contacts),
        "slide_truth_contact_cm_s": slide(ours, true_contacts),
        "slide_gt_cm_s": slide(truth, true_contacts),
        "contact_f1": _ratio(2 * float(np.sum(contacts & true_contacts)), float(np.sum(contacts) + np.sum(true_contacts))),
        "penetration_p99_cm": penetration(ours),
        "penetration_gt_p99_cm": penetration(truth),
    }


def measure_raw(performance: Performance, truth: Motion) -> dict[str, float]:
    """What the performance said before inverse kinematics, put on the truth's body.

    Head and hands stand where the predicted hips and rotations carry them. Their own rotations are never predicted (they are the
    trackers'), so there is no raw tracker angle.
    """
    true = tracks(truth)
    said = performance.at(truth.times)
    lower = said.lower_positions * np.float32(said.head_height)
    local = local_rotations(true.body, world_rotations(true.body, said))
    carried = forward_kinematics(true.body, lower[:, LOWER_JOINTS.index("Hips")], local)[1][:, true.body.indices(TRACKED_JOINTS)]
    return {
        "raw_lower_mpjpe_cm": float(CM * np.linalg.norm(lower - true.of(LOWER_JOINTS), axis=-1).mean()),
        "raw_tracker_cm": float(CM * np.linalg.norm(carried - true.of(TRACKED_JOINTS), axis=-1).mean()),
    }


def contacts_of(motion: Tracks) -> np.ndarray:
    """Contacts bool [T, 4] of CONTACT_JOINTS by the rule of motion/contacts.py."""
    return contact_labels(motion.body, motion.positions, motion.rate)


def detail(motion: Tracks, joints: tuple[str, ...] = LOWER_JOINTS) -> float:
    """Mean local rotation speed of joints (of the hips: in the world), degrees per second."""
    local = motion.local[:, motion.body.indices(joints)]
    return float(np.degrees(difference(local[:-1], local[1:])).mean() * motion.rate)


def jitter(motion: Tracks, joints: tuple[str, ...] = LOWER_JOINTS) -> float:
    """Mean third difference of joints' positions, 100 m/s³."""
    third = np.diff(motion.of(joints).astype(np.float64), 3, axis=0)
    return float(np.linalg.norm(third, axis=-1).mean() * motion.rate**3 / 100)


def slide(motion: Tracks, contacts: np.ndarray) -> float:
    """Mean horizontal speed of foot joints over the steps that end in a frame of contact, cm/s; NaN if there is no contact."""
    speed = CM * motion.rate * np.linalg.norm(np.diff(motion.of(CONTACT_JOINTS)[..., :2], axis=0), axis=-1)
    return float(speed[contacts[1:]].mean()) if contacts[1:].any() else float("nan")


def penetration(motion: Tracks) -> float:
    """99th percentile over frames of the depth of the lowest foot joint under the floor, cm."""
    depth = np.maximum(0, -motion.of(CONTACT_JOINTS)[..., 2].min(axis=1))
    return float(CM * np.percentile(depth, 99))


def weighted_means(rows: list[dict[str, float]], seconds: list[float]) -> dict[str, float]:
    """Means over clips weighted by their seconds; clips where a metric is NaN do not count for it."""
    weights = np.asarray(seconds)
    means = {}
    for name in dict.fromkeys(name for row in rows for name in row):
        values = np.array([row.get(name, np.nan) for row in rows])
        known = np.isfinite(values)
        means[name] = _ratio(float(np.sum(values[known] * weights[known])), float(np.sum(weights[known])))
    return means


def _ratio(value: float, of: float, least: float = 0.0) -> float:
    """NaN where what it is a ratio of is not more than `least`."""
    return value / of if of > least else float("nan")
