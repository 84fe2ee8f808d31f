"""Scores how well transitions fill frames that were hidden from them, on any clips."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass

import numpy as np

from signsplice.errors import InputError
from signsplice.motion import Clip, FloatArray, concatenate
from signsplice.rig import metrics
from signsplice.rig.info import rig_info
from signsplice.rig.keyedness import judge_keyedness
from signsplice.splicing.collisions import depths
from signsplice.splicing.contracts import Gap, Transition
from signsplice.splicing.seam import DEEP_M
from signsplice_workshop.measure import motion_scores
from signsplice_workshop.measure.collisions import fill
from signsplice_workshop.measure.hands import wrist_positions
from signsplice_workshop.measure.measures import Measure, Progress, Row, format_table, make_row

SHOWN = 8
"""Number of frames shown to a transition on either side of the gap."""

LENGTHS = (5, 8, 12, 18, 24)
"""Numbers of hidden frames per gap."""

STRIDE = 6
"""Number of frames from the start of one gap to the start of the next."""

SIGNATURE = f"hidden-frames|context:{SHOWN}|stride:{STRIDE}|{motion_scores.POSITION_ERROR}|{motion_scores.GROUP_ERRORS}"


@dataclass(frozen=True, eq=False)
class _ScoredGaps:
    """Gaps of one length, filled by one transition.

    scores: (n_gaps, 7), from ``_score``.
    true_jump: median velocity jump of the real motion, m/s.
    keyed: fraction of the gaps that lie in clips drawn between keys (``rig.keyedness``).
    """

    scores: FloatArray
    true_jump: float
    keyed: float


def _mean_of(column: int) -> Callable[[_ScoredGaps], float]:
    """Returns a function that gives the mean of a score over the gaps that have it; NaN if none has."""

    def mean(scored: _ScoredGaps) -> float:
        known = scored.scores[~np.isnan(scored.scores[:, column]), column]
        return float(known.mean()) if len(known) else float("nan")

    return mean


def _fraction_deep(scored: _ScoredGaps) -> float:
    depth = scored.scores[:, 6]
    return float(np.mean(depth > DEEP_M)) if np.isfinite(depth).all() else float("nan")


MEASURES = (
    Measure("transition"),
    Measure("n_frames"),
    Measure("n_gaps", function=lambda scored: len(scored.scores)),
    Measure("position_error", "error, arm/1000", "{:.1f}", None, _mean_of(0)),
    Measure("hand_error", "error of the hands", "{:.1f}", None, _mean_of(1)),
    Measure("finger_error", "error of the fingers", "{:.2f}", None, _mean_of(2)),
    Measure("trunk_error", "error of trunk and head", "{:.1f}", None, _mean_of(3)),
    Measure("motion_ratio", "motion ratio", "{:.2f}", None, _mean_of(4)),
    Measure(
        "velocity_jump", "velocity jump, m/s", "{:.2f}", None, lambda scored: float(np.median(scored.scores[:, 5]))
    ),
    Measure("true_velocity_jump", function=lambda scored: scored.true_jump),
    Measure("deep", function=_fraction_deep),
    Measure("deepest", "deepest in the body, mm", "{:.1f}", 1e3, lambda scored: float(scored.scores[:, 6].max())),
    Measure("drawn", function=lambda scored: scored.keyed),
)
"""Measures of a transition on gaps of ``n_frames``: mean errors (``rig.metrics``), path of the fingertips over that of
the real motion, median velocity jump at the ends; fraction of the gaps in which a hand lies more than ``DEEP_M`` in
the body, not counting depth at the two ends, and the greatest depth, m, NaN if the rig's arms are not known.
"""


def score_hidden_frames(
    clips: Sequence[Clip],
    transitions: Sequence[Transition],
    lengths: Sequence[int] = LENGTHS,
    stride: int = STRIDE,
    progress: Progress | None = None,
) -> list[Row]:
    """Returns one row for each length and transition, over a gap every ``stride`` frames of each clip.

    Each transition sees ``SHOWN`` frames on either side. Collision avoidance is at its default: on for learned
    transitions. Raises ``InputError`` if no clip is long enough for a length.
    """
    rows: list[Row] = []
    total = len(lengths) * len(transitions)
    for n_frames in lengths:
        windows = [
            (clip[start : start + n_frames + 2 * SHOWN], judge_keyedness(clip).is_keyed)
            for clip in clips
            for start in range(0, len(clip) - n_frames - 2 * SHOWN + 1, stride)
        ]
        if not windows:
            raise InputError(
                f"no clip has {n_frames + 2 * SHOWN} frames, as a gap of {n_frames} frames with {SHOWN} frames of "
                "context on either side needs; give longer clips"
            )
        true_jump = float(np.median([_gap_velocity_jump(window, n_frames) for window, _ in windows]))
        keyframed = float(np.mean([keyed for _, keyed in windows]))
        for transition in transitions:
            scores = np.array([_score(*window, transition, n_frames) for window in windows])  # (n_gaps, 7)
            scored = _ScoredGaps(scores, true_jump, keyframed)
            rows.append(make_row(MEASURES, scored, transition=transition.name, n_frames=n_frames))
            if progress is not None:
                progress(len(rows), total)
    return rows


def table(rows: Sequence[Row], clips: Sequence[Clip] = ()) -> list[str]:
    """Returns the rows as Markdown with their signature: a table for each score, a column for each length. First it
    names the measured ``clips`` that were drawn between keys.
    """
    lengths = sorted({row.n_frames for row in rows})
    row_by_key = {(row.transition, row.n_frames): row for row in rows}
    names = list(dict.fromkeys(row.transition for row in rows))
    length_rows = [row_by_key[names[0], n] for n in lengths]
    lines: list[str] = [f"`{SIGNATURE}`"]
    keyed = [clip for clip in clips if judge_keyedness(clip).is_keyed]
    lines += [f"\n{clip.name} is no measure of real motion ({motion_scores.format_keyedness(clip)})." for clip in keyed]
    for measure in (measure for measure in MEASURES if measure.head):
        cells = [[name, *(measure.cell(row_by_key[name, n]) for n in lengths)] for name in names]
        if measure.name == "velocity_jump":
            cells.append(["real motion", *(f"{row.true_velocity_jump:.2f}" for row in length_rows)])
        lines += ["", *format_table((measure.head, *lengths), cells)]
    gaps = ", ".join(f"{row.n_gaps} of {row.n_frames}" for row in length_rows)
    lines += ["", f"Gaps: {gaps} frames."]
    if any(row.drawn > 0.0 for row in length_rows):
        fractions = ", ".join(f"{100.0 * row.drawn:.0f} % of {row.n_frames}" for row in length_rows)
        lines += ["", f"Gaps in clips that a program drew between keys, not captured: {fractions} frames."]
    return lines


def _score(window: Clip, keyed: bool, transition: Transition, n_frames: int) -> tuple[float, ...]:
    """Returns position error, errors of hands, fingers and trunk, motion ratio, velocity jump (m/s) and depth (m) of a
    transition on one gap. ``keyed``: whether the whole clip is keyed.
    """
    before, true, after = window[:SHOWN], window[SHOWN:-SHOWN], window[-SHOWN:]
    filled = fill(transition, [Gap(before, after, n_frames, keyed)], None)[0]
    joined = concatenate([before, filled, after])
    # Motion is counted from the last frame before to the first after, so that a held pose counts its jumps too.
    ratio = motion_scores.motion_ratio(joined[SHOWN - 1 : 1 - SHOWN], window[SHOWN - 1 : 1 - SHOWN])
    depth = float(depths(filled, before, after).max()) if rig_info(window.skeleton).has_arms else float("nan")
    groups = astuple(motion_scores.group_errors(filled, true))
    return motion_scores.position_error(filled, true), *groups, ratio, _gap_velocity_jump(joined, n_frames), depth


def _gap_velocity_jump(window: Clip, n_frames: int) -> float:
    """Returns the largest change of wrist velocity at the ends of the gap, m/s."""
    return metrics.velocity_jump(wrist_positions(window), SHOWN, SHOWN + n_frames, window.fps)
