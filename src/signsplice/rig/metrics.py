"""Scores of motion."""

from __future__ import annotations

import numpy as np

from signsplice.motion import FloatArray

MOVING_RAD = 0.005
"""Rotation of the fastest joint in a frame from which on a body counts as moving, radians (0.3 degrees)."""


def velocity_jump(positions: FloatArray, first: int, stop: int, fps: float) -> float:
    """Largest change of velocity from one frame step to the next at either end of frames [first, stop).

    positions: (T, K, 3) with at least two frames before ``first`` and after ``stop`` if the clip has them; the unit is
    that of positions a second. At each end, the steps on either side of the last frame outside and of the first inside
    are compared.
    """
    velocity = np.diff(positions, axis=0) * fps
    changes = np.linalg.norm(np.diff(velocity, axis=0), axis=-1).max(
        axis=-1, initial=0.0
    )  # [i] is centred on frame i + 1
    ends = [frame - 1 for frame in (first - 1, first, stop - 1, stop) if 0 <= frame - 1 < len(changes)]
    return float(max((changes[i] for i in ends), default=0.0))


def peak_speed(positions: FloatArray, first: int, stop: int, fps: float) -> float:
    """Highest speed of any point (T, K, 3) between frame first - 1 and frame stop, in units a second."""
    path = positions[max(first - 1, 0) : stop + 1]
    if len(path) < 2:
        return 0.0
    return float(np.linalg.norm(np.diff(path, axis=0), axis=-1).max() * fps)


def jerk_ratio(positions: FloatArray, first: int, stop: int, least: float = 0.0) -> float:
    """Root mean square jerk of frames [first - 1, stop + 1) over that of the frames around them; 1 is as smooth as the
    signs.

    positions: (T, K, 3). Jerk is the third difference. least: lower limit of the jerk of the frames around, in units of
    positions. NaN if there are no such frames, or they are at rest and ``least`` is 0.
    """
    jerk = np.linalg.norm(np.diff(positions, n=3, axis=0), axis=-1)  # [i] spans frames i .. i + 3
    inside = np.zeros(len(jerk), bool)
    inside[max(first - 4, 0) : stop + 1] = True
    around = max(float(np.sqrt(np.mean(jerk[~inside] ** 2))), least) if (~inside).any() else 0.0
    if around < 1e-12 or not inside.any():
        return float("nan")
    return float(np.sqrt(np.mean(jerk[inside] ** 2)) / around)
