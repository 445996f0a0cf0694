"""From bones that were matched to a mapping: what hangs off what, and what is keyed."""

from __future__ import annotations

from dataclasses import replace

from ..errors import InputError
from ..features import LOWER_JOINTS
from ..motion.skeleton import BODY_JOINTS
from .match import Match
from .rig import FINGER_JOINTS, OWN_ROLL, SIDES, Bones, Control, Mapping, Pole, next_in_limb
from .tables import Names, Table


def mapping_of(bones: Bones, match: Match) -> Mapping:
    """The mapping of a match; InputError if joints are missing, or its bones do not hang together as a body does."""
    table = match.table
    if match.missing:
        expected = ", ".join(f"{name} ({' or '.join(table.joints.get(name, ('?',)))})" for name in match.missing)
        raise InputError(bones.name, f"lacks bones for {expected}, going by the names of {table.title}, the nearest that is known")
    joints = {joint: match.joints[joint] for joint in BODY_JOINTS if joint in match.joints}
    above = _above(bones, table, joints)
    _check_hierarchy(bones, joints, above)
    settings = tuple(setting for setting in table.settings if setting.bone in bones.bones)
    if table.controls:
        fingers = {joint: match.joints[joint] for joint in FINGER_JOINTS if joint in match.joints}
        own = replace(table, joints=_single(joints | fingers), root=(match.root,) if match.root else ())
        return Mapping(own, joints, fingers, above, _table_controls(bones, table), settings, _poles(bones, table), match.root)
    fingers = _fingers(bones, match.joints)
    twists = _spreading(bones, _below(bones, match.twists, joints), joints)
    also = _below(bones, match.also, {joint: joints[parent] for joint, parent in above.items() if parent})
    top = bones.ancestors(joints["Hips"])
    root = match.root if match.root in top else top[-1] if top else None
    own = replace(table, joints=_single(joints | fingers), twists=twists, also=also, root=(root,) if root else ())
    return Mapping(own, joints, fingers, above, _plain_controls(bones, joints | fingers, twists, also), settings, root=root)


def _single(bones: dict[str, str]) -> dict[str, Names]:
    return {joint: (bone,) for joint, bone in bones.items()}


def _below(bones: Bones, named: dict[str, Names], carriers: dict[str, str]) -> dict[str, Names]:
    """The named bones of each joint that are below the bone that must carry them."""
    return {joint: below for joint, names in named.items() if (below := tuple(bone for bone in names if carriers.get(joint) in bones.ancestors(bone)))}


def _spreading(bones: Bones, twists: dict[str, Names], joints: dict[str, str]) -> dict[str, Names]:
    """Twist bones that can spread a roll: those of upper arm and thigh only beside the way to the next joint, which has to keep the roll."""
    return {
        joint: tuple(bone for bone in names if not joint.endswith(OWN_ROLL) or bone not in bones.ancestors(joints[next_in_limb(joint)]))
        for joint, names in twists.items()
    }


def _above(bones: Bones, table: Table, joints: dict[str, str]) -> dict[str, str | None]:
    """Joint -> the joint above it: what the table says (of a rig whose mechanism hides its hierarchy), else the nearest mapped ancestor."""
    joint_of = {bone: joint for joint, bone in joints.items()}
    hidden = table.parents or {}
    return {joint: hidden.get(joint, next((joint_of[name] for name in bones.ancestors(bone) if name in joint_of), None)) for joint, bone in joints.items()}


def _check_hierarchy(bones: Bones, joints: dict[str, str], above: dict[str, str | None]) -> None:
    rig, order = bones.name, list(joints)
    if len(set(joints.values())) < len(joints):
        twice = next(bone for bone in joints.values() if list(joints.values()).count(bone) > 1)
        raise InputError(rig, f"its bone {twice} is to play more than one joint; give every joint its own bone")
    for joint, parent in above.items():
        if joint != "Hips" and (parent is None or order.index(parent) > order.index(joint)):
            raise InputError(rig, f"its bone {joints[joint]} ({joint}) is not below the bones that carry it in a body; parent it below {joints['Hips']}")
    for side in SIDES:
        for upper, lower in (("Arm", "ForeArm"), ("ForeArm", "Hand"), ("UpLeg", "Leg"), ("Leg", "Foot")):
            if above[side + lower] != side + upper:
                raise InputError(rig, f"its bone {joints[side + lower]} is not below {joints[side + upper]}; parent it there")
        chest = above[f"{side}Shoulder" if f"{side}Shoulder" in joints else f"{side}Arm"]
        if chest == "Hips" or chest not in _carriers("Head", above):
            raise InputError(rig, f"its bone {joints[f'{side}Arm']} does not hang off the spine between hips and head; parent it to a bone there")


def _carriers(joint: str, above: dict[str, str | None]) -> list[str]:
    chain = []
    while (parent := above[joint]) is not None:
        chain.append(parent)
        joint = parent
    return chain


def _fingers(bones: Bones, joints: dict[str, str]) -> dict[str, str]:
    """The finger joints of a match whose bones are below the finger's joints before them, or the hand."""
    fingers: dict[str, str] = {}
    for joint in (name for name in FINGER_JOINTS if name in joints):
        side = joint[: joint.index("Hand")]
        before = [fingers[name] for name in (f"{joint[:-1]}{phalanx}" for phalanx in range(int(joint[-1]))) if name in fingers]
        if all(bone in bones.ancestors(joints[joint]) for bone in (joints[f"{side}Hand"], *before)):
            fingers[joint] = joints[joint]
    return fingers


# What is keyed


def _plain_controls(bones: Bones, joints: dict[str, str], twists: dict[str, Names], also: dict[str, Names]) -> tuple[Control, ...]:
    """Every mapped bone is keyed itself; the hips also move. A bone between two of them that does not inherit rotation is keyed to do so."""
    plays = {bone: joint for more in (twists, also) for joint, names in more.items() for bone in names} | {bone: joint for joint, bone in joints.items()}
    rolls = {bone: (i + 1) / (len(names) + 1) - joint.endswith(OWN_ROLL) for joint, names in twists.items() for i, bone in enumerate(names)}
    for bone in list(plays):
        below = []
        for parent in bones.ancestors(bone):
            if parent in plays:
                plays |= {loose: plays[parent] for loose in below if not bones.inherits_rotation[bones.index(loose)]}
                break
            below.append(parent)

    def carrier(bone: str) -> str | None:
        while bones.inherits_rotation[bones.index(bone)] and (parent := bones.parent(bone)) is not None:
            if parent in plays:
                return parent
            bone = parent
        return None

    return tuple(
        Control(
            bone=bone,
            joint=plays[bone],
            carrier=carrier(bone),
            anchor="Hips" if bone == joints["Hips"] else None,
            lower=plays[bone] in LOWER_JOINTS,
            roll=rolls.get(bone, 0.0),
        )
        for bone in bones.bones
        if bone in plays
    )


def _table_controls(bones: Bones, table: Table) -> tuple[Control, ...]:
    needed = (control.bone for control in table.controls if control.joint in BODY_JOINTS and control.limbs != "ik")
    named = (*needed, *(setting.bone for setting in table.settings if setting.limbs != "ik"))
    missing = [bone for bone in named if bone not in bones.bones]
    if missing:
        raise InputError(bones.name, f"looks like {table.title} but lacks its controls {', '.join(missing)}; generate it again from the human metarig")
    return tuple(control for control in table.controls if control.bone in bones.bones)


def _poles(bones: Bones, table: Table) -> tuple[Pole, ...]:
    """The table's poles, if the armature has them and all controls of its inverse kinematics."""
    needed = (*(pole.bone for pole in table.poles), *(item.bone for item in (*table.controls, *table.settings) if item.limbs == "ik"))
    return table.poles if all(bone in bones.bones for bone in needed) else ()
