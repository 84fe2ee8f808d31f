"""A growing sentence: words get seams, passes change these, and finished pieces are emitted (``stages``).

Cuts are chosen on words as recorded; new frames are made on words as retimed.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from time import perf_counter
from typing import Any

from signsplice.body.contacts import Contact
from signsplice.motion import Clip, FloatArray
from signsplice.rig.align import Reference
from signsplice.rig.info import rig_info
from signsplice.splicing import stages
from signsplice.splicing.carriage import POSTURE, Carriage, rotate_person
from signsplice.splicing.contracts import Cut
from signsplice.splicing.faces import BLINKS, BROWS, GAZE, Blinks, open_eyes, relax_brows, turn_eyes, with_rules
from signsplice.splicing.options import SpliceOptions, not_options
from signsplice.splicing.passes import Entering, Pass, check_order, fill, run
from signsplice.splicing.pauses import last_left
from signsplice.splicing.person import channel_joints, retract
from signsplice.splicing.result import Pause, Piece, Remade, Span
from signsplice.splicing.seam import Seam, score_seam, seam_positions
from signsplice.splicing.word import AlignedWord, Edit, HeldEnd, Word, apply_edits, as_word

_SEAMS_AT_ONCE = 32
"""Largest number of seams that are made together: more are no faster."""


class Sentence:
    """A sentence while words are added; it holds only the last word, however long the sentence.

    seconds: time spent so far by part: "harmonize" (align), "cut", "transition", "join".
    contacts: contacts of each word that was retargeted, by its index.
    faces: indices of words with a face of their own.
    face_rules: rules that animate the faces of other words.
    planned: index of each emitted word -> its channels with planned frames.
    passes: passes that change planned seams, in order.
    skeleton: as in ``SpliceResult``.
    """

    def __init__(self, options: SpliceOptions, passes: Sequence[Pass] | None = None, grows: bool = False) -> None:
        """``passes``: used instead of ``stages.passes``. ``grows``: whether clips are unknown that come later."""
        if not isinstance(options, SpliceOptions):
            raise not_options(options)
        self.options, self.seconds = options, dict.fromkeys(("harmonize", "cut", "transition", "join"), 0.0)
        self.planner = stages.Planner(options)
        self.passes = stages.passes(options, self.planner.methods) if passes is None else check_order(passes)
        self.contacts: dict[int, tuple[Contact, ...]] = {}
        self.faces: list[int] = []
        self.planned: dict[int, tuple[str, ...]] = {}
        self.face_rules, self._blinks = () if options.whole_system is not None else options.face_rules, Blinks()
        self._carriage = Carriage(options.person, options.seed)
        self.skeleton: Mapping[str, Any] | None = None
        self._n_words, self._n_out, self._grows = 0, 0, grows
        self._reference: Reference | None = None
        self._last: AlignedWord | None = None
        self._entered_by: Seam | None = None
        self._entering: Entering = ()

    @property
    def names(self) -> tuple[str, str, str | None]:
        """Names of the cutter and of the transition, and the sha256 of their bundle."""
        system, methods = self.options.whole_system, self.planner.methods
        if system is not None:
            return system.name, system.name, system.sha256
        return methods.cutter.name, methods.transition.name, methods.bundle

    def add(self, clips: Iterable[Clip | Word]) -> list[Piece]:
        """Adds words, whose cuts are chosen together, and returns the pieces that are final now. Seams are made some at
        a time, since a word takes several times its frames in memory meanwhile.
        """
        words, cuts = self._cut(clips)
        if self._last is None:
            self._count(words[:1])
            self._last, words = (words[0], words[1:]) if words else (None, words)
        pieces = list[Piece]()
        # A system names all pairs without a splice.
        most = _SEAMS_AT_ONCE if self.options.whole_system is None else len(words)
        while words:
            part, part_cuts = words[:most], cuts[:most]
            del words[:most], cuts[:most]
            began = perf_counter()
            assert self._last is not None
            seams = fill(self.passes, self.planner.seams([self._last, *part], part_cuts))
            self.seconds["transition"] += perf_counter() - began
            seams = self.finish(part, seams)
            began = perf_counter()
            positions = seam_positions(seams)
            self.seconds["join"] += perf_counter() - began
            pieces += self.pieces(seams, positions)
        return pieces

    def plan(self, clips: Iterable[Clip | Word]) -> tuple[list[AlignedWord], list[Seam]]:
        """Aligns further words and plans their seams, including the one with the last word, without making frames. The
        words are not part of the sentence yet.
        """
        words, cuts = self._cut(clips)
        began = perf_counter()
        seams = self.planner.seams(words if self._last is None else [self._last, *words], cuts) if words else []
        self.seconds["transition"] += perf_counter() - began
        return words, seams

    def _cut(self, clips: Iterable[Clip | Word]) -> tuple[list[AlignedWord], list[Cut]]:
        """Aligns further words and chooses their cuts, including the one with the last word."""
        unaligned = [as_word(clip, n) for n, clip in enumerate(clips, self._n_words)]
        if not unaligned:
            return [], []
        began, to, warnings = perf_counter(), self._reference, tuple[str, ...]()
        if to is None:
            to, self.skeleton, warnings = self.planner.reference([word.clip for word in unaligned], self._grows)
        self.seconds["harmonize"] += perf_counter() - began
        words = [self._align(word, n, to) for n, word in enumerate(unaligned, self._n_words)]
        words[0] = replace(words[0], warnings=(*warnings, *words[0].warnings))
        self._reference = to  # only now: a word that raises must not set it
        began = perf_counter()
        cuts = self.planner.cuts(words if self._last is None else [self._last, *words])
        self.seconds["cut"] += perf_counter() - began
        return words, cuts

    def finish(self, words: Sequence[AlignedWord], filled: Sequence[Seam]) -> list[Seam]:
        """Applies the remaining passes to the seams and makes the words part of the sentence; ``filled``: the planned
        seams after the passes that batch.
        """
        began = perf_counter()
        seams, self._entering = run(self.passes, filled, self._entering)
        self.seconds["transition"] += perf_counter() - began
        self._count(words)
        if self._last is None and words:
            self._last = words[0]
        return seams

    def _count(self, words: Sequence[AlignedWord]) -> None:
        """Makes words part of the sentence."""
        self._n_words += len(words)
        self.contacts |= {word.index: word.contacts for word in words if word.contacts}
        self.faces += [word.index for word in words if word.clip.face is not None]

    def pieces(self, seams: Sequence[Seam], positions: Sequence[FloatArray]) -> list[Piece]:
        """Returns the pieces of all finished words but the last; ``positions``: ``seam_positions`` of their seams."""
        began, pieces = perf_counter(), list[Piece]()
        for seam, seen in zip(seams, positions, strict=True):
            before, stop = seam.before, seam.retimed_cut.pre + 1
            sign = _sign_piece(before, self._entered_by, (*seam.earlier, *seam.leaving), stop, self._n_out)
            made = [sign]
            if seam.frames is not None:
                output = sign.span.output[1], sign.span.output[1] + seam.gap.n_frames
                made.append(_transition_piece(seam.frames, output, seam.n_held, before.held))
            sign, *new = self._carry(made, before, slice(before.first_frame, stop + seam.n_held), seam.after)
            waits = before.held is not None  # a blink for the pause that follows
            pieces.append(self._emit_piece(sign, () if waits else (before,)))
            pieces += [self._emit_piece(piece, (before, seam.after)) for piece in new]
            self._last, self._entered_by = seam.after, score_seam(seam, seen)
        self.seconds["join"] += perf_counter() - began
        return pieces

    def end(self) -> list[Piece]:
        """Returns the rest of the last word: its sign, and its retraction if there is one."""
        word, entered_by = self._last, self._entered_by
        self._last = self._entered_by = None
        self._entering = ()
        if word is None:
            return []
        began, last = perf_counter(), len(word.clip) - 1
        if self.options.whole_system is None:
            last = last_left(word, self.planner.methods.cutter, self.options.sign_speed)
            is_alone = entered_by is None  # then it is its clip
            word = replace(word, planned=()) if is_alone else retract(word, self.options.leads_arms)
        cut = perf_counter()
        edits, n_frames = () if entered_by is None else entered_by.entering, len(word.retimed)
        sign = _sign_piece(word, entered_by, edits, n_frames, self._n_out)
        if entered_by is not None:
            (sign,) = self._carry([sign], word, slice(word.first_frame, n_frames), None)
        self._carriage = Carriage(self.options.person, self.options.seed)
        # Rules for the face see a retraction by itself only if it begins with a pause.
        pieces = [sign] if word.held is None else _last_pieces(sign, word, edits, last)
        if self.face_rules and word.face_by_rules:
            pieces[-1] = relax_brows(pieces[-1])
        pieces = [self._emit_piece(piece, (word,) if piece is pieces[-1] else (), is_last=True) for piece in pieces]
        if word.held is None:
            pieces = _last_pieces(pieces[0], word, edits, last)
        self.seconds["cut"] += cut - began
        self.seconds["join"] += perf_counter() - cut
        return pieces

    def _align(self, given: Word, index: int, to: Reference) -> AlignedWord:
        """Aligns a word to the first one, brings it to the chosen tempo, holds it at its mark, and gives it a face."""
        began = perf_counter()
        word = self.planner.align(given.clip, index, to)
        aligned = perf_counter()
        word = self.planner.time(word, given)
        self.seconds["harmonize"] += aligned - began
        self.seconds["cut"] += perf_counter() - aligned
        if not index:
            word = replace(word, warnings=(*self.planner.methods.warnings, *word.warnings))
        if self.face_rules:
            said = self.options.pronunciations if word.clip.face is None else None
            others = [] if said is None else [said.mouth(word, self.planner.methods.cutter)]
            if GAZE in self.face_rules and self.options.moves_person:
                others.append(open_eyes(len(word.retimed)))
            word = with_rules(word, given.brow if BROWS in self.face_rules else None, index == 0, *others)
        return word

    def _carry(self, pieces: Sequence[Piece], word: AlignedWord, kept: slice, after: AlignedWord | None) -> list[Piece]:
        """Returns the pieces of a word and of the transition to the word ``after`` with the motion of the person.
        ``kept``: the retimed frames of the word, with its pause, that they begin with.
        """
        if word.planned:
            self.planned[word.index] = word.planned
        if not (self.options.moves_person and rig_info(word.clip.skeleton).has_arms):
            return list(pieces)
        n_frames = sum(len(piece.clip) for piece in pieces)
        angles, looks = self._carriage.move(n_frames, word, kept, after)
        carried, start = list[Piece](), 0
        for piece in pieces:
            frames = slice(start, start := start + len(piece.clip))
            clip = rotate_person(piece.clip, angles[frames])
            if GAZE in self.face_rules and looks[frames].any():
                clip = turn_eyes(clip, looks[frames] / POSTURE.eyes_deg)
            carried.append(replace(piece, clip=clip))
        return carried

    def _emit_piece(self, piece: Piece, words: Sequence[AlignedWord], is_last: bool = False) -> Piece:
        """Returns a piece as emitted, with a blink if one is due and the faces of its ``words`` are by rule."""
        self._n_out = piece.span.output[1]
        if BLINKS in self.face_rules and words and all(word.face_by_rules for word in words):
            piece, self._blinks = self._blinks.on(piece, is_last)
        return piece


def _sign_piece(word: AlignedWord, entered_by: Seam | None, edits: Sequence[Edit], stop: int, output: int) -> Piece:
    """Makes the piece of a word from its entry to its retimed frame ``stop``, with its ``edits``; ``entered_by``: the
    seam before it, None before the first word; ``output``: frame of the sentence at which it begins.
    """
    start = word.first_frame
    span = _span(word, edits, (start, stop), output)
    score = None if entered_by is None else entered_by.score
    return Piece(apply_edits(word.retimed, edits)[start:stop], span, score, word.warnings)


def _span(word: AlignedWord, edits: Sequence[Edit], frames: tuple[int, int], output: int) -> Span:
    """Makes the span of a sign: a word's retimed ``frames``, half-open, from frame ``output`` of the sentence on."""
    start, stop = frames
    remade = describe_edits(edits, word.clip.skeleton.names, frames, output) if edits else None
    if word.planned:
        joints = {joint for channel in word.planned for joint in channel_joints(word.clip, channel)}
        names = {word.clip.skeleton.names[joint] for joint in joints} | {*(remade.joints if remade else ())}
        remade = Remade(
            tuple(name for name in word.clip.skeleton.names if name in names), (output, output + stop - start)
        )
    return Span(
        kind="sign",
        clip=word.index,
        name=word.clip.name,
        source=word.frames.source(start, stop),
        output=(output, output + stop - start),
        warp=word.frames.warp(start, stop, output),
        remade=remade,
    )


def _transition_piece(new: Clip, output: tuple[int, int], n_held: int, held: HeldEnd | None) -> Piece:
    """Makes the piece of new frames, frames ``output`` of the sentence, half-open; the first ``n_held`` are the pause
    of a word that is ``held``.
    """
    pause = Pause(held.mark, (output[0], output[0] + n_held)) if held is not None and n_held else None
    return Piece(new, Span("transition", None, None, None, output, pause=pause))


def _last_pieces(whole: Piece, word: AlignedWord, edits: Sequence[Edit], last: int) -> list[Piece]:
    """Splits the piece of a sentence's last word, with its ``edits``, after its recorded frame ``last``: the sign, and
    if frames follow, the retraction, which begins with the pause of a word that is held.
    """
    start, stop, n_frames = word.first_frame, word.frames.last(last) + 1, len(word.retimed)
    if stop >= n_frames:
        return [whole]
    begin = whole.span.output[0] + stop - start
    n_held = 0 if word.held is None else max(0, word.frames.last(word.held.leave) + 1 - stop)
    pause = Pause(word.held.mark, (begin, begin + n_held)) if word.held is not None and n_held else None
    sign = replace(whole, clip=whole.clip[: stop - start], span=_span(word, edits, (start, stop), whole.span.output[0]))
    retraction = replace(_span(word, edits, (stop, n_frames), begin), kind="retraction", pause=pause)
    return [sign, Piece(whole.clip[stop - start :], retraction)]


def describe_edits(edits: Sequence[Edit], names: Sequence[str], frames: tuple[int, int], output: int) -> Remade | None:
    """Describes the edits in a span of a word's retimed ``frames``, the first of which is frame ``output`` of the
    sentence; None if it holds none. Several edits are joined to one, from the first frame to the last.
    """
    start, stop = frames
    inside = [edit for edit in edits if edit.first_frame < stop and edit.stop > start]
    if not inside:
        return None
    joints = sorted({joint for edit in inside for joint in edit.joints})
    first = max(start, min(edit.first_frame for edit in inside))
    last = min(stop, max(edit.stop for edit in inside))
    return Remade(tuple(names[joint] for joint in joints), (first - start + output, last - start + output))
