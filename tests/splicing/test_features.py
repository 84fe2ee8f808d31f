"""What networks are shown: at any rate, of any rig, in the mirror, the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from other_rigs import mirror
from signing import word
from signsplice.motion import rotation
from signsplice.motion.clip import Clip, concatenate, resample
from signsplice.rig.canonical import FEATURE_FPS, apply_deltas, canonical_motion
from signsplice.rig.canonical_map import ROLES
from signsplice.splicing import features
from signsplice.splicing.gap import Gap
from signsplice.splicing.transition import find_transition

RNG = np.random.default_rng(7)


def test_six_numbers_come_back() -> None:
    turns = canonical_motion(word("BOOK").clip).quats
    matrices = rotation.to_matrix(turns)
    np.testing.assert_allclose(rotation.to_6d(turns), rotation.matrix_to_6d(matrices), atol=1e-15)
    np.testing.assert_allclose(rotation.matrix_from_6d(rotation.to_6d(turns)), matrices, atol=1e-9)
    np.testing.assert_allclose(rotation.matrix_from_6d(rotation.to_6d(turns) * 1.7), matrices, atol=1e-9)


def test_another_rate_shows_the_same_motion() -> None:
    clip = word("MOTHER").clip
    own = features.trajectory(canonical_motion(clip))
    assert len(own) == len(clip)
    np.testing.assert_array_equal(own.rotations_6d, rotation.to_6d(canonical_motion(clip).quats))
    for fps, tolerance in ((60.0, 1e-6), (24.0, 0.05), (100.0, 0.02)):
        other = features.trajectory(canonical_motion(resample(clip, fps)))
        n = min(len(own), len(other))
        assert abs(len(own) - len(other)) <= 1
        assert np.abs(other.rotations_6d[:n] - own.rotations_6d[:n]).max() < tolerance
        assert np.abs(other.positions[:n] - own.positions[:n]).max() < tolerance


def test_a_course_stays_where_it_ends() -> None:
    one = features.trajectory(canonical_motion(word("YES").clip), np.array([-1.0, 0.0, 99.0, 0.051]))
    whole = features.trajectory(canonical_motion(word("YES").clip))
    np.testing.assert_array_equal(one.rotations_6d[0], one.rotations_6d[1])
    np.testing.assert_allclose(one.rotations_6d[2], whole.rotations_6d[-1], atol=1e-9)
    columns = one.rotations_6d.reshape(4, -1, 2, 3)
    np.testing.assert_allclose(np.linalg.norm(columns, axis=-1), 1.0, atol=1e-9)
    np.testing.assert_allclose(np.sum(columns[:, :, 0] * columns[:, :, 1], axis=-1), 0.0, atol=1e-9)


def test_the_mirror_of_a_course_is_the_course_of_the_mirror() -> None:
    seen = canonical_motion(word("BOOK").clip)
    one, other = features.mirrored(features.trajectory(seen)), features.trajectory(seen.mirrored())
    np.testing.assert_allclose(one.rotations_6d, other.rotations_6d, atol=1e-12)
    np.testing.assert_allclose(one.positions, other.positions, atol=1e-12)
    again = features.mirrored(one)
    np.testing.assert_array_equal(again.rotations_6d, features.trajectory(seen).rotations_6d)
    strong = features.trajectory(canonical_motion(word("YES").clip))
    assert not features.left_hand_busier(strong)
    assert features.left_hand_busier(features.mirrored(strong))


def test_numbers_of_a_frame_and_their_rates() -> None:
    one = features.trajectory(canonical_motion(word("YES").clip))
    told = features.frame_features(one)
    assert told.shape == (len(one), features.N_FRAME)
    assert told.dtype == np.float32
    n = features.N_ROTATION + features.N_POSITION
    np.testing.assert_allclose(told[5, :n], np.r_[one.rotations_6d[5].ravel(), one.positions[5].ravel()], atol=1e-6)
    np.testing.assert_allclose(told[5, n:], (told[5, :n] - told[4, :n]) * FEATURE_FPS / 5.0, atol=1e-4)
    assert not told[0, n:].any()


def test_a_window_tells_where_every_frame_lies() -> None:
    whole = features.trajectory(canonical_motion(word("BOOK").clip), np.arange(16 + 5) / 30.0 + 0.3)
    real = np.arange(21) > 1
    told = features.gap_tokens(whole, 5, real, 0.25)
    assert told.shape == (21, features.N_TOKEN)
    n = features.N_FRAME
    own = features.frame_features(whole)
    np.testing.assert_array_equal(told[:, : n // 2], own[:, : n // 2])
    np.testing.assert_allclose(told[3, n // 2 : n], own[3, n // 2 :], atol=1e-6)
    np.testing.assert_allclose(told[10, n // 2 : n], own[10, n // 2 :] * (1 / 30) / (0.25 / 6), atol=1e-4)
    assert not told[7, n : 2 * n].any(), "seen from the last frame before"
    kind, flags = told[:, 2 * n : 2 * n + 3], told[:, 2 * n + 3 :]
    assert kind.argmax(axis=1).tolist() == [0] * 8 + [1] * 5 + [2] * 8
    assert flags[:, 0].tolist() == real.tolist()
    np.testing.assert_allclose(flags[7:14, 1], np.arange(7) / 6, atol=1e-6)
    np.testing.assert_allclose(flags[:, 3], 0.25)
    assert features.gap_frames(6 / 30) == 5


MATRIX = RNG.normal(0.0, 0.01, (features.N_TOKEN, len(ROLES) * 3))


def filled(before: Clip, after: Clip, n_frames: int) -> Clip:
    """A transition by a network that is one fixed matrix."""
    base = find_transition("hermite").between(Gap(before, after, n_frames))
    seen = features.gap_features(canonical_motion(concatenate([before, base, after])), len(before), n_frames)
    said = (seen.tokens[features.CONTEXT : features.CONTEXT + seen.n_gap] @ MATRIX).reshape(-1, len(ROLES), 3)
    turns = apply_deltas(base.skeleton, base.local_rotations, features.delta_rotvecs(said, seen, n_frames))
    return replace(base, local_rotations=turns)


def test_a_mirrored_seam_is_filled_by_the_mirrored_frames() -> None:
    before, after = word("MOTHER").clip[20:34], word("BOOK").clip[20:34]
    one, other = filled(before, after, 9), filled(mirror(before), mirror(after), 9)
    base = find_transition("hermite").between(Gap(before, after, 9))
    assert rotation.angle_between(one.local_rotations, base.local_rotations).max() > 0.05
    np.testing.assert_allclose(
        rotation.angle_between(mirror(one).local_rotations, other.local_rotations), 0.0, atol=1e-6
    )


def test_an_answer_counts_nothing_at_the_ends_and_less_in_short_gaps() -> None:
    share = np.array([0.0, 1e-3, 0.5, 1.0])
    moving = np.linspace(0.0, 1.0, len(ROLES))

    def weights(seconds: float) -> np.ndarray:
        return features.answer_weights(
            share, features.GapFeatures(np.zeros((0, 0), np.float32), 9, seconds, False, moving)
        )

    full = weights(0.6)
    np.testing.assert_allclose(full, np.outer([0.0, 16e-6 * (1.0 - 1e-3) ** 2, 1.0, 0.0], moving))
    np.testing.assert_allclose(weights(0.15), 0.125 * full)
    np.testing.assert_allclose(weights(1.4), full)


def test_a_hand_that_rests_counts_as_resting() -> None:
    one_handed = word("MOTHER").clip
    whole = features.trajectory(canonical_motion(one_handed), np.arange(20, 50) / 30.0)
    shares = features.motion_weights(whole, 1.0)
    arms = {side: shares[ROLES.index(f"{side}LowerArm")] for side in ("left", "right")}
    assert arms["left"] < 0.2 < 0.8 < arms["right"] <= 1.0
    assert shares[ROLES.index("chest")] == arms["right"]
    other = features.motion_weights(features.mirrored(whole), 1.0)
    assert other[ROLES.index("leftIndexDistal")] == arms["right"]
    assert features.motion_weights(whole, 1e9).max() < 1e-6


def test_a_seam_at_another_rate_is_filled_by_the_same_motion() -> None:
    before, after = word("MOTHER").clip[20:34], word("BOOK").clip[20:34]
    slow = filled(before, after, 9)
    fast = filled(resample(before, 60.0), resample(after, 60.0), 19)
    assert rotation.angle_between(fast.local_rotations[1::2], slow.local_rotations).max() < 0.02
    share, finer = np.arange(1, 10) / 10, np.arange(1, 28) / 28
    seen = features.GapFeatures(np.zeros((0, 0), np.float32), 9, 1 / 3, False, np.ones(len(ROLES)))
    wave = np.broadcast_to(np.sin(3.0 * share)[:, None, None], (9, len(ROLES), 3))
    found = features.delta_rotvecs(wave, seen, 27)[:, 0, 0] / features.answer_weights(finer, seen)[:, 0]
    assert np.abs(found - np.sin(3.0 * finer))[3:-3].max() < 0.005, "smooth between the moments that were looked at"


def test_ends_and_their_velocities_stay() -> None:
    before, after = word("MOTHER").clip[20:34], word("BOOK").clip[20:34]
    base = find_transition("hermite").between(Gap(before, after, 400))
    share = np.arange(1, 401) / 401
    seen = features.GapFeatures(np.zeros((0, 0), np.float32), 12, 0.8, False, np.ones(len(ROLES)))
    out = features.delta_rotvecs(np.ones((12, len(ROLES), 3)), seen, len(base))
    np.testing.assert_allclose(out[:, 0, 0], 16 * share**2 * (1 - share) ** 2, atol=1e-9)
    assert out[0].max() < 1e-3
    assert out.max() == pytest.approx(1.0, abs=1e-4)
