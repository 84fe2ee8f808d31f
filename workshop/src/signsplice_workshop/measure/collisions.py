"""Measures how deep transitions lead a hand into head, trunk or the other hand, over the pairs of a corpus.

Each transition joins each pair at its true cut with its true number of frames, with and without collision avoidance.
Depth that the two ends of a gap already have does not count (``splicing.collisions.depths``).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from signsplice.body.collision import pose_capsules
from signsplice.motion import Clip, FloatArray, Skeleton
from signsplice.splicing.collisions import TOLERANCE_M, avoid_all_collisions, depths
from signsplice.splicing.contracts import Cut, Gap, Transition, fill_gaps, gap_at
from signsplice.splicing.curves import TRANSITIONS
from signsplice.splicing.seam import DEEP_M
from signsplice_workshop.corpora.pairs import Pairs
from signsplice_workshop.measure.measures import (
    Measure,
    Progress,
    Row,
    format_measures,
    make_row,
    percent,
    track_progress,
)

SIGNATURE = f"intrusion|hands-in:head,trunk,hand|beyond-ends:{1e3 * TOLERANCE_M:g}mm|deep:{1e3 * DEEP_M:g}mm"


MEASURES = (
    Measure("transition", "transition"),
    Measure("body_sense", "collision avoidance"),
    Measure("n_gaps", function=len),
    Measure("n_frames", function=lambda gaps: len(np.concatenate(gaps))),
    percent("deep_gaps", "transitions deep", 1, lambda gaps: float(np.mean([gap.max() > DEEP_M for gap in gaps]))),
    percent("deep_frames", "frames deep", 1, lambda gaps: float(np.mean(np.concatenate(gaps) > DEEP_M))),
    Measure("deepest", "deepest, mm", "{:.1f}", 1e3, lambda gaps: float(np.concatenate(gaps).max())),
)
"""Measures of a transition, from depths (n_frames,) in every gap, m: whether it avoids collisions, number of gaps and
of new frames; fraction of the gaps with a deep frame, and fraction of deep frames (a hand lies more than ``DEEP_M``
in the body); greatest depth, m.
"""


def transitions_to_compare(learned: Transition | None = None) -> list[tuple[Transition, bool]]:
    """Returns the transitions to compare, each with whether it avoids collisions."""
    transitions: list[tuple[Transition, bool]] = [
        *((transition, False) for transition in TRANSITIONS.values()),
        (TRANSITIONS["hermite"], True),
    ]
    return transitions if learned is None else [*transitions, (learned, False), (learned, True)]


def compare(
    pairs: Pairs,
    numbers: Sequence[int],
    methods: Sequence[tuple[Transition, bool]],
    progress: Progress | None = None,
) -> list[Row]:
    """Returns one row for each method, measured on the pairs of these numbers."""
    clips = {int(p): pairs.word_clip(int(p)) for p in np.unique(pairs.index[list(numbers), :2])}
    method_depths: list[list[FloatArray]] = [[] for _ in methods]  # depths (n_frames,) of every gap, for each method
    for number in track_progress(numbers, progress):
        p, q, pre, post, _, count = pairs.index[number].tolist()
        gap = gap_at(clips[p], clips[q], Cut(pre, post), count)
        for gap_depths, (transition, avoid) in zip(method_depths, methods, strict=True):
            gap_depths.append(depths(fill(transition, [gap], avoid)[0], gap.before, gap.after))
    return [
        make_row(MEASURES, gaps, transition=transition.name, body_sense=avoid)
        for (transition, avoid), gaps in zip(methods, method_depths, strict=True)
    ]


def table(rows: Sequence[Row]) -> list[str]:
    """Returns the rows as Markdown, with their signature."""
    caption = f"{rows[0].n_gaps} transitions of {rows[0].n_frames} frames in all, each." if rows else ""
    return [f"`{SIGNATURE}`", "", *format_measures(MEASURES, rows), "", caption]


def fill(transition: Transition, gaps: Sequence[Gap], avoids: bool | None = None) -> list[Clip]:
    """Returns the frames that a transition makes for every gap, with hands led around the body if ``avoids`` is true;
    None avoids collisions if the transition is learned. Raises the errors of ``contracts.fill_gaps``.
    """
    new_frames = fill_gaps(transition, gaps)
    if not (transition.learned if avoids is None else avoids):
        return new_frames
    filled_gaps = [(frames, gap.before, gap.after) for frames, gap in zip(new_frames, gaps, strict=True)]
    return [cleared.clip for cleared in avoid_all_collisions(filled_gaps)]


def hand_penetration(
    skeleton: Skeleton, global_rotations: FloatArray, global_positions: FloatArray, forearms: bool = False
) -> tuple[FloatArray, FloatArray]:
    """Returns the depth (T, 2) of the left and the right hand in head, neck, trunk, the other arm or its hand, clip
    units (negative: the distance), and the exit direction (T, 2, 3) in the world. ``forearms``: takes the depth of a
    forearm in the other arm too, if that is deeper.

    ``global_rotations``, ``global_positions``: of all joints, from ``kinematics.forward``. Two hands that meet are
    separated as wholes rather than skin from skin, since single fingers would push in all directions.
    """
    posed = pose_capsules(skeleton, global_rotations, global_positions)
    return posed.near_pairs(1e9, forearms=forearms).penetration()
