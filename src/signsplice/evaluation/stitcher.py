"""The stitcher of spoken-to-signed, rebuilt from its published description as a baseline: points, no rotations.

spoken-to-signed (PyPI, 0.4.0; MIT) joins clips of landmarks in four steps:

1. It trims each clip to the frames in which a wrist is above its elbow, five frames wider.
2. It shortens a trimmed clip of more than 0.8 s to 0.8 s.
3. It compares the end of the first and the beginning of the second (0.3 s, or 0.3 of the clip) by the distance of their
   points and joins them at the nearest pair of frames, with int(0.07 fps) frames between, interpolated linearly.
4. It low-passes all points (Butterworth, order 4, 6 Hz, forward and backward).

It moves points, so bones change length, and its filter also changes the signs. Here the points are the joints of a
clip, all with the same confidence; it leaves faces unfiltered, and there are none here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, filtfilt

from signsplice.motion import Clip, FloatArray, kinematics
from signsplice.rig.info import arms

MARGIN_FRAMES = 5
LONGEST_S = 0.8
SEARCH_S = SEARCH_FRACTION = 0.3
GAP_S = 0.07
ORDER, CUTOFF_HZ = 4, 6.0


@dataclass(frozen=True, eq=False)
class Stitched:
    """Two words joined.

    positions: joint positions (T, J, 3), clip units.
    first, stop: the interpolated frames [first, stop).
    kept_before, kept_after: half-open range of frames of each word's clip, counted before any shortening, that are in
        the result.
    """

    positions: FloatArray
    first: int
    stop: int
    kept_before: tuple[int, int]
    kept_after: tuple[int, int]


def stitch(before: Clip, after: Clip) -> Stitched:
    """Two clips of one skeleton and rate joined. Raises ``InputError`` where the rig's arms are not known by name."""
    fps = before.fps
    spans = [_raised(clip) for clip in (before, after)]
    p, q = (
        _shortened(kinematics.forward(clip)[1][first:stop], fps)
        for clip, (first, stop) in zip((before, after), spans, strict=True)
    )  # (T, J, 3)
    n_p, n_q = (max(1, int(min(SEARCH_S * fps, SEARCH_FRACTION * len(part)))) for part in (p, q))
    tail, head = p[-n_p:].reshape(n_p, -1), q[:n_q].reshape(n_q, -1)
    distances = np.linalg.norm(tail[:, None] - head[None], axis=-1)  # (n_p, n_q)
    i, j = np.unravel_index(int(distances.argmin()), distances.shape)
    last, entry = len(p) - n_p + int(i), int(j)
    n_gap = int(GAP_S * fps)
    weight = np.arange(1, n_gap + 1)[:, None, None] / (n_gap + 1)
    filled = (1.0 - weight) * p[last] + weight * q[entry]
    whole = np.concatenate([p[: last + 1], filled, q[entry:]])
    return Stitched(
        _filtered(whole, fps),
        last + 1,
        last + 1 + n_gap,
        _source(spans[0], len(p), 0, last + 1),
        _source(spans[1], len(q), entry, len(q)),
    )


def _raised(clip: Clip) -> tuple[int, int]:
    """The frames in which a wrist is above its elbow, five frames wider; the whole clip where none is."""
    motion = arms(clip)
    raised = np.flatnonzero((((motion.wrists - motion.elbows) @ motion.up) > 0.0).any(axis=1))
    if not len(raised):
        return 0, len(clip)
    return max(0, int(raised[0]) - MARGIN_FRAMES), min(len(clip), int(raised[-1]) + 1 + MARGIN_FRAMES)


def _shortened(points: FloatArray, fps: float) -> FloatArray:
    """The same motion (T, J, 3) in at most 0.8 s."""
    most = round(LONGEST_S * fps)
    if len(points) <= most:
        return points
    times = np.linspace(0.0, len(points) - 1.0, most)
    low = np.minimum(times.astype(int), len(points) - 2)
    weight = (times - low)[:, None, None]
    return np.asarray((1.0 - weight) * points[low] + weight * points[low + 1])


def _source(span: tuple[int, int], n_frames: int, first: int, stop: int) -> tuple[int, int]:
    """Frames of the clip that lie in [first, stop) of its trimmed span, which was brought to ``n_frames``."""
    scale = (span[1] - span[0] - 1) / max(n_frames - 1, 1)
    return span[0] + int(np.ceil(first * scale - 1e-9)), span[0] + int((stop - 1) * scale + 1e-9) + 1


def _filtered(points: FloatArray, fps: float) -> FloatArray:
    b, a = butter(ORDER, CUTOFF_HZ / (0.5 * fps))
    if len(points) <= 3 * max(len(a), len(b)):
        return points
    return np.asarray(filtfilt(b, a, points, axis=0))
