"""Joint names of rigs that people use, and the role that each joint plays: the table that test_roles.py runs on.

A body is written as chains of joints from the trunk outwards. "Hips=hips/Spine=spine" is a joint Hips that plays the
role hips, and below it a joint Spine that plays spine. A chain begins at the root, or at a joint of an earlier chain.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np

from signsplice.motion import Skeleton
from signsplice.rig.roles import FINGERS, ROLES, finger_roles


def skeleton_of(*chains: str) -> tuple[Skeleton, dict[str, str]]:
    """A skeleton of the chains' joints, and the roles that are written in them: role -> joint name."""
    names: list[str] = []
    parents: list[int] = []
    roles: dict[str, str] = {}
    for chain in chains:
        parent = -1
        for link in chain.split("/"):
            name, _, role = link.partition("=")
            if name not in names:
                names.append(name)
                parents.append(parent)
            if role:
                assert role in ROLES
                roles[role] = name
            parent = names.index(name)
    return Skeleton(tuple(names), np.array(parents), np.zeros((len(names), 3))), roles


def reverse_depth_first(skeleton: Skeleton) -> list[int]:
    """Every joint in depth-first order, with the children of each joint in reverse order."""
    order, stack = [], [0]
    while stack:
        order.append(stack.pop())
        stack += skeleton.children[order[-1]]
    return order


def with_joints(skeleton: Skeleton, joints: Sequence[int]) -> Skeleton:
    """The skeleton of these joints in this order: the root first, and all ancestors of a joint before it."""
    row = {joint: n for n, joint in enumerate(joints)}
    parents = [row.get(int(skeleton.parents[joint]), -1) for joint in joints]
    return Skeleton(tuple(skeleton.names[joint] for joint in joints), np.array(parents), skeleton.offsets[list(joints)])


def both_sides(chains: Sequence[str], left: str, right: str) -> list[str]:
    """The chains and their mirror images.

    left, right: the regular expression for what names the left side in a joint's name, and what replaces it.
    """

    def mirrored(link: str) -> str:
        name, _, role = link.partition("=")
        return re.sub(left, right, name) + (f"=right{role[4:]}" if role.startswith("left") else "")

    return [*chains, *("/".join(mirrored(link) for link in chain.split("/")) for chain in chains)]


def finger_chains(hand: str, pattern: str, words: str, thumb: str, others: str, palm: str = "") -> list[str]:
    """Five chains from ``hand``, the thumb first.

    pattern: a joint's name, with {} for the finger's word and {} for the segment's ending.
    words: the five fingers' words.
    thumb, others: the endings of the three segments of the thumb, and of every other finger.
    palm: name of a joint without a role between the hand and a finger other than the thumb, with {} for its word.
    """
    chains = []
    for finger, word in zip(FINGERS, words.split(), strict=True):
        endings = (thumb if finger == "Thumb" else others).split()
        inside = [palm.format(word)] if palm and finger != "Thumb" else []
        segments = zip(endings, finger_roles(finger), strict=True)
        chains.append("/".join([hand, *inside, *(f"{pattern.format(word, end)}=left{role}" for end, role in segments)]))
    return chains


def prefixed(prefix: str, chains: Sequence[str]) -> list[str]:
    """The chains with a prefix before every joint's name."""
    return ["/".join(prefix + link for link in chain.split("/")) for chain in chains]


HIK = [
    "Hips=hips/Spine=spine/Spine1=chest/Spine2=upperChest/Neck=neck/Head=head/HeadTop_End",
    *both_sides(
        [
            "Spine2/LeftShoulder=leftShoulder/LeftArm=leftUpperArm/LeftForeArm=leftLowerArm/LeftHand=leftHand",
            *finger_chains("LeftHand", "LeftHand{}{}", "Thumb Index Middle Ring Pinky", "1 2 3", "1 2 3"),
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
RIGIFY = [
    "spine=hips/spine.001=spine/spine.002=chest/spine.003=upperChest/spine.004=neck/spine.005/spine.006=head",
    *both_sides(
        [
            "spine.003/shoulder.L=leftShoulder/upper_arm.L=leftUpperArm/forearm.L=leftLowerArm/hand.L=leftHand",
            *finger_chains(
                "hand.L", "{}.{}.L", "thumb f_index f_middle f_ring f_pinky", "01 02 03", "01 02 03", "palm.{}.L"
            ),
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
            *finger_chains(
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

RIGS: dict[str, tuple[str, list[str]]] = {
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
                    *finger_chains(
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
                    *finger_chains("LHand", "LHand{}{}", "T I M R P", "1 2 3", "1 2 3", "LHand{}"),
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
                    *finger_chains(
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
                    *finger_chains("J_Bip_L_Hand", "J_Bip_L_{}{}", "Thumb Index Middle Ring Little", "1 2 3", "1 2 3"),
                    "J_Bip_C_Hips/J_Bip_L_UpperLeg=leftUpperLeg/J_Bip_L_LowerLeg=leftLowerLeg/J_Bip_L_Foot=leftFoot"
                    "/J_Bip_L_ToeBase=leftToes",
                ],
                "_L_",
                "_R_",
            ),
        ],
    ),
    "rigify metarig": ("rigify", RIGIFY),
    "rigify ORG": ("rigify", prefixed("ORG-", RIGIFY)),
    "rigify DEF": ("rigify", [*prefixed("DEF-", RIGIFY), "DEF-upper_arm.L/DEF-upper_arm.L.001"]),
    "rigify in three.js": ("rigify", [chain.replace(".", "") for chain in RIGIFY]),
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
    "rigify 1, limbs in halves": (
        "rigify",
        [
            "hips=hips/spine=spine/ribs=chest/neck=neck/head=head",
            *both_sides(
                [
                    "ribs/shoulder.L=leftShoulder/upper_arm.L.01=leftUpperArm/upper_arm.L.02/forearm.L.01=leftLowerArm"
                    "/forearm.L.02/hand.L=leftHand/palm.01.L",
                    "hips/thigh.L.01=leftUpperLeg/thigh.L.02/shin.L.01=leftLowerLeg/shin.L.02/foot.L=leftFoot"
                    "/toe.L=leftToes",
                ],
                r"\.L",
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
                    *finger_chains("left_wrist", "left_{}{}", FIVE, "1 2 3", "1 2 3"),
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
    # Names of the joints of MHR, in which SAM 3D Body puts out its bodies.
    "mhr": (
        "bvh",
        [
            "body_world/root=hips/c_spine0=spine/c_spine1/c_spine2=chest/c_spine3=upperChest/c_neck=neck/c_head=head/c_jaw=jaw"
            "/c_teeth",
            *both_sides(
                [
                    "c_head/l_eye=leftEye/l_eye_null",
                    "root/l_upleg=leftUpperLeg/l_lowleg=leftLowerLeg/l_foot=leftFoot/l_talocrural/l_subtalar"
                    "/l_transversetarsal/l_ball=leftToes",
                    "l_upleg/l_upleg_twist0_proc",
                    "c_spine3/l_clavicle=leftShoulder/l_uparm=leftUpperArm/l_lowarm=leftLowerArm/l_wrist_twist"
                    "/l_wrist=leftHand",
                    "l_lowarm/l_lowarm_twist1_proc",
                    "l_uparm/l_uparm_twist0_proc",
                    "l_wrist/l_thumb0/l_thumb1=leftThumbMetacarpal/l_thumb2=leftThumbProximal/l_thumb3=leftThumbDistal"
                    "/l_thumb_null",
                    "l_wrist/l_pinky0/l_pinky1=leftLittleProximal/l_pinky2=leftLittleIntermediate"
                    "/l_pinky3=leftLittleDistal/l_pinky_null",
                    *(
                        f"l_wrist/l_{name}1=left{finger}Proximal/l_{name}2=left{finger}Intermediate"
                        f"/l_{name}3=left{finger}Distal/l_{name}_null"
                        for name, finger in (("index", "Index"), ("middle", "Middle"), ("ring", "Ring"))
                    ),
                ],
                "^l_",
                "r_",
            ),
        ],
    ),
    # Names of the joints of SOMA, in which GEM-X puts out its bodies.
    "soma": (
        "soma",
        [
            "Hips=hips/Spine1=spine/Spine2=chest/Chest=upperChest/Neck1=neck/Neck2/Head=head/HeadEnd",
            "Head/Jaw=jaw",
            *both_sides(
                [
                    "Head/LeftEye=leftEye",
                    "Hips/LeftLeg=leftUpperLeg/LeftShin=leftLowerLeg/LeftFoot=leftFoot/LeftToeBase=leftToes/LeftToeEnd",
                    "Chest/LeftShoulder=leftShoulder/LeftArm=leftUpperArm/LeftForeArm=leftLowerArm/LeftHand=leftHand",
                    "LeftHand/LeftHandThumb1=leftThumbMetacarpal/LeftHandThumb2=leftThumbProximal"
                    "/LeftHandThumb3=leftThumbDistal/LeftHandThumbEnd",
                    *(
                        f"LeftHand/LeftHand{name}1/LeftHand{name}2=left{finger}Proximal"
                        f"/LeftHand{name}3=left{finger}Intermediate/LeftHand{name}4=left{finger}Distal/LeftHand{name}End"
                        for name, finger in (
                            ("Index", "Index"),
                            ("Middle", "Middle"),
                            ("Ring", "Ring"),
                            ("Pinky", "Little"),
                        )
                    ),
                ],
                "Left",
                "Right",
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
        [
            *CLASSIC,
            *both_sides(finger_chains("LeftWrist", "LeftHand{}{}", FIVE.title(), "1 2 3", "1 2 3"), "Left", "Right"),
        ],
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
                    *finger_chains("lHand", "l{}{}", "Thumb Index Mid Ring Pinky", "1 2 3", "1 2 3"),
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
                    *finger_chains("lHand", "l{}{}", "Thumb Index Mid Ring Pinky", "1 2 3", "1 2 3", "lCarpal{}"),
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
                    *finger_chains("hand_l", "{}_{}_l", FIVE, "01 02 03", "01 02 03"),
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
                    *finger_chains("hand_l", "{}_{}_l", FIVE, "01 02 03", "01 02 03", "{}_metacarpal_l"),
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
                    *finger_chains(
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
                    *finger_chains(
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
                    *finger_chains("CC_Base_L_Hand", "CC_Base_L_{}{}", "Thumb Index Mid Ring Pinky", "1 2 3", "1 2 3"),
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
                    *finger_chains("LHand", "L{}{}", FIVE.title(), "1 2 3", "1 2 3"),
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
    "makehuman, one arm bone less": (
        "makehuman",
        [
            "root=hips/spine05=spine/spine04/spine03=chest/spine02/spine01=upperChest/neck01=neck/neck02/head=head",
            *both_sides(
                [
                    "spine01/clavicle_L=leftShoulder/shoulder01_L/shoulder02_L=leftUpperArm/upperarm02_L"
                    "/lowerarm01_L=leftLowerArm/lowerarm02_L/wrist_L=leftHand",
                    "root/pelvis_L/upperleg01_L=leftUpperLeg/upperleg02_L/lowerleg01_L=leftLowerLeg/foot_L=leftFoot",
                ],
                "_L$",
                "_R",
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
                    *finger_chains("wrist.L", "finger{}-{}.L", "1 2 3 4 5", "1 2 3", "1 2 3", "metacarpal{}.L"),
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
                    *finger_chains("hand.l", "c_{}{}.l", FIVE, "1 2 3", "1 2 3"),
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
                    *finger_chains("Wrist_L", "{}Finger{}_L", FIVE.title(), "1 2 3", "1 2 3"),
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
    "mmd in Japanese": (
        "mmd",
        [
            "全ての親/センター/グルーブ/腰=hips/上半身=spine/上半身2=chest/首=neck/頭=head/両目",
            *both_sides(
                [
                    "頭/左目=leftEye",
                    "上半身2/左肩P/左肩=leftShoulder/左肩C/左腕=leftUpperArm/左腕捩/左ひじ=leftLowerArm/左手捩/左手首=leftHand",
                    "左手首/左親指０=leftThumbMetacarpal/左親指１=leftThumbProximal/左親指２=leftThumbDistal/左親指先",
                    *finger_chains("左手首", "左{}{}", "親指 人指 中指 薬指 小指", "０ １ ２", "１ ２ ３")[1:],
                    "左人指３/左人指先",
                    "腰/下半身/腰キャンセル左/左足=leftUpperLeg/左ひざ=leftLowerLeg/左足首=leftFoot/左つま先=leftToes",
                    "全ての親/左足IK親/左足ＩＫ/左つま先ＩＫ",
                ],
                "左",
                "右",
            ),
        ],
    ),
    # Half-width letters, the thumb's last two joints only, and Blender's sides at the end.
    "mmd in Japanese, of an early model in Blender": (
        "mmd",
        [
            "ｾﾝﾀｰ=hips/上半身=spine/首=neck/頭=head",
            *both_sides(
                [
                    "上半身/肩.L=leftShoulder/腕.L=leftUpperArm/ひじ.L=leftLowerArm/手首.L=leftHand"
                    "/親指1.L=leftThumbProximal/親指2.L=leftThumbDistal",
                    "手首.L/人差指1.L=leftIndexProximal/人差指2.L=leftIndexIntermediate/人差指3.L=leftIndexDistal",
                    "ｾﾝﾀｰ/下半身/足.L=leftUpperLeg/ひざ.L=leftLowerLeg/足首.L=leftFoot",
                ],
                r"\.L$",
                ".R",
            ),
        ],
    ),
    "mmd as mmd_tools translates it": (
        "mmd",
        [
            "Center/Groove/Waist=hips/UpperBody=spine/UpperBody2=chest/Neck=neck/Head=head/Eyes",
            *both_sides(
                [
                    "Head/Eye_L=leftEye",
                    "UpperBody2/Shoulder_L=leftShoulder/Arm_L=leftUpperArm/ArmTwist_L/Elbow_L=leftLowerArm/Wrist_L=leftHand",
                    *finger_chains(
                        "Wrist_L", "{}{}_L", "Thumb IndexFinger MiddleFinger RingFinger LittleFinger", "0 1 2", "1 2 3"
                    ),
                    "Waist/LowerBody/Leg_L=leftUpperLeg/Knee_L=leftLowerLeg/Ankle_L=leftFoot/ToeTip_L=leftToes",
                    "Center/LegIK_L/ToeTipIK_L",
                ],
                "_L$",
                "_R",
            ),
        ],
    ),
    **{
        f"quest, {prefix}": (
            "quest",
            prefixed(
                f"{prefix}_",
                [
                    "Root/Hips=hips/SpineLower=spine/SpineMiddle/SpineUpper=chest/Chest=upperChest/Neck=neck/Head=head",
                    *both_sides(
                        [
                            "Chest/LeftShoulder=leftShoulder/LeftScapula",
                            "LeftShoulder/LeftArmUpper=leftUpperArm/LeftArmLower=leftLowerArm/LeftHandWristTwist",
                            "LeftArmLower/LeftHandWrist=leftHand/LeftHandPalm",
                            *finger_chains(
                                "LeftHandWrist",
                                "LeftHand{}{}",
                                "Thumb Index Middle Ring Little",
                                "Metacarpal Proximal Distal",
                                "Proximal Intermediate Distal",
                                "LeftHand{}Metacarpal",
                            ),
                            "LeftHandThumbDistal/LeftHandThumbTip",
                            "LeftHandIndexDistal/LeftHandIndexTip",
                            *legs,
                        ],
                        "Left",
                        "Right",
                    ),
                ],
            ),
        )
        for prefix, legs in (
            ("Body", ()),
            (
                "FullBody",
                (
                    "Hips/LeftUpperLeg=leftUpperLeg/LeftLowerLeg=leftLowerLeg/LeftFootAnkleTwist"
                    "/LeftFootAnkle=leftFoot/LeftFootSubtalar/LeftFootTransverse/LeftFootBall=leftToes",
                ),
            ),
        )
    },
    "quest, both hands": (
        "quest",
        [
            "hands",
            *both_sides(
                [
                    "hands/b_l_wrist=leftHand/b_l_forearm_stub",
                    "b_l_wrist/b_l_thumb0/b_l_thumb1=leftThumbMetacarpal/b_l_thumb2=leftThumbProximal"
                    "/b_l_thumb3=leftThumbDistal/b_l_thumb_null",
                    *finger_chains("b_l_wrist", "b_l_{}{}", FIVE, "1 2 3", "1 2 3")[1:4],
                    "b_l_wrist/b_l_pinky0/b_l_pinky1=leftLittleProximal/b_l_pinky2=leftLittleIntermediate"
                    "/b_l_pinky3=leftLittleDistal",
                ],
                "_l_",
                "_r_",
            ),
        ],
    ),
    # Second Life's avatar, with the joints that Bento adds.
    "second life, of its own names": (
        "secondLife",
        [
            "mPelvis=hips/mSpine1/mSpine2/mTorso=spine/mSpine3/mSpine4/mChest=chest/mNeck=neck/mHead=head/mSkull",
            "mHead/mFaceRoot/mFaceJaw=jaw",
            *both_sides(
                [
                    "mHead/mEyeLeft=leftEye",
                    "mFaceRoot/mFaceEyeAltLeft",
                    "mChest/mCollarLeft=leftShoulder/mShoulderLeft=leftUpperArm/mElbowLeft=leftLowerArm/mWristLeft=leftHand",
                    *finger_chains("mWristLeft", "mHand{}{}Left", "Thumb Index Middle Ring Pinky", "1 2 3", "1 2 3"),
                    "mPelvis/mHipLeft=leftUpperLeg/mKneeLeft=leftLowerLeg/mAnkleLeft=leftFoot/mFootLeft=leftToes/mToeLeft",
                ],
                "Left",
                "Right",
            ),
        ],
    ),
    "second life, of its own names, without Bento": (
        "secondLife",
        [
            "mPelvis=hips/mTorso=spine/mChest=chest/mNeck=neck/mHead=head",
            *both_sides(
                [
                    "mChest/mCollarLeft=leftShoulder/mShoulderLeft=leftUpperArm/mElbowLeft=leftLowerArm/mWristLeft=leftHand",
                    "mPelvis/mHipLeft=leftUpperLeg/mKneeLeft=leftLowerLeg/mAnkleLeft=leftFoot/mFootLeft=leftToes",
                ],
                "Left",
                "Right",
            ),
        ],
    ),
}
"""Rig -> the naming convention that it follows, and its chains."""
