"""body.arm_ik: wrists reach their targets, and hands, shoulders and bone lengths stay, on rigs of all kinds."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from conftest import random_clip

from other_rigs import on_other_rig, with_rest_pose
from signing import word
from signsplice.body.arm_ik import move_wrists
from signsplice.errors import InputError
from signsplice.motion import Clip, kinematics, rotation
from signsplice.rig.info import rig_info

OTHER_AXES = rotation.exp([0.4, -1.1, 0.8])
RIGS: dict[str, Callable[[Clip], Clip]] = {
    "the signer's own": lambda clip: clip,
    "other axes and unit": lambda clip: on_other_rig(clip, OTHER_AXES, 0.01),
    "another rest pose": lambda clip: with_rest_pose(
        clip, {"LeftArm": (0.0, 0.0, 1.2), "RightForeArm": (0.7, 0.0, 0.3)}
    ),
}


def smooth_moves(clip: Clip, size: float) -> np.ndarray:
    """Moves (T, 2, 3) of both wrists that change smoothly in time, at most ``size`` clip units an axis."""
    rng = np.random.default_rng(3)
    waves = np.sin(np.linspace(0.0, 6.0, len(clip))[:, None, None] * rng.uniform(0.5, 2.0, (2, 3)))
    return np.asarray(size * waves)


@pytest.mark.parametrize("rig", RIGS)
def test_wrists_reach_their_targets_and_hands_keep_their_rotation(rig: str) -> None:
    clip = RIGS[rig](word("HELLO").clip)
    joints = rig_info(clip.skeleton).arm_joints[:6]
    rotations, positions = kinematics.forward(clip, joints)
    arm = np.linalg.norm(np.diff(positions[0, :3], axis=0), axis=-1).sum()
    moves = smooth_moves(clip, 0.04 * arm)
    new_rotations, new_positions = kinematics.forward(move_wrists(clip, moves), joints)
    targets = positions[:, 2::3] + moves
    within_reach = np.linalg.norm(targets - positions[:, ::3], axis=-1) < 0.999 * arm
    assert within_reach.mean() > 0.8
    np.testing.assert_allclose(new_positions[:, 2::3][within_reach], targets[within_reach], atol=1e-9 * arm)
    np.testing.assert_allclose(new_positions[:, ::3], positions[:, ::3], atol=1e-12 * arm)
    np.testing.assert_allclose(new_rotations[:, 2::3], rotations[:, 2::3], atol=1e-9)


def test_only_the_arm_that_is_moved_changes() -> None:
    clip = word("DEAF").clip
    moves = smooth_moves(clip, 3.0)
    moves[:, 0] = 0.0
    moves[:5] = 0.0
    moved = move_wrists(clip, moves)
    changed = np.abs(moved.local_rotations - clip.local_rotations).max(axis=(0, 2)) > 1e-12
    assert {clip.skeleton.names[j].split(":")[-1] for j in np.flatnonzero(changed)} == {
        "RightArm",
        "RightForeArm",
        "RightHand",
    }
    np.testing.assert_array_equal(moved.local_rotations[:5], clip.local_rotations[:5])


def test_beyond_its_reach_an_arm_points_at_the_target() -> None:
    clip = word("HELLO").clip
    joints = rig_info(clip.skeleton).arm_joints[:3]
    moves = np.zeros((len(clip), 2, 3))
    moves[:, 0] = [500.0, 100.0, 0.0]
    _, before = kinematics.forward(clip, joints)
    _, after = kinematics.forward(move_wrists(clip, moves), joints)
    arm = np.linalg.norm(np.diff(before[0], axis=0), axis=-1).sum()
    stretched = after[:, 2] - after[:, 0]
    np.testing.assert_allclose(np.linalg.norm(stretched, axis=-1), 0.999 * arm, rtol=1e-6)
    target = before[:, 2] + moves[:, 0] - before[:, 0]
    cosine = (stretched * target).sum(-1) / np.linalg.norm(stretched, axis=-1) / np.linalg.norm(target, axis=-1)
    np.testing.assert_allclose(cosine, 1.0, atol=1e-9)


STRAIGHT = {"a T-pose": (0.0, 0.0, 0.0), "hanging": (0.0, 0.0, -1.5), "raised": (0.3, -0.4, 0.9)}


@pytest.mark.parametrize("pose", STRAIGHT)
def test_a_straight_arm_bends_as_elbows_do(pose: str) -> None:
    """A straight arm has no plane. The wrist still reaches its target, with the elbow behind, in both arms alike."""
    skeleton = word("HELLO").clip.skeleton
    local = np.tile(rotation.IDENTITY, (1, len(skeleton), 1))
    left, right = (skeleton.names.index(f"mixamorig:{side}Arm") for side in ("Left", "Right"))
    x, y, z = STRAIGHT[pose]
    local[0, left], local[0, right] = rotation.exp([x, y, z]), rotation.exp([x, -y, -z])
    rest = Clip(skeleton, local, np.zeros((1, 3)), 30.0)
    joints = rig_info(skeleton).arm_joints[:6]
    rotations, before = kinematics.forward(rest, joints)
    moves = np.stack([0.2 * (before[:, k] - before[:, k + 2]) for k in (0, 3)], axis=1)
    _, after = kinematics.forward(move_wrists(rest, moves), joints)
    np.testing.assert_allclose(after[:, 2::3], before[:, 2::3] + moves, atol=1e-6)
    np.testing.assert_allclose(after[:, :3] * [-1.0, 1.0, 1.0], after[:, 3:], atol=1e-6)
    for side, at in ((0, slice(0, 3)), (1, slice(3, 6))):
        shoulder, elbow, wrist = after[0, at]
        bend = elbow - 0.5 * (shoulder + wrist)
        forward = rotations[0, 3 * side] @ [0.0, 0.0, 1.0]
        assert bend @ forward < -0.9 * np.linalg.norm(bend), "the elbow goes backwards"


def test_a_rig_without_arms_is_refused() -> None:
    clip = random_clip(1)
    with pytest.raises(InputError, match="found among joints"):
        move_wrists(clip, np.ones((len(clip), 2, 3)))
