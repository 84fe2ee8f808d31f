"""Judges whether a clip was drawn between keys or captured, once for all of its frames and joints.

Between two keys of an animation program a joint follows a line or a cubic: second or fourth differences vanish. At a
key in frame 0 with none in the three frames on either side, a cubic with continuous velocity has the fourth differences
d[-1] = a/2 + b/6, d[0] = 2b/3, d[1] = -a/2 + b/6 (a, b: jumps of the second and third derivative), so
d[0] = 2 (d[-1] + d[1]). With keys every n frames this leaves (n - 2) / n of the frames, from n = 3 on, in which a curve
fits, and (n - 1) / n of those on lines; in captured motion differences of all frames are alike, and few fit by chance.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from signsplice.motion import Clip, FloatArray, rotation
from signsplice.rig.info import rig_info
from signsplice.rig.metrics import MOVING_RAD
from signsplice.rig.roles import ARM

KEYED_DENSITY = 0.1375
"""Fraction of the moving frames fitted by a line or cubic from which on a clip is keyed: the optimum at equal costs for
2,300 clips of a take and of words of three bodies, re-keyed in eight ways, or with noise, filtered or resampled.
"""
_EXACT = 0.05
"""Fraction of the local root mean square up to which a difference counts as zero."""
_LEVEL_FRAMES = 9
"""Number of frames of that root mean square."""
_ROUNDING_RAD = 1e-7
"""Rounding error below which a difference counts as zero, radians."""
_LEAST_S = 1.0
"""Least motion that is judged, seconds summed over joints."""
_KEYED_SECOND = 0.2
"""Density from which on one second of one joint is keyed: it has too few frames for ``KEYED_DENSITY``."""
_RATES = (24.0, 25.0, 30.0)
"""Rates from which a clip may have been resampled, frames a second."""
_MOST_FPS = 60.0
"""Approximate largest rate at which clips are judged, frames a second."""


@dataclass(frozen=True)
class Keyedness:
    """Whether a clip was drawn between keys.

    is_keyed: whether it was. All joints count, up to twice the score of the arms if these move for a second.
    fraction: fraction of the motion that follows lines or cubics between keys.
    every: approximate frames from key to key: too few if joints are fast. None if captured.
    reason: a line that explains the result.
    """

    is_keyed: bool
    fraction: float
    every: float | None
    reason: str


def judge_keyedness(*clips: Clip) -> Keyedness:
    """Judges whether clips of one skeleton and rate were drawn between keys; the result for one clip is cached."""
    return (clips[0].source_clip or clips[0]).derived[judge_clip] if len(clips) == 1 else _judge(*clips)


def explain_keyedness(clip: Clip) -> Keyedness:
    """Judges a clip with all joints in the reason, which takes longer for captured clips."""
    return _judge(clip, explain=True)


def judge_clip(clip: Clip) -> Keyedness:
    """Judges whether one clip was drawn between keys, for ``judge_keyedness``."""
    return _judge(clip)


@dataclass(frozen=True, eq=False)
class _MotionFit:
    """The frames in which lines and curves fit a motion of T frames and J joints.

    rate: frames a second.
    speed: (T, J) radians a frame; 0 if a joint hardly moves.
    lines, curves: (T, J) whether four frames lie on a line, and whether a line, a cubic, or two with a key between fit.
    """

    rate: float
    speed: FloatArray
    lines: NDArray[np.bool_]
    curves: NDArray[np.bool_]

    def density(self, joints: NDArray[np.bool_]) -> float:
        """Returns the fraction of moving frames that curves fit, averaged over joints by motion; -1 if the joints move
        for less than ``_LEAST_S``.
        """
        n_moving, speed = np.sum(self.speed[:, joints] > 0.0, axis=0), self.speed[:, joints].sum(axis=0)
        if n_moving.sum() < _LEAST_S * self.rate:
            return -1.0
        return float(np.average(self.curves[:, joints].sum(axis=0) / np.maximum(n_moving, 1), weights=speed))

    def keyframe_share_and_step(self, joints: NDArray[np.bool_]) -> tuple[float, float]:
        """Returns the fraction of the joints' motion in seconds that curves fit, and frames from key to key there."""
        speed, curves, width = self.speed[:, joints], self.curves[:, joints], round(self.rate) | 1
        n_fit, n_moving = (_running_mean(mask.astype(np.float64), width, "constant") for mask in (curves, speed > 0.0))
        is_keyed = n_fit > _KEYED_SECOND * n_moving
        total, within = speed.sum(), speed[is_keyed].sum()
        if not within:
            return 0.0, 0.0
        of_lines, of_curves = (speed[is_keyed & mask].sum() / within for mask in (self.lines[:, joints], curves))
        unfit = 1.0 - (of_lines if of_lines > 0.5 * of_curves else of_curves)
        every = (1.0 if of_lines > 0.5 * of_curves else 2.0) / max(unfit, 1e-3)
        return float(within / total), float(every)


def _judge(*clips: Clip, explain: bool = False) -> Keyedness:
    is_arm = np.zeros(len(clips[0].skeleton), bool)
    roles = rig_info(clips[0].skeleton).roles.joints
    is_arm[[joint for role, joint in roles.items() if role.endswith(ARM)]] = True
    everything = np.ones_like(is_arm)
    if not explain and is_arm.any():
        # The score is at most twice the arms' density, so the arms suffice for most captured clips.
        of_arms = everything[is_arm]
        fit = max(_fits(clips, is_arm), key=lambda fit: fit.density(of_arms))
        if 0.0 <= 2.0 * fit.density(of_arms) <= KEYED_DENSITY:
            fraction = fit.keyframe_share_and_step(of_arms)[0]
            return Keyedness(False, fraction, None, f"captured: {100.0 * fraction:.0f} % of {_OF_ARMS}")
    fits = _fits(clips, everything)
    moving = [fit for fit in fits if fit.density(is_arm) >= 0.0]
    judged, name = (is_arm, _OF_ARMS) if moving else (everything, _OF_ALL)

    def density_of(fit: _MotionFit) -> float:
        """Scores all joints, limited to twice the density of the judged joints."""
        of_judged = fit.density(judged)
        return min(0.5 * (of_judged + fit.density(everything)), 2.0 * of_judged)

    fit = max(moving or fits, key=density_of)
    density = density_of(fit)
    if density < 0.0:
        return Keyedness(False, 0.0, None, "captured: hardly anything moves")
    is_keyed = density > KEYED_DENSITY
    fraction, step = fit.keyframe_share_and_step(judged)
    every = min(step * clips[0].fps / fit.rate, float(sum(map(len, clips)))) if is_keyed else None
    lines = [f"{'keyed' if is_keyed else 'captured'}: {100.0 * fraction:.0f} % of {name}"]
    if fit.density(~judged) >= 0.0:
        lines.append(f"{100.0 * fit.keyframe_share_and_step(~judged)[0]:.0f} % of the other joints'")
    if every is not None:
        lines.append(f"keys about every {every:.0f} frames")
    return Keyedness(is_keyed, fraction, every, ", ".join(lines))


_OF_ARMS, _OF_ALL = (f"{joints} motion follows lines or cubics" for joints in ("the arms'", "all joints'"))


def _fits(clips: Sequence[Clip], joints: NDArray[np.bool_]) -> list[_MotionFit]:
    """Returns the fits of some joints (J,) of clips at every rate."""
    return [_concatenate_fits(views) for views in zip(*(list(_views(clip, joints)) for clip in clips), strict=True)]


def _concatenate_fits(fits: tuple[_MotionFit, ...]) -> _MotionFit:
    """Concatenates the fits of several clips at one rate."""
    arrays = (
        np.concatenate(parts) for parts in zip(*((fit.speed, fit.lines, fit.curves) for fit in fits), strict=True)
    )
    return _MotionFit(fits[0].rate, *arrays)


def _views(clip: Clip, joints: NDArray[np.bool_]) -> Iterator[_MotionFit]:
    """Yields the fit at the clip's rate, at most about 60 a second, and at the rates from which it may have been
    resampled by slerp: frames between those of a slower clip always lie on lines.
    """
    step = max(1, round(clip.fps / _MOST_FPS))
    rotations, fps = clip.local_rotations[::step, joints], clip.fps / step
    yield _view(rotations, fps)
    for rate in _RATES:
        if fps > 1.1 * rate:
            yield _view(_source_frames(rotations, Fraction(rate / fps).limit_denominator(12)), rate)


def _source_frames(rotations: FloatArray, step: Fraction) -> FloatArray:
    """Reconstructs frames (S, J, 4) of the clip from which ``motion.resample`` made rotations (T, J, 4) at intervals of
    ``step`` frames: in every block between frames of both clips, each is extrapolated from the one before or after it.
    """
    n_source, n_shown = step.numerator, step.denominator
    n_blocks = (len(rotations) - 1) // n_shown
    if not n_blocks:
        return rotations[:1]
    shown = np.stack([rotations[k : k + (n_blocks - 1) * n_shown + 1 : n_shown] for k in range(n_shown + 1)])
    seen = np.stack([shown, shown[::-1]], axis=1)  # each block to and fro
    chain = [seen[0]]
    for k in range(n_source // 2):
        frame = (k + 1) * n_shown // n_source
        chain.append(rotation.slerp(chain[k], seen[frame], 1.0 / float(frame * step - k)))
    first, last = [to for to, _ in chain], [fro for _, fro in chain[: n_source - n_source // 2]]
    blocks = np.stack([*first, *last[:0:-1]], axis=1)
    return np.concatenate([blocks.reshape(-1, *rotations.shape[1:]), shown[-1][-1:]])


def _view(q: FloatArray, rate: float) -> _MotionFit:
    """Fits lines and curves to rotations (T, J, 4); there are no fits in fewer than five frames."""
    if len(q) < 5:
        nowhere = np.zeros((0, q.shape[1]))
        return _MotionFit(rate, nowhere, nowhere > 0.0, nowhere > 0.0)
    q = rotation.continuous(q)
    second = q[:-2] - 2.0 * q[1:-1] + q[2:]
    fourth = second[:-2] - 2.0 * second[1:-1] + second[2:]  # (T - 4, J, 4)
    at_key = (fourth[1:-1] - 2.0 * (fourth[:-2] + fourth[2:])) / 3.0  # as large as a difference, of noise
    bends, spikes = _perpendicular_sizes(q[2:-2], second[1:-1]), _perpendicular_sizes(q[2:-2], fourth)
    breaks = np.full_like(spikes, np.inf)
    breaks[1:-1] = _perpendicular_sizes(q[3:-3], at_key)
    speed = np.linalg.norm(q[3:-1] - q[1:-3], axis=-1)  # half the angle is the arc of a unit quaternion
    moves = speed > 0.5 * MOVING_RAD * 30.0 / rate
    is_even, limit = bends < _tolerance(bends), _tolerance(spikes)
    lines = np.zeros_like(moves)
    lines[1:] |= is_even[1:] & is_even[:-1]
    lines[:-1] |= is_even[1:] & is_even[:-1]
    curves = lines | (spikes < limit) | (breaks < limit)
    return _MotionFit(rate, np.where(moves, speed, 0.0), lines & moves, curves & moves)


def _perpendicular_sizes(q: FloatArray, changes: FloatArray) -> FloatArray:
    """Returns sizes (T, J), rad, of combinations c (T, J, 4) of quaternions with weights that sum to 0, seen from q:
    the vector part of q^-1 c, in which a slerp through q is odd in time, is as long as c's part perpendicular to q.
    """
    parallel = np.einsum("tjc,tjc->tj", q, changes)
    return np.asarray(2.0 * np.sqrt(np.maximum(np.einsum("tjc,tjc->tj", changes, changes) - parallel**2, 0.0)))


def _tolerance(sizes: FloatArray) -> FloatArray:
    """Returns the size below which differences of ``sizes`` (T, J) count as zero."""
    mean = np.maximum(_running_mean(sizes**2, _LEVEL_FRAMES, "nearest"), 0.0)
    return np.asarray(np.maximum(_EXACT * np.sqrt(mean), _ROUNDING_RAD))


def _running_mean(values: FloatArray, width: int, mode: Literal["constant", "nearest"]) -> FloatArray:
    """Returns means of values (T, J) over an odd number of frames; ``mode`` defines the values beyond the ends."""
    from scipy.ndimage import uniform_filter1d  # its import takes longer than to convert a clip

    return np.asarray(uniform_filter1d(values, width, axis=0, mode=mode))
