"""rig.roles: the role of every joint is found by its name, in the rigs of known_rigs.py and in odd bodies."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from known_rigs import FIVE, HIK, RIGS, finger_chains, reverse_depth_first, skeleton_of, with_joints
from signsplice.errors import InputError
from signsplice.motion import Clip, Skeleton
from signsplice.motion.kinematics import path_to_root
from signsplice.rig.roles import ROLES, Humanoid, find_roles


def named(skeleton: Skeleton, humanoid: Humanoid) -> dict[str, str]:
    """Role -> joint name."""
    return {role: skeleton.names[joint] for role, joint in humanoid.joints.items()}


@pytest.mark.parametrize("rig", RIGS)
def test_exactly_the_roles_of_each_rig_are_found(rig: str) -> None:
    convention, chains = RIGS[rig]
    skeleton, roles = skeleton_of(*chains)
    humanoid = find_roles(skeleton)
    assert named(skeleton, humanoid) == roles
    assert humanoid.rig == convention


@pytest.mark.parametrize("rig", RIGS)
def test_the_order_of_joints_does_not_matter(rig: str) -> None:
    skeleton, roles = skeleton_of(*RIGS[rig][1])
    reordered = with_joints(skeleton, reverse_depth_first(skeleton))
    assert reordered.names != skeleton.names
    assert named(reordered, find_roles(reordered)) == roles


@pytest.mark.parametrize("rig", [rig for rig in RIGS if rig not in ("kinect", "mhr")])  # hips by both legs
def test_the_left_half_of_a_body_is_enough(rig: str) -> None:
    skeleton, roles = skeleton_of(*RIGS[rig][1])
    right = {joint for role, joint in find_roles(skeleton).joints.items() if role.startswith("right")}
    half = with_joints(skeleton, [j for j in range(len(skeleton)) if right.isdisjoint(path_to_root(skeleton, j))])
    assert len(half) < len(skeleton)
    assert named(half, find_roles(half)) == {role: name for role, name in roles.items() if not role.startswith("right")}


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
def test_the_joints_of_the_spine_are_counted_off(
    n_joints: int, spine: int | None, chest: int | None, upper: int | None
) -> None:
    trunk = "/".join(["Hips", *(f"Back{n}" for n in range(n_joints)), "Neck", "Head"])
    above_arms = f"Back{n_joints - 1}" if n_joints else "Hips"
    skeleton, _ = skeleton_of(trunk, f"{above_arms}/LeftArm/LeftForeArm/LeftHand")
    joints = named(skeleton, find_roles(skeleton))
    for role, number in (("spine", spine), ("chest", chest), ("upperChest", upper)):
        assert joints.get(role) == (None if number is None else f"Back{number}"), role


def test_the_upper_chest_is_the_joint_that_carries_the_shoulders() -> None:
    skeleton, roles = skeleton_of(
        "Hips=hips/Spine=spine/Spine1=chest/Spine2=upperChest/Spine3/Spine4/Neck=neck/Head=head",
        "Spine2/LeftShoulder=leftShoulder/LeftArm=leftUpperArm/LeftForeArm=leftLowerArm",
        "Spine2/RightShoulder=rightShoulder/RightArm=rightUpperArm/RightForeArm=rightLowerArm",
    )
    assert named(skeleton, find_roles(skeleton)) == roles


def test_without_a_neck_the_spine_ends_where_the_arms_begin() -> None:
    skeleton, roles = skeleton_of(
        "Hips=hips/Spine=spine/Spine1=chest/Extra",
        "Spine1/LeftArm=leftUpperArm/LeftForeArm=leftLowerArm/LeftHand=leftHand",
        "Spine1/RightArm=rightUpperArm/RightForeArm=rightLowerArm/RightHand=rightHand",
    )
    assert named(skeleton, find_roles(skeleton)) == roles


def test_a_joint_on_the_wrong_branch_gets_no_role() -> None:
    skeleton, roles = skeleton_of(
        "Hips=hips/Spine=spine/Neck=neck/Head=head",
        "Spine/LeftShoulder=leftShoulder/LeftArm=leftUpperArm/LeftForeArm=leftLowerArm/LeftHand=leftHand",
        "Spine/RightShoulder=rightShoulder/RightArm=rightUpperArm/RightForeArm=rightLowerArm/RightHand=rightHand",
        "LeftHand/RightHandIndex1",
        "Hips/LeftUpLeg=leftUpperLeg",
        "Spine/LeftLeg",
    )
    assert named(skeleton, find_roles(skeleton)) == roles


@pytest.mark.parametrize("rig", RIGS)
def test_each_role_lies_below_the_roles_it_hangs_from(rig: str) -> None:
    skeleton, _ = skeleton_of(*RIGS[rig][1])
    joints = find_roles(skeleton).joints
    for chain in (
        ("hips", "spine", "chest", "upperChest", "neck", "head"),
        ("upperChest", "leftUpperArm", "leftLowerArm", "leftHand", "leftIndexProximal", "leftIndexDistal"),
        ("hips", "rightUpperLeg", "rightLowerLeg", "rightFoot", "rightToes"),
        ("rightHand", "rightThumbMetacarpal", "rightThumbProximal", "rightThumbDistal"),
    ):
        found = [joints[role] for role in chain if role in joints]
        for over, joint in pairwise(found):
            assert over in path_to_root(skeleton, joint)[1:]


def test_in_a_full_rigify_rig_only_deform_bones_get_roles() -> None:
    limbs = "{0}spine/{0}spine.001/{0}shoulder.L/{0}upper_arm.L/{0}forearm.L/{0}hand.L"
    skeleton, _ = skeleton_of(*("root/" + limbs.format(kind) for kind in ("ORG-", "DEF-", "MCH-", "")))
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
def test_names_without_meaning_get_no_roles(chains: list[str]) -> None:
    assert find_roles(skeleton_of(*chains)[0]) == Humanoid("unknown", {})


@pytest.mark.parametrize("pattern", ["mixamorig:{}_{:03d}", "{}_JNT", "Ana_{}_jnt", "Actor-{}"])
def test_what_all_names_have_in_common_is_ignored(pattern: str) -> None:
    plain, roles = skeleton_of(*HIK)
    names = tuple(pattern.format(name, n) for n, name in enumerate(plain.names))
    skeleton = Skeleton(("Armature", *names), np.array([-1, *(plain.parents + 1)]), np.zeros((len(names) + 1, 3)))
    found = {role: plain.names[joint - 1] for role, joint in find_roles(skeleton).joints.items()}
    assert found == roles


@pytest.mark.parametrize(
    "chain", ["Root/Ana_Arm_L/Ana_ForeArm_L/Ana_Hand_L", "Root/L_Arm_JNT/L_ForeArm_JNT/L_Hand_JNT"]
)
def test_a_side_that_all_names_have_in_common_is_kept(chain: str) -> None:
    found = find_roles(skeleton_of(chain)[0])
    assert list(found.joints.items()) == [("leftUpperArm", 1), ("leftLowerArm", 2), ("leftHand", 3)]


def test_a_pelvis_that_carries_only_the_legs_is_not_the_hips() -> None:
    skeleton, roles = skeleton_of(
        "Body=hips/Spine=spine/Neck=neck/Head=head",
        "Spine/LeftArm=leftUpperArm/LeftForeArm=leftLowerArm/LeftHand=leftHand",
        "Spine/RightArm=rightUpperArm/RightForeArm=rightLowerArm/RightHand=rightHand",
        "Body/Pelvis/LeftUpLeg=leftUpperLeg/LeftLeg=leftLowerLeg",
        "Pelvis/RightUpLeg=rightUpperLeg/RightLeg=rightLowerLeg",
    )
    assert named(skeleton, find_roles(skeleton)) == roles


def test_a_hand_without_a_body_is_found() -> None:
    skeleton, roles = skeleton_of(
        "LeftHand=leftHand", *finger_chains("LeftHand", "LeftHand{}{}", FIVE.title(), "1 2 3", "1 2 3")
    )
    assert named(skeleton, find_roles(skeleton)) == roles


def test_an_upper_body_without_hips_has_none() -> None:
    skeleton, _ = skeleton_of("Root/Spine/Spine1/Neck/Head", "Spine1/LeftShoulder/LeftArm/LeftForeArm/LeftHand")
    found = named(skeleton, find_roles(skeleton))
    assert "hips" not in found
    assert found["spine"] == "Spine"
    assert found["leftUpperArm"] == "LeftArm"


def test_an_override_wins_and_tables_fill_the_rest() -> None:
    skeleton, roles = skeleton_of(*HIK)
    humanoid = find_roles(skeleton, {"leftHand": "LeftHandMiddle1", "jaw": "HeadTop_End"})
    found = named(skeleton, humanoid)
    assert humanoid.rig == "custom"
    assert found["leftHand"] == "LeftHandMiddle1"
    assert found["jaw"] == "HeadTop_End"
    assert "leftMiddleProximal" not in found, "its joint is the hand now"
    assert "leftIndexProximal" not in found, "its joint does not hang from that hand"
    assert found["rightHand"] == roles["rightHand"]


def test_an_override_is_enough_where_names_mean_nothing() -> None:
    skeleton, roles = skeleton_of(
        "a=hips/b=spine/c=chest/d=neck/e=head",
        "c/f=leftUpperArm/g=leftLowerArm/h=leftHand",
    )
    counted = ("spine", "chest")
    humanoid = find_roles(skeleton, {role: name for role, name in roles.items() if role not in counted})
    assert humanoid.rig == "custom"
    assert named(skeleton, humanoid) == roles


def test_an_empty_override_changes_nothing() -> None:
    skeleton, _ = skeleton_of(*HIK)
    assert find_roles(skeleton, {}) == find_roles(skeleton)


def test_roles_stored_in_the_skeleton_are_the_override() -> None:
    plain, _ = skeleton_of(*HIK)
    skeleton = Skeleton(plain.names, plain.parents, plain.offsets, roles={"jaw": "HeadTop_End"})
    assert find_roles(skeleton) == find_roles(plain, {"jaw": "HeadTop_End"})
    assert find_roles(skeleton, {}).joint("jaw") is None


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ({"leftArm": "LeftArm"}, r"unknown role 'leftArm' \(did you mean 'left\w+Arm'\?\), expected a VRM 1.0"),
        ({"tail": "LeftArm"}, r"unknown role 'tail'"),
        ({"leftHand": "LeftHnad"}, r"leftHand: the skeleton has no joint 'LeftHnad' \(did you mean 'LeftHand'\?\)"),
        ({"leftHand": "xyz"}, r"no joint 'xyz'; its 61 joints begin with Hips, Spine, Spine1"),
        ({"leftHand": "LeftHand", "jaw": "LeftHand"}, r"joint 'LeftHand' is both leftHand and jaw"),
    ],
)
def test_a_wrong_override_is_refused_in_one_line(override: dict[str, str], message: str) -> None:
    skeleton, _ = skeleton_of(*HIK)
    with pytest.raises(InputError, match=message) as caught:
        find_roles(skeleton, override)
    assert "\n" not in str(caught.value)


def test_a_humanoid_is_immutable_and_maps_both_directions() -> None:
    given = {"head": 2, "hips": 0}
    humanoid = Humanoid("custom", given)
    given["jaw"] = 3
    assert list(humanoid.joints.items()) == [("hips", 0), ("head", 2)]
    assert humanoid.joint("head") == 2
    assert humanoid.joint("jaw") is None
    assert humanoid.role_of == {0: "hips", 2: "head"}
    with pytest.raises(TypeError):
        humanoid.joints["jaw"] = 3  # type: ignore[index]


@pytest.mark.parametrize(
    ("joints", "message"), [({"tail": 1}, "unknown role 'tail'"), ({"hips": 1, "head": 1}, "one joint has two roles")]
)
def test_a_humanoid_refuses_unknown_and_double_roles(joints: dict[str, int], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Humanoid("custom", joints)


def test_real_clips_have_every_role_but_eyes_and_jaw(real_clips: dict[str, Clip]) -> None:
    for name, clip in real_clips.items():
        humanoid = find_roles(clip.skeleton)
        assert humanoid.rig == "mixamo", name
        assert set(ROLES) - set(humanoid.joints) == {"jaw", "leftEye", "rightEye"}, name
        for role, end in (("hips", "Hips"), ("upperChest", "Spine2"), ("rightLittleDistal", "RightHandPinky3")):
            assert clip.skeleton.names[humanoid.joints[role]].endswith(end), name


@pytest.mark.parametrize(
    ("prefix", "words", "thumb", "others"),
    [
        ("XRHand_", "Thumb Index Middle Ring Little", "Metacarpal Proximal Distal", "Proximal Intermediate Distal"),
        ("Hand_", "Thumb Index Middle Ring Pinky", "1 2 3", "1 2 3"),
    ],
)
def test_a_quest_hand_that_names_no_side_has_that_of_the_joint_above(
    prefix: str, words: str, thumb: str, others: str
) -> None:
    chains = finger_chains("LeftHand", f"{prefix}{{}}{{}}", words, thumb, others)
    skeleton, roles = skeleton_of("Hips/LeftArm/LeftForeArm/LeftHand", *chains)
    roles_of_fingers = {role: name for role, name in named(skeleton, find_roles(skeleton)).items() if prefix in name}
    assert roles_of_fingers == roles


@pytest.mark.parametrize("wrist", ["{}XRHand_Wrist", "{}Hand_WristRoot", "hands:b_{}wrist", "hands:b_{}hand"])
def test_a_quest_wrist_is_the_hand_by_any_of_its_names(wrist: str) -> None:
    names = {side: wrist.format(f"{side}_") for side in "lr"}
    chains = [f"rig/{name}/b_{side}_index1/b_{side}_index2/b_{side}_index3" for side, name in names.items()]
    skeleton, _ = skeleton_of(*chains)
    found = named(skeleton, find_roles(skeleton))
    assert (found["leftHand"], found["rightHand"]) == (names["l"], names["r"])
    assert len(found) == 8
