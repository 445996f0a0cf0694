"""Every kind of rig: is it known, and does the bake land on it? `python benchmarks/rigs.py` in an environment with bpy (Linux).

The sample take is baked onto each rig as Blender evaluates it. If the package `bpy-vrm-format` is installed, the humanoid of the VRM add-on is
one of the rigs, and the map that the add-on itself holds is the truth for it.

score      share of the body's joints of the table that fits best which have a bone
wrong      joints that were given another bone than the rig's own description says
shape      required joints that were given another bone once all bones were called Bone.001 and so on; - where that is refused, as a rig must
           be whose bones only follow its controls
exact      largest distance of a bone's head from where its joint was solved, over frames, millimetres
head, wrists   share of frames within 1 cm of the tracker (the wrists: the worse of the two), and the largest angle to it, degrees
slide      median speed over the floor of ankles and toes in contact, cm/s at the performer's size: on the rig, and on the engine's own body
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

REPOSITORY = Path(__file__).resolve().parents[1]
RATE = 30
SHAPES = {"a child of 1.1 m": 1.1, "a giant of 2.2 m": 2.2}
LIMBS = {"long arms": {"ForeArm": 1.3, "Hand": 1.3}, "short legs": {"Leg": 0.75, "Foot": 0.75}, "long thighs": {"Leg": 1.2, "Foot": 0.85}}


@dataclass(frozen=True)
class Case:
    """A rig that is added to the scene by `add`. joints: joint -> bone as the rig's own description has it, or how to ask the rig for that."""

    name: str
    add: Callable[[], object]
    joints: dict[str, str] | Callable[..., dict[str, str]]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=8.0, help="how much of the sample take is baked (default: 8)")
    parser.add_argument("--only", default="", help="only rigs whose name contains this")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as resources:
        os.environ["BLENDER_USER_RESOURCES"] = resources
        sys.path.insert(0, str(REPOSITORY))
        show(args.seconds, args.only)
    os._exit(0)  # Blender 4.5 as a Python module hangs at its exit when classes of an add-on are left


def show(seconds: float, only: str) -> None:
    from cbm_addon.scene.silence import silence
    from cbm_addon.solve.models import load_model
    from cbm_addon.solve.perform import sampled
    from cbm_addon.takes.calibrate import calibrate
    from cbm_addon.takes.sample_motion import sample_take

    calibrated = calibrate(sampled(sample_take(), np.arange(2, 2 + seconds, 1 / 72)))
    calibrated = replace(calibrated, take=replace(calibrated.take, times=calibrated.take.times - calibrated.take.times[0]))
    model = load_model()
    engine = motion_of_the_engine(calibrated, model)
    print(f"{'rig':<34}{'bones':>6}  {'taken for':<22}{'score':>6}{'wrong':>6}{'shape':>6}{'exact':>7}{'head':>14}{'wrists':>14}{'slide':>13}")
    for case in cases():
        if only.lower() in case.name.lower():
            with silence():
                new_file()
                armature = case.add()
                row = measure(armature, case, calibrated, model, engine)
            print(f"{case.name:<34}{row}", flush=True)


def new_file() -> None:
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.render.fps = RATE


def cases() -> Iterator[Case]:
    import bpy

    from cbm_addon.scene.rigify import rigify_human, rigify_metarig
    from tests.sample_rigs import SAMPLE_RIGS, add_armature, bones_at_rest, with_lengths

    yield Case("Rigify, generated", lambda: rigify_human(bpy.context), {})
    yield Case("Rigify, metarig", lambda: rigify_metarig(bpy.context), METARIG)
    yield Case("Rigify, basic metarig", basic_metarig, METARIG)
    if vrm_addon():
        yield Case("VRM add-on's humanoid", vrm_humanoid, vrm_map)
    for i, sample in enumerate(SAMPLE_RIGS):
        pose = ("T", "A", "hanging")[i % 3]
        yield Case(f"{sample.name}, {pose}", lambda sample=sample, pose=pose: add_armature(bones_at_rest(sample, pose)), sample.joints)
    unreal = next(sample for sample in SAMPLE_RIGS if sample.name == "Unreal 4")
    for name, stature in SHAPES.items():
        yield Case(name, lambda stature=stature: add_armature(bones_at_rest(unreal, "A", scale=stature / 1.75)), unreal.joints)
    for name, factors in LIMBS.items():
        yield Case(name, lambda factors=factors: add_armature(with_lengths(unreal, "A", factors)), unreal.joints)


METARIG = {"Hips": "spine", "Spine2": "spine.003", "Neck": "spine.004", "Head": "spine.006"} | {
    f"{side}{joint}": f"{bone}.{side[0]}"
    for side in ("Left", "Right")
    for joint, bone in {
        "Shoulder": "shoulder",
        "Arm": "upper_arm",
        "ForeArm": "forearm",
        "Hand": "hand",
        "UpLeg": "thigh",
        "Leg": "shin",
        "Foot": "foot",
        "Toe": "toe",
    }.items()
}
VRM = {"Hips": "hips", "Spine": "spine", "Spine1": "chest", "Neck": "neck", "Head": "head"} | {
    f"{side}{joint}": f"{side.lower()}_{bone}"
    for side in ("Left", "Right")
    for joint, bone in {
        "Shoulder": "shoulder",
        "Arm": "upper_arm",
        "ForeArm": "lower_arm",
        "Hand": "hand",
        "UpLeg": "upper_leg",
        "Leg": "lower_leg",
        "Foot": "foot",
        "Toe": "toes",
        "HandThumb1": "thumb_metacarpal",
        "HandThumb2": "thumb_proximal",
        "HandIndex1": "index_proximal",
        "HandPinky3": "little_distal",
    }.items()
}


def basic_metarig() -> object:
    import addon_utils
    import bpy

    addon_utils.enable("rigify", default_set=True)
    bpy.ops.object.armature_basic_human_metarig_add()
    return bpy.context.object


def vrm_addon() -> bool:
    from importlib.util import find_spec

    return find_spec("io_scene_vrm") is not None


def vrm_humanoid() -> object:
    import bpy
    import io_scene_vrm

    io_scene_vrm.register()
    bpy.ops.icyp.make_basic_armature()
    return bpy.context.object


def vrm_map(armature) -> dict[str, str]:
    bones = armature.data.vrm_addon_extension.vrm1.humanoid.human_bones
    return {joint: getattr(bones, name).node.bone_name for joint, name in VRM.items()}


def measure(armature, case: Case, calibrated, model, engine) -> str:
    from cbm_addon.rigs.recognize import recognize
    from cbm_addon.scene.rig import read_bones, read_rig

    found = recognize(read_bones(armature))
    truth = case.joints(armature) if callable(case.joints) else case.joints
    rig = read_rig(armature)
    named = rig.mapping.joints | rig.mapping.fingers
    wrong = str(sum(named.get(joint) != bone for joint, bone in truth.items())) if truth else "-"
    made = baked(armature, calibrated, model, engine)
    near, turns = (made.apart < 0.01).mean(axis=0), made.off.max(axis=0)
    return (
        f"{len(rig.bones):>6}  {rig.mapping.kind:<22}{found.score:>6.2f}{wrong:>6}{by_shape(rig):>6}{made.exact:>7.3f}"
        f"{near[0]:>8.1%}{turns[0]:>5.1f}°{near[1:].min():>8.1%}{turns[1:].max():>5.1f}°{made.slide:>6.1f} ({made.engine_slide:.1f})"
    )


@dataclass(frozen=True)
class Baked:
    """What a bake of T frames gave, as Blender evaluates it, at the performer's size.

    exact         largest distance of a bone's head from where its joint was solved, millimetres
    apart         [T, 3]: of head and wrists from their trackers, metres
    off           [T, 3]: degrees between the two
    slide         cm/s, see `slide`
    engine_slide  the same of the engine's own body
    """

    exact: float
    apart: np.ndarray
    off: np.ndarray
    slide: float
    engine_slide: float


def baked(armature, calibrated, model, engine, limbs: str = "fk") -> Baked:
    from cbm_addon.motion.contacts import CONTACT_JOINTS
    from cbm_addon.motion.rotations import difference, inverse, multiply, quat_from_matrix
    from cbm_addon.progress import run
    from cbm_addon.rigs.body import rig_body
    from cbm_addon.scene.action import write_action
    from cbm_addon.scene.bake import rig_channels, solve_on_rig, take_scale
    from cbm_addon.scene.rig import read_rig
    from cbm_addon.solve.perform import SolveOptions, sampled
    from cbm_addon.takes.synthesize import TRACKED_JOINTS

    rig = read_rig(armature)
    solved = rig_body(rig)
    scale = take_scale(solved, calibrated)
    motion = run(solve_on_rig(solved, calibrated, model, SolveOptions(), RATE))
    write_action(armature, "bake", 1.0 + np.arange(len(motion)), list(rig_channels(armature, rig, solved, motion, limbs=limbs)))
    matrices = evaluated(armature, [rig.mapping.joints[name] for name in solved.body.names], len(motion))
    heads = matrices[..., :3, 3]
    tracked = solved.body.indices(TRACKED_JOINTS)
    take = sampled(calibrated.take, motion.times)
    rest = np.stack([multiply(rig.object_rotation, rig.rest_rotation(rig.mapping.joints[name])) for name in TRACKED_JOINTS])
    turned = multiply(multiply(quat_from_matrix(matrices[:, tracked, :3, :3] / rig.scale), inverse(rest)), inverse(solved.alignment[tracked]))
    feet = [name for name in CONTACT_JOINTS if name in solved.body]  # of a rig without toes, the ankles of both are compared
    return Baked(
        exact=1000 * float(np.linalg.norm(heads - motion.positions(), axis=-1).max()) / scale,
        apart=np.linalg.norm(heads[:, tracked] - take.positions * scale, axis=-1) / scale,
        off=np.degrees(difference(turned, take.rotations)),
        slide=slide(heads[:, solved.body.indices(feet)] / scale),
        engine_slide=slide(engine.positions()[:, engine.skeleton.indices(feet)]),
    )


def by_shape(rig) -> str:
    """How many required joints the shape alone gives another bone than the names."""
    from cbm_addon.errors import InputError
    from cbm_addon.rigs.recognize import recognize
    from cbm_addon.rigs.shape import REQUIRED
    from tests.sample_rigs import renamed

    nameless = renamed(rig)
    own = dict(zip(nameless.bones, rig.bones, strict=True))
    try:
        joints = recognize(nameless).mapping.joints
    except InputError:
        return "-"
    return str(sum(own[joints[name]] != rig.mapping.joints[name] for name in REQUIRED))


def evaluated(armature, bones: list[str], frames: int) -> np.ndarray:
    """World matrices [T, B, 4, 4] of pose bones from the dependency graph."""
    import bpy

    matrices = np.empty((frames, len(bones), 4, 4))
    for i in range(frames):
        bpy.context.scene.frame_set(i + 1)
        posed = armature.evaluated_get(bpy.context.evaluated_depsgraph_get())
        matrices[i] = [posed.matrix_world @ posed.pose.bones[bone].matrix for bone in bones]
    return matrices


def slide(feet: np.ndarray) -> float:
    """Median horizontal speed, cm/s, of foot joints [T, N, 3] while they are in contact by the rule of motion/contacts.py."""
    from cbm_addon.motion.contacts import CONTACT_HEIGHT, CONTACT_SPEED

    low = feet[..., 2] < np.percentile(feet[..., 2], 5, axis=0) + CONTACT_HEIGHT
    speed = np.linalg.norm(np.gradient(feet[..., :2], axis=0), axis=-1) * RATE
    return float(100 * np.median(speed[low & (speed < CONTACT_SPEED)]))


def motion_of_the_engine(calibrated, model):
    from cbm_addon.features import proportions_of
    from cbm_addon.motion.resample import frame_times
    from cbm_addon.motion.skeleton import STANDARD_BODY
    from cbm_addon.progress import run
    from cbm_addon.solve.fuse import fuse
    from cbm_addon.solve.perform import SolveOptions, perform

    body = STANDARD_BODY.scaled(calibrated.calibration.head_height / STANDARD_BODY.height_above_toes("Head"))
    performance = run(perform(calibrated.take, calibrated.calibration.head_height, proportions_of(body), model, SolveOptions()))
    return fuse(performance, calibrated.take, frame_times(calibrated.take.times[0], calibrated.take.times[-1], RATE), body)


if __name__ == "__main__":
    main()
