"""The networks' input features of clips, defined here only, for training and inference.

From a clip to features in three steps:

    motion = canonical_motion(clip)         # rig/info.py: the clip on the canonical humanoid
    sampled = trajectory(motion)            # resampled to FEATURE_FPS
    tokens = word_tokens(sampled)           # a word, for the network that cuts and times
    seen = gap_features(motion, ...)        # a gap, for the network that makes transitions

Features are computed at ``FEATURE_FPS`` frames a second, whatever the clip's own rate; on the canonical humanoid,
whatever its rig; and with the busier hand on the right, so that a mirrored clip has the same features. A gap includes
``N_CONTEXT`` frames of the signs on either side.

The cutting network also classifies the phase of each frame; ``stroke_span`` finds a word's strokes from these phases
and from the movements of the hands.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy
from numpy.polynomial.legendre import legvander
from numpy.typing import NDArray

from signsplice.motion import FloatArray, rotation
from signsplice.motion.cache import CACHE
from signsplice.rig.info import (
    FEATURE_FPS,
    LEFT,
    RIGHT,
    ROLES,
    TIPS,
    CanonicalMotion,
    mirror_deltas,
)
from signsplice.rig.roles import ARM


@dataclass(frozen=True)
class StrokeLimits:
    """Limits by which phases of frames and movements of hands give a word's strokes; frames at ``FEATURE_FPS``."""

    least_probability: float = 0.02
    """Probability from which on a frame may belong to a stroke. Of 300 synthetic words 7 lose a part at 0.05, 4 at
    0.02, which keeps 0.3 frames more; seams of the shipped words hardly change.
    """
    sure_probability: float = 0.5
    """Probability that at least one frame of a stroke must exceed."""
    least_pause_frames: int = 4
    """Length of the shortest pause between two strokes, frames: a shorter pause joins them, unless the hands move from
    or to rest in it.
    """
    parting_frames: int = 9
    """Longest time in which hands that rest on one another part before they rise, or meet as they sink, frames."""
    parting_height: float = 0.05
    """Largest height above the rest height of the higher hand at which hands part or meet, arm lengths."""
    least_stroke_frames: int = 5
    """Length of the shortest stroke within a movement from or to rest, frames."""
    rest_distance: float = 0.12
    """Distance from its first or last position up to which a hand rests, arm lengths."""
    one_hand_frames: int = 6
    """Shortest time, 0.2 s, from which on a hand counts as moving alone, frames."""


@dataclass(frozen=True)
class OutputLimits:
    """Limits from which on the output of the transition network has full weight."""

    gap_s: float = 0.6
    """Length of a gap, s."""
    hand_speed: float = 0.4
    """Mean speed of a hand, arm lengths a second: half of that in continuous signing."""


_STROKES = StrokeLimits()
_FULL_OUTPUT = OutputLimits()

VERSION = 5
"""Version of the features and of the networks' outputs: increased when either changes."""
N_ROTATION = 6 * len(ROLES)
N_POSITION = 3 * len(TIPS)
N_FRAME = 2 * (N_ROTATION + N_POSITION)
"""Numbers per frame: rotations and positions, and their rates."""
_RATE_SCALE = 1.0 / 5.0
"""Scales rates, which reach some units a second, to about 1."""


@dataclass(frozen=True, eq=False)
class CanonicalTrajectory:
    """A canonical motion sampled at any times, usually every 1 / ``FEATURE_FPS`` s from 0.

    rotations_6d: (T, R, 6) the first two columns of each rotation matrix.
    positions: (T, 12, 3) the joints of ``TIPS``, as in ``CanonicalMotion``, arm lengths.
    has_role: (R,) the roles that the rig has.
    """

    rotations_6d: FloatArray
    positions: FloatArray
    has_role: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.rotations_6d)

    @cached_property
    def wrist_travel(self) -> FloatArray:
        """Path lengths (2,) of the left and the right wrist, arm lengths."""
        steps = np.diff(self.positions[:, [0, len(TIPS) // 2]], axis=0)
        return np.asarray(np.linalg.norm(steps, axis=-1).sum(axis=0))


def trajectory(motion: CanonicalMotion, times: FloatArray | None = None) -> CanonicalTrajectory:
    """Samples a canonical motion at ``times`` (T,), seconds from its first frame; by default its whole length at
    ``FEATURE_FPS``.

    Between frames, positions and the six numbers of rotations are interpolated linearly, and the latter are
    orthonormalised. Before the first and after the last frame the pose is held.
    """
    n_frames = len(motion.quats)
    if times is None:
        times = np.arange(int((n_frames - 1) * FEATURE_FPS / motion.fps + 1e-6) + 1) / FEATURE_FPS
    return sample_motion(motion, frames_at(times, motion.fps, n_frames))


@dataclass(frozen=True, eq=False)
class MomentFrames:
    """Sample times of a motion as positions between its frames.

    low: (T,) the frame at or before each time.
    alpha: (T,) fraction of the way from there to the next frame, 0 to 1.
    mixed: rows of the times that are interpolated: none if all lie on frames.
    """

    low: NDArray[np.intp]
    alpha: FloatArray
    mixed: NDArray[np.intp]


def frames_at(times: FloatArray, fps: float, n_frames: int) -> MomentFrames:
    """Converts ``times`` (T,), seconds from the first of ``n_frames``, to frames."""
    positions = np.clip(np.asarray(times, np.float64) * fps, 0.0, n_frames - 1.0)
    low = np.minimum(positions.astype(int), max(n_frames - 2, 0))
    alpha = positions - low
    if np.all(np.abs(alpha - np.round(alpha)) < 1e-9):
        return MomentFrames(np.round(positions).astype(int), np.zeros_like(positions), np.zeros(0, np.intp))
    return MomentFrames(low, alpha, np.arange(len(positions)))


def sample_motion(motion: CanonicalMotion, frames: MomentFrames) -> CanonicalTrajectory:
    """Samples a canonical motion at these positions between frames."""
    rotations, positions = rotation.to_6d(motion.quats[frames.low]), motion.positions[frames.low]
    if len(frames.mixed):
        high = np.minimum(frames.low[frames.mixed] + 1, len(motion.quats) - 1)
        alpha = frames.alpha[frames.mixed, None, None]
        mixed = (1.0 - alpha) * rotations[frames.mixed] + alpha * rotation.to_6d(motion.quats[high])
        rotations[frames.mixed] = rotation.orthonormal_6d(mixed)
        positions[frames.mixed] = (1.0 - alpha) * positions[frames.mixed] + alpha * motion.positions[high]
    return CanonicalTrajectory(rotations, positions, motion.has_role)


def left_hand_busier(*trajectories: CanonicalTrajectory) -> bool:
    """Whether the left wrist travels farther than the right one, over all trajectories together."""
    left_travel, right_travel = (sum(float(motion.wrist_travel[side]) for motion in trajectories) for side in (0, 1))
    return left_travel > right_travel


def mirror_trajectory(sampled: CanonicalTrajectory) -> CanonicalTrajectory:
    """Mirrors a trajectory: left and right are exchanged."""
    flip = np.array([-1.0, 1.0, 1.0])
    order = np.r_[0 : LEFT.start, RIGHT.start : RIGHT.stop, LEFT.start : LEFT.stop]
    # A mirrored rotation is M A M, M = diag(-1, 1, 1): the signs of its first two columns.
    rotations = sampled.rotations_6d[:, order] * np.concatenate([-flip, flip])
    half = len(TIPS) // 2
    positions = np.concatenate([sampled.positions[:, half:], sampled.positions[:, :half]], axis=1) * flip
    return CanonicalTrajectory(rotations, positions, sampled.has_role[order])


def frame_features(
    sampled: CanonicalTrajectory,
    spacing: float | FloatArray = 1.0 / FEATURE_FPS,
    firsts: Sequence[int] = (0,),
) -> NDArray[np.float32]:
    """Returns features (T, N_FRAME): rotations, positions, and their rates from the frame before (per second,
    times ``_RATE_SCALE``; 0 at the first).

    spacing: seconds from every frame to the next, one number or (T - 1,).
    firsts: first frames of separate stretches, whose rates are 0.
    """
    features = np.empty((len(sampled), N_FRAME), np.float32)
    values, rates = np.split(features, 2, axis=1)
    values[:, :N_ROTATION] = sampled.rotations_6d.reshape(len(sampled), -1)
    values[:, N_ROTATION:] = sampled.positions.reshape(len(sampled), -1)
    np.subtract(values[1:], values[:-1], out=rates[1:])
    rates[1:] *= np.reshape(_RATE_SCALE / np.asarray(spacing, np.float64), (-1, 1)).astype(np.float32)
    rates[firsts] = 0.0
    return features


def tip_positions(features: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns positions (..., 2, 6, 3) of both wrists, each with its fingertips, arm lengths, from features
    (..., N_FRAME) of frames.
    """
    positions = features[..., N_ROTATION : N_ROTATION + N_POSITION]
    return positions.reshape(*features.shape[:-1], 2, len(TIPS) // 2, 3)


def wrist_positions(features: NDArray[np.float32]) -> NDArray[np.float32]:
    """Returns positions (..., 2, 3) of both wrists, arm lengths, from features (..., N_FRAME) of frames."""
    return tip_positions(features)[..., 0, :]


PHASES = ("rest", "preparation", "hold", "stroke", "retraction")
"""Phases of a word's frames (Kita et al. 1998): the stroke lasts from the start of the first movement to the end of the
last; a standstill before or after it is a hold.
"""
WORD_FRAMES = 150
"""Largest number of frames, at ``FEATURE_FPS``, of a word that a cutter sees: the last of the word before, the first of
the word after.
"""
N_WORD = N_FRAME + 2


def word_tokens(word: CanonicalTrajectory) -> NDArray[np.float32]:
    """Returns a cutter's input for a word (T, N_WORD): each frame's features, and the seconds from the word's first
    frame and to its last. The network reads frames in pairs: if their number is odd, the last one is repeated.
    """
    times = np.arange(len(word), dtype=np.float32) / np.float32(FEATURE_FPS)
    tokens = np.concatenate([frame_features(word), np.column_stack([times, times[-1] - times])], axis=1)
    return np.concatenate([tokens, tokens[-1:]]) if len(word) % 2 else tokens


Mask = NDArray[np.bool_]

_PREPARATION, _HOLD, _STROKE, _RETRACTION = range(1, len(PHASES))


def stroke_span(scores: NDArray[np.float32], raised: Mask, wrists: NDArray[np.floating]) -> tuple[int, int] | None:
    """Returns the first and last frame of a word's strokes from the scores (T, 5) of its frames' phases; ``raised``
    (T,): frames in which a stroke may lie; ``wrists`` (T, 2, 3), arm lengths.

    All frames count that may belong to a stroke, except strokes of which no frame is sure or raised, and hands that
    part before their preparation or meet after their retraction. Returns the middle frame of a sign that is only held,
    and None if there is neither stroke nor hold.
    """
    weights = np.exp(scores.astype(np.float64) - scores.max(axis=-1, keepdims=True))
    phases = weights / weights.sum(axis=-1, keepdims=True)
    possible = phases[:, _STROKE] > _STROKES.least_probability
    surest = phases.argmax(axis=-1)
    goes = prepares_or_retracts(scores)
    strokes, _ = scipy.ndimage.label(
        (scipy.ndimage.binary_closing(possible, np.ones(_STROKES.least_pause_frames, bool)) & ~goes) | possible
    )
    rows = [
        rows.start + np.flatnonzero(possible[rows])
        for (rows,) in scipy.ndimage.find_objects(strokes)
        if raised[rows].any() and phases[rows, _STROKE].max() > _STROKES.sure_probability
    ]
    heights, last = wrists[..., 1].max(axis=1), len(surest) - 1
    rows = _without_rest_moves(rows, heights, surest, _PREPARATION)
    rows = _without_rest_moves([last - row[::-1] for row in rows[::-1]], heights[::-1], surest[::-1], _RETRACTION)
    rows = [last - row[::-1] for row in rows[::-1]]
    if rows:
        return int(rows[0][0]), int(rows[-1][-1])
    holds = np.flatnonzero(raised & (phases[:, _HOLD] > 0.5))
    return (int(holds[len(holds) // 2]),) * 2 if len(holds) else None


def _without_rest_moves(
    strokes: list[NDArray[np.intp]], heights: NDArray[np.floating], phases: NDArray[np.intp], rest_phase: int
) -> list[NDArray[np.intp]]:
    """Removes a word's first strokes if hands only leave rest in them: the higher hand is as low as at rest and then
    moves to the next stroke, or the stroke is a moment within the phase ``rest_phase``. ``heights`` (T,) of the higher
    hand; ``phases`` (T,): the most probable phase of each frame.
    """
    while len(strokes) > 1:
        first, stop, between = int(strokes[0][0]), int(strokes[0][-1]) + 1, phases[strokes[0][-1] + 1 : strokes[1][0]]
        between = between[between != _HOLD]
        n_frames, low = stop - first, heights[0] + _STROKES.parting_height
        is_low = n_frames <= _STROKES.parting_frames and heights[strokes[0]].max() <= low
        goes = len(between) > 0 and np.isin(between, (_PREPARATION, _RETRACTION)).mean() > 0.5
        is_short = n_frames < _STROKES.least_stroke_frames
        is_moment = is_short and first > 0 and phases[first - 1] == phases[stop] == rest_phase
        if not (is_low and goes) and not is_moment:
            break
        strokes = strokes[1:]
    return strokes


def prepares_or_retracts(scores: NDArray[np.float32]) -> Mask:
    """Returns whether the surest phase of each frame, of scores (T, 5), is preparation or retraction (T,)."""
    return np.isin(scores.argmax(axis=-1), (_PREPARATION, _RETRACTION))


def are_away(wrists: NDArray[np.floating]) -> Mask:
    """Returns whether (T, 2) each wrist is away from its first and last position; ``wrists`` (T, 2, 3), arm lengths."""
    is_away = [np.linalg.norm(wrists - wrists[end], axis=-1) > _STROKES.rest_distance for end in (0, -1)]
    return np.asarray(is_away[0] & is_away[1])


def frames_alone(wrists: NDArray[np.floating]) -> Mask:
    """Returns the frames (T,) in which the first wrist of wrists (T, 2, 3) is away from rest while the second rests,
    for longer than one hand moves before or after the other.
    """
    is_away = are_away(wrists)
    return np.asarray(
        scipy.ndimage.binary_opening(is_away[:, 0] & ~is_away[:, 1], np.ones(_STROKES.one_hand_frames, bool))
    )


N_CONTEXT = 8
"""Frames of each sign that the transition network sees."""
MIN_GAP_FRAMES = 2
"""Shortest transition that it makes, frames at ``FEATURE_FPS``."""
MAX_GAP_FRAMES = 45
"""Longest transition that it makes, frames at ``FEATURE_FPS``."""
N_MOMENTS = 12
"""Number of evenly spaced sample times in a gap of any length."""
N_SEEN = N_CONTEXT + N_MOMENTS + N_CONTEXT
"""Number of sample times of a gap with its context."""
N_TOKEN = 2 * N_FRAME + 8
"""Numbers per token of a gap (``gap_tokens``)."""
N_TERMS = 3
"""Terms of the polynomial in time that it predicts."""
IS_ARM = np.array([role.endswith(ARM) for role in ROLES])
"""Roles (R,) that it corrects: collarbones, arms and wrists, A of them. On unseen captures its predictions for fingers,
trunk, neck and head were worse than the curve at every length of a gap.
"""


def gap_frames(seconds: float) -> int:
    """Returns the number of new frames at ``FEATURE_FPS`` between two frames that lie ``seconds`` apart."""
    return round(seconds * FEATURE_FPS) - 1


@dataclass(frozen=True, eq=False)
class GapMoments:
    """The ``N_SEEN`` sample times of a gap; they depend on numbers of frames only.

    seconds: from the last frame before to the first after.
    frames: the sample times as frames of the motion.
    position_codes: (N_SEEN, 8) one-hot before, in or after the gap; real (a frame of the clips and not a repeated edge)
        or not; time t in the gap from 0 to 1, t (1 - t), the gap's length and its logarithm.
    spacing: (N_SEEN,) seconds from every sample time to the next.
    """

    seconds: float
    frames: MomentFrames
    position_codes: NDArray[np.float32]
    spacing: FloatArray


def gap_moments(n_frames: int, n_before: int, n_between: int, fps: float) -> GapMoments:
    """Returns the sample times of a gap in ``n_frames``: ``n_before`` of the sign before, then ``n_between`` new."""
    seconds = (n_between + 1) / fps
    last, first = (n_before - 1) / fps, (n_before + n_between) / fps
    steps = np.arange(N_CONTEXT) / FEATURE_FPS
    inside = last + seconds * np.arange(1, N_MOMENTS + 1) / (N_MOMENTS + 1)
    times = np.concatenate([last - steps[::-1], inside, first + steps])
    is_real = (times > -1e-6) & (times < (n_frames - 1) / fps + 1e-6)
    spacing = np.full(N_SEEN, 1.0 / FEATURE_FPS)
    spacing[N_CONTEXT - 1 : N_CONTEXT + N_MOMENTS] = seconds / (N_MOMENTS + 1)
    t = np.clip((np.arange(N_SEEN) - N_CONTEXT + 1) / (N_MOMENTS + 1.0), 0.0, 1.0)
    part = np.zeros((N_SEEN, 3))
    part[:N_CONTEXT, 0] = part[N_CONTEXT:-N_CONTEXT, 1] = part[-N_CONTEXT:, 2] = 1.0
    length = np.full(N_SEEN, seconds)
    codes = np.column_stack([part, is_real, t, t * (1.0 - t), length, np.log(np.maximum(length, 0.02))])
    return GapMoments(seconds, frames_at(times, fps, n_frames), codes.astype(np.float32), spacing)


def gap_tokens(whole: CanonicalTrajectory, gaps: Sequence[GapMoments]) -> NDArray[np.float32]:
    """Returns the network's input for G gaps (G, N_SEEN, N_TOKEN) from ``whole``, sampled at the times of all ``gaps``
    in order: the sign before, a classical transition, the sign after.

    A token holds the frame's features, the same relative to the last frame before, and its position (``GapMoments``).
    """
    tokens = np.empty((len(gaps), N_SEEN, N_TOKEN), np.float32)
    spacing = np.concatenate([gap.spacing for gap in gaps])[:-1]
    frames = frame_features(whole, spacing, range(0, len(whole), N_SEEN)).reshape(len(gaps), N_SEEN, N_FRAME)
    tokens[..., :N_FRAME] = frames
    np.subtract(frames, frames[:, N_CONTEXT - 1, None], out=tokens[..., N_FRAME : 2 * N_FRAME])
    tokens[..., 2 * N_FRAME :] = [gap.position_codes for gap in gaps]
    return tokens


@dataclass(frozen=True, eq=False)
class GapFeatures:
    """The network's input for a gap, and the data that converts its output to the clip.

    tokens: (N_SEEN, N_TOKEN), see ``gap_tokens``.
    mirrored: whether the network sees the gap mirrored.
    weights: (A,) factors of the network's output, 0 to 1, in the order of the possibly mirrored arms
        (``answer_weights``).
    """

    tokens: NDArray[np.float32]
    mirrored: bool
    weights: FloatArray


def gap_features(joined: CanonicalMotion, n_before: int, n_between: int) -> GapFeatures:
    """Returns the features of a gap: ``n_before`` frames of the sign before, ``n_between`` of a classical transition,
    the sign after.
    """
    return all_gap_features(joined, [(slice(0, len(joined.quats)), n_before, n_between)])[0]


def all_gap_features(motion: CanonicalMotion, gaps: Sequence[tuple[slice, int, int]]) -> list[GapFeatures]:
    """Returns the features of gaps in one motion, each gap as (its frames, ``n_before``, ``n_between``)."""
    moments = [
        CACHE.recent(gap_moments, frames.stop - frames.start, *counts, motion.fps, most=512) for frames, *counts in gaps
    ]
    firsts = [frames.start for frames, _, _ in gaps]
    low = np.concatenate([first + gap.frames.low for first, gap in zip(firsts, moments, strict=True)])
    alpha = np.concatenate([gap.frames.alpha for gap in moments])
    mixed = np.concatenate([N_SEEN * k + gap.frames.mixed for k, gap in enumerate(moments)])
    seen = sample_motion(motion, MomentFrames(low, alpha, mixed))
    positions = seen.positions.reshape(len(gaps), N_SEEN, len(TIPS), 3)
    paths = np.linalg.norm(np.diff(positions, axis=1), axis=-1).sum(axis=1)  # (G, 12) path length of each joint
    mirror = paths[:, 0] > paths[:, len(TIPS) // 2]
    if mirror.any():
        rows = np.repeat(mirror, N_SEEN)
        part = mirror_trajectory(CanonicalTrajectory(seen.rotations_6d[rows], seen.positions[rows], seen.has_role))
        seen.rotations_6d[rows], seen.positions[rows] = part.rotations_6d, part.positions
        paths[mirror] = np.roll(paths[mirror], len(TIPS) // 2, axis=1)
    return [
        GapFeatures(tokens, bool(is_mirrored), answer_weights(path, gap.seconds))
        for tokens, is_mirrored, path, gap in zip(gap_tokens(seen, moments), mirror, paths, moments, strict=True)
    ]


def answer_weights(lengths: FloatArray, seconds: float) -> FloatArray:
    """Returns factors (A,) of the network's output for a gap of ``seconds``, from the path lengths (12,) of the joints
    of ``TIPS`` over the gap and its context: min(1, seconds / gap_s)^1.5, times min(1, v / hand_speed)^3, with v the
    mean speed of the arm's wrist and fingers, and the limits of ``OutputLimits``.

    Short gaps and resting hands, which a cubic bridges well, stay close to it (docs/decisions.md).
    """
    context_s = 2.0 * (N_CONTEXT - 1) / FEATURE_FPS
    speeds = lengths.reshape(2, -1).mean(axis=1) / (seconds + context_s)  # (2,)
    sides = min(1.0, seconds / _FULL_OUTPUT.gap_s) ** 1.5 * np.minimum(1.0, speeds / _FULL_OUTPUT.hand_speed) ** 3
    return np.repeat(sides, IS_ARM.sum() // 2)


def answer_basis(t: FloatArray) -> FloatArray:
    """Returns the polynomials (n, N_TERMS) of the network's output at times t (n,) in the gap, 0 to 1: 64 t^3 (1 - t)^3
    times the first Legendre polynomials, so that ends, end velocities and end accelerations stay those of the curve.
    """
    return 64.0 * (t * (1.0 - t))[:, None] ** 3 * legvander(2.0 * t - 1.0, N_TERMS - 1)


def delta_rotvecs(answer: FloatArray, seen: GapFeatures, n_between: int) -> FloatArray:
    """Converts the network's output (N_TERMS, A, 3) to canonical rotation vectors (n_between, R, 3), radians, of the
    frames of a transition; 0 for roles that it does not correct.
    """
    basis = answer_basis(np.arange(1, n_between + 1) / (n_between + 1))
    rotvecs = np.zeros((n_between, len(ROLES), 3))
    rotvecs[:, IS_ARM] = seen.weights[:, None] * np.tensordot(basis, answer.astype(np.float64), axes=1)
    return mirror_deltas(rotvecs) if seen.mirrored else rotvecs
