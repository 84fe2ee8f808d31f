"""Realism of a corpus: its measures, against motions whose answer is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from signing import SIGNS, mirror
from signsplice.motion import Clip
from signsplice.rig.roles import FINGERS
from signsplice.signer import pose
from signsplice.signer.handshapes import HANDSHAPES
from signsplice.signer.locations import resting
from signsplice.signer.signer import STANDARD
from signsplice_workshop.corpora.pairs import Pairs
from signsplice_workshop.measure import corpus_realism
from signsplice_workshop.measure.corpus_realism import signer_motion
from signsplice_workshop.measure.hands import flexions
from signsplice_workshop.measure.measures import percentiles


@pytest.mark.parametrize("plane", [(0, 1), (1, 2)])
def test_an_ellipse_by_the_two_thirds_law_has_its_exponent(plane: tuple[int, int]) -> None:
    t = np.arange(400) / 100.0
    path = np.zeros((400, 3))
    path[:, plane[0]], path[:, plane[1]] = 0.20 * np.cos(2 * np.pi * t), 0.08 * np.sin(2 * np.pi * t)
    assert corpus_realism.power_law([path], 100.0) == pytest.approx(-1.0 / 3.0, abs=0.01)
    assert corpus_realism.power_law([path, path[:3]], 100.0) == pytest.approx(-1.0 / 3.0, abs=0.01), (
        "short ones are left out"
    )


def test_an_ellipse_at_constant_speed_has_exponent_zero() -> None:
    fine = np.linspace(0.0, 2.0 * np.pi, 20001)
    curve = np.stack([0.20 * np.cos(fine), 0.08 * np.sin(fine), np.zeros_like(fine)], axis=-1)
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=-1))])
    positions = np.stack([np.interp(np.linspace(0.0, length[-1], 300), length, x) for x in curve.T], axis=-1)
    assert corpus_realism.power_law([positions], 100.0) == pytest.approx(0.0, abs=0.01)


def test_the_jerk_of_a_cubic_is_its_third_derivative() -> None:
    t = np.arange(50) / 30.0
    path = np.stack([2.0 * t**3 / 6.0 - t**2, 3.0 * t**3 / 6.0 + t, np.full_like(t, 5.0)], axis=-1)
    assert corpus_realism.rms_jerk([path], 30.0) == pytest.approx(np.hypot(2.0, 3.0), rel=1e-9)
    still = np.zeros((50, 3))
    assert corpus_realism.rms_jerk([path, still], 30.0) == pytest.approx(np.sqrt(13.0 / 2.0), rel=1e-9)


def test_finger_bends_are_the_angles_that_were_set() -> None:
    state = np.array(resting(STANDARD))
    degrees = np.zeros(21)
    for n in range(4):
        degrees[4 * n + 2], degrees[4 * n + 3] = 20.0 + 10.0 * n, 5.0 + 6.0 * n
    degrees[19], degrees[20] = 33.0, 44.0
    state[pose.FINGERS], state[33:54] = np.deg2rad(degrees), 0.0
    bends = flexions(pose.clip(state[None], STANDARD, 30.0))
    assert set(bends) == {f"{finger} {n}" for finger in FINGERS for n in (1, 2, 3)}
    for n, finger in enumerate(("Index", "Middle", "Ring", "Little")):
        left, right = bends[f"{finger} 2"], bends[f"{finger} 3"]
        assert np.allclose(left, [0.0, 20.0 + 10.0 * n], atol=1e-4)
        assert np.allclose(right, [0.0, 5.0 + 6.0 * n], atol=1e-4)
    assert np.allclose(bends["Thumb 2"], [0.0, 33.0], atol=1e-4)
    assert np.allclose(bends["Thumb 3"], [0.0, 44.0], atol=1e-4)
    knuckle = np.rad2deg(np.arctan2(2.9, 8.5))
    assert np.allclose(bends["Index 1"], knuckle, atol=1e-4), "the palm's own angle, straight fingers"
    fist = state.copy()
    fist[pose.FINGERS] = HANDSHAPES["S"].angles
    assert flexions(pose.clip(fist[None], STANDARD, 30.0))["Middle 2"][1] == pytest.approx(104.0, abs=0.01)


def test_durations_are_counted_over_all_pairs(pairs: Pairs) -> None:
    transition, kept, alone, again = corpus_realism.durations(pairs)
    assert alone.ours == again.ours
    assert (alone.real[2], again.real[2]) == (720, 830)
    index = pairs.index[:25]
    assert transition.ours[2] == pytest.approx(np.median((index[:, 5] + 1) / 30.0 * 1e3))
    spans = [pairs.events(k).end - pairs.events(k).start + 1 for k in range(5)]
    assert alone.ours[2] == pytest.approx(np.median(spans) / 30.0 * 1e3)
    every = [
        index[5 * b + c, 2] - index[5 * a + b, 3] + 1 for a in range(5) for b in range(5) for c in range(5)
    ]  # words a b c: what b keeps
    assert kept.ours[2] == pytest.approx(np.median(every) / 30.0 * 1e3, abs=1e3 / 30.0)
    assert kept.ours[0] < alone.ours[2]


def test_wrist_motion_of_pairs_has_plausible_speeds(pairs: Pairs) -> None:
    motion = corpus_realism.wrist_motion(pairs)
    again = corpus_realism.wrist_motion(pairs)
    assert np.array_equal(motion.speed, again.speed)
    assert len(motion.peak) == len(motion.start) == len(motion.end) == 25
    assert len(motion.jump) == 50
    assert 0.5 < np.median(motion.peak) < 3.0
    assert (motion.detour >= 1.0 - 1e-6).all()
    means, peaks = corpus_realism.sentence_speeds(pairs, 10), corpus_realism.word_peak_speeds(pairs)
    assert (means.shape, peaks.shape) == ((10,), (5,))
    assert peaks.min() > means.max(), "hands rise from rest faster than they sign on average"
    names = [quantity.name for quantity in corpus_realism.motion_quantities(pairs, motion)]
    assert len(names) == len(set(names)) == 5


def test_a_left_handed_signers_strong_wrist_is_the_left_one(pairs: Pairs) -> None:
    """The corpus of a left-handed signer has the figures of its mirror image."""
    mirrored = _Mirrored(pairs)
    one, other = corpus_realism.wrist_motion(pairs), corpus_realism.wrist_motion(mirrored)
    assert np.allclose(one.peak, other.peak, atol=1e-4)
    assert np.allclose(corpus_realism.word_peak_speeds(pairs), corpus_realism.word_peak_speeds(mirrored), atol=1e-4)
    assert np.allclose(corpus_realism.measure_forming(pairs), corpus_realism.measure_forming(mirrored), atol=1e-4)
    ours, theirs = corpus_realism.signing_motion(pairs), corpus_realism.signing_motion(mirrored)
    assert np.allclose(ours.abduction_deg, theirs.abduction_deg, atol=1e-2)


class _Mirrored(Pairs):
    """A corpus as a left-handed signer would have made it."""

    def __init__(self, pairs: Pairs) -> None:
        super().__init__(pairs.folder)
        self.signers = tuple(replace(one, left_handed=True) for one in pairs.signers)

    def clip(self, number: int) -> Clip:
        return _mirrored(super().clip(number))

    def word_clip(self, number: int) -> Clip:
        return _mirrored(super().word_clip(number))


def _mirrored(clip: Clip) -> Clip:
    rotations, roots = mirror(clip)
    return replace(clip, local_rotations=rotations, root_positions=roots)


def test_a_captured_clip_is_measured_as_the_corpus_is(pairs: Pairs) -> None:
    """The corpus's own pair, taken for a capture, has the figures of its signer."""
    own = pairs.clip(0)
    rows = corpus_realism.compare_with_captures(pairs, {"a take": own})
    found = {row.name: row for row in rows if row.source.startswith("a take; n = ")}
    assert {"strong upper arm, rms", "strong wrist joint, rms", "bend of the strong wrist"} <= set(found)
    assert not any(name.startswith(("head", "neck", "lowest")) for name in found), "their motion has other reasons"
    n_moving = int(found["strong upper arm, rms"].source.rpartition(" ")[2])
    assert 20 < n_moving < len(own)
    assert found["wrist speed while moving"].real == percentiles(signer_motion([own], "right").speed)
    assert len(found) == len(rows)
    assert corpus_realism.compare_with_captures(pairs, {}) == []
    (apart,) = (row for row in corpus_realism.compare_hands(pairs, SIGNS, {}) if row.unit == "cm")
    assert (apart.source, apart.real) == ("range aimed at", (1.0, 3.0))
    assert 0.0 < apart.ours[2] < 6.0, "BOOK is symmetric"
    assert corpus_realism.compare_hands(pairs, {}, {"a take": own}) == []


def test_fingers_form_within_transitions(pairs: Pairs) -> None:
    forming = corpus_realism.measure_forming(pairs)
    assert len(forming) > 20
    assert ((forming > 0.0) & (forming < 1.0)).all()
