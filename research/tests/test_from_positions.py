"""systems.from_positions: joint positions back to rotations."""

import numpy as np
import pytest
from conftest import random_clip

from signsplice.errors import InputError
from signsplice.motion import Clip, Skeleton, kinematics, rotation
from signsplice.splicing.from_positions import HandFit, rotations_from_positions


def test_rotations_from_positions_reproduce_the_positions(words: dict[str, Clip]) -> None:
    for clip in (*(random_clip(seed) for seed in range(4)), words["SIGN"]):
        positions = kinematics.forward(clip)[1]
        local = rotations_from_positions(clip.skeleton, positions)
        again = Clip(clip.skeleton, local, positions[:, 0], clip.fps)
        size = np.abs(clip.skeleton.offsets).max()
        assert np.allclose(kinematics.forward(again)[1], positions, atol=1e-6 * size)


def test_rotations_from_positions_keep_bone_lengths() -> None:
    clip = random_clip(1)
    stretched = kinematics.forward(clip)[1] * 1.3
    local = rotations_from_positions(clip.skeleton, stretched)
    again = kinematics.forward(Clip(clip.skeleton, local, stretched[:, 0], clip.fps))[1]
    lengths = np.linalg.norm(again[:, 1:] - again[:, clip.skeleton.parents[1:]], axis=-1)
    assert np.allclose(lengths, np.linalg.norm(clip.skeleton.offsets[1:], axis=-1))


def test_twist_comes_from_the_poses_before_and_after(words: dict[str, Clip]) -> None:
    """The twist of every joint goes from that of the pose before to that of the pose after without a jump."""
    clip = words["HELLO"]
    start, stop = 15, 27
    positions = kinematics.forward(clip)[1][start:stop]
    q = clip.local_rotations
    local = rotations_from_positions(clip.skeleton, positions, before=q[start - 1], after=q[stop])
    joined = np.concatenate([q[start - 1 : start], local, q[stop : stop + 1]])
    steps = np.rad2deg(rotation.angle_between(joined[:-1], joined[1:]))
    original_steps = np.rad2deg(rotation.angle_between(q[start - 2 : stop], q[start - 1 : stop + 1]))
    assert steps.max() < original_steps.max() + 8.0
    assert np.rad2deg(rotation.angle_between(local, q[start:stop])).max() < 25.0


def test_a_single_bone_gets_no_twist() -> None:
    skeleton = Skeleton(("a", "b"), np.array([-1, 0]), np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))
    angle = np.linspace(0.0, 1.0, 30)
    positions = np.zeros((30, 2, 3))
    positions[:, 1] = np.stack([np.sin(angle), np.cos(angle), np.zeros(30)], axis=-1)
    local = rotations_from_positions(skeleton, positions)
    assert np.allclose(rotation.log(local[:, 0]), np.stack([0 * angle, 0 * angle, -angle], axis=-1), atol=1e-9)


def test_positions_of_the_wrong_shape_are_refused() -> None:
    clip = random_clip(0)
    with pytest.raises(InputError, match="positions"):
        rotations_from_positions(clip.skeleton, np.zeros((4, 3, 3)))


def test_joints_whose_positions_are_not_given_follow_the_poses_on_either_side() -> None:
    """a - b - c - d along a line, where b holds still at an angle and is not given."""
    offsets = np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.2, 1.0, 0.0], [0.0, 0.7, 0.3]])
    skeleton = Skeleton(("a", "b", "c", "d"), np.array([-1, 0, 1, 2]), offsets)
    turns = np.cumsum(np.random.default_rng(5).normal(0.0, 0.1, (9, 4, 3)), axis=0)
    turns[:, 1] = (0.4, 0.0, -0.2)
    clip = Clip(skeleton, rotation.exp(turns), np.zeros((9, 3)), 30.0)
    wanted = kinematics.forward(clip)[1]
    local = rotations_from_positions(
        skeleton, wanted[1:8][:, [0, 2, 3]], clip.local_rotations[0], clip.local_rotations[8], joints=[0, 2, 3]
    )
    made = Clip(skeleton, local, np.zeros((7, 3)), 30.0)
    assert np.allclose(kinematics.forward(made)[1][:, 2:], wanted[1:8, 2:], atol=1e-9)
    assert np.allclose(np.abs(np.sum(local[:, 1] * clip.local_rotations[0, 1], axis=-1)), 1.0)


def test_fitted_hands_turn_no_finger_over_for_errors_of_centimetres(words: dict[str, Clip]) -> None:
    """Errors as large as a finger's bone turn its direction anywhere; hands fitted to the word do not follow."""
    clip = words["HELLO"]
    joints = list(range(len(clip.skeleton)))
    start, stop = 15, 27
    true = clip.local_rotations[start:stop]
    exact = kinematics.forward(clip)[1][start:stop]
    noisy = exact + np.random.default_rng(0).normal(0.0, 2.0, exact.shape)
    before, after = clip.local_rotations[start - 1], clip.local_rotations[stop]
    fit = HandFit([clip], joints)

    def angles_between_frames(local: np.ndarray) -> np.ndarray:
        joined = np.concatenate([before[None], local, after[None]])
        return np.asarray(np.rad2deg(rotation.angle_between(joined[:-1], joined[1:])))

    hands = [joint for joint, name in enumerate(clip.skeleton.names) if "Hand" in name]
    raw = rotations_from_positions(clip.skeleton, noisy, before, after)
    whole = fit.apply(raw, noisy, before, after)
    assert angles_between_frames(raw)[:, hands].max() > 60.0
    assert angles_between_frames(whole)[:, hands].max() < 40.0
    others = [joint for joint in joints if joint not in hands]
    assert np.allclose(np.abs((whole * raw).sum(-1))[:, others], 1.0)
    known = fit.apply(rotations_from_positions(clip.skeleton, exact, before, after), exact, before, after)
    assert np.rad2deg(rotation.angle_between(known, true))[:, hands].mean() < 8.0
