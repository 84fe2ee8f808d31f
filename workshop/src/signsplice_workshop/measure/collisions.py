"""How deep transitions lead a hand into head, trunk or the other hand, over the pairs of a corpus.

Each transition joins each pair at its true cut with its true number of frames, with and without collision avoidance.
Depth that the two ends of a gap already have does not count (``passes.collision_avoidance.depths``).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from signsplice.motion.arrays import FloatArray
from signsplice.splicing.gap import Cut, gap_at
from signsplice.splicing.methods.transition import TRANSITIONS, Transition
from signsplice.splicing.passes.collision_avoidance import TOLERANCE_M, depths
from signsplice.splicing.passes.filling import fill
from signsplice.splicing.seam import DEEP_M
from signsplice_workshop.corpora.pairs import Pairs
from signsplice_workshop.measure.measures import Progress, counted, markdown_columns, percent

SIGNATURE = f"intrusion|hands-in:head,trunk,hand|beyond-ends:{1e3 * TOLERANCE_M:g}mm|deep:{1e3 * DEEP_M:g}mm"


@dataclass(frozen=True)
class CollisionRow:
    """One transition over all gaps; deep is a hand more than ``DEEP_M`` in the body.

    transition: its name.
    avoids_collisions: whether collision avoidance was on.
    n_gaps: gaps filled.
    n_frames: new frames in all gaps together.
    deep_gaps: fraction of the gaps that have a deep frame.
    deep_frames: fraction of the new frames that are deep.
    deepest: greatest depth, m.
    """

    transition: str
    avoids_collisions: bool
    n_gaps: int
    n_frames: int
    deep_gaps: float
    deep_frames: float
    deepest: float


def compared_transitions(learned: Transition | None = None) -> list[tuple[Transition, bool]]:
    """Transitions to compare, each with whether it avoids collisions."""
    out: list[tuple[Transition, bool]] = [*((t, False) for t in TRANSITIONS.values()), (TRANSITIONS["hermite"], True)]
    return out if learned is None else [*out, (learned, False), (learned, True)]


def compare(
    pairs: Pairs,
    numbers: Sequence[int],
    methods: Sequence[tuple[Transition, bool]],
    progress: Progress | None = None,
) -> list[CollisionRow]:
    """One row for each method, measured on the pairs of these numbers."""
    clips = {int(p): pairs.word_clip(int(p)) for p in np.unique(pairs.index[list(numbers), :2])}
    found: list[list[FloatArray]] = [[] for _ in methods]  # depths (n_frames,) of every gap, for each method
    for number in counted(numbers, progress):
        p, q, pre, post, _, count = pairs.index[number].tolist()
        gap = gap_at(clips[p], clips[q], Cut(pre, post), count)
        for row, (transition, avoid) in zip(found, methods, strict=True):
            row.append(depths(fill(transition, [gap], avoid)[0].clip, gap.before, gap.after))
    return [_row(*method, row) for method, row in zip(methods, found, strict=True)]


def _row(transition: Transition, avoid: bool, found: Sequence[FloatArray]) -> CollisionRow:
    every = np.concatenate(found)
    return CollisionRow(
        transition=transition.name,
        avoids_collisions=avoid,
        n_gaps=len(found),
        n_frames=len(every),
        deep_gaps=float(np.mean([depth.max() > DEEP_M for depth in found])),
        deep_frames=float(np.mean(every > DEEP_M)),
        deepest=float(every.max()),
    )


_COLUMNS: dict[str, Callable[[CollisionRow], str]] = {
    "transition": lambda row: row.transition,
    "collision avoidance": lambda row: "yes" if row.avoids_collisions else "no",
    "transitions deep": lambda row: percent(row.deep_gaps, ".1f"),
    "frames deep": lambda row: percent(row.deep_frames, ".1f"),
    "deepest, mm": lambda row: f"{1e3 * row.deepest:.1f}",
}


def table(rows: Sequence[CollisionRow]) -> list[str]:
    """The rows as Markdown, with their signature."""
    counted = f"{rows[0].n_gaps} transitions of {rows[0].n_frames} frames in all, each." if rows else ""
    return [f"`{SIGNATURE}`", "", *markdown_columns(_COLUMNS, rows), "", counted]
