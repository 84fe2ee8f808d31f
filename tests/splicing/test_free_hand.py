"""splicing.free_hand: a hand that only goes to rest, or comes from it, has the time that it needs, and nothing else
changes.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from conftest import random_clip

import signsplice as ss
from other_rigs import mirror
from signing import sign, word
from signsplice.body.arm_ik import move_wrists
from signsplice.body.retarget import align
from signsplice.errors import InputError
from signsplice.motion import Clip, concatenate, kinematics
from signsplice.rig.align import reference
from signsplice.rig.info import TRUNK, rig_info
from signsplice.signer import planner
from signsplice.signer.signer import RESTS, STANDARD
from signsplice.splicing import stages
from signsplice.splicing.collisions import TOLERANCE_M
from signsplice.splicing.contracts import Cut
from signsplice.splicing.durations import DURATIONS
from signsplice.splicing.engine import joined_sentence
from signsplice.splicing.idle_hands import NATURAL, SPEEDS, FreeHands, idle_hands, is_approached
from signsplice.splicing.sentence import Sentence
from signsplice_workshop.measure.collisions import hand_penetration
from signsplice_workshop.measure.hands import wrist_positions

LINES = ("HORSE TEACH I", "BOOK I HELP YOU", "CRY COLOR HOUSE TOMORROW", "RAIN SEE HAT LANGUAGE")
LEFT, RIGHT = 0, 1


def clips(line: str) -> list[Clip]:
    return [word(gloss).clip for gloss in line.split()]


@cache
def spliced(line: str, free_hand: str = NATURAL) -> ss.SpliceResult:
    return ss.splice(clips(line), ss.SpliceOptions(free_hand=free_hand))


def speeds(clip: Clip) -> np.ndarray:
    """Speeds (T - 1, 2) of the wrists, m/s."""
    return np.asarray(np.linalg.norm(np.diff(wrist_positions(clip), axis=0), axis=-1) * clip.fps)


@pytest.mark.parametrize("line", LINES)
def test_all_joints_but_those_of_an_idle_arm_keep_the_frames_of_the_signs(line: str) -> None:
    result, words = spliced(line), clips(line)
    first, names = reference(words[0], result.clip.fps), result.clip.skeleton.index
    joints = rig_info(result.clip.skeleton).roles.joints
    n_remade = 0
    for span in result.spans:
        if span.kind == "transition":
            assert span.remade is None
            continue
        assert span.clip is not None
        assert span.source is not None
        source = align(words[span.clip], first).clip[slice(*span.source)]
        same = result.clip.local_rotations[slice(*span.output)] == source.local_rotations  # (T, J, 4)
        if span.remade is not None:
            n_remade += 1
            start, stop = (frame - span.output[0] for frame in span.remade.frames)
            assert 0 <= start < stop <= len(source)
            arm = [names[name] for name in span.remade.joints]
            assert not {joints[role] for role in (*TRUNK, "rightShoulder", "rightHand") if role in joints} & set(arm)
            assert not same[start:stop, arm].all(), "frames that are called remade are other frames"
            same[start:stop, arm] = True
        assert same.all()
    assert n_remade >= 2


@pytest.mark.parametrize("line", LINES)
def test_an_idle_hand_is_as_slow_as_those_of_people(line: str) -> None:
    natural, usual = spliced(line), spliced(line, "transition")
    for result, most in ((natural, 1.45), (usual, SPEEDS.largest_m_s)):
        words = clips(line)
        for k, seam in enumerate(result.seams):
            a, b = result.spans[2 * k + 1].output
            for hand in idle_hands(words[k], words[k + 1], Cut(seam.pre_frame, seam.post_frame)):
                assert speeds(result.clip)[a - 1 : b, hand.side].max() <= most
    jumps = [np.abs(np.diff(speeds(result.clip)[:, LEFT])).max() for result in (natural, usual)]
    assert jumps[0] <= jumps[1], "where frames of the sign begin again, the hand does not start or stop at once"


def test_a_transition_is_lengthened_only_where_the_idle_hand_would_be_too_fast(monkeypatch: pytest.MonkeyPatch) -> None:
    fast, slow = clips("CRY GRANDMOTHER"), clips("TEACH I")
    # A call that names the transition or its time has them as they are.
    named = ss.SpliceOptions(transition="hermite")
    assert ss.splice(slow).seams[0].n_transition == ss.splice(slow, named).seams[0].n_transition
    monkeypatch.setitem(DURATIONS, "tempo", DURATIONS["fixed"])  # too fast for a hand from face to hip
    given, usual = ss.splice(fast, named).seams[0].n_transition, ss.splice(fast).seams[0]
    assert usual.n_transition > given
    assert usual.peak_speed_m_s <= SPEEDS.largest_m_s
    timed = ss.splice(fast, ss.SpliceOptions(transition_time=given / 30.0))
    assert timed.seams[0].n_transition == given
    assert timed.seams[0].peak_speed_m_s > SPEEDS.largest_m_s
    natural = ss.splice(fast, ss.SpliceOptions(free_hand=NATURAL))
    assert natural.seams[0].n_transition == given, "frames of the sign are enough"


@pytest.mark.parametrize("line", LINES)
def test_a_stream_gives_what_a_splice_gives(line: str) -> None:
    result = spliced(line)
    pieces = list(ss.stream(clips(line), ss.SpliceOptions(free_hand=NATURAL)))
    assert [piece.span for piece in pieces] == list(result.spans)
    streamed = np.concatenate([piece.clip.local_rotations for piece in pieces])
    np.testing.assert_array_equal(streamed, result.clip.local_rotations)
    assert [piece.seam for piece in pieces if piece.seam is not None] == list(result.seams)


def test_a_hand_that_signs_on_both_sides_is_not_idle() -> None:
    for line in ("BOOK TEACH", "I SEE"):
        result = spliced(line)
        assert all(span.remade is None for span in result.spans)
        options = ss.SpliceOptions(free_hand=NATURAL)
        passes = stages.passes(options, options.choose_methods())
        sentence = Sentence(options, [one for one in passes if not isinstance(one, FreeHands)])
        without = joined_sentence(sentence, [*sentence.add(clips(line)), *sentence.end()])
        np.testing.assert_array_equal(result.clip.local_rotations, without.clip.local_rotations)


def test_a_hand_goes_to_rest_after_the_seam_and_leaves_it_before() -> None:
    horse, _, teach, _, i = spliced("HORSE TEACH I").spans
    assert horse.remade is not None
    assert i.remade is not None
    assert horse.remade.frames[1] == horse.output[1], "it rises while HORSE is still signed"
    assert i.remade.frames[0] == i.output[0], "it sinks while I is signed already"
    assert teach.remade is None, "a sign of both hands"
    assert "mixamorig:LeftHand" in i.remade.joints


def test_an_arm_that_cannot_be_led_around_more_slowly_is_left_as_it_is() -> None:
    """The left arm comes from under the right elbow; more time would make its way around longer, and it no slower."""
    usual, natural = (spliced("DAY DREAM", choice) for choice in ("transition", NATURAL))
    assert [span.output for span in natural.spans] == [span.output for span in usual.spans]
    assert speeds(natural.clip)[:, LEFT].max() <= speeds(usual.clip)[:, LEFT].max() + 1e-9


def test_the_right_hand_is_as_free_as_the_left() -> None:
    flipped = ss.splice(
        [mirror(clip) for clip in clips("BOOK I")], ss.SpliceOptions("ends", "hermite", free_hand=NATURAL)
    )
    plain = ss.splice(clips("BOOK I"), ss.SpliceOptions("ends", "hermite", free_hand=NATURAL))
    assert [span.output for span in flipped.spans] == [span.output for span in plain.spans]
    book, i, cut = word("BOOK").clip, word("I").clip, Cut(40, 25)
    (hand,), (other,) = idle_hands(book, i, cut), idle_hands(mirror(book), mirror(i), cut)
    assert (hand.side, other.side) == (LEFT, RIGHT)
    assert (hand.arrives, hand.n_rest) == (other.arrives, other.n_rest)


@pytest.mark.parametrize("rest", RESTS)
def test_hands_rest_in_the_way_of_their_signer(rest: str) -> None:
    signer = replace(STANDARD, rest=rest)
    teach, i = (planner.synthesize_word(sign(gloss), signer) for gloss in ("TEACH", "I"))
    cut = Cut(teach.events.end, i.events.start)
    (hand,) = idle_hands(teach.clip, i.clip, cut)
    assert (hand.side, hand.arrives) == (LEFT, True)
    assert cut.post + hand.n_rest > i.events.end, "it rests until the sign is over"
    (hand,) = idle_hands(i.clip, teach.clip, Cut(i.events.end, teach.events.start))
    assert (hand.side, hand.arrives) == (LEFT, False)


def test_a_held_hand_is_not_at_rest() -> None:
    """A clip that begins within a sign of two hands, one of which keeps still."""
    book = word("BOOK")
    held = concatenate([book.clip[book.events.start :][:1]] * 20)
    assert idle_hands(book.clip, held, Cut(book.events.end, 0)) == []


def test_an_arm_that_the_other_hand_comes_near_is_not_free() -> None:
    still = concatenate([word("I").clip[:1]] * 12)
    joints = rig_info(still.skeleton).arm_joints
    wrists = kinematics.forward(still, [joints[2], joints[5], joints[1]])[1]  # (T, 3, 3)
    moves = np.zeros((12, 2, 3))
    moves[6:, RIGHT] = (0.5 * (wrists[:, 0] + wrists[:, 2]) - wrists[:, 1])[6:]
    touching = move_wrists(still, moves)
    near = is_approached(touching, LEFT)
    assert near.tolist() == [False] * 6 + [True] * 6


@pytest.mark.parametrize("line", LINES)
def test_no_hand_goes_through_the_body_while_its_arm_is_remade(line: str) -> None:
    result = spliced(line)
    metres = rig_info(result.clip.skeleton).sizes.unit.metres
    depth = metres * hand_penetration(result.clip.skeleton, *kinematics.forward(result.clip))[0]
    for span in result.spans:
        if span.remade is not None:
            start, stop = span.remade.frames
            ends = np.maximum(depth[[max(start - 1, 0), min(stop, len(depth) - 1)], LEFT], 0.0)
            assert depth[start:stop, LEFT].max() <= TOLERANCE_M + ends.max() + 1e-9
    for seam in result.seams:
        assert seam.intrusion_mm is not None
        assert seam.intrusion_mm <= 1e3 * TOLERANCE_M


def test_an_unknown_choice_is_refused_and_a_rig_without_arms_is_left_alone() -> None:
    with pytest.raises(InputError, match="free hand 'slow', expected one of transition, natural"):
        ss.SpliceOptions(free_hand="slow")
    clip = random_clip(0)
    made = [ss.splice([clip, clip], ss.SpliceOptions("ends", free_hand=mode)).clip for mode in ("transition", NATURAL)]
    np.testing.assert_array_equal(made[0].local_rotations, made[1].local_rotations)
