"""Motion of one body on another whose chain of spine joints may differ."""

from __future__ import annotations

import numpy as np

from .motion import Motion, local_rotations
from .rotations import Array, continuous, slerp
from .skeleton import Skeleton


def transfer(motion: Motion, body: Skeleton, scale: float = 1.0) -> Motion:
    """The motion on `body`: world rotations are copied by joint name, the hips' path is scaled about the world origin.

    The joint that carries the shoulders takes the rotation of the source's; a neck above it is half-way between chest and head; the other
    joints of the spine take the source's at the same share of the height from hips to shoulders.
    """
    source, world = motion.skeleton, motion.forward()[0]
    spine, source_spine = _spine(body), _spine(source)
    share, source_share = _shares(body, spine), _shares(source, source_spine)
    result = np.empty((len(motion), len(body), 4), dtype=world.dtype)
    for i, name in enumerate(body.names):
        if i in spine:
            result[:, i] = _at_share(world[:, source_spine], source_share, share[spine.index(i)])
        elif name in source:
            result[:, i] = world[:, source.index(name)]
        else:
            result[:, i] = result[:, body.parents[i]]
    head, source_head = body.index("Head"), source.index("Head")
    for joint in body.chain("Hips", "Head")[len(spine) : -1]:
        result[:, joint] = slerp(world[:, source_spine[-1]], world[:, source_head], 0.5)
    result[:, head] = world[:, source_head]
    root = motion.root * np.float32(scale)
    return Motion(body, motion.times, root, continuous(local_rotations(body, result)))


def _spine(skeleton: Skeleton) -> list[int]:
    """Joints from the hips to the one that carries the shoulders, both included."""
    chain = skeleton.chain("Hips", "Head")
    carrier = skeleton.parents[skeleton.index("LeftShoulder" if "LeftShoulder" in skeleton else "LeftArm")]
    return chain[: chain.index(int(carrier)) + 1]


def _shares(skeleton: Skeleton, spine: list[int]) -> Array:
    """How far up the spine each of its joints sits, from 0 (hips) to 1 (the one that carries the shoulders)."""
    lengths = np.linalg.norm(skeleton.offsets[spine[1:]], axis=-1)
    heights = np.concatenate(([0.0], np.cumsum(lengths)))
    return heights / max(heights[-1], 1e-9)


def _at_share(rotations: Array, shares: Array, share: float) -> Array:
    """Rotations [T, 4] at a share of the spine between the joints' own rotations [T, N, 4]."""
    after = int(np.clip(np.searchsorted(shares, share), 1, len(shares) - 1)) if len(shares) > 1 else 0
    before = max(after - 1, 0)
    span = shares[after] - shares[before]
    return slerp(rotations[:, before], rotations[:, after], (share - shares[before]) / span if span > 0 else 0.0)
