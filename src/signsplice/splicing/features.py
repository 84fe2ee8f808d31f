"""The features that networks see of clips: the only definition, for training and for running.

From a clip to features in three steps:

    motion = canonical_motion(clip)         # rig/canonical.py: the clip on the canonical humanoid
    whole = trajectory(motion)              # resampled to FEATURE_FPS
    tokens = word_tokens(whole)             # a word, for the network that cuts and times
    seen = gap_features(motion, ...)        # a gap, for the network that makes transitions (does the resampling itself)

Everything is seen at ``FEATURE_FPS`` frames a second, whatever the clip's own rate; on the canonical humanoid, whatever
its rig; and with the busier hand at the right, so that a mirrored clip has the same features.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from signsplice.motion import rotation
from signsplice.rig.canonical import FEATURE_FPS, CanonicalMotion, mirrored_deltas
from signsplice.rig.canonical_map import LEFT, RIGHT, ROLES, TIPS

Float = NDArray[np.float64]

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

    rotations_6d: Float
    positions: Float
    has_role: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.rotations_6d)

    @cached_property
    def wrist_travel(self) -> Float:
        """Path length (2,) of the left and the right wrist, arm lengths."""
        steps = np.diff(self.positions[:, [0, len(TIPS) // 2]], axis=0)
        return np.asarray(np.linalg.norm(steps, axis=-1).sum(axis=0))


def trajectory(motion: CanonicalMotion, times: Float | None = None) -> CanonicalTrajectory:
    """A canonical motion at ``times`` (T,), seconds from its first frame; at ``FEATURE_FPS`` over its whole length by
    default.

    Between frames, positions and the six numbers of rotations are interpolated linearly, and the latter brought back to
    a rotation. Before the first and after the last frame the pose is held.
    """
    n_frames = len(motion.quats)
    if times is None:
        times = np.arange(int((n_frames - 1) * FEATURE_FPS / motion.fps + 1e-6) + 1) / FEATURE_FPS
    at = np.clip(np.asarray(times, np.float64) * motion.fps, 0.0, n_frames - 1.0)
    low = np.minimum(at.astype(int), max(n_frames - 2, 0))
    alpha = at - low
    if np.all(np.abs(alpha - np.round(alpha)) < 1e-9):
        exact = np.round(at).astype(int)
        return CanonicalTrajectory(rotation.to_6d(motion.quats[exact]), motion.positions[exact], motion.has_role)
    high = np.minimum(low + 1, n_frames - 1)
    rotations = rotation.to_6d(motion.quats)
    mixed = (1.0 - alpha)[:, None, None] * rotations[low] + alpha[:, None, None] * rotations[high]
    positions = (1.0 - alpha)[:, None, None] * motion.positions[low] + alpha[:, None, None] * motion.positions[high]
    return CanonicalTrajectory(rotation.matrix_to_6d(rotation.matrix_from_6d(mixed)), positions, motion.has_role)


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


def frame_features(one: CanonicalTrajectory, spacing: float | Float = 1.0 / FEATURE_FPS) -> NDArray[np.float32]:
    """Features (T, N_FRAME) of frames: rotations, positions, and both as rates from the frame before (0 at the first).

    spacing: seconds from every frame to the next, one number or (T - 1,).
    """
    out = np.empty((len(one), N_FRAME), np.float32)
    values, rates = np.split(out, 2, axis=1)
    values[:, :N_ROTATION] = one.rotations_6d.reshape(len(one), -1)
    values[:, N_ROTATION:] = one.positions.reshape(len(one), -1)
    rates[0] = 0.0
    np.subtract(values[1:], values[:-1], out=rates[1:])
    rates[1:] *= np.reshape(_RATE_SCALE / np.asarray(spacing, np.float64), (-1, 1)).astype(np.float32)
    return out


def wrist_positions(features: NDArray[np.float32]) -> NDArray[np.float32]:
    """Positions (..., 2, 3) of both wrists in features (..., N_FRAME) of frames, arm lengths."""
    positions = features[..., N_ROTATION : N_ROTATION + N_POSITION].reshape(*features.shape[:-1], len(TIPS), 3)
    return positions[..., [0, len(TIPS) // 2], :]


CONTEXT = 8
"""Frames of each sign that the network which makes transitions sees."""
MIN_GAP_FRAMES, MAX_GAP_FRAMES = 2, 45
"""Fewest and most frames, at ``FEATURE_FPS``, of the transitions that it makes."""
N_TOKEN = 2 * N_FRAME + 8


def gap_frames(seconds: float) -> int:
    """New frames at ``FEATURE_FPS`` between two frames that lie ``seconds`` apart: the network looks at so many
    moments.
    """
    return round(seconds * FEATURE_FPS) - 1


def gap_tokens(
    whole: CanonicalTrajectory, n_gap: int, is_real: NDArray[np.bool_], seconds: float
) -> NDArray[np.float32]:
    """What the network sees of a gap (S, N_TOKEN), S = CONTEXT + n_gap + CONTEXT.

    whole: S frames: the sign before, a classical transition, the sign after.
    is_real: (S,) which are frames of the clips and not repeated edges.
    seconds: from the last frame before to the first after.

    A token is the frame's features, the same relative to the last frame before, and where it lies: one-hot before, in
    or after the gap, real or not, time t in the gap from 0 to 1, t (1 - t), the gap's length and its logarithm.
    """
    spacing = np.full(len(whole) - 1, 1.0 / FEATURE_FPS)
    spacing[CONTEXT - 1 : CONTEXT + n_gap] = seconds / (n_gap + 1)
    own = frame_features(whole, spacing)
    relative = own - own[CONTEXT - 1]
    t = np.clip((np.arange(len(own)) - CONTEXT + 1) / (n_gap + 1.0), 0.0, 1.0)
    part = np.zeros((len(own), 3))
    part[:CONTEXT, 0] = part[CONTEXT : CONTEXT + n_gap, 1] = part[CONTEXT + n_gap :, 2] = 1.0
    length = np.full(len(own), seconds)
    where = np.column_stack([part, is_real, t, t * (1.0 - t), length, np.log(np.maximum(length, 0.02))])
    return np.concatenate([own, relative, where.astype(np.float32)], axis=1)


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


@dataclass(frozen=True, eq=False)
class GapFeatures:
    """A gap as the network sees it, and what its answer needs on the return to the clip.

    tokens: (CONTEXT + n_gap + CONTEXT, N_TOKEN), see ``gap_tokens``.
    n_gap: frames of the gap at ``FEATURE_FPS``.
    seconds: from the last frame before to the first after.
    mirrored: whether the network sees the gap in the mirror.
    motion_weights: (R,) how much each role's side moves, 0 to 1, as the network sees it (``motion_weights``).
    """

    tokens: NDArray[np.float32]
    n_gap: int
    seconds: float
    mirrored: bool
    motion_weights: Float


def gap_features(joined: CanonicalMotion, n_before: int, n_between: int) -> GapFeatures:
    """The features of a gap: ``joined`` is ``n_before`` frames of the sign before, ``n_between`` of a classical
    transition, then the sign after.
    """
    seconds = (n_between + 1) / joined.fps
    n_gap = gap_frames(seconds)
    last, first = (n_before - 1) / joined.fps, (n_before + n_between) / joined.fps
    steps = np.arange(CONTEXT) / FEATURE_FPS
    times = np.concatenate([last - steps[::-1], last + seconds * np.arange(1, n_gap + 1) / (n_gap + 1), first + steps])
    end = (len(joined.quats) - 1) / joined.fps
    is_real = (times > -1e-6) & (times < end + 1e-6)
    whole = trajectory(joined, times)
    flip = left_hand_busier(whole)
    whole = mirrored(whole) if flip else whole
    weights = motion_weights(whole, seconds + 2.0 * (CONTEXT - 1) / FEATURE_FPS)
    return GapFeatures(gap_tokens(whole, n_gap, is_real, seconds), n_gap, seconds, flip, weights)


_FULL_SPEED = 0.4
"""Mean speed of a hand, arm lengths a second, from which on it counts as moving in full: half of continuous signing."""


def motion_weights(whole: CanonicalTrajectory, seconds: float) -> Float:
    """How much each role's side moves (R,): the mean path length of its wrist and finger joints over ``seconds``, as a
    fraction of ``_FULL_SPEED``, at most 1, to the third power; for the trunk that of the side that moves more.

    A network's answer is multiplied by this: an arm that rests stays at rest, wherever it hangs, and one that idles
    hardly changes (docs/decisions.md).
    """
    half = len(TIPS) // 2
    lengths = np.linalg.norm(np.diff(whole.positions, axis=0), axis=-1).sum(axis=0)  # (12,)
    left, right = (
        min(1.0, float(lengths[side].mean()) / seconds / _FULL_SPEED) ** 3 for side in (slice(half), slice(half, None))
    )
    out = np.full(len(ROLES), max(left, right))
    out[LEFT], out[RIGHT] = left, right
    return out


FULL_S = 0.6
"""Length of a gap, seconds, from which on a network's answer counts in full."""


def answer_weights(t: Float, seen: GapFeatures) -> Float:
    """Weights (n, R) of a network's answer at times t (n,) in the gap, 0 to 1: 16 t^2 (1 - t)^2 times
    min(1, seconds / FULL_S)^1.5 times ``seen.motion_weights``.

    Both ends and their velocities stay exact, and what a cubic bridges well stays near it: short gaps, and hands that
    rest.
    """
    bump = 16.0 * t**2 * (1.0 - t) ** 2
    return np.asarray(min(1.0, seen.seconds / FULL_S) ** 1.5 * bump[:, None] * seen.motion_weights)


def delta_rotvecs(answer: Float, seen: GapFeatures, n_between: int) -> Float:
    """Canonical rotation vectors (n_between, R, 3), radians, that a network's answer (n_gap, R, 3) gives the frames of
    a transition: ``answer_weights`` times the answer.
    """
    at = np.arange(1, seen.n_gap + 1) / (seen.n_gap + 1)
    t = np.arange(1, n_between + 1) / (n_between + 1)
    if seen.n_gap != n_between:
        answer = CubicSpline(at, answer)(t)
    out = answer_weights(t, seen)[..., None] * np.asarray(answer, np.float64)
    return mirrored_deltas(out) if seen.mirrored else out
