"""Recognition: which bones of an armature play which joints, from tables of the names that rigs use."""

from __future__ import annotations

import json
import re
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import InputError
from ..features import LOWER_JOINTS
from ..motion.skeleton import BODY_JOINTS
from .rig import Control, Mapping, Setting

TABLES = Path(__file__).parent / "tables"
PREFIX = re.compile(r"^(.*:|mixamorig\d*_?)")
SIDES = ("Left", "Right")
REQUIRED = ("Hips", "Head", *(side + name for side in SIDES for name in ("Arm", "ForeArm", "Hand", "UpLeg", "Leg", "Foot")))


@cache
def tables() -> tuple[dict[str, Any], ...]:
    return tuple(json.loads(path.read_text(encoding="utf-8")) for path in sorted(TABLES.glob("*.json")))


def recognize(rig: str, bones: tuple[str, ...], parents: np.ndarray) -> Mapping:
    """The mapping of the table of which most required joints are found; equal tables are told apart by all of their joints.

    `rig` is the armature's name, for the InputError that lists the joints without a bone.
    """
    found = [(table, _joints(table, bones)) for table in tables()]
    table, joints = max(found, key=lambda item: (sum(name in item[1] for name in REQUIRED), len(item[1])))
    missing = [name for name in REQUIRED if name not in joints]
    if missing:
        expected = ", ".join(f"{name} ({' or '.join(_names(table, name))})" for name in missing)
        raise InputError(rig, f"lacks bones for {expected}, going by the names of {table['kind']}, the nearest that is known")
    above = _parents(table, joints, bones, parents)
    _check_hierarchy(rig, joints, above)
    controls = _table_controls(rig, table, bones) if "controls" in table else _plain_controls(joints, above)
    settings = tuple(Setting(**setting) for setting in table.get("settings", ()))
    return Mapping(table["kind"], joints, above, controls, settings)


def _names(table: dict[str, Any], joint: str) -> list[str]:
    names = table["joints"][joint]
    return [names] if isinstance(names, str) else names


def _joints(table: dict[str, Any], bones: tuple[str, ...]) -> dict[str, str]:
    """Joint -> bone for the joints of a table that are found; a bone's exact name is preferred to one without its prefix."""
    by_name = {PREFIX.sub("", bone): bone for bone in reversed(bones)} | {bone: bone for bone in bones}
    joints = {}
    for joint in BODY_JOINTS:
        bone = next((by_name[name] for name in _names(table, joint) if name in by_name), None)
        if bone is not None:
            joints[joint] = bone
    return joints


def _parents(table: dict[str, Any], joints: dict[str, str], bones: tuple[str, ...], parents: np.ndarray) -> dict[str, str | None]:
    """Joint -> the joint above it: what the table says (of a rig whose mechanism hides its hierarchy), else the nearest mapped ancestor."""
    joint_of = {bones.index(bone): joint for joint, bone in joints.items()}
    above: dict[str, str | None] = {}
    for bone, joint in joint_of.items():
        ancestor = int(parents[bone])
        while ancestor >= 0 and ancestor not in joint_of:
            ancestor = int(parents[ancestor])
        above[joint] = table.get("parents", {}).get(joint, joint_of.get(ancestor))
    return above


def _check_hierarchy(rig: str, joints: dict[str, str], above: dict[str, str | None]) -> None:
    order = list(joints)
    for joint, parent in above.items():
        if joint != "Hips" and (parent is None or order.index(parent) > order.index(joint)):
            raise InputError(rig, f"its bone {joints[joint]} ({joint}) is not below the bones that carry it in a body; parent it below {joints['Hips']}")
    for side in SIDES:
        for upper, lower in (("Arm", "ForeArm"), ("ForeArm", "Hand"), ("UpLeg", "Leg"), ("Leg", "Foot")):
            if above[side + lower] != side + upper:
                raise InputError(rig, f"its bone {joints[side + lower]} is not below {joints[side + upper]}; parent it there")
        chest = above[f"{side}Shoulder" if f"{side}Shoulder" in joints else f"{side}Arm"]
        if chest == "Hips" or chest not in _ancestors("Head", above):
            raise InputError(rig, f"its bone {joints[f'{side}Arm']} does not hang off the spine between hips and head; parent it to a bone there")


def _ancestors(joint: str, above: dict[str, str | None]) -> list[str]:
    chain = []
    while (parent := above[joint]) is not None:
        chain.append(parent)
        joint = parent
    return chain


def _plain_controls(joints: dict[str, str], above: dict[str, str | None]) -> tuple[Control, ...]:
    """Every mapped bone is keyed itself; the hips also move."""
    return tuple(Control(bone, joint, above[joint], "Hips" if joint == "Hips" else None, joint in LOWER_JOINTS) for joint, bone in joints.items())


def _table_controls(rig: str, table: dict[str, Any], bones: tuple[str, ...]) -> tuple[Control, ...]:
    controls = tuple(Control(**control) for control in table["controls"])
    missing = [bone for bone in (*(control.bone for control in controls), *(setting["bone"] for setting in table["settings"])) if bone not in bones]
    if missing:
        raise InputError(rig, f"looks like {table['kind']} but lacks its controls {', '.join(missing)}; generate it again from the human metarig")
    return controls
