"""How well transitions fill frames that were hidden from them, on any clips."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass

import numpy as np

from signsplice.errors import InputError
from signsplice.motion.clip import Clip, concatenate
from signsplice.rig import metrics
from signsplice.rig.info import rig_info
from signsplice.splicing.gap import Gap
from signsplice.splicing.methods.transition import Transition
from signsplice.splicing.passes.collision_avoidance import depths
from signsplice.splicing.passes.filling import fill
from signsplice.splicing.seam import DEEP_M
from signsplice_workshop.measure.hands import wrist_positions
from signsplice_workshop.measure.measures import Progress, markdown

SHOWN = 8
"""Frames shown to a transition on either side of the gap."""

LENGTHS = (5, 8, 12, 18, 24)
"""Hidden frames per gap."""

STRIDE = 6
"""Frames from the start of one gap to the start of the next."""

SIGNATURE = f"hidden-frames|context:{SHOWN}|stride:{STRIDE}|{metrics.POSITION_ERROR}|{metrics.GROUP_ERRORS}"


@dataclass(frozen=True)
class HiddenFrames:
    """One transition on gaps of one length: means over the gaps, but for the two velocity jumps (medians).

    transition: its name.
    n_frames: hidden frames per gap.
    n_gaps: gaps filled.
    position_error: mean joint position error, arm length / 1000 (``rig.metrics.position_error``).
    hand_error, finger_error, trunk_error: the same by group of joints (``rig.metrics.GroupErrors``).
    motion_ratio: path of the fingertips over that of the real motion.
    velocity_jump: largest change of wrist velocity at the ends of the gap, m/s.
    true_velocity_jump: the same in the real motion, m/s.
    deep: fraction of the gaps in which a hand lies more than ``DEEP_M`` in the body, depth at the two ends not counted;
        NaN where the rig's arms are not known.
    deepest: greatest such depth, m; NaN where the rig's arms are not known.
    keyframed: fraction of the gaps whose frames, with those shown, were interpolated between keys by a program, not
        captured (``metrics.is_keyed``).
    """

    transition: str
    n_frames: int
    n_gaps: int
    position_error: float
    hand_error: float
    finger_error: float
    trunk_error: float
    motion_ratio: float
    velocity_jump: float
    true_velocity_jump: float
    deep: float
    deepest: float
    keyframed: float


def hidden_frames(
    clips: Sequence[Clip],
    transitions: Sequence[Transition],
    lengths: Sequence[int] = LENGTHS,
    stride: int = STRIDE,
    progress: Progress | None = None,
) -> list[HiddenFrames]:
    """One row for each length and transition, over a gap every ``stride`` frames of each clip.

    Each transition sees ``SHOWN`` frames on either side. Collision avoidance is at its default: on for learned
    transitions. Raises ``InputError`` where no clip is long enough for a length.
    """
    rows: list[HiddenFrames] = []
    total = len(lengths) * len(transitions)
    for n_frames in lengths:
        windows = [
            clip[start : start + n_frames + 2 * SHOWN]
            for clip in clips
            for start in range(0, len(clip) - n_frames - 2 * SHOWN + 1, stride)
        ]
        if not windows:
            raise InputError(
                f"no clip has {n_frames + 2 * SHOWN} frames, as a gap of {n_frames} frames with {SHOWN} frames of "
                "context on either side needs; give longer clips"
            )
        true_jump = float(np.median([_velocity_jump(window, n_frames) for window in windows]))
        keyframed = float(np.mean([metrics.is_keyed(window) for window in windows]))
        for transition in transitions:
            scores = np.array([_score(window, transition, n_frames) for window in windows])  # (n_gaps, 7)
            known = [column[~np.isnan(column)] for column in scores[:, :5].T]  # of the gaps that have a score
            error, hands, fingers, trunk, ratio = (float(one.mean()) if len(one) else float("nan") for one in known)
            jumps, depth = scores[:, 5:].T
            rows.append(
                HiddenFrames(
                    transition=transition.name,
                    n_frames=n_frames,
                    n_gaps=len(windows),
                    position_error=error,
                    hand_error=hands,
                    finger_error=fingers,
                    trunk_error=trunk,
                    motion_ratio=ratio,
                    velocity_jump=float(np.median(jumps)),
                    true_velocity_jump=true_jump,
                    deep=float(np.mean(depth > DEEP_M)) if np.isfinite(depth).all() else float("nan"),
                    deepest=float(depth.max()),
                    keyframed=keyframed,
                )
            )
            if progress is not None:
                progress(len(rows), total)
    return rows


def table(rows: Sequence[HiddenFrames], clips: Sequence[Clip] = ()) -> list[str]:
    """The rows as Markdown with their signature: a table for each score, a column for each length. Of the ``clips``
    that were measured, those drawn between keys are named first.
    """
    lengths = sorted({row.n_frames for row in rows})
    found = {(row.transition, row.n_frames): row for row in rows}
    names = list(dict.fromkeys(row.transition for row in rows))
    of_length = [found[names[0], n] for n in lengths]
    lines: list[str] = [f"`{SIGNATURE}`"]
    keyed = [clip for clip in clips if metrics.is_keyed(clip)]
    lines += [f"\n{clip.name} is no measure of real motion ({metrics.keyed_mark(clip)})." for clip in keyed]
    for title, field, digits in (
        ("error, arm/1000", "position_error", 1),
        ("error of the hands", "hand_error", 1),
        ("error of the fingers", "finger_error", 2),
        ("error of trunk and head", "trunk_error", 1),
        ("motion ratio", "motion_ratio", 2),
        ("velocity jump, m/s", "velocity_jump", 2),
        ("deepest in the body, mm", "deepest", 1),
    ):
        scale = 1e3 if field == "deepest" else 1.0
        cells = [[name, *(f"{scale * getattr(found[name, n], field):.{digits}f}" for n in lengths)] for name in names]
        if field == "velocity_jump":
            cells.append(["real motion", *(f"{row.true_velocity_jump:.2f}" for row in of_length)])
        lines += ["", *markdown((title, *lengths), cells)]
    gaps = ", ".join(f"{row.n_gaps} of {row.n_frames}" for row in of_length)
    lines += ["", f"Gaps: {gaps} frames."]
    if any(row.keyframed > 0.0 for row in of_length):
        fractions = ", ".join(f"{100.0 * row.keyframed:.0f} % of {row.n_frames}" for row in of_length)
        lines += ["", f"Gaps that a program mostly interpolated between keys, not captured: {fractions} frames."]
    return lines


def _score(window: Clip, transition: Transition, n_frames: int) -> tuple[float, ...]:
    """Position error, those of hands, fingers and trunk, motion ratio, velocity jump (m/s) and depth (m) of a
    transition on one gap.
    """
    before, true, after = window[:SHOWN], window[SHOWN:-SHOWN], window[-SHOWN:]
    filled = fill(transition, [Gap(before, after, n_frames)], None)[0].clip
    whole = concatenate([before, filled, after])
    # Motion is counted from the last frame before to the first after, so that a held pose counts its jumps too.
    ratio = metrics.motion_ratio(whole[SHOWN - 1 : 1 - SHOWN], window[SHOWN - 1 : 1 - SHOWN])
    depth = float(depths(filled, before, after).max()) if rig_info(window.skeleton).has_arms else float("nan")
    groups = astuple(metrics.group_errors(filled, true))
    return metrics.position_error(filled, true), *groups, ratio, _velocity_jump(whole, n_frames), depth


def _velocity_jump(window: Clip, n_frames: int) -> float:
    """Largest change of wrist velocity at the ends of the gap, m/s."""
    return metrics.velocity_jump(wrist_positions(window), SHOWN, SHOWN + n_frames, window.fps)
