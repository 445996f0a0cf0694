"""Which of many named objects, bones or joints are the headset and the two controllers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..motion.rotations import Array
from .recording import TakeOverrides
from .take import DEVICES, Constant

DEVICE_WORDS = {"head": ("hmd", "headset", "head", "viewer", "eye"), "hand": ("controller", "hand", "wrist", "grip", "touch", "wand", "knuckles")}
"""What devices are called in recordings, the surest word first."""
SIDE_WORDS = {"left": ("left", "l"), "right": ("right", "r")}
OTHER_WORDS = {
    "offset", "model", "mesh", "root", "end", "site", "top", "nub", "target", "pole", "ik", "origin",
    "thumb", "index", "middle", "ring", "pinky", "little", "finger", "palm",
    "arm", "forearm", "shoulder", "clavicle", "elbow", "leg", "knee", "foot", "toe", "ankle", "hip", "hips",
}  # fmt: skip
BODY_WORDS = {"leg", "upleg", "thigh", "knee", "calf", "shin", "foot", "ankle", "hips", "pelvis", "spine"}


def words(name: str) -> list[str]:
    """The words of a name in lower case: "MotionControllerLeft" and "motion_controller.left" have the same three."""
    return [word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|[^\W\d_]+", name)]


def is_body(names: Sequence[str]) -> bool:
    """Whether these are the joints of a body, not trackers."""
    found = {word for name in names for word in words(name)}
    return len(found & BODY_WORDS) > 1


def find_devices(names: Sequence[str]) -> dict[str, int]:
    """Head, left and right (DEVICES) among the names, as far as there are such, by their words: device to index."""
    found = {}
    for device in DEVICES:
        ranked = [(rank, len(name), index) for index, name in enumerate(names) if (rank := _rank(words(name), device)) is not None]
        if ranked:
            found[device] = min(ranked)[-1]
    return found


def _rank(spoken: list[str], device: str) -> int | None:
    """How surely words name a device, 0 best; None if they do not. A side alone may be that hand."""
    sides = {side for side, marks in SIDE_WORDS.items() if set(marks) & set(spoken)}
    if OTHER_WORDS & set(spoken) or sides != ({device} - {"head"}):
        return None
    known = DEVICE_WORDS["hand" if sides else "head"]
    return next((rank for rank, word in enumerate(known) if word in spoken), len(known) if sides else None)


def choose_devices(path: str | Path, names: Sequence[str], overrides: TakeOverrides) -> tuple[dict[str, int], Constant[str]]:
    """Head, left and right among the names: those that the user named, else those found by name; and the constant that says which.

    Hands may be missing. InputError without a head, or if what the user named is not there.
    """
    found = find_devices(names)
    for device, wanted in zip(DEVICES, (overrides.head, overrides.left, overrides.right), strict=True):
        if wanted is None:
            continue
        if wanted not in names:
            raise InputError(path, f"holds no {wanted!r}; it holds {', '.join(names)}")
        found[device] = names.index(wanted)
    if "head" not in found:
        raise InputError(path, f"nothing in it is called like a headset; name one (--head) of {', '.join(names) or 'what it should hold: nothing moves'}")
    given = (overrides.head, overrides.left, overrides.right) != (None, None, None)
    which = ", ".join(names[found[device]] if device in found else f"no {device}" for device in DEVICES)
    return found, Constant(which, "given") if given else Constant(which, "measured", "by name")


def poses_of(devices: dict[str, int], positions: Array, rotations: Array) -> tuple[Array, Array]:
    """Positions [T, 3, 3] and rotations [T, 3, 4] of head, left and right out of those of N things, [T, N, 3] and [T, N, 4]; NaN for a
    device that is missing."""
    poses = np.full((len(positions), len(DEVICES), 7), np.nan)
    for device, index in devices.items():
        poses[:, DEVICES.index(device)] = np.concatenate((positions[:, index], rotations[:, index]), axis=-1)
    return poses[..., :3], poses[..., 3:]
