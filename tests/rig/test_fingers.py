"""rig.fingers: the segments of every finger are found in the spellings of many rigs, whatever the body's names are."""

from __future__ import annotations

import pytest

from known_rigs import both_sides, skeleton_of
from signsplice.rig.roles import FINGERS, find_roles, finger_roles

BODY = both_sides(
    ["Hips/Spine/Neck/Head", "Spine/LeftShoulder/LeftArm/LeftForeArm/LeftHand", "Hips/LeftUpLeg/LeftLeg/LeftFoot"],
    "Left",
    "Right",
)
BODY_ROLES = 18
FIVE, LITTLE, MID = "thumb index middle ring pinky", "thumb index middle ring little", "thumb index mid ring pinky"
CAPITALS, LITTLE_CAPITALS = FIVE.title(), LITTLE.title()
DOT_L, END_L, LEFT = (r"\.L$", ".R"), ("_L$", "_R"), ("^Left", "Right")

# Rig -> the fingers' words; joints of the thumb, then of the other fingers, from the palm out, with {} for the word and
# in brackets those without a role, nothing for the others where all five are alike; what makes a right name of a left
# one.
SCHEMES: dict[str, tuple[str, str, str, tuple[str, str]]] = {
    "numbers, gaps irregular": (LITTLE, "{}.01.L/{}.02.L/{}03.L", "{}.01.L/{}.02.L/{}03.L/({}04_end.L)", DOT_L),
    "numbers from zero": (FIVE, "{}0.L/{}1.L/{}2.L", "", DOT_L),
    "numbers, palm zero": (FIVE, "{}01_L/{}02_L/{}03_L", "({}00_L)/{}01_L/{}02_L/{}03_L", END_L),
    "side first": (LITTLE_CAPITALS, "L_{}_1/L_{}_2/L_{}_3/(L_{}_End)", "", ("^L", "R")),
    "side last": (LITTLE, "{}_01_l/{}_02_l/{}_03_l/({}_tip_l)", "", ("_l$", "_r")),
    "upper case": (LITTLE.upper(), "LEFT_{}_1/LEFT_{}_2/LEFT_{}_3", "", ("LEFT", "RIGHT")),
    "lower case": (MID, "l{}1/l{}2/l{}3", "", ("^l", "r")),
    "lower case, hand": (FIVE, "lefthand{}1/lefthand{}2/lefthand{}3/(lefthand{}3_end)", "", ("left", "right")),
    "letters": (FIVE, "{}A.L/{}B.L/{}C.L", "", DOT_L),
    "Blender's numbers": (FIVE, "{}.L/{}.L.001/{}.L.002", "", (r"\.L", ".R")),
    "finger in front": (LITTLE, "finger_{}.01.L/finger_{}.02.L/finger_{}.03.L", "", DOT_L),
    "words": (LITTLE, "{}-proximal.L/{}-intermediate.L/{}-distal.L", "", DOT_L),
    "words in front": (
        LITTLE_CAPITALS,
        "Proximal{}_L/Intermediate{}_L/Distal{}_L/(Distal{}_L_end)",
        "",
        ("_L", "_R"),
    ),
    "two numbers": ("01 02 03 04 05", "finger{}_01_L/finger{}_02_L/finger{}_03_L", "", END_L),
    "Mixamo": (
        CAPITALS,
        "mixamorig:LeftHand{}1/mixamorig:LeftHand{}2/mixamorig:LeftHand{}3/(mixamorig:LeftHand{}4)",
        "",
        ("Left", "Right"),
    ),
    "Ready Player Me": (
        CAPITALS,
        "LeftHand{}1/LeftHand{}2/LeftHand{}3/(LeftHand{}4)/(LeftHand{}4_end)",
        "",
        LEFT,
    ),
    "Perception Neuron": (
        CAPITALS,
        "LeftHand{}1/LeftHand{}2/LeftHand{}3",
        "(LeftInHand{})/LeftHand{}1/LeftHand{}2/LeftHand{}3",
        LEFT,
    ),
    "Vicon": ("T I M R P", "LHand{}1/LHand{}2/LHand{}3", "(LHand{})/LHand{}1/LHand{}2/LHand{}3", ("^L", "R")),
    "Rigify 1, first segments in halves": (
        LITTLE,
        "{}.01.L.01/({}.01.L.02)/{}.02.L/{}.03.L",
        "(palm.L)/finger_{}.01.L.01/(finger_{}.01.L.02)/finger_{}.02.L/finger_{}.03.L",
        (r"\.L", ".R"),
    ),
    "Rigify": (
        "thumb index middle ring pinky",
        "{}.01.L/{}.02.L/{}.03.L",
        "(palm.{}.L)/f_{}.01.L/f_{}.02.L/f_{}.03.L/(f_{}.03.L_end)",
        (r"\.L", ".R"),
    ),
    "VRoid": (
        LITTLE_CAPITALS,
        "J_Bip_L_{}1/J_Bip_L_{}2/J_Bip_L_{}3/(J_Bip_L_{}3_end)",
        "",
        ("_L_", "_R_"),
    ),
    "VRM 1.0": (
        LITTLE_CAPITALS,
        "left{}Metacarpal/left{}Proximal/left{}Distal",
        "left{}Proximal/left{}Intermediate/left{}Distal",
        ("^left", "right"),
    ),
    "Unity, VRM 0.x": (LITTLE_CAPITALS, "Left{}Proximal/Left{}Intermediate/Left{}Distal", "", LEFT),
    "Unity with blanks": (LITTLE_CAPITALS, "Left {} Proximal/Left {} Intermediate/Left {} Distal", "", LEFT),
    "Biped": (
        "0 1 2 3 4",
        "Bip01 L Finger{}/Bip01 L Finger{}1/Bip01 L Finger{}2/(Bip01 L Finger{}Nub)",
        "",
        (" L ", " R "),
    ),
    "Biped of four": (
        "0 1 2 3 4",
        "Bip01 L Finger{}/Bip01 L Finger{}1/Bip01 L Finger{}2",
        "Bip01 L Finger{}/Bip01 L Finger{}1/Bip01 L Finger{}2/(Bip01 L Finger{}3)",
        (" L ", " R "),
    ),
    "Unreal": (
        FIVE,
        "{}_01_l/{}_02_l/{}_03_l",
        "({}_metacarpal_l)/{}_01_l/{}_02_l/{}_03_l",
        ("_l$", "_r"),
    ),
    "DAZ Genesis 8": (MID.title(), "l{}1/l{}2/l{}3/(l{}3_end)", "", ("^l", "r")),
    "DAZ Genesis 9": (MID, "l_{}1/l_{}2/l_{}3", "(l_{}metacarpal)/l_{}1/l_{}2/l_{}3", ("^l", "r")),
    "Character Creator": (
        MID.title(),
        "CC_Base_L_{}1/CC_Base_L_{}2/CC_Base_L_{}3/(CC_Base_L_{}3_end)",
        "",
        ("_L_", "_R_"),
    ),
    "MakeHuman": ("1 2 3 4 5", "finger{}-1.L/finger{}-2.L/finger{}-3.L", "", DOT_L),
    "Auto-Rig Pro": (
        FIVE,
        "{}1.l/c_{}2.l/c_{}3.l",
        "(c_{}1_base.l)/{}1.l/c_{}2.l/c_{}3.l",
        (r"\.l$", ".r"),
    ),
    "Advanced Skeleton": (CAPITALS, "{}Finger1_L/{}Finger2_L/{}Finger3_L/({}Finger4_L)", "", END_L),
    "MMD": (LITTLE_CAPITALS, "{}0_L/{}1_L/{}2_L", "{}Finger1_L/{}Finger2_L/{}Finger3_L", END_L),
    "MMD of old": ("thumb fore middle third little", "{}0_L/{}1_L/{}2_L", "{}1_L/{}2_L/{}3_L", END_L),
    "SMPL-X, MANO": (FIVE, "left_{}1/left_{}2/left_{}3", "", ("left", "right")),
    "Xsens": (
        "First Second Third Fourth Fifth",
        "Left{}MC/Left{}PP/Left{}DP/(Left{}FT)",
        "(Left{}MC)/Left{}PP/Left{}MP/Left{}DP/(Left{}FT)",
        LEFT,
    ),
    "Rokoko": (
        "1 2 3 4 5",
        "LeftFinger{}Metacarpal/LeftFinger{}Proximal/LeftFinger{}Distal/(LeftFinger{}Tip)",
        "(LeftFinger{}Metacarpal)/LeftFinger{}Proximal/LeftFinger{}Medial/LeftFinger{}Distal/(LeftFinger{}Tip)",
        LEFT,
    ),
    "OptiTrack": (CAPITALS, "Skeleton_L{}1/Skeleton_L{}2/Skeleton_L{}3", "", ("_L", "_R")),
    "Meta's body": (
        LITTLE_CAPITALS,
        "LeftHand{}Metacarpal/LeftHand{}Proximal/LeftHand{}Distal/(LeftHand{}Tip)",
        "(LeftHand{}Metacarpal)/LeftHand{}Proximal/LeftHand{}Intermediate/LeftHand{}Distal/(LeftHand{}Tip)",
        LEFT,
    ),
    "Meta's hand of old": (
        FIVE,
        "(b_l_{}0)/b_l_{}1/b_l_{}2/b_l_{}3/(b_l_{}_null)/(b_l_{}_null_end)",
        "",
        ("_l_", "_r_"),
    ),
    "ARKit": (
        MID.title(),
        "left_hand{}Start_joint/left_hand{}_1_joint/left_hand{}_2_joint/(left_hand{}End_joint)",
        "(left_hand{}Start_joint)/left_hand{}_1_joint/left_hand{}_2_joint/left_hand{}_3_joint/(left_hand{}End_joint)",
        ("left", "right"),
    ),
    "visionOS": (
        "thumb indexFinger middleFinger ringFinger littleFinger",
        "left_{}Knuckle/left_{}IntermediateBase/left_{}IntermediateTip/(left_{}Tip)",
        "(left_{}Metacarpal)/left_{}Knuckle/left_{}IntermediateBase/left_{}IntermediateTip/(left_{}Tip)",
        ("left", "right"),
    ),
    "Second Life": (CAPITALS, "mHand{}1Left/mHand{}2Left/mHand{}3Left", "", ("Left", "Right")),
    "phalanges": (
        FIVE,
        "L_{}Metacarpal00_JNT/L_{}ProximalPhalange02_JNT/L_{}DistalPhalange04_JNT",
        "(L_{}Metacarpal00_JNT)/L_{}ProximalPhalange02_JNT/L_{}MiddlePhalange04_JNT/L_{}DistalPhalange06_JNT",
        ("^L", "R"),
    ),
    "joints of anatomy": (
        FIVE,
        "left_{}_cmc/left_{}_mcp/left_{}_ip/(left_{}_tip)",
        "left_{}_mcp/left_{}_pip/left_{}_dip/(left_{}_tip)",
        ("left", "right"),
    ),
}
# Without a side: the hand above tells it.
NO_SIDE = {
    "XRHand": (
        LITTLE_CAPITALS,
        "XRHand_{}Metacarpal/XRHand_{}Proximal/XRHand_{}Distal/(XRHand_{}Tip)",
        "(XRHand_{}Metacarpal)/XRHand_{}Proximal/XRHand_{}Intermediate/XRHand_{}Distal/(XRHand_{}Tip)",
    ),
    "OpenXR": (
        LITTLE.upper(),
        "{}_METACARPAL_EXT/{}_PROXIMAL_EXT/{}_DISTAL_EXT/({}_TIP_EXT)",
        "({}_METACARPAL_EXT)/{}_PROXIMAL_EXT/{}_INTERMEDIATE_EXT/{}_DISTAL_EXT/({}_TIP_EXT)",
    ),
    "WebXR": (
        FIVE,
        "{}-metacarpal/{}-phalanx-proximal/{}-phalanx-distal/({}-tip)",
        "({0}-finger-metacarpal)/{0}-finger-phalanx-proximal/{0}-finger-phalanx-intermediate"
        "/{0}-finger-phalanx-distal/({0}-finger-tip)",
    ),
}


def finger_chains(words: str, thumb: str, others: str) -> list[str]:
    """The chains of a left hand's five fingers, with their roles."""
    chains = []
    for finger, word in zip(FINGERS, words.split(), strict=True):
        roles = iter(finger_roles(finger))
        chain = ["LeftHand"]
        for link in (others if others and finger != "Thumb" else thumb).split("/"):
            name = link.strip("()").replace("{0}", word).replace("{}", word)
            chain.append(name if link.startswith("(") else f"{name}=left{next(roles)}")
        chains.append("/".join(chain))
    return chains


def found_fingers(*chains: str) -> dict[str, str]:
    """Role -> joint name, of the fingers that hang from a body of Mixamo's names."""
    skeleton, _ = skeleton_of(*BODY, *chains)
    roles = find_roles(skeleton).joints
    body = {role for role in roles if not any(finger in role for finger in FINGERS)}
    assert len(body) == BODY_ROLES
    return {role: skeleton.names[joint] for role, joint in roles.items() if role not in body}


@pytest.mark.parametrize("scheme", SCHEMES)
def test_every_segment_of_both_hands_is_found(scheme: str) -> None:
    words, thumb, others, (left, right) = SCHEMES[scheme]
    chains = [chain.removeprefix("LeftHand/") for chain in finger_chains(words, thumb, others)]
    mirrored = both_sides(chains, left, right)
    hands = ["LeftHand"] * len(chains) + ["RightHand"] * len(chains)
    chains = [f"{hand}/{chain}" for hand, chain in zip(hands, mirrored, strict=True)]
    _, roles = skeleton_of(*BODY, *chains)
    assert len(roles) == 30
    assert found_fingers(*chains) == roles


@pytest.mark.parametrize("scheme", NO_SIDE)
@pytest.mark.parametrize("hand", ["LeftHand", "RightHand"])
def test_the_hand_tells_the_side_where_names_do_not(scheme: str, hand: str) -> None:
    chains = finger_chains(*NO_SIDE[scheme])
    if hand == "RightHand":
        chains = [chain.replace("LeftHand", hand).replace("=left", "=right") for chain in chains]
    _, roles = skeleton_of(*BODY, *chains)
    assert len(roles) == 15
    assert found_fingers(*chains) == roles


@pytest.mark.parametrize(
    "chain",
    [
        "LeftHandIndex1=leftIndexProximal",
        "Finger1_Left=leftThumbMetacarpal/Finger2_Left=leftThumbProximal/Finger3_Left=leftThumbDistal",
        "LeftHandIndex1=leftIndexProximal/LeftHandIndex2=leftIndexIntermediate",
        "LeftHandIndex1=leftIndexProximal/LeftHandIndex2=leftIndexIntermediate/LeftHandIndexEnd",
        "LeftHandIndex2=leftIndexIntermediate/LeftHandIndex3=leftIndexDistal",
        "LeftHandIndex1=leftIndexProximal/Wing/LeftHandIndex3=leftIndexDistal",
        "LeftIndexProximal=leftIndexProximal/LeftIndexDistal=leftIndexDistal",
        "LeftIndexIntermediate=leftIndexIntermediate",
        "LeftIndexMetacarpal/LeftIndexProximal=leftIndexProximal",
        "LeftIndexMetacarpal",
        "LHandI/LHandI1=leftIndexProximal/LHandI2=leftIndexIntermediate",
        "LeftIndexTip",
        "LeftThumbMetacarpal=leftThumbMetacarpal/LeftThumbTip",
        "LeftThumbProximal=leftThumbProximal/LeftThumbDistal=leftThumbDistal",
        "LeftThumb=leftThumbMetacarpal",
        "LeftThumb1=leftThumbMetacarpal/LeftThumb2=leftThumbProximal",
        "thumb_metacarpal_l/thumb_01_l=leftThumbMetacarpal/thumb_02_l=leftThumbProximal/thumb_03_l=leftThumbDistal",
        "LeftFinger3Distal=leftMiddleDistal",
        "ring_a_l=leftRingProximal/ring_b_l=leftRingIntermediate",
    ],
)
def test_of_a_short_finger_the_names_tell_the_segments(chain: str) -> None:
    _, roles = skeleton_of(f"LeftHand/{chain}")
    assert found_fingers(f"LeftHand/{chain}") == roles


@pytest.mark.parametrize(
    ("words", "fingers"),
    [
        ("Finger0 Finger1 Finger2 Finger3 Finger4", "Thumb Index Middle Ring Little"),
        ("Finger1 Finger2 Finger3 Finger4 Finger5", "Thumb Index Middle Ring Little"),
        ("Finger0 Finger1 Finger2", "Thumb Index Middle"),
        ("Thumb Finger1 Finger2 Finger3 Finger4", "Thumb Index Middle Ring Little"),
        ("Thumb Finger2 Finger3 Finger4 Finger5", "Thumb Index Middle Ring Little"),
        ("Thumb Finger0 Finger1", "Thumb Index Middle"),
        ("Thumb Fore Middle Third Little", "Thumb Index Middle Ring Little"),
    ],
)
def test_numbers_count_the_fingers_that_have_no_name(words: str, fingers: str) -> None:
    chains = [f"LeftHand/{word}_Proximal_L" for word in words.split()]
    roles = {f"left{f}Proximal": f"{w}_Proximal_L" for f, w in zip(fingers.split(), words.split(), strict=True)}
    assert found_fingers(*chains) == roles


@pytest.mark.parametrize(
    "chains",
    [
        ["LeftHand/RightHandIndex1"],
        ["LeftHand/index_ik_target_l", "LeftHand/LeftThumbSocket"],
        ["LeftHand/spring_l", "LeftHand/L_Earring", "LeftHand/L_Weapon"],
        ["LeftFoot/l_indextoe1", "LeftFoot/l_midtoe1", "LeftHand/LeftIndexToe1"],
        ["LeftForeArm/LeftIndexTarget", "Head/RightHandIndex1"],
        ["LeftHand/LeftHandFingerBase", "LeftHand/lfingers", "LeftHand/LeftFinger9Distal"],
    ],
)
def test_what_is_no_finger_of_that_hand_has_no_role(chains: list[str]) -> None:
    assert found_fingers(*chains) == {}


def test_helpers_beside_a_finger_do_not_shift_it() -> None:
    finger = "LeftHand/index_01_l=leftIndexProximal/index_02_l=leftIndexIntermediate/index_03_l=leftIndexDistal"
    chains = [
        "LeftHand/index_00_helper_l",
        "LeftHand/l_index_marker",
        finger,
        "index_01_l/index_01_twist_l/index_01_half_l",
        "index_03_l/index_nail_l",
        "index_03_l/index_03_pad_l",
    ]
    assert found_fingers(*chains) == skeleton_of(*BODY, *chains)[1]


def test_biped_without_a_thumb_still_counts_from_it() -> None:
    chains = [
        f"LeftHand/Bip01 L Finger{n}=left{finger}Proximal/Bip01 L Finger{n}1=left{finger}Intermediate"
        for n, finger in enumerate(FINGERS)
        if n
    ]
    assert found_fingers(*chains) == skeleton_of(*BODY, *chains)[1]


def test_a_twist_joint_inside_a_finger_is_no_segment() -> None:
    finger = "index_01_l=leftIndexProximal/index_01_twist_l/index_02_l=leftIndexIntermediate/index_03_l=leftIndexDistal"
    assert found_fingers(f"LeftHand/{finger}") == skeleton_of(finger)[1]


def test_the_thumb_of_mmd_counts_from_zero() -> None:
    skeleton, roles = skeleton_of(
        "center/waist=hips/upper body=spine/neck=neck/head=head",
        "upper body/arm_L=leftUpperArm/elbow_L=leftLowerArm/wrist_L=leftHand",
        "wrist_L/Thumb1_L=leftThumbProximal/Thumb2_L=leftThumbDistal",
        "waist/lower body/leg_L=leftUpperLeg/knee_L=leftLowerLeg/ankle_L=leftFoot",
    )
    assert {role: skeleton.names[joint] for role, joint in find_roles(skeleton).joints.items()} == roles


def test_fingers_without_a_hand_are_found_by_their_side() -> None:
    skeleton, roles = skeleton_of(
        "Scene",
        *(f"Scene/{finger}_01_L=left{finger}Proximal" for finger in FINGERS[1:]),
        *(f"Scene/{finger}_01_R=right{finger}Proximal" for finger in FINGERS[1:]),
    )
    assert {role: skeleton.names[joint] for role, joint in find_roles(skeleton).joints.items()} == roles
