"""What a clip shows, from the list of clips that lies beside its folder, or from its name."""

from __future__ import annotations

import csv
from functools import cache
from pathlib import Path

from ..errors import InputError

MANIFEST = "manifest.csv"


def behaviours_of(clip: Path) -> tuple[str, ...]:
    """The tags of a clip in the manifest beside its folder, else the part of its name before `__`.

    A manifest is a CSV whose column `file` holds paths relative to its own folder and whose column `tags` holds words.
    """
    clip = Path(clip).resolve()
    tags = _tags(clip.parent.parent / MANIFEST).get(f"{clip.parent.name}/{clip.name}")
    return tuple(tags.split()) if tags else (clip.stem.split("__")[0],)


@cache
def _tags(manifest: Path) -> dict[str, str]:
    """File -> tags; empty where there is no manifest or it has other columns."""
    if not manifest.is_file():
        return {}
    try:
        with manifest.open(newline="", encoding="utf-8") as file:
            return {row["file"]: row["tags"] for row in csv.DictReader(file) if row.get("file") and row.get("tags")}
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(manifest, f"cannot be read ({error}); a CSV with the columns file and tags is expected") from error
