"""What the panel holds between its steps: settings of the scene, and what the last step found."""

from __future__ import annotations

from pathlib import Path

import bpy

from ..cbm_addon.errors import InputError
from ..cbm_addon.features import MODES
from ..cbm_addon.hands.avoid import FingerOptions
from ..cbm_addon.rigs.recognize import recognize, summary
from ..cbm_addon.rigs.tables import Table, load_table
from ..cbm_addon.scene.fingers import PoseOptions
from ..cbm_addon.scene.rig import find_armature, read_bones
from ..cbm_addon.solve.models import DEFAULT_MODEL
from ..cbm_addon.solve.perform import SolveOptions
from ..cbm_addon.takes.calibrate import CalibrationOptions
from ..cbm_addon.takes.devices import CONTROLLERS, NO_DEVICE
from ..cbm_addon.takes.frames import AXES, METRES
from ..cbm_addon.takes.recording import TakeOverrides
from ..cbm_addon.takes.take import Take

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

    def overrides(self) -> TakeOverrides:
        swap = {"SWAP": True, "KEEP": False}.get(self.swap_hands)
        return TakeOverrides(
            _given(self.unit), _given(self.axes), swap, self.rate or None, keep_outliers=self.keep_outliers, join_teleports=self.join_teleports
        )

    def calibration(self) -> CalibrationOptions:
        return CalibrationOptions(
            eye_height=self.eye_height or None,
            floor=None if self.measure_floor else self.floor,
            device=_given(self.device),
            seated=self.seated,
        )


def map_of_bones(**more):
    says = "File that says which bones play which joints, as `cbm rigs --save-map` writes it; they are recognised if it is empty"
    return bpy.props.StringProperty(name="Map", description=says, subtype="FILE_PATH", **more)


class RigProperties:
    """Which bones play which joints, and what carries the way over the ground."""

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

    def table(self) -> Table | None:
        return load_table(Path(bpy.path.abspath(self.map))) if self.map else None


CALIBRATION_NAMES = tuple(CalibrationProperties.__annotations__)


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
        description="What fingers must not enter; everything visible that does not belong to the character if empty",
        type=bpy.types.Collection,
    )
    use_range: bpy.props.BoolProperty(name="Frame Range", description="Pose these frames only; otherwise all frames of the scene")
    frame_start: bpy.props.IntProperty(name="Start", description="First frame", default=1)
    frame_end: bpy.props.IntProperty(name="End", description="Last frame", default=250)
    strength: bpy.props.FloatProperty(name="Strength", description="0 leaves the fingers as they are", default=1, min=0, max=1, subtype="FACTOR")
    grasp: bpy.props.BoolProperty(name="Grasp", description="Close the fingers until they rest on what they can reach")
    buttons: bpy.props.BoolProperty(
        name="Trigger and Grip", description="Bend the fingers by the triggers and grips of the take first; otherwise keep their animation, or relax them"
    )
    summary: bpy.props.StringProperty(name="Result", description="What became of each hand, a line each")

    def options(self, table: Table | None, take: Take | None) -> PoseOptions:
        return PoseOptions(
            sides=None if self.hands == "BOTH" else (self.hands.capitalize(),),
            collection=self.obstacles,
            frames=(self.frame_start, self.frame_end) if self.use_range else None,
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
        items=[("full", "Full Body", "Key the whole body"), ("lower", "Hips and Legs", "Key hips and legs only; the animation of the upper body stays")],
    )

    fingers: bpy.props.PointerProperty(type=CBM_PG_fingers)

    def solve_options(self) -> SolveOptions:
        return SolveOptions(self.mode, self.candidates, self.variation, self.seed)

    def model_folder(self) -> Path:
        return Path(bpy.path.abspath(self.model)) if self.model else DEFAULT_MODEL
