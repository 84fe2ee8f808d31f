"""How well transitions fill frames that were hidden from them, on any clips."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from signsplice.errors import InputError
from signsplice.motion import kinematics
from signsplice.motion.clip import Clip, concatenate
from signsplice.rig import metrics, proportions
from signsplice.rig.arms import has_arms
from signsplice.rig.roles import find_roles
from signsplice.splicing.collision_avoidance import depths
from signsplice.splicing.filling import fill
from signsplice.splicing.seam import DEEP_M
from signsplice.splicing.transition import Transition

CONTEXT = 8
"""Frames on either side that a transition is shown."""

LENGTHS = (5, 8, 12, 18, 24)
STRIDE = 6

SIGNATURE = f"hidden-frames|context:{CONTEXT}|stride:{STRIDE}|{metrics.POSITION_ERROR}"


@dataclass(frozen=True)
class HiddenFrames:
    """One transition on gaps of one length, means over ``n_gaps``; velocity jumps (m/s) are medians, ``true_`` of the
    real motion. deep: share of the gaps in which a hand lies deep in the body beyond what both ends call for, deepest:
    how deep, m; NaN where the rig's arms are not known. drawn: share of the gaps whose hidden frames turn evenly for
    the most part (``measures.evenly_turning``): nobody moved so, a program drew them between keys.
    """

    transition: str
    n_frames: int
    n_gaps: int
    position_error: float
    motion_ratio: float
    velocity_jump: float
    true_velocity_jump: float
    deep: float
    deepest: float
    drawn: float


def hidden_frames(
    clips: Sequence[Clip],
    transitions: Sequence[Transition],
    lengths: Sequence[int] = LENGTHS,
    stride: int = STRIDE,
    progress: Callable[[int, int], None] | None = None,
) -> list[HiddenFrames]:
    """Every transition on every gap of each length, a gap every ``stride`` frames of each clip, 8 frames shown on
    either side.

    A learned transition has body sense, as it has by default. Raises ``InputError`` where no clip is long enough for a
    length.
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
        drawn = float(np.mean([_drawn(window) for window in windows]))
        for transition in transitions:
            scores = [_score(window, transition, n_frames) for window in windows]
            error, ratio, _, _ = np.nanmean(scores, axis=0)
            jump, depth = np.median([score[2] for score in scores]), np.array([score[3] for score in scores])
            rows.append(
                HiddenFrames(
                    transition.name,
                    n_frames,
                    len(windows),
                    float(error),
                    float(ratio),
                    float(jump),
                    float(np.median(true_jumps)),
                    float(np.mean(depth > DEEP_M)) if np.isfinite(depth).all() else float("nan"),
                    float(depth.max()),
                    drawn,
                )
            )
            done += 1
            if progress is not None:
                progress(done, total)
    return rows


def table(rows: Sequence[HiddenFrames]) -> list[str]:
    """The rows as Markdown: a line for each transition, a column for each length, with signature and real motion."""
    lengths = sorted({row.n_frames for row in rows})
    found = {(row.transition, row.n_frames): row for row in rows}
    names = list(dict.fromkeys(row.transition for row in rows))
    lines: list[str] = [f"`{SIGNATURE}`"]
    for title, field, digits in (
        ("error, arm/1000", "position_error", 1),
        ("motion ratio", "motion_ratio", 2),
        ("velocity jump, m/s", "velocity_jump", 2),
        ("deepest in the body, mm", "deepest", 1),
    ):
        lines += ["", "| " + " | ".join([title, *map(str, lengths)]) + " |", "| --- |" + " --- |" * len(lengths)]
        for name in names:
            scale = 1e3 if field == "deepest" else 1.0
            values = [f"{scale * getattr(found[name, n], field):.{digits}f}" for n in lengths]
            lines.append("| " + " | ".join([name, *values]) + " |")
        if field == "velocity_jump":
            true = [f"{found[names[0], n].true_velocity_jump:.2f}" for n in lengths]
            lines.append("| " + " | ".join(["real motion", *true]) + " |")
    gaps = ", ".join(f"{found[names[0], n].n_gaps} of {n}" for n in lengths)
    lines += ["", f"Gaps: {gaps} frames."]
    drawn = [found[names[0], n].drawn for n in lengths]
    if max(drawn) > 0.0:
        told = ", ".join(f"{100.0 * share:.0f} % of {n}" for share, n in zip(drawn, lengths, strict=True))
        lines += ["", f"Drawn evenly between keys by a program, not captured, for the most part: {told} frames."]
    return lines


def _drawn(window: Clip) -> bool:
    """Whether most of the hidden frames turn evenly."""
    evenly = metrics.even_rotation_frames(window[CONTEXT - 1 : 1 - CONTEXT])
    return bool(np.nansum(evenly) > 0.5 * len(evenly))


def _score(window: Clip, transition: Transition, n_frames: int) -> tuple[float, float, float, float]:
    before, true, after = window[:CONTEXT], window[CONTEXT:-CONTEXT], window[-CONTEXT:]
    filled = fill(transition, [(before, after, n_frames)], None)[0].clip
    whole = concatenate([before, filled, after])
    # Motion is counted from the last frame before to the first after, so that a held pose counts its jumps too.
    ratio = metrics.motion_ratio(whole[CONTEXT - 1 : 1 - CONTEXT], window[CONTEXT - 1 : 1 - CONTEXT])
    depth = float(depths(filled, before, after).max()) if has_arms(window.skeleton) else float("nan")
    return metrics.position_error(filled, true), ratio, _jump(whole, n_frames), depth


def _jump(window: Clip, n_frames: int) -> float:
    joints = find_roles(window.skeleton).joints
    hands = [joints[role] for role in ("leftHand", "rightHand") if role in joints]
    _, positions = kinematics.forward(window, hands)
    metres = proportions.sizes(window.skeleton).unit.metres
    return metrics.velocity_jump(positions * metres, CONTEXT, CONTEXT + n_frames, window.fps)
