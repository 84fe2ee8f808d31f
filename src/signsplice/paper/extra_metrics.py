"""What the paper does not measure and viewers see: distance in the body's size, how much moves, how smooth the seams
are.

All from the 159 numbers, scaled back. Distances are seen from the hips, without their turn, which the numbers do not
show.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signsplice.motion.clip import Clip
from signsplice.paper.prediction import Prediction
from signsplice.rig import metrics, proportions
from signsplice.rig.roles import find_roles

Float = NDArray[np.float64]

CONTEXT = 8
"""Frames on either side of a transition that its seams are judged with."""

SIGNATURES = {
    "position_error": "position-error|joints:arms+fingers|frame:hips-place|unit:arm/1000|other-lengths:stretched|mean",
    "motion_ratio": "motion-ratio|joints:fingertips|frame:hips-place|path:P_pre,O,Q_post|sum/sum|of:predicted",
    "velocity_jump": f"{metrics.VELOCITY_JUMP}|over:Y|median:pairs|of:predicted",
    "jerk_ratio": f"{metrics.JERK_RATIO}|over:Y|context:{CONTEXT}|median:pairs|of:predicted",
}


@dataclass(frozen=True, eq=False)
class NumberLayout:
    """How the 159 numbers of a signer are read: joint indices, the arm's length in the numbers' unit, metres a unit."""

    hips: int
    arms: tuple[int, ...]
    tips: tuple[int, ...]
    wrists: tuple[int, ...]
    arm_length: float
    metres: float
    fps: float


@dataclass(frozen=True)
class PairMotion:
    """One pair: position error (arm / 1000), fingertip paths predicted and true, velocity jump (m/s), jerk ratio. NaN
    where positions or frames are missing.
    """

    position_error: float
    path: float
    true_path: float
    velocity_jump: float
    jerk_ratio: float


def number_layout(clip: Clip, unit_cm: float) -> NumberLayout:
    """How to read a signer's numbers: ``clip`` any of the signer's words, ``unit_cm`` the side of the cube."""
    joints = find_roles(clip.skeleton).joints
    return NumberLayout(
        hips=joints["hips"],
        arms=tuple(metrics.arm_and_finger_joints(clip)),
        tips=tuple(metrics.fingertip_joints(clip)),
        wrists=(joints["leftHand"], joints["rightHand"]),
        arm_length=proportions.sizes(clip.skeleton).arm_length / unit_cm,
        metres=unit_cm / 100.0,
        fps=clip.fps,
    )


def utterance(before: Float, after: Float, prediction: Prediction) -> Float | None:
    """The filter layer's Y (T, 159) = [P_1 .. P_pre, O, Q_post .. Q_M] (eq. 17); None where a position is missing."""
    if prediction.pre is None or prediction.post is None:
        return None
    return np.concatenate([before[: prediction.pre + 1], prediction.frames, after[prediction.post :]])


def pair_motion(
    prediction: Prediction, true: tuple[int, int, Float], words: tuple[Float, Float], number_layout: NumberLayout
) -> PairMotion:
    """What the prediction for one pair looks like, beside pre, post and frames (m, 159) of the truth."""
    pre, post, frames = true
    nan = float("nan")
    error = position_error(prediction.frames, frames, number_layout) if len(prediction.frames) and len(frames) else nan
    whole = utterance(*words, prediction)
    if whole is None or prediction.pre is None:
        return PairMotion(error, nan, nan, nan, nan)
    n = len(prediction.frames)
    true_whole = np.concatenate([words[0][pre : pre + 1], frames, words[1][post : post + 1]])
    first = min(prediction.pre + 1, CONTEXT)
    window = whole[prediction.pre + 1 - first : prediction.pre + 1 + n + CONTEXT]
    wrists = _places(window)[:, list(number_layout.wrists)] * number_layout.metres
    return PairMotion(
        position_error=error,
        path=_path(whole[prediction.pre : prediction.pre + n + 2], number_layout),
        true_path=_path(true_whole, number_layout),
        velocity_jump=metrics.velocity_jump(wrists, first, first + n, number_layout.fps),
        jerk_ratio=metrics.jerk_ratio(wrists, first, first + n),
    )


def position_error(predicted: Float, true: Float, number_layout: NumberLayout) -> float:
    """Mean distance of elbows, wrists and finger joints, seen from the hips, in thousandths of the arm's length.

    A prediction of another length is stretched evenly onto the true one, first frame on first, last on last.
    """
    there = _seen(stretched(predicted, len(true)), number_layout)[:, list(number_layout.arms)]
    return float(
        1000.0
        * np.linalg.norm(there - _seen(true, number_layout)[:, list(number_layout.arms)], axis=-1).mean()
        / number_layout.arm_length
    )


def stretched(frames: Float, count: int) -> Float:
    """Frames (n, K) brought to ``count`` by linear interpolation, ends on ends."""
    if len(frames) == count:
        return frames
    at = np.linspace(0.0, len(frames) - 1.0, count)
    low = np.floor(at).astype(int)
    high = np.minimum(low + 1, len(frames) - 1)
    share = (at - low)[:, None]
    return np.asarray((1.0 - share) * frames[low] + share * frames[high])


def summary(motions: Sequence[PairMotion]) -> dict[str, float]:
    """Mean position error, sum of paths over sum of true paths, median velocity jump and jerk ratio."""
    known = [m for m in motions if not np.isnan(m.path)]
    true_path = sum(m.true_path for m in known)
    return {
        "position_error": _over([m.position_error for m in motions], np.mean),
        "motion_ratio": sum(m.path for m in known) / true_path if true_path > 0.0 else float("nan"),
        "velocity_jump": _over([m.velocity_jump for m in known], np.median),
        "jerk_ratio": _over([m.jerk_ratio for m in known], np.median),
    }


def _over(values: Sequence[float], how: Callable[[list[float]], np.floating]) -> float:
    there = [value for value in values if not np.isnan(value)]
    return float(how(there)) if there else float("nan")


def _places(frames: Float) -> Float:
    return frames.reshape(len(frames), -1, 3)


def _seen(frames: Float, number_layout: NumberLayout) -> Float:
    places = _places(frames)
    return np.asarray(places - places[:, number_layout.hips, None])


def _path(frames: Float, number_layout: NumberLayout) -> float:
    return float(
        np.linalg.norm(np.diff(_seen(frames, number_layout)[:, list(number_layout.tips)], axis=0), axis=-1).sum()
    )
