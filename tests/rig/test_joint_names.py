"""rig.joint_names.simplify: the many spellings of one joint name have one form."""

from __future__ import annotations

import pytest

from known_rigs import RIGS, skeleton_of
from signsplice.rig.roles import simplify


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
        ("左手首 手首.L 手首_L ns:左手首 Wrist_L wrist.L", "leftwrist"),
        ("左人指１ 左人指1 左人差し指１ 人差指１.L", "leftindex1"),
        ("上半身２ 上半身2 UpperBody2", "upperbody2"),
        ("センター ｾﾝﾀｰ Center", "center"),
        ("左腕捩", "leftarmtwist"),
        ("Body_LeftArmUpper FullBody_LeftArmUpper", "leftarmupper"),
        ("b_l_index1 l_index1 hands:b_l_index1", "leftindex1"),
        ("mWristLeft avatar:mWristLeft", "leftwrist"),
        ("mHandThumb1Left", "lefthandthumb1"),
        # Neither a side nor a prefix:
        ("body Body", "body"),
        ("middle1", "middle1"),
        ("mP", "mp"),
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
def test_all_spellings_of_one_joint_have_one_form(names: str, form: str) -> None:
    assert {name: simplify(name) for name in names.split()} == dict.fromkeys(names.split(), form)


def test_spellings_with_spaces_have_the_same_form() -> None:
    assert simplify("Bip01 L UpperArm") == simplify("BIP01 L UPPERARM") == "leftupperarm"
    assert simplify("Left Thumb Proximal") == "leftthumbproximal"
    assert simplify("") == ""


@pytest.mark.parametrize("rig", RIGS)
def test_no_two_joints_of_a_rig_have_the_same_form(rig: str) -> None:
    skeleton, _ = skeleton_of(*RIGS[rig][1])
    assert len({simplify(name) for name in skeleton.names}) == len(skeleton)
