"""BVH files: any dialect in, one dialect out.

Reading turns the file's axes and unit into the engine's (Z up, metres) once, here. A BVH file names neither, so both are guessed from
the body and reported. The rest pose stays the file's own, whatever it is: zero rotations do not have to be a T-pose.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path
from typing import NamedTuple, NoReturn, TextIO

import numpy as np

from ..errors import InputError
from .motion import Motion, forward_kinematics
from .resample import frame_times, resample
from .rotations import Array, continuous_euler, euler_from_quat, quat_from_euler
from .skeleton import Skeleton

# Engine axes from the file's, p' = C p. Both are rotations, so R' = C R Cᵀ turns the axis of R by C and keeps its angle.
AXES = {
    "Y": np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], dtype=np.float32),
    "Z": np.eye(3, dtype=np.float32),
}

# Metres per unit. The raw units of the CMU library are inches at the scale 0.45.
BODY_UNITS = {"m": 1.0, "cmu": 0.0254 / 0.45, "inch": 0.0254, "cm": 0.01, "mm": 0.001}
HAND_UNITS = {"m": 1.0, "dm": 0.1, "inch": 0.0254, "cm": 0.01, "mm": 0.001}
BODY_REACH = 1.25  # metres from the hips along the bones to the farthest end of the skeleton: 1.0 to 1.6 for adults
HAND_REACH = 0.16  # the same from the wrist

# Frame rates in use: a frame time stands for one of them if it reads like it to the digits that the file gives. The video rates come second.
USUAL_RATES = ((24, 25, 30, 48, 50, 60, 72, 80, 90, 100, 120, 144, 150, 180, 200, 240, 250, 300, 360, 480, 500, 1000), (24 / 1.001, 30 / 1.001, 60 / 1.001))

STILL = 5e-5  # a joint that moves in its parent by less than this share of the skeleton's reach does not move


@dataclass(frozen=True)
class BvhFile:
    """A BVH file as it was understood.

    motion           engine axes, metres; times from 0
    unit             "m", "cm", "mm", "dm", "inch" or "cmu" (the CMU library's raw unit), with its size and why it was chosen
    up_axis          "Y" or "Z", and why
    frame_time       seconds, as the file gives it; the motion's times follow the usual rate that it stands for
    frames_declared  frame count in the header, or None; the motion holds what is really there
    channels         values per frame
    rotation_orders  the distinct orders of the rotation channels, for example ("ZXY",)
    moving_joints    names of the joints other than the root that change their place in their parent
    warnings         one sentence each
    """

    motion: Motion
    unit: str
    unit_to_metres: float
    unit_reason: str
    up_axis: str
    up_axis_reason: str
    frame_time: float
    frames_declared: int | None
    channels: int
    rotation_orders: tuple[str, ...]
    moving_joints: tuple[str, ...]
    warnings: tuple[str, ...]


def read_bvh(path: str | Path) -> Motion:
    """The motion in a BVH file, in engine axes and metres; InputError if it is not a sound BVH file."""
    return read_bvh_file(path).motion


def read_bvh_file(path: str | Path) -> BvhFile:
    """The motion in a BVH file and everything that was found out about the file; InputError if it is not a sound BVH file."""
    notes: list[str] = []
    try:
        with Path(path).open(encoding="utf-8-sig", errors="replace") as file:
            lines = _Lines(path, file)
            nodes = _read_hierarchy(lines)
            header = _read_motion_header(lines)
            values = _read_rows(lines, sum(len(node.channels) for node in nodes))
    except OSError as error:
        raise InputError(path, f"cannot be read ({error.strerror}); give an existing BVH file") from error

    if header.frames is None:
        notes.append(f"the header gives no frame count; the file holds {len(values)} frames")
    elif header.frames != len(values):
        notes.append(f"the header declares {header.frames} frames, the file holds {len(values)}; all {len(values)} were read")
    skeleton = _skeleton(nodes, notes)
    raw, moving = _raw_motion(skeleton, nodes, values, _frame_step(header.time_text))
    unit, metres, unit_reason = _guess_unit(skeleton)
    up_axis, up_axis_reason = _guess_up_axis(raw)
    return BvhFile(
        motion=_to_engine(raw, AXES[up_axis], metres),
        unit=unit,
        unit_to_metres=metres,
        unit_reason=unit_reason,
        up_axis=up_axis,
        up_axis_reason=up_axis_reason,
        frame_time=float(header.time_text),
        frames_declared=header.frames,
        channels=values.shape[1],
        rotation_orders=tuple(dict.fromkeys(node.rotation_order for node in nodes if node.rotation_order)),
        moving_joints=moving,
        warnings=tuple(notes),
    )


# Reading the text


@dataclass
class _Node:
    name: str
    parent: int
    offset: tuple[float, ...] | None = None
    channels: list[str] = field(default_factory=list)
    tip: tuple[float, ...] | None = None

    @property
    def rotation_order(self) -> str:
        return "".join(channel[0] for channel in self.channels if channel.endswith("rotation")).upper()


class _MotionHeader(NamedTuple):
    frames: int | None
    time_text: str


class _Lines:
    """The lines of a file, read once, and the number of the one just read."""

    def __init__(self, path: str | Path, file: TextIO) -> None:
        self.path = path
        self.number = 0
        self._file = file

    def __iter__(self) -> Iterator[str]:
        for line in self._file:
            self.number += 1
            yield line

    def words(self) -> Iterator[str]:
        for line in self:
            yield from re.findall(r"[{}]|[^\s{}]+", line)

    def fail(self, what: str) -> NoReturn:
        raise InputError(self.path, f"line {self.number}: {what}")


def _read_hierarchy(lines: _Lines) -> list[_Node]:
    """Joints, parents first, up to and including the line MOTION."""
    words = lines.words()
    if next(words, "").upper() != "HIERARCHY":
        raise InputError(lines.path, "not a BVH file; one begins with the word HIERARCHY")

    def following() -> str:
        word = next(words, None)
        if word is None:
            lines.fail("the file ends inside the hierarchy; it is truncated, a whole one has MOTION and its frames after it")
        return word

    def numbers(count: int, of: str) -> tuple[float, ...]:
        texts = [following() for _ in range(count)]
        try:
            values = tuple(float(text) for text in texts)
        except ValueError:
            lines.fail(f"{of} {' '.join(texts)}: expected {count} number{'s' * (count > 1)}")
        if not np.isfinite(values).all():
            lines.fail(f"{of} {' '.join(texts)}: expected finite numbers")
        return values

    nodes: list[_Node] = []
    opened: list[int] = []  # indices of the joints around the current word; an end site repeats its joint's
    while (word := following().upper()) != "MOTION":
        node = nodes[opened[-1]] if opened else None
        in_end_site = len(opened) > 1 and opened[-1] == opened[-2]
        if word in ("ROOT", "JOINT", "END"):
            name = " ".join(iter(following, "{"))
            if in_end_site or (word == "ROOT") != (node is None):
                lines.fail(f"{word} {name} is out of place; a ROOT stands at the top, a JOINT or End Site inside a ROOT or JOINT")
            if word != "END":
                nodes.append(_Node(name or f"joint{len(nodes)}", parent=opened[-1] if opened else -1))
            opened.append(opened[-1] if word == "END" else len(nodes) - 1)
        elif word == "}" and node is not None:
            if node.offset is None:
                lines.fail(f"{node.name} has no OFFSET; every joint needs one")
            opened.pop()
        elif word == "OFFSET" and node is not None:
            setattr(node, "tip" if in_end_site else "offset", numbers(3, "OFFSET"))
        elif word == "CHANNELS" and node is not None and not in_end_site:
            (count,) = numbers(1, "CHANNELS")
            node.channels = [following().lower() for _ in range(int(count))]
            for channel in node.channels:
                if not re.fullmatch("[xyz](position|rotation)", channel):
                    lines.fail(f"{channel!r} is not a channel; {node.name} announces {count:.0f} of Xposition … Zrotation")
        else:
            lines.fail(f"{word!r} is not expected here; a hierarchy holds ROOT, JOINT, End Site, OFFSET, CHANNELS and matching braces")
    if opened:
        lines.fail(f"MOTION begins while {nodes[opened[-1]].name} is still open; a closing brace is missing")
    if not any(node.channels for node in nodes):
        lines.fail("the hierarchy has no channels; a ROOT with CHANNELS is the least")
    return nodes


def _read_motion_header(lines: _Lines) -> _MotionHeader:
    frames = None
    for line in lines:
        key, _, value = (part.strip() for part in line.partition(":"))
        match key.lower().split():
            case ["frames"]:
                frames = int(value) if value.isdecimal() else None
            case ["frame", "time"]:
                try:
                    seconds = float(value)
                except ValueError:
                    seconds = np.nan
                if not (np.isfinite(seconds) and seconds > 0):
                    lines.fail(f"the frame time is {value!r}; it must be a number of seconds above 0")
                return _MotionHeader(frames, value)
            case [_, *_]:
                break
    raise InputError(lines.path, "no line 'Frame Time: SECONDS' after MOTION; it must stand before the frames")


def _read_rows(lines: _Lines, channels: int) -> Array:
    """Frames float32 [T, channels]. Line by line: the text is never held, and a defect is found where it is."""
    numbers: list[int] = []

    def rows() -> Iterator[Array]:
        for line in lines:
            try:
                row = np.fromstring(line, dtype=np.float32, sep=" ")
            except (DeprecationWarning, ValueError):
                row = np.empty(0, dtype=np.float32)
            if len(row) == channels:
                numbers.append(lines.number)
                yield row
            elif line.strip():
                _explain_row(lines, line.split(), channels)

    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # how numpy reports text that is not a number
        values = np.fromiter(rows(), dtype=np.dtype((np.float32, channels)))
    if not len(values):
        raise InputError(lines.path, "no frames after 'Frame Time'; a motion needs at least one")
    finite = np.isfinite(values).all(axis=1)
    if not finite.all():
        lines.number = numbers[int(np.argmin(finite))]
        lines.fail("a value is not finite or far too large; every value of a frame must be a number within reason")
    return np.asarray(values, dtype=np.float32)


def _explain_row(lines: _Lines, texts: list[str], channels: int) -> NoReturn:
    for text in texts:
        try:
            float(text)
        except ValueError:
            lines.fail(f"{text!r} is not a number; a frame is {channels} of them")
    lines.fail(f"{len(texts)} values; the channels of the hierarchy ask for {channels} in every frame")


# From text to motion


def _skeleton(nodes: list[_Node], notes: list[str]) -> Skeleton:
    """The skeleton in the file's own axes and unit."""
    names: list[str] = []
    for node in nodes:
        name, count = node.name, 1
        while name in names:
            count += 1
            name = f"{node.name}_{count}"
        if count > 1:
            notes.append(f"a second joint is called {node.name}; it became {name}")
        names.append(name)
    return Skeleton(
        names=tuple(names),
        parents=np.array([node.parent for node in nodes]),
        offsets=np.array([node.offset for node in nodes], dtype=np.float32),
        tips=np.array([node.tip or (np.nan,) * 3 for node in nodes], dtype=np.float32),
    )


def _raw_motion(skeleton: Skeleton, nodes: list[_Node], values: Array, step: float) -> tuple[Motion, tuple[str, ...]]:
    """The motion in the file's own axes and unit, and the names of the joints that move in their parent."""
    still = STILL * _reach(skeleton)
    rotations = np.zeros((len(values), len(nodes), 4), dtype=np.float32)
    rotations[..., 0] = 1
    places: dict[int, Array] = {}
    column = 0
    for joint, node in enumerate(nodes):
        block = values[:, column : column + len(node.channels)]
        column += len(node.channels)
        turns = [i for i, channel in enumerate(node.channels) if channel.endswith("rotation")]
        if turns:
            rotations[:, joint] = quat_from_euler(np.radians(block[:, turns]), node.rotation_order)
        moves = [i for i, channel in enumerate(node.channels) if channel.endswith("position")]
        if moves or joint == 0:
            place = np.repeat(skeleton.offsets[joint, None], len(values), axis=0)
            for i in moves:  # a position replaces the offset
                place[:, "xyz".index(node.channels[i][0])] = block[:, i]
            if joint == 0 or np.abs(place - skeleton.offsets[joint]).max() > still:
                places[joint] = place
    root = places.pop(0)
    offsets = None
    if places:
        offsets = np.repeat(skeleton.offsets[None], len(values), axis=0)
        for joint, place in places.items():
            offsets[:, joint] = place
    motion = Motion(skeleton, np.arange(len(values)) * step, root, rotations, offsets)
    return motion, tuple(skeleton.names[joint] for joint in places)


def _to_engine(raw: Motion, axes: Array, metres: float) -> Motion:
    matrix = axes.T * np.float32(metres)
    raw.rotations[..., 1:] = raw.rotations[..., 1:] @ axes.T
    skeleton = Skeleton(raw.skeleton.names, raw.skeleton.parents, raw.skeleton.offsets @ matrix, raw.skeleton.tips @ matrix)
    return Motion(skeleton, raw.times, raw.root @ matrix, raw.rotations, None if raw.offsets is None else raw.offsets @ matrix)


def _frame_step(text: str) -> float:
    """Seconds per frame: exactly those of a usual rate if the text is that number written with fewer digits."""
    given = Decimal(text)
    digits = -int(given.as_tuple().exponent)
    for rates in USUAL_RATES:
        steps = [1 / rate for rate in rates if round(Decimal(1 / rate), digits) == given]
        if steps:
            return min(steps, key=lambda step: abs(step - float(given)))
    return float(given)


# What the file does not say


def _reach(skeleton: Skeleton) -> float:
    """How far the skeleton reaches from its first fork (the hips, the wrist), measured along the bones; the same in every pose."""
    children = [np.flatnonzero(skeleton.parents == joint) for joint in range(len(skeleton))]
    fork = 0
    while len(children[fork]) == 1:
        fork = children[fork][0]
    lengths = np.linalg.norm(skeleton.offsets, axis=-1)
    ends = np.nan_to_num(np.linalg.norm(skeleton.tips, axis=-1))
    distance = {fork if len(children[fork]) else 0: 0.0}
    for joint, parent in enumerate(skeleton.parents):
        if parent in distance and joint not in distance:
            distance[joint] = distance[parent] + float(lengths[joint])
    return max(length + float(ends[joint]) for joint, length in distance.items())


def _joints_like(skeleton: Skeleton, *patterns: str) -> list[int]:
    """Joints whose name holds the first of the patterns that any name holds."""
    for pattern in patterns:
        found = [i for i, name in enumerate(skeleton.names) if re.search(pattern, name, re.IGNORECASE)]
        if found:
            return found
    return []


def _guess_unit(skeleton: Skeleton) -> tuple[str, float, str]:
    """The unit in which the skeleton comes closest to the size of a person (or of a hand): its name, metres, and why."""
    reach = _reach(skeleton)
    hand = bool(_joints_like(skeleton, "thumb|finger")) and not _joints_like(skeleton, "leg|thigh|foot|ankle|knee|head")
    units, usual, origin = (HAND_UNITS, HAND_REACH, "wrist") if hand else (BODY_UNITS, BODY_REACH, "hips")
    if reach <= 0:
        return "cm", BODY_UNITS["cm"], "the skeleton has no size; centimetres are assumed"
    unit = min(units, key=lambda name: abs(np.log(reach * units[name] / usual)))
    return unit, units[unit], f"from the {origin} along the bones it is {reach:.4g} units to the farthest end: {reach * units[unit]:.2f} m in {unit}"


def _guess_up_axis(raw: Motion) -> tuple[str, str]:
    """The axis along which the head is above the feet most of the time; Y, the custom of the format, unless Z is clearly it."""
    head = _joints_like(raw.skeleton, r"head(?!.*(eye|dummy))", "neck", "chest|spine")
    feet = _joints_like(raw.skeleton, "toe|foot|ankle")
    if not head or not feet:
        return "Y", "no head and feet by name; Y is the custom of the format"
    some = np.linspace(0, len(raw) - 1, min(len(raw), 100)).astype(int)
    _, positions = forward_kinematics(raw.skeleton, raw.root[some], raw.rotations[some], None if raw.offsets is None else raw.offsets[some])
    _, y, z = np.mean(positions[:, head].mean(axis=1) - positions[:, feet].mean(axis=1), axis=0)
    axis = "Z" if abs(z) > 2 * abs(y) else "Y"
    share = abs(z if axis == "Z" else y) / max(float(np.hypot(y, z)), 1e-9)
    return axis, f"the head is above the feet along {axis} ({share:.0%} of the distance) on average over the motion"


# Writing


ORDER = "ZXY"


def write_bvh(path: str | Path, motion: Motion) -> None:
    """Writes a motion: Y up, centimetres, rotations in the order ZXY, positions only on the root and on joints that move in their parent.

    World positions stay what they are. A motion with uneven times is resampled at its median rate, because BVH knows only one.
    """
    rate = motion.rate or 30.0
    even = motion.times[0] + np.arange(len(motion)) / rate
    if np.abs(even - motion.times).max() > 1e-3 / rate:
        motion = resample(motion, frame_times(motion.times[0], motion.times[-1], rate))
    skeleton = motion.skeleton
    to_file = AXES["Y"].astype(np.float64) * 100  # p = Cᵀ p', for rows of vectors
    moving = {0} if motion.offsets is None else {0, *np.flatnonzero(np.abs(motion.offsets - skeleton.offsets).max(axis=(0, 2)) > 1e-6)}
    columns: list[Array] = []
    for joint in range(len(skeleton)):
        if joint in moving:
            columns.append((motion.root if joint == 0 or motion.offsets is None else motion.offsets[:, joint]) @ to_file)
        quaternion = motion.rotations[:, joint].astype(np.float64)
        quaternion[:, 1:] = quaternion[:, 1:] @ AXES["Y"]
        columns.append(np.degrees(continuous_euler(euler_from_quat(quaternion, ORDER))))
    values = np.concatenate(columns, axis=1)

    with Path(path).open("w", encoding="utf-8", newline="\n") as file:
        file.write("HIERARCHY\n")
        for joint in np.flatnonzero(skeleton.parents < 0):
            file.writelines(_hierarchy_lines(skeleton, int(joint), moving, to_file, 0))
        file.write(f"MOTION\nFrames: {len(motion)}\nFrame Time: {1 / rate:.8f}\n")
        row = " ".join(["%.4f"] * values.shape[1]) + "\n"
        file.writelines(row % tuple(frame) for frame in values)


def _hierarchy_lines(skeleton: Skeleton, joint: int, moving: set[int], to_file: Array, depth: int) -> Iterator[str]:
    tab = "\t" * depth
    rotations = " ".join(f"{axis}rotation" for axis in ORDER)
    yield f"{tab}{'JOINT' if depth else 'ROOT'} {skeleton.names[joint]}\n{tab}{{\n"
    yield f"{tab}\tOFFSET {_vector(skeleton.offsets[joint] @ to_file)}\n"
    yield f"{tab}\tCHANNELS 6 Xposition Yposition Zposition {rotations}\n" if joint in moving else f"{tab}\tCHANNELS 3 {rotations}\n"
    for child in np.flatnonzero(skeleton.parents == joint):
        yield from _hierarchy_lines(skeleton, int(child), moving, to_file, depth + 1)
    if np.isfinite(skeleton.tips[joint]).all():
        yield f"{tab}\tEnd Site\n{tab}\t{{\n{tab}\t\tOFFSET {_vector(skeleton.tips[joint] @ to_file)}\n{tab}\t}}\n"
    yield f"{tab}}}\n"


def _vector(v: Array) -> str:
    return " ".join(f"{x:.6f}" for x in v)
