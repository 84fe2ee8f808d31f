"""A sentence that grows: clips become words, words get seams, passes change them, and pieces come out (``stages``).

Cuts are chosen on words as they were recorded, frames made on words as they are retimed.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from time import perf_counter

from signsplice.body.contacts import Contact
from signsplice.motion import Clip, FloatArray
from signsplice.rig.align import Reference
from signsplice.splicing import stages
from signsplice.splicing.face_rules import BLINKS, BROWS, Blinks, released, with_rules
from signsplice.splicing.gap import FilledGap, Gap
from signsplice.splicing.joins.join import PlannedSeam
from signsplice.splicing.options import SpliceOptions, not_a_clip, not_clips, not_options
from signsplice.splicing.passes.pauses import with_pause
from signsplice.splicing.passes.seam_pass import Entering, Pass, run, split
from signsplice.splicing.pieces import OpenWord, last_pieces, scored, sign_piece, transition_piece
from signsplice.splicing.result import Piece
from signsplice.splicing.seam import seam_positions
from signsplice.splicing.tempo import seconds_a_sign
from signsplice.splicing.words.pace import retimed
from signsplice.splicing.words.word import SentenceWord


@dataclass(frozen=True, eq=False)
class PlannedWords:
    """Words that are to be added to a sentence, before any frame is made.

    words: the new words.
    seams: their seams in order, that of the first new word with the word before it among them.
    """

    words: Sequence[SentenceWord]
    seams: Sequence[PlannedSeam]

    @property
    def gaps(self) -> list[Gap]:
        """The gaps for which frames have to be made."""
        return [seam.gap for seam in self.seams if seam.is_open]


class SentenceBuilder:
    """A sentence while words are added to it; it holds the last word alone, however long the sentence.

    seconds: time spent so far by part: "harmonize" (align), "cut", "transition", "join".
    contacts: of each word that was brought to another body, by its index.
    faces: indices of words with a face of their own.
    face_rules: rules by which the others have one.
    gap_passes, seam_passes: what happens to planned seams, in order.
    """

    def __init__(self, options: SpliceOptions, passes: Sequence[Pass] | None = None) -> None:
        """``passes``: in place of ``stages.passes``."""
        if not isinstance(options, SpliceOptions):
            raise not_options(options)
        self.options, self.seconds = options, dict.fromkeys(("harmonize", "cut", "transition", "join"), 0.0)
        self.methods = stages.chosen_methods(options)
        self.gap_passes, self.seam_passes = split(stages.passes(options, self.methods) if passes is None else passes)
        self.contacts: dict[int, tuple[Contact, ...]] = {}
        self.faces: list[int] = []
        self.face_rules, self._blinks = () if options.system is not None else options.face_rules, Blinks()
        self._aligner, self._planner = stages.word_aligner(options), stages.planner(options, self.methods)
        self._seconds_a_sign = seconds_a_sign(options.tempo)
        self._n_words = self._n_out = 0
        self._reference: Reference | None = None
        self._last: OpenWord | None = None
        self._entering: Entering = ()

    @property
    def names(self) -> tuple[str, str, str | None]:
        """Names of what cuts and of what makes the frames, and the sha256 of the bundle that they come from."""
        system = self.options.system
        if system is not None:
            return system.name, system.name, system.sha256
        return self.methods.cutter.name, self.methods.transition.name, self.methods.bundle

    def add(
        self,
        clips: Iterable[Clip],
        starts: Collection[int] = (),
        pauses: Mapping[int, str] | None = None,
        brows: Mapping[int, str] | None = None,
    ) -> list[Piece]:
        """The pieces that are final once these words are known too; their seams are chosen together."""
        planned = self.plan(clips, starts, pauses, brows)
        began = perf_counter()
        filled = self.gap_passes.fill(planned.gaps)
        began = self._count("transition", began)
        seams = self.finish(planned, filled)
        began = perf_counter()
        positions = seam_positions([(seam.gap, seam.filled) for seam in seams])
        self._count("join", began)
        return self.pieces(seams, positions)

    def plan(
        self,
        clips: Iterable[Clip],
        starts: Collection[int] = (),
        pauses: Mapping[int, str] | None = None,
        brows: Mapping[int, str] | None = None,
    ) -> PlannedWords:
        """Further words with their seams, before any frame is made. They are no part of the sentence yet. ``starts``,
        ``pauses``, ``brows``: as in ``splice``, counted from the first of these clips.
        """
        if isinstance(clips, (Clip, str)):
            raise not_clips(clips)
        new = [self._word(clip, self._n_words + k, k in starts, (pauses or {}).get(k)) for k, clip in enumerate(clips)]
        if self.face_rules:
            asked = brows or {} if BROWS in self.face_rules else {}
            new = [with_rules(word, asked.get(k), word.index == 0) for k, word in enumerate(new)]
        words = new if self._last is None else [self._last.word, *new]
        began = perf_counter()
        cuts = self._planner.cuts(words)
        began = self._count("cut", began)
        seams = self._planner.plan(words, cuts)
        self._count("transition", began)
        return PlannedWords(new, seams)

    def finish(self, planned: PlannedWords, filled: Sequence[FilledGap]) -> list[PlannedSeam]:
        """The seams of planned words after all passes, from the frames that ``gap_passes`` made for their gaps. From
        here on the words are part of the sentence.
        """
        began, new_frames = perf_counter(), iter(filled)
        seams = [_with_frames(seam, next(new_frames)) if seam.is_open else seam for seam in planned.seams]
        seams, self._entering = run(self.seam_passes, seams, self._entering)
        self._count("transition", began)
        self._n_words += len(planned.words)
        self.contacts |= {word.index: word.contacts for word in planned.words if word.contacts}
        self.faces += [word.index for word in planned.words if word.clip.face is not None]
        if self._last is None and planned.words:
            self._last = OpenWord(planned.words[0])
        return seams

    def pieces(self, seams: Sequence[PlannedSeam], positions: Sequence[FloatArray]) -> list[Piece]:
        """The pieces of finished words but the last; ``positions`` are ``seam_positions`` of their seams."""
        began, out = perf_counter(), list[Piece]()
        for seam, seen in zip(seams, positions, strict=True):
            assert self._last is not None, "set by ``finish``"
            stop = seam.retimed_cut.pre + 1
            sign = sign_piece(self._last, (*seam.earlier, *seam.leaving), stop, self._n_out)
            waits = seam.before.held is not None  # a blink for the pause that follows
            out.append(self._put_out(sign, seam.before.face_by_rules and not waits))
            if seam.filled is not None:
                new, held = seam.filled.clip, seam.before.held
                by_rules = seam.before.face_by_rules and seam.after.face_by_rules
                out.append(self._put_out(transition_piece(new, self._n_out, seam.n_held, held), by_rules))
            self._last = OpenWord(seam.after, scored(seam, seen), seam.entering)
        self._count("join", began)
        return out

    def end(self) -> list[Piece]:
        """The rest of the last word."""
        last, self._last, self._entering = self._last, None, ()
        if last is None:
            return []
        began = perf_counter()
        pieces, by_rules = last_pieces(last, self._n_out), last.word.face_by_rules
        if by_rules:
            pieces[-1] = released(pieces[-1])
        pieces = [self._put_out(piece, by_rules and piece is pieces[-1], is_last=True) for piece in pieces]
        self._count("join", began)
        return pieces

    def _word(self, clip: Clip, index: int, starts: bool, mark: str | None = None) -> SentenceWord:
        """A clip as a word: aligned to the first one, at the tempo asked for, and held before a ``mark``."""
        if not isinstance(clip, Clip):
            raise not_a_clip(clip, index)
        began = perf_counter()
        word, first = self._aligner.word(clip, index, self._reference)
        began = self._count("harmonize", began)
        if self._seconds_a_sign is not None:
            word = retimed(word, self.methods.cutter, self._seconds_a_sign)
        if mark is not None and self.options.system is None:
            word = with_pause(word, mark, self.methods.cutter, self.options.sign_speed)
        self._count("cut", began)
        self._reference = first  # only now: a word that was refused sets nothing
        warnings = word.warnings if index else (*self.methods.warnings, *word.warnings)
        return replace(word, starts=starts, warnings=warnings)

    def _count(self, part: str, began: float) -> float:
        """Count the time since ``began`` to a part of the work; the time now."""
        now = perf_counter()
        self.seconds[part] += now - began
        return now

    def _put_out(self, piece: Piece, by_rules: bool, is_last: bool = False) -> Piece:
        """A piece as it is put out, with a blink in a face ``by_rules`` where one is due."""
        self._n_out = piece.span.output[1]
        if by_rules and BLINKS in self.face_rules:
            piece, self._blinks = self._blinks.on(piece, is_last)
        return piece


def _with_frames(seam: PlannedSeam, filled: FilledGap) -> PlannedSeam:
    """A seam with the frames that were made for its gap, which may be more than planned."""
    return replace(seam, gap=replace(seam.gap, n_frames=len(filled.clip)), filled=filled)
