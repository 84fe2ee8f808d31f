"""splicing.features: one motion has the same features at any rate and in the mirror, and answers return to the clip."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from other_rigs import mirror
from signing import word
from signsplice.motion import Clip, concatenate, resample, rotation
from signsplice.rig.info import FEATURE_FPS, ROLES, apply_deltas, canonical_motion
from signsplice.splicing import features
from signsplice.splicing import features as gap_features
from signsplice.splicing.contracts import Gap
from signsplice.splicing.curves import find_transition

RNG = np.random.default_rng(7)


def test_6d_rotations_convert_there_and_back() -> None:
    quats = canonical_motion(word("BOOK").clip).quats
    matrices = rotation.to_matrix(quats)
    np.testing.assert_allclose(rotation.to_6d(quats), rotation.matrix_to_6d(matrices), atol=1e-14)
    np.testing.assert_allclose(rotation.matrix_from_6d(rotation.to_6d(quats)), matrices, atol=1e-9)
    np.testing.assert_allclose(rotation.matrix_from_6d(rotation.to_6d(quats) * 1.7), matrices, atol=1e-9)


def test_a_clip_at_another_rate_has_the_same_trajectory() -> None:
    clip = word("MOTHER").clip
    expected = features.trajectory(canonical_motion(clip))
    assert len(expected) == len(clip)
    np.testing.assert_array_equal(expected.rotations_6d, rotation.to_6d(canonical_motion(clip).quats))
    for fps, tolerance in ((60.0, 1e-6), (24.0, 0.05), (100.0, 0.02)):
        other = features.trajectory(canonical_motion(resample(clip, fps)))
        n = min(len(expected), len(other))
        assert abs(len(expected) - len(other)) <= 1
        assert np.abs(other.rotations_6d[:n] - expected.rotations_6d[:n]).max() < tolerance
        assert np.abs(other.positions[:n] - expected.positions[:n]).max() < tolerance


def test_a_trajectory_stays_at_its_ends_and_at_unit_length() -> None:
    one = features.trajectory(canonical_motion(word("YES").clip), np.array([-1.0, 0.0, 99.0, 0.051]))
    whole = features.trajectory(canonical_motion(word("YES").clip))
    np.testing.assert_array_equal(one.rotations_6d[0], one.rotations_6d[1])
    np.testing.assert_allclose(one.rotations_6d[2], whole.rotations_6d[-1], atol=1e-9)
    columns = one.rotations_6d.reshape(4, -1, 2, 3)
    np.testing.assert_allclose(np.linalg.norm(columns, axis=-1), 1.0, atol=1e-9)
    np.testing.assert_allclose(np.sum(columns[:, :, 0] * columns[:, :, 1], axis=-1), 0.0, atol=1e-9)


def test_mirroring_and_making_trajectories_commute() -> None:
    seen = canonical_motion(word("BOOK").clip)
    one, other = features.mirrored(features.trajectory(seen)), features.trajectory(seen.mirrored())
    np.testing.assert_allclose(one.rotations_6d, other.rotations_6d, atol=1e-12)
    np.testing.assert_allclose(one.positions, other.positions, atol=1e-12)
    twice = features.mirrored(one)
    np.testing.assert_array_equal(twice.rotations_6d, features.trajectory(seen).rotations_6d)


def test_the_busier_hand_is_found() -> None:
    right_handed = features.trajectory(canonical_motion(word("YES").clip))
    assert not features.left_hand_busier(right_handed)
    assert features.left_hand_busier(features.mirrored(right_handed))


def test_the_features_of_a_frame_are_values_and_their_rates() -> None:
    one = features.trajectory(canonical_motion(word("YES").clip))
    frames = features.frame_features(one)
    assert frames.shape == (len(one), features.N_FRAME)
    assert frames.dtype == np.float32
    n = features.N_ROTATION + features.N_POSITION
    np.testing.assert_allclose(frames[5, :n], np.r_[one.rotations_6d[5].ravel(), one.positions[5].ravel()], atol=1e-6)
    np.testing.assert_allclose(frames[5, n:], (frames[5, :n] - frames[4, :n]) * FEATURE_FPS / 5.0, atol=1e-4)
    assert not frames[0, n:].any()


def test_the_tokens_of_a_gap_have_where_every_frame_lies() -> None:
    motion = canonical_motion(word("BOOK").clip[9:28])  # 6 frames before the gap, 5 in it, 8 after it
    tokens = gap_features.gap_features(motion, 6, 5).tokens
    assert tokens.shape == (21, gap_features.N_TOKEN)
    n = features.N_FRAME
    frames = features.frame_features(features.trajectory(motion, (np.arange(21) - 2) / 30.0))
    np.testing.assert_array_equal(tokens[:, :n], frames)
    np.testing.assert_allclose(tokens[10, n : 2 * n], frames[10] - frames[7], atol=1e-6)
    assert not tokens[7, n : 2 * n].any(), "relative to the last frame before"
    part, (real, t, _, seconds, _) = tokens[:, 2 * n : 2 * n + 3], tokens[:, 2 * n + 3 :].T
    assert part.argmax(axis=1).tolist() == [0] * 8 + [1] * 5 + [2] * 8
    assert real.tolist() == [False] * 2 + [True] * 19
    np.testing.assert_allclose(t[7:14], np.arange(7) / 6, atol=1e-6)
    np.testing.assert_allclose(seconds, 6 / 30)
    assert gap_features.gap_frames(6 / 30) == 5


MATRIX = RNG.normal(0.0, 0.01, (gap_features.N_TOKEN, len(ROLES) * 3))


def filled(before: Clip, after: Clip, n_frames: int) -> Clip:
    """A transition by a network that is one fixed matrix from tokens to rotation vectors."""
    base = find_transition("hermite").between(Gap(before, after, n_frames))
    seen = gap_features.gap_features(canonical_motion(concatenate([before, base, after])), len(before), n_frames)
    new = slice(gap_features.N_CONTEXT, gap_features.N_CONTEXT + seen.n_gap)
    answer = (seen.tokens[new] @ MATRIX).reshape(-1, len(ROLES), 3)
    deltas = gap_features.delta_rotvecs(answer, seen, n_frames)
    return replace(base, local_rotations=apply_deltas(base.skeleton, base.local_rotations, deltas))


def unseen_gap(n_gap: int, seconds: float, motion_weights: np.ndarray | None = None) -> gap_features.GapFeatures:
    """A gap without tokens, in which all roles move in full by default."""
    weights = np.ones(len(ROLES)) if motion_weights is None else motion_weights
    return gap_features.GapFeatures(np.zeros((0, 0), np.float32), n_gap, seconds, False, weights)


def test_a_mirrored_gap_is_filled_with_the_mirrored_frames() -> None:
    before, after = word("MOTHER").clip[20:34], word("BOOK").clip[20:34]
    one, other = filled(before, after, 9), filled(mirror(before), mirror(after), 9)
    base = find_transition("hermite").between(Gap(before, after, 9))
    assert rotation.angle_between(one.local_rotations, base.local_rotations).max() > 0.05
    np.testing.assert_allclose(
        rotation.angle_between(mirror(one).local_rotations, other.local_rotations), 0.0, atol=1e-6
    )


def test_answers_weigh_nothing_at_the_ends_and_less_in_short_gaps() -> None:
    t = np.array([0.0, 1e-3, 0.5, 1.0])
    moving = np.linspace(0.0, 1.0, len(ROLES))
    full, short, long = (gap_features.answer_weights(t, unseen_gap(9, seconds, moving)) for seconds in (0.6, 0.15, 1.4))
    np.testing.assert_allclose(full, np.outer([0.0, 16e-6 * (1.0 - 1e-3) ** 2, 1.0, 0.0], moving))
    np.testing.assert_allclose(short, 0.125 * full)
    np.testing.assert_allclose(long, full)


def test_a_hand_at_rest_has_a_small_motion_weight() -> None:
    one_handed = word("MOTHER").clip
    whole = features.trajectory(canonical_motion(one_handed), np.arange(20, 50) / 30.0)
    paths = np.linalg.norm(np.diff(whole.positions, axis=0), axis=-1).sum(axis=0)
    weights = gap_features.motion_weights(paths, 1.0)
    arms = {side: weights[ROLES.index(f"{side}LowerArm")] for side in ("left", "right")}
    assert arms["left"] < 0.2 < 0.8 < arms["right"] <= 1.0
    assert weights[ROLES.index("chest")] == arms["right"]
    other = gap_features.motion_weights(np.roll(paths, len(paths) // 2), 1.0)
    assert other[ROLES.index("leftIndexDistal")] == arms["right"]
    assert gap_features.motion_weights(paths, 1e9).max() < 1e-6


def test_a_gap_at_another_rate_is_filled_with_the_same_motion() -> None:
    before, after = word("MOTHER").clip[20:34], word("BOOK").clip[20:34]
    slow = filled(before, after, 9)
    fast = filled(resample(before, 60.0), resample(after, 60.0), 19)
    assert rotation.angle_between(fast.local_rotations[1::2], slow.local_rotations).max() < 0.02


def test_answers_are_interpolated_smoothly() -> None:
    t, finer = np.arange(1, 10) / 10, np.arange(1, 28) / 28
    seen = unseen_gap(9, 1 / 3)
    wave = np.broadcast_to(np.sin(3.0 * t)[:, None, None], (9, len(ROLES), 3))
    found = gap_features.delta_rotvecs(wave, seen, 27)[:, 0, 0] / gap_features.answer_weights(finer, seen)[:, 0]
    assert np.abs(found - np.sin(3.0 * finer))[3:-3].max() < 0.005


def test_end_poses_and_end_velocities_do_not_change() -> None:
    t = np.arange(1, 401) / 401
    out = gap_features.delta_rotvecs(np.ones((12, len(ROLES), 3)), unseen_gap(12, 0.8), len(t))
    np.testing.assert_allclose(out[:, 0, 0], 16 * t**2 * (1 - t) ** 2, atol=1e-9)
    assert out[0].max() < 1e-3
    assert out.max() == pytest.approx(1.0, abs=1e-4)
