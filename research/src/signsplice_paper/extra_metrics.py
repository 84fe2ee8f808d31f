"""Metrics beyond the paper's: joint distance in units of the body, amount of motion, and smoothness at the seams.

All are computed from the numbers, scaled back to metres. Positions are relative to the hips but not rotated with
them, because the numbers hold no rotation of the hips.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from signsplice.errors import InputError
from signsplice.motion import Clip, FloatArray
from signsplice.rig import metrics
from signsplice.rig.info import rig_info
from signsplice.splicing.contracts import CONTEXT
from signsplice_paper.prediction import Prediction
from signsplice_workshop.corpora.number_space import NumberSpace
from signsplice_workshop.measure import motion_scores

REQUIRED = ("hips", "leftHand", "rightHand")
"""Roles of the joints that every measurement needs."""
FRAMES = 8
"""Frames of a transition, from its first on, that have an error of their own."""
FIRST = 2
"""Frames that the paper calls the first ones (its figure 6)."""

SIGNATURES = {
    "position_error": "position-error|joints:arms+fingers|frame:hips-place|unit:arm/1000|other-lengths:stretched|mean",
    "frame_error": f"frame-error|joints:arms+fingers|frame:hips-place|unit:cm|by:index,1..{FRAMES}|mean:frames",
    "first_frames_error": f"frame-error|joints:arms+fingers|frame:hips-place|unit:cm|by:index,1..{FIRST}|mean:frames",
    "later_frames_error": f"frame-error|joints:arms+fingers|frame:hips-place|unit:cm|by:index,{FIRST}+1..|mean:frames",
    "velocity_error": "velocity-error|joints:arms+fingers|frame:hips-place|unit:m/s|other-lengths:stretched|mean",
    "motion_ratio": "motion-ratio|joints:fingertips|frame:hips-place|path:P_pre,O,Q_post|sum/sum|of:predicted",
    "velocity_jump": f"{motion_scores.VELOCITY_JUMP}|over:Y|median:pairs|of:predicted",
    "jerk_ratio": f"{motion_scores.JERK_RATIO}|over:Y|context:{CONTEXT}|median:pairs|of:predicted",
}


@dataclass(frozen=True, eq=False)
class NumberLayout:
    """How to read the numbers of a signer. Joints are counted in the order of the numbers.

    - hips: joint
    - arms: joints of arms and fingers
    - tips: joints of fingertips, or the wrists if the numbers hold no fingers
    - wrists: joints of both wrists
    - arm_length: in the numbers' unit, the side of the cube
    - metres: metres per unit
    - fps: frames per second
    """

    hips: int
    arms: tuple[int, ...]
    tips: tuple[int, ...]
    wrists: tuple[int, ...]
    arm_length: float
    metres: float
    fps: float


@dataclass(frozen=True)
class PairMotion:
    """The extra metrics of one pair; NaN if positions or frames are missing.

    - position_error: mean joint distance, thousandths of the arm's length
    - frame_errors: mean joint distance of the first, second, ... frame, cm, while both transitions last
    - velocity_error: mean difference of the joints' velocities, m/s
    - path: path length of the predicted fingertips, in the numbers' unit
    - true_path: path length of the true fingertips, in the numbers' unit
    - velocity_jump: largest jump of wrist velocity at the seams, m/s
    - jerk_ratio: jerk in the transition over jerk in the signs around it
    """

    position_error: float
    frame_errors: tuple[float, ...]
    velocity_error: float
    path: float
    true_path: float
    velocity_jump: float
    jerk_ratio: float


def make_number_layout(clip: Clip, space: NumberSpace) -> NumberLayout:
    """Returns how to read a signer's numbers; ``clip`` is any word of the signer.

    Raises ``InputError`` if hips or wrists are not known by name, or are not among the numbers.
    """
    order = {joint: k for k, joint in enumerate(space.find_joints(clip.skeleton, clip.name))}
    roles = rig_info(clip.skeleton).roles.joints
    missing = [role for role in REQUIRED if roles.get(role) not in order]
    if missing:
        raise InputError(f"{clip.name}: {', '.join(missing)} not among the joints of the numbers; name them")
    wrists = (order[roles["leftHand"]], order[roles["rightHand"]])
    arms, tips = (
        tuple(order[joint] for joint in joints if joint in order)
        for joints in (motion_scores.arm_and_finger_joints(clip), motion_scores.fingertip_joints(clip))
    )
    return NumberLayout(
        hips=order[roles["hips"]],
        arms=arms,
        tips=tips or wrists,
        wrists=wrists,
        arm_length=rig_info(clip.skeleton).sizes.arm_length / space.side,
        metres=space.side / 100.0,
        fps=clip.fps,
    )


def join_utterance(before: FloatArray, after: FloatArray, prediction: Prediction) -> FloatArray | None:
    """Returns Y (T, K) = [P_1 .. P_pre, O, Q_post .. Q_M] of the filter layer (eq. 17); None without a position."""
    if prediction.pre is None or prediction.post is None:
        return None
    return np.concatenate([before[: prediction.pre + 1], prediction.frames, after[prediction.post :]])


def measure_pair_motion(
    prediction: Prediction,
    true: tuple[int, int, FloatArray],
    words: tuple[FloatArray, FloatArray],
    layout: NumberLayout,
) -> PairMotion:
    """Returns the extra metrics of one pair.

    true: pre, post and frames (m, K). words: frames (N, K) and (M, K) of both words.
    """
    pre, post, frames = true
    nan = float("nan")
    errors = _measure_errors(prediction.frames, frames, layout)
    predicted_utterance = join_utterance(*words, prediction)
    if predicted_utterance is None or prediction.pre is None:
        return PairMotion(*errors, nan, nan, nan, nan)
    n = len(prediction.frames)
    true_window = np.concatenate([words[0][pre : pre + 1], frames, words[1][post : post + 1]])
    first = min(prediction.pre + 1, CONTEXT)
    window = predicted_utterance[prediction.pre + 1 - first : prediction.pre + 1 + n + CONTEXT]
    wrists = _split_joints(window)[:, list(layout.wrists)] * layout.metres  # (T, 2, 3)
    return PairMotion(
        *errors,
        path=_measure_path(predicted_utterance[prediction.pre : prediction.pre + n + 2], layout),
        true_path=_measure_path(true_window, layout),
        velocity_jump=metrics.velocity_jump(wrists, first, first + n, layout.fps),
        jerk_ratio=metrics.jerk_ratio(wrists, first, first + n),
    )


def _measure_errors(
    predicted: FloatArray, true: FloatArray, layout: NumberLayout
) -> tuple[float, tuple[float, ...], float]:
    """Returns position error, the errors of each frame, and velocity error; NaN and no errors without frames."""
    if not len(predicted) or not len(true):
        return float("nan"), (), float("nan")
    by_frame = measure_frame_errors(predicted, true, layout)
    return measure_position_error(predicted, true, layout), by_frame, measure_velocity_error(predicted, true, layout)


def measure_velocity_error(predicted: FloatArray, true: FloatArray, layout: NumberLayout) -> float:
    """Returns the mean difference, m/s, of the velocities of elbows, wrists and finger joints relative to the hips; a
    prediction of another length is resampled as in ``measure_position_error``. NaN for a single frame.
    """
    if len(true) < 2:
        return float("nan")
    arms = list(layout.arms)
    predicted_velocities, true_velocities = (
        np.diff(_subtract_hips(frames, layout)[:, arms], axis=0)
        for frames in (resample_frames(predicted, len(true)), true)
    )
    return float(np.linalg.norm(predicted_velocities - true_velocities, axis=-1).mean() * layout.metres * layout.fps)


def measure_position_error(predicted: FloatArray, true: FloatArray, layout: NumberLayout) -> float:
    """Returns the mean distance of elbows, wrists and finger joints relative to the hips, in thousandths of the arm's
    length.

    A prediction of another length is resampled evenly to the true length, first frame on first, last on last.
    """
    return float(
        1000.0 * _measure_arm_distances(resample_frames(predicted, len(true)), true, layout).mean() / layout.arm_length
    )


def measure_frame_errors(predicted: FloatArray, true: FloatArray, layout: NumberLayout) -> tuple[float, ...]:
    """Returns the mean distance, cm, of elbows, wrists and finger joints relative to the hips, between the n-th
    predicted and the n-th true frame, up to the end of the shorter transition.
    """
    n = min(len(predicted), len(true))
    return tuple((100.0 * layout.metres * _measure_arm_distances(predicted[:n], true[:n], layout)).tolist())


def _measure_arm_distances(predicted: FloatArray, true: FloatArray, layout: NumberLayout) -> FloatArray:
    """Returns the mean distance (n,) of elbows, wrists and finger joints in each of n frames, in the numbers' unit."""
    arms = list(layout.arms)
    difference = _subtract_hips(predicted, layout)[:, arms] - _subtract_hips(true, layout)[:, arms]  # (n, J, 3)
    return np.asarray(np.linalg.norm(difference, axis=-1).mean(axis=-1))


def resample_frames(frames: FloatArray, count: int) -> FloatArray:
    """Returns frames (n, K) resampled to (count, K) by linear interpolation, first frame on first, last on last."""
    if len(frames) == count:
        return frames
    indices = np.linspace(0.0, len(frames) - 1.0, count)
    low = np.floor(indices).astype(int)
    high = np.minimum(low + 1, len(frames) - 1)
    alpha = (indices - low)[:, None]
    return np.asarray((1.0 - alpha) * frames[low] + alpha * frames[high])


def summarise(motions: Sequence[PairMotion]) -> dict[str, float]:
    """Returns the scores of a test set by name: mean errors of positions, of the n-th frame (frame_error-n), of the
    first ``FIRST`` and of all later frames, and of velocities; sum of paths over sum of true paths; medians of velocity
    jump and jerk ratio.
    """
    known = [m for m in motions if not np.isnan(m.path)]
    true_path = sum(m.true_path for m in known)
    by_frame = {n: [m.frame_errors[n] for m in motions if n < len(m.frame_errors)] for n in range(FRAMES)}
    return {
        "position_error": _aggregate_known([m.position_error for m in motions], np.mean),
        "first_frames_error": _aggregate_known([e for m in motions for e in m.frame_errors[:FIRST]], np.mean),
        "later_frames_error": _aggregate_known([e for m in motions for e in m.frame_errors[FIRST:]], np.mean),
        **{f"frame_error-{n + 1}": _aggregate_known(errors, np.mean) for n, errors in by_frame.items()},
        "velocity_error": _aggregate_known([m.velocity_error for m in motions], np.mean),
        "motion_ratio": sum(m.path for m in known) / true_path if true_path > 0.0 else float("nan"),
        "velocity_jump": _aggregate_known([m.velocity_jump for m in known], np.median),
        "jerk_ratio": _aggregate_known([m.jerk_ratio for m in known], np.median),
    }


def _aggregate_known(values: Sequence[float], aggregate: Callable[[list[float]], np.floating]) -> float:
    known = [value for value in values if not np.isnan(value)]
    return float(aggregate(known)) if known else float("nan")


def _split_joints(frames: FloatArray) -> FloatArray:
    """Returns the joint positions (T, J, 3) of frames (T, 3 J)."""
    return frames.reshape(len(frames), -1, 3)


def _subtract_hips(frames: FloatArray, layout: NumberLayout) -> FloatArray:
    """Returns the joint positions (T, J, 3) relative to the hips."""
    positions = _split_joints(frames)
    return np.asarray(positions - positions[:, layout.hips, None])


def _measure_path(frames: FloatArray, layout: NumberLayout) -> float:
    tips = _subtract_hips(frames, layout)[:, list(layout.tips)]
    return float(np.linalg.norm(np.diff(tips, axis=0), axis=-1).sum())
