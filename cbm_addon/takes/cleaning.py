"""Cleaning: spikes are taken out, jumps of the whole tracking space are found and may be joined, and a take is held or split where nothing
was recorded."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..motion.rotations import Array, difference, inverse, multiply, quat_from_yaw, rotate, slerp, yaw_from_quat
from .gaps import SHORT_GAP
from .take import DEVICES, HEAD, Take

LONGEST_SPIKE = 4  # samples, and
SPIKE_SECONDS = 0.1
SPIKE_ACCELERATION = {"head": 600.0, "left": 2500.0, "right": 2500.0}
"""Metres per second squared, there and back: in sound recordings of people who throw and swing, heads stay under 210 and hands under 2100."""
SPIKE_TURN = {"head": 5000.0, "left": 20000.0, "right": 20000.0}
"""Radians per second squared: heads stay under 530, hands under 10800."""
SPIKE_SIZE = (0.05, np.radians(15))  # metres and radians: whatever is smaller harms nobody
SPIKE_STEP = 0.75  # of a spike's size: the steps there and back

FASTEST_HAND = 25.0  # metres per second

TELEPORT_STEP, TELEPORT_SPEED = 0.3, 10.0  # metres and metres per second of a head: in sound recordings under 3.5 m/s
SNAP_TURN, SNAP_SPEED = np.radians(15), np.radians(1500)  # radians and radians per second of a head: there under 760°/s
CALM = 1 / 3  # of a jump: what the steps beside it may be. Spinning kicks turn a head by 1900°/s, but not from one sample to the next

HELD_RATE = 30.0  # samples a second where a take is held


def spikes(times: np.ndarray, positions: Array, rotations: Array, tracked: np.ndarray) -> np.ndarray:
    """Bool [T, 3]: tracked samples, a few at a time, that leave the way of their device and are back at once, faster than anybody can; or
    that are as far off right after or before a loss.

    Times [T], poses [T, 3, 3] and [T, 3, 4] in metres, bool [T, 3].
    """
    found = np.zeros_like(tracked)
    for device, name in enumerate(DEVICES):
        seen = np.flatnonzero(tracked[:, device])
        if len(seen) < 2:
            continue
        own = _spikes(times[seen], positions[seen, device], rotations[seen, device], SPIKE_ACCELERATION[name], SPIKE_TURN[name])
        found[seen[own | _torn_ends(seen, times[seen], positions[seen, device])], device] = True
    return found


def _spikes(times: np.ndarray, positions: Array, rotations: Array, acceleration: float, turn: float) -> np.ndarray:
    """Bool [N], of one device. All of a spike happens in the step there and the step back: samples beside a longer one are off their
    neighbours' way too, but not by steps of that size."""
    found = np.zeros(len(times), dtype=bool)
    step = np.linalg.norm(np.diff(positions, axis=0), axis=-1)
    turned = difference(rotations[1:], rotations[:-1])
    large = (step > SPIKE_STEP * SPIKE_SIZE[0]) | (turned > SPIKE_STEP * SPIKE_SIZE[1])
    for length in range(1, LONGEST_SPIKE + 1):
        before = np.flatnonzero(large[:-length] & large[length:])
        after = before + length + 1
        seconds = times[after] - times[before]
        off, askew = np.full(len(before), np.inf), np.full(len(before), np.inf)
        for inside in range(1, length + 1):
            share = (times[before + inside] - times[before]) / seconds
            way = positions[before] + (positions[after] - positions[before]) * share[:, None]
            off = np.minimum(off, np.linalg.norm(positions[before + inside] - way, axis=-1))
            askew = np.minimum(askew, difference(slerp(rotations[before], rotations[after], share), rotations[before + inside]))
        strength = 8 / seconds**2  # the acceleration that goes a distance of 1 and comes back in that time
        moved = (off > SPIKE_SIZE[0]) & (off * strength > acceleration) & (np.minimum(step[before], step[after - 1]) > SPIKE_STEP * off)
        spun = (askew > SPIKE_SIZE[1]) & (askew * strength > turn) & (np.minimum(turned[before], turned[after - 1]) > SPIKE_STEP * askew)
        for start in before[(moved | spun) & (seconds < SPIKE_SECONDS)]:
            found[start + 1 : start + length + 1] = True
    return found


def _torn_ends(rows: np.ndarray, times: np.ndarray, positions: Array) -> np.ndarray:
    """Bool [N], of one device's tracked samples in those rows: the first or last few of a stretch, and the rest of it out of their reach."""
    found = np.zeros(len(rows), dtype=bool)
    impossible = np.linalg.norm(np.diff(positions, axis=0), axis=-1) > FASTEST_HAND * np.diff(times)
    lost = np.flatnonzero(np.diff(rows) > 1) + 1
    for start, end in zip([0, *lost], [*lost, len(rows)], strict=True):
        steps = np.flatnonzero(impossible[start : end - 1]) + start + 1
        for step in steps[times[steps - 1] - times[start] < SPIKE_SECONDS]:
            found[start:step] = True
        for step in steps[times[end - 1] - times[steps] < SPIKE_SECONDS]:
            found[step:end] = True
    return found


def teleports(times: np.ndarray, positions: Array, rotations: Array, tracked: np.ndarray) -> np.ndarray:
    """Indices of the samples before which the head is suddenly elsewhere or turned elsewhere, and stays: poses in engine axes.

    A recentred tracking space, a game that moves or turns the player at once.
    """
    seen = np.flatnonzero(tracked[:, HEAD])
    seconds = np.diff(times[seen])
    step = np.linalg.norm(np.diff(positions[seen, HEAD], axis=0), axis=-1)
    turn = np.abs(_yaw_steps(rotations[seen, HEAD]))
    moved = (step > TELEPORT_STEP) & (step / seconds > TELEPORT_SPEED) & _lonely(step)
    turned = (turn > SNAP_TURN) & (turn / seconds > SNAP_SPEED) & _lonely(turn)
    return seen[1:][moved | turned]


def _lonely(steps: np.ndarray) -> np.ndarray:
    """Bool [N]: steps beside which hardly anything happens."""
    around = np.pad(steps, 1)
    return np.maximum(around[:-2], around[2:]) < CALM * steps


def joined(positions: Array, rotations: Array, tracked: np.ndarray, jumps: np.ndarray) -> tuple[Array, Array]:
    """The poses with everything after each of the `jumps` moved and turned about Z, so that the head goes on where it was."""
    positions, rotations = positions.copy(), rotations.copy()
    seen = np.flatnonzero(tracked[:, HEAD])
    for jump in jumps:
        last = seen[np.searchsorted(seen, jump) - 1]
        turn = quat_from_yaw(-_yaw_steps(rotations[[last, jump], HEAD])[0])
        pivot = positions[jump, HEAD].copy()
        positions[jump:] = positions[last, HEAD] + rotate(turn, positions[jump:] - pivot)
        rotations[jump:] = multiply(turn, rotations[jump:])
    return positions, rotations


def _yaw_steps(rotations: Array) -> Array:
    """Turns about Z from each sample to the next, -pi to pi."""
    return (yaw_from_quat(multiply(rotations[1:], inverse(rotations[:-1]))) + np.pi) % (2 * np.pi) - np.pi


def hold_gaps(take: Take) -> Take:
    """The take with samples, none of them tracked, where nothing was recorded for longer than SHORT_GAP: there it is held, not stretched."""
    gaps = np.flatnonzero(np.diff(take.times) > SHORT_GAP)
    if not len(gaps):
        return take
    inner = [np.linspace(take.times[gap], take.times[gap + 1], int((take.times[gap + 1] - take.times[gap]) * HELD_RATE) + 1)[1:-1] for gap in gaps]
    counts = [len(times) for times in inner]
    source = np.insert(np.arange(len(take)), np.repeat(gaps + 1, counts), np.repeat(gaps, counts))
    new = np.insert(np.zeros(len(take), dtype=bool), np.repeat(gaps + 1, counts), True)
    return replace(
        take,
        times=np.insert(take.times, np.repeat(gaps + 1, counts), np.concatenate(inner)),
        positions=np.where(new[:, None, None], np.float32(np.nan), take.positions[source]),
        rotations=np.where(new[:, None, None], np.float32(np.nan), take.rotations[source]),
        tracked=take.tracked[source] & ~new[:, None],
        extras={name: values[source] for name, values in take.extras.items()},
    )


def split(take: Take, seconds: float) -> list[Take]:
    """The stretches of a take between times of at least `seconds` without the head, and between teleports, each from time 0.

    Stretches of a single sample are left out.
    """
    seen = np.flatnonzero(take.tracked[:, HEAD])
    starts = seen[1:][np.diff(take.times[seen]) >= seconds]
    starts = np.union1d(starts, teleports(take.times, take.positions, take.rotations, take.tracked)).astype(int)
    pieces = []
    for first, end in zip([seen[0], *starts], [*starts, seen[-1] + 1], strict=True):
        last = seen[seen < end][-1]
        if last > first:
            pieces.append(_stretch(take, slice(first, last + 1), f"{take.name}_{len(pieces) + 1}"))
    return pieces


def _stretch(take: Take, rows: slice, name: str) -> Take:
    return replace(
        take,
        name=name,
        times=take.times[rows] - take.times[rows.start],
        positions=take.positions[rows],
        rotations=take.rotations[rows],
        tracked=take.tracked[rows],
        extras={key: values[rows] for key, values in take.extras.items()},
    )
