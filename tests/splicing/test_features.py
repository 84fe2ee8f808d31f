"""splicing.features: one motion has the same features at any rate and in the mirror, and answers return to the clip."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from other_rigs import mirror
from signing import word
from signsplice.motion import Clip, concatenate, resample, rotation
from signsplice.rig.info import FEATURE_FPS, apply_deltas, canonical_motion
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
    one, other = features.mirror_trajectory(features.trajectory(seen)), features.trajectory(seen.mirror())
    np.testing.assert_allclose(one.rotations_6d, other.rotations_6d, atol=1e-12)
    np.testing.assert_allclose(one.positions, other.positions, atol=1e-12)
    twice = features.mirror_trajectory(one)
    np.testing.assert_array_equal(twice.rotations_6d, features.trajectory(seen).rotations_6d)


def test_the_busier_hand_is_found() -> None:
    right_handed = features.trajectory(canonical_motion(word("YES").clip))
    assert not features.left_hand_busier(right_handed)
    assert features.left_hand_busier(features.mirror_trajectory(right_handed))


def test_the_features_of_a_frame_are_values_and_their_rates() -> None:
    one = features.trajectory(canonical_motion(word("YES").clip))
    frames = features.frame_features(one)
    assert frames.shape == (len(one), features.N_FRAME)
    assert frames.dtype == np.float32
    n = features.N_ROTATION + features.N_POSITION
    np.testing.assert_allclose(frames[5, :n], np.r_[one.rotations_6d[5].ravel(), one.positions[5].ravel()], atol=1e-6)
    np.testing.assert_allclose(frames[5, n:], (frames[5, :n] - frames[4, :n]) * FEATURE_FPS / 5.0, atol=1e-4)
    assert not frames[0, n:].any()


def test_the_tokens_of_a_gap_have_where_every_moment_lies() -> None:
    motion = canonical_motion(word("BOOK").clip[9:28])  # 6 frames before the gap, 5 in it, 8 after it
    tokens = gap_features.gap_features(motion, 6, 5).tokens
    assert tokens.shape == (28, gap_features.N_TOKEN)
    n = features.N_FRAME
    times = np.concatenate([np.arange(-2, 6), 5 + 6 * np.arange(1, 13) / 13, np.arange(11, 19)]) / 30.0
    frames = features.frame_features(features.trajectory(motion, times), np.diff(times))
    np.testing.assert_allclose(tokens[:, :n], frames, atol=1e-5)
    np.testing.assert_allclose(tokens[10, n : 2 * n], tokens[10, :n] - tokens[7, :n], atol=1e-6)
    assert not tokens[7, n : 2 * n].any(), "relative to the last frame before"
    part, (real, t, _, seconds, _) = tokens[:, 2 * n : 2 * n + 3], tokens[:, 2 * n + 3 :].T
    assert part.argmax(axis=1).tolist() == [0] * 8 + [1] * 12 + [2] * 8
    assert real.tolist() == [False] * 2 + [True] * 26
    np.testing.assert_allclose(t[7:21], np.arange(14) / 13, atol=1e-6)
    np.testing.assert_allclose(seconds, 6 / 30)
    assert gap_features.gap_frames(6 / 30) == 5


N_ARM = int(gap_features.IS_ARM.sum())
MATRIX = RNG.normal(0.0, 0.01, (gap_features.N_TOKEN, N_ARM * 3))


def filled(before: Clip, after: Clip, n_frames: int) -> Clip:
    """A transition by a network that is one fixed matrix from three moments' tokens to its three terms."""
    base = find_transition("hermite").between(Gap(before, after, n_frames))
    seen = gap_features.gap_features(canonical_motion(concatenate([before, base, after])), len(before), n_frames)
    answer = (seen.tokens[[9, 13, 17]] @ MATRIX).reshape(gap_features.N_TERMS, N_ARM, 3)
    deltas = gap_features.delta_rotvecs(answer, seen, n_frames)
    return replace(base, local_rotations=apply_deltas(base.skeleton, base.local_rotations, deltas))


def paths_of(gloss: str) -> np.ndarray:
    """Path lengths (12,) of wrists and fingers in a second of a word."""
    whole = features.trajectory(canonical_motion(word(gloss).clip), np.arange(20, 50) / 30.0)
    return np.asarray(np.linalg.norm(np.diff(whole.positions, axis=0), axis=-1).sum(axis=0))


def test_a_mirrored_gap_is_filled_with_the_mirrored_frames() -> None:
    before, after = word("MOTHER").clip[20:34], word("BOOK").clip[20:34]
    one, other = filled(before, after, 9), filled(mirror(before), mirror(after), 9)
    base = find_transition("hermite").between(Gap(before, after, 9))
    assert rotation.angle_between(one.local_rotations, base.local_rotations).max() > 0.05
    np.testing.assert_allclose(
        rotation.angle_between(mirror(one).local_rotations, other.local_rotations), 0.0, atol=1e-6
    )


def test_answers_weigh_less_in_short_gaps_and_nothing_for_hands_at_rest() -> None:
    moving = np.full(12, 10.0)
    full, short, long = (gap_features.answer_weights(moving, seconds) for seconds in (0.6, 0.15, 1.4))
    np.testing.assert_allclose(full, np.ones(N_ARM))
    np.testing.assert_allclose(short, 0.125 * full)
    np.testing.assert_allclose(long, full)
    one_handed = gap_features.answer_weights(paths_of("MOTHER"), 0.6)
    left, right = one_handed[0], one_handed[-1]
    assert left < 0.2 < 0.8 < right <= 1.0
    mirrored = gap_features.answer_weights(np.roll(paths_of("MOTHER"), 6), 0.6)
    np.testing.assert_allclose(mirrored, one_handed[::-1])


def test_a_gap_at_another_rate_is_filled_with_the_same_motion() -> None:
    before, after = word("MOTHER").clip[20:34], word("BOOK").clip[20:34]
    slow = filled(before, after, 9)
    fast = filled(resample(before, 60.0), resample(after, 60.0), 19)
    assert rotation.angle_between(fast.local_rotations[1::2], slow.local_rotations).max() < 0.02


def test_end_poses_velocities_and_accelerations_do_not_change() -> None:
    seen = gap_features.GapFeatures(np.zeros((0, 0), np.float32), False, np.ones(N_ARM))
    out = gap_features.delta_rotvecs(np.ones((gap_features.N_TERMS, N_ARM, 3)), seen, 400)[:, gap_features.IS_ARM]
    t = np.arange(1, 401) / 401
    u = 2.0 * t - 1.0
    np.testing.assert_allclose(out[:, 0, 0], 64 * (t * (1 - t)) ** 3 * (1 + u + 1.5 * u**2 - 0.5), atol=1e-9)
    accelerations = np.diff(np.pad(out[:, 0, 0], 1), n=2)
    assert np.abs(accelerations[[0, -1]]).max() < 0.1 * np.abs(accelerations).max()
