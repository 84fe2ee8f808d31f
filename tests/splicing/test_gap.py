"""splicing.gap: what a transition is shown of both signs, and what a seam is scored on."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import random_clip

from signsplice.motion import Clip, resample
from signsplice.splicing.engine import SpliceOptions, splice
from signsplice.splicing.gap import CONTEXT, Cut, Gap, gap_at
from signsplice.splicing.inbetween import inbetween
from signsplice.splicing.methods.cut import PairCutter
from signsplice.splicing.methods.transition import GapTransition, find_transition

BEFORE = random_clip(0, n_frames=40)
AFTER = BEFORE[:30]


def same_frames(a: Clip, b: Clip) -> bool:
    """Whether two clips have the same frames, bit for bit."""
    return np.array_equal(a.local_rotations, b.local_rotations) and np.array_equal(a.root_positions, b.root_positions)


def test_a_gap_shows_the_frames_that_are_kept_next_to_the_cut() -> None:
    gap = gap_at(BEFORE, AFTER, Cut(pre=25, post=4), n_frames=9)
    assert same_frames(gap.before, BEFORE[18:26])
    assert same_frames(gap.after, AFTER[4:12])
    assert gap.n_frames == 9
    assert gap.seconds == pytest.approx(10 / 30)


def test_a_gap_shows_no_frame_before_the_entry_of_the_sign() -> None:
    for entry, expected in ((0, 8), (18, 8), (19, 7), (23, 3), (25, 1)):
        gap = gap_at(BEFORE, AFTER, Cut(pre=25, post=4), 9, entry)
        assert same_frames(gap.before, BEFORE[26 - expected : 26])


def test_a_gap_ends_with_the_clips() -> None:
    gap = gap_at(BEFORE[:3], AFTER, Cut(pre=2, post=len(AFTER) - 1), n_frames=0)
    assert (len(gap.before), len(gap.after)) == (3, 1)


def test_the_window_of_a_seam_has_eight_frames_on_either_side() -> None:
    new = find_transition("slerp").between(Gap(BEFORE, AFTER, 5))
    for before, n_before in ((BEFORE, CONTEXT), (BEFORE[:2], 2)):
        gap = Gap(before, AFTER[:4], 5)
        window, first = gap.window(new)
        assert first == n_before
        assert same_frames(window[:first], before[-CONTEXT:])
        assert same_frames(window[first : first + 5], new)
        assert same_frames(window[first + 5 :], AFTER[:4])


def test_the_window_without_new_frames_joins_both_signs() -> None:
    window, first = Gap(BEFORE, AFTER, 0).window(None)
    assert (len(window), first) == (2 * CONTEXT, CONTEXT)
    assert same_frames(window[:first], BEFORE[-CONTEXT:])
    assert same_frames(window[first:], AFTER[:CONTEXT])


class Recording(GapTransition):
    """Slerp that keeps how many frames it was shown before and after each gap."""

    name, summary = "recording", "for tests"

    def __init__(self) -> None:
        self.seen: list[tuple[int, int]] = []

    def between(self, gap: Gap) -> Clip:
        self.seen.append((len(gap.before), len(gap.after)))
        return find_transition("slerp").between(gap)


class ShortStay(PairCutter):
    """Leaves every sign two frames after it was entered."""

    name, summary = "short-stay", "for tests"

    def cut(self, before: Clip, after: Clip) -> Cut:
        return Cut(22, 20)


def test_splice_never_shows_frames_that_are_cut_away(sentence: list[Clip]) -> None:
    recording = Recording()
    splice(sentence[:4], SpliceOptions(cutter=ShortStay(), transition=recording))
    assert [n_before for n_before, _ in recording.seen] == [8, 3, 3]


@pytest.mark.parametrize(("fps", "expected"), [(24.0, 8), (30.0, 8), (60.0, 15), (120.0, 29)])
def test_transitions_see_as_much_time_at_any_rate(sentence: list[Clip], fps: float, expected: int) -> None:
    recording = Recording()
    splice(sentence[:3], SpliceOptions("pose-velocity", recording, "tempo", fps=fps))
    whole = resample(sentence[0], fps)
    inbetween(whole, [(len(whole) // 2, len(whole) // 2 + 4)], recording)
    assert recording.seen == [(expected, expected)] * 3
