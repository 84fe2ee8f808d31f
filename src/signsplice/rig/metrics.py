"""Scores of motion, each with a signature of its parameters: a number means nothing without them."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import convolve1d

from signsplice.motion import Clip, FloatArray, rotation
from signsplice.rig.info import rig_info
from signsplice.rig.roles import ARM

MOVING_RAD = 0.005
"""Rotation of the fastest joint in a frame (0.3 degrees) from which on a body counts as moving."""


KEYED_FRACTION = 0.15
"""Fraction of interpolated arm motion from which on a clip is keyed. Eight frames on either side of a gap in a captured
take or in the words that ship have 0.04 in 95 of 100 gaps, and none has more than 0.1; with keys every fourth frame
nearly all have more. Splines between keys every third frame are not seen: no five frames lie between two keys.
"""
_FPS = 30.0
_EVEN, _LEAST = 0.05, 0.003
"""Differences count as none up to this part of the joint's own, and of its speed."""
_LEAST_MOVING = 8


def interpolated_fraction(*clips: Clip) -> float:
    """Fraction of the moments at which an arm's joint moves, and its rotation lies on a line (second difference) or a
    cubic (fourth difference) through the two frames on either side, as it does between a spline's keys. 0 where hardly
    anything moves, or the arms are not known.

    Differences are measured against the same joint's own, which are large at keys, whatever speed and rate are. Each
    clip is seen at about 30 frames a second: those between may be interpolated.
    """
    smooth = moving = 0
    for clip in clips:
        joints = [joint for role, joint in rig_info(clip.skeleton).roles.joints.items() if role.endswith(ARM)]
        q = clip.local_rotations[:: max(1, round(clip.fps / _FPS)), joints]  # (T, K, 4)
        if len(q) < 5 or not joints:
            continue
        x = [rotation.difference(q[2:-2], q[2 + k : len(q) - 2 + k]) for k in (-2, -1, 0, 1, 2)]  # (T - 4, K, 3) each
        speed = 0.5 * np.linalg.norm(x[3] - x[1], axis=-1)
        least = _LEAST * _local_rms(speed)
        is_smooth = np.zeros(speed.shape, bool)
        for vectors in (x[1] + x[3] - 2.0 * x[2], x[0] - 4.0 * x[1] + 6.0 * x[2] - 4.0 * x[3] + x[4]):
            size = np.linalg.norm(vectors, axis=-1)
            is_smooth |= size < np.maximum(_EVEN * _local_rms(size), least)
        moves = speed > 0.5 * MOVING_RAD
        smooth, moving = smooth + int((is_smooth & moves).sum()), moving + int(moves.sum())
    return smooth / moving if moving >= _LEAST_MOVING else 0.0


def _local_rms(values: FloatArray) -> FloatArray:
    """Root mean square of values (T, K) over five frames."""
    return np.sqrt(np.asarray(convolve1d(values**2, np.full(5, 0.2), axis=0, mode="nearest")))


def is_keyed(*clips: Clip) -> bool:
    """Whether clips were drawn between keys, with lines or splines (``interpolated_fraction``)."""
    return interpolated_fraction(*clips) > KEYED_FRACTION


def velocity_jump(positions: FloatArray, first: int, stop: int, fps: float) -> float:
    """Largest change of velocity from one frame step to the next at either end of frames [first, stop).

    positions: (T, K, 3) with at least two frames before ``first`` and after ``stop`` where the clip has them; the unit
    is that of positions a second. At each end, the steps on either side of the last frame outside and of the first
    inside are compared.
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

    positions: (T, K, 3). Jerk is the third difference. least: jerk that the frames around are taken to have at least,
    in units of positions. NaN where there are none, or they are at rest and ``least`` is 0.
    """
    jerk = np.linalg.norm(np.diff(positions, n=3, axis=0), axis=-1)  # [i] spans frames i .. i + 3
    inside = np.zeros(len(jerk), bool)
    inside[max(first - 4, 0) : stop + 1] = True
    around = max(float(np.sqrt(np.mean(jerk[~inside] ** 2))), least) if (~inside).any() else 0.0
    if around < 1e-12 or not inside.any():
        return float("nan")
    return float(np.sqrt(np.mean(jerk[inside] ** 2)) / around)
