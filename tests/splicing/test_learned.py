"""Learned parts on clips: whatever the rig, rate and hand, and beside the classical method they bend.

The bundle has random weights (tests/golden/make_tiny_bundle.py): its answers are arbitrary, and the same for all.
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

import signsplice as ss
from other_rigs import mirror, on_other_rig
from signing import sign, word
from signsplice.errors import InputError
from signsplice.motion import kinematics, rotation
from signsplice.motion.clip import Clip, Skeleton, concatenate, resample
from signsplice.rig.canonical import canonical_motion
from signsplice.splicing.cut import Cut
from signsplice.splicing.gap import Gap
from signsplice.splicing.learned import LearnedCutter, LearnedDuration, LearnedTransition, open_sessions
from signsplice.splicing.sessions import Array, Sessions
from signsplice.splicing.transition import find_transition
from signsplice.splicing.word_reader import REST_FRAMES, WordReader, stroke_span
from signsplice.synth import planner
from signsplice.synth.signer import RESTS, STANDARD

TINY = Path(__file__).parents[1] / "golden" / "tiny_bundle"
GRAPHS = open_sessions(TINY)
READER = WordReader(GRAPHS)
CUTTER, DURATION, TRANSITION = (
    LearnedCutter(READER, whole=False),
    LearnedDuration(READER, unhurried=False),
    LearnedTransition(GRAPHS),
)
P, Q = word("MOTHER").clip, word("BOOK").clip
TURN = rotation.exp([0.4, -1.1, 2.0])


def worn(clip: Clip) -> Clip:
    """Another rig: turned axes, another unit."""
    return on_other_rig(clip, TURN, 0.01)


def test_every_rig_hand_and_rate_is_cut_alike() -> None:
    own = CUTTER.cut_all([P, Q])[0]
    assert 0 <= own.pre < len(P)
    assert 0 <= own.post < len(Q)
    assert CUTTER.cut_all([worn(P), worn(Q)])[0] == own
    assert CUTTER.cut_all([mirror(P), mirror(Q)])[0] == own
    fast = CUTTER.cut_all([resample(P, 60.0), resample(Q, 60.0)])[0]
    assert (abs(fast.pre - 2 * own.pre), abs(fast.post - 2 * own.post)) <= (1, 1)


def test_where_a_word_is_left_depends_on_the_next() -> None:
    pairs = ((P, Q), (P, word("SEE").clip))
    seen, other = (CUTTER.scores(*CUTTER.reader.pair(*pair)) for pair in pairs)
    (start, stop), (begin, end) = (canonical_motion(clip).active_span for clip in (P, Q))
    assert seen.scores.shape == (stop - start, end - begin), "while the arms are away from rest"
    assert (seen.leaves_from, seen.enters_from) == (start, begin)
    assert np.exp(seen.scores).sum() == pytest.approx(1.0), "log-probabilities of both frames"
    leaving, instead = (np.exp(c.scores).sum(axis=1) for c in (seen, other))
    assert np.abs(leaving - instead).max() > 1e-7
    best = CUTTER.cut_all([P, Q])[0]
    assert seen.scores[best.pre - start, best.post - begin] == seen.scores.max()


def test_long_words_are_read_at_their_inner_ends() -> None:
    long = concatenate([P, P, P])
    before, after = READER.pair(long, long)
    assert (before.first, after.first) == (len(long) - 150, 0)
    assert len(before.features) == len(after.features) == 150
    assert CUTTER.cut_all([long, Q])[0].pre >= len(long) - 150
    assert CUTTER.cut_all([Q, long])[0].post < 150
    assert DURATION.seconds(long, long, Cut(len(long) - 1, 0)) > 0.0


@pytest.mark.parametrize("rest", RESTS)
@pytest.mark.parametrize("whole", [False, True])
def test_however_long_it_rests_a_word_is_left_and_entered_alike(whole: bool, rest: str) -> None:
    """Whoever stands still for ten seconds before and after a sign is not shown standing still in a sentence."""
    cutter = LearnedCutter(READER, whole)
    words = [planner.isolated(sign(gloss), replace(STANDARD, rest=rest)) for gloss in ("MOTHER", "BOOK")]
    clips = [concatenate([w.clip[:1]] * 300 + [w.clip] + [w.clip[-1:]] * 300) for w in words]
    cut = cutter.cut_all(list(clips))[0]
    for frame, word_ in zip((cut.pre, cut.post), words, strict=True):
        assert 300 - REST_FRAMES <= frame < 300 + len(word_) + REST_FRAMES, "and not in the middle of nothing"
    longer = [concatenate([clip[:1], clip, clip[-1:]]) for clip in clips]
    again = cutter.cut_all(list(longer))[0]
    assert (again.pre, again.post) == (cut.pre + 1, cut.post + 1)
    for reading, word_ in zip(READER.pair(*clips), words, strict=True):
        assert len(reading.features) <= len(word_) + 2 * REST_FRAMES


@pytest.mark.parametrize("fps", [24.0, 29.97, 30.0, 60.0])
def test_words_are_cut_while_their_arms_are_away_from_rest_at_any_rate(fps: float) -> None:
    clips = [resample(word(gloss).clip, fps) for gloss in ("NIGHT", "YOU", "BOOK")]
    cuts = LearnedCutter(READER).cut_all(clips)
    for (before, after), cut in zip(itertools.pairwise(clips), cuts, strict=True):
        start, stop = canonical_motion(before).active_span
        begin, end = canonical_motion(after).active_span
        assert start <= cut.pre < stop
        assert begin <= cut.post < end
    for clip in clips:
        ((reading, _), (start, stop)) = READER.pair(clip, clip), canonical_motion(clip).active_span
        first, last = (reading.first + frame for frame in (reading.active[0], reading.active[1] - 1))
        assert start <= round(first / 30.0 * fps) < start + 2
        assert stop - 2 <= round(last / 30.0 * fps) + (fps > 30.0) < stop + (fps > 30.0)


def test_a_word_is_read_once_for_all_its_seams() -> None:
    class Counting(Sessions):
        def run(self, name: str, inputs: Mapping[str, Array]) -> dict[str, Array]:
            runs.append(name)
            return super().run(name, inputs)

    runs: list[str] = []
    graphs = Counting(GRAPHS.folder, GRAPHS.config)
    reader = WordReader(graphs)
    words = [P[:], Q[:], word("SEE").clip[:]]
    ss.splice([*words, *words], ss.SpliceOptions(cutter=LearnedCutter(reader), duration=LearnedDuration(reader)))
    assert runs.count("cut") == runs.count("duration") == 5
    assert runs.count("word") <= 6, "each word in one orientation, at most in both"


def test_a_sentence_is_cut_as_a_whole_and_never_backwards() -> None:
    clips = [P, Q, word("SEE").clip, P]
    result = ss.splice(clips, ss.SpliceOptions(cutter=CUTTER, transition="hermite"))
    cuts = CUTTER.cut_all(clips)
    assert [(seam.pre_frame, seam.post_frame) for seam in result.seams] == [(cut.pre, cut.post) for cut in cuts]
    assert all(after.pre > before.post for before, after in itertools.pairwise(cuts)), "every word keeps some frames"


def test_every_rig_hand_and_rate_takes_as_long() -> None:
    cut = Cut(40, 22)
    own = DURATION.seconds(P, Q, cut)
    assert 0.02 < own < 5.0
    assert DURATION.seconds(worn(P), worn(Q), cut) == pytest.approx(own, rel=1e-4)
    assert DURATION.seconds(mirror(P), mirror(Q), cut) == pytest.approx(own, rel=1e-4)
    fast = DURATION.seconds(resample(P, 60.0), resample(Q, 60.0), Cut(80, 44))
    assert fast + 1.0 / 60.0 == pytest.approx(own + 1.0 / 30.0, rel=1e-2), "from the last frame kept to the first"
    assert DURATION.seconds(P, Q, Cut(0, len(Q) - 1)) > 0.0


def test_a_transition_bends_the_curve_and_keeps_its_ends() -> None:
    before, after = P[:40], Q[22:]
    base, made = (
        find_transition("hermite").between(Gap(before, after, 40)),
        TRANSITION.fill([Gap(before, after, 40)])[0],
    )
    away = rotation.angle_between(made.local_rotations, base.local_rotations).max(axis=1)
    assert away[15:25].max() > 0.02
    assert away[[0, -1]].max() < 0.02 * away.max(), "end velocities are the curve's"
    np.testing.assert_array_equal(made.root_positions, base.root_positions)
    bones = np.linalg.norm(np.diff(kinematics.forward(made)[1][:, [8, 9]], axis=1), axis=-1)
    assert np.ptp(bones) < 1e-6


def test_gaps_filled_together_are_each_filled_alone() -> None:
    gaps = [Gap(P[:40], Q[22:], n) for n in (7, 1, 12, 30, 7, 90)]
    for one, gap in zip(TRANSITION.fill(gaps), gaps, strict=True):
        alone = TRANSITION.fill([gap])[0]
        assert len(one) == gap.n_frames
        np.testing.assert_allclose(one.local_rotations, alone.local_rotations, atol=1e-5)
    assert TRANSITION.fill([]) == []


def test_a_sentence_is_filled_in_one_pass_and_a_stream_in_many() -> None:
    class Counting(Sessions):
        def run(self, name: str, inputs: Mapping[str, Array]) -> dict[str, Array]:
            runs.append(len(inputs["tokens"]))
            return super().run(name, inputs)

    runs: list[int] = []
    options = ss.SpliceOptions(
        transition=LearnedTransition(Counting(GRAPHS.folder, GRAPHS.config)), transition_time=0.3
    )
    words = [P, Q, word("SEE").clip, P]
    together = ss.splice(words, options)
    assert runs == [3]
    pieces = list(ss.stream(words, options))
    assert runs == [3, 1, 1, 1]
    streamed = np.concatenate([piece.clip.local_rotations for piece in pieces])
    np.testing.assert_allclose(streamed, together.clip.local_rotations, atol=1e-5)


def test_every_rig_hand_and_rate_is_bridged_alike() -> None:
    before, after = P[:40], Q[22:]
    own = TRANSITION.fill([Gap(before, after, 9)])[0]
    other = TRANSITION.fill([Gap(worn(before), worn(after), 9)])[0]
    apart = rotation.angle_between(other.local_rotations, worn(own).local_rotations)
    assert apart.max() < 1e-3
    flipped = mirror(TRANSITION.fill([Gap(mirror(before), mirror(after), 9)])[0])
    assert rotation.angle_between(flipped.local_rotations, own.local_rotations).max() < 1e-3
    fast = TRANSITION.fill([Gap(resample(before, 60.0), resample(after, 60.0), 19)])[0]
    assert rotation.angle_between(fast.local_rotations[1::2], own.local_rotations).max() < 0.03


@pytest.mark.parametrize("n_frames", [1, 46, 90])
def test_gaps_beyond_its_length_follow_the_curve(n_frames: int) -> None:
    before, after = P[:40], Q[22:]
    made, base = (
        TRANSITION.fill([Gap(before, after, n_frames)])[0],
        find_transition("hermite").between(Gap(before, after, n_frames)),
    )
    np.testing.assert_array_equal(made.local_rotations, base.local_rotations)


def test_signs_of_a_frame_or_two_are_enough() -> None:
    made = TRANSITION.fill([Gap(P[40:41], Q[22:23], 6)])[0]
    assert len(made) == 6
    assert CUTTER.cut_all([P[:1], Q[:2]])[0].pre == 0
    assert np.isfinite(concatenate([P[40:41], made, Q[22:23]]).local_rotations).all()


def test_a_sentence_by_networks_alone() -> None:
    options = ss.SpliceOptions(cutter=CUTTER, transition=TRANSITION, duration=DURATION)
    result = ss.splice([P, Q, word("YES").clip], options)
    assert (result.cutter, result.transition) == ("learned-fluent", "learned")
    assert [seam.n_transition for seam in result.seams] == [
        max(1, round(DURATION.seconds(a, b, Cut(seam.pre_frame, seam.post_frame)) * 30.0))
        for a, b, seam in zip((P, Q), (Q, word("YES").clip), result.seams, strict=True)
    ]
    again = ss.splice([P, Q, word("YES").clip], options)
    np.testing.assert_array_equal(result.clip.local_rotations, again.clip.local_rotations)


def test_foreign_old_and_broken_bundles_are_refused(tmp_path: Path) -> None:
    shutil.copytree(TINY, tmp_path / "b")
    head = tmp_path / "b" / "bundle.json"
    facts = json.loads(head.read_text())
    (tmp_path / "b" / "cut.onnx").write_bytes(b"x")
    with pytest.raises(InputError, match=r"cut.onnx: is not the file that bundle.json lists"):
        LearnedCutter(WordReader(open_sessions(tmp_path / "b"))).cut_all([P, Q])[0]
    for changed, expected in (
        ({"system": "lpt"}, "is a bundle of 'lpt'"),
        ({"features": 0}, "was made for features 0"),
    ):
        head.write_text(json.dumps(facts | changed))
        with pytest.raises(InputError, match=expected):
            open_sessions(tmp_path / "b")


def test_a_rig_without_known_arms_is_refused_in_a_line() -> None:
    skeleton = Skeleton(("a", "b"), np.array([-1, 0]), np.array([[0.0, 0, 0], [0, 1, 0]]))
    clip = Clip(skeleton, np.tile([0.0, 0, 0, 1], (5, 2, 1)), np.zeros((5, 3)), 30.0)
    with pytest.raises(InputError, match="no leftUpperArm or leftLowerArm found among joints a, b"):
        CUTTER.cut_all([clip, replace(clip, name="other")])[0]


def sure(*phases: int) -> np.ndarray:
    """Scores of frames that are surely what they are."""
    return 20.0 * np.eye(5)[list(phases)]


def test_a_stroke_is_the_movements_without_the_holds_and_a_frame_around() -> None:
    assert stroke_span(sure(0, 1, 2, 2, 3, 3, 2, 3, 2, 4, 0)) == (3, 8)
    assert stroke_span(sure(3, 3)) == (0, 1)
    doubtful = sure(0, 1, 2, 2, 3, 3, 2, 2, 4)
    doubtful[6] = np.log([0.01, 0.01, 0.89, 0.08, 0.01])
    assert stroke_span(doubtful) == (3, 7)


def test_a_sign_that_is_all_hold_has_its_middle() -> None:
    assert stroke_span(sure(0, 1, 2, 2, 2, 2, 2, 4, 0)) == (4, 4)
    assert stroke_span(sure(0, 0, 1, 1, 1, 4, 4, 0, 0)) is None


class PhasesTold:
    """The tiny bundle's graphs, and the true phases of P and Q."""

    facts: Mapping[str, object] = {}

    def run(self, name: str, inputs: Mapping[str, Array]) -> dict[str, Array]:
        said = GRAPHS.run(name, inputs)
        if name == "word":
            events = word("MOTHER" if inputs["tokens"].shape[1] == len(P) else "BOOK").events
            at = np.arange(inputs["tokens"].shape[1])
            said["phases"] = 20.0 * np.eye(5)[np.where((at >= events.start) & (at <= events.end), 3, 0)][None]
        return said


def test_a_whole_cut_leaves_movements_whole_and_a_fluent_one_need_not() -> None:
    assert len(P) != len(Q)
    reader = WordReader(PhasesTold())  # type: ignore[arg-type]
    fluent, whole = LearnedCutter(reader, whole=False), LearnedCutter(reader)
    assert (fluent.name, whole.name) == ("learned-fluent", "learned")
    p, q = reader.pair(P, Q)
    assert p.stroke is not None
    assert q.stroke is not None
    free, cut = fluent.cut_all([P, Q])[0], whole.cut_all([P, Q])[0]
    assert cut.pre == max(free.pre, p.stroke[1])
    assert cut.post == min(free.post, q.stroke[0])
    joined = ss.splice([P, Q, P], ss.SpliceOptions(whole, "hermite", "fixed"))
    middle = next(span for span in joined.spans if span.clip == 1)
    assert middle.source is not None
    assert middle.source[0] <= q.stroke[0] < q.stroke[1] < middle.source[1]
