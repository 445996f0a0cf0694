"""The one exception that means "the user's input, not our fault"."""

from __future__ import annotations

from pathlib import Path


class InputError(Exception):
    """Bad input: `error: SUBJECT: what is wrong and what would be right` on one line, exit code 2.

    `subject` is the file, bone or option that is at fault.
    """

    def __init__(self, subject: str | Path, message: str) -> None:
        super().__init__(f"{subject}: {message}")
        self.subject = str(subject)
        self.message = message
