"""What a command shows while it works: a progress bar on stderr, plain lines on stdout; or JSON lines for a program that drives it."""

from __future__ import annotations

import json
import sys
import time
from contextlib import closing
from typing import TypeVar

from .progress import Job, Progress, run

Result = TypeVar("Result")
BAR_WIDTH = 30
SECONDS_BETWEEN_LINES = 5.0


class Console:
    """Drives a command's jobs and prints its lines.

    `quiet` hides the progress bar; with `json_lines` everything goes to stdout, one JSON object a line: {"share", "message"} for
    progress, {"said"} for the command's own lines.
    """

    def __init__(self, quiet: bool = False, json_lines: bool = False) -> None:
        self.quiet = quiet
        self.json_lines = json_lines
        self._last_message = ""
        self._last_line_at = 0.0

    def run(self, job: Job[Result]) -> Result:
        """Drives the job to its end behind a progress bar and returns its result; the job is closed however it ends."""
        with closing(job):
            if self.json_lines:
                return run(job, lambda progress: _print_json(share=progress.share, message=progress.message))
            if self.quiet:
                return run(job)
            show = self._rewrite_bar if sys.stderr.isatty() else self._print_line
            try:
                return run(job, show)
            finally:
                if sys.stderr.isatty():
                    print(file=sys.stderr)

    def say(self, line: str) -> None:
        if self.json_lines:
            _print_json(said=line)
        else:
            print(line, flush=True)

    def _rewrite_bar(self, progress: Progress) -> None:
        """One line that is written over itself."""
        filled = round(BAR_WIDTH * progress.share)
        bar = "#" * filled + "-" * (BAR_WIDTH - filled)
        print(f"\r\033[K[{bar}] {progress.share:4.0%}  {progress.message}", end="", file=sys.stderr, flush=True)

    def _print_line(self, progress: Progress) -> None:
        """Where lines cannot be rewritten (a log): one line per new message, and one now and then."""
        now = time.monotonic()
        if progress.message != self._last_message or now - self._last_line_at > SECONDS_BETWEEN_LINES:
            print(f"{progress.share:4.0%}  {progress.message}", file=sys.stderr, flush=True)
            self._last_message, self._last_line_at = progress.message, now


def _print_json(**values: float | str) -> None:
    print(json.dumps(values), flush=True)
