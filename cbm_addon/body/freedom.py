"""How a body may be changed: turns of its joints and a shift of its hips on top of a wanted motion, and what each of them moves.

Head, hands and feet keep the turns that they are wanted with: trackers and floors say them. Elbows and knees are hinges. Everything else
turns freely, at a cost (EASE).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..motion.motion import Motion, local_rotations
from ..motion.rotations import Array, matrix_from_quat, normalize, quat_from_matrix, quat_from_rotvec, rotate, rotvec_from_quat
from ..motion.skeleton import Skeleton
from .shape import SIDES

KEPT = ("Head", *(f"{side}{name}" for side in SIDES for name in ("Hand", "Foot", "Toe")))  # joints whose world rotations stay
HELD = ("Head", "LeftHand", "RightHand", "LeftFoot", "RightFoot")  # joints whose positions are to stay
HINGES = {"LeftForeArm": (0, 0, -1), "RightForeArm": (0, 0, 1), "LeftLeg": (1, 0, 0), "RightLeg": (1, 0, 0)}  # axes of one that is straight
STRAIGHT = 0.2  # sine of the bend below which a hinge's axis is more and more that of a straight one
LEAST, MOST = np.radians((1, 150))  # bends of a hinge

# Turns (radians) and shifts (metres of a body whose head joint stands at 1.6) that cost as much as one another.
EASE = {"Hips": 0.35, "Shoulder": 0.12, "Arm": 0.7, "ForeArm": 0.9, "UpLeg": 1.2, "Leg": 2.0}
SHIFT, SPINE = 0.3, 0.2


@dataclass(frozen=True)
class Posed:
    """A body with its changes made; T frames, n changes.

    rotations  [T, J, 3, 3] and positions [T, J, 3] of the joints in the world
    axes       [T, n, 3]: the world axis that each change turns about now, or along which it shifts
    pivots     [T, n, 3]: the point that it turns about; nothing for shifts
    bends      [T, H]: how far the hinges are bent
    """

    rotations: Array
    positions: Array
    axes: Array
    pivots: Array
    bends: Array


class Freedom:
    """The changes of a body along a wanted motion: n numbers in each frame.

    ease     [n]: how large a change of each is that costs 1
    hinges   the columns [H] of the hinges
    """

    def __init__(self, motion: Motion) -> None:
        body = motion.skeleton
        self.motion, self.body = motion, body
        turning = [name for name in body.names if name not in KEPT]
        self._columns: dict[int, slice] = {}
        ease, start = [SHIFT] * 3, 3
        for name in turning:
            width = 1 if name in HINGES else 3
            self._columns[body.index(name)] = slice(start, start + width)
            ease += [EASE.get(name.removeprefix("Left").removeprefix("Right"), SPINE)] * width
            start += width
        self.ease = np.array(ease)
        self.hinges = np.array([self._columns[body.index(name)].start for name in HINGES])
        self._kept = np.isin(body.names, KEPT)
        self.held = body.indices(HELD)
        local, (world, positions) = motion.rotations.astype(np.float64), motion.forward()
        self.local, self.world, self.positions = matrix_from_quat(local), matrix_from_quat(world.astype(np.float64)), positions.astype(np.float64)
        self._hinge_axes, self._bends = _hinge_axes(body, local)

    def __len__(self) -> int:
        return len(self.ease)

    @cached_property
    def _lever(self) -> np.ndarray:
        """int [J]: what moves along rigidly without being turned ends at this joint; the joint itself if it is turned."""
        lever = np.arange(len(self.body))
        for joint, parent in enumerate(self.body.parents):
            if self._kept[joint] and parent >= 0 and self._kept[parent]:
                lever[joint] = lever[parent]
        return lever

    @cached_property
    def _moves(self) -> np.ndarray:
        """bool [J, n]: which changes move what a joint carries."""
        moves = np.zeros((len(self.body), len(self)), bool)
        for joint, parent in enumerate(self.body.parents):
            if parent >= 0:
                moves[joint] = moves[parent]
            if joint in self._columns:
                moves[joint, self._columns[joint]] = True
        moves[:, :3] = True
        return moves

    def posed(self, frames: np.ndarray, changes: Array) -> Posed:
        """The body at `frames` int [R] with changes [R, n]."""
        count, body = len(frames), self.body
        rotations, positions = np.empty((count, len(body), 3, 3)), np.empty((count, len(body), 3))
        axes, pivots = np.empty((count, len(self), 3)), np.zeros((count, len(self), 3))
        axes[:, :3] = np.eye(3)
        for joint, parent in enumerate(body.parents):
            above = rotations[:, parent] if parent >= 0 else np.broadcast_to(np.eye(3), (count, 3, 3))
            if parent >= 0:
                positions[:, joint] = positions[:, parent] + above @ body.offsets[joint].astype(np.float64)
            else:
                positions[:, joint] = self.positions[frames, joint] + changes[:, :3]
            if self._kept[joint]:
                rotations[:, joint] = self.world[frames, joint]
                continue
            columns = self._columns[joint]
            pivots[:, columns] = positions[:, joint, None]
            if body.names[joint] in HINGES:
                axis = self._hinge_axes[body.names[joint]][frames]
                axes[:, columns.start] = (above @ axis[..., None])[..., 0]
                rotations[:, joint] = above @ _turn(axis * changes[:, columns]) @ self.local[frames, joint]
            else:
                wanted = above @ self.local[frames, joint]
                axes[:, columns] = np.swapaxes(wanted @ _left_jacobian(changes[:, columns]), -1, -2)
                rotations[:, joint] = wanted @ _turn(changes[:, columns])
        return Posed(rotations, positions, axes, pivots, self._bends[frames] + changes[:, self.hinges])

    def slopes(self, posed: Posed, joints: np.ndarray, points: Array, along: Array) -> Array:
        """How fast points [R, M, 3], carried by `joints` int [M] or [R, M], move along directions [R, M, 3] with each change: [R, M, n]."""
        carried = posed.positions[np.arange(len(points))[:, None], self._lever[joints]]
        ends = np.where(self._kept[joints][..., None], carried, points)
        turned = np.cross(ends, along) @ np.swapaxes(posed.axes, -1, -2)  # n . (a x (p - q)) = a . (p x n) - n . (a x q)
        slopes = turned - along @ np.swapaxes(np.cross(posed.axes, posed.pivots), -1, -2)
        slopes[..., :3] = along
        return slopes * self._moves[joints]

    def changes_to(self, frames: np.ndarray, rotations: Array, hips: Array) -> Array:
        """The changes [R, n] that take the wanted pose at `frames` to world rotation matrices [R, J, 3, 3] with the hips at [R, 3], as near as hinges allow."""
        changes = np.zeros((len(frames), len(self)))
        changes[:, :3] = hips - self.positions[frames, 0]
        for joint, columns in self._columns.items():
            parent = self.body.parents[joint]
            above = rotations[:, parent] if parent >= 0 else np.eye(3)
            wanted = above @ self.local[frames, joint]
            turn = rotvec_from_quat(quat_from_matrix(np.swapaxes(wanted, -1, -2) @ rotations[:, joint]))
            if columns.stop - columns.start == 1:
                turn = ((self.local[frames, joint] @ turn[..., None])[..., 0] * self._hinge_axes[self.body.names[joint]][frames]).sum(-1, keepdims=True)
            changes[:, columns] = turn
        return changes

    def changed(self, changes: Array) -> Motion:
        """The motion with changes [T, n]; what is not changed stays to the bit."""
        motion, touched = self.motion, np.flatnonzero(np.any(changes != 0, axis=-1))
        root, rotations = motion.root.copy(), motion.rotations.copy()
        if len(touched):
            posed = self.posed(touched, changes[touched])
            local = local_rotations(self.body, quat_from_matrix(posed.rotations)).astype(np.float32)
            before = motion.rotations[touched]
            rotations[touched] = np.where((local * before).sum(-1, keepdims=True) < 0, -local, local)
            root[touched] = posed.positions[:, 0].astype(np.float32)
        return Motion(self.body, motion.times, root, rotations)

    def columns(self, joint: int) -> slice:
        """Which changes turn a joint."""
        return self._columns[joint]

    def is_spine(self, name: str) -> bool:
        """Whether a joint is between hips and head."""
        return name not in ("Hips", "Head") and self.body.index(name) in self.body.chain("Hips", "Head")


def _hinge_axes(body: Skeleton, local: Array) -> tuple[dict[str, Array], Array]:
    """The axes [T, 3] in the parents' frames that elbows and knees bend about, and how far they are bent [T, H]."""
    axes, bends = {}, []
    for name, straight in HINGES.items():
        joint = body.index(name)
        following = [child for child, parent in enumerate(body.parents) if parent == joint]
        upper = normalize(body.offsets[joint].astype(np.float64))
        lower = rotate(local[:, joint], normalize(body.offsets[following[0]].astype(np.float64)))
        across = np.cross(np.broadcast_to(upper, lower.shape), lower)
        sine, cosine = np.linalg.norm(across, axis=-1), lower @ upper
        axes[name] = normalize(across + np.maximum(STRAIGHT - sine, 0)[:, None] * np.array(straight, np.float64))
        bends.append(np.arctan2(sine, cosine))
    return axes, np.stack(bends, -1)


def _turn(vectors: Array) -> Array:
    return matrix_from_quat(quat_from_rotvec(vectors))


def _left_jacobian(vectors: Array) -> Array:
    """[..., 3, 3]: how the turn by a rotation vector [..., 3] turns further as the vector grows (Sola et al. 2018, eq. 145)."""
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    safe = np.maximum(angle, 1e-4)
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    cross = np.stack((zero, -z, y, z, zero, -x, -y, x, zero), -1).reshape(*vectors.shape[:-1], 3, 3)
    first = np.where(angle < 1e-4, 0.5, (1 - np.cos(safe)) / safe**2)
    second = np.where(angle < 1e-4, 1 / 6, (safe - np.sin(safe)) / safe**3)
    return np.eye(3) + first * cross + second * (cross @ cross)
