"""Hand poses from files of recorded joint positions: stewdio/handy.js and meta-quest/immersive-web-emulation-runtime, both MIT."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...errors import InputError
from ...hands.hand import Hand, Side
from ...motion.rotations import Array

# The WebXR order: the wrist, 4 joints of the thumb, 5 of each finger, whose first (the base of the metacarpal) we leave out.
_WEBXR = [1, 2, 3, 6, 7, 8, 11, 12, 13, 16, 17, 18, 21, 22, 23, 4, 9, 14, 19, 24]
_FLATTEST = "flat"  # the pose of handy.js that the axes of each hand are measured in


@dataclass(frozen=True)
class FreePoses:
    """Names [P] and angles [P, 20] of recorded poses."""

    names: tuple[str, ...]
    angles: Array

    def __len__(self) -> int:
        return len(self.names)

    def part(self, chosen: np.ndarray) -> FreePoses:
        return FreePoses(tuple(self.names[i] for i in chosen), self.angles[chosen])


def read_free_poses(folder: Path) -> FreePoses:
    """All the poses of `handyjs_poses.json` and `iwer_poses.json` in a folder, whichever are there, as angles."""
    names: list[str] = []
    found: list[Array] = []
    for reader in (_handyjs, _webxr_matrices):
        hands: dict[bytes, Hand] = {}
        for name, side, positions, rest in reader(Path(folder)):
            if rest.tobytes() not in hands:
                hands[rest.tobytes()] = Hand.from_rest(side, rest)
            names.append(name)
            found.append(hands[rest.tobytes()].angles_from_positions(positions[None])[0])
    if not names:
        raise InputError(folder, "holds no hand poses; handyjs_poses.json or iwer_poses.json is expected")
    return FreePoses(tuple(names), np.array(found, np.float32))


def held_out(poses: FreePoses) -> tuple[FreePoses, FreePoses]:
    """Poses to train on, and every fifth by name to measure with; both hands of a name go the same way."""
    every = sorted(set(poses.names))
    kept = set(every[2::5])
    measured = np.array([name in kept for name in poses.names])
    return poses.part(np.flatnonzero(~measured)), poses.part(np.flatnonzero(measured))


def _load(path: Path) -> dict:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise InputError(path, f"is not JSON ({error})") from error


def _handyjs(folder: Path) -> list[tuple[str, Side, Array, Array]]:
    path = folder / "handyjs_poses.json"
    if not path.exists():
        return []
    poses = [(pose["names"][0], pose["handedness"], np.array(pose["jointPositions"], np.float32)[_WEBXR] / 1000) for pose in _load(path)["poses"]]
    rest = {side: positions for name, side, positions in poses if name == _FLATTEST}
    return [(name, side, positions, rest[side]) for name, side, positions in poses]


def _webxr_matrices(folder: Path) -> list[tuple[str, Side, Array, Array]]:
    """Left hands as 4x4 matrices by columns; each is its own rest pose."""
    path = folder / "iwer_poses.json"
    if not path.exists():
        return []
    found: list[tuple[str, Side, Array, Array]] = []
    for name, joints in _load(path)["poses"].items():
        matrices = np.array(list(joints.values()), np.float64).reshape(-1, 4, 4).swapaxes(-1, -2)
        positions = (np.linalg.inv(matrices[0]) @ matrices)[_WEBXR, :3, 3].astype(np.float32)
        found.append((name, "left", positions, positions))
    return found
