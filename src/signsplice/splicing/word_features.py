"""The features that networks see of clips: the only definition, for training and for running.

From a clip to features in three steps:

    motion = canonical_motion(clip)         # rig/canonical.py: the clip on the canonical humanoid
    whole = trajectory(motion)              # resampled to FEATURE_FPS
    tokens = word_tokens(whole)             # a word, for the network that cuts and times
    seen = gap_features(motion, ...)        # gap_features.py: a gap, for the network that makes transitions

Everything is seen at ``FEATURE_FPS`` frames a second, whatever the clip's own rate; on the canonical humanoid, whatever
its rig; and with the busier hand at the right, so that a mirrored clip has the same features.

A word's strokes by the phases that the network sees in its frames, and by which hand moves when.

Words as the cutting network reads them, each read once however often it is placed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_closing, binary_opening, find_objects, label

from signsplice.motion import Clip, FloatArray, rotation
from signsplice.rig.info import FEATURE_FPS, LEFT, RIGHT, ROLES, TIPS, CanonicalMotion, canonical_motion
from signsplice.splicing.bundle import Array, Sessions

VERSION = 4
"""Of the features and of the networks' outputs: raised when either changes."""
N_ROTATION = 6 * len(ROLES)
N_POSITION = 3 * len(TIPS)
N_FRAME = 2 * (N_ROTATION + N_POSITION)
"""Numbers of a frame: rotations and positions, and their rates."""
_RATE_SCALE = 1.0 / 5.0
"""Rates reach some units a second: this scales them to about 1."""


@dataclass(frozen=True, eq=False)
class CanonicalTrajectory:
    """A canonical motion at any moments, usually every 1 / ``FEATURE_FPS`` s from 0.

    rotations_6d: (T, R, 6) the first two columns of each rotation matrix.
    positions: (T, 12, 3) the joints of ``TIPS``, arm lengths.
    has_role: (R,) the roles that the rig has.
    """

    rotations_6d: FloatArray
    positions: FloatArray
    has_role: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.rotations_6d)

    @cached_property
    def wrist_travel(self) -> FloatArray:
        """Path length (2,) of the left and the right wrist, arm lengths."""
        steps = np.diff(self.positions[:, [0, len(TIPS) // 2]], axis=0)
        return np.asarray(np.linalg.norm(steps, axis=-1).sum(axis=0))


def trajectory(motion: CanonicalMotion, times: FloatArray | None = None) -> CanonicalTrajectory:
    """A canonical motion at ``times`` (T,), seconds from its first frame; at ``FEATURE_FPS`` over its whole length by
    default.

    Between frames, positions and the six numbers of rotations are interpolated linearly, and the latter brought back to
    a rotation. Before the first and after the last frame the pose is held.
    """
    n_frames = len(motion.quats)
    if times is None:
        times = np.arange(int((n_frames - 1) * FEATURE_FPS / motion.fps + 1e-6) + 1) / FEATURE_FPS
    return sampled(motion, frames_at(times, motion.fps, n_frames))


@dataclass(frozen=True, eq=False)
class MomentFrames:
    """Moments of a motion between its frames.

    low: (T,) the frame at or before each.
    alpha: (T,) how far each lies from there to the next frame, 0 to 1.
    mixed: rows of the moments that are interpolated: none where all lie on frames.
    """

    low: NDArray[np.intp]
    alpha: FloatArray
    mixed: NDArray[np.intp]


def frames_at(times: FloatArray, fps: float, n_frames: int) -> MomentFrames:
    """The frames at ``times`` (T,), seconds from the first of ``n_frames``."""
    at = np.clip(np.asarray(times, np.float64) * fps, 0.0, n_frames - 1.0)
    low = np.minimum(at.astype(int), max(n_frames - 2, 0))
    alpha = at - low
    if np.all(np.abs(alpha - np.round(alpha)) < 1e-9):
        return MomentFrames(np.round(at).astype(int), np.zeros_like(at), np.zeros(0, np.intp))
    return MomentFrames(low, alpha, np.arange(len(at)))


def sampled(motion: CanonicalMotion, frames: MomentFrames) -> CanonicalTrajectory:
    """A canonical motion at these moments."""
    rotations, positions = rotation.to_6d(motion.quats[frames.low]), motion.positions[frames.low]
    if len(frames.mixed):
        high = np.minimum(frames.low[frames.mixed] + 1, len(motion.quats) - 1)
        alpha = frames.alpha[frames.mixed, None, None]
        mixed = (1.0 - alpha) * rotations[frames.mixed] + alpha * rotation.to_6d(motion.quats[high])
        rotations[frames.mixed] = rotation.matrix_to_6d(rotation.matrix_from_6d(mixed))
        positions[frames.mixed] = (1.0 - alpha) * positions[frames.mixed] + alpha * motion.positions[high]
    return CanonicalTrajectory(rotations, positions, motion.has_role)


def left_hand_busier(*trajectories: CanonicalTrajectory) -> bool:
    """Whether the left wrist travels farther than the right one, over all trajectories together."""
    left, right = (sum(float(one.wrist_travel[side]) for one in trajectories) for side in (0, 1))
    return left > right


def mirrored(one: CanonicalTrajectory) -> CanonicalTrajectory:
    """A trajectory as it is in the mirror."""
    flip = np.array([-1.0, 1.0, 1.0])
    order = np.r_[0 : LEFT.start, RIGHT.start : RIGHT.stop, LEFT.start : LEFT.stop]
    # A mirrored rotation is M A M, M = diag(-1, 1, 1): the signs of its first two columns.
    rotations = one.rotations_6d[:, order] * np.concatenate([-flip, flip])
    half = len(TIPS) // 2
    positions = np.concatenate([one.positions[:, half:], one.positions[:, :half]], axis=1) * flip
    return CanonicalTrajectory(rotations, positions, one.has_role[order])


def frame_features(
    one: CanonicalTrajectory,
    spacing: float | FloatArray = 1.0 / FEATURE_FPS,
    firsts: Sequence[int] | NDArray[np.intp] = (0,),
    out: NDArray[np.float32] | None = None,
) -> NDArray[np.float32]:
    """Features (T, N_FRAME) of frames: rotations, positions, and both as rates from the frame before (0 at the first).

    spacing: seconds from every frame to the next, one number or (T - 1,).
    firsts: frames with which stretches of their own begin; out: where the features are written.
    """
    out = np.empty((len(one), N_FRAME), np.float32) if out is None else out
    values, rates = np.split(out, 2, axis=1)
    values[:, :N_ROTATION] = one.rotations_6d.reshape(len(one), -1)
    values[:, N_ROTATION:] = one.positions.reshape(len(one), -1)
    np.subtract(values[1:], values[:-1], out=rates[1:])
    rates[1:] *= np.reshape(_RATE_SCALE / np.asarray(spacing, np.float64), (-1, 1)).astype(np.float32)
    rates[firsts] = 0.0
    return out


def tip_positions(features: NDArray[np.float32]) -> NDArray[np.float32]:
    """Positions (..., 2, 6, 3) of both wrists, each with its fingertips, in features (..., N_FRAME) of frames, arm
    lengths.
    """
    positions = features[..., N_ROTATION : N_ROTATION + N_POSITION]
    return positions.reshape(*features.shape[:-1], 2, len(TIPS) // 2, 3)


def wrist_positions(features: NDArray[np.float32]) -> NDArray[np.float32]:
    """Positions (..., 2, 3) of both wrists in features (..., N_FRAME) of frames, arm lengths."""
    return tip_positions(features)[..., 0, :]


PHASES = ("rest", "preparation", "hold", "stroke", "retraction")
"""Phases of a word's frames (Kita et al. 1998): the stroke goes from the begin of the first movement to the end of the
last; a standstill before or after it is a hold.
"""
WORD_FRAMES = 150
"""Most frames, at ``FEATURE_FPS``, of a word that a cutter sees: the last of the word before, the first of the word
after.
"""
N_WORD = N_FRAME + 2


def word_tokens(word: CanonicalTrajectory) -> NDArray[np.float32]:
    """What a cutter sees of a word (T, N_WORD): each frame's features, and the seconds from the word's first frame and
    to its last. The network reads frames in twos: of a word with an odd number of frames the last one is repeated.
    """
    at = np.arange(len(word), dtype=np.float32) / np.float32(FEATURE_FPS)
    tokens = np.concatenate([frame_features(word), np.column_stack([at, at[-1] - at])], axis=1)
    return np.concatenate([tokens, tokens[-1:]]) if len(word) % 2 else tokens


Mask = NDArray[np.bool_]

_PREPARATION, _HOLD, _STROKE, _RETRACTION = range(1, len(PHASES))
_POSSIBLE, _SURE = 0.05, 0.5
"""Probability from which on a frame may be part of a stroke, and that of one frame of it at least."""
_JOINED = np.ones(4, bool)
"""Strokes that are fewer frames apart than these are one, unless those are a way from or to rest."""
_PARTING, _PARTING_HEIGHT = 9, 0.05
"""Hands that lie on one another part before they rise, and meet as they sink: that takes so many frames at most, at no
more than this height, arm lengths, above where the higher one rests.
"""
_MOMENT = 5
"""A stroke takes so many frames at least where it lies amid a way from or to rest."""
_AT_REST = 0.12
"""Distance, arm lengths, from where it begins or ends up to which a hand rests."""
_ALONE = 6
"""Frames, 0.2 s, from which on a hand moves alone."""


def stroke_span(scores: NDArray[np.float32], raised: Mask, wrists: NDArray[np.floating]) -> tuple[int, int] | None:
    """First and last frame of a word's strokes by the scores (T, 5) of its frames' phases; ``raised`` (T,): frames in
    which a stroke may lie; ``wrists`` (T, 2, 3), arm lengths.

    All frames count that are not surely something else; but not a stroke of which no frame is sure, or none is raised,
    nor hands that part before their preparation or meet after their retraction. The middle frame of a sign that is all
    hold; None where neither is seen.
    """
    weights = np.exp(scores.astype(np.float64) - scores.max(axis=-1, keepdims=True))
    phases = weights / weights.sum(axis=-1, keepdims=True)
    possible = phases[:, _STROKE] > _POSSIBLE
    surest = phases.argmax(axis=-1)
    goes = np.isin(surest, (_PREPARATION, _RETRACTION))
    strokes, _ = label((binary_closing(possible, _JOINED) & ~goes) | possible)
    rows = [
        rows.start + np.flatnonzero(possible[rows])
        for (rows,) in find_objects(strokes)
        if raised[rows].any() and phases[rows, _STROKE].max() > _SURE
    ]
    heights, last = wrists[..., 1].max(axis=1), len(surest) - 1
    rows = _without_rest_moves(rows, heights, surest, _PREPARATION)
    rows = _without_rest_moves([last - row[::-1] for row in rows[::-1]], heights[::-1], surest[::-1], _RETRACTION)
    rows = [last - row[::-1] for row in rows[::-1]]
    if rows:
        return int(rows[0][0]), int(rows[-1][-1])
    held = np.flatnonzero(raised & (phases[:, _HOLD] > 0.5))
    return (int(held[len(held) // 2]),) * 2 if len(held) else None


def _without_rest_moves(
    strokes: list[NDArray[np.intp]], heights: NDArray[np.floating], phases: NDArray[np.intp], rest_phase: int
) -> list[NDArray[np.intp]]:
    """The frames of each of a word's strokes without the first ones in which hands only leave rest, by the height (T,)
    of the higher one and the phase (T,) that each frame is surest in: it is as low as it rests, and goes from there to
    the next stroke, or it is a moment within the phase ``rest_phase``.
    """
    while len(strokes) > 1:
        first, stop, then = int(strokes[0][0]), int(strokes[0][-1]) + 1, phases[strokes[0][-1] + 1 : strokes[1][0]]
        then = then[then != _HOLD]
        is_low = stop - first <= _PARTING and heights[strokes[0]].max() <= heights[0] + _PARTING_HEIGHT
        goes = len(then) > 0 and np.isin(then, (_PREPARATION, _RETRACTION)).mean() > 0.5
        is_moment = stop - first < _MOMENT and first > 0 and phases[first - 1] == phases[stop] == rest_phase
        if not (is_low and goes) and not is_moment:
            break
        strokes = strokes[1:]
    return strokes


def are_away(wrists: NDArray[np.floating]) -> Mask:
    """Whether each wrist of wrists (T, 2, 3), arm lengths, is away from where it begins and ends (T, 2)."""
    away = [np.linalg.norm(wrists - wrists[end], axis=-1) > _AT_REST for end in (0, -1)]
    return np.asarray(away[0] & away[1])


def frames_alone(wrists: NDArray[np.floating]) -> Mask:
    """Frames (T,) in which the first wrist of wrists (T, 2, 3) is away from rest while the second rests, for longer
    than a hand that comes or goes a little before the other.
    """
    away = are_away(wrists)
    return np.asarray(binary_opening(away[:, 0] & ~away[:, 1], np.ones(_ALONE, bool)))


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
class _Shown:
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
        self._words: WeakKeyDictionary[Clip, _Shown] = WeakKeyDictionary()

    def alone(self, clip: Clip) -> tuple[WordReading, WordReading]:
        """A word seen with its own busier hand at the right: its end and its beginning, one and the same unless it is
        long. Neither depends on the words beside it.
        """
        (word,) = self.prepare([clip])
        mirror = left_hand_busier(word.trajectory)
        return self._alone(word, mirror, end=True), self._alone(word, mirror, end=False)

    def pair(self, before: Clip, after: Clip) -> tuple[WordReading, WordReading]:
        """Two words, both seen with the busier hand of the pair at the right, so that each hand of the one is that hand
        of the other; of long ones the end and the beginning.
        """
        p, q = self.prepare([before, after])
        mirror = left_hand_busier(p.trajectory, q.trajectory)
        return self._reading(p, mirror, end=True), self._reading(q, mirror, end=False)

    def prepare(self, clips: Sequence[Clip]) -> list[_Shown]:
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

    def _alone(self, word: _Shown, mirror: bool, end: bool) -> WordReading:
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

    def _reading(self, word: _Shown, mirror: bool, end: bool) -> WordReading:
        key = (mirror, end and len(word.trajectory.positions) > WORD_FRAMES, False)
        if key not in word.readings:
            tokens = word_tokens(mirrored(word.trajectory) if mirror else word.trajectory)
            first = len(tokens) - WORD_FRAMES if key[1] else 0
            tokens = tokens[first : first + WORD_FRAMES]
            n, n_phases = len(tokens), len(PHASES)
            outputs = self.sessions.run(
                "word", {"tokens": tokens[None]}, states=(1, n, None), leave=(1, None), enter=(1, None),
                phases=(1, n, n_phases),
            )  # fmt: skip
            start, stop = (min(max(frame - first, 0), len(tokens)) for frame in word.active)
            wrists, is_active = wrist_positions(tokens), np.zeros(n, bool)
            is_active[start:stop] = True
            word.readings[key] = WordReading(
                features=tokens[:, :N_FRAME],
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
    """A word without the rest, or the standing still wherever the hands are, that goes beyond ``REST_FRAMES``: the
    networks learned from words that begin and end soon.
    """
    start, stop = motion.active_span
    whole = trajectory(motion)
    # Frames at FEATURE_FPS that lie within the span whatever the clip's own rate.
    last = min(int((stop - 1) / motion.fps * FEATURE_FPS + 1e-6), len(whole.positions) - 1)
    start, stop = min(int(np.ceil(start / motion.fps * FEATURE_FPS - 1e-6)), last), last + 1
    n = len(whole.positions)
    away = np.logical_or(*are_away(whole.positions[:, :: whole.positions.shape[1] // 2]).T)
    first = max(0, _n_left_out(whole.positions, away, start))
    kept = slice(first, n - max(0, _n_left_out(whole.positions[::-1], away[::-1], n - stop)))
    start, stop = max(start, first), min(stop, kept.stop)
    shown = CanonicalTrajectory(whole.rotations_6d[kept], whole.positions[kept], whole.has_role)
    return _Shown(shown, first, (start - first, stop - first))


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
