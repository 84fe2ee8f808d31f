"""The learned cutter and transition: a bundle's networks with the interface of the classical methods.

The networks see words on the canonical humanoid at 30 frames a second (``features``) and read each once, however often
it is placed (``WordReader``); their outputs are converted back to the clips' joints and rate.

Dynamic programming (Viterbi 1967) finds the best cuts of a whole sentence. The best pair of frames of each seam alone
does not suffice: a word must not be left before it was entered. The search runs over the frames at which words are
entered, in time linear in the number of words. Cuts are then moved outside strokes: these stay whole, and movements
from and to rest are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from weakref import WeakKeyDictionary

import numpy as np
import scipy
from numpy.typing import NDArray

from signsplice.errors import InputError
from signsplice.motion import Clip, FloatArray, JoinedClips, batch_clips, copy_unchecked
from signsplice.rig.info import FEATURE_FPS, CanonicalMotion, apply_deltas, canonical_motion, rig_info
from signsplice.splicing import features
from signsplice.splicing.bundle import Array, Sessions, read_config
from signsplice.splicing.contracts import Cut, Cutter, Gap, Transition
from signsplice.splicing.curves import find_transition
from signsplice.splicing.features import (
    MAX_GAP_FRAMES,
    MIN_GAP_FRAMES,
    N_CONTEXT,
    WORD_FRAMES,
    CanonicalTrajectory,
    Mask,
    are_away,
    frames_alone,
    stroke_span,
)

_TOO_EARLY = 1e6
"""Cost per frame that a word is left too early: larger than any score, but finite, so that a solution exists."""


@dataclass(frozen=True, eq=False)
class SeamScores:
    """The scores of a seam.

    scores: (P, Q) for leaving the word before at frame ``leaves_from`` + row and entering the word after at frame
        ``enters_from`` + column.
    leaves_from, enters_from: first frames of rows and columns.
    """

    scores: FloatArray
    leaves_from: int
    enters_from: int = 0


def best_path(seams: Sequence[SeamScores], least: int = 1) -> list[tuple[int, int]]:
    """Returns the frames (left, entered) of every seam that maximise the sum of scores, with at least ``least`` frames
    between entering and leaving a word, or all its frames if it is shorter.
    """
    sums_so_far, entered_from = np.zeros(1), 0  # best sum by the frame at which the word before was entered
    back: list[tuple[NDArray[np.intp], NDArray[np.intp]]] = []
    for seam in seams:
        latest = seam.leaves_from + np.arange(len(seam.scores)) - least
        best_sums, entered = _best_entry(sums_so_far, latest - entered_from)
        sums = seam.scores + best_sums[:, None]  # (P, Q)
        rows = sums.argmax(axis=0)
        sums_so_far, entered_from = sums[rows, np.arange(sums.shape[1])], seam.enters_from
        back.append((rows, entered))
    chosen: list[tuple[int, int]] = []
    column = int(sums_so_far.argmax()) if back else 0
    for seam, (rows, entered) in zip(reversed(seams), reversed(back), strict=True):
        row = int(rows[column])
        chosen.append((seam.leaves_from + row, seam.enters_from + column))
        column = int(entered[row])
    return chosen[::-1]


def _best_entry(sums: FloatArray, latest: NDArray[np.intp]) -> tuple[FloatArray, NDArray[np.intp]]:
    """Returns the best sum among entries no later than each of ``latest``, and the frame of that entry."""
    running = np.maximum.accumulate(sums)
    improves = np.concatenate([[True], sums[1:] > running[:-1]])
    frames = np.maximum.accumulate(np.where(improves, np.arange(len(sums)), 0))
    index = np.minimum(latest, len(sums) - 1)
    missing = np.maximum(-index, 0)  # frames before the word's first one, at which it cannot be entered
    index = np.maximum(index, 0)
    best = np.where(missing > 0, sums[0], running[index]) - _TOO_EARLY * missing
    return best, np.where(missing > 0, 0, frames[index])


BELOW = 0.015
"""Largest distance of a kept hand below the end of its stroke, arm lengths (0.8 cm). Of the shipped words, twice as
many transitions dip by over 3 cm at 0.02, and at 0.01 one stroke in a hundred loses a frame.
"""
NEXT_BELOW = 0.03
"""The same in the frame next to the stroke, in which slow movements look like holds: a hand that is farther below
within a thirtieth of a second falls.
"""
_BESIDE = 2
"""Number of frames beside a stroke that are kept, unless a hand is below it there."""


@dataclass(frozen=True, eq=False)
class WordEnd:
    """The end of a word, or its beginning, as a cutter that reads words alone knows it; T frames at ``FEATURE_FPS``.

    first: number of its first frame in the clip.
    active: frames [start, stop), counted from ``first``, in which the arms are away from rest.
    stroke: first and last frame of the movements, counted from ``first``; None if no sign is detected.
    heights: (T, 2) of both wrists, arm lengths.
    scores: (A,) log-probabilities of leaving the word, or of entering it, at its active frames.
    """

    first: int
    active: tuple[int, int]
    stroke: tuple[int, int] | None
    heights: NDArray[np.float32]
    scores: FloatArray


def outside_strokes(cut: tuple[int, int], p: WordEnd, q: WordEnd) -> tuple[int, int]:
    """Moves a cut, frames at ``FEATURE_FPS``, outwards until both words' strokes stay whole, then inwards, up to the
    strokes, past frames in which a hand sinks or rises: a transition that ends in them would dip below both signs.
    """
    pre, post = cut
    if p.stroke is not None:
        last, end = p.first + p.stroke[1], p.first + len(p.heights) - 1
        pre = last + _n_raised(p, range(last, min(max(pre, last + _BESIDE), end) + 1))
    if q.stroke is not None:
        first = q.first + q.stroke[0]
        post = first - _n_raised(q, range(first, max(min(post, first - _BESIDE), q.first) - 1, -1))
    return pre, post


def _n_raised(word: WordEnd, frames: range) -> int:
    """Counts the ``frames`` of a word, away from its stroke, before the last in which both hands are as high as in the
    first.
    """
    heights = word.heights[np.arange(frames.start, frames.stop, frames.step) - word.first]  # (n, 2)
    below, limits = (heights[0] - heights).max(axis=1), np.full(len(heights), BELOW)
    limits[1:2] = NEXT_BELOW
    return int(np.flatnonzero(below <= limits)[-1])


SYSTEM = "signsplice"
NAME = "learned"
"""Name of the cutter that keeps movements whole, and of the transition."""
FLUENT = "learned-fluent"
"""Name of the cutter that shortens signs as in running signing."""
_BATCH = 16
"""Largest number of gaps in one run of the network: larger batches are no faster per gap."""


REST_FRAMES = 24
"""Largest number of rest frames, at ``FEATURE_FPS``, that the cutter sees at either end of a word."""
_LONGEST_LOW = 60
"""Largest number of frames of a sign's low part, before an arm is raised, that the cutter sees."""
STILL = 0.05
"""Distance, arm lengths, within which a hand or finger counts as still: people who wait sway."""


@dataclass(frozen=True, eq=False)
class WordReading:
    """A word as the cutting network reads it; T frames at ``FEATURE_FPS``.

    features: (T, N_FRAME) of its frames.
    wrists: (T, 2, 3) wrist positions, arm lengths.
    states: (1, T, D) the network's states.
    leave, enter: (1, S) the network's summaries for leaving and for entering the word.
    first: first frame of ``features`` in the clip, at ``FEATURE_FPS``.
    active: frames [start, stop), counted from ``first``, in which the arms are away from rest.
    phases: (T, 5) scores of its frames' phases.
    stroke: first and last frame of the movements, counted from ``first``; None if no sign is detected.
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
class _Shown:
    """A word before it is read.

    trajectory: the part that the network sees, from frame ``first`` on, at ``FEATURE_FPS``.
    first: number of its first frame.
    active: frames [start, stop), counted from ``first``, in which the arms are away from rest.
    readings: the network's readings, by (mirrored, only its end, with the strokes of both hands).
    """

    trajectory: CanonicalTrajectory
    first: int
    active: tuple[int, int]
    readings: dict[tuple[bool, bool, bool], WordReading] = field(default_factory=dict)


class WordReader:
    """Reads words with a bundle's networks. Readings are kept as long as the word's source clip lives: a word has two
    seams, and may occur in more than one sentence.
    """

    def __init__(self, sessions: Sessions) -> None:
        self.sessions = sessions
        self._words: WeakKeyDictionary[Clip, _Shown] = WeakKeyDictionary()

    def alone(self, clip: Clip) -> tuple[WordReading, WordReading]:
        """Reads a word with its own busier hand on the right, independently of its neighbours; returns the readings of
        its end and its beginning, which are the same unless the word is long.
        """
        (word,) = self.prepare([clip])
        mirror = features.left_hand_busier(word.trajectory)
        return self._alone(word, mirror, end=True), self._alone(word, mirror, end=False)

    def pair(self, before: Clip, after: Clip) -> tuple[WordReading, WordReading]:
        """Reads two words, both with the busier hand of the pair on the right, so that left and right hands match; of
        long words only the end of the first and the beginning of the second.
        """
        p, q = self.prepare([before, after])
        mirror = features.left_hand_busier(p.trajectory, q.trajectory)
        return self._reading(p, mirror, end=True), self._reading(q, mirror, end=False)

    def prepare(self, clips: Sequence[Clip]) -> list[_Shown]:
        """Returns the words of aligned clips; converts new ones to canonical form."""
        sources = [clip if clip.source_clip is None else clip.source_clip for clip in clips]
        for clip in sources:
            if clip not in self._words:
                self._words[clip] = _without_long_rests(canonical_motion(clip))
        return [self._words[clip] for clip in sources]

    def forget(self, *clips: Clip) -> None:
        """Discards the readings of these words."""
        for clip in clips:
            self._words.pop(clip.source_clip or clip, None)

    def _alone(self, word: _Shown, mirror: bool, end: bool) -> WordReading:
        """Returns the reading by the busier hand, with the strokes of the other hand while the busier one rests."""
        key = (mirror, end and len(word.trajectory.positions) > WORD_FRAMES, True)
        if key not in word.readings:
            reading = self._reading(word, mirror, end)
            is_alone = frames_alone(reading.wrists)
            if is_alone.any():
                mirrored = self._reading(word, not mirror, end)
                frames = [*(reading.stroke or ()), *(stroke_span(mirrored.phases, is_alone, mirrored.wrists) or ())]
                reading = replace(reading, stroke=(min(frames), max(frames)) if frames else None)
            word.readings[key] = reading
        return word.readings[key]

    def _reading(self, word: _Shown, mirror: bool, end: bool) -> WordReading:
        key = (mirror, end and len(word.trajectory.positions) > WORD_FRAMES, False)
        if key not in word.readings:
            tokens = features.word_tokens(features.mirror_trajectory(word.trajectory) if mirror else word.trajectory)
            first = len(tokens) - WORD_FRAMES if key[1] else 0
            tokens = tokens[first : first + WORD_FRAMES]
            n, n_phases = len(tokens), len(features.PHASES)
            outputs = self.sessions.run(
                "word", {"tokens": tokens[None]}, states=(1, n, None), leave=(1, None), enter=(1, None),
                phases=(1, n, n_phases),
            )  # fmt: skip
            start, stop = (min(max(frame - first, 0), len(tokens)) for frame in word.active)
            wrists = features.wrist_positions(tokens)
            # A low part of a sign lies below the height that shows arms away from rest.
            is_active = np.asarray(are_away(wrists).any(axis=1))
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


def _without_long_rests(motion: CanonicalMotion) -> _Shown:
    """Removes rest, and stillness anywhere, beyond ``REST_FRAMES`` from a word: the networks learned from words without
    long pauses at their ends.
    """
    start, stop = motion.active_span
    sampled = features.trajectory(motion)
    # Frames at FEATURE_FPS that lie within the span whatever the clip's own rate.
    last = min(int((stop - 1) / motion.fps * FEATURE_FPS + 1e-6), len(sampled.positions) - 1)
    start, stop = min(int(np.ceil(start / motion.fps * FEATURE_FPS - 1e-6)), last), last + 1
    n = len(sampled.positions)
    is_away = np.logical_or(*are_away(sampled.positions[:, :: sampled.positions.shape[1] // 2]).T)
    first = max(0, _n_left_out(sampled.positions, is_away, start))
    window = slice(first, n - max(0, _n_left_out(sampled.positions[::-1], is_away[::-1], n - stop)))
    start, stop = max(start, first), min(stop, window.stop)
    shown = CanonicalTrajectory(sampled.rotations_6d[window], sampled.positions[window], sampled.has_role)
    return _Shown(shown, first, (start - first, stop - first))


def _n_left_out(positions: FloatArray, away: Mask, n_low: int) -> int:
    """Returns how many frames of a word's beginning are left out, from positions (T, 12, 3), whether a hand is away
    from rest (T,), and the number of frames until an arm is raised. A low part of the sign, in which a hand has left
    its rest long before an arm is raised, is kept.
    """
    n_still = _n_still_frames(positions)
    n_rest = max(n_low - _LONGEST_LOW, int(np.flatnonzero(~away[:n_low]).max(initial=0)))
    return min(max(n_low, n_still) - REST_FRAMES, max(n_rest, n_still) - REST_FRAMES // 2)


def _n_still_frames(positions: FloatArray) -> int:
    """Returns the number of frames of positions (T, 12, 3) until a joint leaves its first position; 0 if none does."""
    offsets = positions - positions[0]
    return int((np.einsum("tkc,tkc->tk", offsets, offsets).max(axis=1) > STILL**2).argmax())


def open_sessions(folder: str | Path) -> Sessions:
    """Opens the networks of a bundle; each is read and checked at its first run.

    Raises ``InputError`` if the folder holds no bundle, another system's bundle, or one made for other features.
    """
    folder = Path(folder)
    config = read_config(folder)
    if config.system != SYSTEM:
        raise InputError(f"{folder}: is a bundle of {config.system!r}, expected one of {SYSTEM!r}")
    if config.features != features.VERSION:
        raise InputError(
            f"{folder}: was made for features {config.features}, and these are {features.VERSION}; train it anew"
        )
    return Sessions(folder, config)


class LearnedCutter(Cutter):
    """Scores the frames at which words are left and entered, and chooses all seams of a sentence together.

    whole: whether movements stay whole: a word is left after its last movement and entered before its first, as far as
        these lie between rests. Every word is read by its own busier hand and scored as if it preceded and followed
        itself, so that its cut does not depend on its neighbours. Otherwise words are read and scored in pairs, and
        signs are shortened as in running signing, depending on where the hands go next: repetitions and the outer parts
        of movements are cut.

    Words are left and entered while their arms are away from rest by the height of the hands
    (``rig.info.active_span``), whatever phase the network assigns.
    """

    learned = own_rate = True

    def __init__(self, reader: WordReader, whole: bool = True) -> None:
        self.reader, self.whole = reader, whole
        self.name = NAME if whole else FLUENT
        self.summary = "a network that reads " + (
            "every word by itself; movements stay whole"
            if whole
            else "both words, and all seams together; signs are shortened as in running signing"
        )

    def cut_all(self, clips: Sequence[Clip]) -> list[Cut]:
        """Returns the splice positions of a sentence, chosen together (``best_path``)."""
        pairs = list(pairwise(clips))
        if self.whole:
            words = [(clip.source_clip or clip).derived[self.ends] for clip in clips]
            ends = [(p, q) for (p, _), (_, q) in pairwise(words)]
            chosen = best_path([_seam_scores(p, q, p.scores, q.scores) for p, q in ends])
            chosen = [outside_strokes(cut, *pair) for cut, pair in zip(chosen, ends, strict=True)]
        else:
            self.reader.prepare(clips)
            chosen = best_path([self.scores(*self.reader.pair(*pair)) for pair in pairs])
        last = [len(clip) - 1 for clip in clips]
        return [
            Cut(min(round(pre / FEATURE_FPS * p.fps), last[k]), min(round(post / FEATURE_FPS * q.fps), last[k + 1]))
            for k, ((pre, post), (p, q)) in enumerate(zip(chosen, pairs, strict=True))
        ]

    def scores(self, p: WordReading, q: WordReading) -> SeamScores:
        """Returns log-probabilities of leaving ``p`` at one frame and entering ``q``, which follows it, at another,
        frames at 30 a second.
        """
        return _seam_scores(p, q, *self._log_probabilities(p, q))

    def ends(self, clip: Clip) -> tuple[WordEnd, WordEnd]:
        """Returns the end of a word and its beginning, read by themselves; ``clip``: as it is before it is placed."""
        p, q = self.reader.alone(clip)
        if clip.points is not None:
            p, q = _between_rests(p), _between_rests(q)
        left, entered = self._log_probabilities(p, q)
        self.reader.forget(clip)  # a reading takes a hundred times the memory
        return _word_end(p, left), _word_end(q, entered)

    def _log_probabilities(self, p: WordReading, q: WordReading) -> tuple[FloatArray, FloatArray]:
        """Returns log-probabilities of leaving ``p`` (P,) and entering ``q`` (Q,) after it, at their active frames."""
        inputs = {"before": p.states, "leave": p.leave, "after": q.states, "enter": q.enter}
        lengths = {"left": (1, len(p.features)), "entered": (1, len(q.features))}
        outputs = self.reader.sessions.run("cut", inputs, **lengths)
        leave_scores, enter_scores = (
            scipy.special.log_softmax(outputs[name][0, slice(*word.active)].astype(np.float64))
            for name, word in (("left", p), ("entered", q))
        )
        return leave_scores, enter_scores


_RISE = 0.25
"""Speed of the higher hand from which on it rises or sinks, arm lengths/s."""
_LONGEST_RISE = 10
"""Largest number of frames for which it does so between rest and a stroke."""


def _between_rests(reading: WordReading) -> WordReading:
    """Returns a reading whose stroke begins after the hands' rise from rest and ends before they sink to it. In
    dictionaries on video hands rest before the belly, where the network takes the detector's tremor for strokes.
    """
    if reading.stroke is None:
        return reading
    start, stop = max(reading.stroke[0], reading.active[0]), min(reading.stroke[1] + 1, reading.active[1])
    kept = np.flatnonzero(~features.prepares_or_retracts(reading.phases[start:stop]))
    if not len(kept):
        return reading
    start, stop = start + int(kept[0]), start + int(kept[-1])
    rises = np.diff(reading.wrists[..., 1].max(axis=1)) * FEATURE_FPS
    first, last = start, stop
    while first < min(start + _LONGEST_RISE, last) and rises[first] > _RISE:
        first += 1
    while last > max(stop - _LONGEST_RISE, first) and rises[last - 1] < -_RISE:
        last -= 1
    return replace(reading, stroke=(first, last))


def _word_end(reading: WordReading, scores: FloatArray) -> WordEnd:
    heights = np.ascontiguousarray(reading.wrists[..., 1])
    return WordEnd(reading.first, reading.active, reading.stroke, heights, scores)


def _seam_scores(
    p: WordReading | WordEnd, q: WordReading | WordEnd, left: FloatArray, entered: FloatArray
) -> SeamScores:
    return SeamScores(left[:, None] + entered, p.first + p.active[0], q.first + q.active[0])


class LearnedTransition(Transition):
    """The limited Hermite curve, with arms corrected by a network that sees the gap and eight frames on either side.

    End poses and end velocities stay those of the curve. Fingers, trunk, neck, head and joints without a role, gaps of
    fewer than 2 or more than 45 frames at 30 a second, words drawn between keys (``Gap.keyed``), and rigs whose arms
    are not known by name follow the curve alone.
    """

    name, learned = NAME, True
    summary = "limited Hermite curve, its arms bent by a network that sees eight frames on either side"

    def __init__(self, sessions: Sessions) -> None:
        self.sessions = sessions
        self.base = find_transition("hermite")

    @property
    def identity(self) -> str | None:
        """The curve and the hash of the network."""
        network = self.sessions.config.files.get("bridge.onnx")
        return f"{self.base.name}+{network}" if type(self) is LearnedTransition and network else None

    def between(self, gap: Gap) -> Clip:
        """Returns the new frames of one gap."""
        return self.fill([gap])[0]

    def fill(self, gaps: Sequence[Gap]) -> list[Clip]:
        """Returns the new frames of every gap; curves and network inputs of all gaps are computed together."""
        clips = self.base.fill(gaps)
        bent = [row for row, gap in enumerate(gaps) if _within_limits(gap) and not gap.is_keyed]
        windows = [_window(gaps[row], clips[row]) for row in bent]
        for block in batch_clips(windows):
            rows = [bent[row] for row in block.rows]
            for row, clip in zip(rows, self._bend_arms(block, windows, [clips[row] for row in rows]), strict=True):
                clips[row] = clip
        return clips

    def _bend_arms(
        self, block: JoinedClips, windows: Sequence[tuple[Clip, Clip, Clip]], bases: list[Clip]
    ) -> list[Clip]:
        """Returns the curves of some gaps with their arms bent by the network."""
        counts = [(frames, len(windows[row][0]), len(windows[row][1])) for row, frames in block]
        seen = features.all_gap_features(canonical_motion(block.clip), counts)
        lengths = [n_frames for _, _, n_frames in counts]
        local = np.concatenate([base.local_rotations for base in bases])
        deltas = [
            features.delta_rotvecs(answer, gap, n_frames)
            for answer, gap, n_frames in zip(self._answers(seen), seen, lengths, strict=True)
        ]
        local = apply_deltas(block.clip.skeleton, local, np.concatenate(deltas), features.IS_ARM)
        parts = np.split(local, np.cumsum(lengths)[:-1])
        return [copy_unchecked(base, local_rotations=part) for base, part in zip(bases, parts, strict=True)]

    def _answers(self, seen: Sequence[features.GapFeatures]) -> FloatArray:
        """Returns the network's outputs (G, N_TERMS, A, 3). Each gap gets the numbers that it would get alone, bit for
        bit as far as tests show.
        """
        blocks = []
        for start in range(0, len(seen), _BATCH):
            tokens = np.stack([gap.tokens for gap in seen[start : start + _BATCH]])
            shape = (len(tokens), features.N_TERMS, int(features.IS_ARM.sum()), 3)
            blocks.append(self.sessions.run("bridge", {"tokens": tokens}, turns=shape)["turns"])
        return np.concatenate(blocks)

    def warnings(self, gap: Gap) -> tuple[str, ...]:
        """Returns a warning if the gap is too long for the network."""
        if features.gap_frames(gap.seconds) <= MAX_GAP_FRAMES:
            return ()
        seconds = gap.n_frames / gap.before.fps
        return (f"{seconds:.2f} s are longer than the network knows: made by {self.base.name} alone",)


def _within_limits(gap: Gap) -> bool:
    """Whether a gap is neither too short nor too long for the network, and the rig's arms are known."""
    n_frames = features.gap_frames(gap.seconds)
    return MIN_GAP_FRAMES <= n_frames <= MAX_GAP_FRAMES and rig_info(gap.before.skeleton).has_arms


def _window(gap: Gap, base: Clip) -> tuple[Clip, Clip, Clip]:
    """Returns the network's view of a gap bridged by a classical transition: frames before, between and after."""
    n_context = int(np.ceil((N_CONTEXT + 1) / FEATURE_FPS * base.fps)) + 1
    return gap.before[-n_context:], base, gap.after[:n_context]
