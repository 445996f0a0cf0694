"""`rigs`: how the armatures of a blend file play a body."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..console import Console
from ..errors import InputError

if TYPE_CHECKING:
    from ..rigs.recognize import Recognition

HELP = "say which bones of a file's armatures play which joints, how sure that is, and save it as a map"
RIVALS = 3  # tables that are named besides the one that fits


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("blend", type=Path, nargs="?", metavar="IN.blend", help="the file (default: the one that is open)")
    parser.add_argument("--rig", metavar="NAME", help="one armature of it (default: all)")
    parser.add_argument("--map", type=Path, metavar="MAP.json", help="try a map of bones instead of recognising them")
    parser.add_argument("--save-map", type=Path, metavar="OUT.json", help="write the map of the armature, to correct and to pass to `bake --map`")


def run(args: argparse.Namespace, console: Console) -> dict[str, Any]:
    try:
        from ..scene import blend_file
        from ..scene.rig import armatures, find_armature, read_bones
    except ModuleNotFoundError as error:
        raise InputError(error.name or "bpy", "is not installed here; run `rigs` inside Blender, or `pip install bpy`") from error
    from ..rigs.recognize import recognize
    from ..rigs.tables import load_table, save_map

    table = load_table(args.map) if args.map else None
    if args.blend:
        blend_file.open_blend(args.blend)
    found = [find_armature(args.rig)] if args.rig else armatures()
    if args.save_map and len(found) != 1:
        raise InputError("--save-map", f"is for one armature, and there are {len(found)}; name one with --rig")
    reports = []
    for armature in found:
        try:
            recognition = recognize(read_bones(armature), table)
        except InputError as refusal:
            if args.rig or args.save_map:
                raise
            console.say(f"{armature.name}\n  ! no body: {refusal.message}")
            reports.append({"rig": armature.name, "refused": refusal.message})
            continue
        console.say(armature.name)
        for line in _lines(recognition):
            console.say(f"  {line}")
        reports.append({"rig": armature.name, **_facts(recognition)})
        if args.save_map:
            save_map(args.save_map, recognition.mapping, args.overwrite)
            console.say(f"{args.save_map}: the map of {armature.name}")
    if not found:
        console.say("no armatures found")
    return {"rigs": reports}


def _lines(recognition: Recognition) -> Iterator[str]:
    from ..rigs.recognize import summary

    yield from summary(recognition)
    if others := [f"{title} {score:.2f}" for title, score in recognition.ranking[1 : 1 + RIVALS]]:
        yield f"then {', '.join(others)}"
    yield ", ".join(f"{joint} {bone}" for joint, bone in recognition.mapping.joints.items())


def _facts(recognition: Recognition) -> dict[str, Any]:
    mapping = recognition.mapping
    return {
        "kind": mapping.kind,
        "score": recognition.score,
        "doubts": recognition.doubts,
        "ranking": recognition.ranking,
        "joints": mapping.joints,
        "fingers": mapping.fingers,
        "twists": mapping.table.twists,
        "root": mapping.root,
    }
