"""Which clips train, which choose between models (validation) and which are reported (test): never split by frame.

A split file is JSON: {"rule": text, "clips": {stem: {"split": "train"|"validation"|"test"|"unused", "by": "performer"|"clip"}}}. Performers whose
behaviour others also show are held out whole ("performer"); behaviours that one performer shows alone are divided by clip ("clip").
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

from ..errors import InputError

CORE_SPLIT = Path(__file__).parent / "splits" / "core.json"
SPLITS = ("train", "validation", "test")


def read_split(path: Path = CORE_SPLIT) -> dict[str, str]:
    """Clip stem -> split name."""
    try:
        clips = json.loads(Path(path).read_text())["clips"]
        split = {stem: entry["split"] for stem, entry in clips.items()}
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(path, f"is not a split file ({error}); a JSON object with 'clips' is expected") from error
    return split


def split_of(stem: str, split: dict[str, str]) -> str:
    """The split of a clip; clips that the file does not name are divided 90/5/5 by a hash of their name, the same on every machine."""
    if stem in split:
        return split[stem]
    share = int.from_bytes(hashlib.sha256(stem.encode()).digest()[:4], "big") / 2**32
    return "train" if share < 0.9 else "validation" if share < 0.95 else "test"
