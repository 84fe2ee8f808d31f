"""How fast each moment of a sign may be played, and how fast it is played to last a given time.

A rate says how many times as fast as recorded a moment passes. Speeds grow with the rate and accelerations with its
square, so the intensity of a moment, the larger of speed over the highest human speed and the square root of
acceleration over the highest human acceleration, grows with the rate itself: at a rate of 1 / intensity a person could
just follow. Low intensity means a hold or a slow part; those are shortened first.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import convolve1d, gaussian_filter1d, minimum_filter1d

from signsplice.body.capsules import body_capsules
from signsplice.body.collision import Near, near_pairs, pair_clearances, skin_pairs
from signsplice.body.contacts import PART_M, find_contacts, pose_body
from signsplice.motion import Clip, FloatArray, kinematics, sample_clip
from signsplice.rig.info import active_span, arms, rig_info
from signsplice.splicing.contracts import Cutter
from signsplice.splicing.durations import running_sign_s
from signsplice.splicing.word import AlignedWord, cut_words

PEAKS = {"Hand": (2.5, 45.0), "Distal": (4.3, 73.0), "head": (1.5, 12.7)}
"""Highest speed, m/s, and acceleration, m/s2, of wrists, fingertips and head, seen from the hips, by the end of their
roles' names: 99 % of the frames of a public captured take (``long_take_metres``) stay below. The wrists' speed is lower
than that (2.75): the highest of isolated words.
"""
MOST = 16.0
"""Highest rate, of hands that stand: people leave holds between signs out, and a second of one becomes a sixteenth."""
CONTACT_S = 0.08
"""A contact is held at least this long, where it was: two frames at 25 or 30 a second."""
STROKE_S = 0.1
"""One movement of a hand or its fingers takes at least this long, where it did: hands repeat a movement to and fro no
faster than about five times a second.
"""
FLATTENING = 0.5
"""How much slow moments are preferred: 0 plays all moments at one rate, 1 brings all to one intensity, which would take
from movements how they start and stop.
"""
OUTSIDE = 0.35
"""Intensity that what lies before and after a sign is brought to at most: neighbours keep a little of it, and a hand
that is led away fast there swings out in the transition.
"""
_LEAST_INTENSITY = 0.02
_STEP_S = 1.0 / 30.0
"""Step of the differences that speeds and accelerations are taken by."""
_SMOOTH_S = 0.04
_NOISE_S = 0.08
"""Standard deviation of the Gaussian under which accelerations limit rates: a capture's noise, a few thousandths of a
radian a joint, would otherwise allow a hold no more than two or three times its pace.
"""
_STILL_M_S, _LEAST_PEAK_M_S = 0.05, 0.12
"""A local maximum of speed counts as a movement where it rises this much above the minima beside it."""


@dataclass(frozen=True, eq=False)
class Pace:
    """What a clip's T frames allow.

    intensity: (T,) how near to human peaks each moment is, 1 at a peak.
    most: (T,) highest rate, at least 1.
    active: frames [start, stop) in which the arms are away from rest.
    fps: of the clip.
    """

    intensity: FloatArray
    most: FloatArray
    active: tuple[int, int]
    fps: float

    def seconds(self, rates: FloatArray, first: int, last: int) -> float:
        """How long frames ``first`` to ``last`` take at ``rates`` (T,)."""
        slowness = 1.0 / rates[first : last + 1]
        return float((0.5 * (slowness[1:] + slowness[:-1])).sum()) / self.fps

    def rates(self, first: int, last: int, seconds: float) -> FloatArray:
        """Rates (T,) at which frames ``first`` to ``last``, a sign, take ``seconds``, or as near as the limits allow; 1
        throughout where they take no longer as recorded.
        """
        if (last - first) / self.fps <= seconds:
            return np.ones_like(self.most)
        most = np.minimum(self.most, np.maximum(OUTSIDE / self.intensity, 1.0))
        most[first + 1 : last] = self.most[first + 1 : last]
        most[: min(first, self.active[0])] = most[max(last + 1, self.active[1]) :] = 1.0
        slow, fast = -8.0, 8.0  # log2 of the intensity that slow moments are brought towards
        for _ in range(40):
            middle = 0.5 * (slow + fast)
            if self.seconds(self._rates(2.0**middle, most), first, last) > seconds:
                slow = middle
            else:
                fast = middle
        return self._rates(2.0**fast, most)

    def _rates(self, level: float, most: FloatArray) -> FloatArray:
        wanted = np.clip((level / self.intensity) ** FLATTENING, 1.0, most)
        return np.asarray(np.exp(_smooth(np.log(wanted), self.fps)))


def pace(clip: Clip) -> Pace:
    """What the frames of an aligned clip allow, computed once for the clip that it was placed from.

    Raises ``InputError`` where the rig's arms are not known by name.
    """
    return (clip.source_clip or clip).derived[_pace]


def _pace(clip: Clip) -> Pace:
    points, speeds, accelerations = _points(clip)
    intensity = _intensity(points, points, speeds, accelerations, clip.fps)
    low_passed = gaussian_filter1d(points, _NOISE_S * clip.fps, axis=0, mode="nearest")
    limiting = _intensity(points, low_passed, speeds, accelerations, clip.fps)
    width = 2 * max(1, round(_SMOOTH_S * clip.fps)) + 1
    most = np.clip(1.0 / np.maximum(limiting, 1.0 / MOST), 1.0, MOST)
    spans = [(*frames, STROKE_S) for frames in _movements(clip)]
    spans += [(start, stop - 1, CONTACT_S) for start, stop in contact_frames(clip)]  # from first to last touch
    for start, stop, least in spans:
        most[start : stop + 1] = np.minimum(most[start : stop + 1], max(1.0, (stop - start) / clip.fps / least))
    most = minimum_filter1d(most, width, mode="nearest")
    smooth = gaussian_filter1d(intensity, _SMOOTH_S * clip.fps, mode="nearest")
    return Pace(np.maximum(smooth, _LEAST_INTENSITY), most, active_span(arms(clip)), clip.fps)


def _intensity(
    moving: FloatArray, accelerating: FloatArray, speeds: FloatArray, accelerations: FloatArray, fps: float
) -> FloatArray:
    """Intensity (T,) of points (T, P, 3): speeds of the first over ``speeds`` (P,), accelerations of the second over
    ``accelerations`` (P,).
    """
    step, n_frames = max(1, round(_STEP_S * fps)), len(moving)
    before, after = (np.clip(np.arange(n_frames) + n, 0, n_frames - 1) for n in (-step, step))
    speed = np.linalg.norm(moving[after] - moving[before], axis=-1) * fps / (2.0 * step)
    change = accelerating[after] - 2.0 * accelerating + accelerating[before]
    acceleration = np.linalg.norm(change, axis=-1) * (fps / step) ** 2
    return np.asarray(np.maximum(speed / speeds, np.sqrt(acceleration / accelerations)).max(axis=1))


def _smooth(values: FloatArray, fps: float) -> FloatArray:
    """Values (T,) under a bell no wider than what ``most`` was narrowed by, so that it stays a limit."""
    side = max(1, round(_SMOOTH_S * fps))
    kernel = np.hanning(2 * side + 3)[1:-1]
    return np.asarray(convolve1d(values, kernel / kernel.sum(), mode="nearest"))


def _points(clip: Clip) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Points (T, P, 3) of the body relative to the hips, m, with the highest speed and acceleration (P,) of each."""
    info = rig_info(clip.skeleton)
    joints = info.roles.joints
    rows = [(joints[role], peak) for role in joints for end, peak in PEAKS.items() if role.endswith(end)]
    positions = kinematics.forward(clip, [0, *(joint for joint, _ in rows)])[1] * info.sizes.unit.metres
    speeds, accelerations = np.array([peak for _, peak in rows]).T
    return positions[:, 1:] - positions[:, :1], speeds, accelerations


def _movements(clip: Clip) -> list[tuple[int, int]]:
    """First and last frame of each single movement of a wrist, and of its fingers about it, from one minimum of speed
    to the next.
    """
    info = rig_info(clip.skeleton)
    joints = info.roles.joints
    found: list[tuple[int, int]] = []
    for side in ("left", "right"):
        tips = [joint for role, joint in joints.items() if role.startswith(side) and role.endswith("Distal")]
        positions = kinematics.forward(clip, [0, joints[f"{side}Hand"], *tips])[1] * info.sizes.unit.metres
        positions = gaussian_filter1d(positions, _SMOOTH_S * clip.fps, axis=0, mode="nearest")
        for path in (positions[:, 1:2] - positions[:, :1], positions[:, 2:] - positions[:, 1:2]):
            speed = np.linalg.norm(np.gradient(path, axis=0), axis=-1).max(axis=1, initial=0.0) * clip.fps
            found += _humps(speed)
    return found


def _humps(speed: FloatArray) -> list[tuple[int, int]]:
    """First and last frame around each clear maximum of ``speed`` (T,), between the minima or the stillness on either
    side.
    """
    peaks = [peak - 1 for peak in prominent_peaks(np.r_[0.0, speed, 0.0], _LEAST_PEAK_M_S)]
    lows = [a + int(np.argmin(speed[a : b + 1])) for a, b in pairwise(peaks)]
    ranges = []
    for peak, low, high in zip(peaks, [0, *lows], [*lows, len(speed) - 1], strict=len(peaks) > 0):
        before, after = (np.flatnonzero(speed[part] < _STILL_M_S) for part in (slice(low, peak), slice(peak, high)))
        ranges.append((low + int(before[-1]) if len(before) else low, peak + int(after[0]) if len(after) else high))
    return ranges


def prominent_peaks(values: FloatArray, prominence: float) -> list[int]:
    """Local maxima of ``values`` (T,) that stand out by at least ``prominence``; of a plateau its middle. The same as
    ``scipy.signal.find_peaks``, whose import takes a third of a second.
    """
    change = np.flatnonzero(np.diff(values))
    firsts, lasts = np.r_[0, change + 1], np.r_[change, len(values) - 1]  # of each run of equal values
    rises = np.r_[False, np.diff(values[firsts]) > 0, True]
    found = []
    for peak in ((firsts + lasts) // 2)[rises[:-1] & ~rises[1:]].tolist():
        higher = np.flatnonzero(values > values[peak])
        k = int(np.searchsorted(higher, peak))
        left = values[higher[k - 1] + 1 if k else 0 : peak + 1].min()
        right = values[peak : higher[k] if k < len(higher) else None].min()
        if values[peak] - max(left, right) >= prominence:
            found.append(peak)
    return found


def contact_frames(clip: Clip) -> list[tuple[int, int]]:
    """Half-open frame ranges in which a hand touches head, trunk, arm or the other hand."""
    body = body_capsules(clip.skeleton)
    posed, pairs = pose_body(clip, body), skin_pairs(body, frozenset(body.keys))
    frames, k = near_pairs(posed.starts, posed.ends, posed.radii, pairs, PART_M)
    distance = pair_clearances(posed.starts, posed.ends, posed.radii, pairs, frames, k).distance
    near = Near(frames, k, distance)
    return [contact.frames for contact in find_contacts(body, pairs, near, distance, len(clip))]


_BESIDE = 2
"""Frames of a sign beyond the time from its first to its last recorded frame: one, and half a one at either end, since
a sentence shows the played frames just outside of these.
"""
_DECIMALS = 4


def retime_word(word: AlignedWord, cutter: Cutter, seconds: float) -> AlignedWord:
    """A word brought to a tempo of ``seconds`` a sign, as far as human peaks allow; the word itself where the sign is
    no longer than that, where it is a letter, whose tempo the seams between letters decide, or, with a warning, where
    the rig's arms are not known by name.

    What counts as the sign is what the cutter keeps of it between two signs like itself.
    """
    if word.is_letter:
        return word
    clip, n_left_out = word.clip, word.frames.n_left_out
    if not rig_info(clip.skeleton).has_arms:
        line = f"no arms known in {clip.name}: it is played as recorded, whatever the tempo"
        return replace(word, warnings=(*word.warnings, line))
    if len(clip) < 2:
        return word
    first, last = _sign(word, cutter)
    wanted_s = running_sign_s((last - first + 1) / clip.fps, seconds)
    rates = pace(clip).rates(first, last, wanted_s - _BESIDE / clip.fps)
    if np.all(rates == 1.0):
        return word
    # Rounded as they count in the whole clip: sampling that at a warp's frames gives the same fractions, bit for bit.
    sources = np.round(_source_frames(rates) + n_left_out, _DECIMALS) - n_left_out
    return replace(word, retimed=sample_clip(clip, sources), frames=replace(word.frames, sources=sources))


def _sign(word: AlignedWord, cutter: Cutter) -> tuple[int, int]:
    """First and last frame of the sign in a word: as the cutter cuts it, or, at an end that it keeps whole, while the
    arms are away from rest.
    """
    (cut,) = cut_words(cutter, [word, word])
    start, stop = active_span(arms(word.clip))
    first = cut.post or start
    last = cut.pre if cut.pre < len(word.clip) - 1 else stop - 1
    return (first, last) if first < last else (start, stop - 1)


def _source_frames(rates: FloatArray) -> FloatArray:
    """The recorded frame that each played one shows, from the rate at each recorded frame (T,). The first and the last
    frame are played as they are: the whole is slower by less than a frame for that.
    """
    slowness = 1.0 / rates
    times = np.r_[0.0, np.cumsum(0.5 * (slowness[1:] + slowness[:-1]))]  # played frames
    n_frames = int(np.ceil(times[-1] - 1e-9))
    times *= n_frames / times[-1]
    sources = PchipInterpolator(times, np.arange(len(rates), dtype=np.float64))(np.arange(n_frames + 1))
    sources = np.round(sources, _DECIMALS)
    sources[0], sources[-1] = 0.0, len(rates) - 1.0
    return np.asarray(sources)
