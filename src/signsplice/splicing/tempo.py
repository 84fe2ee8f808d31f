"""Playback rates of the frames of a sign: their limits, and the rates at which the sign lasts a given time.

A rate is the playback speed of a frame relative to the recording. Speeds grow with the rate and accelerations with its
square, so the intensity of a frame, the larger of speed over the highest human speed and the square root of
acceleration over the highest human acceleration, grows linearly with the rate: 1 / intensity is the highest rate that a
person could follow. Holds and slow parts have low intensity and are shortened first.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import scipy

from signsplice.body.capsules import body_capsules
from signsplice.body.collision import Near, near_pairs, pair_clearances, skin_pairs
from signsplice.body.contacts import SEPARATION_M, find_contacts, pose_body
from signsplice.motion import Clip, FloatArray, kinematics, sample_clip
from signsplice.rig.info import active_span, arms, rig_info
from signsplice.splicing.contracts import Cutter
from signsplice.splicing.durations import running_sign_s
from signsplice.splicing.word import AlignedWord, cut_words


@dataclass(frozen=True)
class RateSettings:
    """Limits of playback rates, and settings of the measurements that they follow."""

    highest_rate: float = 16.0
    """Highest rate, for still hands: people omit holds between signs, so a second of hold becomes a sixteenth."""
    least_contact_s: float = 0.08
    """Shortest time to which a contact is reduced, s: two frames at 25 or 30 a second."""
    least_movement_s: float = 0.1
    """Shortest time to which one movement of a hand or its fingers is reduced, s: hands repeat a movement to and fro no
    faster than about five times a second.
    """
    slow_frame_preference: float = 0.5
    """Preference for slow frames: 0 plays all frames at one rate, 1 brings all to one intensity, which would remove the
    acceleration at the start and end of movements.
    """
    neighbour_intensity: float = 0.35
    """Largest intensity of frames before and after a sign: neighbours keep a few of them, and a fast hand there
    overshoots in the transition.
    """
    least_intensity: float = 0.02
    """Lower limit of the intensity."""
    difference_step_s: float = 1.0 / 30.0
    """Step of the differences that give speeds and accelerations, s."""
    smoothing_s: float = 0.04
    """Width of the smoothing of intensities and rates, s."""
    noise_filter_s: float = 0.08
    """Standard deviation of the Gaussian that filters positions before accelerations limit rates, s: otherwise capture
    noise of a few thousandths of a radian per joint would limit a hold to two or three times its pace.
    """
    still_speed_m_s: float = 0.05
    """Speed below which a hand stands still between movements, m/s."""
    movement_peak_m_s: float = 0.12
    """Prominence from which on a local maximum of speed counts as a movement, m/s."""
    boundary_frames: int = 2
    """Frames of a sign beyond the time from its first to its last recorded frame: one, and half a one at either end,
    since a sentence shows the played frames just outside of these.
    """
    frame_decimals: int = 4
    """Decimals to which source frames are rounded."""


RATES = RateSettings()

PEAKS = {"Hand": (2.5, 45.0), "Distal": (4.3, 73.0), "head": (1.5, 12.7)}
"""Role suffix -> highest speed, m/s, and acceleration, m/s2, of wrists, fingertips and head, seen from the hips: 99 %
of the frames of a public captured take (``long_take_metres``) stay below. The wrists' speed is lower than in that take
(2.75): the highest of isolated words.
"""


@dataclass(frozen=True, eq=False)
class Pace:
    """The intensities and highest rates of a clip's T frames.

    intensity: (T,) intensity relative to human peaks, 1 at a peak.
    most: (T,) highest rate, at least 1.
    active: frames [start, stop) in which the arms are away from rest.
    fps: frame rate of the clip.
    """

    intensity: FloatArray
    most: FloatArray
    active: tuple[int, int]
    fps: float

    def seconds(self, rates: FloatArray, first: int, last: int) -> float:
        """Returns the time that frames ``first`` to ``last`` take at ``rates`` (T,)."""
        slowness = 1.0 / rates[first : last + 1]
        return float((0.5 * (slowness[1:] + slowness[:-1])).sum()) / self.fps

    def rates(self, first: int, last: int, seconds: float) -> FloatArray:
        """Returns rates (T,) at which frames ``first`` to ``last``, a sign, take ``seconds``, or as close as the limits
        allow; all 1 if they take no longer as recorded.
        """
        if (last - first) / self.fps <= seconds:
            return np.ones_like(self.most)
        limits = np.minimum(self.most, np.maximum(RATES.neighbour_intensity / self.intensity, 1.0))
        limits[first + 1 : last] = self.most[first + 1 : last]
        limits[: min(first, self.active[0])] = limits[max(last + 1, self.active[1]) :] = 1.0
        slow, fast = -8.0, 8.0  # log2 of the intensity that slow moments are brought towards
        for _ in range(40):
            middle = 0.5 * (slow + fast)
            if self.seconds(self._rates(2.0**middle, limits), first, last) > seconds:
                slow = middle
            else:
                fast = middle
        return self._rates(2.0**fast, limits)

    def _rates(self, level: float, most: FloatArray) -> FloatArray:
        rates = np.clip((level / self.intensity) ** RATES.slow_frame_preference, 1.0, most)
        return np.asarray(np.exp(_smooth(np.log(rates), self.fps)))


def pace(clip: Clip) -> Pace:
    """Returns the pace of an aligned clip, computed once for the clip that it was placed from.

    Raises ``InputError`` if the rig's arms are not known by name.
    """
    return (clip.source_clip or clip).derived[_pace]


def _pace(clip: Clip) -> Pace:
    points, speeds, accelerations = _points(clip)
    intensity = _intensity(points, points, speeds, accelerations, clip.fps)
    low_passed = scipy.ndimage.gaussian_filter1d(points, RATES.noise_filter_s * clip.fps, axis=0, mode="nearest")
    limiting = _intensity(points, low_passed, speeds, accelerations, clip.fps)
    width = 2 * max(1, round(RATES.smoothing_s * clip.fps)) + 1
    limits = np.clip(1.0 / np.maximum(limiting, 1.0 / RATES.highest_rate), 1.0, RATES.highest_rate)
    spans = [(*frames, RATES.least_movement_s) for frames in _movements(clip)]
    # Contacts count from the first to the last touch.
    spans += [(start, stop - 1, RATES.least_contact_s) for start, stop in contact_frames(clip)]
    for start, stop, least in spans:
        limits[start : stop + 1] = np.minimum(limits[start : stop + 1], max(1.0, (stop - start) / clip.fps / least))
    limits = scipy.ndimage.minimum_filter1d(limits, width, mode="nearest")
    smooth = scipy.ndimage.gaussian_filter1d(intensity, RATES.smoothing_s * clip.fps, mode="nearest")
    return Pace(np.maximum(smooth, RATES.least_intensity), limits, active_span(arms(clip)), clip.fps)


def _intensity(
    moving: FloatArray, accelerating: FloatArray, speeds: FloatArray, accelerations: FloatArray, fps: float
) -> FloatArray:
    """Returns the intensity (T,) of points (T, P, 3): speeds of ``moving`` over ``speeds`` (P,), accelerations of
    ``accelerating`` over ``accelerations`` (P,).
    """
    step, n_frames = max(1, round(RATES.difference_step_s * fps)), len(moving)
    before, after = (np.clip(np.arange(n_frames) + n, 0, n_frames - 1) for n in (-step, step))
    speed = np.linalg.norm(moving[after] - moving[before], axis=-1) * fps / (2.0 * step)
    change = accelerating[after] - 2.0 * accelerating + accelerating[before]
    acceleration = np.linalg.norm(change, axis=-1) * (fps / step) ** 2
    return np.asarray(np.maximum(speed / speeds, np.sqrt(acceleration / accelerations)).max(axis=1))


def _smooth(values: FloatArray, fps: float) -> FloatArray:
    """Smooths values (T,) by a bell no wider than the minimum filter of ``most``, so that ``most`` stays a limit."""
    side = max(1, round(RATES.smoothing_s * fps))
    kernel = np.hanning(2 * side + 3)[1:-1]
    return np.asarray(scipy.ndimage.convolve1d(values, kernel / kernel.sum(), mode="nearest"))


def _points(clip: Clip) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Returns points (T, P, 3) of the body relative to the hips, m, and their highest speeds and accelerations (P,)."""
    info = rig_info(clip.skeleton)
    joints = info.roles.joints
    rows = [(joints[role], peak) for role in joints for end, peak in PEAKS.items() if role.endswith(end)]
    positions = kinematics.forward(clip, [0, *(joint for joint, _ in rows)])[1] * info.sizes.unit.metres
    speeds, accelerations = np.array([peak for _, peak in rows]).T
    return positions[:, 1:] - positions[:, :1], speeds, accelerations


def _movements(clip: Clip) -> list[tuple[int, int]]:
    """Returns the first and last frame of each single movement of a wrist, or of its fingers relative to it, from one
    minimum of speed to the next.
    """
    info = rig_info(clip.skeleton)
    joints = info.roles.joints
    movements: list[tuple[int, int]] = []
    for side in ("left", "right"):
        tips = [joint for role, joint in joints.items() if role.startswith(side) and role.endswith("Distal")]
        positions = kinematics.forward(clip, [0, joints[f"{side}Hand"], *tips])[1] * info.sizes.unit.metres
        positions = scipy.ndimage.gaussian_filter1d(positions, RATES.smoothing_s * clip.fps, axis=0, mode="nearest")
        for path in (positions[:, 1:2] - positions[:, :1], positions[:, 2:] - positions[:, 1:2]):
            speed = np.linalg.norm(np.gradient(path, axis=0), axis=-1).max(axis=1, initial=0.0) * clip.fps
            movements += _humps(speed)
    return movements


def _humps(speed: FloatArray) -> list[tuple[int, int]]:
    """Returns the first and last frame around each clear maximum of ``speed`` (T,), between the minima or the stillness
    on either side.
    """
    peaks = [peak - 1 for peak in prominent_peaks(np.r_[0.0, speed, 0.0], RATES.movement_peak_m_s)]
    lows = [a + int(np.argmin(speed[a : b + 1])) for a, b in pairwise(peaks)]
    is_still, ranges = speed < RATES.still_speed_m_s, []
    for peak, low, high in zip(peaks, [0, *lows], [*lows, len(speed) - 1], strict=len(peaks) > 0):
        before, after = (np.flatnonzero(is_still[part]) for part in (slice(low, peak), slice(peak, high)))
        ranges.append((low + int(before[-1]) if len(before) else low, peak + int(after[0]) if len(after) else high))
    return ranges


def prominent_peaks(values: FloatArray, prominence: float) -> list[int]:
    """Returns the local maxima of ``values`` (T,) with at least this ``prominence``; the middle of a plateau. Equal to
    ``scipy.signal.find_peaks``, whose import takes a third of a second.
    """
    change = np.flatnonzero(np.diff(values))
    firsts, lasts = np.r_[0, change + 1], np.r_[change, len(values) - 1]  # of each run of equal values
    rises = np.r_[False, np.diff(values[firsts]) > 0, True]
    peaks = []
    for peak in ((firsts + lasts) // 2)[rises[:-1] & ~rises[1:]].tolist():
        higher = np.flatnonzero(values > values[peak])
        k = int(np.searchsorted(higher, peak))
        left_low = values[higher[k - 1] + 1 if k else 0 : peak + 1].min()
        right_low = values[peak : higher[k] if k < len(higher) else None].min()
        if values[peak] - max(left_low, right_low) >= prominence:
            peaks.append(peak)
    return peaks


def contact_frames(clip: Clip) -> list[tuple[int, int]]:
    """Returns the half-open frame ranges in which a hand touches head, trunk, arm or the other hand."""
    body = body_capsules(clip.skeleton)
    posed, pairs = pose_body(clip, body), skin_pairs(body, frozenset(body.keys))
    frames, k = near_pairs(posed.starts, posed.ends, posed.radii, pairs, SEPARATION_M)
    distance = pair_clearances(posed.starts, posed.ends, posed.radii, pairs, frames, k).distance
    close_pairs = Near(frames, k, distance)
    return [contact.frames for contact in find_contacts(body, pairs, close_pairs, distance, len(clip))]


def retime_word(word: AlignedWord, cutter: Cutter, seconds: float) -> AlignedWord:
    """Brings a word to a tempo of ``seconds`` a sign, as far as human peaks allow. Returns it unchanged if the sign is
    no longer than that, if it is a letter (seams determine the tempo of letters), or, with a warning, if the rig's arms
    are not known by name.

    The sign is the part that the cutter keeps between two copies of the word.
    """
    if word.is_letter:
        return word
    clip, n_left_out = word.clip, word.frames.n_left_out
    if not rig_info(clip.skeleton).has_arms:
        line = f"no arms known in {clip.name}: it is played as recorded, whatever the tempo"
        return replace(word, warnings=(*word.warnings, line))
    if len(clip) < 2:
        return word
    first, last = find_sign(word, cutter)
    wanted_s = running_sign_s((last - first + 1) / clip.fps, seconds)
    rates = pace(clip).rates(first, last, wanted_s - RATES.boundary_frames / clip.fps)
    if np.all(rates == 1.0):
        return word
    # Rounded as frames of the whole clip: sampling it at a warp's frames gives the same fractions, bit for bit.
    sources = np.round(_source_frames(rates) + n_left_out, RATES.frame_decimals) - n_left_out
    return replace(word, retimed=sample_clip(clip, sources), frames=replace(word.frames, sources=sources))


def find_sign(word: AlignedWord, cutter: Cutter) -> tuple[int, int]:
    """Returns the first and last frame of the sign in a word: as the cutter cuts it, or, at an end that it keeps whole,
    by the span in which the arms are away from rest.
    """
    (cut,) = cut_words(cutter, [word, word])
    start, stop = active_span(arms(word.clip))
    first = cut.post or start
    last = cut.pre if cut.pre < len(word.clip) - 1 else stop - 1
    return (first, last) if first < last else (start, stop - 1)


def _source_frames(rates: FloatArray) -> FloatArray:
    """Returns the recorded frame that each played frame shows, from the rate at each recorded frame (T,). The first and
    last frames are played exactly, which makes the whole longer by less than a frame.
    """
    slowness = 1.0 / rates
    times = np.r_[0.0, np.cumsum(0.5 * (slowness[1:] + slowness[:-1]))]  # played frames
    n_frames = int(np.ceil(times[-1] - 1e-9))
    times *= n_frames / times[-1]
    sources = scipy.interpolate.PchipInterpolator(times, np.arange(len(rates), dtype=np.float64))(
        np.arange(n_frames + 1)
    )
    sources = np.round(sources, RATES.frame_decimals)
    sources[0], sources[-1] = 0.0, len(rates) - 1.0
    return np.asarray(sources)
