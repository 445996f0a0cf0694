"""The ways to free fingers that are compared: ours and its parts, and what is usually done."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...hands.avoid import FingerOptions, avoiding
from ...hands.contact import Probe, every_row
from ...hands.hand import finger_angles
from ...hands.model import HandModel
from ...hands.obstacle import over_time
from ...hands.poses import POSES
from ...hands.project import pushed_out
from ...hands.sweep import swept
from ...motion.rotations import Array
from ...progress import Job
from .scenes import RATE, Scene

Method = Callable[[Scene], Job[Array]]


def methods(model: HandModel, rivals: list[HandModel], seed: int) -> dict[str, Method]:
    """By name: the model with and without the exact step, the same for `rivals`, the exact step with stock poses in place of networks, and two
    baselines."""

    def ours(networks: HandModel | None, exact: bool) -> Method:
        return lambda scene: _ours(scene, networks, FingerOptions(seed=seed, exact=exact))

    found: dict[str, Method] = {"ours": ours(model, True), "networks alone": ours(model, False)}
    for rival in rivals:
        found |= {rival.name: ours(rival, True), f"{rival.name} alone": ours(rival, False)}
    return found | {"no networks": ours(None, True), "sweep": sweep, "gradient": gradient}


def _ours(scene: Scene, model: HandModel | None, options: FingerOptions) -> Job[Array]:
    result = yield from avoiding(scene.hand, scene.wrists, scene.wanted, scene.obstacles, RATE, model, options)
    return result.angles


def sweep(scene: Scene) -> Job[Array]:
    """What live engines do: each finger closes from the open hand toward the wanted pose until it touches."""
    yield from ()
    frames, fingers = every_row(len(scene))
    start = finger_angles(np.clip(POSES["flat"], *scene.hand.limits.T))[fingers]
    end = finger_angles(np.clip(scene.wanted, *scene.hand.limits.T))[frames, fingers]
    return swept(_probe(scene), frames, fingers, start, end)[0].reshape(scene.wanted.shape)


def gradient(scene: Scene) -> Job[Array]:
    """Each frame by itself is pushed out along the distances, from the wanted pose."""
    yield from ()
    frames, fingers = every_row(len(scene))
    start = finger_angles(np.clip(scene.wanted, *scene.hand.limits.T))[frames, fingers]
    return pushed_out(_probe(scene), frames, fingers, start, 20)[0].reshape(scene.wanted.shape)


def _probe(scene: Scene) -> Probe:
    return Probe(scene.hand, scene.wrists, over_time(scene.obstacles))
