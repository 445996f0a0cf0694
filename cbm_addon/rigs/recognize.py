"""Recognition: which bones of an armature play which joints, by the names that rigs use, and by the shape where no names fit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, fields

from ..errors import InputError
from ..motion.skeleton import BODY_JOINTS
from .bone_tree import BoneTree
from .finger_shape import finger_chains
from .mapping import mapping_of
from .match import Match, match_table
from .rig import FINGER_JOINTS, SIDES, Bones, Mapping, Rig
from .shape import REQUIRED, find_joints, misshapen
from .tables import Table, tables

NEAR = 0.03  # scores that differ by less do not tell two tables apart

BY_SHAPE = Table("shape", "the shape of a person", "Topology and rest positions of the bones, whatever their names", {})


@dataclass(frozen=True)
class Recognition:
    """A mapping, and how far it can be trusted.

    score    share of the body's joints that the table knows which have a bone, from 0 to 1
    doubts   what speaks against the mapping
    ranking  title and score of what was tried, the best first
    """

    mapping: Mapping
    score: float
    doubts: tuple[str, ...]
    ranking: tuple[tuple[str, float], ...]


def summary(recognition: Recognition) -> list[str]:
    """What was recognised and how sure that is, a line each; doubts begin with an exclamation mark."""
    mapping = recognition.mapping
    bones = f"{len(mapping.joints)} joints, {len(mapping.fingers)} finger joints, root bone {mapping.root or 'none'}"
    return [f"{mapping.table.title}, score {recognition.score:.2f}: {bones}", *(f"! {doubt}" for doubt in recognition.doubts)]


def recognized(bones: Bones, table: Table | None = None) -> Rig:
    """The armature as a rig; InputError if it is not a body."""
    return Rig(**{field.name: getattr(bones, field.name) for field in fields(Bones)}, mapping=recognize(bones, table).mapping)


def recognize(bones: Bones, table: Table | None = None) -> Recognition:
    """How an armature plays a body: by the table that fits best, or by its shape where no table does.

    A `table` that is given is the user's own choice: nothing else is tried, and an odd shape is a doubt but no refusal. InputError if
    what would be mapped is no body: a wrong map is worse than none.
    """
    if table:
        match = match_table(bones, table)
        mapping = mapping_of(bones, match)
        reason = misshapen(bones, mapping.joints)
        doubts = [f"its rest pose is not that of a person: {reason}"] if reason else []
        return Recognition(mapping, match.score, (*doubts, *_doubts(bones, match, mapping)), ((table.title, match.score),))
    matches = sorted((match_table(bones, known) for known in tables()), key=lambda match: (match.score, match.found), reverse=True)
    try:
        return _by_names(bones, matches)
    except InputError as by_names:
        return _by_shape(bones, matches, by_names)


def _by_names(bones: Bones, matches: list[Match]) -> Recognition:
    best = matches[0]
    mapping = mapping_of(bones, best)
    if reason := misshapen(bones, mapping.joints):
        raise InputError(bones.name, f"has the names of {best.table.title}, but {reason}; correct that, or give a map of its bones")
    doubts = (*_rivals(matches), *_disagreements(bones, mapping), *_doubts(bones, best, mapping))
    return Recognition(mapping, best.score, doubts, _ranking(matches))


def _by_shape(bones: Bones, matches: list[Match], by_names: InputError) -> Recognition:
    if matches[0].table.controls and not matches[0].missing:
        raise by_names  # a control rig that is known moves by its controls alone
    try:
        joints = find_joints(bones)
    except InputError as by_shape:
        if len(matches[0].missing) <= len(REQUIRED) / 2:
            raise by_names from None
        raise InputError(bones.name, f"has neither the names of a known rig nor the shape of a person: {by_shape.message}; give a map of its bones") from None
    match = Match(BY_SHAPE, joints | _fingers(bones, joints), sum(name in joints for name in BODY_JOINTS) / len(BODY_JOINTS))
    mapping = mapping_of(bones, match)
    if driven := [bone for bone in mapping.joints.values() if bones.constrained[bones.index(bone)]]:
        raise InputError(bones.name, f"has the shape of a person, but constraints move its bone {driven[0]}; give a map of its controls")
    doubts = ("found by its shape, not by names: look at the map before you rely on it", *_doubts(bones, match, mapping))
    return Recognition(mapping, match.score, doubts, _ranking([match, *matches]))


def _fingers(bones: Bones, joints: dict[str, str]) -> dict[str, str]:
    """Finger joint -> bone, by the shape of the hands."""
    tree = BoneTree(bones)
    chains = {f"{side}Hand{finger}": chain for side in SIDES for finger, chain in finger_chains(tree, bones.index(joints[f"{side}Hand"])).items()}
    return {f"{finger}{phalanx + 1}": bones.bones[bone] for finger, chain in chains.items() for phalanx, bone in enumerate(chain)}


def _ranking(matches: list[Match]) -> tuple[tuple[str, float], ...]:
    return tuple((match.table.title, match.score) for match in matches)


# Doubts


def _rivals(matches: list[Match]) -> Iterator[str]:
    """Tables that fit about as well, but otherwise."""
    best = matches[0]
    for rival in matches[1:]:
        differing = [joint for joint, bone in rival.joints.items() if joint in BODY_JOINTS and best.joints.get(joint, bone) != bone]
        if rival.score > best.score - NEAR and not rival.missing and differing:
            yield f"{rival.table.title} fits about as well ({rival.score:.2f}); it has other bones for {', '.join(differing)}"


def _disagreements(bones: Bones, mapping: Mapping) -> Iterator[str]:
    try:
        by_shape = find_joints(bones)
    except InputError:
        return
    for joint in REQUIRED:
        if mapping.joints[joint] != by_shape[joint]:
            yield f"{joint} is {mapping.joints[joint]} by its name, but {by_shape[joint]} by the shape of the armature"


def _doubts(bones: Bones, match: Match, mapping: Mapping) -> Iterator[str]:
    if match.table.note:
        yield match.table.note
    without = [joint for joint in BODY_JOINTS if joint in match.table.joints and joint not in mapping.joints]
    if without:
        yield f"no bone for {', '.join(without)}"
    lacking = sum(joint in match.table.joints and joint not in mapping.fingers for joint in FINGER_JOINTS)
    if mapping.fingers and lacking:
        yield f"no bones for {lacking} of its finger joints"
    driven = [control.bone for control in mapping.controls if bones.constrained[bones.index(control.bone)]]
    if driven and not match.table.controls:
        yield f"constraints move {driven[0]}" + (f" and {len(driven) - 1} more of its bones" if len(driven) > 1 else "")
