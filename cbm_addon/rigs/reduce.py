"""Fewer keys: which frames of a dense bake must be keyed, so that smooth curves through them keep every joint within a tolerance.

The error is measured where it is seen, on positions and rotations of joints, and not curve by curve: a degree matters more at the hips than
at a toe. Every bone begins with its first and last frame. Wherever a joint leaves the tolerance, the bone that contributes most gets a
key more, where it is itself farthest off (the splitting of Ramer 1972 and of Douglas and Peucker 1973, by the error of the whole chain).
Joints of feet that stand have a tolerance of their own, since even a millimetre is seen as sliding.
"""

from __future__ import annotations

from collections.abc import Collection, Generator, Sequence
from dataclasses import dataclass

import numpy as np

from ..motion.rotations import Array, difference, inverse, multiply, normalize, quat_from_axis_angle, quat_from_euler, rotate
from ..progress import Progress
from .rig import Control, Rig

STRAIGHT = 1e-3  # weight of a straight line where too few frames lie between two keys to tell how the curve goes


@dataclass(frozen=True)
class BoneCurves:
    """What a dense bake keys of one control over T frames: values [T, N] in its rotation mode, and locations [T, 3] of one that also moves."""

    control: Control
    mode: str
    rotation: Array
    location: Array | None

    def values(self) -> Array:
        """float64 [T, N], rotation first."""
        parts = (self.rotation,) if self.location is None else (self.rotation, self.location)
        return np.concatenate(parts, axis=-1).astype(np.float64)

    def turns(self, values: Array) -> Array:
        """The rotations [t, 4] that Blender makes of values [t, N]."""
        rotation = values[:, : self.rotation.shape[1]]
        if self.mode == "QUATERNION":
            return normalize(rotation)
        if self.mode == "AXIS_ANGLE":
            return quat_from_axis_angle(normalize(rotation[:, 1:]), rotation[:, 0])
        order = self.mode[::-1]  # Blender names the sequence of fixed axes
        return quat_from_euler(rotation[:, ["XYZ".index(axis) for axis in order]], order)


@dataclass(frozen=True)
class Tolerance:
    """How far a joint may leave where it was: `position` and, for a joint of a foot that stands, `planted` in armature units; `angle` in radians."""

    position: float
    planted: float
    angle: float


@dataclass(frozen=True)
class Reduced:
    """frames: for each of the curves, which frames are keyed, int, increasing. position, angle: the largest deviations that are left."""

    frames: list[np.ndarray]
    position: float
    angle: float


def handles(values: Array, keyed: np.ndarray) -> tuple[Array, Array]:
    """Slopes per frame [K - 1, N] with which cubic curves leave each of the frames `keyed` [K] and arrive at the next, so that they follow dense
    values [T, N] between them best (least squares). The curves pass through the values at the keys."""
    first, last = keyed[:-1], keyed[1:]
    length = (last - first).astype(np.float64)
    segment = np.repeat(np.arange(len(length)), last - first)
    frames = np.arange(keyed[0], keyed[-1])
    t = ((frames - first[segment]) / length[segment])[:, None]
    leaving, arriving, there = t * (1 - t) ** 2, t * t * (t - 1), t * t * (3 - 2 * t)
    way = values[last] - values[first]
    rest = values[frames] - values[first][segment] - there * way[segment]

    def total(products: Array) -> Array:
        return np.add.reduceat(products, first - keyed[0], axis=0)

    a, b, c = total(leaving**2) + STRAIGHT, total(leaving * arriving), total(arriving**2) + STRAIGHT
    x, y = total(leaving * rest) + STRAIGHT * way, total(arriving * rest) + STRAIGHT * way
    scale = (a * c - b * b) * length[:, None]
    return (c * x - b * y) / scale, (a * y - b * x) / scale


def between(values: Array, keyed: np.ndarray, frames: np.ndarray) -> Array:
    """Values [t, N] at `frames` of the curves through dense values [T, N] at the frames `keyed`."""
    if len(keyed) == 1:
        return np.repeat(values[keyed], len(frames), axis=0)
    start = np.clip(np.searchsorted(keyed, frames, side="right") - 1, 0, len(keyed) - 2)
    first, last = keyed[start], keyed[start + 1]
    length = (last - first)[:, None].astype(np.float64)
    t = (frames - first)[:, None] / length
    leaving, arriving = (slope[start] * length for slope in handles(values, keyed))
    here, way = values[first], values[last] - values[first]
    return here + t * (leaving + t * (3 * way - 2 * leaving - arriving + t * (leaving + arriving - 2 * way)))


def reducing(
    rig: Rig, curves: Sequence[BoneCurves], planted: dict[str, np.ndarray], apart: Collection[str], tolerance: Tolerance
) -> Generator[Progress, None, Reduced]:
    """The frames to key of each of `curves`, whose controls come after their carriers.

    planted  joint -> bool [T]: it belongs to a foot that stands
    apart    joints whose places do not follow from the curves, because inverse kinematics hold them
    """
    chain = _Chain(rig, curves)
    dense = [bone.values() for bone in curves]
    every = np.arange(len(dense[0]))
    allowed = np.full((len(every), len(chain.joints)), tolerance.position)
    for joint in set(planted) & set(chain.joints):
        allowed[planted[joint], chain.joints.index(joint)] = min(tolerance.planted, tolerance.position)
    allowed[:, [chain.joints.index(joint) for joint in apart]] = np.inf
    fit = _Fit(chain, dense, chain.pose(dense), allowed, tolerance.angle)
    keyed = [np.unique(every[[0, -1]]) for _ in curves]
    values = [between(dense[bone], keyed[bone], every) for bone in range(len(curves))]
    active = every
    while len(active):
        blamed = fit.blame(values, active)
        changed = np.zeros(len(every), dtype=bool)
        for bone in np.unique(blamed[blamed >= 0]):
            segments = np.unique(np.searchsorted(keyed[bone], active[blamed == bone], side="right") - 1)
            ends = [(keyed[bone][segment], keyed[bone][segment + 1]) for segment in segments]
            new = [first + 1 + np.argmax(chain.error(bone, dense[bone][first + 1 : last], values[bone][first + 1 : last])) for first, last in ends]
            keyed[bone] = np.union1d(keyed[bone], new)
            inside = np.concatenate([every[first : last + 1] for first, last in ends])
            values[bone][inside] = between(dense[bone], keyed[bone], inside)
            changed[inside] = True
        yield Progress(0.5 * (1 - changed.mean()), "thinning keys")
        active = every[changed]
    for bone in range(len(curves)):  # the first keys were set before the others were there: some are not needed any more
        for start in (1, 2):
            yield Progress(0.5 + 0.5 * bone / len(curves), "thinning keys")
            keyed[bone] = _without(fit, values, bone, keyed[bone], keyed[bone][start:-1:2])
            values[bone] = between(dense[bone], keyed[bone], every)
    _, position, angle = fit.ratios(values, every)
    return Reduced(keyed, position, angle)


def _without(fit: _Fit, values: list[Array], bone: int, keyed: np.ndarray, removed: np.ndarray) -> np.ndarray:
    """The keys of a bone without those of `removed`, no two of them neighbours, that are not needed."""
    left = np.setdiff1d(keyed, removed)
    trial = list(values)
    trial[bone] = between(fit.dense[bone], left, np.arange(len(values[bone])))
    wrong = fit.ratios(trial, np.arange(len(values[bone])))[0].max(axis=-1) > 1
    needed = [key for key in removed if wrong[(first := left[np.searchsorted(left, key) - 1]) : left[np.searchsorted(left, first) + 1] + 1].any()]
    return np.union1d(left, needed).astype(int)


@dataclass(frozen=True)
class _Fit:
    """How well thinned values of every control keep to the dense ones: `truth` is what those do, `allowed` [T, J] how far joints may be from it."""

    chain: _Chain
    dense: list[Array]
    truth: _Pose
    allowed: Array
    angle: float

    def ratios(self, values: list[Array], frames: np.ndarray) -> tuple[Array, float, float]:
        """Deviations as shares of what is allowed [t, J + K], of joints' positions and of controls' rotations; and the largest of both."""
        return self._ratios(self.chain.pose([value[frames] for value in values]), self.truth.at(frames), self.allowed[frames])

    def _ratios(self, pose: _Pose, truth: _Pose, allowed: Array) -> tuple[Array, float, float]:
        away = np.linalg.norm(pose.positions - truth.positions, axis=-1)
        turned = difference(pose.turns, truth.turns).T
        judged = np.where(np.isfinite(allowed), away, 0)
        return np.concatenate((judged / allowed, turned / self.angle), axis=-1), float(judged.max()), float(turned.max())

    def blame(self, values: list[Array], frames: np.ndarray) -> np.ndarray:
        """Which control contributes most to the worst deviation at every frame, int [t]; -1 where all are allowed."""
        chain = self.chain
        pose, truth = chain.pose([value[frames] for value in values]), self.truth.at(frames)
        ratios = self._ratios(pose, truth, self.allowed[frames])[0]
        worst = ratios.argmax(axis=-1)
        every = np.arange(len(frames))
        off = difference(pose.own, truth.own).T  # [t, K]
        joint = np.minimum(worst, len(chain.joints) - 1)
        lever = np.linalg.norm(truth.positions[every, joint][:, None] - truth.positions[:, chain.pivots], axis=-1)
        moved = np.linalg.norm(pose.moves - truth.moves, axis=-1).T
        shares = np.where((worst < len(chain.joints))[:, None], off * lever + moved, off) * chain.carries[worst]
        return np.where((ratios[every, worst] > 1) & (shares.max(axis=-1) > 0), shares.argmax(axis=-1), -1)


@dataclass(frozen=True)
class _Pose:
    """own: rotations [K, t, 4] of K controls from their rest, as their parents see them; turns: the same as the armature sees them; moves
    [K, t, 3]: locations (0 of controls that only turn); positions [t, J, 3] of joints. In armature axes and units."""

    own: Array
    turns: Array
    moves: Array
    positions: Array

    def at(self, frames: np.ndarray) -> _Pose:
        return _Pose(self.own[:, frames], self.turns[:, frames], self.moves[:, frames], self.positions[frames])


class _Chain:
    """The controls and joints of a rig as a chain: what every control carries along."""

    def __init__(self, rig: Rig, curves: Sequence[BoneCurves]) -> None:
        self.curves = curves
        place = {bone.control.bone: i for i, bone in enumerate(curves)}
        mapping = rig.mapping
        self.joints = list(mapping.joints)
        self.parents = [self.joints.index(parent) if (parent := mapping.parents[joint]) else -1 for joint in self.joints]
        self.rest = np.array([rig.rest[rig.index(bone), :3, 3] for bone in mapping.joints.values()])
        self.carriers = [place.get(bone.control.carrier or "", -1) for bone in curves]
        self.frames = np.array([rig.rest_rotation(bone.control.bone) for bone in curves])
        self.heads = np.array([rig.rest[rig.index(bone.control.bone), :3, 3] for bone in curves])
        self.pivots = np.array([self.joints.index(bone.control.joint) for bone in curves])
        self.player = np.full(len(self.joints), -1)
        for i, bone in enumerate(curves):
            if not bone.control.roll:
                self.player[self.pivots[i]] = i  # of several controls of a joint, the last is the one that its bone follows
        self.mover = next((i for i, bone in enumerate(curves) if bone.location is not None), -1)
        self.move_axes = self._axes_of_location(rig) if self.mover >= 0 else None
        self.carries = self._carried()

    def _axes_of_location(self, rig: Rig) -> Array:
        bone = self.curves[self.mover].control.bone
        if rig.local_location[rig.index(bone)]:
            return rig.rest_rotation(bone)
        parent = rig.parent(bone)
        return rig.rest_rotation(parent) if parent else np.array([1.0, 0, 0, 0])

    def _carried(self) -> np.ndarray:
        """bool [J + K, K]: which controls move a joint, and which turn a control."""
        count = len(self.curves)
        turns = np.eye(count, dtype=bool)
        for i, carrier in enumerate(self.carriers):
            turns[i] |= turns[carrier] if carrier >= 0 else False
        moves = np.zeros((len(self.joints), count), dtype=bool)
        for joint, parent in enumerate(self.parents):
            if parent >= 0:
                moves[joint] = moves[parent] | (turns[self.player[parent]] if self.player[parent] >= 0 else False)
        if self.mover >= 0:
            anchor = self.joints.index(self.curves[self.mover].control.anchor or self.joints[0])
            moves |= moves[anchor] | turns[self.mover]
        return np.concatenate((moves, turns))

    def pose(self, values: Sequence[Array]) -> _Pose:
        """What values [t, N] of every control do."""
        count = len(values[0])
        own = np.stack([bone.turns(value) for bone, value in zip(self.curves, values, strict=True)])
        own = multiply(multiply(self.frames[:, None], own), inverse(self.frames)[:, None])
        turns = own.copy()
        for i, carrier in enumerate(self.carriers):
            if carrier >= 0:
                turns[i] = multiply(turns[carrier], own[i])
        playing = np.empty((len(self.joints), count, 4))
        positions = np.zeros((count, len(self.joints), 3))
        for joint, parent in enumerate(self.parents):
            playing[joint] = turns[self.player[joint]] if self.player[joint] >= 0 else playing[parent] if parent >= 0 else (1, 0, 0, 0)
            if parent >= 0:
                positions[:, joint] = positions[:, parent] + rotate(playing[parent], self.rest[joint] - self.rest[parent])
        moves = np.zeros((len(self.curves), count, 3))
        if self.mover >= 0:
            bone = self.curves[self.mover]
            moves[self.mover] = rotate(self.move_axes, values[self.mover][:, bone.rotation.shape[1] :])
            anchor = self.joints.index(bone.control.anchor or self.joints[0])
            beside = rotate(turns[self.mover], self.heads[self.mover] - self.rest[anchor])
            positions += (self.heads[self.mover] + moves[self.mover] - beside - positions[:, anchor])[:, None]
        return _Pose(own, turns, moves, positions)

    def error(self, bone: int, dense: Array, values: Array) -> Array:
        """By how much a bone itself is off, [t], to compare frames."""
        curve = self.curves[bone]
        turned = difference(curve.turns(values), curve.turns(dense))
        if curve.location is None:
            return turned
        reach = np.linalg.norm(self.rest - self.heads[bone], axis=-1).max()
        return reach * turned + np.linalg.norm((values - dense)[:, curve.rotation.shape[1] :], axis=-1)
