"""The data set: BVH clips become per-frame feature values; windows are cut from them when a batch is drawn."""

from __future__ import annotations

import zlib
from collections.abc import Generator, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from ..errors import InputError
from ..features import RATE, TRACKERS, Frames, Mode, control_frames, lower_body_frames, proportions_of, tracker_frames
from ..motion.bvh import read_bvh
from ..motion.ground_frame import GroundFrame, ground_frame
from ..motion.mirror import mirror
from ..motion.motion import Motion
from ..motion.repair import repaired
from ..motion.resample import frame_times, resample
from ..motion.rotations import Array, rotate
from ..motion.skeleton import BODY_JOINTS
from ..progress import Progress
from ..takes.synthesize import synthesize
from .augment import roughen, vary
from .split import split_of

MINIMUM_SECONDS = 1.5
SHOULDERS_LIMIT, HEAD_LIMIT = np.radians((90, 120))  # from the hips, in the middle of a clip's frames: nobody turns farther for half of the time


@dataclass(frozen=True)
class ClipFrames:
    """One clip as the networks see it, T frames at RATE: trackers and anchors as they are, the same as a rough recording has them
    (learn/augment.py), control, lower body, and the proportions [P] of the body."""

    stem: str
    trackers: Frames
    anchors: GroundFrame
    rough_trackers: Frames
    rough_anchors: GroundFrame
    control: Frames
    lower_body: Frames
    proportions: Array


def clip_frames(stem: str, motion: Motion, seed: int = 0) -> ClipFrames:
    """Features of a body motion sampled at RATE, in units of the skeleton's own standing head height; `seed` draws the rough recording."""
    head_height = motion.skeleton.height_above_toes("Head")
    take = synthesize(motion)
    trackers, anchors = tracker_frames(take, head_height)
    rough = tracker_frames(roughen(take, motion.skeleton.height_above_toes(), seed), head_height)
    control, lower_body = control_frames(motion, head_height), lower_body_frames(motion, head_height)
    return ClipFrames(stem, trackers, anchors, *rough, control, lower_body, proportions_of(motion.skeleton))


def find_clips(sources: list[Path]) -> list[Path]:
    """All BVH files named or under the folders named, in order of name."""
    found: list[Path] = []
    for source in sources:
        source = Path(source)
        if source.is_dir():
            found += sorted(source.rglob("*.bvh"))
        elif source.is_file():
            found.append(source)
        else:
            raise InputError(source, "does not exist; a BVH file or a folder of BVH files is expected")
    if not found:
        raise InputError(sources[0], "holds no BVH files; a folder of .bvh clips is expected")
    return found


def read_body_motion(path: Path) -> Motion:
    """A clip on the engine's joints at RATE, its frames repaired (motion/repair.py); InputError lists the joints that are missing."""
    motion = read_bvh(path)
    missing = [name for name in BODY_JOINTS if name not in motion.skeleton]
    if missing:
        raise InputError(path, f"lacks the joints {', '.join(missing)}; training needs clips with the joint names {', '.join(BODY_JOINTS)}")
    return repaired(resample(motion, frame_times(motion.times[0], motion.times[-1], RATE)))


def read_sound_motion(path: Path) -> Motion | None:
    """A clip as `read_body_motion` reads it, if it is long enough and not broken."""
    motion = read_body_motion(path)
    return motion if motion.seconds >= MINIMUM_SECONDS and stands_on_a_floor(motion) and faces_one_way(motion) else None


def stands_on_a_floor(motion: Motion) -> bool:
    """Whether the head stays above z = 0: where it does not, the clip's floor is not where its feet are."""
    return bool(motion.positions()[:, motion.skeleton.index("Head"), 2].min() > 0)


def faces_one_way(motion: Motion) -> bool:
    """Whether shoulders and head mostly face where the hips do: in broken recordings arms are on the wrong sides or the head looks backwards."""
    rotations, positions = motion.forward()
    skeleton = motion.skeleton

    def across(joint: str) -> Array:
        return (positions[:, skeleton.index(f"Left{joint}")] - positions[:, skeleton.index(f"Right{joint}")])[:, :2]

    hips, shoulders = across("UpLeg"), across("Arm")
    head = rotate(ground_frame(positions[:, skeleton.index("Head")], rotations[:, skeleton.index("Head")]).rotation, np.array([1, 0, 0], np.float32))[:, :2]
    return all(
        np.median(np.sum(hips * left, axis=-1)) > np.cos(limit) * np.median(np.linalg.norm(hips, axis=-1) * np.linalg.norm(left, axis=-1))
        for left, limit in ((shoulders, SHOULDERS_LIMIT), (head, HEAD_LIMIT))
    )


@dataclass(frozen=True)
class Dataset:
    """Clips of one split laid end to end. `first` and `last` int [F]: the clip borders of each frame, so that windows never mix clips.
    `proportions` float32 [F, P]: those of whose body each frame is."""

    trackers: Frames
    anchors: GroundFrame
    rough_trackers: Frames
    rough_anchors: GroundFrame
    control: Frames
    lower_body: Frames
    first: np.ndarray
    last: np.ndarray
    proportions: Array
    stems: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.first)

    def batch(self, frames: np.ndarray, mode: Mode, rough: np.ndarray | None = None) -> tuple[Array, Array, Array]:
        """Tracker windows [N, O, .], control [N, S, .] and lower body [N, S, .] of the frames int [N], seen from their anchors.

        rough  bool [N]: whose windows are those of a rough recording
        """

        def at(offsets: tuple[int, ...]) -> np.ndarray:
            return np.clip(frames[:, None] + np.array(offsets), self.first[frames, None], self.last[frames, None])

        anchors = self.anchors[frames]
        if rough is not None:
            other = self.rough_anchors[frames]
            anchors = GroundFrame(other.origin, np.where(rough[:, None], other.rotation, anchors.rotation))
        windows = self.trackers.seen_from(anchors, at(mode.window))
        if rough is not None:
            windows[rough] = self.rough_trackers.seen_from(anchors[rough], at(mode.window)[rough])
        return (
            windows,
            self.control.seen_from(anchors, at(mode.sequence)),
            self.lower_body.seen_from(anchors, at(mode.sequence)),
        )

    @cached_property
    def chances(self) -> np.ndarray:
        """How likely each frame is drawn, float64 [F], sum 1. Hours of walking must not drown minutes of crouching and running: a frame's chance
        falls with the square root of how common its head height and its speed over the floor are, to an eighth at most."""
        head, velocity = self.trackers.vectors[:, 0], self.trackers.vectors[:, TRACKERS.index("head.velocity")]
        height = np.digitize(head[:, 2], np.arange(0.2, 1.15, 0.1))
        speed = np.digitize(np.linalg.norm(velocity[:, :2], axis=-1), (0.1, 0.5, 1.0, 1.5, 2.5))
        kind = height * 8 + speed
        common = np.bincount(kind)[kind] / len(kind)
        chances = 1 / np.sqrt(common)
        chances = np.minimum(chances, 8 * chances.min())
        return chances / chances.sum()

    def drawn(self, size: int, seed: int) -> Iterator[np.ndarray]:
        """Frame numbers of the batches of one epoch: as many frames as there are, drawn by their chances."""
        random = np.random.default_rng(seed)
        ends = np.cumsum(self.chances)
        for _ in range(len(self) // size):
            yield np.minimum(np.searchsorted(ends, random.random(size)), len(self) - 1)


def join(clips: list[ClipFrames]) -> Dataset:
    """Clips laid end to end."""

    def lay(frames: list[Frames]) -> Frames:
        return Frames(frames[0].layout, np.concatenate([f.vectors for f in frames]), np.concatenate([f.scalars for f in frames]))

    def lay_anchors(anchors: list[GroundFrame]) -> GroundFrame:
        return GroundFrame(np.concatenate([a.origin for a in anchors]), np.concatenate([a.rotation for a in anchors]))

    lengths = np.array([len(clip.trackers) for clip in clips])
    ends = np.cumsum(lengths)
    return Dataset(
        trackers=lay([clip.trackers for clip in clips]),
        anchors=lay_anchors([clip.anchors for clip in clips]),
        rough_trackers=lay([clip.rough_trackers for clip in clips]),
        rough_anchors=lay_anchors([clip.rough_anchors for clip in clips]),
        control=lay([clip.control for clip in clips]),
        lower_body=lay([clip.lower_body for clip in clips]),
        first=np.repeat(ends - lengths, lengths),
        last=np.repeat(ends - 1, lengths),
        proportions=np.repeat([clip.proportions for clip in clips], lengths, axis=0),
        stems=tuple(clip.stem for clip in clips),
    )


def read_datasets(clips: list[Path], split: dict[str, str], mirrored: bool = True, variants: int = 1) -> Generator[Progress, None, dict[str, Dataset]]:
    """Training and validation sets from BVH files (test clips are left alone); training clips also mirrored, and each in `variants`: as it is, then
    by other bodies (learn/augment.py)."""
    chosen: dict[str, list[ClipFrames]] = {"train": [], "validation": []}
    for i, path in enumerate(clips):
        yield Progress(i / len(clips), f"reading {path.name}")
        name = split_of(path.stem, split)
        if name not in chosen:
            continue
        motion = read_sound_motion(path)
        if motion is None:
            continue
        for variant in range(variants if name == "train" else 1):
            seed = zlib.crc32(f"{path.stem}/{variant}".encode())
            seen = vary(motion, seed) if variant else motion
            chosen[name].append(clip_frames(path.stem, seen, seed))
            if mirrored and name == "train":
                chosen[name].append(clip_frames(path.stem, mirror(seen), seed + 1))
    if not chosen["train"]:
        raise InputError(clips[0].parent, f"gives no clip to train on; at least one of {MINIMUM_SECONDS} s is needed")
    if not chosen["validation"]:  # a handful of clips: choose on what there is, and say so in the card
        chosen["validation"] = chosen["train"][-1:]
    return {name: join(found) for name, found in chosen.items()}
