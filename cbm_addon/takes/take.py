"""Take: what a headset and two controllers did over time, and how the reader came to say so."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Generic, Literal, TypeVar

import numpy as np

from ..motion.rotations import Array

DEVICES = ("head", "left", "right")
HEAD, LEFT, RIGHT = range(3)
HANDS = (LEFT, RIGHT)

EXTRAS = ("stick_x", "stick_y", "trigger_left", "grip_left", "trigger_right", "grip_right")

Value = TypeVar("Value", float, str, bool, tuple[float, float, float])


@dataclass(frozen=True)
class Constant(Generic[Value]):
    """One constant of a take: its value, where that came from (the file format, a measurement, the user, an assumption), and why.

    confidence  of a measurement: 0 (a coin toss) to 1 (every sample agrees)
    """

    value: Value
    source: Literal["format", "measured", "given", "assumed"]
    why: str = ""
    confidence: float | None = None


@dataclass(frozen=True)
class Defect:
    """Something wrong in a file that its reader repaired, left out or could only notice; `count` samples have it."""

    kind: str
    count: int
    message: str


@dataclass(frozen=True)
class TakeReport:
    """What a reader found: the format, the number of rows in the file, what the file says of its origin, the constants that were decided
    (unit, axes, swapped hands, time), and every defect."""

    format: str
    rows: int
    origin: dict[str, str] = field(default_factory=dict)
    constants: dict[str, Constant[Any]] = field(default_factory=dict)
    defects: tuple[Defect, ...] = ()


@dataclass(frozen=True)
class Take:
    """A three-point recording in engine axes and metres.

    times      float64 [T], seconds from 0, strictly increasing
    positions  float32 [T, 3, 3]: head, left, right (DEVICES); NaN where not tracked
    rotations  float32 [T, 3, 4]: unit quaternions without sign flips; NaN where not tracked
    tracked    bool [T, 3]
    kind       "device": poses of the hardware, to be calibrated; "joint": poses of the head and wrist joints, rotations relative to the T-pose
    extras     name (EXTRAS) to float32 [T]: sticks from -1 to 1, triggers and grips from 0 to 1
    report     how the take was read; None if it was not read from a file
    """

    name: str
    times: np.ndarray
    positions: Array
    rotations: Array
    tracked: np.ndarray
    kind: Literal["device", "joint"]
    extras: dict[str, Array] = field(default_factory=dict)
    report: TakeReport | None = None

    def __post_init__(self) -> None:
        count = len(self.times)
        if self.positions.shape != (count, 3, 3) or self.rotations.shape != (count, 3, 4) or self.tracked.shape != (count, 3):
            raise ValueError(f"a take of {count} samples cannot have {self.positions.shape}, {self.rotations.shape}, {self.tracked.shape}")
        if not np.all(np.diff(self.times) > 0):
            raise ValueError("the times of a take must increase")

    def __len__(self) -> int:
        return len(self.times)

    @property
    def seconds(self) -> float:
        return float(self.times[-1] - self.times[0])

    @property
    def rate(self) -> float:
        """Median samples per second; 0 for a single sample."""
        return float(1 / np.median(np.diff(self.times))) if len(self) > 1 else 0.0
