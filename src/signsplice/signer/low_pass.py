"""States smoothed in time, less where hands touch and in repeated movements, and the bump by which corrections fade."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from signsplice.motion.arrays import FloatArray

_LEAST_PASS = 0.18
"""Standard deviation of the smoothing over the duration of a movement's shortest pass, at most: the movement keeps 85 %
of its size when it is repeated."""
_AT_TOUCH = 0.4
"""Standard deviation of the smoothing at a touch, frames, at most: hands come and go as straight as they would."""
_REACH = 4.0
"""How far from a touch the correction of its posture reaches, in standard deviations of the smoothing."""


def low_passed(
    states: FloatArray, deviation: float, passes: Sequence[tuple[int, int]] = (), touches: Sequence[int] = ()
) -> FloatArray:
    """States (T, 65) smoothed in time by a Gaussian of standard deviation ``deviation``, frames.

    The first and the last frame stay as they are; within repeated ``passes``, [begin, end] each, and near both ends of
    the word, and near the frames ``touches``, it is smoothed less. In those frames the states stay as they are, and
    those around them are moved along, less with their distance.
    """
    n = len(states)
    width = _deviations(n, deviation, passes, touches)
    frames = np.arange(n)
    weights = (frames - frames[:, None]) / np.maximum(width, 1e-3)[:, None]
    weights *= weights
    weights *= -0.5
    np.exp(weights, out=weights)
    weights /= weights.sum(axis=1, keepdims=True)
    smooth = weights @ states
    centres = np.array(sorted(set(touches)), np.intp)
    if not len(centres):
        return np.asarray(smooth)
    radius = max(_REACH * deviation, 2.0)
    factors = np.linalg.solve(bump(centres, centres, radius), states[centres] - smooth[centres])
    return np.asarray(smooth + bump(frames, centres, radius) @ factors)


def _deviations(
    n_frames: int, deviation: float, passes: Sequence[tuple[int, int]], touches: Sequence[int]
) -> FloatArray:
    """The smoothing's standard deviation (T,) in each frame. It changes by no more than 1 in 3 frames."""
    frames = np.arange(n_frames)
    out = np.minimum(deviation, np.minimum(frames, n_frames - 1 - frames) / 3.0)
    if len(passes) > 1:
        least = _LEAST_PASS * min(stop - begin for begin, stop in passes)
        away = np.maximum(np.maximum(passes[0][0] - frames, frames - passes[-1][1]), 0)
        out = np.minimum(out, least + away / 3.0)
    for touch in touches:
        out = np.minimum(out, _AT_TOUCH + np.abs(frames - touch) / 3.0)
    return np.asarray(out, np.float64)


def bump(frames: NDArray[np.intp], centres: NDArray[np.intp], radius: float) -> FloatArray:
    """Wendland's function (F, C) of the distance in frames: 1 at 0, 0 from ``radius`` on, twice differentiable, and
    positive definite, so that any values at the centres can be met.
    """
    near = np.clip(np.abs(frames[:, None] - centres) / radius, 0.0, 1.0)
    return np.asarray((1.0 - near) ** 4 * (4.0 * near + 1.0))
