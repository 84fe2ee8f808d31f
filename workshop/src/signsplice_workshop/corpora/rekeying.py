"""Clips redrawn between keys as animation programs draw them, and captured clips with noise or smoothed.

    line, euler-line          slerp between quaternions (glTF LINEAR; Blender, Unity); lines between Euler angles (Maya)
    blender, blender-euler    auto-clamped handles with continuous acceleration, Blender's default since 2.80
    blender-old               auto-clamped handles without it
    maya-auto, maya-clamped   "auto" and "clamped" tangents of Euler channels
    unity                     clamped-auto tangents of quaternion components
    spline                    a cubic with continuous second derivative through all keys of a quaternion component

Each function for a program's tangents names its source. A curve is a cubic of time between two keys, except for
blender-old.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline, CubicSpline, PchipInterpolator, interp1d
from scipy.linalg import solve_banded
from scipy.ndimage import gaussian_filter1d
from scipy.signal import butter, sosfiltfilt

from signsplice.motion import Clip, FloatArray, rotation, sample_clip

Tangents = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]
"""Key times (K,) and values (K, C) -> slopes into and out of every key (K, C)."""
_THIRD, _OLD_HANDLE = 1.0 / 3.0, 1.0 / 2.5614
"""Length of a handle along time, as a fraction of the interval to the next key: a third makes a cubic of time; the
other is that of ``calchandleNurb_intern`` with smoothing "None" (Blender, blenkernel/intern/curve.cc).
"""


@dataclass(frozen=True)
class Drawing:
    """How a program draws between keys.

    axes: order of the keyed Euler channels; None: quaternion components are keyed, or rotations are slerped.
    tangents: of its curves; None: lines.
    handle: length of handles, as a fraction of the interval.
    """

    axes: str | None
    tangents: Tangents | None
    handle: float = _THIRD


def _compute_secants(times: FloatArray, values: FloatArray) -> FloatArray:
    """Returns the slopes (K - 1, C) of the lines between keys."""
    return np.asarray(np.diff(values, axis=0) / np.diff(times)[:, None])


def _limit_slopes(slopes: FloatArray, secants: FloatArray, handle: float) -> FloatArray:
    """Returns slopes (K, C), flat at both ends and at keys that lie beyond both neighbours or level with one, and
    limited so that both handles stay between the values of their keys.
    """
    before, after = secants[:-1], secants[1:]
    steepest = np.minimum(np.abs(before), np.abs(after)) / handle
    inner = np.where(
        before * after > 0.0, np.sign(after) * np.minimum(np.maximum(np.sign(after) * slopes[1:-1], 0.0), steepest), 0.0
    )
    return np.concatenate([np.zeros_like(slopes[:1]), inner, np.zeros_like(slopes[:1])])


def _average_secants(times: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Returns the means (K, C) of the secants on either side of a key, 0 at both ends, and the secants (K - 1, C)."""
    secants = _compute_secants(times, values)
    slopes = np.zeros_like(values)
    slopes[1:-1] = 0.5 * (secants[:-1] + secants[1:])
    return slopes, secants


def _compute_old_blender_slopes(times: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Returns auto-clamped handles: ``calchandleNurb_intern``, HD_AUTO_ANIM (Blender, blenkernel/intern/curve.cc)."""
    slopes, secants = _average_secants(times, values)
    limited = _limit_slopes(slopes, secants, _OLD_HANDLE)
    return limited, limited


def _compute_blender_slopes(times: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Returns auto-clamped handles with smoothing "Continuous Acceleration": ``bezier_handle_calc_smooth_fcurve`` (same
    file) solves for slopes at which the second derivative is continuous; flat keys stay, and handles that overshoot are
    locked at the limit and the others solved again.
    """
    steps, secants = np.diff(times), _compute_secants(times, values)
    locked = _limit_slopes(_average_secants(times, values)[0], secants, _THIRD) == 0.0
    slopes = np.zeros_like(values)
    for channel in range(values.shape[1]):
        fixed, target = locked[:, channel].copy(), np.zeros(len(times))
        for _ in range(6):
            bands = np.zeros((3, len(times)))
            bands[1] = 1.0
            free = np.flatnonzero(~fixed)
            bands[0, free + 1] = 1.0 / steps[free]
            bands[2, free - 1] = 1.0 / steps[free - 1]
            bands[1, free] = 2.0 / steps[free - 1] + 2.0 / steps[free]
            right_side = target.copy()
            right_side[free] = 3.0 * (
                secants[free - 1, channel] / steps[free - 1] + secants[free, channel] / steps[free]
            )
            solved = solve_banded((1, 1), bands, right_side)
            clipped = _limit_slopes(solved[:, None], secants[:, channel, None], _THIRD)[:, 0]
            overshooting = ~fixed & (np.abs(solved - clipped) > 1e-12)
            target[overshooting], fixed[overshooting] = clipped[overshooting], True
            if not overshooting.any():
                break
        slopes[:, channel] = clipped
    return slopes, slopes


def _compute_maya_auto_slopes(times: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Returns auto tangents: spline tangents, flat at both ends, that do not overshoot a neighbour (Autodesk, Maya 2023
    help, Graph Editor Tangents menu, "Auto Span").
    """
    slopes = np.zeros_like(values)
    slopes[1:-1] = (values[2:] - values[:-2]) / (times[2:] - times[:-2])[:, None]
    limited = _limit_slopes(slopes, _compute_secants(times, values), _THIRD)
    return limited, limited


def _compute_maya_clamped_slopes(times: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Returns clamped tangents: from the key before to the key after, but a line between two keys of nearly one value
    (Autodesk, Maya 2013 help, Graph Editor Tangents menu, "Clamped").
    """
    secants = _compute_secants(times, values)
    slopes = np.concatenate([secants[:1], (values[2:] - values[:-2]) / (times[2:] - times[:-2])[:, None], secants[-1:]])
    into, out_of = slopes.copy(), slopes.copy()
    level = np.abs(np.diff(values, axis=0)) < _LEVEL
    into[1:][level], out_of[:-1][level] = secants[level], secants[level]
    return into, out_of


_LEVEL = 1e-4
"""Difference of two keys, radians, below which they count as level; Maya does not publish its own."""


def _compute_unity_slopes(times: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Returns clamped-auto tangents: means of both secants (``AnimationCurveUtility.UpdateTangents`` of Unity's Live
    Capture), flat at the ends, that do not overshoot (Unity manual, "Editing Curves": Clamped Auto; its code is not
    public).
    """
    slopes, secants = _average_secants(times, values)
    limited = _limit_slopes(slopes, secants, _THIRD)
    return limited, limited


def _compute_spline_slopes(times: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    slopes = np.asarray(CubicSpline(times, values)(times, 1)) if len(times) > 1 else np.zeros_like(values)
    return slopes, slopes


DRAWINGS = {
    "line": Drawing(None, None),
    "euler-line": Drawing("XYZ", None),
    "blender": Drawing(None, _compute_blender_slopes),
    "blender-euler": Drawing("XYZ", _compute_blender_slopes),
    "blender-old": Drawing(None, _compute_old_blender_slopes, _OLD_HANDLE),
    "maya-auto": Drawing("XYZ", _compute_maya_auto_slopes),
    "maya-clamped": Drawing("ZYX", _compute_maya_clamped_slopes),
    "unity": Drawing(None, _compute_unity_slopes),
    "spline": Drawing(None, _compute_spline_slopes),
}
"""Kinds of drawing by name, as the module's docstring describes them."""


def choose_key_frames(
    n_frames: int, every: int | tuple[int, int], rng: np.random.Generator | None = None
) -> FloatArray:
    """Returns the key frames (K,) from the first to the last frame: every ``every`` frames, or at intervals drawn from
    a range, both ends included.
    """
    if isinstance(every, int):
        keys = np.arange(0, n_frames - 1, every)
    else:
        if rng is None:
            raise TypeError("intervals of a range are drawn: give rng")
        steps = rng.integers(every[0], every[1] + 1, n_frames // every[0] + 1)
        keys = np.cumsum(np.concatenate([[0], steps]))
        keys = keys[keys < n_frames - 1]
    return np.append(keys, n_frames - 1).astype(np.float64)


def rekey_clip(
    clip: Clip,
    every: int | tuple[int, int],
    kind: str,
    rng: np.random.Generator | None = None,
    fps: float | None = None,
    joints: Sequence[int] | NDArray[np.intp] | None = None,
) -> Clip:
    """Returns the clip keyed every so many frames, with what a program draws between the keys.

    every, rng: of ``choose_key_frames``. kind: of ``DRAWINGS``. fps: the rate at which the program plays its curves;
    None: the clip's. (``motion.resample`` of the result would slerp between its frames instead.) joints: those that are
    keyed, by default all.
    """
    drawing, keys = DRAWINGS[kind], choose_key_frames(len(clip), every, rng)
    rate = clip.fps if fps is None else fps
    n_frames = int(np.floor((len(clip) - 1) * rate / clip.fps + 1e-9)) + 1
    times = np.arange(n_frames, dtype=np.float64) * clip.fps / rate
    quats = rotation.continuous(clip.local_rotations)
    values = quats if drawing.axes is None else rotation.nearest_euler_sequence(rotation.to_euler(quats, drawing.axes))
    key_values = values[keys.astype(int)].reshape(len(keys), -1)
    if drawing.tangents is not None:
        curve_values = _evaluate_curves(keys, key_values, drawing.tangents(keys, key_values), times, drawing.handle)
        curve_values = curve_values.reshape(len(times), *values.shape[1:])
    elif drawing.axes is None:
        interval, fraction = _find_intervals(keys, times)
        knots = quats[keys.astype(int)]
        curve_values = rotation.slerp(knots[interval], knots[interval + 1], fraction[:, None])
    else:
        interval, fraction = _find_intervals(keys, times)
        curve_values = (
            key_values[interval] + fraction[:, None] * (key_values[interval + 1] - key_values[interval])
        ).reshape(len(times), *values.shape[1:])
    local_quats = (
        rotation.normalize(curve_values) if drawing.axes is None else rotation.from_euler(curve_values, drawing.axes)
    )
    played = replace(sample_clip(clip, times), fps=rate) if rate != clip.fps else replace(clip, channels=None)
    if joints is not None:
        local_quats, keyed_quats = np.array(played.local_rotations), local_quats
        local_quats[:, joints] = keyed_quats[:, joints]
    return replace(played, local_rotations=local_quats, channels=None)


def _find_intervals(keys: FloatArray, times: FloatArray) -> tuple[NDArray[np.intp], FloatArray]:
    """Returns for every time the key before it and the fraction of the interval that has passed."""
    interval = np.clip(np.searchsorted(keys, times + 1e-9, side="right") - 1, 0, len(keys) - 2)
    return interval, np.asarray((times - keys[interval]) / (keys[interval + 1] - keys[interval]))


def _evaluate_curves(
    keys: FloatArray, values: FloatArray, slopes: tuple[FloatArray, FloatArray], times: FloatArray, handle: float
) -> FloatArray:
    """Returns Bezier curves (T, C) at ``times``, through values (K, C) with slopes into and out of each key."""
    interval, fraction = _find_intervals(keys, times)
    into, out_of = slopes
    s = fraction
    for _ in range(8 if handle != _THIRD else 0):  # Newton's steps to the curve's parameter at each time
        x = 3.0 * handle * s * (1.0 - s) ** 2 + 3.0 * (1.0 - handle) * s**2 * (1.0 - s) + s**3
        rate = 3.0 * handle * (1.0 - s) ** 2 + 6.0 * (1.0 - 2.0 * handle) * s * (1.0 - s) + 3.0 * handle * s**2
        s = s - (x - fraction) / rate
    s = s[:, None]
    length = handle * (keys[interval + 1] - keys[interval])[:, None]
    first, last = values[interval], values[interval + 1]
    points = (first, first + length * out_of[interval], last - length * into[interval + 1], last)
    binomials = ((1.0 - s) ** 3, 3.0 * s * (1.0 - s) ** 2, 3.0 * s**2 * (1.0 - s), s**3)
    return np.asarray(sum(b * p for b, p in zip(binomials, points, strict=True)))


def add_noise(clip: Clip, rad: float, rng: np.random.Generator, width: float = 0.0) -> Clip:
    """Returns the clip with noise of deviation ``rad``, radians, about each axis of every joint: white, or smoothed
    over ``width`` frames and as strong.
    """
    noise = rng.normal(size=(*clip.local_rotations.shape[:2], 3))
    if width:
        noise = gaussian_filter1d(noise, width, axis=0, mode="nearest")
        noise /= noise.std()
    local = rotation.multiply(clip.local_rotations, rotation.exp(rad * noise))
    return replace(clip, local_rotations=rotation.normalize(local), channels=None)


def low_pass(clip: Clip, hertz: float, order: int = 4) -> Clip:
    """Returns the clip without motion faster than ``hertz``, as motion made from video is smoothed: a Butterworth
    filter over quaternion components, forwards and backwards.
    """
    sections = butter(order, hertz, fs=clip.fps, output="sos")
    local = sosfiltfilt(sections, rotation.continuous(clip.local_rotations), axis=0)
    return replace(clip, local_rotations=rotation.normalize(local), channels=None)


KEY_FRAMES = (3, 12)
"""Smallest and largest number of frames between the keys of ``with_keys``."""


def with_keys(quats: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Returns the rotations (T, R, 4) redrawn between keys some ``KEY_FRAMES`` apart: by lines, by the cubics through
    their neighbours (Catmull and Rom 1974), or by cubics that do not overshoot (Fritsch and Carlson 1980).
    """
    interval, last_frame = int(rng.integers(KEY_FRAMES[0], KEY_FRAMES[1] + 1)), len(quats) - 1
    keys = np.unique([0, *range(int(rng.integers(interval)), last_frame, interval), last_frame])
    values, frames = rotation.continuous(quats[keys]), np.arange(len(quats))
    kind = int(rng.integers(3))
    if kind == 0 or len(keys) < 3:
        redrawn = interp1d(keys, values, axis=0)(frames)
    elif kind == 1:
        redrawn = CubicHermiteSpline(keys, values, np.gradient(values, keys, axis=0))(frames)
    else:
        redrawn = PchipInterpolator(keys, values)(frames)
    return rotation.normalize(redrawn)
