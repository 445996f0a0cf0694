"""Stages 1 and 2: from a calibrated take to a performance, looking ahead over the whole take or causally."""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, replace

import numpy as np

from ..features import CONTROL, LOWER_BODY, LOWER_JOINTS, RATE, UPPER_JOINTS, Frames, tracker_frames
from ..motion.ground_frame import GroundFrame
from ..motion.resample import frame_times, lerp_samples, slerp_samples
from ..motion.rotations import Array, quat_from_sixd
from ..progress import Progress, part
from ..takes.take import Take
from .candidates import agreement, choose_next, choose_path, draw, gumbel_noise, own_cost
from .idle import settle
from .manner import draw_manner
from .mirroring import mean, mirror_performance, mirror_take
from .miscalibration import find_miscalibration
from .models import Estimate, Model, ModeNetworks
from .performance import Performance
from .sharpen import sharpened

HOP = 5  # frames between the sequences of look-ahead mode
FORGET = 3  # frames after which what was predicted counts a third, in causal mode
BATCH = 64  # anchors per network call
HEIGHTS = {"lookahead": (0.97, 1.03), "causal": (1.0,)}  # shares of the head height for which a take is asked


@dataclass(frozen=True)
class SolveOptions:
    """mode "lookahead" (the whole take is known) or "causal" (nothing later than the frame is used); K candidates; variation 0 is the most
    agreed answer, others have another manner and, every second one, other steps; the same seed gives the same motion."""

    mode: str = "lookahead"
    candidates: int = 16
    variation: int = 0
    seed: int = 0


def at_rate(take: Take, rate: float = RATE) -> Take:
    """A calibrated take sampled at a steady rate from its start."""
    return sampled(take, frame_times(take.times[0], take.times[-1], rate))


def sampled(take: Take, times: np.ndarray) -> Take:
    """A calibrated take at other times (clamped to its own)."""
    before = np.clip(np.searchsorted(take.times, times, side="right") - 1, 0, len(take.times) - 1)
    return replace(
        take,
        times=times,
        positions=lerp_samples(take.times, take.positions, times),
        rotations=slerp_samples(take.times, take.rotations, times),
        tracked=take.tracked[before],
        extras={name: values[before] for name, values in take.extras.items()},
    )


def perform(take: Take, head_height: float, proportions: Array, model: Model, options: SolveOptions) -> Generator[Progress, None, Performance]:
    """Stages 1 and 2 on a calibrated take; `head_height` is the standing height of the head joint, metres, and `proportions` [P] those of
    the body that is to move (features.proportions_of).

    Half of the candidates answer the take's mirror image; looking ahead, half of either answer a smaller performer and half a taller one. The performance
    is the mean of all. A variation other than 0 has a manner of its own (manner.py), and every second one steps as one answer alone, which is more
    decided.
    """
    take = at_rate(take)
    networks = model.networks(options.mode)
    miscalibration = find_miscalibration(take, head_height, networks)
    seen, true_height = miscalibration.corrected(take), head_height * miscalibration.height
    if _decided(options.variation) or options.candidates == 1:
        answer = yield from _perform(seen, true_height, proportions, networks, options)
    else:
        answer = yield from _asked_often(seen, true_height, proportions, networks, options)
    manner = draw_manner(networks.manners, options.seed, options.variation)
    return replace(settle(sharpened(answer.measured_in(head_height)), take), manner=manner, miscalibration=miscalibration)


def _asked_often(take: Take, head_height: float, proportions: Array, networks: ModeNetworks, options: SolveOptions) -> Generator[Progress, None, Performance]:
    """The mean of what is answered to the take and to its mirror image, by performers of all HEIGHTS; the candidates are divided among them."""
    heights = [head_height * share for share in HEIGHTS[options.mode]]
    questions = [(height, mirrored) for height in heights for mirrored in (False, True)]
    few = replace(options, candidates=-(-options.candidates // len(questions)))
    answers = []
    for i, (height, mirrored) in enumerate(questions):
        job = _perform(mirror_take(take) if mirrored else take, height, proportions, networks, few)
        answer = yield from part(job, i / len(questions), (i + 1) / len(questions))
        answers.append((mirror_performance(answer) if mirrored else answer).measured_in(head_height))
    return mean(answers)


def calibration_warnings(take: Take, head_height: float, model: Model, options: SolveOptions) -> list[str]:
    """What looks wrong with the calibration of a take to the networks that solve it, a sentence each."""
    return find_miscalibration(at_rate(take), head_height, model.networks(options.mode)).warnings()


def _decided(variation: int) -> bool:
    """Whether a variation is one answer rather than the one that most candidates agree on."""
    return variation > 0 and variation % 2 == 0


def _perform(take: Take, head_height: float, proportions: Array, networks: ModeNetworks, options: SolveOptions) -> Generator[Progress, None, Performance]:
    """One answer to a take sampled at RATE."""
    trackers, anchors = tracker_frames(take, head_height)
    causal = options.mode == "causal"
    frames = np.arange(0, len(take.times), 1 if causal else HOP)
    sampler = _Sampler(networks, trackers, anchors, proportions, options)
    if causal:
        control, lower = yield from part(_sample_causally(sampler, frames), 0, 0.95)
    else:
        control, lower = yield from part(_sample_whole(sampler, frames), 0, 0.95)
    yield Progress(0.95, "joining sequences")
    weights = _past_weights(networks) if causal else _overlap_weights(networks)
    join = Join(len(take.times), frames, networks.mode.sequence, weights)
    return join_performance(take.times, join, control, *lower, head_height, causal)


class _Sampler:
    """Draws and decodes codes for anchors of one take."""

    def __init__(self, networks: ModeNetworks, trackers: Frames, anchors: GroundFrame, proportions: Array, options: SolveOptions) -> None:
        self.networks, self.trackers, self.anchors, self.proportions = networks, trackers, anchors, proportions
        self.consensus = not _decided(options.variation)
        self.noise = gumbel_noise(options.candidates, networks.channels, networks.classes, options.seed, 0 if self.consensus else options.variation)

    def estimate(self, frames: np.ndarray) -> Estimate:
        windows = self.trackers.seen_from(self.anchors[frames], frames[:, None] + np.array(self.networks.mode.window))
        return self.networks.estimate(windows, self.proportions)

    def control(self, estimate: Estimate, frames: np.ndarray) -> Array:
        """Stage 1 in world axes: vectors [N, S, V, 3]."""
        return Frames.to_world(CONTROL, estimate.control, self.anchors[frames])[0]

    def decode(self, codes: np.ndarray, features: Array, frames: np.ndarray) -> tuple[Array, Array]:
        """Stage 2 in world axes: vectors [N, K, S, V, 3] and contacts [N, K, S, 4] of codes int [N, K, C] and features [N, H]."""
        count, candidates = codes.shape[:2]
        sequences = self.networks.decode(codes.reshape(count * candidates, -1), np.repeat(features, candidates, axis=0))
        return Frames.to_world(LOWER_BODY, sequences.reshape(count, candidates, *sequences.shape[1:]), self.anchors[frames])

    def cost(self, paths: Array, control: Array) -> Array:
        return own_cost(paths, control[:, :, CONTROL.points.index("Hips.position")], self.consensus)


def _batches(frames: np.ndarray) -> list[np.ndarray]:
    return [frames[start : start + BATCH] for start in range(0, len(frames), BATCH)]


def _sample_whole(sampler: _Sampler, frames: np.ndarray) -> Generator[Progress, None, tuple[Array, tuple[Array, Array]]]:
    """Draws candidates for all hops, finds the best path through them, and decodes the winners in full."""
    controls, codes, features, paths = [], [], [], []
    for i, chunk in enumerate(_batches(frames)):
        yield Progress(0.8 * i * BATCH / len(frames), "sampling the codebook")
        estimate = sampler.estimate(chunk)
        controls.append(sampler.control(estimate, chunk))
        codes.append(draw(estimate.logits, sampler.noise))
        features.append(estimate.features)
        paths.append(sampler.decode(codes[-1], estimate.features, chunk)[0][..., : len(LOWER_JOINTS), :].copy())
    yield Progress(0.8, "choosing")
    control = np.concatenate(controls)
    candidates = np.concatenate(paths)
    chosen = choose_path(sampler.cost(candidates, control), candidates, HOP)
    winners = np.concatenate(codes)[np.arange(len(frames)), chosen][:, None]
    parts = []
    for i, chunk in enumerate(_batches(frames)):
        yield Progress(0.9 + 0.1 * i * BATCH / len(frames), "decoding")
        parts.append(sampler.decode(winners[i * BATCH : i * BATCH + len(chunk)], features[i], chunk))
    return control, _joined(parts)


def _sample_causally(sampler: _Sampler, frames: np.ndarray) -> Generator[Progress, None, tuple[Array, tuple[Array, Array]]]:
    """Draws candidates for every frame and keeps those that continue what was chosen before and agree with each other."""
    controls, parts, current = [], [], None
    for i, chunk in enumerate(_batches(frames)):
        yield Progress(i * BATCH / len(frames), "sampling the codebook")
        estimate = sampler.estimate(chunk)
        controls.append(sampler.control(estimate, chunk))
        vectors, contacts = sampler.decode(draw(estimate.logits, sampler.noise), estimate.features, chunk)
        paths = vectors[..., : len(LOWER_JOINTS), :]
        own = sampler.cost(paths, controls[-1])
        weights = np.zeros(own.shape, np.float32)
        for frame in range(len(chunk)):
            chosen = choose_next(own[frame], paths[frame], current)
            weights[frame] = agreement(paths[frame], chosen) if sampler.consensus else np.arange(len(own[frame])) == chosen
            current = np.tensordot(weights[frame], paths[frame], 1)
        parts.append(tuple(np.einsum("hk,hk...->h...", weights, values)[:, None] for values in (vectors, contacts)))
    return np.concatenate(controls), _joined(parts)


def _joined(parts: list[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Chosen vectors [H, S, V, 3] and contacts [H, S, 4] of all batches."""
    vectors, contacts = (np.concatenate(values)[:, 0] for values in zip(*parts, strict=True))
    return vectors, contacts


def _overlap_weights(networks: ModeNetworks) -> Array:
    """A raised cosine over the sequence: its middle counts most."""
    count = len(networks.mode.sequence)
    return (0.5 - 0.5 * np.cos(2 * np.pi * (np.arange(count) + 1) / (count + 1))).astype(np.float32)


def _past_weights(networks: ModeNetworks) -> Array:
    """Newer sequences count more; a frame is the mean of what was said of it until then."""
    return np.exp(-np.arange(len(networks.mode.sequence)) / FORGET).astype(np.float32)


class Join:
    """Overlap-add: sequences [H, S, ...] of all hops become frames [T, ...], weighted by their place in the sequence."""

    def __init__(self, count: int, frames: np.ndarray, offsets: tuple[int, ...], weights: Array) -> None:
        where = frames[:, None] + np.array(offsets)
        self.inside = (where >= 0) & (where < count)
        self.where, self.count = where[self.inside], count
        self.weights = np.broadcast_to(weights, where.shape)[self.inside]
        self.total = np.bincount(self.where, self.weights, count)

    def __call__(self, values: Array) -> Array:
        flat = values[self.inside].reshape(len(self.where), -1) * self.weights[:, None]
        summed = np.stack([np.bincount(self.where, column, self.count) for column in flat.T], axis=-1)
        return (summed / self.total[:, None]).reshape(self.count, *values.shape[2:]).astype(np.float32)


def join_performance(times: np.ndarray, join: Join, control: Array, vectors: Array, contacts: Array, head_height: float, causal: bool) -> Performance:
    """The frames of a take from control vectors [H, S, V, 3], chosen lower-body vectors [H, S, V, 3] and contacts [H, S, 4]."""
    joints = len(LOWER_JOINTS)
    positions = vectors[:, :, :joints]
    velocities = np.diff(positions, axis=1, prepend=2 * positions[:, :1] - positions[:, 1:2]) * np.float32(RATE)
    upper = control[:, :, -2 * len(UPPER_JOINTS) :]
    return Performance(
        times=times,
        lower_positions=join(positions),
        lower_velocities=join(velocities),
        lower_rotations=_rotations(join(vectors[:, :, joints:])),
        upper_rotations=_rotations(join(upper)),
        contacts=np.clip(join(contacts), 0, 1),
        head_height=head_height,
        causal=causal,
    )


def _rotations(axes: Array) -> Array:
    """Rotations [T, J, 4] from averaged first and second axes [T, 2 J, 3]."""
    return quat_from_sixd(axes.reshape(len(axes), -1, 6)).astype(np.float32)
