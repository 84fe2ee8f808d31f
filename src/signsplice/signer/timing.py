"""Timing of the parts of a word: its events, and variations of the plain durations: tempo by word, hesitations, stops
between frames.

Citation forms of American Sign Language last 0.40, 0.63, 0.83, 1.03 and 1.37 s (5, 25, 50, 75, 95 %; ASL-LEX 2.0,
Sehyr et al. 2021), far longer than the same signs in a sentence, which omits holds. The rest of a sign lasts 0.16,
0.26, 0.40, 0.54 and 0.91 s there (918 signs of Czech Sign Language): its movement takes at least this long.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from signsplice.motion import FloatArray
from signsplice.signer.phonology import Segment, Sign
from signsplice.signer.signer import Signer, stream
from signsplice.signer.trajectory import Knot


@dataclass(frozen=True)
class TempoVariation:
    """Durations of citation forms, and their variation, over the plain durations."""

    movement_log_mean: float = 0.03
    """Mean over words of the logarithm of the factor on a movement's duration."""
    movement_log_spread: float = 0.16
    """Standard deviation over words of that logarithm."""
    hold_log_spread: float = 0.30
    """Standard deviation over words of the logarithm of the factor on a hold's duration."""
    take_log_spread: float = 0.03
    """Standard deviation of both logarithms over takes of one word."""
    first_hold: float = 1.1
    """Usual first hold of a citation form over the plain one."""
    last_hold: float = 1.15
    """Usual last hold of a citation form over the plain one."""
    last_touch: float = 1.8
    """Usual last hold that touches over the plain one."""
    least_stroke_s: float = 0.28
    """Least duration of a movement that is made once, seconds."""
    least_revolution_s: float = 0.50
    """Least duration of a revolution of a circle, seconds."""
    landing: float = 0.10
    """Fraction of its path that a movement with an open end leaves to the hold after it."""
    least_word_s: float = 0.35
    """Least duration of a word with a movement, seconds."""


@dataclass(frozen=True)
class Hesitation:
    """Hesitations of a signer, and stops that lie between frames."""

    share: float = 0.07
    """Fraction of holds and transitions with a hesitation."""
    hold_pause_s: tuple[float, float] = (0.15, 0.45)
    """Least and greatest duration that a hesitation adds to a hold, seconds."""
    drift_cm_s: float = 1.2
    """Speed at which hands drift in a hesitation, cm/s."""
    largest_offset_frames: float = 0.45
    """Largest distance of a stop from its frame, frames: less than half, so that the frame stays the nearest one."""


_TEMPO = TempoVariation()
_HESITATION = Hesitation()

LANDING_S = 0.2
"""Longest time in which a movement with an open end comes to rest within the hold after it, seconds."""


@dataclass(frozen=True)
class SignTake:
    """One take of a sign: its signer, number, and frames a second."""

    sign: Sign
    signer: Signer
    number: int
    fps: float


@dataclass(frozen=True)
class Tempo:
    """Factors on the durations of one take of a word.

    movement: of movements
    first_hold, last_hold: of holds at its start and its end
    last_touch: of a last hold that touches
    least_s: least duration from the first posture to the last one, seconds
    stroke_s: least duration of a movement that is made once
    revolution_s: least duration of a revolution of a circle
    landing: fraction of its path that a movement leaves to the hold after it; if not 0, hands also flow: they come
        into a circle, and out of a movement without a hold, at speed
    """

    movement: float = 1.0
    first_hold: float = 1.0
    last_hold: float = 1.0
    last_touch: float = 1.0
    least_s: float = 0.0
    stroke_s: float = 0.0
    revolution_s: float = 0.0
    landing: float = 0.0


def tempo_of(sign: Sign, signer: Signer, take: int) -> Tempo:
    """The tempo of a take: words differ from one another in the same way for every signer, takes a little. Letters, and
    words whose only posture is held, differ too, but are not longer on average.
    """
    spread = signer.manner.tempo_spread
    if not spread:
        return Tempo()
    word = np.clip(stream("tempo-spread", sign.gloss).standard_normal(2), -2.0, 2.0)
    once = np.clip(stream("tempo-spread", signer.name, sign.gloss, take).standard_normal(2), -2.0, 2.0)
    still = len(sign.segments) == 1 or sign.kind == "letter"
    hold_spread = 0.5 * _TEMPO.hold_log_spread if still else _TEMPO.hold_log_spread
    varied = spread * (np.array([_TEMPO.movement_log_spread, hold_spread]) * word)
    movement, hold = np.exp(varied + spread * _TEMPO.take_log_spread * once)
    return Tempo(
        movement=float(movement * (1.0 if still else np.exp(spread * _TEMPO.movement_log_mean))),
        first_hold=float(hold * (1.0 if still else _TEMPO.first_hold**spread)),
        last_hold=float(hold * (1.0 if still else _TEMPO.last_hold**spread)),
        last_touch=float(hold * _TEMPO.last_touch**spread),
        least_s=0.0 if still else _TEMPO.least_word_s * min(spread, 1.0),
        stroke_s=_TEMPO.least_stroke_s * min(spread, 1.0) * float(movement**0.5),
        revolution_s=_TEMPO.least_revolution_s * min(spread, 1.0) * float(movement**0.5),
        landing=_TEMPO.landing * min(spread, 1.0),
    )


def hold_pause(signer: Signer, sign: Sign, take: int, number: int) -> tuple[float, FloatArray]:
    """Additional duration, seconds, of a word's hold ``number`` by hesitation, mostly 0, and the drift (3,), cm, of the
    hands meanwhile, mostly down. Words of a single hold have no pause, since a sentence keeps most of that hold.
    """
    if len(sign.segments) == 1:
        return 0.0, np.zeros(3)
    pause, rng = draw_pause(signer, _HESITATION.hold_pause_s, sign.gloss, take, number)
    direction = rng.standard_normal(3) + np.array([0.0, -1.5, 0.0])
    return pause, _HESITATION.drift_cm_s * signer.scale * pause * direction / float(np.linalg.norm(direction))


def draw_pause(signer: Signer, seconds: tuple[float, float], *names: str | int) -> tuple[float, np.random.Generator]:
    """A pause, seconds, mostly 0, and the random stream for further draws."""
    rng = stream("hesitation", signer.name, *names)
    hesitates = rng.random() < _HESITATION.share * signer.manner.hesitation
    return (rng.uniform(*seconds) if hesitates else 0.0), rng


def between_frames(knots: Sequence[Knot], stops: Iterable[int], signer: Signer, gloss: str, take: int) -> list[Knot]:
    """Moves each knot at the frames ``stops`` by up to half a frame, and the knots between them in proportion."""
    off = signer.manner.off_frame
    if not off:
        return list(knots)
    frames = np.array(sorted(set(stops)), np.float64)
    rng = stream("off-frame", signer.name, gloss, take)
    most = _HESITATION.largest_offset_frames
    moved = frames + np.clip(off * rng.uniform(-0.5, 0.5, len(frames)), -most, most)
    times = np.interp([knot.frame for knot in knots], frames, moved).tolist()
    return [replace(knot, frame=time) for knot, time in zip(knots, times, strict=True)]


@dataclass(frozen=True)
class TimedSegment:
    """A segment with its [begin, end] frames, and those of each pass of a movement."""

    segment: Segment
    begin: int
    end: int
    passes: tuple[tuple[int, int], ...] = ()

    def later(self, frames: int) -> TimedSegment:
        """The segment, ``frames`` frames later."""
        passes = tuple((begin + frames, end + frames) for begin, end in self.passes)
        return replace(self, begin=self.begin + frames, end=self.end + frames, passes=passes)


@dataclass(frozen=True)
class Events:
    """Frames of an isolated word.

    up: the last frame of rest
    start: the first posture
    end: the last posture
    down: the first frame of rest again
    first: the first movement, [begin, end]; None for a word without movement
    passes: [begin, end] of every pass of the last movement, in order: its repetitions, or a circle's revolutions
    """

    up: int
    start: int
    end: int
    down: int
    first: tuple[int, int] | None
    passes: tuple[tuple[int, int], ...]
