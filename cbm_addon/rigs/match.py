"""Which bones of an armature have the names of a table."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from ..motion.skeleton import BODY_JOINTS
from .rig import Bones
from .shape import REQUIRED
from .tables import Names, Table

SEPARATORS = re.compile(r"[\s_.\-]+")


@dataclass(frozen=True)
class Match:
    """What a table finds among the bones of an armature: joint -> bone, of body and fingers, and what else it names."""

    table: Table
    joints: dict[str, str]
    score: float
    twists: dict[str, Names] = field(default_factory=dict)
    also: dict[str, Names] = field(default_factory=dict)
    root: str | None = None

    @property
    def found(self) -> int:
        """How many bones are accounted for."""
        return len(self.joints) + sum(map(len, self.twists.values()))

    @property
    def missing(self) -> list[str]:
        return [name for name in REQUIRED if name not in self.joints]


def match_table(bones: Bones, table: Table) -> Match:
    """What is found under the prefix with which most is found: what stands before the name of the hips, such as `mixamorig:`."""
    by_name = {_plain(bone): bone for bone in reversed(bones.bones)}
    hips = [_plain(name) for name in table.joints.get("Hips", ())]
    prefixes = {name.removesuffix(end) for name in by_name for end in hips if name.endswith(end)} | {""}

    def found(prefix: str, names: Names) -> list[str]:
        return [by_name[prefix + _plain(name)] for name in names if prefix + _plain(name) in by_name]

    def joints(prefix: str) -> dict[str, str]:
        return {joint: present[0] for joint, names in table.joints.items() if (present := found(prefix, names))}

    prefix = max(sorted(prefixes, key=len), key=lambda prefix: len(joints(prefix)))
    bone_of = joints(prefix)
    twists, also = ({joint: tuple(found(prefix, names)) for joint, names in more.items()} for more in (table.twists, table.also))
    score = sum(joint in bone_of for joint in BODY_JOINTS) / max(sum(joint in table.joints for joint in BODY_JOINTS), 1)
    return Match(table, bone_of, score, twists, also, next(iter(found(prefix, table.root)), None))


def _plain(name: str) -> str:
    """A name without what exporters change: case and separators."""
    return SEPARATORS.sub("", name).casefold()
