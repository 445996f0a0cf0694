"""What the panel holds between its steps: settings of the scene, and what the last step found."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import get_type_hints

import bpy

from ..cbm_addon.body.avoid import BodyOptions
from ..cbm_addon.errors import InputError
from ..cbm_addon.features import MODES
from ..cbm_addon.hands.avoid import FingerOptions
from ..cbm_addon.rigs.recognize import recognize, summary
from ..cbm_addon.rigs.tables import Table, load_table
from ..cbm_addon.scene.bake import BakeOptions
from ..cbm_addon.scene.body import ClearOptions
from ..cbm_addon.scene.fingers import PoseOptions
from ..cbm_addon.scene.reduction import Reduction
from ..cbm_addon.scene.rig import find_armature, read_bones
from ..cbm_addon.solve.models import DEFAULT_MODEL
from ..cbm_addon.solve.perform import SolveOptions
from ..cbm_addon.takes.calibrate import Calibration, CalibrationOptions
from ..cbm_addon.takes.devices import CONTROLLERS, NO_DEVICE
from ..cbm_addon.takes.frames import AXES, METRES
from ..cbm_addon.takes.recording import ROTATION_ORDERS, TakeOverrides
from ..cbm_addon.takes.take import Take
from .import_take import load_take

MEASURE = ("MEASURE", "Measure", "Find it in the take")


def choices(names) -> list[tuple[str, str, str]]:
    """Enum items that begin with "measure"."""
    return [MEASURE, *((name, name, "") for name in names)]


def armatures_only(self: bpy.types.PropertyGroup, obj: bpy.types.Object) -> bool:
    return obj.type == "ARMATURE"


class CalibrationProperties:
    """The constants of a take that a user may know better; the measured or assumed value is used where nothing is given."""

    unit: bpy.props.EnumProperty(name="Unit", description="Unit of the take's positions", items=choices(METRES))
    axes: bpy.props.EnumProperty(name="Axes", description="Axes of the take", items=choices(AXES))
    swap_hands: bpy.props.EnumProperty(
        name="Hands", description="Whether left and right are exchanged", items=[MEASURE, ("SWAP", "Swap", ""), ("KEEP", "As They Are", "")]
    )
    eye_height: bpy.props.FloatProperty(name="Eye Height", description="Standing eye height; 0 measures it", min=0, max=2.5, unit="LENGTH")
    floor: bpy.props.FloatProperty(name="Floor", description="Height of the floor in the take", unit="LENGTH")
    measure_floor: bpy.props.BoolProperty(name="Measure Floor", description="Take the floor from the recording", default=True)
    device: bpy.props.EnumProperty(name="Device", description="Which controllers were held", items=choices((*CONTROLLERS, NO_DEVICE)))
    rate: bpy.props.FloatProperty(name="Rate", description="Samples per second; 0 takes them from the file", min=0, max=1000)
    keep_outliers: bpy.props.BoolProperty(name="Keep Outliers", description="Keep samples that no hand or head can have reached")
    join_teleports: bpy.props.BoolProperty(name="Join Teleports", description="Go on where the take was after a jump of the whole tracking space")
    seated: bpy.props.BoolProperty(name="Seated", description="The performer sits throughout")
    rotation_order: bpy.props.EnumProperty(
        name="Rotation Order", description="In which order Euler angles turn, where the format does not say", items=choices(ROTATION_ORDERS)
    )
    own_offsets: bpy.props.BoolProperty(name="Own Offsets", description="Say where the joints are, seen from the devices, instead of going by the device")
    head_offset: bpy.props.FloatVectorProperty(
        name="Headset to Head", description="From between the eyes to the base of the skull: left, back, up in the headset's frame", size=3, unit="LENGTH"
    )
    wrist_offset: bpy.props.FloatVectorProperty(
        name="Controller to Wrist", description="From the left controller to the left wrist, in the controller's frame; mirrored", size=3, unit="LENGTH"
    )

    def overrides(self) -> TakeOverrides:
        swap = {"SWAP": True, "KEEP": False}.get(self.swap_hands)
        return TakeOverrides(
            _given(self.unit),
            _given(self.axes),
            swap,
            self.rate or None,
            _given(self.rotation_order),
            keep_outliers=self.keep_outliers,
            join_teleports=self.join_teleports,
        )

    def calibration(self) -> CalibrationOptions:
        return CalibrationOptions(
            eye_height=self.eye_height or None,
            floor=None if self.measure_floor else self.floor,
            device=_given(self.device),
            head_offset=tuple(self.head_offset) if self.own_offsets else None,
            wrist_offset=tuple(self.wrist_offset) if self.own_offsets else None,
            seated=self.seated,
        )


def map_of_bones(**more):
    says = "File that says which bones play which joints, as `cbm rigs --save-map` writes it; they are recognised if it is empty"
    return bpy.props.StringProperty(name="Map", description=says, subtype="FILE_PATH", **more)


class RigProperties:
    """Which bones play which joints, what carries the way over the ground, and how limbs are keyed."""

    map: map_of_bones()
    root: bpy.props.EnumProperty(
        name="Root Motion",
        description="What carries the way over the ground",
        items=[
            ("hips", "Hips", "The hips move through the world"),
            ("bone", "Root Bone", "The topmost bone above the hips carries them"),
            ("object", "Object", "The armature's object moves"),
            ("in-place", "In Place", "Nothing: the body stays over its spot"),
        ],
    )
    limbs: bpy.props.EnumProperty(
        name="Limbs",
        description="Which controls of arms and legs are keyed, on a generated Rigify rig",
        items=[
            ("fk", "FK", "Forward kinematics"),
            ("ik", "IK", "Inverse kinematics: hands, feet and poles"),
            ("both", "FK and IK", "Both, in agreement, switched to inverse kinematics"),
        ],
    )

    def table(self) -> Table | None:
        return load_table(Path(bpy.path.abspath(self.map))) if self.map else None


CALIBRATION_NAMES = tuple(CalibrationProperties.__annotations__)
unwatched = ContextVar("unwatched", default=False)


@contextmanager
def changing_many() -> Iterator[None]:
    """While the body runs, changed settings do not calibrate the take."""
    token = unwatched.set(True)
    try:
        yield
    finally:
        unwatched.reset(token)


def calibrate_again(settings: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    """Shows at once what a changed setting makes of the take: its trackers move."""
    if unwatched.get() or not settings.take:
        return
    try:
        load_take(context, Path(settings.take))
    except InputError as error:
        settings.take_summary = f"! {error}"


def watched() -> dict[str, object]:
    """The calibration's properties with `calibrate_again` on each."""
    properties = get_type_hints(CalibrationProperties)
    return {name: properties[name].function(**{**properties[name].keywords, "update": calibrate_again}) for name in CALIBRATION_NAMES}


def _given(choice: str) -> str | None:
    return None if choice == MEASURE[0] else choice


def describe_rig(settings: bpy.types.PropertyGroup, context: bpy.types.Context) -> None:
    """Shows in the panel what the chosen armature is taken for."""
    if settings.rig is None:
        settings.rig_summary = ""
        return
    try:
        settings.rig_summary = "\n".join(summary(recognize(read_bones(settings.rig), settings.table())))
    except InputError as error:
        settings.rig_summary = f"! {error}"


def chosen_armature(context: bpy.types.Context, name: str) -> bpy.types.Object:
    """The armature of that name, or the panel's, or the active one; InputError if there is none."""
    if name:
        return find_armature(name)
    chosen = context.scene.cbm.rig or context.active_object
    if chosen is None:
        raise InputError("Rig", "none is chosen; choose an armature")
    return chosen


class CBM_PG_fingers(bpy.types.PropertyGroup):
    hands: bpy.props.EnumProperty(
        name="Hands",
        items=[("BOTH", "Both", "The hands that have fingers"), ("LEFT", "Left", "The left hand"), ("RIGHT", "Right", "The right hand")],
    )
    obstacles: bpy.props.PointerProperty(
        name="Obstacles",
        description="What fingers and body must not enter; everything visible that does not belong to the character if empty",
        type=bpy.types.Collection,
    )
    use_range: bpy.props.BoolProperty(name="Frame Range", description="Pose these frames only; otherwise all frames of the scene")
    frame_start: bpy.props.IntProperty(name="Start", description="First frame", default=1)
    frame_end: bpy.props.IntProperty(name="End", description="Last frame", default=250)
    strength: bpy.props.FloatProperty(name="Strength", description="0 leaves fingers and body as they are", default=1, min=0, max=1, subtype="FACTOR")
    grasp: bpy.props.BoolProperty(name="Grasp", description="Close the fingers until they rest on what they can reach")
    buttons: bpy.props.BoolProperty(
        name="Trigger and Grip", description="Bend the fingers by the triggers and grips of the take first; otherwise keep their animation, or relax them"
    )
    hold: bpy.props.FloatProperty(
        name="Hold", description="How strongly head and wrists stay with their trackers when the body makes way", default=1, min=0, soft_max=4
    )
    summary: bpy.props.StringProperty(name="Result", description="What became of each hand, a line each")
    body_summary: bpy.props.StringProperty(name="Body", description="What became of the body")

    def body_options(self, table: Table | None) -> ClearOptions:
        solve = BodyOptions(strength=self.strength, hold=self.hold, seed=self.id_data.cbm.seed)
        return ClearOptions(self.obstacles, self.frames(), solve, table)

    def frames(self) -> tuple[int, int] | None:
        return (self.frame_start, self.frame_end) if self.use_range else None

    def options(self, table: Table | None, take: Take | None) -> PoseOptions:
        return PoseOptions(
            sides=None if self.hands == "BOTH" else (self.hands.capitalize(),),
            collection=self.obstacles,
            frames=self.frames(),
            solve=FingerOptions(strength=self.strength, grasp=self.grasp, seed=self.id_data.cbm.seed),
            take=take,
            table=table,
        )


class CBM_PG_settings(bpy.types.PropertyGroup, CalibrationProperties, RigProperties):
    take: bpy.props.StringProperty(name="Take", description="The three-point recording")
    take_summary: bpy.props.StringProperty(name="Findings", description="What was found and assumed of the take, a line each")
    rig: bpy.props.PointerProperty(name="Rig", description="The armature to animate", type=bpy.types.Object, poll=armatures_only, update=describe_rig)
    map: map_of_bones(update=describe_rig)
    rig_summary: bpy.props.StringProperty(name="Rig Facts", description="What the armature is taken for and what speaks against that, a line each")
    model: bpy.props.StringProperty(name="Model", description="The model folder; the shipped model if empty")
    model_summary: bpy.props.StringProperty(name="Model Facts", description="What the model's card says")
    mode: bpy.props.EnumProperty(
        name="Mode", description="What a frame may know", items=[(name, name.capitalize(), "") for name in MODES], default=SolveOptions().mode
    )
    candidates: bpy.props.IntProperty(
        name="Candidates", description="Futures drawn from the codebook at a time", default=SolveOptions().candidates, min=1, max=64
    )
    variation: bpy.props.IntProperty(name="Variation", description="0 is the most agreed answer, others are different ones", min=0)
    seed: bpy.props.IntProperty(name="Seed", description="The same seed gives the same motion", min=0)
    part: bpy.props.EnumProperty(
        name="Part",
        items=[
            ("full", "Full Body", "Key the whole body"),
            ("lower", "Hips and Legs", "Hips and legs follow the take; head and wrists stay where the rig's animation has them"),
        ],
    )

    fingers: bpy.props.PointerProperty(type=CBM_PG_fingers)

    variations: bpy.props.IntProperty(name="Variations", description="How many are baked at once, each an action", default=1, min=1, max=16)
    push_down: bpy.props.BoolProperty(
        name="NLA Tracks", description="Keep the rig's earlier action, and all variations but the first, as muted NLA tracks", default=False
    )
    fake_user: bpy.props.BoolProperty(name="Fake User", description="Keep the new actions in the file when nothing uses them", default=True)
    reduce: bpy.props.BoolProperty(name="Reduce Keys", description="Thin the keys as far as joints stay near the full bake; standing feet stay put")
    reduce_distance: bpy.props.FloatProperty(name="Distance", description="Millimetres by which a joint may move", default=5, min=0.1, soft_max=20)
    reduce_angle: bpy.props.FloatProperty(name="Angle", description="Degrees by which a joint may turn", default=1, min=0.05, soft_max=10)

    show_calibration: bpy.props.BoolProperty(name="Calibration", description="Correct what was measured of the take; its trackers move at once")
    show_options: bpy.props.BoolProperty(name="Options", description="More about how a take is baked")

    def show_offsets(self, calibration: Calibration) -> None:
        """Own offsets begin as those that the device has."""
        if not self.own_offsets and "head_offset" in calibration.constants:
            with changing_many():
                self.head_offset, self.wrist_offset = (calibration.constants[name].value for name in ("head_offset", "wrist_offset"))

    def bake_options(self) -> BakeOptions:
        reduction = Reduction(self.reduce_distance, self.reduce_angle) if self.reduce else None
        return BakeOptions(self.part, self.solve_options(), self.root, self.table(), self.limbs, reduction, self.fake_user, self.push_down)

    def solve_options(self) -> SolveOptions:
        return SolveOptions(self.mode, self.candidates, self.variation, self.seed)

    def model_folder(self) -> Path:
        return Path(bpy.path.abspath(self.model)) if self.model else DEFAULT_MODEL


CBM_PG_settings.__annotations__.update(watched())
