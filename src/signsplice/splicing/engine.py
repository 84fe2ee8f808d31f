"""Clips -> one sentence, piece by piece: the filter layer of the paper's eq. 17, for any cutter and transition.

    Y = [P_1 .. P_pre, O, Q_post .. Q_M]

A piece that has come out never changes: what a word becomes is settled as soon as the next word is known. Frames of a
sign are those of its harmonized clip, bit for bit; only transition frames are new.
"""

from __future__ import annotations

import math
import time
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

from signsplice.errors import InputError
from signsplice.motion.clip import Clip, concatenate
from signsplice.motion.harmonize import Harmonized, ground, harmonize
from signsplice.splicing.body_sense import cleared
from signsplice.splicing.cut import DEFAULT_CUTTER, Cut, Cutter, SentenceCutter, find_cutter
from signsplice.splicing.duration import HUMAN_MEDIAN_S, Duration, find_duration
from signsplice.splicing.seam import Seam, score
from signsplice.splicing.transition import DEFAULT_TRANSITION, Transition, find_transition

MAX_TRANSITION_S = 10.0
_CONTEXT = 8
"""Frames of each sign that a seam's scores see, and the least that a transition is shown."""
_SHOWN_S = 7.0 / 30.0
"""Time of each sign that a transition is shown: eight frames at 30 a second, at other rates as much time."""


@dataclass(frozen=True)
class SpliceOptions:
    """What one call wants.

    cutter, transition, duration: by name, or any object of those protocols. transition_time: seconds that stand in for
    the duration. sign_speed: how many times as fast signs play. fps: output rate, the first clip's by default.
    body_sense: whether hands are led around head, trunk and each other (``body_sense``); None: where the transition is
    learned.
    """

    cutter: str | Cutter = DEFAULT_CUTTER
    transition: str | Transition = DEFAULT_TRANSITION
    duration: str | Duration = "auto"
    transition_time: float | None = None
    sign_speed: float = 1.0
    fps: float | None = None
    body_sense: bool | None = None

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

    timing_ms: time spent in harmonize, cut, transition and join.
    """

    clip: Clip
    spans: tuple[Span, ...]
    seams: tuple[Seam, ...]
    warnings: tuple[str, ...]
    cutter: str
    transition: str
    timing_ms: dict[str, float]


def splice(clips: Iterable[Clip], options: SpliceOptions | None = None) -> SpliceResult:
    """Clips in order joined into one continuous clip.

    Raises ``InputError`` where there is no clip or an option is out of range, ``RigMismatchError`` where rigs have
    nothing in common.
    """
    sentence = _Sentence(options or SpliceOptions())
    pieces = list(sentence.pieces(clips, whole=True))
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
    )


def stream(clips: Iterable[Clip], options: SpliceOptions | None = None) -> Iterator[Piece]:
    """Pieces of the sentence in order, each as soon as the next clip is known; joined, they are what ``splice`` gives,
    but for a cutter that chooses all seams of a sentence together, which sees two words at a time here.

    Reads ``clips`` one ahead; without any, nothing comes. Raises as ``splice`` does, at the clip that is wrong.
    """
    return _Sentence(options or SpliceOptions()).pieces(clips)


@dataclass
class _Sentence:
    """One sentence in the making."""

    options: SpliceOptions
    seconds: dict[str, float] = field(default_factory=lambda: defaultdict(float))
    _n_out: int = 0

    def __post_init__(self) -> None:
        cutter, transition, duration = self.options.cutter, self.options.transition, self.options.duration
        self.cutter = find_cutter(cutter) if isinstance(cutter, str) else cutter
        self.transition = find_transition(transition) if isinstance(transition, str) else transition
        self.duration = find_duration(duration) if isinstance(duration, str) else duration

    @contextmanager
    def timed(self, part: str) -> Iterator[None]:
        start = time.perf_counter()
        yield
        self.seconds[part] += time.perf_counter() - start

    def pieces(self, clips: Iterable[Clip], whole: bool = False) -> Iterator[Piece]:
        """The sentence in pieces; ``whole``: all words may be looked at before the first piece comes."""
        words: Iterable[Harmonized] = self._words(clips)
        cuts: Iterator[Cut] | None = None
        if whole and isinstance(self.cutter, SentenceCutter):
            words = list(words)
            with self.timed("cut"):
                chosen = self.cutter.cuts([word.clip for word in words]) if len(words) > 1 else []
            if len(chosen) != max(0, len(words) - 1):
                raise InputError(f"cutter {self.cutter.name} chose {len(chosen)} cuts for {len(words)} clips")
            cuts = iter(chosen)
        before: Clip | None = None
        entry, index = 0, -1
        seam: Seam | None = None
        said: tuple[str, ...] = ()
        for index, word in enumerate(words):
            after = word.clip
            if before is not None:
                cut = self._checked(self._cut(before, after) if cuts is None else next(cuts), before, after, entry)
                yield self._sign(before, index - 1, entry, cut.pre + 1, seam, said)
                filled, seam = self._transition(before, after, cut, entry)
                if filled is not None:
                    yield Piece(filled, self._span("transition", None, None, None, len(filled)))
                entry = cut.post
            before, said = after, word.warnings
        if before is not None:
            yield self._sign(before, index, entry, len(before), seam, said)

    def _words(self, clips: Iterable[Clip]) -> Iterator[Harmonized]:
        """Clips on the first one's ground."""
        onto = None
        for clip in clips:
            with self.timed("harmonize"):
                if onto is None:
                    onto = ground(clip, self.options.fps)
                harmonized = harmonize(clip, onto, self.options.sign_speed)
            yield harmonized

    def _cut(self, before: Clip, after: Clip) -> Cut:
        with self.timed("cut"):
            return self.cutter.cut(before, after)

    def _checked(self, cut: Cut, before: Clip, after: Clip, entry: int) -> Cut:
        """Where to leave and enter; never before the frame at which ``before`` itself was entered."""
        if not (0 <= cut.pre < len(before) and 0 <= cut.post < len(after)):
            raise InputError(
                f"cutter {self.cutter.name} chose {cut} for clips of {len(before)} and {len(after)} frames"
            )
        return Cut(max(cut.pre, entry), cut.post)

    def _transition(self, before: Clip, after: Clip, cut: Cut, entry: int) -> tuple[Clip | None, Seam]:
        with self.timed("transition"):
            n_frames, warnings = self._n_frames(before, after, cut)
            if cut.pre <= entry and entry > 0:
                warnings = (
                    *warnings,
                    f"{before.name} is left where it was entered, at frame {entry}: only that frame is kept",
                )
            n_shown = _shown(before.fps)
            kept = before[max(entry, cut.pre + 1 - n_shown) : cut.pre + 1]
            follows = after[cut.post : cut.post + n_shown]
            filled, depth = None, None
            if n_frames:
                filled, depth = _filled(self.transition, kept, follows, n_frames, self.options.body_sense)
        with self.timed("join"):
            kept, follows = kept[-_CONTEXT:], follows[:_CONTEXT]
            window = concatenate([kept, filled, follows] if filled is not None else [kept, follows])
            seam = score(window, len(kept), n_frames, before.name, after.name, cut, warnings, depth)
        return filled, seam

    def _n_frames(self, before: Clip, after: Clip, cut: Cut) -> tuple[int, tuple[str, ...]]:
        """Number of transition frames: the user's time, or the rule's; the human median where the rig has no known
        arms.
        """
        if self.options.transition_time is not None:
            return round(self.options.transition_time * before.fps), ()
        try:
            seconds = self.duration.seconds(before, after, cut)
        except InputError:
            return max(1, round(HUMAN_MEDIAN_S * before.fps)), (
                f"no arms known in {before.name}: the transition takes {HUMAN_MEDIAN_S:g} s, whatever the travel",
            )
        return max(1, round(min(seconds, MAX_TRANSITION_S) * before.fps)), ()

    def _sign(self, clip: Clip, index: int, start: int, stop: int, seam: Seam | None, said: tuple[str, ...]) -> Piece:
        with self.timed("join"):
            span = self._span("sign", index, clip.name, (start, stop), stop - start)
            return Piece(clip[start:stop], span, seam, said)

    def _span(
        self, kind: str, clip: int | None, name: str | None, source: tuple[int, int] | None, n_frames: int
    ) -> Span:
        start, self._n_out = self._n_out, self._n_out + n_frames
        return Span(kind, clip, name, source, (start, self._n_out))


def _shown(fps: float) -> int:
    """Frames of each sign that a transition is shown."""
    return max(_CONTEXT, math.ceil(_SHOWN_S * fps - 1e-6) + 1)


def _filled(
    transition: Transition, before: Clip, after: Clip, n_frames: int, body_sense: bool | None
) -> tuple[Clip, float | None]:
    """The frames that a transition makes; how deep a hand is in the body, m, None where nobody looked.

    Raises ``InputError`` where they are not as many as were asked for.
    """
    filled = transition.between(before, after, n_frames)
    if len(filled) != n_frames:
        raise InputError(f"transition {transition.name} made {len(filled)} frames, expected {n_frames}")
    if not (transition.learned if body_sense is None else body_sense):
        return filled, None
    led = cleared(filled, before, after)
    return led.clip, led.depth


def inbetween(
    clip: Clip,
    gaps: Sequence[tuple[int, int]],
    transition: str | Transition = DEFAULT_TRANSITION,
    body_sense: bool | None = None,
) -> SpliceResult:
    """The clip with frames [a, b) of every gap made anew from what surrounds them; every other frame unchanged.

    Gaps are half-open frame ranges with at least one frame kept before, between and after them; body_sense as in
    ``SpliceOptions``. Raises ``InputError`` for other gaps.
    """
    method = find_transition(transition) if isinstance(transition, str) else transition
    seconds: dict[str, float] = defaultdict(float)
    spans: list[Span] = []
    seams: list[Seam] = []
    pieces: list[Clip] = []
    gaps = sorted(gaps)
    at = 0
    for start, stop in gaps:
        if not at < start < stop < len(clip):
            raise InputError(
                f"gap {start}:{stop} in {len(clip)} frames, expected {at + 1} <= A < B <= {len(clip) - 1}: "
                "frames must remain before, between and after gaps"
            )
        at = stop
    at = 0
    ends = [start for start, _ in gaps[1:]] + [len(clip)]
    for (start, stop), kept_until in zip(gaps, ends, strict=True):
        began = time.perf_counter()
        n_shown = _shown(clip.fps)
        follows = clip[stop:kept_until][:n_shown]
        filled, depth = _filled(method, clip[at:start][-n_shown:], follows, stop - start, body_sense)
        seconds["transition"] += time.perf_counter() - began
        pieces += [clip[at:start], filled]
        spans += [
            Span("sign", 0, clip.name, (at, start), (at, start)),
            Span("transition", None, None, None, (start, stop)),
        ]
        low = max(at, start - _CONTEXT)
        window = concatenate([clip[low:start], filled, follows[:_CONTEXT]])
        cut = Cut(start - 1, stop)
        seams.append(score(window, start - low, stop - start, clip.name, clip.name, cut, (), depth))
        at = stop
    pieces.append(clip[at:])
    spans.append(Span("sign", 0, clip.name, (at, len(clip)), (at, len(clip))))
    began = time.perf_counter()
    joined = concatenate(pieces, name=clip.name)
    seconds["join"] = time.perf_counter() - began
    timing = {part: 1e3 * seconds[part] for part in ("harmonize", "cut", "transition", "join")}
    return SpliceResult(joined, tuple(spans), tuple(seams), (), "none", method.name, timing)
