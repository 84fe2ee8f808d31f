"""Keys of a glTF animation: the frame rate that they tell, and what lies between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signsplice.motion import rotation

Float = NDArray[np.float64]

LEAST_FPS, MOST_FPS = 10.0, 240.0
"""Keys that lie farther apart or nearer together tell no frame rate: such files are sampled at ``USUAL_FPS``."""
USUAL_FPS = 30.0
DRIFT = 0.1
"""A rate is taken for a whole number, or one of television's (k 1000 / 1001), where keys move by so few frames."""
_NEAR = 1e-3
"""Share of a frame by which a moment may lie before a key and yet be at it: files hold times in 32 bits."""


@dataclass(frozen=True)
class Keys:
    """A channel's keys: times (K,), values (K, 3 or 4), with tangents (K, 3, ...) where it is a spline."""

    times: Float
    values: Float
    interpolation: str


def frame_rate(times: Float) -> float:
    """The frame rate that rising key times tell."""
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


def sampled(keys: Keys, times: Float, fps: float, turning: bool) -> Float:
    """A channel at moments (T,): between keys as the file says, before and after them as at the first and last."""
    at = np.clip(times, keys.times[0], keys.times[-1])
    low = np.clip(np.searchsorted(keys.times, at, side="right") - 1, 0, max(len(keys.times) - 2, 0))
    high = np.minimum(low + 1, len(keys.times) - 1)
    span = keys.times[high] - keys.times[low]
    share = np.divide(at - keys.times[low], span, out=np.zeros_like(at), where=span > 0.0)
    share[(at - keys.times[low]) * fps < _NEAR] = 0.0
    share[(keys.times[high] - at) * fps < _NEAR] = 1.0
    if keys.interpolation == "CUBICSPLINE":
        s, t = share[:, None], span[:, None]
        a, leaving = keys.values[low, 1], t * keys.values[low, 2]
        b, arriving = keys.values[high, 1], t * keys.values[high, 0]
        out = (
            (1 + 2 * s) * (1 - s) ** 2 * a
            + s * (1 - s) ** 2 * leaving
            + s**2 * (3 - 2 * s) * b
            + s**2 * (s - 1) * arriving
        )
        return rotation.normalize(out) if turning else np.asarray(out)
    if keys.interpolation == "STEP":
        share = np.where(share >= 1.0, 1.0, 0.0)
    a, b = keys.values[low], keys.values[high]
    if turning:
        return rotation.slerp(rotation.normalize(a), rotation.normalize(b), share)
    return np.asarray(a + share[:, None] * (b - a))
