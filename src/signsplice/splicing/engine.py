"""Clips -> one sentence, piece by piece: the filter layer of the paper's eq. 17, for any cutter and transition.

    Y = [P_1 .. P_pre, O, Q_post .. Q_M]: frames of the first word up to pre, new frames O, the second word from post

A piece that has been put out never changes: a word is settled as soon as the next word is known. Frames of a sign are
those of its aligned clip, bit for bit; only transition frames are new, and the arm of a hand that is idle, where it is
given more time (``free_hand``).
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Literal

from signsplice.body.contacts import Contact
from signsplice.body.retarget import align
from signsplice.errors import FormatError, InputError
from signsplice.formats.limits import DEFAULT_LIMITS, ReadLimits
from signsplice.motion.clip import Clip, concatenate
from signsplice.rig.align import Reference, reference
from signsplice.splicing import free_hand, methods
from signsplice.splicing.cut import Cut, Cutter
from signsplice.splicing.duration import HUMAN_MEDIAN_S, Duration
from signsplice.splicing.filling import FilledGap, fill
from signsplice.splicing.free_hand import ArmStretch, Remade
from signsplice.splicing.gap import Gap, gap_at
from signsplice.splicing.learned import NAME
from signsplice.splicing.seam import Seam, score
from signsplice.splicing.transition import Transition

MAX_TRANSITION_S = 10.0


@dataclass(frozen=True)
class SpliceOptions:
    """What one call wants.

    cutter, transition, duration: a name, or an object of that class; None: the learned one, or the classical default
        where the networks cannot be read (``methods.choose``).
    bundle: folder of the networks; None: those that ship.
    transition_time: length of every transition, seconds, in place of the duration.
    sign_speed: how many times as fast signs play.
    fps: output rate; None: the first clip's.
    avoid_collisions: whether hands are led around head, trunk and each other; None: where the transition is learned.
    free_hand: how much time a hand has that only goes to rest at a seam, or comes from it. "transition": that of the
        transition, which is lengthened where the hand would pass 2.2 m/s, unless the call names a transition or a time;
        "natural": frames of the signs too, as long as the hand rests in them.
    limits: how many frames a clip may have at the output rate.

    Raises ``InputError`` for a number out of range.
    """

    cutter: str | Cutter | None = None
    transition: str | Transition | None = None
    duration: str | Duration | None = None
    bundle: str | Path | None = None
    transition_time: float | None = None
    sign_speed: float = 1.0
    fps: float | None = None
    avoid_collisions: bool | None = None
    free_hand: str = free_hand.TRANSITION
    limits: ReadLimits = DEFAULT_LIMITS

    def __post_init__(self) -> None:
        limits = (
            ("transition time", self.transition_time, 0.0, MAX_TRANSITION_S, "s"),
            ("sign speed", self.sign_speed, 0.1, 10.0, ""),
            ("fps", self.fps, 1.0, 1000.0, ""),
        )
        for what, value, least, most, unit in limits:
            if value is not None and not least <= value <= most:
                raise InputError(f"{what} {value:g}{unit}, expected {least:g} to {most:g}{unit}")
        if self.free_hand not in free_hand.FREE_HANDS:
            raise InputError(f"free hand {self.free_hand!r}, expected one of {', '.join(free_hand.FREE_HANDS)}")

    @property
    def lengthens(self) -> bool:
        """Whether transitions are lengthened for an idle hand: the call names neither them nor their time."""
        chosen = (self.transition, None if self.duration == methods.AUTO else self.duration)
        return self.transition_time is None and all(name in (None, NAME) for name in chosen)


@dataclass(frozen=True)
class Span:
    """Where a stretch of the output comes from; frame ranges are half-open.

    kind: "sign" or "transition".
    clip: index of the source clip; None for a transition.
    name: name of the source clip; None for a transition.
    source: frames of that clip, counted at the output rate; None for a transition.
    output: frames of the output.
    remade: an idle arm whose frames are not those of the clip; None where all are.
    """

    kind: Literal["sign", "transition"]
    clip: int | None
    name: str | None
    source: tuple[int, int] | None
    output: tuple[int, int]
    remade: Remade | None = None


@dataclass(frozen=True, eq=False)
class Piece:
    """A stretch of finished frames.

    clip: the frames.
    span: where they come from.
    seam: the seam by which a sign is entered; None for transitions and for the first sign.
    warnings: what a user should know about the sign's clip, one line each.
    """

    clip: Clip
    span: Span
    seam: Seam | None = None
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class SpliceResult:
    """A spliced sentence.

    clip: the animation.
    spans: where each frame comes from, in order.
    seams: how good each seam is, in order.
    warnings: what a user should know, one line each.
    cutter, transition: names of the methods that were used.
    timing_ms: time spent in each part: "harmonize" (align), "cut", "transition", "join".
    bundle: sha256 of the bundle that a chosen method comes from; None where all are classical.
    contacts: for each source clip that was brought to another body, by its index, what its hands touch there.
    """

    clip: Clip
    spans: tuple[Span, ...]
    seams: tuple[Seam, ...]
    warnings: tuple[str, ...]
    cutter: str
    transition: str
    timing_ms: dict[str, float]
    bundle: str | None = None
    contacts: Mapping[int, tuple[Contact, ...]] = field(default_factory=dict)


def splice(clips: Iterable[Clip], options: SpliceOptions | None = None) -> SpliceResult:
    """Clips in order joined into one continuous clip.

    Raises ``InputError`` where there is no clip or an option is out of range, ``RigMismatchError`` where rigs have
    nothing in common, ``LimitError`` where a clip has too many frames at the output rate.
    """
    sentence = _SentenceBuilder(options or SpliceOptions())
    pieces = [*sentence.add(clips), *sentence.end()]
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
        contacts=sentence.contacts,
    )


def stream(clips: Iterable[Clip], options: SpliceOptions | None = None) -> Iterator[Piece]:
    """Pieces of the sentence in order, each as soon as the next clip is known; joined, they are what ``splice`` gives,
    bit for bit, with one exception: a cutter that chooses all seams of a sentence together sees two words at a time
    here. It chooses otherwise where a word would be left before it was entered.

    Reads ``clips`` one ahead; without any, nothing comes. Raises as ``splice`` does, at the clip that is wrong.
    """
    growing = Stream(options)
    for clip in clips:
        yield from growing.push(clip)
    yield from growing.end()


class Stream:
    """A sentence that grows a word at a time: what ``stream`` gives, pushed instead of pulled. It holds one word,
    however long the sentence.

    cutter, transition: names of the methods that are used.

    Raises ``InputError`` for an unknown method.
    """

    def __init__(self, options: SpliceOptions | None = None) -> None:
        self._sentence = _SentenceBuilder(options or SpliceOptions())
        self.cutter, self.transition = self._sentence.cutter.name, self._sentence.transition.name

    def push(self, clip: Clip) -> list[Piece]:
        """The pieces that are final now that one more word is known: none for the first. Raises as ``splice`` does;
        a word that raises is not part of the sentence.
        """
        return list(self._sentence.add([clip]))

    def end(self) -> list[Piece]:
        """The rest of the last word; nothing where there was none, or where it was taken already."""
        return list(self._sentence.end())


@dataclass(eq=False)
class _SentenceWord:
    """A word of a sentence, aligned to the first one.

    index: its number in the sentence.
    clip: its aligned clip.
    shown: the same as it is put out.
    warnings: about the clip, one line each.
    entry: the frame at which it is entered.
    seam: the seam by which it is entered.
    remade: where idle arms were made anew in it.
    """

    index: int
    clip: Clip
    shown: Clip
    warnings: tuple[str, ...]
    entry: int = 0
    seam: Seam | None = None
    remade: list[ArmStretch] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class _PlannedSeam:
    """Two words, where the first is left and the second entered, the gap between them, and warnings about it."""

    before: _SentenceWord
    after: _SentenceWord
    cut: Cut
    gap: Gap
    warnings: tuple[str, ...]


@dataclass
class _SentenceBuilder:
    """A sentence while words are added to it.

    seconds: time spent so far by part.
    contacts: of each word that was brought to another body, by its index.
    """

    options: SpliceOptions
    seconds: dict[str, float] = field(default_factory=lambda: defaultdict(float))
    contacts: dict[int, tuple[Contact, ...]] = field(default_factory=dict)
    _n_out: int = 0
    _n_words: int = 0
    _reference: Reference | None = None
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

    def add(self, clips: Iterable[Clip]) -> Iterator[Piece]:
        """The pieces that are final once these words are known too; their seams are chosen together."""
        new = [self._word(clip, self._n_words + k) for k, clip in enumerate(clips)]
        words = new if self._last is None else [self._last, *new]
        seams = self._plan(words)
        filled = self._fill(seams)
        self._n_words += len(new)
        self._last = words[-1] if words else None
        for planned, transition in filled:
            yield self._sign(planned.before, planned.cut.pre + 1)
            planned.after.seam = self._score(planned, transition)
            if transition is not None:
                span = self._span("transition", None, None, None, len(transition.clip))
                yield Piece(transition.clip, span)

    def end(self) -> Iterator[Piece]:
        """The rest of the last word."""
        last, self._last = self._last, None
        if last is not None:
            yield self._sign(last, len(last.clip))

    def _word(self, clip: Clip, index: int) -> _SentenceWord:
        """A clip aligned to the first one."""
        with self.timed("harmonize"):
            fps = self._reference.fps if self._reference else self.options.fps or clip.fps
            self.options.limits.check_resampling(clip, fps, self.options.sign_speed)
            to = self._reference or reference(clip, self.options.fps)
            aligned = align(clip, to, self.options.sign_speed)
            self._reference = to
        if aligned.contacts:
            self.contacts[index] = aligned.contacts
        warnings = aligned.warnings if index else (*self.methods.warnings, *aligned.warnings)
        return _SentenceWord(index, aligned.clip, aligned.clip, warnings)

    def _plan(self, words: Sequence[_SentenceWord]) -> list[_PlannedSeam]:
        """The seams of words in order; sets the frame at which each word is entered."""
        seams = []
        for (before, after), chosen in zip(pairwise(words), self._cuts([word.clip for word in words]), strict=True):
            n_before, n_after = len(before.clip), len(after.clip)
            if not (0 <= chosen.pre < n_before and 0 <= chosen.post < n_after):
                raise InputError(
                    f"cutter {self.cutter.name} chose {chosen} for clips of {n_before} and {n_after} frames"
                )
            # Never before the frame at which the word itself was entered.
            cut = Cut(max(chosen.pre, before.entry), chosen.post)
            after.entry = cut.post
            with self.timed("transition"):
                n_frames, warnings = self._n_frames(before.clip, after.clip, cut)
            if cut.pre <= before.entry and before.entry > 0:
                line = (
                    f"{before.clip.name} is left at frame {before.entry}, where it was entered: only that frame is kept"
                )
                warnings = (*warnings, line)
            gap = gap_at(before.clip, after.clip, cut, n_frames, before.entry)
            seams.append(_PlannedSeam(before, after, cut, gap, warnings))
        return seams

    def _cuts(self, clips: Sequence[Clip]) -> list[Cut]:
        """The cutter's choice for every two neighbours."""
        if len(clips) < 2:
            return []
        with self.timed("cut"):
            cuts = self.cutter.cut_all(clips)
        if len(cuts) != len(clips) - 1:
            raise InputError(f"cutter {self.cutter.name} chose {len(cuts)} cuts for {len(clips)} clips")
        return cuts

    def _fill(self, seams: Sequence[_PlannedSeam]) -> list[tuple[_PlannedSeam, FilledGap | None]]:
        """Every seam with its transition, None where it has no frames."""
        with self.timed("transition"):
            gaps = [planned.gap for planned in seams if planned.gap.n_frames]
            filled = iter(fill(self.transition, gaps, self.options.avoid_collisions))
            return [self._free(one, next(filled)) if one.gap.n_frames else (one, None) for one in seams]

    def _free(self, planned: _PlannedSeam, filled: FilledGap) -> tuple[_PlannedSeam, FilledGap]:
        """A seam whose idle hands have the time that they need."""
        before, after, options = planned.before, planned.after, self.options

        def refill(gap: Gap) -> FilledGap:
            return fill(self.transition, [gap], options.avoid_collisions)[0]

        rules = free_hand.Rules(
            natural=options.free_hand == free_hand.NATURAL,
            lengthens=options.lengthens,
            avoids=options.avoid_collisions is not False,
            longest=round(MAX_TRANSITION_S * before.clip.fps),
        )
        seam = free_hand.SeamFrames(before.shown, after.shown, planned.cut, before.entry, planned.gap, filled)
        if before.shown is not before.clip:
            seam = seam.refilled(planned.gap.n_frames, refill)
        done = free_hand.finish(seam, rules, refill)
        before.shown, after.shown = done.before, done.after
        before.remade += done.remade[0]
        after.remade += done.remade[1]
        return replace(planned, gap=done.gap), done.filled

    def _score(self, planned: _PlannedSeam, filled: FilledGap | None) -> Seam:
        with self.timed("join"):
            names = planned.before.clip.name, planned.after.clip.name
            return score(planned.gap, filled, *names, planned.cut, planned.warnings)

    def _n_frames(self, before: Clip, after: Clip, cut: Cut) -> tuple[int, tuple[str, ...]]:
        """Number of transition frames: by the user's time, or by the duration; the human median where the rig has no
        known arms.
        """
        if self.options.transition_time is not None:
            return round(self.options.transition_time * before.fps), ()
        try:
            seconds = self.methods.duration.seconds(before, after, cut)
        except FormatError:  # of a network that is damaged
            raise
        except InputError:
            return max(1, round(HUMAN_MEDIAN_S * before.fps)), (
                f"no arms known in {before.name}: the transition takes {HUMAN_MEDIAN_S:g} s, whatever the distance",
            )
        return max(1, round(min(seconds, MAX_TRANSITION_S) * before.fps)), ()

    def _sign(self, word: _SentenceWord, stop: int) -> Piece:
        with self.timed("join"):
            frames = (word.entry, stop)
            span = self._span("sign", word.index, word.clip.name, frames, stop - word.entry)
            if word.remade:
                span = replace(span, remade=free_hand.remade(word.remade, word.clip, frames, span.output[0]))
            return Piece(word.shown[word.entry : stop], span, word.seam, word.warnings)

    def _span(
        self,
        kind: Literal["sign", "transition"],
        clip: int | None,
        name: str | None,
        source: tuple[int, int] | None,
        n_frames: int,
    ) -> Span:
        start, self._n_out = self._n_out, self._n_out + n_frames
        return Span(kind, clip, name, source, (start, self._n_out))
