"""The stitcher that people use today, rebuilt from its published description, as a baseline: points, no rotations.

spoken-to-signed (PyPI, 0.4.0; MIT) joins landmark clips so: each clip is trimmed to the span in which a wrist is above
its elbow, five frames wider; a span of more than 0.8 s is brought to 0.8 s; the end of the one and the beginning of the
other (0.3 s, or 0.3 of the span) are compared by the distance of their points, and joined at the nearest pair; int(0.07
fps) frames are left out between and filled evenly; at last all points are low-passed (Butterworth, order 4, 6 Hz, there
and back).

It works on points, so bones change length, and its filter goes over the signs themselves. Here the points are the
joints of a clip, all of one confidence; faces, which it spares, are not among them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, filtfilt

from signsplice.motion import kinematics
from signsplice.motion.clip import Clip
from signsplice.rig.arms import arms

Float = NDArray[np.float64]

WIDER = 5
LONGEST_S = 0.8
WINDOW = 0.3
EMPTY_S = 0.07
ORDER, CUTOFF_HZ = 4, 6.0


@dataclass(frozen=True, eq=False)
class Stitched:
    """Joint positions (T, J, 3) of two words joined, clip units; the filled frames [first, stop); and of each word the
    frames of its clip, before any change of tempo, that are in it, half-open.
    """

    positions: Float
    first: int
    stop: int
    kept_before: tuple[int, int]
    kept_after: tuple[int, int]


def stitch(before: Clip, after: Clip) -> Stitched:
    """Two clips of one skeleton and rate joined. Raises ``InputError`` where the rig's arms are not known by name."""
    fps = before.fps
    spans = [_raised(clip) for clip in (before, after)]
    p, q = (_shortened(_points(clip)[a:b], fps) for clip, (a, b) in zip((before, after), spans, strict=True))
    n_p, n_q = (max(1, int(min(WINDOW * fps, WINDOW * len(part)))) for part in (p, q))
    tail, head = p[-n_p:].reshape(n_p, -1), q[:n_q].reshape(n_q, -1)
    apart = np.linalg.norm(tail[:, None] - head[None], axis=-1)
    i, j = np.unravel_index(int(apart.argmin()), apart.shape)
    left, entered = len(p) - n_p + int(i), int(j)
    n_empty = int(EMPTY_S * fps)
    share = np.arange(1, n_empty + 1)[:, None, None] / (n_empty + 1)
    filled = (1.0 - share) * p[left] + share * q[entered]
    whole = np.concatenate([p[: left + 1], filled, q[entered:]])
    return Stitched(
        _filtered(whole, fps),
        left + 1,
        left + 1 + n_empty,
        _source(spans[0], len(p), 0, left + 1),
        _source(spans[1], len(q), entered, len(q)),
    )


def _points(clip: Clip) -> Float:
    return kinematics.forward(clip)[1]


def _raised(clip: Clip) -> tuple[int, int]:
    """The frames in which a wrist is above its elbow, five wider; the whole clip where none is."""
    seen = arms(clip)
    up = np.flatnonzero((((seen.wrists - seen.elbows) @ seen.up) > 0.0).any(axis=1))
    if not len(up):
        return 0, len(clip)
    return max(0, int(up[0]) - WIDER), min(len(clip), int(up[-1]) + 1 + WIDER)


def _shortened(points: Float, fps: float) -> Float:
    """The same in at most 0.8 s."""
    most = round(LONGEST_S * fps)
    if len(points) <= most:
        return points
    at = np.linspace(0.0, len(points) - 1.0, most)
    low = np.minimum(at.astype(int), len(points) - 2)
    share = (at - low)[:, None, None]
    return np.asarray((1.0 - share) * points[low] + share * points[low + 1])


def _source(span: tuple[int, int], n_frames: int, first: int, stop: int) -> tuple[int, int]:
    """Frames of a clip that lie in frames [first, stop) of its span, once that has ``n_frames``."""
    scale = (span[1] - span[0] - 1) / max(n_frames - 1, 1)
    return span[0] + int(np.ceil(first * scale - 1e-9)), span[0] + int((stop - 1) * scale + 1e-9) + 1


def _filtered(points: Float, fps: float) -> Float:
    b, a = butter(ORDER, CUTOFF_HZ / (0.5 * fps))
    if len(points) <= 3 * max(len(a), len(b)):
        return points
    return np.asarray(filtfilt(b, a, points, axis=0))
