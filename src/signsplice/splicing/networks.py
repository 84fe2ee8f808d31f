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
from signsplice.motion import features
from signsplice.motion.arms import has_arms
from signsplice.motion.canonical import Signing, signings, turned
from signsplice.motion.clip import Clip, concatenate
from signsplice.motion.features import CONTEXT, LEAST, MOST, RATE, WORD_FRAMES, Course
from signsplice.motion.harmonize import unmoved
from signsplice.motion.stance import sizes
from signsplice.splicing.bundle import read_facts
from signsplice.splicing.cut import Cut
from signsplice.splicing.duration import HUMAN_MEDIAN_S, travel_law
from signsplice.splicing.graphs import Array, Graphs
from signsplice.splicing.joint import Choices, best
from signsplice.splicing.transition import Gap, find_transition

Float = NDArray[np.float64]

SYSTEM = "signsplice"
NAME, FLUENT = "learned", "learned-fluent"
_HOLD, _STROKE = (features.PHASES.index(name) for name in ("hold", "stroke"))
_MAY_BE = 0.05
"""Probability from which a frame may be part of a movement."""
REST_FRAMES = 24
"""Most frames of rest, at ``RATE``, that the cutter is shown at either end of a word."""
STILL = 0.05
"""Way of a hand or finger, arm lengths, up to which it stands still: who waits sways."""
MOST_AT_ONCE = 32
"""Gaps that are filled in one pass of the network."""
Item = TypeVar("Item")


def open_graphs(folder: str | Path) -> Graphs:
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
    return Graphs(folder, facts)


@dataclass(frozen=True, eq=False)
class Reading:
    """A word as the cutting network reads it: its frames' numbers (T, N_FRAME), states (1, T, D) and summaries (1, S)
    for leaving and for entering it; ``first`` is the frame, at ``RATE``, with which they begin. Counted from there:
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


def stroke(phases: Array) -> tuple[int, int] | None:
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


class Reader:
    """Reads words by a bundle's graphs; what was read is remembered as long as the clip lives that a word comes from:
    it stands on both sides of two seams, and in more than one sentence.
    """

    def __init__(self, graphs: Graphs) -> None:
        self.graphs = graphs
        self._words: WeakKeyDictionary[Clip, _Word] = WeakKeyDictionary()
        self._readings: WeakKeyDictionary[Clip, dict[tuple[bool, bool], Reading]] = WeakKeyDictionary()

    def pair(self, before: Clip, after: Clip) -> tuple[Reading, Reading]:
        """Two words, both seen with the busier hand at the right; of long ones the end and the beginning."""
        before, after = unmoved(before), unmoved(after)
        self.look(before, after)
        flipped = features.busier_left(self._words[before].course, self._words[after].course)
        return self._read(before, flipped, end=True), self._read(after, flipped, end=False)

    def look(self, *clips: Clip) -> None:
        """See words that were not seen before, harmonized ones, all in one go."""
        new = [clip for clip in dict.fromkeys(map(unmoved, clips)) if clip not in self._words]
        if not new:
            return
        for clip, seen in zip(new, signings(new), strict=True):
            self._words[clip] = _seen(seen)

    def _read(self, clip: Clip, flipped: bool, end: bool) -> Reading:
        known = self._readings.setdefault(clip, {})
        word = self._words[clip]
        key = (flipped, end and len(word.course) > WORD_FRAMES)
        if key not in known:
            tokens = features.word_window(features.mirrored(word.course) if flipped else word.course)
            first = len(tokens) - WORD_FRAMES if key[1] else 0
            tokens = tokens[first : first + WORD_FRAMES]
            said = self.graphs.run("word", {"tokens": tokens[None]})
            start, stop = (min(max(frame - first, 0), len(tokens)) for frame in word.active)
            movements = stroke(said["phases"][0, start:stop])
            known[key] = Reading(
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
class _Word:
    """A word as it is shown: its course, which begins with frame ``first`` at ``RATE``; ``active``, from there, as in
    ``Reading``.
    """

    course: Course
    first: int
    active: tuple[int, int]


def _seen(word: Signing) -> _Word:
    """A word without the rest, or the standing still wherever the hands are, that goes beyond ``REST_FRAMES``: networks
    know words that begin and end soon.
    """
    course = features.course(word)
    start, stop = word.active
    # Frames at ``RATE`` that are within the span whatever the clip's own rate.
    last = min(int((stop - 1) / word.fps * RATE + 1e-6), len(course) - 1)
    start, stop = min(int(np.ceil(start / word.fps * RATE - 1e-6)), last), last + 1
    leaves, comes = _still(course.places), len(course) - _still(course.places[::-1])
    first = max(0, max(start, leaves) - REST_FRAMES)
    kept = slice(first, min(stop, comes) + REST_FRAMES)
    start, stop = max(start, first), min(stop, kept.stop)
    return _Word(Course(course.turns[kept], course.places[kept], course.there), first, (start - first, stop - first))


def _still(places: Float) -> int:
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

    def __init__(self, reader: Reader, whole: bool = True) -> None:
        self.reader, self.whole = reader, whole
        self.name = NAME if whole else FLUENT
        self.summary = "a network that reads both words, and all seams together; " + (
            "movements stay whole" if whole else "signs are shortened as in running signing"
        )

    def choices(self, p: Reading, q: Reading) -> Choices:
        """Log-probabilities of leaving the one at a frame and entering the other at another, both at 30 a second."""
        given = {"before": p.states, "leave": p.leave, "after": q.states, "enter": q.enter}
        said = self.reader.graphs.run("cut", given)
        left, entered = (
            log_softmax(said[name][0, slice(*word.active)].astype(np.float64))
            for name, word in (("left", p), ("entered", q))
        )
        return Choices(left[:, None] + entered, p.first + p.active[0], q.first + q.active[0])

    def cut(self, before: Clip, after: Clip) -> Cut:
        """The splice position of two harmonized clips."""
        return self.cuts([before, after])[0]

    def cuts(self, clips: Sequence[Clip]) -> list[Cut]:
        """The splice positions of a sentence, chosen together (``joint``)."""
        self.reader.look(*clips)
        pairs = list(pairwise(clips))
        read = [self.reader.pair(*pair) for pair in pairs]
        chosen = best([self.choices(*words) for words in read])
        if self.whole:
            chosen = [_around(cut, *words) for cut, words in zip(chosen, read, strict=True)]
        return [Cut(_frame(pre, p), _frame(post, q)) for (pre, post), (p, q) in zip(chosen, pairs, strict=True)]


def _around(cut: tuple[int, int], p: Reading, q: Reading) -> tuple[int, int]:
    """A choice that leaves both words' movements whole."""
    pre, post = cut
    return (
        pre if p.stroke is None else max(pre, p.first + p.stroke[1]),
        post if q.stroke is None else min(post, q.first + q.stroke[0]),
    )


def _frame(at: int, clip: Clip) -> int:
    """The clip's own frame nearest to one at 30 a second."""
    return min(round(at / RATE * clip.fps), len(clip) - 1)


class LearnedDuration:
    """How long a transition takes, by the network that cuts: from the two frames that it joins, and both words.

    ``unhurried``: never quicker than people are, 0.25 s in the median and more for long ways (``duration.travel_law``),
    since viewers of avatars prefer transitions slower than human ones (Al-khazraji et al. 2021).
    """

    name, learned = NAME, True
    summary = "a network that sees both words and the two frames that are joined"

    def __init__(self, reader: Reader, unhurried: bool = True) -> None:
        self.reader, self.unhurried = reader, unhurried

    def seconds(self, before: Clip, after: Clip, cut: Cut) -> float:
        """Seconds that the new frames take: the network's, from the last frame kept to the first, less one frame."""
        p, q = self.reader.pair(before, after)
        given = {"leave": p.leave, "enter": q.enter}
        for name, word, frame, clip in (("leaving", p, cut.pre, before), ("entering", q, cut.post, after)):
            row = round(frame / clip.fps * RATE) - word.first
            given[name] = word.numbers[None, min(max(row, 0), len(word.numbers) - 1)]
        seconds = float(self.reader.graphs.run("duration", given)["seconds"][0]) - 1.0 / before.fps
        if not self.unhurried:
            return seconds
        return max(seconds, HUMAN_MEDIAN_S, travel_law(_travel(given["leaving"][0], given["entering"][0], before)))


def _travel(leaving: NDArray[np.float32], entering: NDArray[np.float32], clip: Clip) -> float:
    """The way of the hand that goes farther between two frames' numbers (N_FRAME,), in shoulder widths."""
    arm_lengths = np.linalg.norm(features.wrists(entering) - features.wrists(leaving), axis=-1).max()
    body = sizes(clip.skeleton)
    return float(arm_lengths) * body.arm_length / body.shoulder_width


class LearnedTransition:
    """The limited Hermite curve, bent by a network over the gap and eight frames on either side.

    End poses and end velocities stay those of the curve; joints without a role, gaps of fewer than 2 or more than 45
    frames at 30 a second, and rigs whose arms are not known by name follow the curve alone.
    """

    name, learned = NAME, True
    summary = "limited Hermite curve, bent by a network that sees eight frames on either side"

    def __init__(self, graphs: Graphs) -> None:
        self.graphs = graphs
        self.base = find_transition("hermite")

    def between(self, before: Clip, after: Clip, n_frames: int) -> Clip:
        """``n_frames`` >= 1 new frames that lead from the last frame of ``before`` to the first of ``after``."""
        return self.between_all([(before, after, n_frames)])[0]

    def between_all(self, gaps: Sequence[Gap]) -> list[Clip]:
        """New frames for every gap, ``MOST_AT_ONCE`` gaps in a pass."""
        made = [self.base.between(*gap) for gap in gaps]
        known = [k for k, gap in enumerate(gaps) if _knows(gap)]
        for part in batched(known, MOST_AT_ONCE):
            some = list(zip(part, _windows([(made[k], gaps[k]) for k in part]), strict=True))
            longest = max(len(window.tokens) for _, window in some)
            tokens = np.zeros((len(some), longest, features.N_TOKEN), np.float32)
            mask = np.zeros((len(some), longest), bool)
            for row, (_, window) in enumerate(some):
                tokens[row, : len(window.tokens)], mask[row, : len(window.tokens)] = window.tokens, True
            answers = self.graphs.run("bridge", {"tokens": tokens, "mask": mask})["turns"]
            for answer, (k, window) in zip(answers, some, strict=True):
                turns = features.deltas(answer[: window.n_gap], window, len(made[k]))
                base = made[k]
                made[k] = replace(base, local_rotations=turned(base.skeleton, base.local_rotations, turns))
        return made

    def limits(self, gap: Gap) -> tuple[str, ...]:
        """Said of a gap that is too long."""
        before, _, n_frames = gap
        if features.gap_frames((n_frames + 1) / before.fps) <= MOST:
            return ()
        return (f"{n_frames / before.fps:.2f} s are longer than the network knows: made by {self.base.name} alone",)


def _knows(gap: Gap) -> bool:
    """Whether a gap is neither too short nor too long for the network, on a rig whose arms are known."""
    before, _, n_frames = gap
    return LEAST <= features.gap_frames((n_frames + 1) / before.fps) <= MOST and has_arms(before.skeleton)


def _windows(bridged: Sequence[tuple[Clip, Gap]]) -> list[features.Window]:
    """What the network sees of gaps that a classical transition bridges."""
    kept, joined = [], []
    for base, (before, after, _) in bridged:
        n_context = int(np.ceil((CONTEXT + 1) / RATE * base.fps)) + 1
        kept.append(before[-n_context:])
        joined.append(concatenate([kept[-1], base, after[:n_context]]))
    return [
        features.seam_window(seen, len(before), len(base))
        for seen, before, (base, _) in zip(signings(joined), kept, bridged, strict=True)
    ]


def batched(items: Iterable[Item], most: int) -> Iterator[list[Item]]:
    """The items in order, ``most`` at a time."""
    left = iter(items)
    while some := list(islice(left, most)):
        yield some
