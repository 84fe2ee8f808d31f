"""The features of gaps, for the network that makes transitions, and what its answer becomes on the clip.

A gap is seen at ``FEATURE_FPS`` frames a second with ``N_CONTEXT`` frames of the signs on either side (``features``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from signsplice.motion import FloatArray
from signsplice.motion.cache import CACHE
from signsplice.rig.info import FEATURE_FPS, LEFT, RIGHT, ROLES, TIPS, CanonicalMotion, mirrored_deltas
from signsplice.splicing.networks import features
from signsplice.splicing.networks.features import CanonicalTrajectory, MomentFrames

N_CONTEXT = 8
"""Frames of each sign that the network which makes transitions sees."""
MIN_GAP_FRAMES, MAX_GAP_FRAMES = 2, 45
"""Fewest and most frames, at ``FEATURE_FPS``, of the transitions that it makes."""
N_TOKEN = 2 * features.N_FRAME + 8


def gap_frames(seconds: float) -> int:
    """New frames at ``FEATURE_FPS`` between two frames that lie ``seconds`` apart: the network looks at so many
    moments.
    """
    return round(seconds * FEATURE_FPS) - 1


@dataclass(frozen=True, eq=False)
class GapMoments:
    """The moments at which the network looks at a gap, S = N_CONTEXT + n_gap + N_CONTEXT; they follow from numbers of
    frames alone.

    n_gap: frames of the gap at ``FEATURE_FPS``.
    seconds: from the last frame before to the first after.
    frames: of the motion that is looked at.
    position_codes: (S, 8) one-hot before, in or after the gap; real (a frame of the clips and not a repeated edge) or
        not; time t in the gap from 0 to 1, t (1 - t), the gap's length and its logarithm.
    spacing: (S,) seconds from every moment to the next.
    """

    n_gap: int
    seconds: float
    frames: MomentFrames
    position_codes: NDArray[np.float32]
    spacing: FloatArray


def gap_moments(n_frames: int, n_before: int, n_between: int, fps: float) -> GapMoments:
    """The moments of a gap: of ``n_frames``, ``n_before`` of the sign before and then ``n_between`` of a transition."""
    seconds = (n_between + 1) / fps
    n_gap = gap_frames(seconds)
    last, first = (n_before - 1) / fps, (n_before + n_between) / fps
    steps = np.arange(N_CONTEXT) / FEATURE_FPS
    times = np.concatenate([last - steps[::-1], last + seconds * np.arange(1, n_gap + 1) / (n_gap + 1), first + steps])
    is_real = (times > -1e-6) & (times < (n_frames - 1) / fps + 1e-6)
    spacing = np.full(len(times), 1.0 / FEATURE_FPS)
    spacing[N_CONTEXT - 1 : N_CONTEXT + n_gap] = seconds / (n_gap + 1)
    t = np.clip((np.arange(len(times)) - N_CONTEXT + 1) / (n_gap + 1.0), 0.0, 1.0)
    part = np.zeros((len(times), 3))
    part[:N_CONTEXT, 0] = part[N_CONTEXT : N_CONTEXT + n_gap, 1] = part[N_CONTEXT + n_gap :, 2] = 1.0
    length = np.full(len(times), seconds)
    codes = np.column_stack([part, is_real, t, t * (1.0 - t), length, np.log(np.maximum(length, 0.02))])
    return GapMoments(n_gap, seconds, features.frames_at(times, fps, n_frames), codes.astype(np.float32), spacing)


def gap_tokens(whole: CanonicalTrajectory, gaps: Sequence[GapMoments], starts: NDArray[np.intp]) -> NDArray[np.float32]:
    """What the network sees of gaps (N, N_TOKEN): of ``whole``, the N moments of all ``gaps`` in order, those of each
    from its ``starts`` on: the sign before, a classical transition, the sign after.

    A token is the frame's features, the same relative to the last frame before, and where it lies (``GapMoments``).
    """
    out = np.empty((len(whole.positions), N_TOKEN), np.float32)
    spacing = np.concatenate([gap.spacing for gap in gaps])[:-1]
    own = features.frame_features(whole, spacing, starts, out[:, : features.N_FRAME])
    last = np.repeat(starts + N_CONTEXT - 1, [len(gap.spacing) for gap in gaps])
    np.subtract(own, own[last], out=out[:, features.N_FRAME : 2 * features.N_FRAME])
    out[:, 2 * features.N_FRAME :] = np.concatenate([gap.position_codes for gap in gaps])
    return out


@dataclass(frozen=True, eq=False)
class GapFeatures:
    """A gap as the network sees it, and what its answer needs on the return to the clip.

    tokens: (N_CONTEXT + n_gap + N_CONTEXT, N_TOKEN), see ``gap_tokens``.
    n_gap: frames of the gap at ``FEATURE_FPS``.
    seconds: from the last frame before to the first after.
    mirrored: whether the network sees the gap in the mirror.
    motion_weights: (R,) how much each role's side moves, 0 to 1, as the network sees it (``motion_weights``).
    """

    tokens: NDArray[np.float32]
    n_gap: int
    seconds: float
    mirrored: bool
    motion_weights: FloatArray


def gap_features(joined: CanonicalMotion, n_before: int, n_between: int) -> GapFeatures:
    """The features of a gap: ``n_before`` frames of the sign before, ``n_between`` of a classical transition, the sign
    after.
    """
    return all_gap_features(joined, [(slice(0, len(joined.quats)), n_before, n_between)])[0]


def all_gap_features(motion: CanonicalMotion, gaps: Sequence[tuple[slice, int, int]]) -> list[GapFeatures]:
    """The features of gaps that lie in one motion, each (its frames, ``n_before``, ``n_between``)."""
    found = [
        CACHE.recent(gap_moments, frames.stop - frames.start, *counts, motion.fps, most=_MOMENTS_KEPT)
        for frames, *counts in gaps
    ]
    starts = np.cumsum([0, *(len(gap.spacing) for gap in found)])
    firsts = [frames.start for frames, _, _ in gaps]
    low = np.concatenate([first + gap.frames.low for first, gap in zip(firsts, found, strict=True)])
    alpha = np.concatenate([gap.frames.alpha for gap in found])
    mixed = np.concatenate([start + gap.frames.mixed for start, gap in zip(starts[:-1], found, strict=True)])
    whole = features.sampled(motion, MomentFrames(low, alpha, mixed))
    steps = np.linalg.norm(np.diff(whole.positions, axis=0), axis=-1)  # of each joint from frame to frame (S - 1, 12)
    stretches = list(pairwise(starts.tolist()))
    paths = [steps[start : stop - 1].sum(axis=0) for start, stop in stretches]
    mirror = [bool(path[0] > path[len(TIPS) // 2]) for path in paths]
    if any(mirror):
        rows = np.concatenate([np.arange(*ends) for ends, flip in zip(stretches, mirror, strict=True) if flip])
        part = features.mirrored(CanonicalTrajectory(whole.rotations_6d[rows], whole.positions[rows], whole.has_role))
        whole.rotations_6d[rows], whole.positions[rows] = part.rotations_6d, part.positions
    tokens = gap_tokens(whole, found, starts[:-1])
    paths = [np.roll(path, len(TIPS) // 2) if flip else path for path, flip in zip(paths, mirror, strict=True)]
    weights = [motion_weights(path, gap.seconds + _CONTEXT_S) for path, gap in zip(paths, found, strict=True)]
    return [
        GapFeatures(tokens[slice(*ends)], gap.n_gap, gap.seconds, flip, weight)
        for ends, gap, flip, weight in zip(stretches, found, mirror, weights, strict=True)
    ]


_CONTEXT_S = 2.0 * (N_CONTEXT - 1) / FEATURE_FPS
_MOMENTS_KEPT = 512
_FULL_SPEED = 0.4
"""Mean speed of a hand, arm lengths a second, from which on it counts as moving in full: half of continuous signing."""


def motion_weights(lengths: FloatArray, seconds: float) -> FloatArray:
    """How much each role's side moves (R,), by the path lengths (12,) of the joints of ``TIPS`` over ``seconds``: the
    mean of its wrist and finger joints a second, as a fraction of ``_FULL_SPEED``, at most 1, to the third power; for
    the trunk that of the side that moves more.

    A network's answer is multiplied by this: an arm that rests stays at rest, wherever it hangs, and one that idles
    hardly changes (docs/decisions.md).
    """
    half = len(TIPS) // 2
    left, right = (
        min(1.0, float(lengths[side].mean()) / seconds / _FULL_SPEED) ** 3 for side in (slice(half), slice(half, None))
    )
    out = np.full(len(ROLES), max(left, right))
    out[LEFT], out[RIGHT] = left, right
    return out


FULL_S = 0.6
"""Length of a gap, seconds, from which on a network's answer counts in full."""


def answer_weights(t: FloatArray, seen: GapFeatures) -> FloatArray:
    """Weights (n, R) of a network's answer at times t (n,) in the gap, 0 to 1: 16 t^2 (1 - t)^2 times
    min(1, seconds / FULL_S)^1.5 times ``seen.motion_weights``.

    Both ends and their velocities stay exact, and what a cubic bridges well stays near it: short gaps, and hands that
    rest.
    """
    bump = 16.0 * t**2 * (1.0 - t) ** 2
    return np.asarray(min(1.0, seen.seconds / FULL_S) ** 1.5 * bump[:, None] * seen.motion_weights)


def delta_rotvecs(answer: FloatArray, seen: GapFeatures, n_between: int) -> FloatArray:
    """Canonical rotation vectors (n_between, R, 3), radians, that a network's answer (n_gap, R, 3) gives the frames of
    a transition: ``answer_weights`` times the answer.
    """
    at = np.arange(1, seen.n_gap + 1) / (seen.n_gap + 1)
    t = np.arange(1, n_between + 1) / (n_between + 1)
    if seen.n_gap != n_between:
        answer = CubicSpline(at, answer)(t)
    out = answer_weights(t, seen)[..., None] * np.asarray(answer, np.float64)
    return mirrored_deltas(out) if seen.mirrored else out
