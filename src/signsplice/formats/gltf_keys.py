"""Keys of a glTF animation: the frame rate that they imply, and values interpolated between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from signsplice.motion import rotation
from signsplice.motion.arrays import FloatArray

LEAST_FPS, MOST_FPS = 10.0, 240.0
"""Keys that are farther apart or closer together imply no frame rate: such files are sampled at ``USUAL_FPS``."""
USUAL_FPS = 30.0
DRIFT = 0.1
"""A rate is rounded to a whole number or an NTSC rate (k 1000 / 1001) if that moves no key by more frames than this."""
INTERPOLATIONS = ("LINEAR", "STEP", "CUBICSPLINE")
_NEAR = 1e-3
"""A time within this fraction of a frame of a key is at that key: files store times in 32 bits."""


@dataclass(frozen=True)
class Keys:
    """The keys of one animated channel.

    times: (K,) seconds, rising.
    values: (K, 3) or (K, 4); for splines (K, 3, 3) or (K, 3, 4): in-tangent, value, out-tangent.
    interpolation: one of ``INTERPOLATIONS``.
    """

    times: FloatArray
    values: FloatArray
    interpolation: str


def frame_rate(times: FloatArray) -> float:
    """The frame rate that rising key times (K,) imply."""
    if len(times) < 2:
        return USUAL_FPS
    steps = np.diff(times)
    even = np.ptp(steps) < 0.01 * steps.mean() + 1e-5
    rate = float(1.0 / (steps.mean() if even else np.median(steps)))
    if not LEAST_FPS <= rate <= MOST_FPS:
        return USUAL_FPS
    length = float(times[-1] - times[0])
    for likely in (float(round(rate)), round(rate * 1.001) / 1.001):
        if abs(likely - rate) * length < DRIFT and abs(likely - rate) < 1e-3 * rate:
            return likely
    return rate


def sample(keys: Keys, times: FloatArray, fps: float, rotations: bool) -> FloatArray:
    """Values of a channel at ``times`` (T,): (T, 3), or unit quaternions (T, 4) for ``rotations``.

    Between keys as the file's interpolation says; before the first and after the last key, the value there.
    """
    at = np.clip(times, keys.times[0], keys.times[-1])
    low = np.clip(np.searchsorted(keys.times, at, side="right") - 1, 0, max(len(keys.times) - 2, 0))
    high = np.minimum(low + 1, len(keys.times) - 1)
    since, until = at - keys.times[low], keys.times[high] - at
    span = keys.times[high] - keys.times[low]
    weight = np.divide(since, span, out=np.zeros_like(at), where=span > 0.0)
    weight[since * fps < _NEAR] = 0.0
    weight[(until * fps < _NEAR) & (until < since)] = 1.0
    if keys.interpolation == "CUBICSPLINE":
        s, t = weight[:, None], span[:, None]
        a, out_tangent = keys.values[low, 1], t * keys.values[low, 2]
        b, in_tangent = keys.values[high, 1], t * keys.values[high, 0]
        out = (
            (1 + 2 * s) * (1 - s) ** 2 * a
            + s * (1 - s) ** 2 * out_tangent
            + s**2 * (3 - 2 * s) * b
            + s**2 * (s - 1) * in_tangent
        )
        return rotation.normalize(out) if rotations else np.asarray(out)
    if keys.interpolation == "STEP":
        weight = np.where(weight >= 1.0, 1.0, 0.0)
    a, b = keys.values[low], keys.values[high]
    if rotations:
        return rotation.slerp(rotation.normalize(a), rotation.normalize(b), weight)
    return np.asarray(a + weight[:, None] * (b - a))
