"""The best cuts of a whole sentence, by dynamic programming (Viterbi 1967).

A cutter that scores every pair of frames for every seam cannot take the best pair of each seam alone: a word must not
be left before it was entered. The best sentence is found over the frames at which words are entered, in time linear in
the number of words.

Where a word is left and entered beside its strokes: these stay whole, and ways from and to rest are left out.

The learned cutter, duration and transition: a bundle's networks behind the classes of the classical methods.

Two words are seen on the canonical humanoid at 30 frames a second (``features``); the networks' answers go back to the
clips' own joints and rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_softmax

from signsplice.errors import InputError
from signsplice.motion import Clip, FloatArray, JoinedClips, joined
from signsplice.rig.info import FEATURE_FPS, ROLES, apply_deltas, canonical_motion, rig_info
from signsplice.rig.metrics import is_keyed
from signsplice.rig.roles import ARM
from signsplice.splicing import gap_features, word_features
from signsplice.splicing.bundle import Sessions, read_config
from signsplice.splicing.contracts import Cut, Cutter, Duration, Gap, Transition
from signsplice.splicing.curves import find_transition
from signsplice.splicing.durations import HUMAN_MEDIAN_S, travel_law
from signsplice.splicing.gap_features import MAX_GAP_FRAMES, MIN_GAP_FRAMES, N_CONTEXT
from signsplice.splicing.word_features import WordReader, WordReading

_TOO_EARLY = 1e6
"""Cost of every frame that a word is left too early: larger than any score, but finite, so that there is an answer."""


@dataclass(frozen=True, eq=False)
class SeamScores:
    """The scores of a seam.

    scores: (P, Q) of leaving the word before at frame ``leaves_from`` + row, and entering the word after at frame
        ``enters_from`` + column.
    leaves_from, enters_from: first frames of rows and columns.
    """

    scores: FloatArray
    leaves_from: int
    enters_from: int = 0


def best_path(seams: Sequence[SeamScores], least: int = 1) -> list[tuple[int, int]]:
    """The frames (left, entered) of every seam whose scores have the largest sum, among all with at least ``least``
    frames between entering and leaving a word; of a word that is too short for that, as many as it has.
    """
    sums_so_far, entered_from = np.zeros(1), 0  # best sum by the frame at which the word before was entered
    back: list[tuple[NDArray[np.intp], NDArray[np.intp]]] = []
    for seam in seams:
        latest = seam.leaves_from + np.arange(len(seam.scores)) - least
        kept, entered = _best_entry(sums_so_far, latest - entered_from)
        sums = seam.scores + kept[:, None]  # (P, Q)
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
    """The best sum no later than each of ``latest``, and the frame of entering that it belongs to."""
    running = np.maximum.accumulate(sums)
    improves = np.concatenate([[True], sums[1:] > running[:-1]])
    where = np.maximum.accumulate(np.where(improves, np.arange(len(sums)), 0))
    at = np.minimum(latest, len(sums) - 1)
    missing = np.maximum(-at, 0)  # frames before the word's first one, at which it cannot be entered
    at = np.maximum(at, 0)
    return np.where(missing > 0, sums[0], running[at]) - _TOO_EARLY * missing, np.where(missing > 0, 0, where[at])


BELOW, NEXT_BELOW = 0.015, 0.03
"""How far below the end of its stroke, arm lengths (0.8 cm), a hand is still kept, and in the next frame beside it,
where movements are too slow to be told from holds: a hand that is farther below in a thirtieth of a second falls. Of
the words that ship, twice as many transitions dip by over 3 cm at 0.02, and at 0.01 one stroke in a hundred loses a
frame.
"""
_BESIDE = 2
"""Frames beside a stroke that are kept, unless a hand is below it there."""


def outside_strokes(cut: tuple[int, int], p: WordReading, q: WordReading) -> tuple[int, int]:
    """A cut, frames at ``FEATURE_FPS``, moved outwards until it leaves both words' strokes whole, then inwards, as far
    as these, past frames in which a hand has begun to sink or still rises: a transition that ends in them goes down
    first, below both signs.
    """
    pre, post = cut
    if p.stroke is not None:
        last, end = p.first + p.stroke[1], p.first + len(p.features) - 1
        pre = last + _n_raised(p, range(last, min(max(pre, last + _BESIDE), end) + 1))
    if q.stroke is not None:
        first = q.first + q.stroke[0]
        post = first - _n_raised(q, range(first, max(min(post, first - _BESIDE), q.first) - 1, -1))
    return pre, post


def _n_raised(word: WordReading, frames: range) -> int:
    """How many of a word's frames, away from its stroke, lie before the last at which both hands are still as high as
    in the first.
    """
    heights = word.wrists[np.array(frames) - word.first, :, 1]  # (n, 2)
    below = (heights[0] - heights).max(axis=1)
    return int(np.flatnonzero(below <= np.where(np.arange(len(below)) == 1, NEXT_BELOW, BELOW))[-1])


SYSTEM = "signsplice"
NAME, FLUENT = "learned", "learned-fluent"
_BATCH = 16
"""Gaps of one pass at most: larger passes take as long a gap."""
_CORRECTED = np.array([role.endswith(ARM) for role in ROLES])
"""Roles (R,) that the network corrects: collarbones, arms and wrists. On captures that it had not seen, its answer
for fingers, trunk, neck and head was worse than the curve at every length of a gap.
"""


def open_sessions(folder: str | Path) -> Sessions:
    """The networks of a bundle; each is read and checked when first run.

    Raises ``InputError`` where the folder holds no bundle, another system's, or one that was made for other features.
    """
    folder = Path(folder)
    config = read_config(folder)
    if config.system != SYSTEM:
        raise InputError(f"{folder}: is a bundle of {config.system!r}, expected one of {SYSTEM!r}")
    if config.features != word_features.VERSION:
        raise InputError(
            f"{folder}: was made for features {config.features}, and these are {word_features.VERSION}; train it anew"
        )
    return Sessions(folder, config)


class LearnedCutter(Cutter):
    """Scores the frames at which words are left and entered, and chooses all seams of a sentence together.

    whole: no movement is cut into; a word is left after its last movement and entered before its first, as far as they
        lie between rests. Every word is read by its own busier hand and scored as if it stood before and after itself,
        so that it is cut alike whatever stands beside it. Otherwise, words are read and scored in pairs: the motion
        that the network learned from shortens signs as running signing does, by where the hands go next; repetitions
        go, and the outer part of movements.

    Words are left and entered while their arms are away from rest, where the height of the hands shows rest
    (``arms.active_span``), whatever the network takes it for.
    """

    learned = own_rate = True

    def __init__(self, reader: WordReader, whole: bool = True) -> None:
        self.reader, self.whole = reader, whole
        self._scores: WeakKeyDictionary[WordReading, tuple[FloatArray, FloatArray]] = WeakKeyDictionary()
        self.name = NAME if whole else FLUENT
        self.summary = "a network that reads " + (
            "every word by itself; movements stay whole"
            if whole
            else "both words, and all seams together; signs are shortened as in running signing"
        )

    def cut_all(self, clips: Sequence[Clip]) -> list[Cut]:
        """The splice positions of a sentence, chosen together (``viterbi``)."""
        self.reader.prepare(clips)
        pairs = list(pairwise(clips))
        if self.whole:
            words = [self.reader.alone(clip) for clip in clips]
            scored = [self._scored_alone(*word) for word in words]
            readings = [(p, q) for (p, _), (_, q) in pairwise(words)]
            seams = [(left, entered) for (left, _), (_, entered) in pairwise(scored)]
        else:
            readings = [self.reader.pair(*pair) for pair in pairs]
            seams = [self._log_probabilities(*pair) for pair in readings]
        last = [len(clip) - 1 for clip in clips]
        chosen = best_path([_seam_scores(*pair, *seam) for pair, seam in zip(readings, seams, strict=True)])
        if self.whole:
            chosen = [outside_strokes(cut, *pair) for cut, pair in zip(chosen, readings, strict=True)]
        return [
            Cut(min(round(pre / FEATURE_FPS * p.fps), last[k]), min(round(post / FEATURE_FPS * q.fps), last[k + 1]))
            for k, ((pre, post), (p, q)) in enumerate(zip(chosen, pairs, strict=True))
        ]

    def scores(self, p: WordReading, q: WordReading) -> SeamScores:
        """Log-probabilities of leaving one word at a frame and entering the other, which follows it, at another, frames
        at 30 a second.
        """
        return _seam_scores(p, q, *self._log_probabilities(p, q))

    def _scored_alone(self, end: WordReading, beginning: WordReading) -> tuple[FloatArray, FloatArray]:
        """``_log_probabilities`` of a word before and after itself, kept as long as what was read of it."""
        if end not in self._scores:
            self._scores[end] = self._log_probabilities(end, beginning)
        return self._scores[end]

    def _log_probabilities(self, p: WordReading, q: WordReading) -> tuple[FloatArray, FloatArray]:
        """Log-probabilities of leaving ``p`` (P,) and of entering ``q`` (Q,) after it, at their active frames."""
        inputs = {"before": p.states, "leave": p.leave, "after": q.states, "enter": q.enter}
        lengths = {"left": (1, len(p.features)), "entered": (1, len(q.features))}
        outputs = self.reader.sessions.run("cut", inputs, **lengths)
        left, entered = (
            log_softmax(outputs[name][0, slice(*word.active)].astype(np.float64))
            for name, word in (("left", p), ("entered", q))
        )
        return left, entered


def _seam_scores(p: WordReading, q: WordReading, left: FloatArray, entered: FloatArray) -> SeamScores:
    return SeamScores(left[:, None] + entered, p.first + p.active[0], q.first + q.active[0])


class LearnedDuration(Duration):
    """How long a transition takes, by the network that cuts: from the two frames that it joins, and both words.

    unhurried: never shorter than human transitions, 0.25 s in the median and more for long distances
        (``duration.travel_law``), since viewers of avatars prefer transitions slower than human ones (Al-khazraji et
        al. 2021).
    """

    name, learned = NAME, True
    summary = "a network that sees both words and the two frames that are joined"

    def __init__(self, reader: WordReader, unhurried: bool = True) -> None:
        self.reader, self.unhurried = reader, unhurried

    def seconds(self, before: Clip, after: Clip, cut: Cut) -> float:
        """Seconds that the new frames take: the network's, from the last frame kept to the first, less one frame."""
        p, q = self.reader.pair(before, after)
        inputs = {"leave": p.leave, "enter": q.enter}
        for name, word, frame, clip in (("leaving", p, cut.pre, before), ("entering", q, cut.post, after)):
            row = round(frame / clip.fps * FEATURE_FPS) - word.first
            inputs[name] = word.features[None, min(max(row, 0), len(word.features) - 1)]
        answer = self.reader.sessions.run("duration", inputs, seconds=(1,))["seconds"]
        seconds = float(answer[0]) - 1.0 / before.fps
        if not self.unhurried:
            return seconds
        return max(seconds, HUMAN_MEDIAN_S, travel_law(_travel(inputs["leaving"][0], inputs["entering"][0], before)))


def _travel(leaving: NDArray[np.float32], entering: NDArray[np.float32], clip: Clip) -> float:
    """Distance of the hand that goes farther between two frames' features (N_FRAME,), in shoulder widths."""
    distances = np.linalg.norm(
        word_features.wrist_positions(entering) - word_features.wrist_positions(leaving), axis=-1
    )
    sizes = rig_info(clip.skeleton).sizes
    return float(distances.max()) * sizes.arm_length / sizes.shoulder_width


class LearnedTransition(Transition):
    """The limited Hermite curve, its arms corrected by a network that sees the gap and eight frames on either side.

    End poses and end velocities stay those of the curve. Fingers, trunk, neck, head and joints without a role, gaps of
    fewer than 2 or more than 45 frames at 30 a second, words that were drawn between keys (``metrics.is_keyed``), and
    rigs whose arms are not known by name follow the curve alone.
    """

    name, learned = NAME, True
    summary = "limited Hermite curve, its arms bent by a network that sees eight frames on either side"

    corrected = _CORRECTED
    """Roles (R,) whose joints the network corrects."""

    def __init__(self, sessions: Sessions) -> None:
        self.sessions = sessions
        self.base = find_transition("hermite")

    @property
    def identity(self) -> str | None:
        """The curve and the hash of the network."""
        network = self.sessions.config.files.get("bridge.onnx")
        return f"{self.base.name}+{network}" if type(self) is LearnedTransition and network else None

    def between(self, gap: Gap) -> Clip:
        """The new frames of one gap."""
        return self.fill([gap])[0]

    def fill(self, gaps: Sequence[Gap]) -> list[Clip]:
        """The new frames of every gap: the curves of all, and what the network sees of them, are computed together."""
        made = self.base.fill(gaps)
        bent = [row for row, gap in enumerate(gaps) if _within_limits(gap) and not is_keyed(gap.before, gap.after)]
        windows = [_window(gaps[row], made[row]) for row in bent]
        for block in joined(windows):
            rows = [bent[row] for row in block.rows]
            for row, clip in zip(rows, self._bent(block, windows, [made[row] for row in rows]), strict=True):
                made[row] = clip
        return made

    def _bent(self, block: JoinedClips, windows: Sequence[tuple[Clip, Clip, Clip]], bases: list[Clip]) -> list[Clip]:
        """The curves of some gaps with their arms bent by the network."""
        counts = [(frames, len(windows[row][0]), len(windows[row][1])) for row, frames in block]
        seen = gap_features.all_gap_features(canonical_motion(block.clip), counts)
        lengths = [n_frames for _, _, n_frames in counts]
        local = np.concatenate([base.local_rotations for base in bases])
        deltas = [
            gap_features.delta_rotvecs(rotvecs, one, n_frames)
            for rotvecs, one, n_frames in zip(self._rotvecs(seen), seen, lengths, strict=True)
        ]
        local = apply_deltas(block.clip.skeleton, local, np.concatenate(deltas), self.corrected)
        parts = np.split(local, np.cumsum(lengths)[:-1])
        return [replace(base, local_rotations=part) for base, part in zip(bases, parts, strict=True)]

    def _rotvecs(self, seen: Sequence[gap_features.GapFeatures]) -> list[FloatArray]:
        """The network's rotation vectors (n_gap, R, 3) of every gap. Gaps of one length are a batch; each gets the
        numbers that it would get alone, bit for bit, as far as measured (tests compare).
        """
        found: dict[int, FloatArray] = {}
        lengths = [one.n_gap for one in seen]
        for n_gap in set(lengths):
            rows = [row for row, length in enumerate(lengths) if length == n_gap]
            for start in range(0, len(rows), _BATCH):
                batch = rows[start : start + _BATCH]
                tokens = np.stack([seen[row].tokens for row in batch], dtype=np.float32)
                inputs = {"tokens": tokens, "mask": np.ones(tokens.shape[:2], bool)}
                shape = (len(batch), n_gap, len(ROLES), 3)
                found |= zip(batch, self.sessions.run("bridge", inputs, turns=shape)["turns"], strict=True)
        return [found[row] for row in range(len(seen))]

    def warnings(self, gap: Gap) -> tuple[str, ...]:
        """A line about a gap that is too long for the network."""
        if gap_features.gap_frames(gap.seconds) <= MAX_GAP_FRAMES:
            return ()
        seconds = gap.n_frames / gap.before.fps
        return (f"{seconds:.2f} s are longer than the network knows: made by {self.base.name} alone",)


def _within_limits(gap: Gap) -> bool:
    """Whether a gap is neither too short nor too long for the network, on a rig whose arms are known."""
    n_frames = gap_features.gap_frames(gap.seconds)
    return MIN_GAP_FRAMES <= n_frames <= MAX_GAP_FRAMES and rig_info(gap.before.skeleton).has_arms


def _window(gap: Gap, base: Clip) -> tuple[Clip, Clip, Clip]:
    """What the network sees of a gap that a classical transition bridges: frames before, between and after."""
    n_context = int(np.ceil((N_CONTEXT + 1) / FEATURE_FPS * base.fps)) + 1
    return gap.before[-n_context:], base, gap.after[:n_context]
