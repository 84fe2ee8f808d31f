"""What networks are shown of clips: the only definition, for training and for running.

Everything is seen at ``FEATURE_FPS`` frames a second, whatever the clip's own rate; on the canonical humanoid, whatever its
rig; and with the busier hand at the right, so that a mirrored clip is shown the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from signsplice.motion import rotation
from signsplice.rig.canonical import FEATURE_FPS, LEFT, RIGHT, ROLES, TIPS, CanonicalMotion, mirrored_deltas

Float = NDArray[np.float64]

VERSION = 4
"""Of what networks are shown, and of what they say: raised when either changes."""
N_ROTATION = 6 * len(ROLES)
N_POSITION = 3 * len(TIPS)
N_FRAME = 2 * (N_ROTATION + N_POSITION)
"""Numbers of a frame: turns and places, and their rates."""
_PER_SECOND = 1.0 / 5.0
"""Rates reach some units a second: scaled to about 1."""


@dataclass(frozen=True, eq=False)
class CanonicalTrajectory:
    """A signing body at any moments: turns as the first two columns of each matrix (T, R, 6), positions (T, 12, 3), at
    ``FEATURE_FPS`` frames a second from 0.
    """

    rotations_6d: Float
    positions: Float
    has_role: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.rotations_6d)

    @cached_property
    def wrist_travel(self) -> Float:
        """How far (2,) the left and the right wrist go, arm lengths."""
        steps = np.diff(self.positions[:, [0, len(TIPS) // 2]], axis=0)
        return np.asarray(np.linalg.norm(steps, axis=-1).sum(axis=0))


def trajectory(signing: CanonicalMotion, times: Float | None = None) -> CanonicalTrajectory:
    """A signing body at ``times`` (T,), seconds from its first frame; at ``FEATURE_FPS`` over its whole length by default.

    Between frames both are interpolated evenly, turns as six numbers brought back to a rotation; before the first and
    after the last frame the body stays.
    """
    n_frames = len(signing.quats)
    if times is None:
        times = np.arange(int((n_frames - 1) * FEATURE_FPS / signing.fps + 1e-6) + 1) / FEATURE_FPS
    at = np.clip(np.asarray(times, np.float64) * signing.fps, 0.0, n_frames - 1.0)
    low = np.minimum(at.astype(int), max(n_frames - 2, 0))
    share = at - low
    if np.all(np.abs(share - np.round(share)) < 1e-9):
        exact = np.round(at).astype(int)
        return CanonicalTrajectory(rotation.to_6d(signing.quats[exact]), signing.positions[exact], signing.has_role)
    high = np.minimum(low + 1, n_frames - 1)
    turns = rotation.to_6d(signing.quats)
    mixed = (1.0 - share)[:, None, None] * turns[low] + share[:, None, None] * turns[high]
    places = (1.0 - share)[:, None, None] * signing.positions[low] + share[:, None, None] * signing.positions[high]
    return CanonicalTrajectory(rotation.matrix_to_6d(rotation.matrix_from_6d(mixed)), places, signing.has_role)


def left_hand_busier(*courses: CanonicalTrajectory) -> bool:
    """Whether the left wrist goes a longer way than the right one, over all courses together."""
    left, right = (sum(float(trajectory.wrist_travel[side]) for trajectory in courses) for side in (0, 1))
    return left > right


def mirrored(one: CanonicalTrajectory) -> CanonicalTrajectory:
    """A course seen in the mirror."""
    flip = np.array([-1.0, 1.0, 1.0])
    order = np.r_[0 : LEFT.start, RIGHT.start : RIGHT.stop, LEFT.start : LEFT.stop]
    # A mirrored rotation is M A M, M = diag(-1, 1, 1): of its two columns x is negated beside the mirrored numbers.
    turns = one.rotations_6d[:, order] * np.concatenate([-flip, flip])
    half = len(TIPS) // 2
    places = np.concatenate([one.positions[:, half:], one.positions[:, :half]], axis=1) * flip
    return CanonicalTrajectory(turns, places, one.has_role[order])


def frame_features(one: CanonicalTrajectory, spacing: float | Float = 1.0 / FEATURE_FPS) -> NDArray[np.float32]:
    """Numbers (T, N_FRAME) of a course: turns, places, and both as rates from the frame before (0 at the first).

    spacing: seconds from every frame to the next, one number or (T - 1,).
    """
    out = np.empty((len(one), N_FRAME), np.float32)
    flat, rates = np.split(out, 2, axis=1)
    flat[:, :N_ROTATION], flat[:, N_ROTATION:] = (
        one.rotations_6d.reshape(len(one), -1),
        one.positions.reshape(len(one), -1),
    )
    rates[0] = 0.0
    np.subtract(flat[1:], flat[:-1], out=rates[1:])
    rates[1:] *= np.reshape(_PER_SECOND / np.asarray(spacing, np.float64), (-1, 1)).astype(np.float32)
    return out


def wrist_positions(numbers: NDArray[np.float32]) -> NDArray[np.float32]:
    """Places (..., 2, 3) of both wrists in numbers (..., N_FRAME) of ``frame_features``, arm lengths."""
    places = numbers[..., N_ROTATION : N_ROTATION + N_POSITION].reshape(*numbers.shape[:-1], len(TIPS), 3)
    return places[..., [0, len(TIPS) // 2], :]


CONTEXT = 8
"""Frames of each sign that the network which makes transitions sees."""
MIN_GAP_FRAMES, MAX_GAP_FRAMES = 2, 45
"""Frames (at ``FEATURE_FPS``) of the transitions that it makes."""
N_TOKEN = 2 * N_FRAME + 8


def gap_frames(seconds: float) -> int:
    """New frames at ``FEATURE_FPS`` between two frames that lie ``seconds`` apart; the network looks at so many moments."""
    return round(seconds * FEATURE_FPS) - 1


def gap_tokens(whole: CanonicalTrajectory, n_gap: int, real: NDArray[np.bool_], seconds: float) -> NDArray[np.float32]:
    """What the network sees of a gap (CONTEXT + n_gap + CONTEXT, N_TOKEN).

    ``whole``: the sign before, a classical transition, the sign after, as many frames as the result. real: which are
    frames of the clips and no repeated edges. seconds: between the last frame before and the first after. A token is
    the frame's numbers, the same seen from the last frame before, and where it lies: before, in or after the gap, real
    or not, share of the gap, the gap's length.
    """
    spacing = np.full(len(whole) - 1, 1.0 / FEATURE_FPS)
    spacing[CONTEXT - 1 : CONTEXT + n_gap] = seconds / (n_gap + 1)
    own = frame_features(whole, spacing)
    away = own - own[CONTEXT - 1]
    share = np.clip((np.arange(len(own)) - CONTEXT + 1) / (n_gap + 1.0), 0.0, 1.0)
    kind = np.zeros((len(own), 3))
    kind[:CONTEXT, 0] = kind[CONTEXT : CONTEXT + n_gap, 1] = kind[CONTEXT + n_gap :, 2] = 1.0
    long = np.full(len(own), seconds)
    told = np.column_stack([kind, real, share, share * (1.0 - share), long, np.log(np.maximum(long, 0.02))])
    return np.concatenate([own, away, told.astype(np.float32)], axis=1)


PHASES = ("rest", "preparation", "hold", "stroke", "retraction")
"""What a frame of a word is (Kita et al. 1998): the stroke goes from the first movement's begin to the last one's end,
what stands before and after it is a hold.
"""
WORD_FRAMES = 150
"""Most frames (at ``FEATURE_FPS``) of a word that a cutter sees: the last ones of the word before, the first of the one after.
"""
N_WORD = N_FRAME + 2


def word_tokens(word: CanonicalTrajectory) -> NDArray[np.float32]:
    """What a cutter sees of a word (T, N_WORD): each frame's numbers, and the seconds from the word's first frame and
    to its last. It sees two frames at once: of a word with an odd number the last one is there twice.
    """
    at = np.arange(len(word), dtype=np.float32) / np.float32(FEATURE_FPS)
    seen = np.concatenate([frame_features(word), np.column_stack([at, at[-1] - at])], axis=1)
    return np.concatenate([seen, seen[-1:]]) if len(word) % 2 else seen


@dataclass(frozen=True, eq=False)
class GapFeatures:
    """A gap as the network sees it: tokens (CONTEXT + n_gap + CONTEXT, N_TOKEN), and what brings its answer back.

    motion_weights (R,): how much of its motion each role's side is in, 0 to 1 (``motion_weights``), as the network sees it.
    """

    tokens: NDArray[np.float32]
    n_gap: int
    seconds: float
    mirrored: bool
    motion_weights: Float


def gap_features(joined: CanonicalMotion, n_before: int, n_between: int) -> GapFeatures:
    """The window of a seam: ``n_before`` frames of the sign before, ``n_between`` of a classical transition, then the
    sign after.
    """
    seconds = (n_between + 1) / joined.fps
    n_gap = gap_frames(seconds)
    last, first = (n_before - 1) / joined.fps, (n_before + n_between) / joined.fps
    steps = np.arange(CONTEXT) / FEATURE_FPS
    times = np.concatenate([last - steps[::-1], last + seconds * np.arange(1, n_gap + 1) / (n_gap + 1), first + steps])
    end = (len(joined.quats) - 1) / joined.fps
    real = (times > -1e-6) & (times < end + 1e-6)
    whole = trajectory(joined, times)
    flipped = left_hand_busier(whole)
    whole = mirrored(whole) if flipped else whole
    long = seconds + 2.0 * (CONTEXT - 1) / FEATURE_FPS
    return GapFeatures(gap_tokens(whole, n_gap, real, seconds), n_gap, seconds, flipped, motion_weights(whole, long))


_FULL_SPEED = 0.4
"""Mean speed of a hand, arm lengths a second, from which on it counts as moving in full: half of continuous signing."""


def motion_weights(whole: CanonicalTrajectory, seconds: float) -> Float:
    """How much each role's side moves (R,): the mean way of its wrist and finger joints over ``seconds``, as a share of
    ``_FULL_SPEED``, 1 at most, to the third power; for the trunk that of the side that moves more.

    A network's answer counts so much: an arm that rests stays at rest, wherever it hangs, and one that idles hardly
    does otherwise (lab/LOG.md, What idles).
    """
    half = len(TIPS) // 2
    ways = np.linalg.norm(np.diff(whole.positions, axis=0), axis=-1).sum(axis=0)
    left, right = (
        min(1.0, float(ways[side].mean()) / seconds / _FULL_SPEED) ** 3 for side in (slice(half), slice(half, None))
    )
    out = np.full(len(ROLES), max(left, right))
    out[LEFT], out[RIGHT] = left, right
    return out


FULL_S = 0.6
"""Time of a gap from which on a network's answer counts in full."""


def answer_weights(share: Float, seen: GapFeatures) -> Float:
    """What a network's answer counts (n, R) at shares s of a gap: 16 s^2 (1 - s)^2 times min(1, seconds / FULL_S)^1.5
    times ``moving``. Both ends and their velocities stay, and what a cubic bridges well stays near it: short gaps, and
    hands that rest.
    """
    gap_tokens = 16.0 * share**2 * (1.0 - share) ** 2
    return np.asarray(min(1.0, seen.seconds / FULL_S) ** 1.5 * gap_tokens[:, None] * seen.motion_weights)


def delta_rotvecs(answer: Float, seen: GapFeatures, n_between: int) -> Float:
    """Turns (n_between, R, 3), canonical rotation vectors, that a network's answer (n_gap, R, 3) gives the frames of a
    transition: ``answer_weights`` times the answer.
    """
    at = np.arange(1, seen.n_gap + 1) / (seen.n_gap + 1)
    share = np.arange(1, n_between + 1) / (n_between + 1)
    if seen.n_gap != n_between:
        answer = CubicSpline(at, answer)(share)
    out = answer_weights(share, seen)[..., None] * np.asarray(answer, np.float64)
    return mirrored_deltas(out) if seen.mirrored else out
