"""Numbers of a frame: any joints of any skeleton, in a cube, and back."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from signsplice.errors import InputError
from signsplice.motion import Clip, Skeleton, kinematics, rotation
from signsplice_workshop.corpora.number_space import NumberSpace, make_space, read_space

RNG = np.random.default_rng(3)
SKELETON = Skeleton(
    ("rig:Hips", "rig:Spine", "rig:Arm", "rig:Hand", "rig:Leg"),
    np.array([-1, 0, 1, 2, 0]),
    RNG.normal(0.0, 20.0, (5, 3)),
)
MIDDLE = (1.0, 85.0, -2.0)


def clip(skeleton: Skeleton = SKELETON) -> Clip:
    rotations = rotation.exp(RNG.normal(0.0, 0.4, (4, len(skeleton), 3)))
    return Clip(skeleton, rotations, RNG.normal(0.0, 5.0, (4, 3)), 30.0, "HOUSE")


def test_numbers_are_positions_in_the_cube_and_come_back() -> None:
    space, motion = make_space(SKELETON, MIDDLE, 221.0), clip()
    numbers = space.to_numbers(motion)
    assert numbers.shape == (4, space.n_numbers) == (4, 15)
    positions = kinematics.forward(motion)[1]
    np.testing.assert_allclose(space.to_positions(numbers), positions, atol=1e-12)
    np.testing.assert_allclose(numbers[2, 9:12] * 221.0 + MIDDLE, positions[2, 3])


def test_some_joints_keep_the_nearest_joint_above_them() -> None:
    space = make_space(SKELETON, MIDDLE, 200.0, joints=[3, 1])
    assert space.joints == ("rig:Hips", "rig:Spine", "rig:Hand")
    assert space.parents == (-1, 0, 1), "the arm between is left out"
    motion = clip()
    np.testing.assert_array_equal(
        space.to_numbers(motion),
        make_space(SKELETON, MIDDLE, 200.0).to_numbers(motion).reshape(4, 5, 3)[:, [0, 1, 3]].reshape(4, 9),
    )


def test_joints_are_found_by_name_in_any_order_and_with_any_prefix() -> None:
    space, motion = make_space(SKELETON, MIDDLE, 200.0), clip()
    bare = replace(SKELETON, names=tuple(name.removeprefix("rig:") for name in SKELETON.names))
    np.testing.assert_array_equal(space.to_numbers(replace(motion, skeleton=bare)), space.to_numbers(motion))
    order = [0, 4, 1, 2, 3]
    turned = Skeleton(tuple(SKELETON.names[k] for k in order), np.array([-1, 0, 0, 2, 3]), SKELETON.offsets[order])
    other = Clip(turned, motion.local_rotations[:, order], motion.root_positions, 30.0)
    np.testing.assert_allclose(space.to_numbers(other), space.to_numbers(motion), atol=1e-12)


def test_a_clip_without_a_joint_is_refused_by_name() -> None:
    handless = Skeleton(SKELETON.names[:3], SKELETON.parents[:3], SKELETON.offsets[:3])
    with pytest.raises(InputError, match=r"HOUSE: has no joint rig:Hand, rig:Leg; expected the 5 joints"):
        make_space(SKELETON, MIDDLE, 200.0).to_numbers(clip(handless))


def test_a_space_survives_json() -> None:
    space = make_space(SKELETON, MIDDLE, 221.5, joints=[0, 2])
    assert read_space(json.loads(json.dumps(space.as_json()))) == space


@pytest.mark.parametrize(
    "change",
    [
        {"joints": ["a", "a"]},
        {"joints": ["a", 3]},
        {"parents": [-1]},
        {"parents": [0, 0]},
        {"parents": [-1, 1]},
        {"parents": [-1, -1]},
        {"middle": [0.0, 1.0]},
        {"middle": [0.0, float("nan"), 0.0]},
        {"side": 0.0},
        {"side": "wide"},
        {"side": None},
    ],
)
def test_a_broken_space_is_refused(change: dict[str, Any]) -> None:
    row = {"joints": ["a", "b"], "parents": [-1, 0], "middle": [0.0, 1.0, 2.0], "side": 200.0}
    assert isinstance(read_space(row), NumberSpace)
    with pytest.raises(InputError, match=r"^space: "):
        read_space(row | change)
    with pytest.raises(InputError, match=r"^space: "):
        read_space([])
