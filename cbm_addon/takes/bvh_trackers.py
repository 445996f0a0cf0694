"""BVH files whose joints are trackers, not a body: a headset and controllers called by name, each with its own way through the world."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..motion import bvh
from .names import choose_devices, find_devices, is_body, poses_of
from .recording import Recording, TakeOverrides, take_from
from .take import Take

NAME = "BVH of trackers"

JOINT = re.compile(r"^\s*(?:ROOT|JOINT)\s+(.+?)\s*\{?\s*$", re.MULTILINE | re.IGNORECASE)


def recognises(head: bytes) -> bool:
    return head.removeprefix(b"\xef\xbb\xbf").lstrip()[:9].upper() == b"HIERARCHY"


def is_mocap(head: bytes) -> bool:
    """Whether a file with these first bytes is BVH of a body, not of trackers."""
    names = JOINT.findall(head.decode("utf-8", errors="replace"))
    return recognises(head) and (is_body(names) or "head" not in find_devices(names))


def read(path: Path, overrides: TakeOverrides) -> Take:
    """The take in a BVH. InputError if its joints are a body's and the user names none: motion capture is no recording of devices."""
    file = bvh.read_bvh_file(path)
    motion = file.motion
    if is_body(motion.skeleton.names) and not overrides.head:
        raise InputError(path, "is motion capture of a body; make a take of it (cbm synthesize), or name its trackers (--head, --left, --right)")
    devices, trackers = choose_devices(path, motion.skeleton.names, overrides)
    world, places = motion.forward()
    # As they stand in the file: what it is of can be told better from trackers than from a skeleton, which these are not.
    to_file = bvh.AXES[file.up_axis].astype(np.float64)
    positions, rotations = poses_of(devices, places @ to_file / file.unit_to_metres, world)
    rotations[..., 1:] = rotations[..., 1:] @ to_file
    recording = Recording(NAME, motion.times, positions, rotations, constants={"trackers": trackers})
    return take_from(recording, path, overrides)
