"""Rigs of every kind as armatures at rest: their full lists of bones, which joints those play, and a body's places for them.

The lists are written from the rigs' own descriptions, apart from the tables that recognition uses. A line of a list is a path of bones,
each below the one before it. {s} and {S} stand for both sides, {f} and {F} for all fingers, as the rig and as a joint's name calls them.

    bone=Joint   plays a joint, and is where that is
    bone~Joint   is where a joint is, but does not play it
    bone~0.3     is at that share of the way from its parent to the joint below its parent
    bone~on      goes on from its parent as that goes on from its own
    bone~up      is the top of the head
    bone         is on the way to the next bone that plays a joint, or else a little beside its parent
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from cbm_addon.motion.motion import forward_kinematics
from cbm_addon.motion.rotations import matrix_from_quat, normalize, quat_from_axis_angle, quat_from_rotvec
from cbm_addon.motion.skeleton import STANDARD_BODY
from cbm_addon.rigs.pose import BonePose
from cbm_addon.rigs.rig import FINGERS, SIDES, Bones

if TYPE_CHECKING:
    import bpy

POSES = {"T": 0.0, "A": 50.0, "hanging": 82.0}  # degrees by which the arms are lowered


@dataclass(frozen=True)
class SampleRig:
    """bones: name -> parent, parents first. joints: joint -> bone. places: bone -> where it is, for bones that play none."""

    name: str
    kind: str
    bones: dict[str, str | None]
    joints: dict[str, str]
    places: dict[str, str]


def rig(name: str, kind: str, sides: str, paths: str, fingers: str = "Thumb Index Middle Ring Pinky") -> SampleRig:
    bones: dict[str, str | None] = {}
    joints: dict[str, str] = {}
    places: dict[str, str] = {}
    for line in filter(None, (line.strip() for line in paths.splitlines())):
        for side, own_side in zip(SIDES, sides.split(), strict=True) if "{s}" in line or "{S}" in line else [("", "")]:
            for finger, own_finger in zip(FINGERS, fingers.split(), strict=True) if "{f}" in line else [("", "")]:
                parent = None
                for step in line.split(" > "):
                    step = step.replace("{s}", own_side).replace("{S}", side).replace("{f}", own_finger).replace("{F}", finger)
                    bone, sign, what = re.split("([=~]|$)", step, maxsplit=1)
                    bones.setdefault(bone, parent)
                    if sign == "=":
                        joints[what] = bone
                    elif sign == "~":
                        places[bone] = what
                    parent = bone
    return SampleRig(name, kind, bones, joints, places)


MIXAMO_PATHS = """
    {p}Hips=Hips > {p}Spine=Spine > {p}Spine1=Spine1 > {p}Spine2=Spine2 > {p}Neck=Neck > {p}Head=Head > {p}HeadTop_End~up
    {p}Spine2 > {p}{s}Shoulder={S}Shoulder > {p}{s}Arm={S}Arm > {p}{s}ForeArm={S}ForeArm > {p}{s}Hand={S}Hand
    {p}{s}Hand > {p}{s}Hand{f}1={S}Hand{F}1 > {p}{s}Hand{f}2={S}Hand{F}2 > {p}{s}Hand{f}3={S}Hand{F}3 > {p}{s}Hand{f}4~on
    {p}Hips > {p}{s}UpLeg={S}UpLeg > {p}{s}Leg={S}Leg > {p}{s}Foot={S}Foot > {p}{s}ToeBase={S}Toe > {p}{s}Toe_End~on
"""
UNREAL_LIMBS = """
    {f}_01_{s}={S}Hand{F}1 > {f}_02_{s}={S}Hand{F}2 > {f}_03_{s}={S}Hand{F}3
    pelvis > thigh_{s}={S}UpLeg > calf_{s}={S}Leg > foot_{s}={S}Foot > ball_{s}={S}Toe
    root > ik_foot_root > ik_foot_{s}~{S}Foot
    root > ik_hand_root > ik_hand_gun~RightHand > ik_hand_{s}~{S}Hand
"""
FACE = """
    {head} > jaw > tongue00 > tongue01
    {head} > eye.{s}
    {head} > ear_{s}
"""

SAMPLE_RIGS = (
    rig("Mixamo", "mixamo", "Left Right", MIXAMO_PATHS.replace("{p}", "mixamorig:")),
    rig("Mixamo, another prefix", "mixamo", "Left Right", MIXAMO_PATHS.replace("{p}", "Armature|mixamorig7_")),
    rig(
        "motion capture",
        "mixamo",
        "Left Right",
        """
        Hips=Hips > Spine=Spine > Spine1=Spine1 > Spine2=Spine2 > Neck=Neck > Head=Head
        Neck > {s}Shoulder={S}Shoulder > {s}Arm={S}Arm > {s}ForeArm={S}ForeArm > {s}Hand={S}Hand
        Hips > {s}UpLeg={S}UpLeg > {s}Leg={S}Leg > {s}Foot={S}Foot > {s}Toe={S}Toe
        """,
    ),
    rig(
        "Unreal 4",
        "unreal",
        "l r",
        """
        root > pelvis=Hips > spine_01=Spine > spine_02=Spine1 > spine_03=Spine2 > neck_01=Neck > head=Head
        spine_03 > clavicle_{s}={S}Shoulder > upperarm_{s}={S}Arm > lowerarm_{s}={S}ForeArm > hand_{s}={S}Hand
        upperarm_{s} > upperarm_twist_01_{s}~0.0
        lowerarm_{s} > lowerarm_twist_01_{s}~0.5
        hand_{s} > {f}_01_{s}
        pelvis > thigh_{s} > thigh_twist_01_{s}~0.5
        thigh_{s} > calf_{s} > calf_twist_01_{s}~0.5
        """
        + UNREAL_LIMBS,
        "thumb index middle ring pinky",
    ),
    rig(
        "Unreal 5",
        "unreal",
        "l r",
        """
        root > pelvis=Hips > spine_01=Spine > spine_02=Spine1 > spine_03 > spine_04 > spine_05=Spine2 > neck_01=Neck > neck_02 > head=Head
        spine_05 > clavicle_{s}={S}Shoulder > upperarm_{s}={S}Arm > lowerarm_{s}={S}ForeArm > hand_{s}={S}Hand
        upperarm_{s} > upperarm_twist_01_{s}~0.33 > upperarm_tricep_{s}
        upperarm_{s} > upperarm_twist_02_{s}~0.66
        upperarm_{s} > upperarm_correctiveRoot_{s} > upperarm_in_{s}
        lowerarm_{s} > lowerarm_twist_02_{s}~0.33
        lowerarm_{s} > lowerarm_twist_01_{s}~0.66
        lowerarm_{s} > lowerarm_correctiveRoot_{s} > lowerarm_out_{s}
        hand_{s} > thumb_01_{s}
        hand_{s} > index_metacarpal_{s} > index_01_{s}
        hand_{s} > middle_metacarpal_{s} > middle_01_{s}
        hand_{s} > ring_metacarpal_{s} > ring_01_{s}
        hand_{s} > pinky_metacarpal_{s} > pinky_01_{s}
        pelvis > thigh_{s} > thigh_twist_01_{s}~0.33
        thigh_{s} > thigh_twist_02_{s}~0.66
        thigh_{s} > calf_{s} > calf_twist_02_{s}~0.33
        calf_{s} > calf_twist_01_{s}~0.66
        root > interaction
        root > center_of_mass
        """
        + UNREAL_LIMBS,
        "thumb index middle ring pinky",
    ),
    rig(
        "MakeHuman game engine",
        "unreal",
        "l r",
        """
        Root > pelvis=Hips > spine_01=Spine > spine_02=Spine1 > spine_03=Spine2 > neck_01=Neck > head=Head
        spine_03 > clavicle_{s}={S}Shoulder > upperarm_{s}={S}Arm > lowerarm_{s}={S}ForeArm > hand_{s}={S}Hand
        hand_{s} > {f}_01_{s}={S}Hand{F}1 > {f}_02_{s}={S}Hand{F}2 > {f}_03_{s}={S}Hand{F}3
        pelvis > thigh_{s}={S}UpLeg > calf_{s}={S}Leg > foot_{s}={S}Foot > ball_{s}={S}Toe
        """,
        "thumb index middle ring pinky",
    ),
    rig(
        "MakeHuman default",
        "makehuman",
        "L R",
        """
        root=Hips > spine05=Spine > spine04 > spine03=Spine1 > spine02 > spine01=Spine2 > neck01=Neck > neck02 > neck03 > head=Head
        spine02 > breast.{s}
        spine01 > clavicle.{s}={S}Shoulder > shoulder01.{s} > upperarm01.{s}={S}Arm > upperarm02.{s} > lowerarm01.{s}={S}ForeArm
        lowerarm01.{s} > lowerarm02.{s} > wrist.{s}={S}Hand
        wrist.{s} > finger1-1.{s}
        wrist.{s} > metacarpal1.{s} > finger2-1.{s}
        wrist.{s} > metacarpal2.{s} > finger3-1.{s}
        wrist.{s} > metacarpal3.{s} > finger4-1.{s}
        wrist.{s} > metacarpal4.{s} > finger5-1.{s}
        finger{f}-1.{s}={S}Hand{F}1 > finger{f}-2.{s}={S}Hand{F}2 > finger{f}-3.{s}={S}Hand{F}3
        root > pelvis.{s} > upperleg01.{s}={S}UpLeg > upperleg02.{s} > lowerleg01.{s}={S}Leg > lowerleg02.{s} > foot.{s}={S}Foot
        foot.{s} > toe1-1.{s}~{S}Toe > toe1-2.{s}~on
        foot.{s} > toe2-1.{s}~{S}Toe > toe2-2.{s}~on > toe2-3.{s}~on
        foot.{s} > toe3-1.{s}={S}Toe > toe3-2.{s}~on > toe3-3.{s}~on
        foot.{s} > toe4-1.{s}~{S}Toe > toe4-2.{s}~on > toe4-3.{s}~on
        foot.{s} > toe5-1.{s}~{S}Toe > toe5-2.{s}~on > toe5-3.{s}~on
        head > levator02.{s} > levator03.{s} > levator04.{s} > levator05.{s}
        head > risorius02.{s} > risorius03.{s}
        """
        + FACE.replace("{head}", "head"),
        "1 2 3 4 5",
    ),
    rig(
        "VRM 1",
        "vrm",
        "left right",
        """
        hips=Hips > spine=Spine > chest=Spine1 > upperChest=Spine2 > neck=Neck > head=Head > jaw
        head > {s}Eye
        upperChest > {s}Shoulder={S}Shoulder > {s}UpperArm={S}Arm > {s}LowerArm={S}ForeArm > {s}Hand={S}Hand
        {s}Hand > {s}{f}Proximal={S}Hand{F}1 > {s}{f}Intermediate={S}Hand{F}2 > {s}{f}Distal={S}Hand{F}3
        hips > {s}UpperLeg={S}UpLeg > {s}LowerLeg={S}Leg > {s}Foot={S}Foot > {s}Toes={S}Toe
        """,
        "Thumb Index Middle Ring Little",
    ),
    rig(
        "VRoid",
        "vroid",
        "L R",
        """
        Root > J_Bip_C_Hips=Hips > J_Bip_C_Spine=Spine > J_Bip_C_Chest=Spine1 > J_Bip_C_UpperChest=Spine2 > J_Bip_C_Neck=Neck > J_Bip_C_Head=Head
        J_Bip_C_Head > J_Adj_{s}_FaceEye
        J_Bip_C_Head > J_Sec_Hair1_01 > J_Sec_Hair2_01 > J_Sec_Hair3_01
        J_Bip_C_UpperChest > J_Sec_{s}_Bust1 > J_Sec_{s}_Bust2
        J_Bip_C_UpperChest > J_Bip_{s}_Shoulder={S}Shoulder > J_Bip_{s}_UpperArm={S}Arm > J_Bip_{s}_LowerArm={S}ForeArm > J_Bip_{s}_Hand={S}Hand
        J_Bip_{s}_Hand > J_Bip_{s}_{f}1={S}Hand{F}1 > J_Bip_{s}_{f}2={S}Hand{F}2 > J_Bip_{s}_{f}3={S}Hand{F}3
        J_Bip_C_Hips > J_Bip_{s}_UpperLeg={S}UpLeg > J_Bip_{s}_LowerLeg={S}Leg > J_Bip_{s}_Foot={S}Foot > J_Bip_{s}_ToeBase={S}Toe
        """,
        "Thumb Index Middle Ring Little",
    ),
    rig(
        "Auto-Rig Pro export",
        "auto_rig_pro_export",
        "l r",
        """
        root > root.x=Hips > spine_01.x=Spine > spine_02.x=Spine1 > spine_03.x=Spine2 > neck.x=Neck > head.x=Head
        spine_03.x > shoulder.{s}={S}Shoulder > c_arm_twist_offset.{s}={S}Arm > arm_stretch.{s} > forearm_stretch.{s}={S}ForeArm
        forearm_stretch.{s} > forearm_twist.{s} > hand.{s}={S}Hand
        hand.{s} > c_{f}1_base.{s} > c_{f}1.{s}={S}Hand{F}1 > c_{f}2.{s}={S}Hand{F}2 > c_{f}3.{s}={S}Hand{F}3
        root.x > thigh_twist.{s}={S}UpLeg > thigh_stretch.{s} > leg_stretch.{s}={S}Leg > leg_twist.{s} > foot.{s}={S}Foot > toes_01.{s}={S}Toe
        """,
        "thumb index middle ring pinky",
    ),
    rig(
        "Auto-Rig Pro controls",
        "auto_rig_pro",
        "l r",
        """
        c_pos > c_traj > c_root_master.x=Hips > c_spine_01.x=Spine > c_spine_02.x=Spine1 > c_spine_03.x=Spine2 > c_neck.x=Neck > c_head.x=Head
        c_root_master.x > c_root.x
        c_spine_03.x > c_shoulder.{s}={S}Shoulder > c_arm_fk.{s}={S}Arm > c_forearm_fk.{s}={S}ForeArm > c_hand_fk.{s}={S}Hand
        c_hand_fk.{s} > c_{f}1_base.{s} > c_{f}1.{s}={S}Hand{F}1 > c_{f}2.{s}={S}Hand{F}2 > c_{f}3.{s}={S}Hand{F}3
        c_root_master.x > c_thigh_b.{s} > c_thigh_fk.{s}={S}UpLeg > c_leg_fk.{s}={S}Leg > c_foot_fk.{s}={S}Foot > c_toes_fk.{s}={S}Toe
        c_traj > c_hand_ik.{s}~{S}Hand
        c_traj > c_foot_ik.{s}~{S}Foot
        """,
        "thumb index middle ring pinky",
    ),
    rig(
        "SMPL",
        "smpl",
        "L R",
        """
        Pelvis=Hips > Spine1=Spine > Spine2=Spine1 > Spine3=Spine2 > Neck=Neck > Head=Head
        Spine3 > {s}_Collar={S}Shoulder > {s}_Shoulder={S}Arm > {s}_Elbow={S}ForeArm > {s}_Wrist={S}Hand > {s}_Hand~on
        Pelvis > {s}_Hip={S}UpLeg > {s}_Knee={S}Leg > {s}_Ankle={S}Foot > {s}_Foot={S}Toe
        """,
    ),
    rig(
        "SMPL-X",
        "smpl",
        "left right",
        """
        root > pelvis=Hips > spine1=Spine > spine2=Spine1 > spine3=Spine2 > neck=Neck > head=Head > jaw
        head > {s}_eye_smplhf
        spine3 > {s}_collar={S}Shoulder > {s}_shoulder={S}Arm > {s}_elbow={S}ForeArm > {s}_wrist={S}Hand
        {s}_wrist > {s}_{f}1={S}Hand{F}1 > {s}_{f}2={S}Hand{F}2 > {s}_{f}3={S}Hand{F}3
        pelvis > {s}_hip={S}UpLeg > {s}_knee={S}Leg > {s}_ankle={S}Foot > {s}_foot={S}Toe
        """,
        "thumb index middle ring pinky",
    ),
    rig(
        "CMU",
        "cmu",
        "l r",
        """
        root=Hips > lowerback=Spine > upperback=Spine1 > thorax=Spine2 > lowerneck=Neck > upperneck > head=Head
        thorax > {s}clavicle={S}Shoulder > {s}humerus={S}Arm > {s}radius={S}ForeArm > {s}wrist={S}Hand > {s}hand~on > {s}fingers~on
        {s}wrist > {s}thumb
        root > {s}hipjoint > {s}femur={S}UpLeg > {s}tibia={S}Leg > {s}foot={S}Foot > {s}toes={S}Toe
        """,
    ),
    rig(
        "CMU, MotionBuilder names",
        "cmu_bvh",
        "Left Right",
        """
        Hips=Hips > LowerBack=Spine > Spine=Spine1 > Spine1=Spine2 > Neck=Neck > Neck1 > Head=Head
        Spine1 > {s}Shoulder={S}Shoulder > {s}Arm={S}Arm > {s}ForeArm={S}ForeArm > {s}Hand={S}Hand > {s}FingerBase~on > {s}HandIndex1~on
        {s}Hand > {s}Thumb
        Hips > {s}HipJoint > {s}UpLeg={S}UpLeg > {s}Leg={S}Leg > {s}Foot={S}Foot > {s}ToeBase={S}Toe
        """,
    ),
    rig(
        "Daz Genesis 8",
        "daz",
        "l r",
        """
        hip=Hips > abdomenLower=Spine > abdomenUpper=Spine1 > chestLower > chestUpper=Spine2 > neckLower=Neck > neckUpper > head=Head
        chestLower > {s}Pectoral
        chestUpper > {s}Collar={S}Shoulder > {s}ShldrBend={S}Arm > {s}ShldrTwist > {s}ForearmBend={S}ForeArm > {s}ForearmTwist > {s}Hand={S}Hand
        {s}Hand > {s}Thumb1
        {s}Hand > {s}Carpal1 > {s}Index1
        {s}Hand > {s}Carpal2 > {s}Mid1
        {s}Hand > {s}Carpal3 > {s}Ring1
        {s}Hand > {s}Carpal4 > {s}Pinky1
        {s}{f}1={S}Hand{F}1 > {s}{f}2={S}Hand{F}2 > {s}{f}3={S}Hand{F}3
        hip > pelvis > {s}ThighBend={S}UpLeg > {s}ThighTwist > {s}Shin={S}Leg > {s}Foot={S}Foot > {s}Metatarsals > {s}Toe={S}Toe
        {s}Toe > {s}BigToe~on > {s}BigToe_2
        {s}Toe > {s}SmallToe1~on > {s}SmallToe1_2
        {s}Toe > {s}SmallToe4~on > {s}SmallToe4_2
        head > upperTeeth
        head > lowerJaw > tongue01 > tongue02
        """,
        "Thumb Index Mid Ring Pinky",
    ),
    rig(
        "Daz Genesis 9",
        "daz",
        "l r",
        """
        hip=Hips > spine1=Spine > spine2=Spine1 > spine3 > spine4=Spine2 > neck1=Neck > neck2 > head=Head
        spine4 > {s}_shoulder={S}Shoulder > {s}_upperarm={S}Arm > {s}_forearm={S}ForeArm > {s}_hand={S}Hand
        {s}_upperarm > {s}_upperarmtwist1~0.33
        {s}_upperarm > {s}_upperarmtwist2~0.66
        {s}_forearm > {s}_forearmtwist1~0.33
        {s}_forearm > {s}_forearmtwist2~0.66
        {s}_hand > {s}_{f}1={S}Hand{F}1 > {s}_{f}2={S}Hand{F}2 > {s}_{f}3={S}Hand{F}3
        hip > pelvis > {s}_thigh={S}UpLeg > {s}_shin={S}Leg > {s}_foot={S}Foot > {s}_toes={S}Toe > {s}_bigtoe1~on > {s}_bigtoe2
        {s}_thigh > {s}_thightwist1~0.33
        """,
        "thumb index mid ring pinky",
    ),
    rig(
        "Meta, OpenXR body",
        "meta",
        "LEFT RIGHT",
        """
        ROOT > HIPS=Hips > SPINE_LOWER=Spine > SPINE_MIDDLE=Spine1 > SPINE_UPPER > CHEST=Spine2 > NECK=Neck > HEAD=Head
        CHEST > {s}_SHOULDER={S}Shoulder > {s}_SCAPULA > {s}_ARM_UPPER={S}Arm > {s}_ARM_LOWER={S}ForeArm > {s}_HAND_WRIST={S}Hand
        {s}_ARM_LOWER > {s}_HAND_WRIST_TWIST~1.0
        {s}_HAND_WRIST > {s}_HAND_PALM
        {s}_HAND_WRIST > {s}_HAND_THUMB_METACARPAL={S}HandThumb1 > {s}_HAND_THUMB_PROXIMAL={S}HandThumb2 > {s}_HAND_THUMB_DISTAL={S}HandThumb3
        {s}_HAND_WRIST > {s}_HAND_INDEX_METACARPAL > {s}_HAND_INDEX_PROXIMAL={S}HandIndex1
        {s}_HAND_INDEX_PROXIMAL > {s}_HAND_INDEX_INTERMEDIATE={S}HandIndex2 > {s}_HAND_INDEX_DISTAL={S}HandIndex3
        {s}_HAND_WRIST > {s}_HAND_MIDDLE_METACARPAL > {s}_HAND_MIDDLE_PROXIMAL={S}HandMiddle1
        {s}_HAND_MIDDLE_PROXIMAL > {s}_HAND_MIDDLE_INTERMEDIATE={S}HandMiddle2 > {s}_HAND_MIDDLE_DISTAL={S}HandMiddle3
        {s}_HAND_WRIST > {s}_HAND_RING_METACARPAL > {s}_HAND_RING_PROXIMAL={S}HandRing1
        {s}_HAND_RING_PROXIMAL > {s}_HAND_RING_INTERMEDIATE={S}HandRing2 > {s}_HAND_RING_DISTAL={S}HandRing3
        {s}_HAND_WRIST > {s}_HAND_LITTLE_METACARPAL > {s}_HAND_LITTLE_PROXIMAL={S}HandPinky1
        {s}_HAND_LITTLE_PROXIMAL > {s}_HAND_LITTLE_INTERMEDIATE={S}HandPinky2 > {s}_HAND_LITTLE_DISTAL={S}HandPinky3
        {s}_HAND_{f}_DISTAL > {s}_HAND_{f}_TIP~on
        HIPS > {s}_UPPER_LEG={S}UpLeg > {s}_LOWER_LEG={S}Leg > {s}_FOOT_ANKLE={S}Foot > {s}_FOOT_SUBTALAR > {s}_FOOT_TRANSVERSE > {s}_FOOT_BALL={S}Toe
        {s}_LOWER_LEG > {s}_FOOT_ANKLE_TWIST~1.0
        """,
        "THUMB INDEX MIDDLE RING LITTLE",
    ),
    rig(
        "Character Creator",
        "character_creator",
        "L R",
        """
        RL_BoneRoot > CC_Base_Hip=Hips > CC_Base_Waist=Spine > CC_Base_Spine01=Spine1 > CC_Base_Spine02=Spine2
        CC_Base_Spine02 > CC_Base_NeckTwist01=Neck > CC_Base_NeckTwist02 > CC_Base_Head=Head
        CC_Base_Head > CC_Base_FacialBone > CC_Base_JawRoot > CC_Base_Tongue01
        CC_Base_FacialBone > CC_Base_{s}_Eye
        CC_Base_Spine02 > CC_Base_{s}_RibsTwist > CC_Base_{s}_Breast
        CC_Base_Spine02 > CC_Base_{s}_Clavicle={S}Shoulder > CC_Base_{s}_Upperarm={S}Arm > CC_Base_{s}_Forearm={S}ForeArm > CC_Base_{s}_Hand={S}Hand
        CC_Base_{s}_Upperarm > CC_Base_{s}_UpperarmTwist01~0.33 > CC_Base_{s}_UpperarmTwist02
        CC_Base_{s}_Forearm > CC_Base_{s}_ForearmTwist01~0.33 > CC_Base_{s}_ForearmTwist02
        CC_Base_{s}_Forearm > CC_Base_{s}_ElbowShareBone~0.0
        CC_Base_{s}_Hand > CC_Base_{s}_{f}1={S}Hand{F}1 > CC_Base_{s}_{f}2={S}Hand{F}2 > CC_Base_{s}_{f}3={S}Hand{F}3
        CC_Base_Hip > CC_Base_Pelvis > CC_Base_{s}_Thigh={S}UpLeg > CC_Base_{s}_Calf={S}Leg > CC_Base_{s}_Foot={S}Foot
        CC_Base_{s}_Foot > CC_Base_{s}_ToeBase={S}Toe > CC_Base_{s}_BigToe1~on
        CC_Base_{s}_Foot > CC_Base_{s}_ToeBaseShareBone
        CC_Base_{s}_Thigh > CC_Base_{s}_ThighTwist01~0.33 > CC_Base_{s}_ThighTwist02
        CC_Base_{s}_Thigh > CC_Base_{s}_KneeShareBone~1.0
        CC_Base_{s}_Calf > CC_Base_{s}_CalfTwist01~0.33 > CC_Base_{s}_CalfTwist02
        """,
        "Thumb Index Mid Ring Pinky",
    ),
    rig(
        "3ds Max Biped",
        "biped",
        "L R",
        """
        Bip001 > Bip001 Pelvis=Hips > Bip001 Spine=Spine > Bip001 Spine1=Spine1 > Bip001 Spine2=Spine2 > Bip001 Neck=Neck > Bip001 Head=Head
        Bip001 Spine2 > Bip001 {s} Clavicle={S}Shoulder > Bip001 {s} UpperArm={S}Arm > Bip001 {s} Forearm={S}ForeArm > Bip001 {s} Hand={S}Hand
        Bip001 {s} Forearm > Bip001 {s} ForeTwist~0.5
        Bip001 {s} Hand > Bip001 {s} Finger{f}={S}Hand{F}1 > Bip001 {s} Finger{f}1={S}Hand{F}2 > Bip001 {s} Finger{f}2={S}Hand{F}3
        Bip001 Pelvis > Bip001 {s} Thigh={S}UpLeg > Bip001 {s} Calf={S}Leg > Bip001 {s} Foot={S}Foot > Bip001 {s} Toe0={S}Toe
        """,
        "0 1 2 3 4",
    ),
)


# Rest poses


def joint_positions(lowered: float) -> dict[str, np.ndarray]:
    """World positions of the joints of a standing body of 1.75 m with fingers, arms lowered by degrees, elbows and knees a little bent."""
    angles = {"Arm": np.radians(lowered), "UpLeg": 0.0}
    pose = np.tile(np.array([1.0, 0, 0, 0]), (len(STANDARD_BODY), 1))
    for side, sign in (("Left", 1), ("Right", -1)):
        pose[STANDARD_BODY.index(f"{side}Arm")] = quat_from_rotvec(np.array([0, sign * angles["Arm"], 0]))
        pose[STANDARD_BODY.index(f"{side}ForeArm")] = quat_from_rotvec(np.array([0, 0, -0.15 * sign]))
        pose[STANDARD_BODY.index(f"{side}UpLeg")] = quat_from_rotvec(np.array([-0.05, -0.05 * sign, 0]))
        pose[STANDARD_BODY.index(f"{side}Leg")] = quat_from_rotvec(np.array([0.1, 0, 0]))
        pose[STANDARD_BODY.index(f"{side}Foot")] = quat_from_rotvec(np.array([-0.05, 0.05 * sign, 0.1 * sign]))
    world, heads = forward_kinematics(STANDARD_BODY, np.array([0, 0, 0.92]), pose)
    at = dict(zip(STANDARD_BODY.names, heads, strict=True))
    for side, sign in (("Left", 1), ("Right", -1)):
        hand = STANDARD_BODY.index(f"{side}Hand")
        turn = matrix_from_quat(world[hand])
        for finger, across in (("Thumb", -0.03), ("Index", -0.03), ("Middle", -0.01), ("Ring", 0.01), ("Pinky", 0.03)):
            start, step = (0.03, 0.03) if finger == "Thumb" else (0.09, 0.028)
            toward = np.array([sign * 0.7, -0.7, -0.1]) if finger == "Thumb" else np.array([sign, 0.03 * across, -0.15])
            for phalanx in range(3):
                at[f"{side}Hand{finger}{phalanx + 1}"] = heads[hand] + turn @ (np.array([sign * start, across, -0.01]) + phalanx * step * toward)
    return at


def bone_heads(sample: SampleRig, lowered: float) -> np.ndarray:
    """Heads [B, 3] of all bones, as the list says."""
    at, joint_of = joint_positions(lowered), {bone: joint for joint, bone in sample.joints.items()}
    below = {parent: [bone for bone in sample.bones if sample.bones[bone] == parent] for parent in sample.bones}
    heads: dict[str, np.ndarray] = {}

    def next_joint(bone: str) -> tuple[int, np.ndarray] | None:
        """How many bones further down the first joint is, and where."""
        if bone in joint_of:
            return 0, at[joint_of[bone]]
        found = [(steps + 1, place) for steps, place in filter(None, map(next_joint, below[bone]))]
        return min(found, key=lambda item: item[0], default=None)

    def place(i: int, bone: str, parent: str | None) -> np.ndarray:
        where, following = sample.places.get(bone, ""), next_joint(bone)
        if bone in joint_of or where in at:
            return at[joint_of.get(bone, where)]
        if parent is None:
            return np.zeros(3)
        if where == "on":
            return heads[parent] + 0.6 * (heads[parent] - heads[str(sample.bones[parent])])
        if where == "up":
            return heads[parent] + [0, 0, 0.18]
        if where:
            limb = next(joint_of[child] for child in below[parent] if child in joint_of)
            return heads[parent] + float(where) * (at[limb] - heads[parent])
        if following:
            return heads[parent] + (following[1] - heads[parent]) / (following[0] + 1)
        return heads[parent] + np.random.default_rng(i).uniform(-0.03, 0.03, 3)

    for i, (bone, parent) in enumerate(sample.bones.items()):
        heads[bone] = place(i, bone, parent)
    return np.array(list(heads.values()))


def bones_at_rest(sample: SampleRig, pose: str = "T", object_matrix: np.ndarray | None = None, scale: float = 1.0, seed: int = 0) -> Bones:
    """A sample rig at rest in a pose of POSES, standing at the world's origin and facing -Y if its object is not moved.

    A bone points to its first child, or on from its parent; its roll is anything. `scale` multiplies all lengths in armature space.
    """
    names, above = list(sample.bones), list(sample.bones.values())
    heads = bone_heads(sample, POSES[pose]) * scale
    random = np.random.default_rng(seed)
    rest, lengths = np.tile(np.eye(4), (len(names), 1, 1)), np.zeros(len(names))
    for i, name in enumerate(names):
        children = [j for j, parent in enumerate(above) if parent == name and np.linalg.norm(heads[j] - heads[i]) > 0.005 * scale]
        onward = heads[i] - heads[names.index(str(above[i]))] if above[i] else np.array([0, -0.1 * scale, 0])
        along = heads[children[0]] - heads[i] if children else onward / 2
        if np.linalg.norm(along) < 0.005 * scale:
            along = np.array([0, 0, 0.03 * scale])
        y = normalize(along)
        x = normalize(np.cross(y, [0.3, 0.5, -0.8] if abs(y[1]) < 0.9 else [1, 0, 0]))
        matrix = np.stack((x, y, np.cross(x, y)), axis=-1)
        rest[i, :3, :3] = matrix_from_quat(quat_from_axis_angle(y, np.asarray(random.uniform(-np.pi, np.pi)))) @ matrix
        rest[i, :3, 3], lengths[i] = heads[i], np.linalg.norm(along)
    return Bones(
        name=sample.name,
        bones=tuple(names),
        parents=np.array([names.index(parent) if parent else -1 for parent in above]),
        rest=rest,
        lengths=lengths,
        inherits_rotation=np.ones(len(names), bool),
        local_location=np.ones(len(names), bool),
        constrained=np.zeros(len(names), bool),
        object_matrix=np.eye(4) if object_matrix is None else object_matrix,
    )


def with_lengths(sample: SampleRig, pose: str, factors: dict[str, float]) -> Bones:
    """A sample rig of other proportions: the way from the joint above to these joints of both sides is that many times as long. Its ankles
    are as high above the floor as before."""
    bones = bones_at_rest(sample, pose)
    longer = {sample.joints[side + part]: factor for side in SIDES for part, factor in factors.items()}
    heads = bones.rest[:, :3, 3]
    rest = bones.rest.copy()
    for bone, parent in enumerate(bones.parents):
        if parent >= 0:
            rest[bone, :3, 3] = rest[parent, :3, 3] + (heads[bone] - heads[parent]) * longer.get(bones.bones[bone], 1.0)
    ankle = bones.index(sample.joints["LeftFoot"])
    body = [i for i, bone in enumerate(bones.bones) if sample.joints["Hips"] in (bone, *bones.ancestors(bone))]
    rest[body, 2, 3] += heads[ankle, 2] - rest[ankle, 2, 3]
    return replace(bones, rest=rest)


def renamed(bones: Bones) -> Bones:
    """The same bones, called Bone.001 and so on."""
    return replace(bones, bones=tuple(f"Bone.{i:03}" for i in range(len(bones.bones))))


def transform(rotation: np.ndarray, position: np.ndarray, scale: float = 1.0) -> np.ndarray:
    """Matrix [4, 4] of a rotation (a quaternion), a place and a uniform scale."""
    matrix = np.eye(4)
    matrix[:3, :3] = matrix_from_quat(np.asarray(rotation, float)) * scale
    matrix[:3, 3] = position
    return matrix


def evaluate(bones: Bones, frames: int, poses: Iterable[BonePose]) -> np.ndarray:
    """World matrices [T, B, 4, 4] of the bones by Blender's definition: parent's pose * offset at rest * own pose.

    A bone that does not inherit rotation is carried by its parent, but turned as at rest; without local location its location is along
    its parent's axes (the armature's, of a bone without a parent).
    """
    basis = np.tile(np.eye(4), (frames, len(bones.bones), 1, 1))
    for pose in poses:
        bone = bones.index(pose.bone)
        basis[:, bone, :3, :3] = matrix_from_quat(pose.rotation)
        if pose.location is not None:
            basis[:, bone, :3, 3] = pose.location
    matrices = np.empty_like(basis)
    for bone, parent in enumerate(bones.parents):
        above = np.eye(4) if parent < 0 else matrices[:, parent] @ np.linalg.inv(bones.rest[parent])
        carried = np.broadcast_to(above @ bones.rest[bone], basis[:, bone].shape)
        turned = carried[:, :3, :3] if bones.inherits_rotation[bone] else bones.rest[bone, :3, :3]
        axes = carried[:, :3, :3] if bones.local_location[bone] else matrices[:, parent, :3, :3] if parent >= 0 else np.eye(3)
        matrices[:, bone] = np.eye(4)
        matrices[:, bone, :3, :3] = turned @ basis[:, bone, :3, :3]
        matrices[:, bone, :3, 3] = carried[:, :3, 3] + (axes @ basis[:, bone, :3, 3, None])[..., 0]
    return bones.object_matrix @ matrices


def add_armature(bones: Bones) -> bpy.types.Object:
    """The bones as an armature object in the scene, at rest where they are, with their flags."""
    import bpy
    from mathutils import Matrix

    armature = bpy.data.objects.new(bones.name, bpy.data.armatures.new(bones.name))
    bpy.context.scene.collection.objects.link(armature)
    bpy.context.view_layer.objects.active = armature
    armature.matrix_world = Matrix(bones.object_matrix)
    bpy.ops.object.mode_set(mode="EDIT")
    made = []
    for i, name in enumerate(bones.bones):
        bone = armature.data.edit_bones.new(name)
        bone.tail = (0, bones.lengths[i], 0)
        bone.matrix = Matrix(bones.rest[i])
        bone.use_inherit_rotation, bone.use_local_location = bool(bones.inherits_rotation[i]), bool(bones.local_location[i])
        bone.parent = made[bones.parents[i]] if bones.parents[i] >= 0 else None
        made.append(bone)
    bpy.ops.object.mode_set(mode="OBJECT")
    return armature
