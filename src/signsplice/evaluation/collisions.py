"""How deep transitions lead hands into head, trunk or the other hand, over every pair of a corpus.

Every transition joins the pairs at their true positions, in their true time, with body sense and without; what both of
its ends call for (``splicing.body_sense``) is not counted.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signsplice.motion.clip import Clip
from signsplice.splicing.collision_avoidance import TOLERANCE_M, depths
from signsplice.splicing.filling import fill, n_shown_frames
from signsplice.splicing.seam import DEEP_M
from signsplice.splicing.transition import TRANSITIONS, Transition
from signsplice.synth.corpus import Pairs

Float = NDArray[np.float64]
Progress = Callable[[int, int], None]

SIGNATURE = f"intrusion|hands-in:head,trunk,hand|beyond-ends:{1e3 * TOLERANCE_M:g}mm|deep:{1e3 * DEEP_M:g}mm"


@dataclass(frozen=True)
class CollisionRow:
    """A transition on ``n_gaps`` gaps of ``n_frames`` frames in all: shares of gaps and frames that lie deep, and the
    deepest, m.
    """

    transition: str
    avoids_collisions: bool
    n_gaps: int
    n_frames: int
    deep_gaps: float
    deep_frames: float
    deepest: float


def compared_transitions(learned: Transition | None = None) -> list[tuple[Transition, bool]]:
    """The transitions that are compared, and whether with body sense."""
    out = [(transition, False) for transition in TRANSITIONS.values()] + [(TRANSITIONS["hermite"], True)]
    return out if learned is None else [*out, (learned, False), (learned, True)]


def compare(
    pairs: Pairs,
    numbers: Sequence[int],
    methods: Sequence[tuple[Transition, bool]],
    progress: Progress | None = None,
) -> list[CollisionRow]:
    """Every transition on the pairs of these numbers."""
    words = {int(p): pairs.word_clip(int(p)) for p in np.unique(pairs.index[list(numbers), :2])}
    found: list[list[Float]] = [[] for _ in methods]
    for done, number in enumerate(numbers, 1):
        gap = _gap(pairs, words, number)
        for row, (transition, body_sense) in zip(found, methods, strict=True):
            row.append(depths(fill(transition, [gap], body_sense)[0].clip, gap[0], gap[1]))
        if progress is not None:
            progress(done, len(numbers))
    return [_row(*method, row) for method, row in zip(methods, found, strict=True)]


def _gap(pairs: Pairs, words: Mapping[int, Clip], number: int) -> tuple[Clip, Clip, int]:
    p, q, pre, post, _, count = pairs.index[number].tolist()
    before, after = words[p], words[q]
    n_shown = n_shown_frames(before.fps)
    return before[max(0, pre + 1 - n_shown) : pre + 1], after[post : post + n_shown], count


def _row(transition: Transition, body_sense: bool, found: Sequence[Float]) -> CollisionRow:
    every = np.concatenate(found)
    return CollisionRow(
        transition=transition.name,
        avoids_collisions=body_sense,
        n_gaps=len(found),
        n_frames=len(every),
        deep_gaps=float(np.mean([depth.max() > DEEP_M for depth in found])),
        deep_frames=float(np.mean(every > DEEP_M)),
        deepest=float(every.max()),
    )


def table(rows: Sequence[CollisionRow]) -> list[str]:
    """The rows as Markdown, with their signature."""
    lines = [f"`{SIGNATURE}`", "", "| transition | body sense | transitions deep | frames deep | deepest, mm |"]
    lines.append("| --- | --- | --- | --- | --- |")
    for r in rows:
        cells = (f"{100 * r.deep_gaps:.1f} %", f"{100 * r.deep_frames:.1f} %", f"{1e3 * r.deepest:.1f}")
        lines.append("| " + " | ".join((r.transition, "yes" if r.avoids_collisions else "no", *cells)) + " |")
    return [*lines, "", f"{rows[0].n_gaps} transitions of {rows[0].n_frames} frames in all, each." if rows else ""]
