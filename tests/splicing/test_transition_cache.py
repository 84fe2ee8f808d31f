"""TransitionCache: what is kept is what would be made, and anything that differs is made anew."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from conftest import GOLDEN

import signsplice as ss
from signing import word
from signsplice.motion import Clip, EndSite, copy_unchecked
from signsplice.splicing.bulk_splice import TransitionCache, gap_key, splice_many
from signsplice.splicing.contracts import Cut, Gap, Transition
from signsplice.splicing.curves import CurveTransition, find_transition
from signsplice.splicing.options import SpliceOptions
from signsplice.splicing.passes import Pass, fill
from signsplice.splicing.seam import SIGNS, Seam
from signsplice.splicing.sentence import Sentence
from signsplice.splicing.word import AlignedWord, FrameMap

GAP = Gap(word("BOOK").clip[30:38], word("MOTHER").clip[20:28], 6)


def passes(**options: Any) -> Sequence[Pass]:
    """The passes of a call: by default hermite, with collision avoidance."""
    named: dict[str, Any] = {"transition": "hermite", "avoid_collisions": True, **options}
    wanted = SpliceOptions(**named)
    return Sentence(wanted).passes


PASSES = passes()


def seam(gap: Gap) -> Seam:
    """A planned seam with this gap."""
    before, after = (AlignedWord(0, clip, clip, FrameMap()) for clip in (gap.before, gap.after))
    return Seam(SIGNS, before, after, Cut(len(gap.before) - 1, 0), gap)


def nudged(values: np.ndarray) -> np.ndarray:
    """The same numbers, the last one changed in its last bit."""
    out = np.array(values)
    out.flat[-1] = np.nextafter(out.flat[-1], 2.0)
    return out


def changed(side: str, **fields: Callable[[Clip], object]) -> Gap:
    clip = getattr(GAP, side)
    sides: dict[str, Any] = {side: copy_unchecked(clip, **{name: change(clip) for name, change in fields.items()})}
    return replace(GAP, **sides)


def on_skeleton(**fields: Any) -> Gap:
    skeleton = replace(GAP.before.skeleton, **fields)
    before, after = (copy_unchecked(clip, skeleton=skeleton) for clip in (GAP.before, GAP.after))
    return Gap(before, after, GAP.n_frames)


SKELETON = GAP.before.skeleton
OTHER_GAPS = {
    "a rotation before": changed("before", local_rotations=lambda clip: nudged(clip.local_rotations)),
    "a rotation after": changed("after", local_rotations=lambda clip: nudged(clip.local_rotations)),
    "a position before": changed("before", root_positions=lambda clip: nudged(clip.root_positions)),
    "a position after": changed("after", root_positions=lambda clip: nudged(clip.root_positions)),
    "bones that move": changed("after", translations=lambda clip: np.tile(SKELETON.offsets, (len(clip), 1, 1))),
    "frames shown before": replace(GAP, before=GAP.before[1:]),
    "frames shown after": replace(GAP, after=GAP.after[:-1]),
    "sides": Gap(GAP.after, GAP.before, GAP.n_frames),
    "number of frames": replace(GAP, n_frames=7),
    "words drawn between keys": replace(GAP, keyed=True),
    "words that are captured": replace(GAP, keyed=False),
    "rate": changed("before", fps=lambda clip: clip.fps + 1e-9),
    "a bone": on_skeleton(offsets=nudged(SKELETON.offsets)),
    "a name": on_skeleton(names=(*SKELETON.names[:-1], "other")),
    "tips": on_skeleton(end_sites=(EndSite(1, np.ones(3)),)),
    "roles": on_skeleton(roles={"head": SKELETON.names[1]}),
}
OTHER_PASSES = {
    "transition": passes(transition="quintic"),
    "a network": passes(transition="learned"),
    "another network": passes(transition="learned", bundle=GOLDEN / "tiny_bundle"),
    "collision avoidance": passes(avoid_collisions=None),
}
CHANGES = [(name, PASSES, gap) for name, gap in OTHER_GAPS.items()]
CHANGES += [(name, others, GAP) for name, others in OTHER_PASSES.items()]


@pytest.mark.parametrize(("others", "gap"), [row[1:] for row in CHANGES], ids=[name for name, *_ in CHANGES])
def test_what_differs_in_anything_is_a_miss(others: Sequence[Pass], gap: Gap) -> None:
    transitions = TransitionCache()
    transitions.fill(PASSES, [seam(GAP)])
    same_numbers = Gap(GAP.before[:], GAP.after[:], GAP.n_frames)
    transitions.fill(PASSES, [seam(same_numbers)])
    assert (transitions.hits, transitions.misses) == (1, 1)
    found = {gap_key(PASSES, GAP), gap_key(others, gap)}
    assert len(found) == 2
    assert None not in found


def test_keys_of_all_changes_differ() -> None:
    assert len({gap_key(others, gap) for _, others, gap in CHANGES}) == len(CHANGES)


def assert_same(found: Sequence[Seam], expected: Sequence[Seam]) -> None:
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one.new_frames.local_rotations, other.new_frames.local_rotations)
        np.testing.assert_array_equal(one.new_frames.root_positions, other.new_frames.root_positions)
        assert (one.depth, one.frame_warnings) == (other.depth, other.frame_warnings)


def test_gaps_are_filled_alike_with_and_without_and_once_where_they_come_twice() -> None:
    network = OTHER_PASSES["a network"]
    gaps = [GAP, OTHER_GAPS["sides"], GAP, OTHER_GAPS["number of frames"]]
    transitions = TransitionCache()
    seams = [seam(gap) for gap in gaps]
    expected = fill(network, seams)
    for hits in (1, 5):
        found = transitions.fill(network, seams)
        assert_same(found, expected)
        assert all(one.new_frames.skeleton is gap.before.skeleton for one, gap in zip(found, gaps, strict=True))
        assert (transitions.hits, transitions.misses) == (hits, 3)


def test_memory_is_bounded_and_what_was_used_last_stays() -> None:
    transitions = TransitionCache(most_bytes=50_000)
    gaps = [replace(GAP, n_frames=n) for n in (5, 6, 7, 8, 9)]
    for gap in gaps:
        transitions.fill(PASSES, [seam(gap)])
        assert 0 < transitions.nbytes <= 50_000
    transitions.fill(PASSES, [seam(gaps[-1])])
    assert transitions.hits == 1
    transitions.fill(PASSES, [seam(gaps[0])])
    assert transitions.hits == 1


class Stepwise(Transition):
    """A user's transition: nobody knows what decides its frames."""

    name, summary = "stepwise", "the last pose, then the next"

    def between(self, gap: Gap) -> Clip:
        return find_transition("hold").between(gap)


@pytest.mark.parametrize(
    "transition", [Stepwise(), CurveTransition("hermite", "not it", lambda problem: problem.times)]
)
def test_a_transition_of_the_users_is_never_kept(transition: Transition) -> None:
    own, transitions = passes(transition=transition), TransitionCache()
    assert gap_key(own, GAP) is None
    if isinstance(transition, Stepwise):
        assert len(transitions.fill(own, [seam(GAP), seam(GAP)])) == 2
        assert (transitions.hits, transitions.misses) == (0, 2)


def test_sentences_with_known_transitions_are_those_of_splice() -> None:
    words = [word(gloss).clip for gloss in ("BOOK", "MOTHER", "YES")]
    sentences, transitions = [words, words[1:], words[1:] + words[:1]], TransitionCache()
    for _ in range(2):
        found = splice_many(sentences, transitions=transitions)
    assert transitions.hits >= 6
    for result, clips in zip(found, sentences, strict=True):
        assert isinstance(result, ss.SpliceResult)
        expected = ss.splice(clips)
        np.testing.assert_array_equal(result.clip.local_rotations, expected.clip.local_rotations)
        assert (result.spans, result.warnings) == (expected.spans, expected.warnings)
        assert repr(result.seams) == repr(expected.seams)  # NaN is itself there
