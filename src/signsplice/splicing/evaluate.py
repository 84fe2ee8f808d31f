"""How well transitions fill frames that were hidden from them, on any clips."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from signsplice.errors import InputError
from signsplice.motion import kinematics, measures, stance
from signsplice.motion.clip import Clip, concatenate
from signsplice.motion.humanoid import find_roles
from signsplice.splicing.transition import Transition

CONTEXT = 8
"""Frames on either side that a transition is shown."""

LENGTHS = (5, 8, 12, 18, 24)
STRIDE = 6

SIGNATURE = f"hidden-frames|context:{CONTEXT}|stride:{STRIDE}|{measures.POSITION_ERROR}"


@dataclass(frozen=True)
class HiddenFrames:
    """One transition on gaps of one length, means over ``n_gaps``; velocity jumps (m/s) are medians, ``true_`` of the
    real motion.
    """

    transition: str
    n_frames: int
    n_gaps: int
    position_error: float
    motion_ratio: float
    velocity_jump: float
    true_velocity_jump: float


def hidden_frames(
    clips: Sequence[Clip],
    transitions: Sequence[Transition],
    lengths: Sequence[int] = LENGTHS,
    stride: int = STRIDE,
    progress: Callable[[int, int], None] | None = None,
) -> list[HiddenFrames]:
    """Every transition on every gap of each length, a gap every ``stride`` frames of each clip, 8 frames shown on
    either side.

    Raises ``InputError`` where no clip is long enough for a length.
    """
    rows: list[HiddenFrames] = []
    total, done = len(lengths) * len(transitions), 0
    for n_frames in lengths:
        windows = [
            clip[start : start + n_frames + 2 * CONTEXT]
            for clip in clips
            for start in range(0, len(clip) - n_frames - 2 * CONTEXT + 1, stride)
        ]
        if not windows:
            raise InputError(
                f"no clip has {n_frames + 2 * CONTEXT} frames, as a gap of {n_frames} with its context needs"
            )
        true_jumps = [_jump(window, n_frames) for window in windows]
        for transition in transitions:
            scores = [_score(window, transition, n_frames) for window in windows]
            error, ratio, _ = np.nanmean(scores, axis=0)
            jump = np.median([score[2] for score in scores])
            rows.append(
                HiddenFrames(
                    transition.name,
                    n_frames,
                    len(windows),
                    float(error),
                    float(ratio),
                    float(jump),
                    float(np.median(true_jumps)),
                )
            )
            done += 1
            if progress is not None:
                progress(done, total)
    return rows


def _score(window: Clip, transition: Transition, n_frames: int) -> tuple[float, float, float]:
    before, true, after = window[:CONTEXT], window[CONTEXT:-CONTEXT], window[-CONTEXT:]
    filled = transition.between(before, after, n_frames)
    whole = concatenate([before, filled, after])
    # Motion is counted from the last frame before to the first after, so that a held pose counts its jumps too.
    ratio = measures.motion_ratio(whole[CONTEXT - 1 : 1 - CONTEXT], window[CONTEXT - 1 : 1 - CONTEXT])
    return measures.position_error(filled, true), ratio, _jump(whole, n_frames)


def _jump(window: Clip, n_frames: int) -> float:
    joints = find_roles(window.skeleton).joints
    hands = [joints[role] for role in ("leftHand", "rightHand") if role in joints]
    _, positions = kinematics.forward(window, hands)
    metres = stance.sizes(window.skeleton).unit.metres
    return measures.velocity_jump(positions * metres, CONTEXT, CONTEXT + n_frames, window.fps)
