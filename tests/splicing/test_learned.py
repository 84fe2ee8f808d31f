"""splicing.learned: the same cuts, durations and frames on every rig, for both hands and at any rate.

The bundle has random weights (tests/golden/make_tiny_bundle.py): what its networks answer is arbitrary, but must be the
same for one motion.
"""

from __future__ import annotations

import itertools
import json
import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import GOLDEN

import signsplice as ss
from other_rigs import mirror, on_other_rig
from signing import sign, word
from signsplice.errors import InputError
from signsplice.lexicon import open_shipped_lexicon
from signsplice.motion import Clip, Skeleton, concatenate, kinematics, resample, rotation
from signsplice.rig.info import canonical_motion, rig_info
from signsplice.rig.roles import ARM
from signsplice.signer import planner
from signsplice.signer.signer import RESTS, STANDARD
from signsplice.splicing.bundle import WEIGHTS, Array, Sessions
from signsplice.splicing.contracts import Cut, Gap, gap_at
from signsplice.splicing.curves import find_transition
from signsplice.splicing.learned import (
    REST_FRAMES,
    LearnedCutter,
    LearnedTransition,
    WordReader,
    open_sessions,
)
from signsplice.splicing.sentence import Sentence
from signsplice_workshop.corpora.rekeying import rekey_clip

TINY = GOLDEN / "tiny_bundle"
SESSIONS = open_sessions(TINY)
READER = WordReader(SESSIONS)
CUTTER = LearnedCutter(READER, whole=False)
TRANSITION = LearnedTransition(SESSIONS)
P, Q = word("MOTHER").clip, word("BOOK").clip


def other_rig(clip: Clip) -> Clip:
    """The clip on a rig with other axes, in metres."""
    return on_other_rig(clip, rotation.exp([0.4, -1.1, 2.0]), 0.01)


@pytest.mark.slow
@pytest.mark.parametrize("cutter", ["learned", "learned-fluent"])
def test_a_stream_which_sees_two_words_at_a_time_cuts_as_a_splice_does(cutter: str) -> None:
    """In 200 sentences of 3 to 12 words: the same frames of each word, and the same bits between them."""
    lexicon, options, rng = open_shipped_lexicon(), ss.SpliceOptions(cutter=cutter), np.random.default_rng(18)
    glosses = [gloss for gloss in lexicon.glosses if not gloss.startswith("fs-")]
    for _ in range(200):
        chosen = rng.choice(len(glosses), int(rng.integers(3, 13)), replace=False)
        words = [lexicon.clip(glosses[k]) for k in chosen]
        together, pieces = ss.splice(words, options), list(ss.stream(words, options))
        assert [piece.span for piece in pieces] == list(together.spans)
        streamed = np.concatenate([piece.clip.local_rotations for piece in pieces])
        np.testing.assert_array_equal(streamed, together.clip.local_rotations)


def test_every_rig_hand_and_rate_has_the_same_cut() -> None:
    expected = CUTTER.cut_all([P, Q])[0]
    assert 0 <= expected.pre < len(P)
    assert 0 <= expected.post < len(Q)
    assert CUTTER.cut_all([other_rig(P), other_rig(Q)])[0] == expected
    assert CUTTER.cut_all([mirror(P), mirror(Q)])[0] == expected
    fast = CUTTER.cut_all([resample(P, 60.0), resample(Q, 60.0)])[0]
    assert max(abs(fast.pre - 2 * expected.pre), abs(fast.post - 2 * expected.post)) <= 1


def test_where_a_word_is_left_depends_on_the_next_word() -> None:
    pairs = ((P, Q), (P, word("SEE").clip))
    seam, other = (CUTTER.scores(*CUTTER.reader.pair(*pair)) for pair in pairs)
    (start, stop), (begin, end) = (canonical_motion(clip).active_span for clip in (P, Q))
    assert seam.scores.shape == (stop - start, end - begin), "while the arms are away from rest"
    assert (seam.leaves_from, seam.enters_from) == (start, begin)
    assert np.exp(seam.scores).sum() == pytest.approx(1.0), "log-probabilities of both frames"
    leaving, instead = (np.exp(one.scores).sum(axis=1) for one in (seam, other))
    assert np.abs(leaving - instead).max() > 1e-7
    best = CUTTER.cut_all([P, Q])[0]
    assert seam.scores[best.pre - start, best.post - begin] == seam.scores.max()


def test_of_long_words_only_the_inner_ends_are_read() -> None:
    long = concatenate([P, P, P])
    before, after = READER.pair(long, long)
    assert (before.first, after.first) == (len(long) - 150, 0)
    assert len(before.features) == len(after.features) == 150
    assert CUTTER.cut_all([long, Q])[0].pre >= len(long) - 150
    assert CUTTER.cut_all([Q, long])[0].post < 150


@pytest.mark.parametrize("rest", RESTS)
def test_the_length_of_the_rests_of_a_word_does_not_matter(rest: str) -> None:
    """Words of a signer who stands still for ten seconds before and after every sign."""
    n_rest = 300
    signer = replace(STANDARD, rest=rest)
    words = [planner.synthesize_word(sign(gloss), signer).clip for gloss in ("MOTHER", "BOOK")]
    clips, longer = (
        [concatenate([clip[:1]] * n + [clip] + [clip[-1:]] * n) for clip in words] for n in (n_rest, n_rest + 1)
    )
    for whole in (False, True):
        cutter = LearnedCutter(READER, whole)
        cut, again = cutter.cut_all(clips)[0], cutter.cut_all(longer)[0]
        for frame, clip in zip((cut.pre, cut.post), words, strict=True):
            assert n_rest - REST_FRAMES <= frame < n_rest + len(clip) + REST_FRAMES, "near the sign"
        assert (again.pre, again.post) == (cut.pre + 1, cut.post + 1)
    for reading, clip in zip(READER.pair(*clips), words, strict=True):
        assert len(reading.features) <= len(clip) + 2 * REST_FRAMES


@pytest.mark.parametrize("fps", [24.0, 29.97, 30.0, 60.0])
def test_words_are_cut_while_their_arms_are_away_from_rest(fps: float) -> None:
    clips = [resample(word(gloss).clip, fps) for gloss in ("NIGHT", "YOU", "BOOK")]
    reader = WordReader(open_sessions(WEIGHTS))
    cuts = LearnedCutter(reader).cut_all(clips)
    for (before, after), cut in zip(itertools.pairwise(clips), cuts, strict=True):
        start, stop = canonical_motion(before).active_span
        begin, end = canonical_motion(after).active_span
        assert start <= cut.pre < stop
        assert begin <= cut.post < end
    for clip in clips:
        (reading, _), (start, stop) = reader.pair(clip, clip), canonical_motion(clip).active_span
        first, last = (reading.first + frame for frame in (reading.active[0], reading.active[1] - 1))
        assert start <= round(first / 30.0 * fps) < start + 2
        assert stop - 2 <= round(last / 30.0 * fps) + (fps > 30.0) < stop + (fps > 30.0)


class Counting(Sessions):
    """The tiny bundle's networks, with the names of those that were run, and how many rows each was given."""

    def __init__(self) -> None:
        super().__init__(SESSIONS.folder, SESSIONS.config)
        self.runs: list[tuple[str, int]] = []

    def run(self, name: str, inputs: Mapping[str, Array], **shapes: tuple[int | None, ...]) -> dict[str, Array]:
        self.runs.append((name, len(next(iter(inputs.values())))))
        return super().run(name, inputs, **shapes)


def test_a_word_is_read_once_for_all_its_seams() -> None:
    sessions = Counting()
    reader = WordReader(sessions)
    words = [P[:], Q[:], word("SEE").clip[:]]
    ss.splice([*words, *words], ss.SpliceOptions(cutter=LearnedCutter(reader)))
    runs = [name for name, _ in sessions.runs]
    assert runs.count("cut") == 3, "once a word, wherever it stands"
    assert runs.count("word") <= 6, "each of three words, as it is and at most once more in the mirror"


def test_a_word_is_cut_alike_whatever_stands_beside_it() -> None:
    """The neighbours sign with the right hand, with the left, with both, and one goes on for longer than the word."""
    cutter = LearnedCutter(WordReader(open_sessions(WEIGHTS)))
    neighbours = [Q, mirror(Q), mirror(P), word("SEE").clip, concatenate([mirror(P)] * 3)]
    for clip in (P, Q, mirror(P)):
        cuts = [cutter.cut_all([before, clip, after]) for before in neighbours for after in neighbours]
        assert len({(entering.post, leaving.pre) for entering, leaving in cuts}) == 1


def test_a_word_is_read_by_its_own_busier_hand() -> None:
    for clip in (P, Q):
        for own, seen in zip(READER.alone(clip), READER.alone(mirror(clip)), strict=True):
            np.testing.assert_allclose(own.features, seen.features, atol=1e-5)
            assert (own.stroke, own.active) == (seen.stroke, seen.active)


def test_all_cuts_of_a_sentence_are_chosen_together() -> None:
    clips = [P, Q, word("SEE").clip, P]
    result = ss.splice(clips, ss.SpliceOptions(cutter=CUTTER, transition="hermite"))
    cuts = CUTTER.cut_all(clips)
    kept = [after.pre - before.post for before, after in itertools.pairwise(cuts)]
    assert [(seam.pre_frame, seam.post_frame) for seam in result.seams] == [(cut.pre, cut.post) for cut in cuts]
    assert min(kept) > 0, "a word is left after it is entered"


def test_a_learned_transition_changes_the_curve_but_not_its_ends() -> None:
    before, after = P[:40], Q[22:]
    gap = Gap(before, after, 40)
    base, made = find_transition("hermite").between(gap), TRANSITION.fill([gap])[0]
    change = rotation.angle_between(made.local_rotations, base.local_rotations).max(axis=1)
    assert change[15:25].max() > 0.02
    assert change[[0, -1]].max() < 0.02 * change.max(), "end velocities are the curve's"
    np.testing.assert_array_equal(made.root_positions, base.root_positions)
    bones = np.linalg.norm(np.diff(kinematics.forward(made)[1][:, [8, 9]], axis=1), axis=-1)
    assert np.ptp(bones) < 1e-6


def test_the_network_corrects_the_arms_alone() -> None:
    """Fingers, trunk, neck and head follow the curve; the wrists do not jump."""
    gap = Gap(P[:40], Q[22:], 20)
    base, made = find_transition("hermite").between(gap), TRANSITION.fill([gap])[0]
    change = rotation.angle_between(made.local_rotations, base.local_rotations).max(axis=0)
    joints = rig_info(made.skeleton).roles.joints
    arms = [joint for role, joint in joints.items() if role.endswith(ARM)]
    assert change[arms].min() > 1e-3
    assert np.delete(change, arms).max() < 1e-6
    wrists = [joints["leftHand"], joints["rightHand"]]
    away = np.linalg.norm(np.subtract(*(kinematics.forward(clip, wrists)[1] for clip in (made, base))), axis=-1)
    assert away[[0, -1]].max() < 0.06 * away.max(), "next to both signs the wrists are where the curve has them"


def test_beside_a_word_drawn_between_keys_the_curve_stays() -> None:
    drawn = rekey_clip(P, 4, "unity")
    curve = find_transition("hermite")
    for before, after in ((drawn, Q), (Q, drawn)):
        gap = gap_at(before, after, Cut(39, 22), 9)
        assert gap.keyed
        np.testing.assert_array_equal(TRANSITION.between(gap).local_rotations, curve.between(gap).local_rotations)
        bent = TRANSITION.between(replace(gap, keyed=False))
        assert np.abs(bent.local_rotations - curve.between(gap).local_rotations).max() > 1e-4
    assert gap_at(P, Q, Cut(39, 22), 9).keyed is False


def test_the_recorded_word_is_judged_not_the_one_at_another_rate_or_tempo() -> None:
    drawn = rekey_clip(P, 5, "maya-auto")
    sentence = Sentence(ss.SpliceOptions(fps=47.0, tempo="natural"))
    words, seams = sentence.plan([drawn, Q])
    assert [word.keyed for word in words] == [True, False]
    assert seams[0].gap.keyed


def test_gaps_filled_together_are_filled_as_each_alone() -> None:
    gaps = [Gap(P[:40], Q[22:], n) for n in (7, 1, 12, 30, 7, 90)]
    for one, gap in zip(TRANSITION.fill(gaps), gaps, strict=True):
        alone = TRANSITION.fill([gap])[0]
        assert len(one) == gap.n_frames
        np.testing.assert_array_equal(one.local_rotations, alone.local_rotations)
    assert TRANSITION.fill([]) == []


@pytest.mark.parametrize("line", ["BUY MAKE SMELL NO CHEESE WALK", "REMEMBER NIGHT COME FOX"])
def test_a_stream_and_a_splice_give_the_same_frames_where_they_cut_alike(line: str) -> None:
    lexicon = open_shipped_lexicon()
    words = [lexicon.clip(gloss) for gloss in line.split()]
    together, pieces = ss.splice(words), list(ss.stream(words))
    assert [piece.span for piece in pieces] == list(together.spans)
    streamed = np.concatenate([piece.clip.local_rotations for piece in pieces])
    np.testing.assert_array_equal(streamed, together.clip.local_rotations)


def test_every_rig_hand_and_rate_has_the_same_transition() -> None:
    before, after = P[:40], Q[22:]
    expected = TRANSITION.fill([Gap(before, after, 9)])[0]
    other = TRANSITION.fill([Gap(other_rig(before), other_rig(after), 9)])[0]
    assert rotation.angle_between(other.local_rotations, other_rig(expected).local_rotations).max() < 1e-3
    flipped = mirror(TRANSITION.fill([Gap(mirror(before), mirror(after), 9)])[0])
    assert rotation.angle_between(flipped.local_rotations, expected.local_rotations).max() < 1e-3
    fast = TRANSITION.fill([Gap(resample(before, 60.0), resample(after, 60.0), 19)])[0]
    assert rotation.angle_between(fast.local_rotations[1::2], expected.local_rotations).max() < 0.03


@pytest.mark.parametrize("n_frames", [1, 46, 90])
def test_gaps_that_are_too_short_or_too_long_follow_the_curve(n_frames: int) -> None:
    gap = Gap(P[:40], Q[22:], n_frames)
    made, base = TRANSITION.fill([gap])[0], find_transition("hermite").between(gap)
    np.testing.assert_array_equal(made.local_rotations, base.local_rotations)


def test_clips_of_one_or_two_frames_are_enough() -> None:
    made = TRANSITION.fill([Gap(P[40:41], Q[22:23], 6)])[0]
    assert len(made) == 6
    assert CUTTER.cut_all([P[:1], Q[:2]])[0].pre == 0
    assert np.isfinite(concatenate([P[40:41], made, Q[22:23]]).local_rotations).all()


def test_a_sentence_is_cut_and_filled_by_networks() -> None:
    options = ss.SpliceOptions(cutter=CUTTER, transition=TRANSITION)
    result = ss.splice([P, Q, word("YES").clip], options)
    assert (result.cutter, result.transition) == ("learned-fluent", "learned")
    again = ss.splice([P, Q, word("YES").clip], options)
    np.testing.assert_array_equal(result.clip.local_rotations, again.clip.local_rotations)


def test_bundles_of_other_systems_old_and_broken_ones_are_refused(tmp_path: Path) -> None:
    shutil.copytree(TINY, tmp_path / "b")
    file = tmp_path / "b" / "bundle.json"
    stored = json.loads(file.read_text())
    (tmp_path / "b" / "cut.onnx").write_bytes(b"x")
    with pytest.raises(InputError, match=r"cut.onnx: is not the file that bundle.json lists"):
        LearnedCutter(WordReader(open_sessions(tmp_path / "b"))).cut_all([P, Q])[0]
    for changed, expected in (
        ({"system": "lpt"}, "is a bundle of 'lpt'"),
        ({"features": 0}, "was made for features 0"),
    ):
        file.write_text(json.dumps(stored | changed))
        with pytest.raises(InputError, match=expected):
            open_sessions(tmp_path / "b")


def test_a_rig_without_known_arms_is_not_cut() -> None:
    skeleton = Skeleton(("a", "b"), np.array([-1, 0]), np.array([[0.0, 0, 0], [0, 1, 0]]))
    clip = Clip(skeleton, np.tile([0.0, 0, 0, 1], (5, 2, 1)), np.zeros((5, 3)), 30.0)
    with pytest.raises(InputError, match="no leftUpperArm or leftLowerArm found among joints a, b"):
        CUTTER.cut_all([clip, replace(clip, name="other")])[0]


class TruePhases(Sessions):
    """The tiny bundle's networks, but with the true phases of P and Q as their answer: stroke and rest."""

    def run(self, name: str, inputs: Mapping[str, Array], **shapes: tuple[int | None, ...]) -> dict[str, Array]:
        outputs = super().run(name, inputs, **shapes)
        if name == "word":
            frames = np.arange(inputs["tokens"].shape[1])
            events = word("MOTHER" if len(frames) == len(P) else "BOOK").events
            phases = np.where((frames >= events.start) & (frames <= events.end), 3, 0)
            outputs["phases"] = 20.0 * np.eye(5)[phases][None]
        return outputs


def test_the_default_cutter_keeps_movements_whole() -> None:
    assert len(P) != len(Q)
    reader = WordReader(TruePhases(SESSIONS.folder, SESSIONS.config))
    fluent, whole = LearnedCutter(reader, whole=False), LearnedCutter(reader)
    assert (fluent.name, whole.name) == ("learned-fluent", "learned")
    p, q = (reader.alone(clip)[0] for clip in (P, Q))
    assert p.stroke is not None
    assert q.stroke is not None
    cut = whole.cut_all([P, Q])[0]
    assert p.stroke[1] <= cut.pre <= max(fluent.cut_all([P, P])[0].pre, p.stroke[1] + 2)
    assert q.stroke[0] >= cut.post >= min(fluent.cut_all([Q, Q])[0].post, q.stroke[0] - 2)
    joined = ss.splice([P, Q, P], ss.SpliceOptions(whole, "hermite", "fixed"))
    middle = next(span for span in joined.spans if span.clip == 1)
    assert middle.source is not None
    assert middle.source[0] <= q.stroke[0] < q.stroke[1] < middle.source[1]
