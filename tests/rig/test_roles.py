"""Joint names of rigs that people bring, written out, and the roles that each joint plays.

A body is written as chains of joints from the trunk out: "Hips=hips/Spine=spine" is a joint Hips that plays hips, and
below it a joint Spine that plays spine. A chain begins at the root or at a joint that an earlier chain has made.
"""

import gc
import re
import weakref
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from signsplice.errors import FormatError, InputError
from signsplice.formats import roles
from signsplice.motion.clip import Skeleton
from signsplice.rig.roles import ROLES, Humanoid, find_roles, simplify

CLIPS = Path(__file__).resolve().parents[3] / "shared/data/bvh"
THUMB = ("leftThumbMetacarpal", "leftThumbProximal", "leftThumbDistal")
OTHERS = ("Index", "Middle", "Ring", "Little")
PHALANGES = ("Proximal", "Intermediate", "Distal")


def body(*chains: str) -> tuple[Skeleton, dict[str, str]]:
    """A skeleton of the chains' joints, and the roles written into them: role -> joint name."""
    names: list[str] = []
    parents: list[int] = []
    roles: dict[str, str] = {}
    for chain in chains:
        above = -1
        for link in chain.split("/"):
            name, _, role = link.partition("=")
            if name not in names:
                names.append(name)
                parents.append(above)
            if role:
                assert role in ROLES
                roles[role] = name
            above = names.index(name)
    return Skeleton(tuple(names), np.array(parents), np.zeros((len(names), 3))), roles


def both_sides(chains: Sequence[str], left: str, right: str) -> list[str]:
    """The chains and their mirror images: the pattern ``left`` in joint names turned into ``right``, roles too."""

    def mirrored(link: str) -> str:
        name, _, role = link.partition("=")
        return re.sub(left, right, name) + (f"=right{role[4:]}" if role.startswith("left") else "")

    return [*chains, *("/".join(mirrored(link) for link in chain.split("/")) for chain in chains)]


def fingers(hand: str, names: str, words: str, thumb: str, others: str, palm: str = "") -> list[str]:
    """Five chains from ``hand``. ``names`` has {} for a finger's word and a joint's ending; ``palm`` for its word."""
    first, *rest = words.split()
    chains = [
        "/".join(
            [hand, *(f"{names.format(first, end)}={role}" for end, role in zip(thumb.split(), THUMB, strict=True))]
        )
    ]
    for word, finger in zip(rest, OTHERS, strict=True):
        inside = [palm.format(word)] if palm else []
        links = [
            f"{names.format(word, end)}=left{finger}{part}" for end, part in zip(others.split(), PHALANGES, strict=True)
        ]
        chains.append("/".join([hand, *inside, *links]))
    return chains


HIK = [
    "Hips=hips/Spine=spine/Spine1=chest/Spine2=upperChest/Neck=neck/Head=head/HeadTop_End",
    *both_sides(
        [
            "Spine2/LeftShoulder=leftShoulder/LeftArm=leftUpperArm/LeftForeArm=leftLowerArm/LeftHand=leftHand",
            *fingers("LeftHand", "LeftHand{}{}", "Thumb Index Middle Ring Pinky", "1 2 3", "1 2 3"),
            "LeftHandThumb3/LeftHandThumb4",
            "LeftHandIndex3/LeftHandIndex4",
            "Hips/LeftUpLeg=leftUpperLeg/LeftLeg=leftLowerLeg/LeftFoot=leftFoot/LeftToeBase=leftToes/LeftToe_End",
        ],
        "Left",
        "Right",
    ),
    "Head/LeftEye=leftEye",
    "Head/RightEye=rightEye",
]


def prefixed(prefix: str, chains: Sequence[str]) -> list[str]:
    return ["/".join(prefix + link for link in chain.split("/")) for chain in chains]


METARIG = [
    "spine=hips/spine.001=spine/spine.002=chest/spine.003=upperChest/spine.004=neck/spine.005/spine.006=head",
    *both_sides(
        [
            "spine.003/shoulder.L=leftShoulder/upper_arm.L=leftUpperArm/forearm.L=leftLowerArm/hand.L=leftHand",
            *fingers("hand.L", "{}.{}.L", "thumb f_index f_middle f_ring f_pinky", "01 02 03", "01 02 03", "palm.{}.L"),
            "spine/pelvis.L",
            "spine/thigh.L=leftUpperLeg/shin.L=leftLowerLeg/foot.L=leftFoot/toe.L=leftToes",
            "foot.L/heel.02.L",
            "spine.003/breast.L",
        ],
        r"\.L$",
        ".R",
    ),
]
VRM = [
    "hips=hips/spine=spine/chest=chest/upperChest=upperChest/neck=neck/head=head/jaw=jaw",
    *both_sides(
        [
            "head/leftEye=leftEye",
            "upperChest/leftShoulder=leftShoulder/leftUpperArm=leftUpperArm/leftLowerArm=leftLowerArm/leftHand=leftHand",
            *fingers(
                "leftHand",
                "left{}{}",
                "Thumb Index Middle Ring Little",
                "Metacarpal Proximal Distal",
                "Proximal Intermediate Distal",
            ),
            "hips/leftUpperLeg=leftUpperLeg/leftLowerLeg=leftLowerLeg/leftFoot=leftFoot/leftToes=leftToes",
        ],
        "left",
        "right",
    ),
]
BIPED = [
    "Bip01/Bip01 Pelvis=hips/Bip01 Spine=spine/Bip01 Spine1=chest/Bip01 Neck=neck/Bip01 Head=head/Bip01 HeadNub",
    *both_sides(
        [
            # Biped hangs the collar bones from the neck, the legs from the spine.
            "Bip01 Neck/Bip01 L Clavicle=leftShoulder/Bip01 L UpperArm=leftUpperArm/Bip01 L Forearm=leftLowerArm"
            "/Bip01 L Hand=leftHand/Bip01 L Finger0=leftThumbMetacarpal/Bip01 L Finger01=leftThumbProximal"
            "/Bip01 L Finger02=leftThumbDistal/Bip01 L Finger0Nub",
            "Bip01 L Hand/Bip01 L Finger1=leftIndexProximal/Bip01 L Finger11=leftIndexIntermediate"
            "/Bip01 L Finger12=leftIndexDistal",
            "Bip01 L Hand/Bip01 L Finger2=leftMiddleProximal/Bip01 L Finger21=leftMiddleIntermediate",
            "Bip01 L Hand/Bip01 L Finger3=leftRingProximal",
            "Bip01 L Hand/Bip01 L Finger4=leftLittleProximal/Bip01 L Finger41=leftLittleIntermediate"
            "/Bip01 L Finger42=leftLittleDistal",
            "Bip01 Spine/Bip01 L Thigh=leftUpperLeg/Bip01 L Calf=leftLowerLeg/Bip01 L Foot=leftFoot"
            "/Bip01 L Toe0=leftToes",
        ],
        " L ",
        " R ",
    ),
]
CLASSIC = [
    "Hips=hips/Chest=spine/Neck=neck/Head=head",
    *both_sides(
        [
            "Chest/LeftCollar=leftShoulder/LeftShoulder=leftUpperArm/LeftElbow=leftLowerArm/LeftWrist=leftHand",
            "Hips/LeftHip=leftUpperLeg/LeftKnee=leftLowerLeg/LeftAnkle=leftFoot/LeftToe=leftToes",
        ],
        "Left",
        "Right",
    ),
]
UNREAL_LIMBS = [
    "clavicle_l=leftShoulder/upperarm_l=leftUpperArm/lowerarm_l=leftLowerArm/hand_l=leftHand",
    "upperarm_l/upperarm_twist_01_l",
    "pelvis/thigh_l=leftUpperLeg/calf_l=leftLowerLeg/foot_l=leftFoot/ball_l=leftToes",
    "thigh_l/thigh_twist_01_l",
]
FIVE = "thumb index middle ring pinky"

BODIES: dict[str, tuple[str, list[str]]] = {
    "mixamo bare": ("mixamo", HIK),
    "mixamo colon": ("mixamo", prefixed("mixamorig:", HIK)),
    "mixamo numbered": ("mixamo", prefixed("mixamorig7:", HIK)),
    "mixamo underscore": ("mixamo", prefixed("mixamorig_", HIK)),
    "mixamo joined": ("mixamo", prefixed("mixamorig", HIK)),
    "motionbuilder": ("mixamo", prefixed("Character1_", HIK)),
    "neuron": (
        "neuron",
        [
            "Hips=hips/Spine=spine/Spine1/Spine2=chest/Spine3=upperChest/Neck=neck/Head=head",
            *both_sides(
                [
                    "Spine3/LeftShoulder=leftShoulder/LeftArm=leftUpperArm/LeftForeArm=leftLowerArm/LeftHand=leftHand",
                    *fingers(
                        "LeftHand", "LeftHand{}{}", "Thumb Index Middle Ring Pinky", "1 2 3", "1 2 3", "LeftInHand{}"
                    ),
                    "Hips/LeftUpLeg=leftUpperLeg/LeftLeg=leftLowerLeg/LeftFoot=leftFoot",
                ],
                "Left",
                "Right",
            ),
        ],
    ),
    "cmu": (
        "cmu",
        [
            "Hips=hips/LHipJoint/LeftUpLeg=leftUpperLeg/LeftLeg=leftLowerLeg/LeftFoot=leftFoot/LeftToeBase=leftToes",
            "Hips/RHipJoint/RightUpLeg=rightUpperLeg/RightLeg=rightLowerLeg/RightFoot=rightFoot/RightToeBase=rightToes",
            "Hips/LowerBack=spine/Spine=chest/Spine1=upperChest/Neck=neck/Neck1/Head=head",
            "Spine1/LeftShoulder=leftShoulder/LeftArm=leftUpperArm/LeftForeArm=leftLowerArm/LeftHand=leftHand",
            "LeftHand/LeftFingerBase/LeftHandIndex1=leftIndexProximal",
            "LeftHand/LThumb=leftThumbMetacarpal",
            "Spine1/RightShoulder=rightShoulder/RightArm=rightUpperArm/RightForeArm=rightLowerArm/RightHand=rightHand",
            "RightHand/RightFingerBase/RightHandIndex1=rightIndexProximal",
            "RightHand/RThumb=rightThumbMetacarpal",
        ],
    ),
    "vicon": (
        "vicon",
        [
            "Hips=hips/Spine=spine/Spine1/Spine2=chest/Spine3=upperChest/Neck=neck/Neck1/Head=head/HeadEnd",
            *both_sides(
                [
                    "Spine3/LShoulder=leftShoulder/LArm=leftUpperArm/LArm1=leftLowerArm/LHand=leftHand",
                    *fingers("LHand", "LHand{}{}", "T I M R P", "1 2 3", "1 2 3", "LHand{}"),
                    "Hips/LUpLeg=leftUpperLeg/LLeg=leftLowerLeg/LFoot=leftFoot/LToeBase=leftToes",
                ],
                "^L",
                "R",
            ),
        ],
    ),
    "vrm 1.0": ("vrm", VRM),
    "godot": ("vrm", ["/".join(link[0].upper() + link[1:] for link in chain.split("/")) for chain in VRM]),
    "vrm 0.x": (
        "unity",
        [
            re.sub("(left|right)ThumbProximal=", r"\1ThumbIntermediate=", chain).replace("Metacarpal=", "Proximal=")
            for chain in VRM
        ],
    ),
    "unity": (
        "unity",
        [
            "Hips=hips/Spine=spine/Chest=chest/Neck=neck/Head=head/Jaw=jaw",
            *both_sides(
                [
                    "Head/LeftEye=leftEye",
                    "Chest/LeftShoulder=leftShoulder/LeftUpperArm=leftUpperArm/LeftLowerArm=leftLowerArm/LeftHand=leftHand",
                    *fingers(
                        "LeftHand",
                        "Left {} {}",
                        "Thumb Index Middle Ring Little",
                        "Proximal Intermediate Distal",
                        "Proximal Intermediate Distal",
                    ),
                    "Hips/LeftUpperLeg=leftUpperLeg/LeftLowerLeg=leftLowerLeg/LeftFoot=leftFoot/LeftToes=leftToes",
                ],
                "Left",
                "Right",
            ),
        ],
    ),
    "vroid": (
        "vroid",
        [
            "Root/J_Bip_C_Hips=hips/J_Bip_C_Spine=spine/J_Bip_C_Chest=chest/J_Bip_C_UpperChest=upperChest"
            "/J_Bip_C_Neck=neck/J_Bip_C_Head=head",
            "J_Bip_C_Head/J_Sec_Hair1_01/J_Sec_Hair2_01",
            *both_sides(
                [
                    "J_Bip_C_Head/J_Adj_L_FaceEye=leftEye",
                    "J_Bip_C_UpperChest/J_Sec_L_Bust1",
                    "J_Bip_C_UpperChest/J_Bip_L_Shoulder=leftShoulder/J_Bip_L_UpperArm=leftUpperArm"
                    "/J_Bip_L_LowerArm=leftLowerArm/J_Bip_L_Hand=leftHand",
                    *fingers("J_Bip_L_Hand", "J_Bip_L_{}{}", "Thumb Index Middle Ring Little", "1 2 3", "1 2 3"),
                    "J_Bip_C_Hips/J_Bip_L_UpperLeg=leftUpperLeg/J_Bip_L_LowerLeg=leftLowerLeg/J_Bip_L_Foot=leftFoot"
                    "/J_Bip_L_ToeBase=leftToes",
                ],
                "_L_",
                "_R_",
            ),
        ],
    ),
    "rigify metarig": ("rigify", METARIG),
    "rigify ORG": ("rigify", prefixed("ORG-", METARIG)),
    "rigify DEF": ("rigify", [*prefixed("DEF-", METARIG), "DEF-upper_arm.L/DEF-upper_arm.L.001"]),
    "rigify in three.js": ("rigify", [chain.replace(".", "") for chain in METARIG]),
    "rigify with hips": (
        "rigify",
        [
            "root/DEF-hips=hips/DEF-spine.001=spine/DEF-spine.002=chest/DEF-spine.003=upperChest/DEF-neck=neck/DEF-head=head",
            *both_sides(
                [
                    "DEF-spine.003/DEF-shoulder.L=leftShoulder/DEF-upper_arm.L=leftUpperArm/DEF-forearm.L=leftLowerArm"
                    "/DEF-hand.L=leftHand",
                    "DEF-hips/DEF-thigh.L=leftUpperLeg/DEF-shin.L=leftLowerLeg/DEF-foot.L=leftFoot/DEF-toe.L=leftToes",
                ],
                r"\.L$",
                ".R",
            ),
        ],
    ),
    "smplx": (
        "smplx",
        [
            "pelvis=hips/spine1=spine/spine2=chest/spine3=upperChest/neck=neck/head=head/jaw=jaw",
            *both_sides(
                [
                    "head/left_eye_smplhf=leftEye",
                    "pelvis/left_hip=leftUpperLeg/left_knee=leftLowerLeg/left_ankle=leftFoot/left_foot=leftToes",
                    "spine3/left_collar=leftShoulder/left_shoulder=leftUpperArm/left_elbow=leftLowerArm/left_wrist=leftHand",
                    *fingers("left_wrist", "left_{}{}", FIVE, "1 2 3", "1 2 3"),
                ],
                "left",
                "right",
            ),
        ],
    ),
    "smpl": (
        "smplx",
        [
            "Pelvis=hips/Spine1=spine/Spine2=chest/Spine3=upperChest/Neck=neck/Head=head",
            *both_sides(
                [
                    "Pelvis/L_Hip=leftUpperLeg/L_Knee=leftLowerLeg/L_Ankle=leftFoot/L_Foot=leftToes",
                    "Spine3/L_Collar=leftShoulder/L_Shoulder=leftUpperArm/L_Elbow=leftLowerArm/L_Wrist=leftHand/L_Hand",
                ],
                "^L",
                "R",
            ),
        ],
    ),
    "classic bvh": ("bvh", CLASSIC),
    "classic bvh of a long trunk": (
        "bvh",
        [
            "Hips=hips/Chest=spine/Chest2/Chest3=chest/Chest4=upperChest/Neck=neck/Head=head",
            *(chain.replace("Chest/", "Chest4/") for chain in CLASSIC[1:]),
        ],
    ),
    "classic bvh without collars": (
        "bvh",
        [CLASSIC[0], *(re.sub("(Left|Right)Collar=.*?/", "", chain) for chain in CLASSIC[1:])],
    ),
    "classic bvh with fingers": (
        "bvh",
        [*CLASSIC, *both_sides(fingers("LeftWrist", "LeftHand{}{}", FIVE.title(), "1 2 3", "1 2 3"), "Left", "Right")],
    ),
    "upper and lower arms": (
        "bvh",
        [
            "Hips=hips/Chest=spine/Chest2=chest/Neck=neck/Head=head",
            *both_sides(
                [
                    "Chest2/LeftCollar=leftShoulder/LeftUpArm=leftUpperArm/LeftLowArm=leftLowerArm/LeftHand=leftHand",
                    "Hips/LeftUpLeg=leftUpperLeg/LeftLowLeg=leftLowerLeg/LeftFoot=leftFoot",
                ],
                "Left",
                "Right",
            ),
        ],
    ),
    "kinect": (
        "bvh",
        [
            # No joint is named for the hips: they are where legs and trunk meet.
            "SpineBase=hips/SpineMid=spine/SpineShoulder=chest/Neck=neck/Head=head",
            *both_sides(
                [
                    "SpineShoulder/ShoulderLeft=leftUpperArm/ElbowLeft=leftLowerArm/WristLeft=leftHand/HandLeft",
                    "SpineBase/HipLeft=leftUpperLeg/KneeLeft=leftLowerLeg/AnkleLeft=leftFoot/FootLeft=leftToes",
                ],
                "Left",
                "Right",
            ),
        ],
    ),
    "second life": (
        "daz",
        [
            "hip=hips/abdomen=spine/chest=chest/neck=neck/head=head",
            *both_sides(
                [
                    "chest/lCollar=leftShoulder/lShldr=leftUpperArm/lForeArm=leftLowerArm/lHand=leftHand",
                    "hip/lThigh=leftUpperLeg/lShin=leftLowerLeg/lFoot=leftFoot",
                ],
                "^l",
                "r",
            ),
        ],
    ),
    "daz": (
        "daz",
        [
            "hip=hips/abdomen=spine/abdomen2=chest/chest=upperChest/neck=neck/head=head",
            *both_sides(
                [
                    "head/lEye=leftEye",
                    "chest/lCollar=leftShoulder/lShldr=leftUpperArm/lForeArm=leftLowerArm/lHand=leftHand",
                    *fingers("lHand", "l{}{}", "Thumb Index Mid Ring Pinky", "1 2 3", "1 2 3"),
                    "hip/pelvis/lThigh=leftUpperLeg/lShin=leftLowerLeg/lFoot=leftFoot/lToe=leftToes",
                ],
                "^l",
                "r",
            ),
        ],
    ),
    "daz in lower case": (
        "bvh",
        [
            "hip=hips/abdomen=spine/chest=chest/neck=neck/head=head",
            *both_sides(
                [
                    "chest/lcollar=leftShoulder/lshoulder=leftUpperArm/lelbow=leftLowerArm/lhand=leftHand",
                    "lhand/lthumb1=leftThumbMetacarpal/lthumb2=leftThumbProximal",
                    "lhand/lmid1=leftMiddleProximal/lmid2=leftMiddleIntermediate",
                    "hip/lbuttock/lhip=leftUpperLeg/lknee=leftLowerLeg/lfoot=leftFoot",
                ],
                "^l",
                "r",
            ),
        ],
    ),
    "daz genesis 8": (
        "daz",
        [
            "hip=hips/abdomenLower=spine/abdomenUpper/chestLower=chest/chestUpper=upperChest/neckLower=neck/neckUpper/head=head",
            *both_sides(
                [
                    "hip/pelvis/lThighBend=leftUpperLeg/lThighTwist/lShin=leftLowerLeg/lFoot=leftFoot/lMetatarsals/lToe=leftToes",
                    "chestUpper/lCollar=leftShoulder/lShldrBend=leftUpperArm/lShldrTwist/lForearmBend=leftLowerArm"
                    "/lForearmTwist/lHand=leftHand",
                    *fingers("lHand", "l{}{}", "Thumb Index Mid Ring Pinky", "1 2 3", "1 2 3", "lCarpal{}"),
                ],
                "^l",
                "r",
            ),
        ],
    ),
    "biped": ("biped", BIPED),
    "biped with underscores": ("biped", [chain.replace(" ", "_") for chain in BIPED]),
    "biped of three digits": ("biped", [chain.replace("Bip01", "Bip001") for chain in BIPED]),
    "biped in capitals": (
        "biped",
        [re.sub("[^/=]+(?==|/|$)", lambda m: m[0] if m[0] in ROLES else m[0].upper(), chain) for chain in BIPED],
    ),
    "biped of Source": ("biped", prefixed("ValveBiped.", [chain.replace(" ", "_") for chain in BIPED])),
    "unreal 4": (
        "unreal",
        [
            "root/pelvis=hips/spine_01=spine/spine_02=chest/spine_03=upperChest/neck_01=neck/head=head",
            *both_sides(
                [
                    f"spine_03/{UNREAL_LIMBS[0]}",
                    *UNREAL_LIMBS[1:],
                    *fingers("hand_l", "{}_{}_l", FIVE, "01 02 03", "01 02 03"),
                ],
                "_l$",
                "_r",
            ),
            "root/ik_hand_root/ik_hand_l",
        ],
    ),
    "unreal 5": (
        "unreal",
        [
            "root/pelvis=hips/spine_01=spine/spine_02/spine_03=chest/spine_04/spine_05=upperChest/neck_01=neck/neck_02/head=head",
            *both_sides(
                [
                    f"spine_05/{UNREAL_LIMBS[0]}",
                    *UNREAL_LIMBS[1:],
                    *fingers("hand_l", "{}_{}_l", FIVE, "01 02 03", "01 02 03", "{}_metacarpal_l"),
                ],
                "_l$",
                "_r",
            ),
        ],
    ),
    "rokoko newton": (
        "rokoko",
        [
            "Root/Hips=hips/Spine1=spine/Spine2/Spine3=chest/Spine4=upperChest/Neck=neck/Head=head",
            *both_sides(
                [
                    "Spine4/LeftShoulder=leftShoulder/LeftArm=leftUpperArm/LeftForeArm=leftLowerArm/LeftHand=leftHand",
                    *fingers(
                        "LeftHand",
                        "LeftFinger{}{}",
                        "1 2 3 4 5",
                        "Metacarpal Proximal Distal",
                        "Proximal Medial Distal",
                        "LeftFinger{}Metacarpal",
                    ),
                    "LeftFinger2Distal/LeftFinger2Tip",
                    "Hips/LeftThigh=leftUpperLeg/LeftShin=leftLowerLeg/LeftFoot=leftFoot/LeftToe=leftToes/LeftToeTip",
                ],
                "Left",
                "Right",
            ),
        ],
    ),
    "xsens": (
        "xsens",
        [
            "Pelvis=hips/L5=spine/L3/T12=chest/T8=upperChest/Neck=neck/Head=head",
            *both_sides(
                [
                    "T8/LeftShoulder=leftShoulder/LeftUpperArm=leftUpperArm/LeftForeArm=leftLowerArm/LeftHand=leftHand",
                    *fingers(
                        "LeftHand", "Left{}{}", "First Second Third Fourth Fifth", "MC PP DP", "PP MP DP", "Left{}MC"
                    ),
                    "Pelvis/LeftUpperLeg=leftUpperLeg/LeftLowerLeg=leftLowerLeg/LeftFoot=leftFoot/LeftToe=leftToes",
                ],
                "Left",
                "Right",
            ),
        ],
    ),
    "character creator": (
        "characterCreator",
        [
            "CC_Base_BoneRoot/CC_Base_Hip=hips/CC_Base_Waist=spine/CC_Base_Spine01=chest/CC_Base_Spine02=upperChest"
            "/CC_Base_NeckTwist01=neck/CC_Base_NeckTwist02/CC_Base_Head=head/CC_Base_JawRoot=jaw",
            *both_sides(
                [
                    "CC_Base_Head/CC_Base_L_Eye=leftEye",
                    "CC_Base_Spine02/CC_Base_L_Clavicle=leftShoulder/CC_Base_L_Upperarm=leftUpperArm"
                    "/CC_Base_L_Forearm=leftLowerArm/CC_Base_L_Hand=leftHand",
                    "CC_Base_L_Upperarm/CC_Base_L_UpperarmTwist01",
                    *fingers("CC_Base_L_Hand", "CC_Base_L_{}{}", "Thumb Index Mid Ring Pinky", "1 2 3", "1 2 3"),
                    "CC_Base_Hip/CC_Base_Pelvis/CC_Base_L_Thigh=leftUpperLeg/CC_Base_L_Calf=leftLowerLeg"
                    "/CC_Base_L_Foot=leftFoot/CC_Base_L_ToeBase=leftToes",
                ],
                "_L_",
                "_R_",
            ),
        ],
    ),
    "optitrack": (
        "optitrack",
        [
            "Hip=hips/Ab=spine/Chest=chest/Neck=neck/Head=head",
            *both_sides(
                [
                    "Chest/LShoulder=leftShoulder/LUArm=leftUpperArm/LFArm=leftLowerArm/LHand=leftHand",
                    *fingers("LHand", "L{}{}", FIVE.title(), "1 2 3", "1 2 3"),
                    "Hip/LThigh=leftUpperLeg/LShin=leftLowerLeg/LFoot=leftFoot/LToe=leftToes",
                ],
                "^L",
                "R",
            ),
        ],
    ),
    "acclaim": (
        "acclaim",
        [
            "root=hips/lowerback=spine/upperback=chest/thorax=upperChest/lowerneck=neck/upperneck/head=head",
            *both_sides(
                [
                    "root/lhipjoint/lfemur=leftUpperLeg/ltibia=leftLowerLeg/lfoot=leftFoot/ltoes=leftToes",
                    "thorax/lclavicle=leftShoulder/lhumerus=leftUpperArm/lradius=leftLowerArm/lwrist=leftHand/lhand/lfingers",
                    "lwrist/lthumb=leftThumbMetacarpal",
                ],
                "^l",
                "r",
            ),
        ],
    ),
    "makehuman": (
        "makehuman",
        [
            "root=hips/spine05=spine/spine04/spine03=chest/spine02/spine01=upperChest/neck01=neck/neck02/neck03/head=head"
            "/jaw=jaw",
            *both_sides(
                [
                    "head/eye.L=leftEye",
                    "spine01/clavicle.L=leftShoulder/shoulder01.L/upperarm01.L=leftUpperArm/upperarm02.L"
                    "/lowerarm01.L=leftLowerArm/lowerarm02.L/wrist.L=leftHand",
                    *fingers("wrist.L", "finger{}-{}.L", "1 2 3 4 5", "1 2 3", "1 2 3", "metacarpal{}.L"),
                    "root/pelvis.L/upperleg01.L=leftUpperLeg/upperleg02.L/lowerleg01.L=leftLowerLeg/lowerleg02.L"
                    "/foot.L=leftFoot/toe1-1.L=leftToes",
                ],
                r"\.L$",
                ".R",
            ),
        ],
    ),
    "auto-rig pro": (
        "autorig",
        [
            "root/root.x=hips/spine_01.x=spine/spine_02.x=chest/neck.x=neck/head.x=head",
            *both_sides(
                [
                    "spine_02.x/shoulder.l=leftShoulder/arm_stretch.l=leftUpperArm/forearm_stretch.l=leftLowerArm"
                    "/hand.l=leftHand",
                    *fingers("hand.l", "c_{}{}.l", FIVE, "1 2 3", "1 2 3"),
                    "root.x/thigh_stretch.l=leftUpperLeg/leg_stretch.l=leftLowerLeg/foot.l=leftFoot/toes_01.l=leftToes",
                ],
                r"\.l$",
                ".r",
            ),
        ],
    ),
    "advanced skeleton": (
        "advancedSkeleton",
        [
            "Root_M=hips/Spine1_M=spine/Chest_M=chest/Neck_M=neck/Head_M=head",
            *both_sides(
                [
                    "Chest_M/Scapula_L=leftShoulder/Shoulder_L=leftUpperArm/Elbow_L=leftLowerArm/Wrist_L=leftHand",
                    *fingers("Wrist_L", "{}Finger{}_L", FIVE.title(), "1 2 3", "1 2 3"),
                    "Root_M/Hip_L=leftUpperLeg/Knee_L=leftLowerLeg/Ankle_L=leftFoot/Toes_L=leftToes",
                ],
                "_L$",
                "_R",
            ),
        ],
    ),
    # Here "leg" is the upper one.
    "mmd in English": (
        "mmd",
        [
            "center/waist=hips/upper body=spine/upper body 2=chest/neck=neck/head=head",
            *both_sides(
                [
                    "upper body 2/shoulder_L=leftShoulder/arm_L=leftUpperArm/elbow_L=leftLowerArm/wrist_L=leftHand",
                    "wrist_L/Thumb0_L=leftThumbMetacarpal/Thumb1_L=leftThumbProximal/Thumb2_L=leftThumbDistal",
                    "wrist_L/IndexFinger1_L=leftIndexProximal/IndexFinger2_L=leftIndexIntermediate"
                    "/IndexFinger3_L=leftIndexDistal",
                    "waist/lower body/leg_L=leftUpperLeg/knee_L=leftLowerLeg/ankle_L=leftFoot/toe_L=leftToes",
                ],
                "_L$",
                "_R",
            ),
        ],
    ),
}


def named(skeleton: Skeleton, humanoid: Humanoid) -> dict[str, str]:
    return {role: skeleton.names[joint] for role, joint in humanoid.joints.items()}


@pytest.mark.parametrize("rig", BODIES)
def test_each_role_of_a_rig_is_found_and_nothing_else(rig: str) -> None:
    convention, chains = BODIES[rig]
    skeleton, roles = body(*chains)
    humanoid = find_roles(skeleton)
    assert named(skeleton, humanoid) == roles
    assert humanoid.rig == convention


@pytest.mark.parametrize("rig", BODIES)
def test_a_body_is_found_whatever_the_order_of_its_joints(rig: str) -> None:
    skeleton, roles = body(*BODIES[rig][1])
    turned = depth_first(skeleton)
    assert turned.names != skeleton.names
    assert named(turned, find_roles(turned)) == roles


def depth_first(skeleton: Skeleton) -> Skeleton:
    """The same joints in depth-first order, each joint's children in reverse."""
    order, ahead = [], [0]
    while ahead:
        order.append(ahead.pop())
        ahead += skeleton.children[order[-1]]
    place = {joint: n for n, joint in enumerate(order)}
    parents = [place.get(int(skeleton.parents[joint]), -1) for joint in order]
    return Skeleton(tuple(skeleton.names[joint] for joint in order), np.array(parents), skeleton.offsets)


@pytest.mark.parametrize("rig", [rig for rig in BODIES if rig != "kinect"])  # whose hips are where two legs meet
def test_the_left_half_is_enough(rig: str) -> None:
    skeleton, roles = body(*BODIES[rig][1])
    gone = {joint for role, joint in find_roles(skeleton).joints.items() if role.startswith("right")}
    gone |= {joint for joint in range(len(skeleton)) if above(skeleton, joint) & gone}
    kept = [joint for joint in range(len(skeleton)) if joint not in gone]
    parents = [kept.index(int(skeleton.parents[joint])) if joint else -1 for joint in kept]
    half = Skeleton(tuple(skeleton.names[joint] for joint in kept), np.array(parents), np.zeros((len(kept), 3)))
    assert len(half) < len(skeleton)
    assert named(half, find_roles(half)) == {role: name for role, name in roles.items() if not role.startswith("right")}


def above(skeleton: Skeleton, joint: int) -> set[int]:
    """All joints above one."""
    joints = set()
    while (joint := int(skeleton.parents[joint])) >= 0:
        joints.add(joint)
    return joints


def test_roles_are_those_of_vrm_1() -> None:
    assert len(ROLES) == len(set(ROLES)) == 55
    assert ROLES[:4] == ("hips", "spine", "chest", "upperChest")
    assert {"leftThumbMetacarpal", "rightLittleIntermediate", "jaw", "leftEye", "rightToes"} <= set(ROLES)
    assert not any("ThumbIntermediate" in role for role in ROLES)


@pytest.mark.parametrize(
    ("n_joints", "spine", "chest", "upper"),
    [
        (0, None, None, None),
        (1, 0, None, None),
        (2, 0, 1, None),
        (3, 0, 1, 2),
        (4, 0, 2, 3),
        (5, 0, 2, 4),
        (7, 0, 3, 6),
    ],
)
def test_the_spine_is_counted_off(n_joints: int, spine: int | None, chest: int | None, upper: int | None) -> None:
    trunk = "/".join(["Hips", *(f"Back{n}" for n in range(n_joints)), "Neck", "Head"])
    above_arms = f"Back{n_joints - 1}" if n_joints else "Hips"
    skeleton, _ = body(trunk, f"{above_arms}/LeftArm/LeftForeArm/LeftHand")
    joints = named(skeleton, find_roles(skeleton))
    places = {"spine": spine, "chest": chest, "upperChest": upper}
    assert {role: joints.get(role) for role in places} == {
        role: None if place is None else f"Back{place}" for role, place in places.items()
    }


def test_the_upper_chest_carries_the_shoulders() -> None:
    skeleton, roles = body(
        "Hips=hips/Spine=spine/Spine1=chest/Spine2=upperChest/Spine3/Spine4/Neck=neck/Head=head",
        "Spine2/LeftShoulder=leftShoulder/LeftArm=leftUpperArm/LeftForeArm=leftLowerArm",
        "Spine2/RightShoulder=rightShoulder/RightArm=rightUpperArm/RightForeArm=rightLowerArm",
    )
    assert named(skeleton, find_roles(skeleton)) == roles


def test_the_spine_ends_where_the_arms_part_if_there_is_no_neck() -> None:
    skeleton, roles = body(
        "Hips=hips/Spine=spine/Spine1=chest/Extra",
        "Spine1/LeftArm=leftUpperArm/LeftForeArm=leftLowerArm/LeftHand=leftHand",
        "Spine1/RightArm=rightUpperArm/RightForeArm=rightLowerArm/RightHand=rightHand",
    )
    assert named(skeleton, find_roles(skeleton)) == roles


def test_a_joint_that_stands_in_the_wrong_place_gets_no_role() -> None:
    skeleton, roles = body(
        "Hips=hips/Spine=spine/Neck=neck/Head=head",
        "Spine/LeftShoulder=leftShoulder/LeftArm=leftUpperArm/LeftForeArm=leftLowerArm/LeftHand=leftHand",
        "Spine/RightShoulder=rightShoulder/RightArm=rightUpperArm/RightForeArm=rightLowerArm/RightHand=rightHand",
        "LeftHand/RightHandIndex1",
        "Hips/LeftUpLeg=leftUpperLeg",
        "Spine/LeftLeg",
    )
    assert named(skeleton, find_roles(skeleton)) == roles


@pytest.mark.parametrize("rig", BODIES)
def test_each_role_hangs_below_the_ones_that_it_belongs_to(rig: str) -> None:
    skeleton, _ = body(*BODIES[rig][1])
    joints = find_roles(skeleton).joints
    for chain in (
        ("hips", "spine", "chest", "upperChest", "neck", "head"),
        ("upperChest", "leftUpperArm", "leftLowerArm", "leftHand", "leftIndexProximal", "leftIndexDistal"),
        ("hips", "rightUpperLeg", "rightLowerLeg", "rightFoot", "rightToes"),
        ("rightHand", "rightThumbMetacarpal", "rightThumbProximal", "rightThumbDistal"),
    ):
        found = [joints[role] for role in chain if role in joints]
        for over, joint in pairwise(found):
            assert over in above(skeleton, joint)


def test_only_the_bones_that_deform_count_in_a_whole_rigify_rig() -> None:
    limbs = "{0}spine/{0}spine.001/{0}shoulder.L/{0}upper_arm.L/{0}forearm.L/{0}hand.L"
    skeleton, _ = body(*("root/" + limbs.format(kind) for kind in ("ORG-", "DEF-", "MCH-", "")))
    found = named(skeleton, find_roles(skeleton))
    assert set(found.values()) == {
        "DEF-spine",
        "DEF-spine.001",
        "DEF-shoulder.L",
        "DEF-upper_arm.L",
        "DEF-forearm.L",
        "DEF-hand.L",
    }


@pytest.mark.parametrize(
    "chains",
    [
        ["root/a/b/c"],
        ["Hips/Tail1/Tail2"],
        ["LeftWheel/RightWheel/Axle"],
        ["bone/bone.001/bone.002/bone.003/bone.004"],
        ["头/左手/右手/脚"],
        ["_/__/___"],
    ],
)
def test_names_that_say_nothing_find_nothing(chains: list[str]) -> None:
    assert find_roles(body(*chains)[0]) == Humanoid("unknown", {})


@pytest.mark.parametrize("pattern", ["mixamorig:{}_{:03d}", "{}_JNT", "Ana_{}_jnt", "Actor-{}"])
def test_what_all_names_share_is_passed_over(pattern: str) -> None:
    plain, roles = body(*HIK)
    names = tuple(pattern.format(name, n) for n, name in enumerate(plain.names))
    skeleton = Skeleton(("Armature", *names), np.array([-1, *(plain.parents + 1)]), np.zeros((len(names) + 1, 3)))
    found = {role: plain.names[joint - 1] for role, joint in find_roles(skeleton).joints.items()}
    assert found == roles


@pytest.mark.parametrize(
    "chain", ["Root/Ana_Arm_L/Ana_ForeArm_L/Ana_Hand_L", "Root/L_Arm_JNT/L_ForeArm_JNT/L_Hand_JNT"]
)
def test_a_side_that_all_names_share_is_kept(chain: str) -> None:
    found = find_roles(body(chain)[0])
    assert list(found.joints.items()) == [("leftUpperArm", 1), ("leftLowerArm", 2), ("leftHand", 3)]


def test_hips_that_hold_the_legs_alone_are_not_the_hips() -> None:
    skeleton, roles = body(
        "Body=hips/Spine=spine/Neck=neck/Head=head",
        "Spine/LeftArm=leftUpperArm/LeftForeArm=leftLowerArm/LeftHand=leftHand",
        "Spine/RightArm=rightUpperArm/RightForeArm=rightLowerArm/RightHand=rightHand",
        "Body/Pelvis/LeftUpLeg=leftUpperLeg/LeftLeg=leftLowerLeg",
        "Pelvis/RightUpLeg=rightUpperLeg/RightLeg=rightLowerLeg",
    )
    assert named(skeleton, find_roles(skeleton)) == roles


def test_a_hand_alone_is_found() -> None:
    skeleton, roles = body("LeftHand=leftHand", *fingers("LeftHand", "LeftHand{}{}", FIVE.title(), "1 2 3", "1 2 3"))
    assert named(skeleton, find_roles(skeleton)) == roles


def test_an_upper_body_without_hips_has_none() -> None:
    skeleton, _ = body("Root/Spine/Spine1/Neck/Head", "Spine1/LeftShoulder/LeftArm/LeftForeArm/LeftHand")
    found = named(skeleton, find_roles(skeleton))
    assert "hips" not in found
    assert found["spine"] == "Spine"
    assert found["leftUpperArm"] == "LeftArm"


def test_an_override_wins_and_the_tables_fill_up() -> None:
    skeleton, roles = body(*HIK)
    humanoid = find_roles(skeleton, {"leftHand": "LeftHandMiddle1", "jaw": "HeadTop_End"})
    found = named(skeleton, humanoid)
    assert humanoid.rig == "custom"
    assert found["leftHand"] == "LeftHandMiddle1"
    assert found["jaw"] == "HeadTop_End"
    assert "leftMiddleProximal" not in found  # its joint has another role now
    assert "leftIndexProximal" not in found  # it does not hang from that hand
    assert found["rightHand"] == roles["rightHand"]


def test_an_override_alone_makes_a_body() -> None:
    skeleton, roles = body(
        "a=hips/b=spine/c=chest/d=neck/e=head",
        "c/f=leftUpperArm/g=leftLowerArm/h=leftHand",
    )
    counted = ("spine", "chest")
    humanoid = find_roles(skeleton, {role: name for role, name in roles.items() if role not in counted})
    assert humanoid.rig == "custom"
    assert named(skeleton, humanoid) == roles


def test_an_empty_override_changes_nothing() -> None:
    skeleton, _ = body(*HIK)
    assert find_roles(skeleton, {}) == find_roles(skeleton)


def test_the_roles_that_a_skeleton_brings_are_its_override() -> None:
    plain, _ = body(*HIK)
    skeleton = Skeleton(plain.names, plain.parents, plain.offsets, roles={"jaw": "HeadTop_End"})
    assert find_roles(skeleton) == find_roles(plain, {"jaw": "HeadTop_End"})
    assert find_roles(skeleton, {}).joint("jaw") is None


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ({"leftArm": "LeftArm"}, r"unknown role 'leftArm' \(did you mean 'left\w+Arm'\?\), expected a VRM 1.0"),
        ({"wing": "LeftArm"}, r"unknown role 'wing'"),
        ({"leftHand": "LeftHnad"}, r"leftHand: the skeleton has no joint 'LeftHnad' \(did you mean 'LeftHand'\?\)"),
        ({"leftHand": "xyz"}, r"no joint 'xyz'; its 61 joints begin with Hips, Spine, Spine1"),
        ({"leftHand": "LeftHand", "jaw": "LeftHand"}, r"joint 'LeftHand' is both leftHand and jaw"),
    ],
)
def test_a_wrong_override_is_refused_in_one_line(override: dict[str, str], said: str) -> None:
    skeleton, _ = body(*HIK)
    with pytest.raises(InputError, match=said) as caught:
        find_roles(skeleton, override)
    assert "\n" not in str(caught.value)


def test_what_was_found_is_kept_as_long_as_the_skeleton_lives() -> None:
    skeleton, _ = body(*HIK)
    found = find_roles(skeleton)
    assert find_roles(skeleton) is found
    again, _ = body(*HIK)
    assert find_roles(again) is not found
    assert find_roles(again) == found
    assert find_roles(skeleton, {"jaw": "HeadTop_End"}) != found
    assert find_roles(skeleton) is found
    gone = weakref.ref(skeleton)
    del skeleton
    gc.collect()
    assert gone() is None


def test_a_humanoid_cannot_be_written_and_knows_both_ways() -> None:
    given = {"head": 2, "hips": 0}
    humanoid = Humanoid("custom", given)
    given["jaw"] = 3
    assert list(humanoid.joints.items()) == [("hips", 0), ("head", 2)]
    assert humanoid.joint("head") == 2
    assert humanoid.joint("jaw") is None
    assert humanoid.role_of == {0: "hips", 2: "head"}
    with pytest.raises(TypeError):
        humanoid.joints["jaw"] = 3  # type: ignore[index]


@pytest.mark.parametrize("joints", [{"tail": 1}, {"hips": 1, "head": 1}])
def test_a_humanoid_refuses_roles_that_cannot_be(joints: dict[str, int]) -> None:
    with pytest.raises(InputError):
        Humanoid("custom", joints)


@pytest.mark.parametrize(
    ("names", "form"),
    [
        (
            "mixamorig:LeftArm mixamorig_LeftArm mixamorigLeftArm mixamorig1:LeftArm Character1_LeftArm ns:LeftArm "
            "Armature|mixamorig:LeftArm LeftArm Left_Arm Arm.L Arm_L Arm-L ArmL L_Arm arm_left LEFT_ARM leftarm larm",
            "leftarm",
        ),
        ("Bip01_L_UpperArm ValveBiped.Bip01_L_UpperArm upperarm_l J_Bip_L_UpperArm DEF-upper_arm.L", "leftupperarm"),
        ("lShldr LShldr lshldr l_shldr", "leftshldr"),
        ("rThumb1 rthumb1 RightThumb1 thumb1.R", "rightthumb1"),
        ("f_index.01.L ORG-f_index.01.L f_index01L", "leftfindex01"),
        ("Hips mixamorig:Hips J_Bip_C_Hips DEF-hips HIPS", "hips"),
        # Neither a side nor a prefix.
        ("L5", "l5"),
        ("leg Leg", "leg"),
        ("lowerarm", "lowerarm"),
        ("ring1", "ring1"),
        ("Bip01", "bip01"),
        ("Default", "default"),
        ("L", "l"),
        ("_", "_"),
    ],
)
def test_names_of_one_joint_have_one_form(names: str, form: str) -> None:
    assert {name: simplify(name) for name in names.split()} == dict.fromkeys(names.split(), form)


def test_names_with_spaces_have_the_same_form() -> None:
    assert simplify("Bip01 L UpperArm") == simplify("BIP01 L UPPERARM") == "leftupperarm"
    assert simplify("Left Thumb Proximal") == "leftthumbproximal"
    assert simplify("") == ""


@pytest.mark.parametrize("rig", BODIES)
def test_no_two_joints_of_a_rig_have_one_form(rig: str) -> None:
    skeleton, _ = body(*BODIES[rig][1])
    assert len({simplify(name) for name in skeleton.names}) == len(skeleton)


def test_an_override_is_read(tmp_path: Path) -> None:
    file = tmp_path / "roles.json"
    file.write_text('\ufeff{"hips": "Root", "leftHand": "poignée"}', encoding="utf-8")
    assert roles.read(file) == roles.read(str(file)) == {"hips": "Root", "leftHand": "poignée"}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (b'{\n"hips": "Root",\n}', ":3: not JSON"),
        (b"", ":1: not JSON"),
        (b'{"hips": "\xff"}', ": not JSON"),
        (b"[" * 100_000, ": not JSON"),
        (b'["hips"]', r': found \["hips"\], expected an object'),
        (b'{"hip": "Root"}', r": unknown role 'hip' \(did you mean 'hips'\?\)"),
        (b'{"hips": 3}', ": hips: found 3, expected a joint's name"),
        (b'{"hips": ["Root"]}', r': hips: found \["Root"\]'),
    ],
)
def test_an_override_that_is_none_is_refused_in_one_line(tmp_path: Path, text: bytes, said: str) -> None:
    file = tmp_path / "roles.json"
    file.write_bytes(text)
    with pytest.raises(FormatError, match=re.escape(str(file)) + said) as caught:
        roles.read(file)
    assert "\n" not in str(caught.value)


def test_an_override_that_is_missing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no\.json: no such file"):
        roles.read(tmp_path / "no.json")


def hierarchy(text: str) -> Skeleton:
    """The joints that a BVH file's HIERARCHY names."""
    names: list[str] = []
    parents: list[int] = []
    above: list[int] = []
    last = -1
    for name, brace in re.findall(r"(?:ROOT|JOINT)\s+(\S+)|([{}])", text.split("MOTION")[0]):
        if name:
            names.append(name)
            parents.append(above[-1] if above else -1)
            last = len(names) - 1
        elif brace == "{":
            above.append(last)
        else:
            above.pop()
    return Skeleton(tuple(names), np.array(parents), np.zeros((len(names), 3)))


def test_real_clips_have_whole_bodies() -> None:
    files = sorted(CLIPS.glob("*.bvh"))
    if not files:
        pytest.skip("real clips not present")
    for file in files:
        skeleton = hierarchy(file.read_text(encoding="utf-8", errors="replace"))
        humanoid = find_roles(skeleton)
        assert humanoid.rig == "mixamo", file.name
        assert set(ROLES) - set(humanoid.joints) == {"jaw", "leftEye", "rightEye"}, file.name
        for role, end in (("hips", "Hips"), ("upperChest", "Spine2"), ("rightLittleDistal", "RightHandPinky3")):
            assert skeleton.names[humanoid.joints[role]].endswith(end), file.name
