"""A model is a folder: ONNX files, and a JSON card that names them, their checksums and what they were made for."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from .errors import InputError

MODELS_FOLDER = Path(__file__).parent / "models"
KEYS = ("name", "version", "files", "training", "licence")  # of every card


def read_json_card(folder: Path) -> dict[str, Any]:
    """The card of a model folder of any format; InputError if there is none or it is no JSON object."""
    path = Path(folder) / "card.json"
    try:
        card = json.loads(path.read_text())
    except OSError as error:
        raise InputError(folder, "is not a model: it has no card.json; choose a folder that `train` wrote") from error
    except ValueError as error:
        raise InputError(path, f"is not JSON ({error}); choose a folder that `train` wrote") from error
    if not isinstance(card, dict):
        raise InputError(path, "is not a card; choose a folder that `train` wrote")
    return card


def card_of_format(folder: Path, kind: str, keys: Iterable[str]) -> dict[str, Any]:
    """The card of a model folder, which must be of the format `kind` and have `keys` besides KEYS."""
    card, path = read_json_card(folder), Path(folder) / "card.json"
    if card.get("format") != kind:
        raise InputError(path, f"has another format; '{kind}' is expected")
    missing = [key for key in (*KEYS, *keys) if key not in card]
    if missing:
        raise InputError(path, f"lacks {', '.join(missing)}; train the model again with this version")
    return card


def verify_files(folder: Path, card: dict[str, Any]) -> None:
    """Every file that the card names is there and unchanged."""
    for name, entry in card["files"].items():
        path = Path(folder) / name
        if not path.is_file():
            raise InputError(path, "is missing; the card names it")
        if hashlib.sha256(path.read_bytes()).hexdigest() != entry["sha256"]:
            raise InputError(path, "is not the file that the card describes (its checksum differs); copy the model again")


def find_models(folder: Path = MODELS_FOLDER) -> list[Path]:
    """Model folders below `folder`."""
    return sorted(path.parent for path in Path(folder).glob("*/card.json"))


def write_model(folder: Path, files: dict[str, bytes], card: dict[str, Any]) -> Path:
    """Writes the files and the card, to which it adds their sizes and checksums; returns the card's path."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    for name, data in files.items():
        (folder / name).write_bytes(data)
    entries = {name: {"sha256": hashlib.sha256(data).hexdigest(), "bytes": len(data)} for name, data in files.items()}
    path = folder / "card.json"
    path.write_text(json.dumps(card | {"files": entries}, indent=2) + "\n")
    return path


def session_options(threads: int) -> Any:
    """Options of onnxruntime sessions; `threads` 0 lets it choose. InputError where onnxruntime is missing."""
    try:
        import onnxruntime
    except ImportError as error:
        raise InputError("onnxruntime", f"cannot be imported ({error}); the extension ships it, a checkout needs `pip install onnxruntime`") from error
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.log_severity_level = 3
    return options


def open_session(path: Path, options: Any) -> Any:
    """An onnxruntime session on the processor."""
    import onnxruntime

    return onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
