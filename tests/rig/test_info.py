"""rig.info: one RigInfo for each skeleton, each part of it computed once, and kept as long as the skeleton lives."""

from __future__ import annotations

import gc
import weakref
from dataclasses import replace

import numpy as np
import pytest

from known_rigs import HIK, skeleton_of
from signsplice.errors import InputError
from signsplice.motion import Clip, Skeleton
from signsplice.rig.info import rig_info
from signsplice.rig.roles import find_roles

PARTS = ("roles", "simple_names", "t_pose", "sizes", "arm_joints", "canonical")


def test_a_skeleton_has_one_rig_info(words: dict[str, Clip]) -> None:
    skeleton = words["SIGN"].skeleton
    info = rig_info(skeleton)
    assert rig_info(skeleton) is info
    for part in PARTS:
        assert getattr(info, part) is getattr(info, part), f"{part} is computed once"
    assert info.roles == find_roles(skeleton)
    assert info.has_arms
    assert rig_info(replace(skeleton)) is not info, "another skeleton object has its own"


def test_rig_info_does_not_keep_its_skeleton_alive(words: dict[str, Clip]) -> None:
    skeleton = replace(words["SIGN"].skeleton)
    info = rig_info(skeleton)
    for part in PARTS:
        getattr(info, part)
    skeleton_ref, info_ref = weakref.ref(skeleton), weakref.ref(info)
    del info
    gc.collect()
    assert info_ref() is rig_info(skeleton), "kept while the skeleton lives"
    del skeleton
    gc.collect()
    assert skeleton_ref() is None
    assert info_ref() is None


def test_roles_named_by_the_user_are_those_of_the_rig_info() -> None:
    plain, _ = skeleton_of(*HIK)
    skeleton = replace(plain, roles={"jaw": "HeadTop_End"})
    assert rig_info(skeleton).roles.joint("jaw") == plain.index["HeadTop_End"]
    assert rig_info(plain).roles.joint("jaw") is None


def test_a_rig_without_known_arms_has_no_arm_joints() -> None:
    info = rig_info(Skeleton(("a", "b"), np.array([-1, 0]), np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]])))
    assert not info.has_arms
    for part in ("arm_joints", "canonical"):
        with pytest.raises(InputError, match="no leftUpperArm or leftLowerArm found among joints a, b"):
            getattr(info, part)
