"""Clips -> one sentence, piece by piece: the filter layer of the paper's eq. 17, for any cutter and transition.

    Y = [P_1 .. P_pre, O, Q_post .. Q_M]: frames of the first word up to pre, new frames O, the second word from post

A piece that has been put out never changes: a word is settled as soon as the next word is known. Frames of a sign are
those of its aligned clip, bit for bit; only transition frames are new.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Literal

from signsplice.body.contacts import Contact
from signsplice.body.retarget import align
from signsplice.errors import FormatError, InputError
from signsplice.formats.limits import DEFAULT_LIMITS, ReadLimits
from signsplice.lexicon.entry import is_letter
from signsplice.motion.clip import Clip, concatenate, left_out_warnings
from signsplice.rig.align import Reference, reference
from signsplice.rig.stray_frames import stray_frames, with_ends_held
from signsplice.splicing import fingerspelling, methods
from signsplice.splicing.arguments import check_clip, check_clips, check_options
from signsplice.splicing.cut import Cut, Cutter
from signsplice.splicing.duration import HUMAN_MEDIAN_S, Duration
from signsplice.splicing.filling import FilledGap, fill
from signsplice.splicing.fingerspelling import LetterSeam
from signsplice.splicing.gap import Gap, gap_at
from signsplice.splicing.seam import Seam, score
from signsplice.splicing.tempo import (
    CITATION,
    Played,
    ReachedTempo,
    RunningDuration,
    fill_unhurried,
    play,
    reached,
    seconds_a_sign,
)
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
    tempo: "citation": as recorded; "natural": as in running signing; or how many seconds a sign takes with its
        transition. Holds and slow parts are shortened until it does, as far as human speeds allow.
    fps: output rate; None: the first clip's.
    avoid_collisions: whether hands are led around head, trunk and each other; None: where the transition is learned.
    limits: how many frames a clip may have at the output rate.

    Raises ``InputError`` for a number out of range.
    """

    cutter: str | Cutter | None = None
    transition: str | Transition | None = None
    duration: str | Duration | None = None
    bundle: str | Path | None = None
    transition_time: float | None = None
    sign_speed: float = 1.0
    tempo: str | float = CITATION
    fps: float | None = None
    avoid_collisions: bool | None = None
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
        seconds_a_sign(self.tempo)


@dataclass(frozen=True)
class Span:
    """Where a stretch of the output comes from; frame ranges are half-open.

    kind: "sign" or "transition".
    clip: index of the source clip; None for a transition.
    name: name of the source clip; None for a transition.
    source: frames of that clip, counted at the output rate; None for a transition.
    output: frames of the output.
    warp: each output frame with the frame of the clip that it shows, where a tempo changed when frames come; else None.
    """

    kind: Literal["sign", "transition"]
    clip: int | None
    name: str | None
    source: tuple[int, int] | None
    output: tuple[int, int]
    warp: tuple[tuple[int, float], ...] | None = None


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
    tempo: the tempo asked for, and how long signs take.
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
    tempo: ReachedTempo = field(default_factory=ReachedTempo)


def splice(clips: Iterable[Clip], options: SpliceOptions | None = None, starts: Collection[int] = ()) -> SpliceResult:
    """Clips in order joined into one continuous clip.

    Neighbouring letters (clips named fs-A) are one spelled word (``fingerspelling``); ``starts``: indices of letters
    with which another one begins.

    Raises ``InputError`` where there is no clip or an option is out of range, ``RigMismatchError`` where rigs have
    nothing in common, ``LimitError`` where a clip has too many frames at the output rate, ``TypeError`` for what is no
    clip.
    """
    sentence = _SentenceBuilder(options or SpliceOptions())
    tempo = sentence.options.tempo
    pieces = [*sentence.add(clips, starts), *sentence.end()]
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
        tempo=reached([piece.span.output for piece in pieces if piece.span.kind == "sign"], clip.fps, tempo),
    )


def stream(clips: Iterable[Clip], options: SpliceOptions | None = None) -> Iterator[Piece]:
    """Pieces of the sentence in order, each as soon as the next clip is known; joined, they are what ``splice`` gives,
    bit for bit, with one exception: a cutter that chooses all seams of a sentence together sees two words at a time
    here. It chooses otherwise where a word would be left before it was entered.

    Reads ``clips`` one ahead; without any, nothing comes. Raises as ``splice`` does, at the clip that is wrong.
    """
    growing = Stream(options)
    check_clips(clips)
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

    def push(self, clip: Clip, starts: bool = False) -> list[Piece]:
        """The pieces that are final now that one more word is known: none for the first. ``starts``: whether a letter
        begins another spelled word. Raises as ``splice`` does; a word that raises is not part of the sentence.
        """
        return list(self._sentence.add([clip], (0,) if starts else ()))

    def end(self) -> list[Piece]:
        """The rest of the last word; nothing where there was none, or where it was taken already."""
        return list(self._sentence.end())


@dataclass(eq=False)
class _SentenceWord:
    """A word of a sentence, aligned to the first one.

    index: its number in the sentence.
    clip: its aligned clip, without the frames at its ends that do not belong to it.
    played: the same as it is played.
    warnings: about the clip, one line each.
    starts: whether it is no letter that goes on with the spelled word before it.
    way_s: how long the way from the letter before took, 0 where there is none.
    entry: the frame at which it is entered.
    seam: the seam by which it is entered.
    n_left_out: how many frames are left out at its beginning.
    """

    index: int
    clip: Clip
    played: Played
    warnings: tuple[str, ...]
    starts: bool = False
    way_s: float = 0.0
    entry: int = 0
    seam: Seam | None = None
    n_left_out: int = 0


@dataclass(frozen=True, eq=False)
class _PlannedSeam:
    """Two words, where the first is left and the second entered, the gap between them, warnings about it, and whether
    they are one letter twice.
    """

    before: _SentenceWord
    after: _SentenceWord
    cut: Cut
    gap: Gap
    warnings: tuple[str, ...]
    is_doubled: bool = False


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
        check_options(options, SpliceOptions)
        self.methods = methods.choose(options.cutter, options.transition, options.duration, options.bundle)
        self.cutter, self.transition = self.methods.cutter, self.methods.transition
        self.seconds_a_sign = seconds_a_sign(options.tempo)
        is_own = options.duration not in (None, methods.AUTO)
        self.duration: Duration = self.methods.duration
        if self.seconds_a_sign is not None and not is_own:
            self.duration = RunningDuration(self.seconds_a_sign)

    @contextmanager
    def timed(self, part: str) -> Iterator[None]:
        start = time.perf_counter()
        yield
        self.seconds[part] += time.perf_counter() - start

    def add(self, clips: Iterable[Clip], starts: Collection[int] = ()) -> Iterator[Piece]:
        """The pieces that are final once these words are known too; their seams are chosen together."""
        check_clips(clips)
        new = [replace(self._word(clip, self._n_words + k), starts=k in starts) for k, clip in enumerate(clips)]
        words = new if self._last is None else [self._last, *new]
        seams = self._plan(words)
        filled = self._fill(seams)
        self._n_words += len(new)
        self._last = words[-1] if words else None
        for planned, transition in zip(seams, filled, strict=True):
            yield self._sign(planned.before, planned.before.played.last(planned.cut.pre) + 1)
            planned.after.seam = self._score(planned, transition)
            if transition is not None:
                span = self._span("transition", None, None, None, len(transition.clip))
                yield Piece(transition.clip, span)

    def end(self) -> Iterator[Piece]:
        """The rest of the last word."""
        last, self._last = self._last, None
        if last is not None:
            yield self._sign(last, len(last.played.clip))

    def _word(self, clip: Clip, index: int) -> _SentenceWord:
        """A clip aligned to the first one."""
        check_clip(clip, index)
        with self.timed("harmonize"):
            fps = self._reference.fps if self._reference else self.options.fps or clip.fps
            self.options.limits.check_resampling(clip, fps, self.options.sign_speed)
            stray, held = stray_frames(clip), with_ends_held(clip)
            to = self._reference or reference(held, self.options.fps)
            aligned = align(held, to, self.options.sign_speed)
            self._reference = to
            kept = stray.resampled(clip.fps * self.options.sign_speed / fps, len(aligned.clip))
        if aligned.contacts:
            self.contacts[index] = aligned.contacts
        own = aligned.clip if held is clip else aligned.clip[kept]
        played = self._played(own)
        warnings = (*left_out_warnings(clip), *aligned.warnings, *(f"{clip.name}: {line}" for line in stray.warnings))
        warnings = (*(() if index else self.methods.warnings), *warnings, *played.warnings)
        return _SentenceWord(index, own, played, warnings, n_left_out=kept.start)

    def _played(self, clip: Clip) -> Played:
        """A word at the tempo asked for; letters have a tempo of their own."""
        if self.seconds_a_sign is None or is_letter(clip.name.lower()):
            return Played(clip)
        with self.timed("cut"):
            return play(clip, self.cutter, self.seconds_a_sign)

    def _plan(self, words: Sequence[_SentenceWord]) -> list[_PlannedSeam]:
        """The seams of words in order; sets the frame at which each word is entered."""
        seams = []
        for (before, after), chosen in zip(pairwise(words), self._cuts([word.clip for word in words]), strict=True):
            n_before, n_after = len(before.clip), len(after.clip)
            if not (0 <= chosen.pre < n_before and 0 <= chosen.post < n_after):
                raise InputError(
                    f"cutter {self.cutter.name} chose {chosen} for clips of {n_before} and {n_after} frames"
                )
            letters = self._letters(before, after)
            if letters is not None:
                chosen = letters.cut
            elif before.way_s:
                chosen = Cut(
                    max(chosen.pre, fingerspelling.held_until(before.clip, before.entry, self.options.sign_speed)),
                    chosen.post,
                )
            # Never before the frame at which the word itself was entered.
            cut = Cut(max(chosen.pre, before.entry), chosen.post)
            after.entry = cut.post
            with self.timed("transition"):
                n_frames, warnings = self._n_frames(before.clip, after.clip, cut, letters)
            after.way_s = (n_frames + 1) / after.clip.fps if letters is not None else 0.0
            if cut.pre <= before.entry and before.entry > 0:
                frame = before.n_left_out + before.entry
                line = f"{before.clip.name} is left at frame {frame}, where it was entered: only that frame is kept"
                warnings = (*warnings, line)
            p, q = before.played, after.played
            gap = gap_at(p.clip, q.clip, p.cut(cut, q), n_frames, p.first(before.entry))
            seams.append(_PlannedSeam(before, after, cut, gap, warnings, letters is not None and letters.is_doubled))
        return seams

    def _letters(self, before: _SentenceWord, after: _SentenceWord) -> LetterSeam | None:
        """The seam of two letters of one spelled word, None for other words and where the user chose a cutter."""
        is_free = self.options.cutter is None or self.cutter.learned
        if after.starts or not is_free or not fingerspelling.are_letters(before.clip, after.clip):
            return None
        with self.timed("cut"):
            return fingerspelling.letter_seam(
                before.clip, after.clip, before.entry, before.way_s, self.options.sign_speed
            )

    def _cuts(self, clips: Sequence[Clip]) -> list[Cut]:
        """The cutter's choice for every two neighbours."""
        if len(clips) < 2:
            return []
        with self.timed("cut"):
            cuts = self.cutter.cut_all(clips)
        if len(cuts) != len(clips) - 1:
            raise InputError(f"cutter {self.cutter.name} chose {len(cuts)} cuts for {len(clips)} clips")
        return cuts

    def _fill(self, seams: Sequence[_PlannedSeam]) -> list[FilledGap | None]:
        """The transition of every seam, None where it has no frames."""
        with self.timed("transition"):
            gaps = [planned.gap for planned in seams if planned.gap.n_frames]
            is_running = isinstance(self.duration, RunningDuration) and self.options.transition_time is None
            fill_all = fill_unhurried if is_running else fill
            filled = iter(fill_all(self.transition, gaps, self.options.avoid_collisions))
            made = [next(filled) if planned.gap.n_frames else None for planned in seams]
            return [
                replace(one, clip=fingerspelling.bounce(one.clip, planned.before.clip))
                if one is not None and planned.is_doubled
                else one
                for one, planned in zip(made, seams, strict=True)
            ]

    def _score(self, planned: _PlannedSeam, filled: FilledGap | None) -> Seam:
        with self.timed("join"):
            before, after, cut = planned.before, planned.after, planned.cut
            own = Cut(cut.pre + before.n_left_out, cut.post + after.n_left_out)
            gap = planned.gap if filled is None else replace(planned.gap, n_frames=len(filled.clip))
            return score(gap, filled, before.clip.name, after.clip.name, own, planned.warnings)

    def _n_frames(self, before: Clip, after: Clip, cut: Cut, letters: LetterSeam | None) -> tuple[int, tuple[str, ...]]:
        """Number of transition frames: by the user's time, by the way between letters, or by the duration; the human
        median where the rig has no known arms.
        """
        if self.options.transition_time is not None:
            return round(self.options.transition_time * before.fps), ()
        if letters is not None and self.options.duration in (None, methods.AUTO):
            return max(1, round(letters.seconds * before.fps) - 1), letters.warnings
        try:
            seconds = self.duration.seconds(before, after, cut)
        except FormatError:  # of a network that is damaged
            raise
        except InputError:
            return max(1, round(HUMAN_MEDIAN_S * before.fps)), (
                f"no arms known in {before.name}: the transition takes {HUMAN_MEDIAN_S:g} s, whatever the distance",
            )
        return max(1, round(min(seconds, MAX_TRANSITION_S) * before.fps)), ()

    def _sign(self, word: _SentenceWord, stop: int) -> Piece:
        """A word from where it is entered to frame ``stop`` as it is played."""
        with self.timed("join"):
            played, first = word.played, word.n_left_out
            start = played.first(word.entry)
            source = played.source(start, stop)
            span = self._span("sign", word.index, word.clip.name, (first + source[0], first + source[1]), stop - start)
            span = replace(span, warp=played.warp(start, stop, span.output[0], first))
            return Piece(played.clip[start:stop], span, word.seam, word.warnings)

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
