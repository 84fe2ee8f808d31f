"""What networks are shown: at any rate, of any rig, in the mirror, the same."""

from __future__ import annotations

import numpy as np

from signing import word
from signsplice.motion import features
from signsplice.motion.canonical import signing
from signsplice.motion.clip import resample

RNG = np.random.default_rng(7)


def test_six_numbers_come_back() -> None:
    turns = signing(word("BOOK").clip).turns
    np.testing.assert_allclose(features.from_6d(features.to_6d(turns)), turns, atol=1e-9)
    np.testing.assert_allclose(features.from_6d(features.to_6d(turns) * 1.7), turns, atol=1e-9)


def test_another_rate_shows_the_same_motion() -> None:
    clip = word("MOTHER").clip
    own = features.course(signing(clip))
    assert len(own) == len(clip)
    np.testing.assert_array_equal(features.from_6d(own.turns).shape, signing(clip).turns.shape)
    for fps, tolerance in ((60.0, 1e-6), (24.0, 0.05), (100.0, 0.02)):
        other = features.course(signing(resample(clip, fps)))
        n = min(len(own), len(other))
        assert abs(len(own) - len(other)) <= 1
        assert np.abs(other.turns[:n] - own.turns[:n]).max() < tolerance
        assert np.abs(other.places[:n] - own.places[:n]).max() < tolerance


def test_a_course_stays_where_it_ends() -> None:
    one = features.course(signing(word("YES").clip), np.array([-1.0, 0.0, 99.0, 0.051]))
    whole = features.course(signing(word("YES").clip))
    np.testing.assert_array_equal(one.turns[0], one.turns[1])
    np.testing.assert_allclose(one.turns[2], whole.turns[-1], atol=1e-9)
    columns = one.turns.reshape(4, -1, 2, 3)
    np.testing.assert_allclose(np.linalg.norm(columns, axis=-1), 1.0, atol=1e-9)
    np.testing.assert_allclose(np.sum(columns[:, :, 0] * columns[:, :, 1], axis=-1), 0.0, atol=1e-9)


def test_the_mirror_of_a_course_is_the_course_of_the_mirror() -> None:
    seen = signing(word("BOOK").clip)
    one, other = features.mirrored(features.course(seen)), features.course(seen.mirrored())
    np.testing.assert_allclose(one.turns, other.turns, atol=1e-12)
    np.testing.assert_allclose(one.places, other.places, atol=1e-12)
    again = features.mirrored(one)
    np.testing.assert_array_equal(again.turns, features.course(seen).turns)
    strong = features.course(signing(word("YES").clip))
    assert not features.busier_left(strong)
    assert features.busier_left(features.mirrored(strong))


def test_numbers_of_a_frame_and_their_rates() -> None:
    one = features.course(signing(word("YES").clip))
    told = features.frames(one)
    assert told.shape == (len(one), features.N_FRAME)
    assert told.dtype == np.float32
    n = features.N_TURNS + features.N_PLACES
    np.testing.assert_allclose(told[5, :n], np.r_[one.turns[5].ravel(), one.places[5].ravel()], atol=1e-6)
    np.testing.assert_allclose(told[5, n:], (told[5, :n] - told[4, :n]) * features.RATE / 5.0, atol=1e-4)
    assert not told[0, n:].any()
