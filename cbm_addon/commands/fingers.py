"""`fingers`: the fingers of an armature, and its body if asked, keep clear of the meshes of its scene, in a blend file."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..console import Console
from ..errors import InputError

if TYPE_CHECKING:
    from ..takes.take import Take

HELP = "pose an armature's fingers (and body) so that they touch and do not pierce, and save a blend file"
HANDS = ("left", "right")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--blend", type=Path, metavar="IN.blend", help="the file with the armature (default: the one that is open); it is not changed")
    parser.add_argument("--rig", metavar="NAME", required=True, help="an armature of the file")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="OUT.blend", help="the blend file to write")
    parser.add_argument("--obstacles", metavar="COLLECTION", help="what fingers must not enter (default: everything visible that is not of the character)")
    parser.add_argument("--hands", metavar="left,right", help="which hands (default: those that have fingers)")
    parser.add_argument("--frames", metavar="A:B", help="first and last frame (default: those of the scene)")
    parser.add_argument("--grasp", action="store_true", help="close the fingers until they rest on what they can reach")
    parser.add_argument("--body", action="store_true", help="move the whole body out of what it pierces first; trackers and planted feet stay")
    parser.add_argument("--hold", type=float, default=1.0, metavar="W", help="with --body: how strongly head and wrists stay with their trackers (default: 1)")
    parser.add_argument("--strength", type=float, default=1.0, metavar="S", help="from 0, leave the fingers as they are, to 1 (default)")
    parser.add_argument("--seed", type=int, default=0, help="the same seed gives the same fingers")
    parser.add_argument("--take", type=Path, metavar="TAKE", help="bend the fingers by the triggers and grips of this recording, then avoid")
    parser.add_argument("--map", type=Path, metavar="MAP.json", help="which bones play which joints, as `cbm rigs --save-map` writes it (default: recognised)")


def run(args: argparse.Namespace, console: Console) -> dict[str, Any]:
    try:
        from ..scene import blend_file
        from ..scene.body import ClearOptions, clear_body
        from ..scene.fingers import PoseOptions, has_fingers, pose_fingers
        from ..scene.obstacles import find_collection
    except ModuleNotFoundError as error:
        raise InputError(error.name or "bpy", "is not installed here; run `fingers` inside Blender, or `pip install bpy`") from error
    from ..body.avoid import BodyOptions
    from ..hands.avoid import FingerOptions
    from ..outputs import replacing
    from ..rigs.tables import load_table

    sides, frames = _sides(args.hands), _frames(args.frames)
    if not 0 <= args.strength <= 1:
        raise InputError("--strength", f"is {args.strength:g}; it is from 0 to 1")
    blend_file.check_files(args.blend, blend_file.opened(), args.output)
    take = _pressed(args.take) if args.take else None
    table = load_table(args.map) if args.map else None
    if args.hold < 0:
        raise InputError("--hold", f"is {args.hold:g}; it is from 0, head and wrists may go anywhere, upwards")
    with replacing(args.output, args.overwrite) as temporary:
        target = blend_file.open_target(args.blend, args.rig, None)
        collection = find_collection(args.obstacles) if args.obstacles else None
        found: dict[str, Any] = {}
        if args.body:
            solve = BodyOptions(strength=args.strength, hold=args.hold, seed=args.seed)
            body = console.run(clear_body(target.context, target.armature, ClearOptions(collection, frames, solve, table)))
            console.say(f"body: {body.summary}")
            found["body"] = asdict(body)
        if not args.body or sides or has_fingers(target.armature, table):
            solving = FingerOptions(strength=args.strength, grasp=args.grasp, seed=args.seed)
            options = PoseOptions(sides=sides, collection=collection, frames=frames, solve=solving, take=take, table=table)
            report = console.run(pose_fingers(target.context, target.armature, options))
            for side, hand in report.hands.items():
                console.say(f"{side.lower()} hand: {hand.summary}")
            console.say(f"fingers: {report.summary}")
            found |= asdict(report)
        blend_file.save_blend(temporary)
    console.say(f"{args.output}: open with `blender {args.output}`")
    return {"output": args.output, "rig": target.armature.name, **found}


def _sides(text: str | None) -> tuple[str, ...] | None:
    if text is None:
        return None
    named = [name.strip().lower() for name in text.split(",")]
    if not named or any(name not in HANDS for name in named):
        raise InputError("--hands", f"is {text}; name left, right, or left,right")
    return tuple(dict.fromkeys(name.capitalize() for name in named))


def _frames(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    try:
        first, last = (int(part) for part in text.split(":"))
    except ValueError:
        raise InputError("--frames", f"is {text}; give the first and the last frame, like 1:250") from None
    return first, last


def _pressed(path: Path) -> Take:
    """A take with triggers or grips; InputError if it has none."""
    from ..takes.readers import read_take
    from ..takes.take import EXTRAS

    take = read_take(path)
    wanted = [name for name in EXTRAS if name.startswith(("trigger", "grip"))]
    if not any(name in take.extras for name in wanted):
        raise InputError(path, f"has no values of triggers or grips; its columns would be {', '.join(wanted)}")
    return take
