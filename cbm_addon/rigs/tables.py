"""Tables of the names that rigs give their bones, one JSON file per rig; a user's own map of an armature is a file of the same format.

    {
      "kind": "short name", "title": "name to show", "source": "where the names come from", "note": "what to be careful of",
      "joints": {"Hips": "pelvis", "LeftToe": ["toe_l", "ball_l"], …},   the bone of each joint; of several names the first that is there
      "twists": {"LeftForeArm": ["lowerarm_twist_02_l", …]},             bones over which a limb spreads a roll, from its upper to its lower end
      "also": {"LeftToe": ["toe2-1.L", …]},                              further bones that turn as a joint's own bone does
      "root": "root"                                                     the bone that carries the way over the ground
    }

`joints` are named as in motion/skeleton.py and FINGER_JOINTS of rigs/rig.py; all but `joints` may be left out. A rig whose mechanism hides
which bones carry which has `parents`, `controls`, `settings` and `poles` as well: the fields of Mapping, Control, Setting and Pole.
"""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from ..errors import InputError
from ..motion.skeleton import BODY_JOINTS
from ..outputs import replacing
from .rig import FINGER_JOINTS, SIDES, Control, Mapping, Pole, Setting

TABLES = Path(__file__).parent / "tables"
JOINTS = (*BODY_JOINTS, *FINGER_JOINTS)
TWISTED = tuple(f"{side}{name}" for side in SIDES for name in ("Arm", "ForeArm", "UpLeg", "Leg"))

Names = tuple[str, ...]


@dataclass(frozen=True)
class Table:
    """What the bones of a kind of rig are called; names are in order of preference."""

    kind: str
    title: str
    source: str
    joints: dict[str, Names]
    twists: dict[str, Names] = field(default_factory=dict)
    also: dict[str, Names] = field(default_factory=dict)
    root: Names = ()
    note: str = ""
    parents: dict[str, str] | None = None
    controls: tuple[Control, ...] = ()
    settings: tuple[Setting, ...] = ()
    poles: tuple[Pole, ...] = ()


@cache
def tables() -> tuple[Table, ...]:
    """The tables that are shipped."""
    return tuple(load_table(path) for path in sorted(TABLES.glob("*.json")))


def load_table(path: Path) -> Table:
    """A table, or a user's map; InputError if the file is not one."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(path, f"cannot be read ({error.strerror}); name a map of bones, as `cbm rigs --save-map` writes it") from None
    except ValueError as error:
        raise InputError(path, f"is not JSON ({error}); a map of bones is needed, as `cbm rigs --save-map` writes it") from None
    if not isinstance(content, dict) or not isinstance(content.get("joints"), dict):
        raise InputError(path, 'is no map of bones; it must be an object with "joints", as `cbm rigs --save-map` writes it')
    _only(path, "joint", content["joints"], JOINTS)
    _only(path, "twist", content.get("twists", {}), TWISTED)
    _only(path, "joint", content.get("also", {}), BODY_JOINTS)
    try:
        return Table(
            kind=content.get("kind", path.stem),
            title=content.get("title", content.get("kind", path.stem)),
            source=content.get("source", str(path.name)),
            joints={joint: _names(path, names) for joint, names in content["joints"].items()},
            twists={joint: _names(path, names) for joint, names in content.get("twists", {}).items()},
            also={joint: _names(path, names) for joint, names in content.get("also", {}).items()},
            root=_names(path, content.get("root", [])),
            note=content.get("note", ""),
            parents=content.get("parents"),
            controls=tuple(Control(**control) for control in content.get("controls", ())),
            settings=tuple(Setting(**setting) for setting in content.get("settings", ())),
            poles=tuple(Pole(**pole) for pole in content.get("poles", ())),
        )
    except TypeError as error:
        raise InputError(path, f"has a control, setting or pole that is not complete ({error})") from None


def save_map(path: Path, mapping: Mapping, overwrite: bool = False) -> None:
    """Writes the map of an armature, for `load_table`; InputError if the file is there already and must not be replaced."""
    table = mapping.table
    content: dict[str, Any] = {"kind": table.kind, "title": table.title, "source": table.source}
    if table.note:
        content["note"] = table.note
    content["joints"] = {joint: _short(names) for joint, names in table.joints.items()}
    for key, bones in (("twists", table.twists), ("also", table.also)):
        if bones:
            content[key] = {joint: _short(names) for joint, names in bones.items()}
    if table.root:
        content["root"] = _short(table.root)
    if table.controls:
        content |= {"parents": table.parents, "controls": [asdict(item) for item in table.controls]}
    for key, items in (("settings", table.settings), ("poles", table.poles)):
        if items:
            content[key] = [asdict(item) for item in items]
    with replacing(path, overwrite) as temporary:
        temporary.write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")


def _only(path: Path, what: str, given: dict[str, Any], known: Names) -> None:
    unknown = [name for name in given if name not in known]
    if unknown:
        raise InputError(path, f"has a bone for the {what} {unknown[0]}, which no body has; a {what} is one of {', '.join(known)}")


def _names(path: Path, names: Any) -> Names:
    listed = [names] if isinstance(names, str) else names
    if not isinstance(listed, list) or not all(isinstance(name, str) for name in listed):
        raise InputError(path, f"names a bone {json.dumps(names)}; a name or a list of names is needed")
    return tuple(listed)


def _short(names: Names) -> str | list[str]:
    return names[0] if len(names) == 1 else list(names)
