"""Words as the cutting network reads them, each read once however often it is placed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from signsplice.motion import Clip, FloatArray
from signsplice.rig.info import FEATURE_FPS, CanonicalMotion, canonical_motion
from signsplice.splicing.networks import features
from signsplice.splicing.networks.features import WORD_FRAMES, CanonicalTrajectory
from signsplice.splicing.networks.phases import Mask, are_away, frames_alone, stroke_span
from signsplice.splicing.networks.sessions import Array, Sessions

REST_FRAMES = 24
"""Most frames of rest, at ``FEATURE_FPS``, that the cutter is shown at either end of a word."""
_LONGEST_LOW = 60
"""Most frames of a sign's low part before an arm is raised: of hands that rest far from where they began, no more."""
STILL = 0.05
"""Distance, arm lengths, within which a hand or finger counts as standing still: people who wait sway."""


@dataclass(frozen=True, eq=False)
class WordReading:
    """A word as the cutting network reads it; T frames at ``FEATURE_FPS``.

    features: (T, N_FRAME) of its frames.
    wrists: (T, 2, 3) of its frames, arm lengths.
    states: (1, T, D) the network's states.
    leave, enter: (1, S) its summaries for leaving and for entering the word.
    first: the frame of the clip, at ``FEATURE_FPS``, with which ``features`` begin.
    active: frames [start, stop), counted from there, in which the arms are away from rest.
    phases: (T, 5) scores of its frames' phases.
    stroke: first and last frame of the movements, counted from there; None where no sign is seen.
    """

    features: NDArray[np.float32]
    wrists: NDArray[np.float32]
    states: Array
    leave: Array
    enter: Array
    first: int
    active: tuple[int, int]
    phases: Array
    stroke: tuple[int, int] | None


@dataclass(frozen=True, eq=False)
class _Word:
    """A word before it is read.

    trajectory: what the network is shown of it, from frame ``first`` on, at ``FEATURE_FPS``.
    first: number of its first frame.
    active: frames [start, stop), counted from there, in which the arms are away from rest.
    readings: what the network made of it, by (mirrored, only its end, with the strokes of both hands).
    """

    trajectory: CanonicalTrajectory
    first: int
    active: tuple[int, int]
    readings: dict[tuple[bool, bool, bool], WordReading] = field(default_factory=dict)


class WordReader:
    """Reads words by a bundle's networks. What was read is kept as long as the clip lives that a word comes from: it
    stands on both sides of two seams, and in more than one sentence.
    """

    def __init__(self, sessions: Sessions) -> None:
        self.sessions = sessions
        self._words: WeakKeyDictionary[Clip, _Word] = WeakKeyDictionary()

    def alone(self, clip: Clip) -> tuple[WordReading, WordReading]:
        """A word seen with its own busier hand at the right: its end and its beginning, one and the same unless it is
        long. Neither depends on the words beside it.
        """
        (word,) = self.prepare([clip])
        mirror = features.left_hand_busier(word.trajectory)
        return self._alone(word, mirror, end=True), self._alone(word, mirror, end=False)

    def pair(self, before: Clip, after: Clip) -> tuple[WordReading, WordReading]:
        """Two words, both seen with the busier hand of the pair at the right, so that each hand of the one is that hand
        of the other; of long ones the end and the beginning.
        """
        p, q = self.prepare([before, after])
        mirror = features.left_hand_busier(p.trajectory, q.trajectory)
        return self._reading(p, mirror, end=True), self._reading(q, mirror, end=False)

    def prepare(self, clips: Sequence[Clip]) -> list[_Word]:
        """The words of aligned clips; those that are new are brought into canonical form."""
        sources = [clip if clip.source_clip is None else clip.source_clip for clip in clips]
        for clip in sources:
            if clip not in self._words:
                self._words[clip] = _without_long_rests(canonical_motion(clip))
        return [self._words[clip] for clip in sources]

    def forget(self, *clips: Clip) -> None:
        """Forget these words, so that they are read anew."""
        for clip in clips:
            self._words.pop(clip.source_clip or clip, None)

    def _alone(self, word: _Word, mirror: bool, end: bool) -> WordReading:
        """The reading by the busier hand, with the strokes that the other one makes while that rests."""
        key = (mirror, end and len(word.trajectory.positions) > WORD_FRAMES, True)
        if key not in word.readings:
            own = self._reading(word, mirror, end)
            alone = frames_alone(own.wrists)
            if alone.any():
                seen = self._reading(word, not mirror, end)
                frames = [*(own.stroke or ()), *(stroke_span(seen.phases, alone, seen.wrists) or ())]
                own = replace(own, stroke=(min(frames), max(frames)) if frames else None)
            word.readings[key] = own
        return word.readings[key]

    def _reading(self, word: _Word, mirror: bool, end: bool) -> WordReading:
        key = (mirror, end and len(word.trajectory.positions) > WORD_FRAMES, False)
        if key not in word.readings:
            tokens = features.word_tokens(features.mirrored(word.trajectory) if mirror else word.trajectory)
            first = len(tokens) - WORD_FRAMES if key[1] else 0
            tokens = tokens[first : first + WORD_FRAMES]
            n, n_phases = len(tokens), len(features.PHASES)
            outputs = self.sessions.run(
                "word", {"tokens": tokens[None]}, states=(1, n, None), leave=(1, None), enter=(1, None),
                phases=(1, n, n_phases),
            )  # fmt: skip
            start, stop = (min(max(frame - first, 0), len(tokens)) for frame in word.active)
            wrists, is_active = features.wrist_positions(tokens), np.zeros(n, bool)
            is_active[start:stop] = True
            word.readings[key] = WordReading(
                features=tokens[:, : features.N_FRAME],
                wrists=wrists,
                states=outputs["states"],
                leave=outputs["leave"],
                enter=outputs["enter"],
                first=word.first + first,
                active=(start, stop),
                phases=outputs["phases"][0],
                stroke=stroke_span(outputs["phases"][0], is_active, wrists),
            )
        return word.readings[key]


def _without_long_rests(motion: CanonicalMotion) -> _Word:
    """A word without the rest, or the standing still wherever the hands are, that goes beyond ``REST_FRAMES``: the
    networks learned from words that begin and end soon.
    """
    whole = features.trajectory(motion)
    start, stop = motion.active_span
    # Frames at FEATURE_FPS that lie within the span whatever the clip's own rate.
    last = min(int((stop - 1) / motion.fps * FEATURE_FPS + 1e-6), len(whole.positions) - 1)
    start, stop = min(int(np.ceil(start / motion.fps * FEATURE_FPS - 1e-6)), last), last + 1
    n = len(whole.positions)
    away = np.logical_or(*are_away(whole.positions[:, :: whole.positions.shape[1] // 2]).T)
    first = max(0, _n_left_out(whole.positions, away, start))
    kept = slice(first, n - max(0, _n_left_out(whole.positions[::-1], away[::-1], n - stop)))
    start, stop = max(start, first), min(stop, kept.stop)
    shown = CanonicalTrajectory(whole.rotations_6d[kept], whole.positions[kept], whole.has_role)
    return _Word(shown, first, (start - first, stop - first))


def _n_left_out(positions: FloatArray, away: Mask, n_low: int) -> int:
    """How many frames of a word's beginning are not shown, from positions (T, 12, 3), whether a hand is away from rest
    (T,) and how many frames pass until an arm is raised: not all of them where a hand has left its rest long before
    that, for a part of the sign that is low.
    """
    n_still = _n_still_frames(positions)
    n_rest = max(n_low - _LONGEST_LOW, int(np.flatnonzero(~away[:n_low]).max(initial=0)))
    return min(max(n_low, n_still) - REST_FRAMES, max(n_rest, n_still) - REST_FRAMES // 2)


def _n_still_frames(positions: FloatArray) -> int:
    """How many frames of positions (T, 12, 3) pass before one joint has left its first position; 0 where none does."""
    away = positions - positions[0]
    return int((np.einsum("tkc,tkc->tk", away, away).max(axis=1) > STILL**2).argmax())
