"""The learned cutter, duration and transition behind the classical ones' protocols: a bundle's graphs, on any rig.

Two words are seen on the canonical humanoid at 30 frames a second (``motion.features``); what the networks say goes
back to the clips' own joints and rate.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice, pairwise
from pathlib import Path
from typing import TypeVar
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_softmax

from signsplice.errors import InputError
from signsplice.motion.clip import Clip, concatenate
from signsplice.rig.align import source_of
from signsplice.rig.arms import has_arms
from signsplice.rig.canonical import FEATURE_FPS, CanonicalMotion, apply_deltas, canonical_motions
from signsplice.rig.proportions import sizes
from signsplice.splicing import features
from signsplice.splicing.bundle import read_facts
from signsplice.splicing.cut import Cut
from signsplice.splicing.duration import HUMAN_MEDIAN_S, travel_law
from signsplice.splicing.features import CONTEXT, MAX_GAP_FRAMES, MIN_GAP_FRAMES, WORD_FRAMES, CanonicalTrajectory
from signsplice.splicing.sessions import Array, Sessions
from signsplice.splicing.transition import Gap, find_transition
from signsplice.splicing.viterbi import SeamScores, best_path

Float = NDArray[np.float64]

SYSTEM = "signsplice"
NAME, FLUENT = "learned", "learned-fluent"
_HOLD, _STROKE = (features.PHASES.index(name) for name in ("hold", "stroke"))
_MAY_BE = 0.05
"""Probability from which a frame may be part of a movement."""
REST_FRAMES = 24
"""Most frames of rest, at ``FEATURE_FPS``, that the cutter is shown at either end of a word."""
STILL = 0.05
"""Way of a hand or finger, arm lengths, up to which it stands still: who waits sways."""
MAX_BATCH = 32
"""Gaps that are filled in one pass of the network."""
Item = TypeVar("Item")


def open_sessions(folder: str | Path) -> Sessions:
    """The graphs of a bundle; each is read and checked when first run.

    Raises ``InputError`` where the folder holds no bundle, another system's, or one that was made for other features.
    """
    folder = Path(folder)
    facts = read_facts(folder)
    if facts.get("system") != SYSTEM:
        raise InputError(f"{folder}: is a bundle of {facts.get('system')!r}, expected one of {SYSTEM!r}")
    if facts.get("features") != features.VERSION:
        raise InputError(
            f"{folder}: was made for features {facts.get('features')}, and these are {features.VERSION}; train it anew"
        )
    return Sessions(folder, facts)


@dataclass(frozen=True, eq=False)
class WordReading:
    """A word as the cutting network reads it: its frames' numbers (T, N_FRAME), states (1, T, D) and summaries (1, S)
    for leaving and for entering it; ``first`` is the frame, at ``FEATURE_FPS``, with which they begin. Counted from there:
    ``active``, frames [start, stop) in which the arms are away from rest, and ``stroke``, first and last frame of its
    movements, None where no sign is seen.
    """

    numbers: NDArray[np.float32]
    states: Array
    leave: Array
    enter: Array
    first: int
    active: tuple[int, int]
    stroke: tuple[int, int] | None


def stroke_span(phases: Array) -> tuple[int, int] | None:
    """First and last frame of a word's movements by the scores of its frames' phases (T, 5): of all frames that are
    not surely something else, and one more at both ends, where movements are too slow to be told from holds. The middle
    frame of a sign that is all hold; None where neither is seen.
    """
    shares = np.exp(phases.astype(np.float64) - phases.max(axis=-1, keepdims=True))
    shares /= shares.sum(axis=-1, keepdims=True)
    rows = np.flatnonzero(shares[:, _STROKE] > _MAY_BE)
    if len(rows):
        return max(int(rows[0]) - 1, 0), min(int(rows[-1]) + 1, len(phases) - 1)
    held = np.flatnonzero(shares[:, _HOLD] > 0.5)
    return (int(held[len(held) // 2]),) * 2 if len(held) else None


class WordReader:
    """Reads words by a bundle's graphs; what was read is remembered as long as the clip lives that a word comes from:
    it stands on both sides of two seams, and in more than one sentence.
    """

    def __init__(self, graphs: Sessions) -> None:
        self.graphs = graphs
        self._words: WeakKeyDictionary[Clip, _SeenWord] = WeakKeyDictionary()
        self._readings: WeakKeyDictionary[Clip, dict[tuple[bool, bool], WordReading]] = WeakKeyDictionary()

    def pair(self, before: Clip, after: Clip) -> tuple[WordReading, WordReading]:
        """Two words, both seen with the busier hand at the right; of long ones the end and the beginning."""
        before, after = source_of(before), source_of(after)
        self.look(before, after)
        flipped = features.left_hand_busier(self._words[before].trajectory, self._words[after].trajectory)
        return self._read(before, flipped, end=True), self._read(after, flipped, end=False)

    def look(self, *clips: Clip) -> None:
        """See words that were not seen before, harmonized ones, all in one go."""
        new = [clip for clip in dict.fromkeys(map(source_of, clips)) if clip not in self._words]
        if not new:
            return
        for clip, seen in zip(new, canonical_motions(new), strict=True):
            self._words[clip] = _seen_word(seen)

    def _read(self, clip: Clip, flipped: bool, end: bool) -> WordReading:
        known = self._readings.setdefault(clip, {})
        word = self._words[clip]
        key = (flipped, end and len(word.trajectory) > WORD_FRAMES)
        if key not in known:
            tokens = features.word_tokens(features.mirrored(word.trajectory) if flipped else word.trajectory)
            first = len(tokens) - WORD_FRAMES if key[1] else 0
            tokens = tokens[first : first + WORD_FRAMES]
            said = self.graphs.run("word", {"tokens": tokens[None]})
            start, stop = (min(max(frame - first, 0), len(tokens)) for frame in word.active)
            movements = stroke_span(said["phases"][0, start:stop])
            known[key] = WordReading(
                numbers=tokens[:, : features.N_FRAME],
                states=said["states"],
                leave=said["leave"],
                enter=said["enter"],
                first=word.first + first,
                active=(start, stop),
                stroke=None if movements is None else (start + movements[0], start + movements[1]),
            )
        return known[key]


@dataclass(frozen=True, eq=False)
class _SeenWord:
    """A word as it is shown: its course, which begins with frame ``first`` at ``FEATURE_FPS``; ``active``, from there, as in
    ``WordReading``.
    """

    trajectory: CanonicalTrajectory
    first: int
    active: tuple[int, int]


def _seen_word(word: CanonicalMotion) -> _SeenWord:
    """A word without the rest, or the standing still wherever the hands are, that goes beyond ``REST_FRAMES``: networks
    know words that begin and end soon.
    """
    course = features.trajectory(word)
    start, stop = word.active_span
    # Frames at ``FEATURE_FPS`` that are within the span whatever the clip's own rate.
    last = min(int((stop - 1) / word.fps * FEATURE_FPS + 1e-6), len(course) - 1)
    start, stop = min(int(np.ceil(start / word.fps * FEATURE_FPS - 1e-6)), last), last + 1
    leaves, comes = _n_still_frames(course.positions), len(course) - _n_still_frames(course.positions[::-1])
    first = max(0, max(start, leaves) - REST_FRAMES)
    kept = slice(first, min(stop, comes) + REST_FRAMES)
    start, stop = max(start, first), min(stop, kept.stop)
    return _SeenWord(
        CanonicalTrajectory(course.rotations_6d[kept], course.positions[kept], course.has_role),
        first,
        (start - first, stop - first),
    )


def _n_still_frames(places: Float) -> int:
    """How many frames of places (T, 12, 3) pass before one of them is away from where it is in the first; 0 where none
    ever is.
    """
    away = places - places[0]
    return int((np.einsum("tkc,tkc->tk", away, away).max(axis=1) > STILL**2).argmax())


class LearnedCutter:
    """Chooses both frames of a seam for one another, and all seams of a sentence together.

    The signing that it learned from shortens signs as running signing does: repetitions go, and the outer part of
    movements. ``whole``: no movement is cut into; a word is left after its last and entered before its first, as far as
    they lie between rests. Words are left and entered while their arms are away from rest, where rest can be told by
    heights (``arms.active_span``), whatever the network takes it for.
    """

    learned = True

    def __init__(self, reader: WordReader, whole: bool = True) -> None:
        self.reader, self.whole = reader, whole
        self.name = NAME if whole else FLUENT
        self.summary = "a network that reads both words, and all seams together; " + (
            "movements stay whole" if whole else "signs are shortened as in running signing"
        )

    def choices(self, p: WordReading, q: WordReading) -> SeamScores:
        """Log-probabilities of leaving the one at a frame and entering the other at another, both at 30 a second."""
        given = {"before": p.states, "leave": p.leave, "after": q.states, "enter": q.enter}
        said = self.reader.graphs.run("cut", given)
        left, entered = (
            log_softmax(said[name][0, slice(*word.active)].astype(np.float64))
            for name, word in (("left", p), ("entered", q))
        )
        return SeamScores(left[:, None] + entered, p.first + p.active[0], q.first + q.active[0])

    def cut(self, before: Clip, after: Clip) -> Cut:
        """The splice position of two harmonized clips."""
        return self.cuts([before, after])[0]

    def cuts(self, clips: Sequence[Clip]) -> list[Cut]:
        """The splice positions of a sentence, chosen together (``joint``)."""
        self.reader.look(*clips)
        pairs = list(pairwise(clips))
        read = [self.reader.pair(*pair) for pair in pairs]
        chosen = best_path([self.choices(*words) for words in read])
        if self.whole:
            chosen = [_outside_strokes(cut, *words) for cut, words in zip(chosen, read, strict=True)]
        return [
            Cut(_nearest_frame(pre, p), _nearest_frame(post, q))
            for (pre, post), (p, q) in zip(chosen, pairs, strict=True)
        ]


def _outside_strokes(cut: tuple[int, int], p: WordReading, q: WordReading) -> tuple[int, int]:
    """A choice that leaves both words' movements whole."""
    pre, post = cut
    return (
        pre if p.stroke is None else max(pre, p.first + p.stroke[1]),
        post if q.stroke is None else min(post, q.first + q.stroke[0]),
    )


def _nearest_frame(at: int, clip: Clip) -> int:
    """The clip's own frame nearest to one at 30 a second."""
    return min(round(at / FEATURE_FPS * clip.fps), len(clip) - 1)


class LearnedDuration:
    """How long a transition takes, by the network that cuts: from the two frames that it joins, and both words.

    ``unhurried``: never quicker than people are, 0.25 s in the median and more for long ways (``duration.travel_law``),
    since viewers of avatars prefer transitions slower than human ones (Al-khazraji et al. 2021).
    """

    name, learned = NAME, True
    summary = "a network that sees both words and the two frames that are joined"

    def __init__(self, reader: WordReader, unhurried: bool = True) -> None:
        self.reader, self.unhurried = reader, unhurried

    def seconds(self, before: Clip, after: Clip, cut: Cut) -> float:
        """Seconds that the new frames take: the network's, from the last frame kept to the first, less one frame."""
        p, q = self.reader.pair(before, after)
        given = {"leave": p.leave, "enter": q.enter}
        for name, word, frame, clip in (("leaving", p, cut.pre, before), ("entering", q, cut.post, after)):
            row = round(frame / clip.fps * FEATURE_FPS) - word.first
            given[name] = word.numbers[None, min(max(row, 0), len(word.numbers) - 1)]
        seconds = float(self.reader.graphs.run("duration", given)["seconds"][0]) - 1.0 / before.fps
        if not self.unhurried:
            return seconds
        return max(seconds, HUMAN_MEDIAN_S, travel_law(_travel(given["leaving"][0], given["entering"][0], before)))


def _travel(leaving: NDArray[np.float32], entering: NDArray[np.float32], clip: Clip) -> float:
    """The way of the hand that goes farther between two frames' numbers (N_FRAME,), in shoulder widths."""
    arm_lengths = np.linalg.norm(features.wrist_positions(entering) - features.wrist_positions(leaving), axis=-1).max()
    body = sizes(clip.skeleton)
    return float(arm_lengths) * body.arm_length / body.shoulder_width


class LearnedTransition:
    """The limited Hermite curve, bent by a network over the gap and eight frames on either side.

    End poses and end velocities stay those of the curve; joints without a role, gaps of fewer than 2 or more than 45
    frames at 30 a second, and rigs whose arms are not known by name follow the curve alone.
    """

    name, learned = NAME, True
    summary = "limited Hermite curve, bent by a network that sees eight frames on either side"

    def __init__(self, graphs: Sessions) -> None:
        self.graphs = graphs
        self.base = find_transition("hermite")

    def between(self, before: Clip, after: Clip, n_frames: int) -> Clip:
        """``n_frames`` >= 1 new frames that lead from the last frame of ``before`` to the first of ``after``."""
        return self.between_all([(before, after, n_frames)])[0]

    def between_all(self, gaps: Sequence[Gap]) -> list[Clip]:
        """New frames for every gap, ``MAX_BATCH`` gaps in a pass."""
        made = [self.base.between(*gap) for gap in gaps]
        known = [k for k, gap in enumerate(gaps) if _within_limits(gap)]
        for part in batched(known, MAX_BATCH):
            some = list(zip(part, _gap_features([(made[k], gaps[k]) for k in part]), strict=True))
            longest = max(len(window.tokens) for _, window in some)
            tokens = np.zeros((len(some), longest, features.N_TOKEN), np.float32)
            mask = np.zeros((len(some), longest), bool)
            for row, (_, window) in enumerate(some):
                tokens[row, : len(window.tokens)], mask[row, : len(window.tokens)] = window.tokens, True
            answers = self.graphs.run("bridge", {"tokens": tokens, "mask": mask})["turns"]
            for answer, (k, window) in zip(answers, some, strict=True):
                turns = features.delta_rotvecs(answer[: window.n_gap], window, len(made[k]))
                base = made[k]
                made[k] = replace(base, local_rotations=apply_deltas(base.skeleton, base.local_rotations, turns))
        return made

    def limits(self, gap: Gap) -> tuple[str, ...]:
        """Said of a gap that is too long."""
        before, _, n_frames = gap
        if features.gap_frames((n_frames + 1) / before.fps) <= MAX_GAP_FRAMES:
            return ()
        return (f"{n_frames / before.fps:.2f} s are longer than the network knows: made by {self.base.name} alone",)


def _within_limits(gap: Gap) -> bool:
    """Whether a gap is neither too short nor too long for the network, on a rig whose arms are known."""
    before, _, n_frames = gap
    return MIN_GAP_FRAMES <= features.gap_frames((n_frames + 1) / before.fps) <= MAX_GAP_FRAMES and has_arms(
        before.skeleton
    )


def _gap_features(bridged: Sequence[tuple[Clip, Gap]]) -> list[features.GapFeatures]:
    """What the network sees of gaps that a classical transition bridges."""
    kept, joined = [], []
    for base, (before, after, _) in bridged:
        n_context = int(np.ceil((CONTEXT + 1) / FEATURE_FPS * base.fps)) + 1
        kept.append(before[-n_context:])
        joined.append(concatenate([kept[-1], base, after[:n_context]]))
    return [
        features.gap_features(seen, len(before), len(base))
        for seen, before, (base, _) in zip(canonical_motions(joined), kept, bridged, strict=True)
    ]


def batched(items: Iterable[Item], most: int) -> Iterator[list[Item]]:
    """The items in order, ``most`` at a time."""
    left = iter(items)
    while some := list(islice(left, most)):
        yield some
