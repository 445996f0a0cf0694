"""Long jobs are generators of progress events: the modal operator, the command line and the tests drive the same generator."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass
from typing import TypeVar

Result = TypeVar("Result")


@dataclass(frozen=True)
class Progress:
    """How far a job is: `share` of the whole from 0 to 1, and what it does now."""

    share: float
    message: str


Job = Generator[Progress, None, Result]


def run(job: Job[Result], report: Callable[[Progress], None] | None = None) -> Result:
    """Drives a job to its end and returns its result; `report` sees every event."""
    while True:
        try:
            event = next(job)
        except StopIteration as end:
            return end.value
        if report:
            report(event)


def part(job: Job[Result], start: float, end: float) -> Job[Result]:
    """The same job as one part of a longer one: its shares are mapped from 0..1 to start..end."""
    while True:
        try:
            event = next(job)
        except StopIteration as stop:
            return stop.value
        yield Progress(start + (end - start) * event.share, event.message)


def blocks(count: int, most: int) -> Iterator[slice]:
    """What is done between two events of a long job, of 0 to `count`: little at first, when all is new to what remembers, then at `most` so much."""
    start, length = 0, 1
    while start < count:
        yield slice(start, min(count, start + length))
        start, length = start + length, min(most, 2 * length)
