"""Stage 2: drawing candidate futures from the codebook, and choosing one for every hop."""

from __future__ import annotations

import numpy as np

from ..motion.rotations import Array

CONSENSUS = 1.0  # weight of agreeing with the candidates' own mean
CONTROL = 0.5  # weight of agreeing with stage 1 on the path of the hips
NEAR = 0.05  # head heights: candidates about so far from the chosen one say the same
TRANSITION = 2.0  # weight of agreeing with the neighbour over the frames that both cover


def gumbel_noise(candidates: int, channels: int, classes: int, seed: int, variation: int) -> Array:
    """Noise float32 [K, C, D]. It is the same at every hop, so that a candidate keeps its manner over the take instead of flickering.

    Candidate 0 of variation 0 has none: it is the most probable code.
    """
    noise = np.random.default_rng([seed, variation]).gumbel(size=(candidates, channels, classes)).astype(np.float32)
    if variation == 0:
        noise[0] = 0
    return noise


def draw(logits: Array, noise: Array) -> np.ndarray:
    """Candidate codes (class numbers) int [N, K, C] from logits [N, C, D] and noise [K, C, D]."""
    return np.argmax(logits[:, None] + noise, axis=-1)


def own_cost(paths: Array, control_hips: Array, consensus: bool) -> Array:
    """What is wrong with each candidate by itself, [H, K]: paths [H, K, S, J, 3] (hips first) against the hips of stage 1 [H, S, 3]."""
    cost = CONTROL * _distance(paths[..., :1, :], control_hips[:, None, :, None, :])
    if consensus:
        cost = cost + CONSENSUS * _distance(paths, paths.mean(axis=1, keepdims=True))
    return cost


def _distance(a: Array, b: Array) -> Array:
    """Mean squared distance of points [..., S, J, 3] over sequence and joints."""
    difference = a - b
    frames, joints = difference.shape[-3:-1]
    flat = difference.reshape(*difference.shape[:-3], -1)  # one product instead of three passes: a causal solve asks for it four times a frame
    return np.einsum("...n,...n->...", flat, flat) / (frames * joints)


def choose_path(own: Array, paths: Array, hop: int) -> np.ndarray:
    """The candidate of every hop, int [H], by dynamic programming (Viterbi): least own cost [H, K] plus disagreement between neighbours.

    paths [H, K, S, J, 3] are world positions; hop h + 1 starts `hop` frames after hop h.
    """
    hops, candidates = own.shape
    overlap = paths.shape[2] - hop
    best, came_from = own[0].copy(), np.zeros((hops, candidates), dtype=int)
    for h in range(1, hops):
        earlier = paths[h - 1, :, hop:].reshape(candidates, -1)
        later = paths[h, :, :overlap].reshape(candidates, -1)
        difference = np.square(earlier[:, None] - later[None]).sum(-1) / (overlap * paths.shape[3])
        total = best[:, None] + TRANSITION * difference
        came_from[h] = np.argmin(total, axis=0)
        best = total[came_from[h], np.arange(candidates)] + own[h]
    chosen = np.empty(hops, dtype=int)
    chosen[-1] = np.argmin(best)
    for h in range(hops - 1, 0, -1):
        chosen[h - 1] = came_from[h, chosen[h]]
    return chosen


def choose_next(own: Array, paths: Array, current: Array | None) -> int:
    """The causal choice (section 4, stage 2 of the paper): the candidate of one frame that continues the current sequence best.

    own [K]; paths [K, S, J, 3]; current [S, J, 3] is the sequence chosen one frame earlier.
    """
    if current is None:
        return int(np.argmin(own))
    return int(np.argmin(own + TRANSITION * _distance(paths[:, :-1], current[None, 1:])))


def agreement(paths: Array, chosen: int) -> Array:
    """Weights [K], summing to 1, of candidates [K, S, J, 3] by how near they are to the chosen one: their mean is steadier than it is."""
    weights = np.exp(-_distance(paths, paths[chosen][None]) / (2 * NEAR**2))
    return weights / weights.sum()
