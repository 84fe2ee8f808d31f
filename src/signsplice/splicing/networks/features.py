"""The features that networks see of clips: the only definition, for training and for running.

From a clip to features in three steps:

    motion = canonical_motion(clip)         # rig/info.py: the clip on the canonical humanoid
    whole = trajectory(motion)              # resampled to FEATURE_FPS
    tokens = word_tokens(whole)             # a word, for the network that cuts and times
    seen = gap_features(motion, ...)        # gap_features.py: a gap, for the network that makes transitions

Everything is seen at ``FEATURE_FPS`` frames a second, whatever the clip's own rate; on the canonical humanoid, whatever
its rig; and with the busier hand at the right, so that a mirrored clip has the same features.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from signsplice.motion import FloatArray, rotation
from signsplice.rig.info import FEATURE_FPS, LEFT, RIGHT, ROLES, TIPS, CanonicalMotion

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
