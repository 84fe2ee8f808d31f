"""passes.pauses: a word that ends a phrase is held in its last posture, and its kept frames stay as they are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pytest
from conftest import random_clip
from hypothesis import given, settings
from hypothesis import strategies as st

import signsplice as ss
from signing import marked, word
from signsplice.body.retarget import align
from signsplice.errors import InputError
from signsplice.motion import Clip, FloatArray, concatenate, sample_clip
from signsplice.rig.align import reference
from signsplice.rig.info import arms
from signsplice.splicing.bulk_splice import splice_many
from signsplice.splicing.contracts import Cut, Cutter
from signsplice.splicing.cutters import CUTTERS
from signsplice.splicing.engine import SpliceOptions, SpliceResult, splice, stream
from signsplice.splicing.pauses import LONGER, PAUSES_S, _braking
from signsplice.splicing.person import channel_joints, owned_channels
from signsplice.splicing.result import Span

GLOSSES = ("HELLO", "FRIEND", "MOTHER", "BOOK", "THANK-YOU")
MARKS = {0: ",", 2: ".", 4: "!"}
WAYS = {
    "default": SpliceOptions(),
    "classical": SpliceOptions("pose-velocity", "hermite", "tempo"),
    "natural": SpliceOptions(tempo="natural"),
    "no person": SpliceOptions(person=0.0, free_hand="transition"),
    "faster": SpliceOptions(fps=25.0, sign_speed=1.4),
    "no transitions": SpliceOptions(transition_time=0.0),
}


def clips(*glosses: str) -> list[Clip]:
    return [word(gloss).clip for gloss in glosses or GLOSSES]


def rebuilt(result: SpliceResult, sources: Sequence[Clip]) -> FloatArray:
    """Rotations by the copy rule: of transitions and remade joints from the output, of others from their aligned
    clips.
    """
    first, out = reference(sources[0], result.clip.fps), np.array(result.clip.local_rotations)
    for span in result.spans:
        if span.clip is not None and span.source is not None:
            source = align(sources[span.clip], first).clip
            source = sample_clip(source, np.array(span.warp)[:, 1]) if span.warp else source[slice(*span.source)]
            out[slice(*span.output)] = source.local_rotations
            if span.remade is not None:
                remade = slice(*span.remade.frames), [source.skeleton.index[name] for name in span.remade.joints]
                out[remade] = result.clip.local_rotations[remade]
    return out


def paused(result: SpliceResult) -> list[Span]:
    return [span for span in result.spans if span.pause is not None]


def wrist_speeds(clip: Clip, sides: Sequence[int] = (0, 1)) -> FloatArray:
    """Speed of the faster wrist from each frame to the next, m/s."""
    own = arms(clip)
    steps = np.diff(own.wrists[:, list(sides)], axis=0)
    return np.asarray(np.linalg.norm(steps, axis=-1).max(axis=1) * own.metres * clip.fps)


def owned_joints(clip: Clip) -> list[int]:
    return [joint for channel in owned_channels(clip) for joint in channel_joints(clip, channel)]


@pytest.mark.parametrize("cutter", ["learned", *CUTTERS])
def test_kept_frames_are_the_clips_and_every_span_rebuilds_the_output(cutter: str) -> None:
    result = splice(marked(clips(), pauses=MARKS), SpliceOptions(cutter=cutter))
    assert np.array_equal(rebuilt(result, clips()), result.clip.local_rotations)
    for span in result.spans:
        if span.clip is not None and span.remade is not None:
            own = {result.clip.skeleton.names[joint] for joint in owned_joints(clips()[span.clip])}
            assert not own & {*span.remade.joints}, "what belongs to a word is kept"
    assert [span.kind for span in result.spans] == ["sign", "transition"] * (len(GLOSSES) - 1) + ["sign", "retraction"]
    assert [span.name for span in result.spans if span.kind == "sign"] == list(GLOSSES)
    stops = [span.output[1] for span in result.spans]
    assert [span.output[0] for span in result.spans] == [0, *stops[:-1]]
    assert stops[-1] == len(result.clip)
    assert all(span.warp is None for span in result.spans[:-1]), "nothing is played otherwise than as recorded"
    assert result.spans[-1].warp is not None, "it comes to a stand"


def test_the_report_names_each_pause_at_the_beginning_of_a_transition_or_the_retraction() -> None:
    result = splice(marked(clips(), pauses=MARKS))
    assert [span.pause.mark for span in paused(result) if span.pause] == list(MARKS.values())
    assert [span.kind for span in paused(result)] == ["transition", "transition", "retraction"]
    for span in paused(result):
        assert span.pause is not None
        assert span.output[0] == span.pause.frames[0] < span.pause.frames[1] < span.output[1]
    for seam, before, gap, after in zip(
        result.seams, result.spans[::2], result.spans[1::2], result.spans[2::2], strict=False
    ):
        assert before.source is not None
        assert after.source is not None
        assert (seam.pre_frame, seam.post_frame) == (before.source[1] - 1, after.source[0])
        assert seam.n_transition == gap.output[1] - gap.output[0]


@pytest.mark.parametrize("way", WAYS)
def test_a_stream_and_many_at_once_make_the_same_frames(way: str) -> None:
    whole = splice(marked(clips(), pauses=MARKS), WAYS[way])
    pieces = list(stream(marked(clips(), pauses=MARKS), WAYS[way]))
    (many,) = splice_many([marked(clips(), pauses=MARKS)], WAYS[way])
    assert isinstance(many, SpliceResult)
    for clip in (concatenate([piece.clip for piece in pieces]), many.clip):
        assert np.array_equal(clip.local_rotations, whole.clip.local_rotations)
        assert np.array_equal(clip.root_positions, whole.clip.root_positions)
    assert tuple(piece.span for piece in pieces) == whole.spans == many.spans
    assert len(paused(whole)) == len(MARKS)


def test_a_word_is_held_alike_whatever_comes_next() -> None:
    every_joint = list(range(len(clips()[0].skeleton)))
    for way, joints in (("no person", every_joint), ("default", owned_joints(clips("HELLO")[0]))):
        holds = []
        for after in ("BOOK", "MOTHER"):
            result = splice(marked(clips("HELLO", after), pauses={0: "."}), WAYS[way])
            (span,) = paused(result)
            assert span.pause is not None
            holds.append(result.clip.local_rotations[: span.pause.frames[1], joints])
        assert np.array_equal(holds[0], holds[1])


@pytest.mark.parametrize("mark", PAUSES_S)
def test_a_pause_lasts_as_its_mark_says_and_a_fifth_of_the_sign(mark: str) -> None:
    """THANK-YOU and BOOK end in a hold: none of the time is needed to come to a stand."""
    for gloss in ("THANK-YOU", "BOOK"):
        result = splice(marked(clips("HELLO", gloss, "MOTHER"), pauses={1: mark}))
        (span,), sign = paused(result), result.spans[2]
        assert span.pause is not None
        wanted = PAUSES_S[mark] * 30.0 + LONGER * (sign.output[1] - sign.output[0])
        assert span.pause.frames[1] - span.pause.frames[0] == pytest.approx(wanted, abs=1.5)


def test_hands_stand_at_the_end_of_a_pause_and_stay_up_between_phrases() -> None:
    result = splice(marked(clips("HELLO", "MOTHER", "FATHER", "BOOK"), pauses={0: ".", 1: "!", 2: "."}))
    # The right hand signs before each mark; the left one is on its way to BOOK while FATHER is held.
    speeds, lift = wrist_speeds(result.clip, sides=[1]), arms(result.clip).lift.max(axis=1)
    for span in paused(result):
        assert span.pause is not None
        assert speeds[span.pause.frames[1] - 3 : span.pause.frames[1] - 1].max() < 0.1
    assert lift[result.spans[0].output[1] : result.spans[-1].output[0]].min() > 0.4, "no arms come down"


def test_a_pause_has_no_more_jerk_than_the_sign_before_it() -> None:
    for gloss in ("MOTHER", "DOG", "COFFEE", "SORRY", "WALK"):
        result = splice(marked(clips(gloss, "BOOK"), pauses={0: ","}))
        (span,) = paused(result)
        assert span.pause is not None
        steps = np.abs(np.diff(wrist_speeds(result.clip)))
        start, stop = span.pause.frames
        assert steps[start - 2 : stop - 1].max() < 1.2 * steps[: start - 2].max(), gloss


def test_after_the_last_mark_hands_come_down_as_in_the_clip() -> None:
    clip = clips("BOOK")[0]
    plain, held = splice([clip]), splice(marked([clip], pauses={0: "."}))
    assert [span.kind for span in plain.spans] == [span.kind for span in held.spans] == ["sign", "retraction"]
    assert (len(paused(plain)), len(paused(held))) == (0, 1)
    n = 20
    assert np.array_equal(plain.clip.local_rotations[-n:], held.clip.local_rotations[-n:])
    assert len(held.clip) - len(plain.clip) > 0.3 * held.clip.fps
    assert wrist_speeds(held.clip).max() < 1.1 * wrist_speeds(plain.clip).max()


def test_no_pause_changes_nothing() -> None:
    held = splice(marked(clips(), pauses={}))
    assert np.array_equal(held.clip.local_rotations, splice(clips()).clip.local_rotations)
    assert paused(held) == []


def test_pauses_are_no_part_of_the_tempo() -> None:
    options = SpliceOptions(tempo="natural")
    plain, held = splice(clips(), options).tempo, splice(marked(clips(), pauses=MARKS), options).tempo
    assert plain.seconds is not None
    assert held.seconds == pytest.approx(plain.seconds, abs=0.15)


def test_a_spelled_word_is_held_at_its_last_letter(words: Mapping[str, Clip]) -> None:
    with ss.open_lexicon() as lexicon:
        spelled = [lexicon.clip(f"fs-{letter}") for letter in "ANA"]
    result = splice(marked([*spelled, words["HELLO"]], pauses={2: ","}))
    (span,) = paused(result)
    assert span.output[0] == result.spans[4].output[1]
    assert np.array_equal(rebuilt(result, [*spelled, words["HELLO"]]), result.clip.local_rotations)


def test_letters_beside_a_pause_are_two_words() -> None:
    with ss.open_lexicon() as lexicon:
        spelled = [lexicon.clip(f"fs-{letter}") for letter in "AB"]
    plain, held = splice(spelled), splice(marked(spelled, pauses={0: "."}))
    assert held.seams[0].n_transition > plain.seams[0].n_transition + 10


def test_rigs_without_arms_and_short_clips_are_held_too() -> None:
    some = [random_clip(0)] * 2
    options = SpliceOptions("ends", "slerp", transition_time=0.2)
    result = splice(marked(some, pauses={0: ".", 1: ","}), options)
    assert len(paused(result)) == 2
    assert np.array_equal(rebuilt(result, some), result.clip.local_rotations)
    short = [clip[:2] for clip in some]
    assert paused(splice(marked(short, pauses={0: "."}), options)) == [], "too few frames"


class LateCutter(Cutter):
    """Enters every word shortly before its end, after it was held."""

    name, summary = "late", "shortly before the end"

    def cut(self, before: Clip, after: Clip) -> Cut:
        return Cut(len(before) - 12, len(after) - self.last)

    def __init__(self, last: int) -> None:
        self.last = last


@pytest.mark.parametrize("last", [1, 2, 11, 12, 13])
def test_a_word_that_is_entered_late_keeps_a_frame_at_least(last: int) -> None:
    some = clips("HELLO", "BOOK", "MOTHER")
    result = splice(marked(some, pauses={1: ",", 2: "."}), SpliceOptions(cutter=LateCutter(last)))
    np.testing.assert_allclose(rebuilt(result, some), result.clip.local_rotations, atol=1e-9)
    assert [span.name for span in result.spans if span.kind == "sign"] == ["HELLO", "BOOK", "MOTHER"]


def test_a_mark_that_is_none_is_refused() -> None:
    with pytest.raises(InputError, match=r"pause ';' after BOOK, expected one of , \. \? !"):
        splice(marked(clips("BOOK"), pauses={0: ";"}))


@settings(max_examples=50, deadline=None)
@given(st.floats(1.0, 20.0), st.integers(1, 200))
def test_time_slows_down_and_never_stands_or_turns(distance: float, n_frames: int) -> None:
    steps = np.diff(np.concatenate([[5.0], _braking(5.0, 5.0 + distance, n_frames)]))
    assert (steps > 0.0).all()
    assert (np.diff(steps) <= 1e-9).all()
    assert steps.sum() == pytest.approx(distance)
