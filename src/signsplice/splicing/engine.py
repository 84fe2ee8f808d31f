"""Joins clips to one sentence, piece by piece: the filter layer (Huang et al. 2023, eq. 17), for any cutter and
transition.

    Y = [P_1 .. P_pre, O, Q_post .. Q_M]: frames of the first word up to pre, new frames O, the second word from post

An emitted piece never changes: a word is final as soon as the next word is known. Frames of a sign are those of its
aligned clip, bit for bit (under a tempo, slerps between them), except in the channels that the word does not own
(``person``, ``carriage``), where passes edit the hands of spelled letters, or rules change the face. Only frames of
transitions and pauses are new.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from time import perf_counter

from signsplice.body.capsules import Avatar
from signsplice.body.retarget import retarget
from signsplice.errors import InputError
from signsplice.motion import Clip, concatenate, copy_unchecked
from signsplice.rig.inspection import clip_warnings
from signsplice.rig.keyedness import judge_keyedness
from signsplice.rig.rest_pose import with_rest_pose
from signsplice.splicing.contracts import Cut, Transition, gap_at
from signsplice.splicing.durations import MAX_TRANSITION_S
from signsplice.splicing.faces import ease_face
from signsplice.splicing.landmarks import carry_points
from signsplice.splicing.options import SpliceOptions, choose
from signsplice.splicing.passes import AvoidCollisions, FillGaps, fill
from signsplice.splicing.report import with_report
from signsplice.splicing.result import FaceSources, Piece, PlannedPerson, Span, SpliceResult, measure_tempo
from signsplice.splicing.seam import ONE_CLIP, Seam, SeamScore, score_seam, seam_positions
from signsplice.splicing.sentence import Sentence
from signsplice.splicing.word import AlignedWord, FrameMap, Word, check_list

__all__ = ["MAX_TRANSITION_S", "Piece", "Span", "SpliceOptions", "SpliceResult", "Stream", "splice", "stream"]


def splice(clips: Iterable[Clip | Word], options: SpliceOptions | None = None) -> SpliceResult:
    """Joins clips in order into one continuous clip. A ``Word`` in place of a clip may add that a new spelled
    word begins, the punctuation mark at which it is held (ignored if a system splices whole words), and "raised" or
    "furrowed" brows in a question (if the options have rules for faces). Neighbouring letters (clips named fs- and the
    letter) form one spelled word.

    Raises ``InputError`` if there is no clip or an option is out of range, ``RigMismatchError`` if rigs have nothing in
    common, ``LimitError`` if a clip has too many frames at the output rate, ``TypeError`` for an item that is not a
    clip.
    """
    check_list(clips)
    sentence = Sentence(options or SpliceOptions())
    return joined_sentence(sentence, [*sentence.add(clips), *sentence.end()])


def joined_sentence(sentence: Sentence, pieces: Sequence[Piece]) -> SpliceResult:
    """Joins all pieces of a sentence. Raises ``InputError`` if there are none."""
    options = sentence.options
    tempo, system = options.tempo, options.whole_system
    if not pieces:
        raise InputError("nothing to splice, expected at least one clip")
    began = perf_counter()
    signs, n_held = list[tuple[str, tuple[int, int]]](), 0
    for span in (piece.span for piece in pieces):
        if span.kind == "sign":  # pauses are no part of the tempo
            signs.append((span.name or "", (span.output[0] - n_held, span.output[1] - n_held)))
        elif span.pause is not None:
            n_held += span.pause.frames[1] - span.pause.frames[0]
    clip = concatenate([piece.clip for piece in pieces], name=" ".join(name for name, _ in signs if name))
    last = pieces[-1].span
    if clip.channels is not None and last.kind == "retraction" and last.pause is None:  # its sign's numbers go on
        starts = tuple(start for start in clip.channels.starts if start != last.output[0])
        clip = copy_unchecked(clip, channels=replace(clip.channels, starts=starts))
    seconds = sentence.seconds | {"join": sentence.seconds["join"] + perf_counter() - began}
    cutter, transition, bundle = sentence.names
    result = SpliceResult(
        clip=clip,
        spans=tuple(piece.span for piece in pieces),
        seams=tuple(piece.seam for piece in pieces if piece.seam is not None),
        warnings=tuple(dict.fromkeys(line for piece in pieces for line in piece.warnings)),
        cutter=cutter,
        transition=transition,
        timing_ms={part: 1e3 * spent for part, spent in seconds.items()},
        bundle=bundle,
        contacts=sentence.contacts,
        tempo=measure_tempo(signs, clip.fps, tempo),
        face=None if clip.face is None else FaceSources(tuple(sentence.faces), sentence.face_rules),
        person=None if system else PlannedPerson(options.person, options.seed, sentence.planned),
        skeleton=sentence.skeleton,
        system=None if system is None else system.report_entry(),
    )
    return with_report(result)


def stream(clips: Iterable[Clip | Word], options: SpliceOptions | None = None) -> Iterator[Piece]:
    """Yields the pieces of the sentence in order, each as soon as the next clip is known; joined, they equal the result
    of ``splice`` bit for bit, with two exceptions. A cutter that chooses all seams of a sentence together
    (``LearnedCutter``, the default) sees only two words at a time here, and its choice differs if cuts chosen pair by
    pair would leave a word at an earlier frame than they enter it. And the skeleton is always the first clip's, the
    rate too, or ``stages.STREAM_FPS`` if that is higher and the first clip's too low.

    Reads ``clips`` one ahead; yields nothing without clips. Raises as ``splice`` does, on reaching the faulty clip.
    """
    growing = Stream(options)
    check_list(clips)
    for clip in clips:
        yield from growing.push(clip)
    yield from growing.end()


class Stream:
    """A sentence that grows by a word at a time: like ``stream``, but pushed instead of pulled. It holds only the last
    word and its seam, however long the sentence.

    cutter, transition: names of the methods in use.

    Raises ``InputError`` for an unknown method.
    """

    def __init__(self, options: SpliceOptions | None = None) -> None:
        self._sentence = Sentence(options or SpliceOptions(), grows=True)
        self.cutter, self.transition, _ = self._sentence.names

    def push(self, clip: Clip | Word) -> list[Piece]:
        """Adds a word and returns the pieces that are final now, none for the first word. Raises as ``splice`` does; a
        word that raises is not part of the sentence.
        """
        return self._sentence.add([clip])

    def end(self) -> list[Piece]:
        """Returns the rest of the last word; nothing if there was none or ``end`` was called before."""
        return self._sentence.end()


def inbetween(
    clip: Clip,
    gaps: Sequence[tuple[int, int]],
    transition: str | Transition | None = None,
    avoid_collisions: bool | None = None,
    bundle: str | Path | None = None,
) -> SpliceResult:
    """Replaces frames [a, b) of every gap by new frames made from the surrounding ones; other frames do not change.

    Gaps are half-open frame ranges with at least one kept frame before, between and after them; ``transition``,
    ``avoid_collisions`` and ``bundle`` as in ``SpliceOptions``. Raises ``InputError`` for other gaps.
    """
    # No word is cut and no duration chosen: these two methods open no network.
    chosen = choose("ends", transition, "fixed", bundle)
    clip = with_rest_pose(clip)
    ranges = _check_gaps(gaps, len(clip))
    entries = [0, *(stop for _, stop in ranges)]  # first frame of each kept stretch
    ends = [*(start for start, _ in ranges), len(clip)]  # and the frame after its last
    began = perf_counter()
    # Whether the clip was drawn between keys, not captured.
    keyed = judge_keyedness(*(clip[start:stop] for start, stop in zip(entries, ends, strict=True))).is_keyed
    word, planned = AlignedWord(0, clip, clip, FrameMap()), list[Seam]()
    for k, (start, stop) in enumerate(ranges):
        cut = Cut(start - 1, stop)
        gap = gap_at(clip, clip[: ends[k + 1]], cut, stop - start, entries[k], keyed)
        planned.append(Seam(ONE_CLIP, word, word, cut, gap))
    avoids = chosen.transition.learned if avoid_collisions is None else avoid_collisions
    planned = fill([FillGaps(chosen.transition), *([AvoidCollisions()] if avoids else [])], planned)
    transition_s = perf_counter() - began
    spans: list[Span] = []
    seams: list[SeamScore] = []
    pieces: list[Clip] = []
    for k, (seam, positions) in enumerate(zip(planned, seam_positions(planned), strict=True)):
        stretch, (start, stop), new = (entries[k], ends[k]), ranges[k], seam.new_frames
        if clip.face is not None:
            face = ease_face(clip.face[:start], clip.face[stop:], start - 1, 0, stop - start, clip.fps)
            new = copy_unchecked(new, face=face)
        if clip.points is not None:
            new = copy_unchecked(new, points=carry_points(clip, start - 1, new, clip, stop))
        pieces += [clip[stretch[0] : stretch[1]], new]
        spans += [Span("sign", 0, clip.name, stretch, stretch), Span("transition", None, None, None, (start, stop))]
        seams += [score for score in (score_seam(seam, positions).score,) if score is not None]
    stretch = entries[-1], len(clip)
    pieces.append(clip[stretch[0] :])
    spans.append(Span("sign", 0, clip.name, stretch, stretch))
    began = perf_counter()
    joined = concatenate(pieces, name=clip.name)
    timing = {"harmonize": 0.0, "cut": 0.0, "transition": transition_s, "join": perf_counter() - began}
    result = SpliceResult(
        clip=joined,
        spans=tuple(spans),
        seams=tuple(seams),
        warnings=(*chosen.warnings, *(f"{clip.name}: {line}" for line in clip_warnings(clip))),
        cutter="none",
        transition=chosen.transition.name,
        timing_ms={part: 1e3 * seconds for part, seconds in timing.items()},
        bundle=chosen.bundle,
    )
    return with_report(result)


def _check_gaps(gaps: Sequence[tuple[int, int]], n_frames: int) -> list[tuple[int, int]]:
    """Returns the gaps in order. Raises ``InputError`` unless frames remain before, between and after them."""
    previous_stop = 0
    for start, stop in sorted(gaps):
        if not previous_stop < start < stop < n_frames:
            raise InputError(
                f"gap {start}:{stop} in {n_frames} frames, expected {previous_stop + 1} <= A < B <= {n_frames - 1}: "
                "frames must remain before, between and after gaps"
            )
        previous_stop = stop
    return sorted(gaps)


def onto_avatar(result: SpliceResult, avatar: Avatar) -> SpliceResult:
    """Retargets a sentence to an avatar. Spans and seams stay those of the sentence; ``avatar`` of the result lists the
    contacts of the hands and whether they are kept.
    """
    done = retarget(result.clip, avatar)
    description = {"name": avatar.label, "contacts": [asdict(contact) for contact in done.contacts]}
    result = replace(result, clip=done.clip, warnings=(*result.warnings, *done.warnings), avatar=description)
    return with_report(result)
