"""The ways to free a body that are compared: ours and its parts, and what is usually done."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...body.avoid import BodyOptions, avoiding, settled
from ...body.contact import Surroundings
from ...body.freedom import Freedom
from ...body.model import BodyModel
from ...hands.obstacle import over_time
from ...motion.motion import Motion
from ...progress import Job
from .scenes import Scene

PUSHES = 20  # iterations of the baseline

Method = Callable[[Scene], Job[Motion]]


def methods(model: BodyModel, rivals: list[BodyModel], seed: int) -> dict[str, Method]:
    """By name: the model with and without the exact step, the same for `rivals`, ways out of stock in place of the networks, and a baseline."""

    def ours(networks: BodyModel | None, exact: bool) -> Method:
        return lambda scene: _ours(scene, networks, BodyOptions(seed=seed, exact=exact))

    found: dict[str, Method] = {"ours": ours(model, True), "networks alone": ours(model, False)}
    for rival in rivals:
        found |= {rival.name: ours(rival, True), f"{rival.name} alone": ours(rival, False)}
    return found | {"no networks": ours(None, True), "gradient": gradient}


def _ours(scene: Scene, model: BodyModel | None, options: BodyOptions) -> Job[Motion]:
    result = yield from avoiding(scene.motion, scene.shape, scene.obstacles, model, options)
    return result.motion


def gradient(scene: Scene) -> Job[Motion]:
    """Each frame by itself is pushed out along the distances, with the same holds of trackers and feet."""
    yield from ()
    freedom = Freedom(scene.motion)
    around = Surroundings(freedom, scene.shape, over_time(scene.obstacles), hold=1.0)
    every = np.arange(len(scene.motion))
    return freedom.changed(settled(around, every, np.zeros((len(every), len(freedom))), PUSHES)[0])
