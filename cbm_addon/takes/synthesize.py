"""Takes made from mocap: what a headset and two controllers would have recorded."""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from ..motion.motion import Motion, forward_kinematics
from ..motion.rotations import continuous, multiply, quat_from_rotvec
from .devices import CONTROLLERS, HEAD_JOINT_SHARE, head_offset, mounting
from .take import DEVICES, HANDS, Constant, Take, TakeReport

TRACKED_JOINTS = ("Head", "LeftHand", "RightHand")


def synthesize(
    motion: Motion,
    device: str = "none",
    noise: tuple[float, float] | None = None,
    head_only: bool = False,
    seed: int = 0,
    name: str = "synthetic",
) -> Take:
    """The take of a motion: joint poses with device "none", else poses of a headset and that pair of controllers (CONTROLLERS).

    noise      standard deviations of white noise, millimetres and degrees, per axis
    head_only  the hands are not tracked
    InputError for an unknown device, or a skeleton without the joints that are tracked.
    """
    if device != "none" and device not in CONTROLLERS:
        raise InputError("--device", f"{device!r} is not known; none, {', '.join(CONTROLLERS)} are")
    skeleton = motion.skeleton
    needed = TRACKED_JOINTS if device == "none" else (*TRACKED_JOINTS, "LeftToe", "RightToe")
    if missing := [joint for joint in needed if joint not in skeleton]:
        raise InputError(name, f"has no joint {', '.join(missing)}; the engine's joint names are needed")
    offsets = None if motion.offsets is None else motion.offsets.astype(np.float64)
    # In float64, so that the same motion gives the same file on every machine.
    world, places = forward_kinematics(skeleton, motion.root.astype(np.float64), motion.rotations.astype(np.float64), offsets)
    joints = skeleton.indices(TRACKED_JOINTS)
    positions, rotations = places[:, joints], world[:, joints]
    if device != "none":
        stature = skeleton.height_above_toes() / HEAD_JOINT_SHARE
        positions, rotations = mounting(CONTROLLERS[device], head_offset(stature)).devices(positions, rotations)
    if noise:
        millimetres, degrees = noise
        random = np.random.default_rng(seed)
        positions = positions + random.normal(scale=millimetres / 1000, size=positions.shape)
        rotations = multiply(rotations, quat_from_rotvec(random.normal(scale=np.radians(degrees), size=positions.shape)))
    tracked = np.ones((len(motion), len(DEVICES)), dtype=bool)
    if head_only:
        tracked[:, HANDS] = False
    return Take(
        name=name,
        times=motion.times - motion.times[0],
        positions=np.where(tracked[..., None], positions, np.nan).astype(np.float32),
        rotations=np.where(tracked[..., None], continuous(rotations), np.nan).astype(np.float32),
        tracked=tracked,
        kind="joint" if device == "none" else "device",
        report=TakeReport("synthetic", len(motion), constants={} if device == "none" else {"device": Constant(device, "format")}),
    )
