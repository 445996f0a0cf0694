"""What engine tests share: a motion of our own, and a model trained on it in seconds."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cbm_addon.features import RATE
from cbm_addon.motion.motion import Motion
from cbm_addon.motion.resample import frame_times, resample


@pytest.fixture(scope="session")
def body_motion() -> Motion:
    """The procedural motion behind the sample take, 8 seconds of it at the engine's rate."""
    from cbm_addon.takes.sample_motion import sample_motion

    motion = sample_motion()
    return resample(motion, frame_times(float(motion.times[0]), 8.0, RATE))


@pytest.fixture(scope="session")
def small_model_folder(tmp_path_factory: pytest.TempPathFactory, body_motion: Motion) -> Path:
    """A model with tiny networks, trained for one epoch on the procedural motion by the real training job."""
    from cbm_addon.learn.config import TrainConfig
    from cbm_addon.learn.job import train_model
    from cbm_addon.motion.bvh import write_bvh
    from cbm_addon.progress import run

    clips = tmp_path_factory.mktemp("clips")
    for i, start in enumerate((0, 60, 120)):
        part = Motion(body_motion.skeleton, np.arange(90) / RATE, body_motion.root[start : start + 90], body_motion.rotations[start : start + 90])
        write_bvh(clips / f"clip_{i}.bvh", part)
    folder = tmp_path_factory.mktemp("model") / "small"
    config = TrainConfig(name="small", channels=4, classes=4, hidden=32, epochs=2, batch=32)
    run(train_model([clips], folder, config, resume=False, overwrite=False))
    return folder
