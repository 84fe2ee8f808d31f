"""Clips -> one sentence, piece by piece: the filter layer of the paper's eq. 17, for any cutter and transition.

    Y = [P_1 .. P_pre, O, Q_post .. Q_M]

A piece that has come out never changes: what a word becomes is settled as soon as the next word is known. Frames of a
sign are those of its harmonized clip, bit for bit; only transition frames are new.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

from signsplice.errors import InputError
from signsplice.motion.clip import Clip, concatenate
from signsplice.rig.align import Reference, align, reference
from signsplice.splicing import methods
from signsplice.splicing.cut import Cut, Cutter, cuts_together
from signsplice.splicing.duration import HUMAN_MEDIAN_S, Duration
from signsplice.splicing.filling import CONTEXT, FilledGap, fill, n_shown_frames
from signsplice.splicing.seam import Seam, score
from signsplice.splicing.transition import Gap, Transition

MAX_TRANSITION_S = 10.0


@dataclass(frozen=True)
class SpliceOptions:
    """What one call wants.

    cutter, transition, duration: by name, or any object of those protocols; None: learned ones, or classical ones where
    these cannot be read (``defaults``). bundle: folder of the networks, by default those that ship. transition_time:
    seconds that stand in for the duration. sign_speed: how many times as fast signs play. fps: output rate, the first
    clip's by default. avoid_collisions: whether hands are led around head, trunk and each other (``avoid_collisions``); None: where
    the transition is learned.
    """

    cutter: str | Cutter | None = None
    transition: str | Transition | None = None
    duration: str | Duration | None = None
    bundle: str | Path | None = None
    transition_time: float | None = None
    sign_speed: float = 1.0
    fps: float | None = None
    avoid_collisions: bool | None = None

    def __post_init__(self) -> None:
        limits = (
            ("transition time", self.transition_time, 0.0, MAX_TRANSITION_S, "s"),
            ("sign speed", self.sign_speed, 0.1, 10.0, ""),
            ("fps", self.fps, 1.0, 1000.0, ""),
        )
        for what, value, least, most, unit in limits:
            if value is not None and not least <= value <= most:
                raise InputError(f"{what} {value:g}{unit}, expected {least:g} to {most:g}{unit}")


@dataclass(frozen=True)
class Span:
    """Where a stretch of the output comes from; frame ranges are half-open.

    kind: "sign" or "transition". clip: index of the source clip, name: its name. source: frames of that clip, counted
    at the output rate. output: frames of the output.
    """

    kind: str
    clip: int | None
    name: str | None
    source: tuple[int, int] | None
    output: tuple[int, int]


@dataclass(frozen=True, eq=False)
class Piece:
    """A stretch of finished frames. ``seam`` comes with the sign that follows a transition; warnings: about its
    clip.
    """

    clip: Clip
    span: Span
    seam: Seam | None = None
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class SpliceResult:
    """A spliced sentence: its clip, where each frame comes from, how good each seam is, and what had to be said.

    timing_ms: time spent in harmonize, cut, transition and join. bundle: sha256 of the networks that worked, None where
    none did.
    """

    clip: Clip
    spans: tuple[Span, ...]
    seams: tuple[Seam, ...]
    warnings: tuple[str, ...]
    cutter: str
    transition: str
    timing_ms: dict[str, float]
    bundle: str | None = None


def splice(clips: Iterable[Clip], options: SpliceOptions | None = None) -> SpliceResult:
    """Clips in order joined into one continuous clip.

    Raises ``InputError`` where there is no clip or an option is out of range, ``RigMismatchError`` where rigs have
    nothing in common.
    """
    sentence = _SentenceBuilder(options or SpliceOptions())
    pieces = [*sentence.add(clips, whole=True), *sentence.end()]
    if not pieces:
        raise InputError("nothing to splice, expected at least one clip")
    with sentence.timed("join"):
        names = [piece.span.name for piece in pieces if piece.span.name]
        clip = concatenate([piece.clip for piece in pieces], name=" ".join(names))
    return SpliceResult(
        clip=clip,
        spans=tuple(piece.span for piece in pieces),
        seams=tuple(piece.seam for piece in pieces if piece.seam is not None),
        warnings=tuple(dict.fromkeys(line for piece in pieces for line in piece.warnings)),
        cutter=sentence.cutter.name,
        transition=sentence.transition.name,
        timing_ms={part: 1e3 * sentence.seconds[part] for part in ("harmonize", "cut", "transition", "join")},
        bundle=sentence.methods.bundle,
    )


def stream(clips: Iterable[Clip], options: SpliceOptions | None = None) -> Iterator[Piece]:
    """Pieces of the sentence in order, each as soon as the next clip is known; joined, they are what ``splice`` gives.
    A cutter that chooses all seams of a sentence together sees two words at a time here and may choose otherwise; a
    transition that fills all gaps in one go makes the same frames up to rounding.

    Reads ``clips`` one ahead; without any, nothing comes. Raises as ``splice`` does, at the clip that is wrong.
    """
    growing = Stream(options)
    for clip in clips:
        yield from growing.push(clip)
    yield from growing.end()


class Stream:
    """A sentence that grows a word at a time, for callers that are told of words as they come: what ``stream`` gives,
    pushed in place of pulled. It holds one word and no more, however long the sentence.

    cutter, transition: names of what does the work. Raises ``InputError`` for a method that there is not.
    """

    def __init__(self, options: SpliceOptions | None = None) -> None:
        self._sentence = _SentenceBuilder(options or SpliceOptions())
        self.cutter, self.transition = self._sentence.cutter.name, self._sentence.transition.name

    def push(self, clip: Clip) -> list[Piece]:
        """The pieces that are final now that one more word is known: none for the first. Raises as ``splice`` does;
        the word that is wrong is then not part of the sentence.
        """
        return list(self._sentence.add([clip]))

    def end(self) -> list[Piece]:
        """The rest of the last word; nothing where there was none, or where it was taken already."""
        return list(self._sentence.end())


@dataclass(eq=False)
class _SentenceWord:
    """A word of a sentence on its ground: the frame at which it is entered, and the seam by which."""

    index: int
    clip: Clip
    warnings: tuple[str, ...]
    entry: int = 0
    seam: Seam | None = None


@dataclass(frozen=True, eq=False)
class _PlannedSeam:
    """Two words, where they are left and entered, the new frames between, and what has to be said."""

    before: _SentenceWord
    after: _SentenceWord
    cut: Cut
    n_frames: int
    warnings: tuple[str, ...]

    @property
    def kept(self) -> Clip:
        """The last frames kept of the word before, as many as a transition is shown."""
        stop = self.cut.pre + 1
        return self.before.clip[max(self.before.entry, stop - n_shown_frames(self.before.clip.fps)) : stop]

    @property
    def follows(self) -> Clip:
        """The first frames kept of the word after."""
        return self.after.clip[self.cut.post : self.cut.post + n_shown_frames(self.after.clip.fps)]

    @property
    def gap(self) -> Gap:
        """What a transition is asked."""
        return self.kept, self.follows, self.n_frames


@dataclass
class _SentenceBuilder:
    """One sentence in the making."""

    options: SpliceOptions
    seconds: dict[str, float] = field(default_factory=lambda: defaultdict(float))
    _n_out: int = 0
    _n_words: int = 0
    _onto: Reference | None = None
    _last: _SentenceWord | None = None

    def __post_init__(self) -> None:
        options = self.options
        self.methods = methods.choose(options.cutter, options.transition, options.duration, options.bundle)
        self.cutter, self.transition = self.methods.cutter, self.methods.transition

    @contextmanager
    def timed(self, part: str) -> Iterator[None]:
        start = time.perf_counter()
        yield
        self.seconds[part] += time.perf_counter() - start

    def add(self, clips: Iterable[Clip], whole: bool = False) -> Iterator[Piece]:
        """The pieces that are final once these words are known too; ``whole``: they are all, so that seams are chosen
        together, and filled in one go.
        """
        words = [self._word(clip, self._n_words + k) for k, clip in enumerate(clips)]
        row = words if self._last is None else [self._last, *words]
        joins = self._joins(row, whole)
        filled = self._fill(joins)
        self._n_words += len(words)
        self._last = row[-1] if row else None
        for join, new in zip(joins, filled, strict=True):
            yield self._sign(join.before, join.cut.pre + 1)
            join.after.seam = self._score(join, new)
            if new is not None:
                yield Piece(new.clip, self._span("transition", None, None, None, len(new.clip)))

    def end(self) -> Iterator[Piece]:
        """The rest of the last word."""
        last, self._last = self._last, None
        if last is not None:
            yield self._sign(last, len(last.clip))

    def _word(self, clip: Clip, index: int) -> _SentenceWord:
        """A clip on the first one's ground."""
        with self.timed("harmonize"):
            onto = self._onto or reference(clip, self.options.fps)
            harmonized = align(clip, onto, self.options.sign_speed)
            self._onto = onto
        said = harmonized.warnings if index else (*self.methods.warnings, *harmonized.warnings)
        return _SentenceWord(index, harmonized.clip, said)

    def _joins(self, words: Sequence[_SentenceWord], whole: bool) -> list[_PlannedSeam]:
        """Where words in order are joined; every word is told at which frame it is entered."""
        joins = []
        for (before, after), cut in zip(pairwise(words), self._cuts([word.clip for word in words], whole), strict=True):
            n_before, n_after = len(before.clip), len(after.clip)
            if not (0 <= cut.pre < n_before and 0 <= cut.post < n_after):
                raise InputError(f"cutter {self.cutter.name} chose {cut} for clips of {n_before} and {n_after} frames")
            # Never before the frame at which the word itself was entered.
            cut = Cut(max(cut.pre, before.entry), cut.post)
            after.entry = cut.post
            with self.timed("transition"):
                n_frames, warnings = self._n_frames(before.clip, after.clip, cut)
            if cut.pre <= before.entry and before.entry > 0:
                told = (
                    f"{before.clip.name} is left where it was entered, at frame {before.entry}: only that frame is kept"
                )
                warnings = (*warnings, told)
            joins.append(_PlannedSeam(before, after, cut, n_frames, warnings))
        return joins

    def _cuts(self, clips: Sequence[Clip], whole: bool) -> Iterable[Cut]:
        """The cutter's choice for every two clips; together where it can, and all words are there."""
        with self.timed("cut"):
            if not (whole and len(clips) > 1 and cuts_together(self.cutter)):
                return [self.cutter.cut(before, after) for before, after in pairwise(clips)]
            cuts = self.cutter.cuts(clips)
        if len(cuts) != len(clips) - 1:
            raise InputError(f"cutter {self.cutter.name} chose {len(cuts)} cuts for {len(clips)} clips")
        return cuts

    def _fill(self, joins: Sequence[_PlannedSeam]) -> list[FilledGap | None]:
        """The transition of every join, None where it has no frames."""
        with self.timed("transition"):
            gaps = [join.gap for join in joins if join.n_frames]
            filled = iter(fill(self.transition, gaps, self.options.avoid_collisions))
            return [next(filled) if join.n_frames else None for join in joins]

    def _score(self, join: _PlannedSeam, filled: FilledGap | None) -> Seam:
        before, after, cut = join.before, join.after, join.cut
        with self.timed("join"):
            kept, follows = join.kept[-CONTEXT:], join.follows[:CONTEXT]
            names = before.clip.name, after.clip.name
            if filled is None:
                return score(concatenate([kept, follows]), len(kept), 0, *names, cut, join.warnings)
            window, said = concatenate([kept, filled.clip, follows]), (*join.warnings, *filled.warnings)
            return score(window, len(kept), join.n_frames, *names, cut, said, filled.depth)

    def _n_frames(self, before: Clip, after: Clip, cut: Cut) -> tuple[int, tuple[str, ...]]:
        """Number of transition frames: the user's time, or the rule's; the human median where the rig has no known
        arms.
        """
        if self.options.transition_time is not None:
            return round(self.options.transition_time * before.fps), ()
        try:
            seconds = self.methods.duration.seconds(before, after, cut)
        except InputError:
            return max(1, round(HUMAN_MEDIAN_S * before.fps)), (
                f"no arms known in {before.name}: the transition takes {HUMAN_MEDIAN_S:g} s, whatever the travel",
            )
        return max(1, round(min(seconds, MAX_TRANSITION_S) * before.fps)), ()

    def _sign(self, word: _SentenceWord, stop: int) -> Piece:
        with self.timed("join"):
            span = self._span("sign", word.index, word.clip.name, (word.entry, stop), stop - word.entry)
            return Piece(word.clip[word.entry : stop], span, word.seam, word.warnings)

    def _span(
        self, kind: str, clip: int | None, name: str | None, source: tuple[int, int] | None, n_frames: int
    ) -> Span:
        start, self._n_out = self._n_out, self._n_out + n_frames
        return Span(kind, clip, name, source, (start, self._n_out))
