"""Recorded motion with a solid put in its way: what the avoidance of whole poses is measured on.

A solid enters a part of the body by some centimetres at a moment of the clip. Another place is drawn where it would enter the axes of bones
by more than its kind allows (a thin thing must not: limbs would be on both of its sides), or come closer than STANDING to a foot that stands:
no pose that keeps its feet could avoid it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from ...body.contact import planted_feet
from ...body.freedom import Freedom
from ...body.shape import BodyShape, body_shape
from ...hands.obstacle import Obstacle
from ...hands.shapes import Box, Cylinder, Moved, Sphere, Union
from ...motion.motion import Motion
from ...motion.rotations import Array, normalize, quat_from_yaw
from ...motion.skeleton import BODY_JOINTS

SECONDS = 8.0  # of a clip that are used, at most
HEIGHT = 1.6  # metres at which the head joint stands: every clip's body is scaled to it
STANDING = 0.03  # metres
TOUCHED = 0.04, 0.6  # shares of the frames that pierce
TRIES = 400
LOOKED = 3  # every which frame is looked at to find a place


@dataclass(frozen=True)
class Scene:
    """A motion, the shape of its body, and a solid in its way."""

    name: str
    motion: Motion
    shape: BodyShape
    solid: Obstacle

    def obstacles(self, frame: int) -> Obstacle:
        return self.solid


def _beam(at: Array, out: Array, across: Array) -> Obstacle:
    """A beam overhead; `at` is on its underside."""
    return Box(at + np.array([0, 0, 0.1]), np.array([1.2, 0.1, 0.1]), quat_from_yaw(np.arctan2(across[1], across[0])))


def _post(at: Array, out: Array, across: Array) -> Obstacle:
    return Cylinder(at - 0.06 * out, 0.06, 3.0)


def _crate(at: Array, out: Array, across: Array) -> Obstacle:
    return Box(at - 0.2 * out, np.array([0.2, 0.3, 0.3]), quat_from_yaw(np.arctan2(out[1], out[0])))


def _ball(at: Array, out: Array, across: Array) -> Obstacle:
    return Sphere(at - 0.2 * out, 0.2)


def _table(at: Array, out: Array, across: Array) -> Obstacle:
    """The edge of a table top."""
    return Box(at - 0.4 * out, np.array([0.4, 0.6, 0.02]), quat_from_yaw(np.arctan2(out[1], out[0])))


def _chair(at: Array, out: Array, across: Array) -> Obstacle:
    """A chair whose back is at `at`, seat and legs beyond it."""
    seat = [Box(np.array(place), np.array(half)) for place, half in (((-0.2, 0, -0.35), (0.2, 0.2, 0.02)), ((0, 0, 0), (0.02, 0.2, 0.35)))]
    legs = [Cylinder(np.array((x, y, -0.6)), 0.02, 0.25) for x in (-0.38, -0.02) for y in (-0.18, 0.18)]
    return Moved(
        Union((*seat, *legs)), (at * [1, 1, 0] + [0, 0, 0.85] - 0.02 * out).astype(np.float32), quat_from_yaw(np.arctan2(out[1], out[0])).astype(np.float32)
    )


# What builds a kind, which joints' parts it enters, and how deep the axes of bones may be inside, metres.
KINDS: dict[str, tuple[Callable[[Array, Array, Array], Obstacle], tuple[str, ...], float]] = {
    "beam": (_beam, ("Head",), 0.08),
    "post": (_post, ("LeftArm", "RightArm", "LeftForeArm", "RightForeArm"), 0.0),
    "crate": (_crate, ("Spine1", "LeftUpLeg", "RightUpLeg"), 0.08),
    "ball": (_ball, ("LeftForeArm", "RightForeArm", "Spine2", "Head"), 0.08),
    "table": (_table, ("Hips", "LeftForeArm", "RightForeArm"), 0.0),
    "chair": (_chair, ("LeftUpLeg", "RightUpLeg", "LeftLeg", "RightLeg"), 0.0),
}


def scenes(clips: list[tuple[str, Motion]], seed: int = 0) -> Iterator[Scene]:
    """One scene for each clip on the engine's joints: the kinds of KINDS in turn, or the next for which the clip has room, if there is one."""
    kinds = list(KINDS)
    for number, (name, motion) in enumerate(clips):
        random = np.random.default_rng([seed, number])
        turned = kinds[number % len(kinds) :] + kinds[: number % len(kinds)]
        placed = next((found for kind in turned if (found := scene(name, motion, kind, random))), None)
        if placed:
            yield placed


def scene(name: str, motion: Motion, kind: str, random: np.random.Generator) -> Scene | None:
    """A solid of a kind in the way of a clip; None if there is no room for one."""
    motion = _prepared(motion, random)
    shape = body_shape(motion.skeleton)
    freedom = Freedom(motion)
    points = shape.axes.world(freedom.world, freedom.positions)[::LOOKED]
    standing = (planted_feet(motion)[::LOOKED, :, None] & shape.feet).any(1)
    build, joints, deepest = KINDS[kind]
    for _ in range(TRIES):
        frame, joint = random.integers(len(points)), motion.skeleton.index(str(random.choice(joints)))
        part = np.flatnonzero(shape.axes.joints == joint)
        point = int(random.choice(part))
        yaw = random.uniform(-np.pi, np.pi)
        out = -np.array([np.cos(yaw), np.sin(yaw), 0.0])  # from the solid toward the body: its surface faces that way
        depth = random.uniform(0.3, 1.0) * (shape.radii[point] + deepest)
        if kind == "beam":
            top = points[frame, part, 2].max() + shape.radii[part].max()
            solid = build(np.append(points[frame, point, :2], top - depth), out, normalize(np.cross([0, 0, 1.0], out)))
        else:
            solid = build(points[frame, point] + out * (depth - shape.radii[point]), out, out)
        distances = solid.nearest(points.reshape(-1, 3).astype(np.float32))[0].reshape(points.shape[:2])
        depths = shape.radii - distances
        share = float((depths.max(-1) > 0).mean())
        if distances.min() > -deepest and TOUCHED[0] < share < TOUCHED[1] and not (standing & (depths > -STANDING)).any():
            return Scene(f"{kind}: {name}", motion, shape, solid)
    return None


def _prepared(motion: Motion, random: np.random.Generator) -> Motion:
    """SECONDS of the motion on the engine's joints, at an adult's size."""
    body = motion.skeleton.subset(BODY_JOINTS) if motion.skeleton.names != BODY_JOINTS else motion.skeleton
    scale = HEIGHT / body.height_above_toes()
    count = min(len(motion), max(1, round(SECONDS * motion.rate)))
    start = int(random.integers(len(motion) - count + 1))
    part = slice(start, start + count)
    return Motion(body.scaled(scale), motion.times[part], motion.root[part] * np.float32(scale), motion.rotations[part])
