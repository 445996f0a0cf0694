"""The file of a batch, in TOML: takes, rigs, and the options of `bake` for all of them, for a rig, or for some takes."""

from __future__ import annotations

import argparse
import tomllib
from collections import Counter
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import Any, NoReturn

from ..errors import InputError
from . import bake

JOB_KEYS = ("output", "options", "takes", "rigs")
RIG_KEYS = ("name", "blend", "rig", "preset")
TAKE_KEYS = ("files",)
PREVIEWS = ("png", "mp4")
NOT_OPTIONS = ("takes", "output", "blend", "rig", "preset", "preview")
"""Arguments of `bake` that the tables of the file say in their own way."""

Values = dict[str, Any]


@dataclass(frozen=True)
class Task:
    """One take on one rig: `argv` is what `bake` is told, `outputs` is what it writes."""

    name: str
    take: Path
    outputs: tuple[Path, ...]
    argv: tuple[str, ...]

    @property
    def is_made(self) -> bool:
        return all(path.exists() for path in self.outputs)


class BakeParser(argparse.ArgumentParser):
    """The parser of `bake`, for values that come from a file."""

    def __init__(self, file: Path | None = None) -> None:
        super().__init__(add_help=False)
        self._file = file
        bake.add_arguments(self)
        self.add_argument("--overwrite", action="store_true")

    def error(self, message: str) -> NoReturn:
        raise InputError(self._file or "bake", message.removeprefix("argument ").removeprefix("--"))


def read_job(path: Path) -> list[Task]:
    """The tasks of a batch, rig after rig. InputError for a file that is none, an unknown key, or a value that `bake` would refuse.

    Paths in the file are relative to its folder. A take that is missing or broken is no error here: its task will say so.
    """
    try:
        job = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(path, f"cannot be read ({error.strerror}); name the TOML file of a batch") from None
    except ValueError as error:
        raise InputError(path, f"is not TOML ({error}); see the user guide for an example") from None
    parser = BakeParser(path)
    defaults = vars(parser.parse_args(["take", "--rig", "rig", "-o", "out.blend"]))
    options = {name.replace("_", "-"): default for name, default in defaults.items() if name not in NOT_OPTIONS} | {"preview": []}
    options.pop("overwrite")
    reader = _Reader(path, options)
    reader.only(job, JOB_KEYS, "at the top")
    output = reader.text(job, "output", "at the top")
    common = reader.options(job.get("options", {}), "[options]")
    takes = [take for entry in reader.entries(job, "takes") for take in reader.takes(entry)]
    rigs = [reader.rig(entry) for entry in reader.entries(job, "rigs")]
    reader.unique([name for name, _, _ in rigs], "rigs")
    names = _take_names([take for take, _ in takes])
    reader.unique(names, "takes")
    tasks = []
    for (rig, target, of_rig), (name, (take, of_take)) in product(rigs, zip(names, takes, strict=True)):
        values = common | of_rig | of_take
        blend = path.parent / output / rig / f"{name}.blend"
        previews = [blend.with_suffix(f".{kind}") for kind in values.pop("preview", [])]
        argv = (str(take), *target, "-o", str(blend), *(f"--preview={preview}" for preview in previews), *reader.arguments(values))
        parser.parse_args(argv)
        tasks.append(Task(f"{rig}/{name}", take, (blend, *previews), argv))
    return tasks


class _Reader:
    """Reads the tables of one file; every refusal names the file, the key and what is known."""

    def __init__(self, path: Path, defaults: Values) -> None:
        self.path = path
        self.defaults = defaults

    def refuse(self, message: str) -> NoReturn:
        raise InputError(self.path, message)

    def only(self, table: Any, known: tuple[str, ...], where: str) -> None:
        if not isinstance(table, dict):
            self.refuse(f"{where} is {table!r}; a table of {', '.join(known)} is needed")
        if unknown := [key for key in table if key not in known]:
            self.refuse(f"unknown key '{unknown[0]}' {where}; known are {', '.join(known)}")

    def text(self, table: Values, key: str, where: str) -> str:
        value = table.get(key)
        if not isinstance(value, str) or not value:
            self.refuse(f"'{key}' {where} is {'missing' if value is None else repr(value)}; a text is needed")
        return value

    def entries(self, job: Values, key: str) -> list[Any]:
        entries = job.get(key)
        if not isinstance(entries, list) or not entries:
            self.refuse(f"'{key}' is {'missing' if entries is None else repr(entries)}; a list of at least one is needed")
        return entries

    def options(self, table: Any, where: str, besides: tuple[str, ...] = ()) -> Values:
        """The options of `bake` in a table; `besides` are its other keys."""
        self.only(table, (*besides, *self.defaults), where)
        values = {key: value for key, value in table.items() if key in self.defaults}
        for key, value in values.items():
            default = self.defaults[key]
            if key == "preview":
                values[key] = [value] if isinstance(value, str) else value
                if not isinstance(values[key], list) or any(kind not in PREVIEWS for kind in values[key]):
                    self.refuse(f"'preview' {where} is {value!r}; {' or '.join(PREVIEWS)} is needed, or a list of both")
            elif isinstance(value, dict) or (isinstance(default, bool) and not isinstance(value, bool)):
                self.refuse(f"'{key}' {where} is {value!r}; {'true or false' if isinstance(default, bool) else 'a value'} is needed")
        return values

    def takes(self, entry: Any) -> list[tuple[Path, Values]]:
        """The files of an entry of `takes`, a pattern or a table with one, and their options."""
        table = {"files": entry} if isinstance(entry, str) else entry
        options = self.options(table, "in [[takes]]", TAKE_KEYS)
        pattern = self.text(table, "files", "in [[takes]]")
        path = self.path.parent / pattern
        if path.exists() or not any(sign in pattern for sign in "*?["):
            return [(path, options)]
        anchor = Path(pattern).anchor
        found = sorted((Path(anchor) if anchor else self.path.parent).glob(pattern.removeprefix(anchor)))
        if not found:
            self.refuse(f"'{pattern}' in takes matches no file; patterns are relative to the folder of this file")
        return [(file, options) for file in found]

    def rig(self, entry: Any) -> tuple[str, list[str], Values]:
        """Name, what `bake` is told of the target, and options of an entry of `rigs`."""
        options = self.options(entry, "in [[rigs]]", RIG_KEYS)
        given = {key: self.text(entry, key, "in [[rigs]]") for key in RIG_KEYS if key in entry}
        if ("rig" in given) == ("preset" in given) or ("rig" in given and "blend" not in given):
            self.refuse("an entry of [[rigs]] needs 'blend' and 'rig' (an armature of that file), or 'preset'")
        target = [f"--{key}={given[key]}" for key in ("rig", "preset") if key in given]
        if "blend" in given:
            blend = self.path.parent / given["blend"]
            if not blend.is_file():
                raise InputError(blend, f"does not exist; {self.path} names it")
            target.append(f"--blend={blend}")
        name = given.get("name") or given.get("rig") or given["preset"]
        if Path(name).name != name or name in (".", ".."):
            self.refuse(f"'{name}' in [[rigs]] cannot be the name of a folder; give the rig another 'name'")
        return name, target, options

    def unique(self, names: list[str], what: str) -> None:
        if twice := [name for name, count in Counter(names).items() if count > 1]:
            advice = "give them names" if what == "rigs" else "name every file once, and give files of one name folders of different names"
            self.refuse(f"two {what} are called '{twice[0]}'; {advice}")

    def arguments(self, values: Values) -> list[str]:
        """Values as arguments of `bake`; paths are relative to the file's folder."""
        arguments = []
        for key, value in values.items():
            if value is True:
                arguments.append(f"--{key}")
            elif value is False:
                arguments += [] if self.defaults[key] is False else [f"--no-{key}"]
            elif key in ("model", "map"):
                arguments.append(f"--{key}={self.path.parent / str(value)}")
            else:
                parts = value if isinstance(value, list) else [value]
                arguments.append(f"--{key}={','.join(str(part) for part in parts)}")
        return arguments


def _take_names(paths: list[Path]) -> list[str]:
    """What takes are called: as their files, and with their folders' names where several files have one name."""
    stems = Counter(path.stem for path in paths)
    return [path.stem if stems[path.stem] == 1 else f"{path.parent.name}_{path.stem}" for path in paths]
