"""The features that networks see of clips: the only definition, for training and for running.

From a clip to features in three steps:

    motion = canonical_motion(clip)         # rig/info.py: the clip on the canonical humanoid
    whole = trajectory(motion)              # resampled to FEATURE_FPS
    tokens = word_tokens(whole)             # a word, for the network that cuts and times
    seen = gap_features(motion, ...)        # a gap, for the network that makes transitions

Everything is seen at ``FEATURE_FPS`` frames a second, whatever the clip's own rate; on the canonical humanoid, whatever
its rig; and with the busier hand at the right, so that a mirrored clip has the same features. A gap is seen with
``N_CONTEXT`` frames of the signs on either side.

The network that cuts also says which phase each frame is in; ``stroke_span`` finds a word's strokes by these, and by
which hand moves when.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial.legendre import legvander
from numpy.typing import NDArray
from scipy.ndimage import binary_closing, binary_opening, find_objects, label

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

VERSION = 5
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
    return sample_motion(motion, frames_at(times, motion.fps, n_frames))


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


def sample_motion(motion: CanonicalMotion, frames: MomentFrames) -> CanonicalTrajectory:
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


def mirror_trajectory(one: CanonicalTrajectory) -> CanonicalTrajectory:
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
    firsts: Sequence[int] = (0,),
) -> NDArray[np.float32]:
    """Features (T, N_FRAME) of frames: rotations, positions, and both as rates from the frame before (0 at the first).

    spacing: seconds from every frame to the next, one number or (T - 1,).
    firsts: frames with which stretches of their own begin.
    """
    out = np.empty((len(one), N_FRAME), np.float32)
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
_POSSIBLE, _SURE = 0.02, 0.5
"""Probability from which on a frame may be part of a stroke, and that of one frame of it at least. Of 300 made words 7
lose a part at 0.05, 4 at 0.02, which keeps 0.3 frames more; seams of the words that ship hardly change.
"""
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


N_CONTEXT = 8
"""Frames of each sign that the network which makes transitions sees."""
MIN_GAP_FRAMES, MAX_GAP_FRAMES = 2, 45
"""Fewest and most frames, at ``FEATURE_FPS``, of the transitions that it makes."""
N_MOMENTS = 12
"""Moments of a gap that it sees, evenly spaced, however long the gap is."""
N_SEEN = N_CONTEXT + N_MOMENTS + N_CONTEXT
N_TOKEN = 2 * N_FRAME + 8
N_TERMS = 3
"""Terms of the polynomial in time that it answers with."""
IS_ARM = np.array([role.endswith(ARM) for role in ROLES])
"""Roles (R,) that it corrects: collarbones, arms and wrists, A of them. On captures that networks had not seen, their
answers for fingers, trunk, neck and head were worse than the curve at every length of a gap.
"""


def gap_frames(seconds: float) -> int:
    """New frames at ``FEATURE_FPS`` between two frames that lie ``seconds`` apart."""
    return round(seconds * FEATURE_FPS) - 1


@dataclass(frozen=True, eq=False)
class GapMoments:
    """The ``N_SEEN`` moments at which the network looks at a gap; they follow from numbers of frames alone.

    seconds: from the last frame before to the first after.
    frames: of the motion that is looked at.
    position_codes: (N_SEEN, 8) one-hot before, in or after the gap; real (a frame of the clips and not a repeated edge)
        or not; time t in the gap from 0 to 1, t (1 - t), the gap's length and its logarithm.
    spacing: (N_SEEN,) seconds from every moment to the next.
    """

    seconds: float
    frames: MomentFrames
    position_codes: NDArray[np.float32]
    spacing: FloatArray


def gap_moments(n_frames: int, n_before: int, n_between: int, fps: float) -> GapMoments:
    """The moments of a gap: of ``n_frames``, ``n_before`` of the sign before and then ``n_between`` of a transition."""
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
    """What the network sees of G gaps (G, N_SEEN, N_TOKEN), of ``whole``, the moments of all ``gaps`` in order: the
    sign before, a classical transition, the sign after.

    A token is the frame's features, the same relative to the last frame before, and where it lies (``GapMoments``).
    """
    out = np.empty((len(gaps), N_SEEN, N_TOKEN), np.float32)
    spacing = np.concatenate([gap.spacing for gap in gaps])[:-1]
    frames = frame_features(whole, spacing, range(0, len(whole), N_SEEN)).reshape(len(gaps), N_SEEN, N_FRAME)
    out[..., :N_FRAME] = frames
    np.subtract(frames, frames[:, N_CONTEXT - 1, None], out=out[..., N_FRAME : 2 * N_FRAME])
    out[..., 2 * N_FRAME :] = [gap.position_codes for gap in gaps]
    return out


@dataclass(frozen=True, eq=False)
class GapFeatures:
    """A gap as the network sees it, and what its answer needs on the return to the clip.

    tokens: (N_SEEN, N_TOKEN), see ``gap_tokens``.
    mirrored: whether the network sees the gap in the mirror.
    weights: (A,) factors of the network's answer, 0 to 1, as it sees the arms (``answer_weights``).
    """

    tokens: NDArray[np.float32]
    mirrored: bool
    weights: FloatArray


def gap_features(joined: CanonicalMotion, n_before: int, n_between: int) -> GapFeatures:
    """The features of a gap: ``n_before`` frames of the sign before, ``n_between`` of a classical transition, the sign
    after.
    """
    return all_gap_features(joined, [(slice(0, len(joined.quats)), n_before, n_between)])[0]


def all_gap_features(motion: CanonicalMotion, gaps: Sequence[tuple[slice, int, int]]) -> list[GapFeatures]:
    """The features of gaps that lie in one motion, each (its frames, ``n_before``, ``n_between``)."""
    moments = [
        CACHE.recent(gap_moments, frames.stop - frames.start, *counts, motion.fps, most=_MOMENTS_KEPT)
        for frames, *counts in gaps
    ]
    firsts = [frames.start for frames, _, _ in gaps]
    low = np.concatenate([first + gap.frames.low for first, gap in zip(firsts, moments, strict=True)])
    alpha = np.concatenate([gap.frames.alpha for gap in moments])
    mixed = np.concatenate([N_SEEN * k + gap.frames.mixed for k, gap in enumerate(moments)])
    whole = sample_motion(motion, MomentFrames(low, alpha, mixed))
    positions = whole.positions.reshape(len(gaps), N_SEEN, len(TIPS), 3)
    paths = np.linalg.norm(np.diff(positions, axis=1), axis=-1).sum(axis=1)  # (G, 12) path length of each joint
    mirror = paths[:, 0] > paths[:, len(TIPS) // 2]
    if mirror.any():
        rows = np.repeat(mirror, N_SEEN)
        part = mirror_trajectory(CanonicalTrajectory(whole.rotations_6d[rows], whole.positions[rows], whole.has_role))
        whole.rotations_6d[rows], whole.positions[rows] = part.rotations_6d, part.positions
        paths[mirror] = np.roll(paths[mirror], len(TIPS) // 2, axis=1)
    return [
        GapFeatures(tokens, bool(is_mirrored), answer_weights(path, gap.seconds))
        for tokens, is_mirrored, path, gap in zip(gap_tokens(whole, moments), mirror, paths, moments, strict=True)
    ]


_CONTEXT_S = 2.0 * (N_CONTEXT - 1) / FEATURE_FPS
_MOMENTS_KEPT = 512
_FULL_SPEED = 0.4
"""Mean speed of a hand, arm lengths a second, from which on it counts as moving in full: half of continuous signing."""
FULL_S = 0.6
"""Length of a gap, seconds, from which on a network's answer counts in full."""


def answer_weights(lengths: FloatArray, seconds: float) -> FloatArray:
    """Factors (A,) of a network's answer for a gap of ``seconds``, by the path lengths (12,) of the joints of ``TIPS``
    over the gap and its context: min(1, seconds / FULL_S)^1.5, times the mean speed of the arm's wrist and fingers, as
    a fraction of ``_FULL_SPEED``, at most 1, to the third power.

    What a cubic bridges well stays near it: short gaps, and hands that rest, wherever they hang (docs/decisions.md).
    """
    speeds = lengths.reshape(2, -1).mean(axis=1) / (seconds + _CONTEXT_S)  # (2,)
    sides = min(1.0, seconds / FULL_S) ** 1.5 * np.minimum(1.0, speeds / _FULL_SPEED) ** 3
    return np.repeat(sides, IS_ARM.sum() // 2)


def answer_basis(t: FloatArray) -> FloatArray:
    """The polynomials (n, N_TERMS) of a network's answer at times t (n,) in the gap, 0 to 1: 64 t^3 (1 - t)^3 times
    Legendre's first ones, so that both ends, their velocities and their accelerations stay the curve's.
    """
    return 64.0 * (t * (1.0 - t))[:, None] ** 3 * legvander(2.0 * t - 1.0, N_TERMS - 1)


def delta_rotvecs(answer: FloatArray, seen: GapFeatures, n_between: int) -> FloatArray:
    """Canonical rotation vectors (n_between, R, 3), radians, that a network's answer (N_TERMS, A, 3) gives the frames
    of a transition; 0 for roles that it does not correct.
    """
    basis = answer_basis(np.arange(1, n_between + 1) / (n_between + 1))
    out = np.zeros((n_between, len(ROLES), 3))
    out[:, IS_ARM] = seen.weights[:, None] * np.tensordot(basis, answer.astype(np.float64), axes=1)
    return mirror_deltas(out) if seen.mirrored else out
