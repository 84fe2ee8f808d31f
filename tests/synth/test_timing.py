"""Traits of timing: each shows in what it is named for, and in nothing for a plain signer."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from signing import SIGNS, sign, signer_of, word, wrists
from signsplice.motion import FloatArray
from signsplice.signer import notation, planner, pose, timing, trajectory
from signsplice.signer.collisions import penetration
from signsplice.signer.planner import IsolatedWord, SegmentPlan
from signsplice.signer.signer import PLAIN, STANDARD, Manner, draw_signer
from signsplice.signer.trajectory import Knot, low_passed
from signsplice_workshop.corpora import pseudo, sentences, truth
from signsplice_workshop.measure.corpus_checks import over_limit

sys.path.insert(0, str(Path(__file__).parents[1] / "golden"))
import make_plain_words

GOLDEN = Path(__file__).parents[1] / "golden" / "plain_words.npz"
ALL = Manner(low_pass_frames=1.0, off_frame=1.0, tempo_spread=1.0, pass_difference=1.0, hesitation=1.0)
TAPS = """TAPS hands=one
  X  shape=5 at=chin by=thumb off=6 palm=in fingers=up-up-in
  M  off=0 times=3
  H
"""


def made(text: str, manner: Manner, take: int = 0) -> IsolatedWord:
    (one,) = notation.parse(text).values()
    return planner.synthesize_word(one, signer_of(None, manner), take)


def depth(one: IsolatedWord) -> FloatArray:
    """Depth (T,) of the deeper hand, cm."""
    return np.asarray(penetration(one.states, one.signer)[0].max(axis=1))


# --- plain


def test_a_plain_signer_moves_as_signers_did_before_they_had_a_manner() -> None:
    with np.load(GOLDEN) as golden:
        words = make_plain_words.words(lambda seed: replace(draw_signer(seed), manner=PLAIN))
        assert sorted(words) == sorted(golden.files)
        for name, array in words.items():
            assert np.allclose(array, golden[name], rtol=0.0, atol=1e-9), name


@pytest.mark.parametrize("trait", ["low_pass_frames", "off_frame", "tempo_spread", "pass_difference"])
def test_each_trait_alone_changes_a_word(trait: str) -> None:
    plain, other = made(TAPS, PLAIN), made(TAPS, Manner(**{trait: 1.0}))
    assert len(plain) != len(other) or np.abs(plain.states - other.states).max() > 0.1
    again = made(TAPS, Manner(**{trait: 1.0}))
    assert np.array_equal(other.states, again.states)


@pytest.mark.parametrize("gloss", ["MOTHER", "BOOK", "HOUSE", "PLEASE", "LEARN", "fs-A"])
def test_with_all_traits_of_timing_hands_stay_out_of_the_body_and_events_in_order(gloss: str) -> None:
    one = planner.synthesize_word(sign(gloss), signer_of(None, ALL))
    assert depth(one).max() < 0.35
    e = one.events
    assert 0 < e.up < e.start < e.end < e.down < len(one) - 1
    spans = [*([e.first] if e.first else []), *e.passes]
    assert all(e.start <= begin < stop <= e.end for begin, stop in spans)
    rest = np.linalg.norm(np.diff(wrists(one), axis=0), axis=-1)
    assert rest[: max(e.up - 2, 1)].max() < 0.12
    assert rest[e.down + 3 :].max(initial=0.0) < 0.12


# --- low pass


def test_smoothing_makes_jerk_less_and_keeps_the_ends() -> None:
    text = "WORD hands=one\n  H shape=B at=space palm=down fingers=fwd\n  M at=space-high\n  H\n"
    sharp, smooth = (made(text, Manner(low_pass_frames=x)) for x in (0.0, 1.5))
    jerk = [float(np.square(np.diff(one.states[:, :3], n=3, axis=0)).mean()) for one in (sharp, smooth)]
    assert jerk[1] < 0.5 * jerk[0]
    assert np.array_equal(sharp.states[[0, -1]], smooth.states[[0, -1]])
    assert sharp.events == smooth.events


@pytest.mark.parametrize("deviation", [0.5, 1.0, 2.5])
def test_smoothing_takes_no_hand_off_what_it_touches(deviation: float) -> None:
    one = made(TAPS, Manner(low_pass_frames=deviation))
    for _, stop in one.events.passes:
        assert abs(depth(one)[stop]) < 0.5
    for begin, _ in one.events.passes[1:]:
        assert depth(one)[begin] < -2.0, "and it still goes back between"


def test_a_gaussian_smooths_what_is_not_near_ends_or_touches() -> None:
    t = np.arange(60)
    wave = np.sin(2.0 * np.pi * t / 12.0)[:, None] * np.ones((1, pose.SIZE))
    smooth = low_passed(wave, 1.5)
    factor = np.exp(-2.0 * (np.pi * 1.5 / 12.0) ** 2)
    assert np.allclose(smooth[10:-10], factor * wave[10:-10], atol=0.01)
    kept = low_passed(wave, 1.5, touches=[27, 33])
    assert np.allclose(kept[[27, 33]], wave[[27, 33]], atol=1e-9)
    assert np.allclose(kept[:15], smooth[:15])


def test_smoothing_is_the_same_time_at_another_rate() -> None:
    slow, fast = (
        planner.synthesize_word(sign("MOTHER"), signer_of(None, Manner(low_pass_frames=1.0)), fps=f) for f in (30, 60)
    )
    plain = planner.synthesize_word(sign("MOTHER"), signer_of(None), fps=60)
    changed = np.abs(fast.states - plain.states)[:, :3].max()
    assert changed == pytest.approx(np.abs(slow.states - word("MOTHER").states)[:, :3].max(), rel=0.5)


# --- stops between frames


def test_a_trajectory_is_sampled_at_whole_frames_between_its_knots() -> None:
    a, b = np.zeros(pose.SIZE), np.ones(pose.SIZE)
    made_states = trajectory.through([Knot(0.25, a, True), Knot(10.75, b, True)])
    u = (np.arange(1, 11) - 0.25)[:, None] / 10.5
    assert np.allclose(made_states, 10 * u**3 - 15 * u**4 + 6 * u**5)


def test_stops_fall_between_frames_and_events_on_the_nearest() -> None:
    knots = [Knot(f, np.zeros(pose.SIZE), stop) for f, stop in ((0, True), (4, False), (8, True), (12, True))]
    signer = signer_of(None, Manner(off_frame=1.0))
    moved = [timing.between_frames(knots, [0, 8, 12], signer, "A", take) for take in range(40)]
    off = np.array([[knot.frame for knot in one] for one in moved]) - [0, 4, 8, 12]
    assert np.abs(off[:, [0, 2, 3]]).max() < 0.5
    assert off.std(axis=0)[[0, 2, 3]].min() > 0.2
    assert np.allclose(off[:, 1], 0.5 * (off[:, 0] + off[:, 2])), "what lies between moves in proportion"
    one = planner.synthesize_word(sign("MOTHER"), signer)
    assert one.events == word("MOTHER").events
    assert np.abs(one.states - word("MOTHER").states)[:, :3].max() > 0.3


# --- tempo


def test_signs_alone_last_as_long_as_those_of_asl_lex() -> None:
    """Medians and quartiles within 15 %, 5 and 95 % within 30 %, of a third of the everyday words."""
    signs = [one for one in SIGNS.values() if one.kind == "sign"][::3]
    signer = signer_of(None, ALL)
    seconds = []
    for one in signs:
        plan = SegmentPlan(one, signer, 30.0, np.random.default_rng(0), 0)
        seconds.append((plan.stop + 1) / 30.0)
    ratio = np.percentile(seconds, (5, 25, 50, 75, 95)) / [0.40, 0.63, 0.83, 1.03, 1.37]
    assert np.abs(ratio[1:4] - 1.0).max() < 0.15, ratio
    assert np.abs(ratio[[0, 4]] - 1.0).max() < 0.30, ratio
    assert min(seconds) > 0.33


def test_words_differ_in_tempo_for_every_signer_and_takes_a_little() -> None:
    manner = Manner(tempo_spread=1.0)
    one, other = (replace(draw_signer(seed), manner=manner) for seed in (1, 2))
    words = [sign(gloss) for gloss in ("MOTHER", "BOOK", "HELLO", "TREE", "LEARN", "YES", "NAME", "CAR")]
    tempos = np.log([[timing.tempo_of(w, s, t).movement for s in (one, other) for t in range(3)] for w in words])
    assert tempos.mean(axis=1).std() > 0.05, "between words"
    assert tempos.std(axis=1).max() < 0.045, "between takes and signers"
    assert timing.tempo_of(words[0], replace(one, manner=PLAIN), 0) == timing.Tempo()


# --- passes


def test_later_passes_are_smaller_and_touch_like_the_first() -> None:
    sizes, times = [], []
    for take in range(6):
        one = made(TAPS, Manner(pass_difference=1.0), take)
        assert len(one.events.passes) == 3
        off = one.states[:, 2]
        spans = [off[begin] - off[stop] for begin, stop in one.events.passes]
        first = one.events.passes[0]
        sizes += [span / spans[0] for span in spans[1:]]
        times += [(stop - begin) / (first[1] - first[0]) for begin, stop in one.events.passes[1:]]
        assert all(abs(depth(one)[stop]) < 0.5 for _, stop in one.events.passes)
    assert 0.5 < min(sizes) < 0.75
    assert 0.85 < max(sizes) < 1.15
    assert np.std(times) > 0.02
    assert 0.7 < min(times) <= max(times) < 1.3


def test_a_touch_at_the_start_of_a_repeated_movement_is_kept() -> None:
    text = TAPS.replace("off=6", "off=0").replace("M  off=0", "M  off=6")
    one = made(text, Manner(pass_difference=1.0))
    assert all(abs(depth(one)[begin]) < 0.5 for begin, _ in one.events.passes)
    far = [one.states[stop, 2] for _, stop in one.events.passes]
    assert min(far[1:]) < far[0] - 0.8, "it goes away less far"


def test_later_revolutions_of_a_circle_are_smaller() -> None:
    text = "TURNS hands=one\n  X shape=index at=space palm=in fingers=fwd-up\n  M path=circle:sagittal:6:3\n"
    plain, one = (made(text, Manner(pass_difference=x)) for x in (0.0, 1.0))
    heights = [[np.ptp(w.states[a : b + 1, 1]) for a, b in w.events.passes] for w in (plain, one)]
    assert len(heights[1]) == 3
    assert np.ptp(heights[0]) < 1.0
    assert min(heights[1][1:]) < 0.88 * heights[1][0]


# --- hesitation


def test_few_holds_are_longer_and_hands_drift_meanwhile() -> None:
    signer = signer_of(None, Manner(hesitation=1.0))
    pauses = [timing.hold_pause(signer, sign("MOTHER"), 0, n) for n in range(400)]
    long = [n for n, (pause, _) in enumerate(pauses) if pause]
    assert 10 < len(long) < 60
    assert all(0.15 <= pauses[n][0] <= 0.45 for n in long)
    text = "WORD hands=one\n  X shape=B at=space palm=down fingers=fwd\n  M at=space-high\n  H\n"
    words = [(made(text, Manner(hesitation=x), take)) for take in range(60) for x in (0.0, 1.0)]
    held = [(w.events.end - w.events.passes[-1][1]) for w in words]
    slow = [k for k in range(1, 120, 2) if held[k] > held[k - 1]]
    assert 1 <= len(slow) < 15
    one = words[slow[0]]
    path = one.states[one.events.passes[-1][1] : one.events.end + 1, :3]
    assert 0.1 < np.linalg.norm(path[-1] - path[0]) < 1.0, "cm"
    assert np.linalg.norm(np.diff(path, axis=0), axis=-1).max() < 0.25


def test_a_hesitating_reach_has_the_same_path_and_speed_at_its_ends() -> None:
    u = truth.compute_hesitating_times(9, 6)
    assert len(u) == 15
    assert (np.diff(u) > 0.0).all()
    assert u[0] == pytest.approx(0.1, rel=0.02)
    assert u[-1] == pytest.approx(0.9, rel=0.02)
    assert np.diff(u)[6:8].max() < 0.04, "slow half way"
    assert len(truth.compute_hesitating_times(3, 50)) <= 2 * 4


def test_sentences_hesitate_rarely_and_the_truth_of_a_pair_never() -> None:
    signer = signer_of(None, Manner(hesitation=1.0))
    words = [planner.synthesize_word(sign(gloss), signer) for gloss in ("MOTHER", "YES", "BOOK", "YOU")]
    seen, paused = 0, 0
    for k in range(24):
        order = np.random.default_rng(k).permutation(4)
        sentence = sentences.utter([words[n] for n in order])
        for part in sentence.stretches[1::2]:
            seen += 1
            if part.changed:
                assert part.changed == ("pause",)
                paused += 1
        exact = sentences.utter([words[n] for n in order], changes=False)
        for p, q, seam in zip(exact.words[:-1], exact.words[1:], exact.seams, strict=True):
            assert len(seam.states) == len(truth.splice(p, q).states)
    assert 1 <= paused < 0.25 * seen


def test_stuck_hands_are_pushed_on() -> None:
    """A hand that passes the nose on a smoothed path: it was left 20 mm deep in the head."""
    one = planner.synthesize_word(sign("LEARN"), replace(STANDARD, manner=Manner(low_pass_frames=1.0)))
    assert depth(one).max() < 0.35


@pytest.mark.parametrize("trait", ["off_frame", "pass_difference", "tempo_spread"])
def test_splines_through_uneven_knots_keep_fingers_within_their_limits(trait: str) -> None:
    one = planner.synthesize_word(pseudo.draw_sign(11), signer_of(None, Manner(**{trait: 1.0})))
    assert over_limit(one.clip.local_rotations) == 0.0


@pytest.mark.parametrize("turns", ["4", "6"])
def test_short_uneven_revolutions_have_knots_in_order(turns: str) -> None:
    text = f"TURNS hands=one\n  X shape=index at=space palm=in fingers=fwd-up\n  M path=circle:sagittal:1:{turns}\n"
    for take in range(3):
        (one,) = notation.parse(text).values()
        plan = SegmentPlan(one, signer_of(None, ALL), 30.0, np.random.default_rng(0), take)
        assert (np.diff([knot.frame for knot in plan.knots]) > 0.3).all()
