"""Curves over time: the minimum-jerk step, smoothing of corrections, and windows that fade at fixed ends."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from signsplice.motion.rotation import FloatArray

Number = TypeVar("Number", float, FloatArray)


def minimum_jerk(u: Number, height: float = 1.0) -> Number:
    """Progress 10 u^3 - 15 u^4 + 6 u^5 at times ``u``, 0 to 1: from rest to rest (Flash and Hogan 1985), also the
    smooth step of degree 5. ``height`` is multiplied first.
    """
    return height * u**3 * (10.0 + u * (-15.0 + 6.0 * u))


def sparse(n_frames: int, apart: float) -> NDArray[np.intp]:
    """Return frames about ``apart`` frames from one another, and the last frame."""
    return np.union1d(np.arange(0, n_frames, max(1, round(apart))), np.arange(n_frames)[-1:])


def between(values: FloatArray, frames: NDArray[np.intp]) -> FloatArray:
    """Interpolate values (F, ...) at some frames, of which the first is 0, linearly to every frame (T, ...)."""
    rows = values.reshape(len(frames), -1)
    all_frames = np.arange(frames[-1] + 1)
    k = np.minimum(np.searchsorted(frames, all_frames, side="right"), len(frames) - 1)
    share = (frames[k] - all_frames) / np.maximum(frames[k] - frames[k - 1], 1)
    interpolated = rows[k] + share[:, None] * (rows[k - 1] - rows[k])
    return np.asarray(interpolated.reshape(len(all_frames), *values.shape[1:]))


def smooth_over_time(push: FloatArray, kernel: FloatArray) -> FloatArray:
    """Spread pushes (T, 2, 3) to neighbouring frames: each gets the weighted sum, at most the largest push nearby.

    kernel: an odd number of weights, 1 in the middle.
    """
    side = len(kernel) // 2
    rows = push.reshape(len(push), -1)
    padded = np.pad(rows, ((side, side), (0, 0)))
    summed = np.stack([padded[k : k + len(rows)] * w for k, w in enumerate(kernel)]).sum(axis=0)
    pushed = np.pad((np.abs(rows).max(axis=1) > 0).astype(float), side)
    weights = sum(pushed[k : k + len(rows)] * w for k, w in enumerate(kernel))
    return np.asarray((summed / np.maximum(weights, 1.0)[:, None]).reshape(push.shape))


def fade_window(n_frames: int) -> FloatArray:
    """Return a window (n_frames,): 0 just outside both ends, 1 well inside, with slope and curvature 0 at the ends."""
    edge = np.minimum(np.arange(1, n_frames + 1), np.arange(n_frames, 0, -1)) / max(1.6, 0.25 * (n_frames + 1))
    progress = np.clip(edge, 0.0, 1.0)
    return minimum_jerk(progress)
