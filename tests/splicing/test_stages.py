"""splicing.stages: words, planned seams and pieces are frozen values, and the passes that are listed are what runs."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import FrozenInstanceError, dataclass, field, fields, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from conftest import random_clip
from hypothesis import given
from hypothesis import strategies as st

import signsplice as ss
from signing import word
from signsplice.lexicon import open_shipped_lexicon
from signsplice.motion import Clip, rotation, sample_clip
from signsplice.splicing import stages
from signsplice.splicing.cutters import CUTTERS
from signsplice.splicing.engine import joined_sentence, splice
from signsplice.splicing.options import SpliceOptions
from signsplice.splicing.passes import Pass, fill, run
from signsplice.splicing.result import Piece, SpliceResult
from signsplice.splicing.seam import LETTERS, REFORMED, SIGNS, SLID, Seam, SeamKind
from signsplice.splicing.sentence import Sentence, describe_edits
from signsplice.splicing.tempo import retime_word
from signsplice.splicing.word import AlignedWord, Edit, FrameMap, Word, apply_edits

GUIDE = Path(__file__).resolve().parents[2] / "CONTRIBUTING.md"
CLIPS = [word(gloss).clip for gloss in ("BOOK", "MOTHER", "YES")]
OPTIONS = SpliceOptions("pose-velocity", "hermite", "tempo")
NO_PERSON = replace(OPTIONS, person=0.0, free_hand="transition")


def spelled(text: str) -> list[Clip]:
    with open_shipped_lexicon() as lexicon:
        return [lexicon.clip(f"fs-{letter}") for letter in text]


def spliced(clips: Sequence[Clip], passes: Sequence[Pass], options: SpliceOptions = OPTIONS) -> SpliceResult:
    sentence = Sentence(options, passes)
    return joined_sentence(sentence, [*sentence.add(clips), *sentence.end()])


def streamed(clips: Sequence[Clip], passes: Sequence[Pass], options: SpliceOptions = OPTIONS) -> list[Piece]:
    sentence = Sentence(options, passes)
    return [piece for clip in clips for piece in sentence.add([clip])] + sentence.end()


def listed(options: SpliceOptions = OPTIONS) -> tuple[Pass, ...]:
    return stages.passes(options, options.choose_methods())


# --- frozen ---


def test_no_attribute_of_a_stage_can_be_set() -> None:
    options = SpliceOptions(tempo="natural")
    sentence = Sentence(options)
    words, planned = sentence.plan([*CLIPS, *spelled("LLB")])
    seams = sentence.finish(words, fill(sentence.passes, planned))
    edits, paths = seams[-1].edits, seams[0].after.paths.values()
    assert edits
    assert paths
    values: list[Any] = [*words, *planned, *seams, *edits, *paths, words[0].frames, Word(CLIPS[0])]
    values += [*listed(options), *splice(CLIPS).spans, *splice(CLIPS).seams]
    for value in values:
        for one in fields(value):
            with pytest.raises(FrozenInstanceError):
                setattr(value, one.name, None)


def test_a_refused_word_leaves_the_sentence_as_it_was() -> None:
    sentence = Sentence(OPTIONS)
    before = sentence.add(CLIPS[:1])
    with pytest.raises(ss.InputError):
        sentence.add([replace(CLIPS[1], skeleton=replace(CLIPS[1].skeleton, names=tuple(map(str, range(53)))))])
    pieces = [*before, *sentence.add(CLIPS[1:]), *sentence.end()]
    assert [piece.span for piece in pieces] == list(splice(CLIPS, OPTIONS).spans)


# --- passes ---


@dataclass(frozen=True)
class Watch(Pass):
    """Changes nothing, and remembers what it is shown."""

    seen: list[Seam] = field(default_factory=list)

    def change(self, seam: Seam) -> Seam:
        self.seen.append(seam)
        return seam


@dataclass(frozen=True)
class WatchLetters(Watch):
    """The same for letters that look different."""

    kinds: ClassVar[frozenset[SeamKind]] = frozenset({LETTERS})


def test_a_pass_in_the_list_sees_each_seam_in_order() -> None:
    whole, piecewise = Watch(), Watch()
    result = spliced(CLIPS, [*listed(), whole])
    pieces = streamed(CLIPS, [*listed(), piecewise])
    for watch in (whole, piecewise):
        assert [(seam.before.clip.name, seam.after.clip.name) for seam in watch.seen] == [
            ("BOOK", "MOTHER"),
            ("MOTHER", "YES"),
        ]
        assert all(seam.frames is not None and seam.kind == SIGNS for seam in watch.seen)
    assert tuple(piece.span for piece in pieces) == result.spans == splice(CLIPS, OPTIONS).spans


def test_a_pass_is_shown_the_kinds_of_seams_that_it_names() -> None:
    everything, letters = Watch(), WatchLetters()
    options = SpliceOptions()
    spliced([CLIPS[0], *spelled("BOOT"), CLIPS[1]], [*listed(options), everything, letters], options)
    assert [seam.kind for seam in everything.seen] == [SIGNS, LETTERS, REFORMED, LETTERS, SIGNS]
    assert letters.seen == [everything.seen[1], everything.seen[3]]
    slid = Watch()
    spliced(spelled("LLB"), [*listed(options), slid], options)
    assert [seam.kind for seam in slid.seen] == [SLID, LETTERS]


def test_passes_that_batch_come_before_the_others() -> None:
    first, *others = listed()
    with pytest.raises(ValueError, match="a pass that batches comes after one that does not"):
        Sentence(OPTIONS, [*others, first])


def test_a_sentence_that_ended_begins_anew() -> None:
    sentence = Sentence(NO_PERSON, [*listed(), TurnHead()])
    for _ in range(2):
        pieces = [*sentence.add(CLIPS), *sentence.end()]
        assert pieces[0].span.remade is not None
        assert len(pieces[0].span.remade.joints) == 1
        assert pieces[0].span.remade.frames[0] == pieces[0].span.output[1] - 3, "of the end alone"
    sentence = Sentence(OPTIONS)
    rounds = [[*sentence.add(CLIPS), *sentence.end()] for _ in range(2)]
    for one, other in zip(*rounds, strict=True):
        np.testing.assert_array_equal(one.clip.local_rotations, other.clip.local_rotations)


def test_seams_without_new_frames_are_shown_to_no_pass() -> None:
    watch = Watch()
    options = replace(OPTIONS, transition_time=0.0)
    spliced(CLIPS, [*listed(options), watch], options)
    assert watch.seen == []


@dataclass(frozen=True)
class TurnHead(Pass):
    """Turns the head a little more at the beginning of every second word and at the end of every first."""

    angle: float = 0.1

    def change(self, seam: Seam) -> Seam:
        head = seam.after.clip.skeleton.index["mixamorig:Head"]
        cut, turn = seam.retimed_cut, rotation.exp(np.array([0.0, self.angle, 0.0]))
        entered = rotation.multiply(seam.after_clip.local_rotations[cut.post : cut.post + 4, [head]], turn)
        left = rotation.multiply(seam.before_clip.local_rotations[cut.pre - 2 : cut.pre + 1, [head]], turn)
        return replace(
            seam,
            entering=(*seam.entering, Edit((head,), cut.post, entered)),
            leaving=(*seam.leaving, Edit((head,), cut.pre - 2, left)),
        )


def test_edits_come_out_and_the_report_names_them() -> None:
    for options in (OPTIONS, NO_PERSON):
        plain, turned = (spliced(CLIPS, passes, options) for passes in (listed(), [*listed(), TurnHead()]))
        head = turned.clip.skeleton.index["mixamorig:Head"]
        changed = np.any(turned.clip.local_rotations != plain.clip.local_rotations, axis=2)
        assert set(np.flatnonzero(changed.any(axis=0))) == {head}
        starts = [span.output for span in turned.spans if span.kind == "sign"]
        expected = {frame for _, stop in starts[:-1] for frame in range(stop - 3, stop)}
        expected |= {frame for start, _ in starts[1:] for frame in range(start, start + 4)}
        assert set(np.flatnonzero(changed.any(axis=1))) == expected
        signs = [span.remade for span in turned.spans if span.kind == "sign"]
        assert all(part is not None and "mixamorig:Head" in part.joints for part in signs)
    parts = [span.remade for span in turned.spans if span.remade is not None]
    assert [part.joints for part in parts] == [("mixamorig:Head",)] * 3
    assert parts[0].frames == (starts[0][1] - 3, starts[0][1])
    assert parts[1].frames == starts[1], "several edits are one part, from the first frame to the last"


def test_a_pass_sees_what_it_did_at_the_seam_before_and_not_what_later_passes_did() -> None:
    early, late = Watch(), Watch()
    spliced(CLIPS, [*listed(), early, TurnHead(), late])
    assert [len(seam.earlier) for seam in early.seen] == [0, 0]
    assert [len(seam.earlier) for seam in late.seen] == [0, 1]
    assert late.seen[1].earlier == late.seen[0].entering


@pytest.mark.parametrize("passes", [[TurnHead()], [TurnHead(), TurnHead(0.2)]])
def test_a_stream_with_edits_is_the_same_sentence(passes: list[Pass]) -> None:
    options = SpliceOptions()
    clips = [*CLIPS, *spelled("LLB")]
    whole = spliced(clips, [*listed(options), *passes], options)
    pieces = streamed(clips, [*listed(options), *passes], options)
    assert tuple(piece.span for piece in pieces) == whole.spans
    rotations = np.concatenate([piece.clip.local_rotations for piece in pieces])
    np.testing.assert_array_equal(rotations, whole.clip.local_rotations)


def test_passes_change_no_seam_that_they_are_given() -> None:
    sentence = Sentence(SpliceOptions())
    seams = fill(sentence.passes, sentence.plan([*CLIPS, *spelled("LLB")])[1])
    first, _ = run(sentence.passes, seams)
    second, _ = run(sentence.passes, seams)
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one.new_frames.local_rotations, other.new_frames.local_rotations)
        assert [edit.joints for edit in one.edits] == [edit.joints for edit in other.edits]
    assert sum(len(seam.edits) for seam in first) > 0


def test_the_guides_pass_runs() -> None:
    section = GUIDE.read_text().split("## Add a pass")[1].split("\n## ")[0]
    (code,) = re.findall(r"```python\n# src/signsplice/splicing/\w+\.py\n(.*?)```", section, re.S)
    space: dict[str, Any] = {"__name__": "guide"}
    exec(code, space)  # as a reader would paste it
    own = space["LevelHead"]()
    others = [one for one in listed() if type(one).__name__ != type(own).__name__]
    plain, level = spliced(CLIPS, others), spliced(CLIPS, [*others, own])
    changed = np.any(level.clip.local_rotations != plain.clip.local_rotations, axis=2)
    assert set(np.flatnonzero(changed.any(axis=0))) == {level.clip.skeleton.index["mixamorig:Head"]}
    assert level.spans == plain.spans


# --- edits ---


EDITS = st.lists(
    st.tuples(st.sets(st.integers(0, 4), min_size=1, max_size=3), st.integers(0, 8), st.integers(1, 4), st.booleans()),
    max_size=5,
)


@given(EDITS, st.integers(0, 5), st.booleans())
def test_edits_compose(rows: list[tuple[set[int], int, int, bool]], split: int, moves_bones: bool) -> None:
    clip, other = random_clip(n_frames=12, n_joints=5, seed=1), random_clip(n_frames=12, n_joints=5, seed=2)
    if moves_bones:
        clip = replace(clip, translations=np.random.default_rng(0).normal(size=(12, 5, 3)))
    edits = []
    for joints, first, n, bones in rows:
        columns = sorted(joints)
        turned = other.local_rotations[first : first + n][:, columns]
        lengths = np.full((len(turned), len(columns), 3), float(first)) if bones else None
        edits.append(Edit(tuple(columns), first, turned, lengths))
    whole = apply_edits(clip, edits)
    parts = apply_edits(apply_edits(clip, edits[:split]), edits[split:])
    np.testing.assert_array_equal(whole.local_rotations, parts.local_rotations)
    assert (whole.translations is None) == (parts.translations is None)
    if whole.translations is not None and parts.translations is not None:
        np.testing.assert_array_equal(whole.translations, parts.translations)
    expected = np.array(clip.local_rotations)
    for edit in edits:  # the last one counts
        expected[edit.first_frame : edit.stop, list(edit.joints)] = edit.rotations
    np.testing.assert_array_equal(whole.local_rotations, expected)
    assert apply_edits(clip, ()) is clip
    part = describe_edits(edits, tuple("abcde"), (0, 12), 100)
    frames = [frame for edit in edits for frame in (edit.first_frame, edit.stop)]
    assert (part is None) == (not edits)
    if part is not None:
        assert part.frames == (100 + min(frames), 100 + max(frames))


# --- the frame map ---


def rising(steps: list[float]) -> np.ndarray:
    return np.round(np.concatenate([[0.0], np.cumsum(steps)]), 4)


@given(st.lists(st.floats(0.01, 3.0), min_size=2, max_size=30), st.integers(0, 5))
def test_a_frame_map_shows_every_recorded_frame_that_is_asked_for(steps: list[float], n_left_out: int) -> None:
    sources = rising(steps)
    sources[-1] = np.ceil(sources[-1])
    frames, last_recorded = FrameMap(sources, n_left_out), int(sources[-1])
    for recorded in range(last_recorded + 1):
        first, last = frames.first(recorded), frames.last(recorded)
        assert sources[first] <= recorded <= sources[last]
        assert first + 1 == len(sources) or sources[first + 1] > recorded, "no later frame would do"
        assert last == 0 or sources[last - 1] < recorded, "no earlier frame would do"
    for start, stop in pairwise(range(0, len(sources), 3)):
        low, high = frames.source(start, stop)
        assert low - n_left_out <= sources[start] <= sources[stop - 1] <= high - 1 - n_left_out
        warp = frames.warp(start, stop, 100)
        assert warp is not None
        assert [output for output, _ in warp] == list(range(100 + start - start, 100 + stop - start))
        assert [shown - n_left_out for _, shown in warp] == pytest.approx(sources[start:stop])


def test_a_frame_map_without_a_warp_is_the_identity() -> None:
    frames = FrameMap(n_left_out=3)
    assert (frames.first(7), frames.last(7), frames.source(2, 9), frames.warp(2, 9, 0)) == (7, 7, (5, 12), None)


@pytest.mark.parametrize("gloss", ["FATHER", "BOOK", "TOILET"])
def test_the_source_of_every_frame_rebuilds_the_retimed_word(gloss: str) -> None:
    clip = word(gloss).clip
    done = retime_word(AlignedWord(0, clip, clip, FrameMap()), CUTTERS["pose-velocity"], 0.6)
    sources = done.frames.sources
    assert sources is not None
    assert (np.diff(sources) > 0.0).all()
    assert (sources[0], sources[-1]) == (0.0, len(clip) - 1.0)
    np.testing.assert_array_equal(sample_clip(clip, sources).local_rotations, done.retimed.local_rotations)
    whole = done.frames.warp(0, len(sources), 0)
    assert whole is not None
    rebuilt = sample_clip(clip, np.array([source for _, source in whole]))
    np.testing.assert_array_equal(rebuilt.local_rotations, done.retimed.local_rotations)
