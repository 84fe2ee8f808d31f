"""Gaps filled by a transition: its frames counted, and hands led around the body."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from signsplice.errors import InputError
from signsplice.splicing.gap import FilledGap, Gap
from signsplice.splicing.joins.join import PlannedSeam
from signsplice.splicing.methods.transition import Transition
from signsplice.splicing.passes.collision_avoidance import AvoidCollisions
from signsplice.splicing.passes.seam_pass import GapPass


@dataclass(frozen=True)
class FillGaps(GapPass):
    """The first pass: a transition makes the frames of every gap."""

    transition: Transition

    def change_all(self, gaps: Sequence[Gap], filled: Sequence[FilledGap]) -> list[FilledGap]:
        """New frames of every gap. Raises ``InputError`` where a transition does not make as many as a gap asks for."""
        transition = self.transition
        made = transition.fill(gaps)
        for new, gap in zip(made, gaps, strict=True):
            if len(new) != gap.n_frames:
                raise InputError(f"transition {transition.name} made {len(new)} frames, expected {gap.n_frames}")
        return [FilledGap(new, None, transition.warnings(gap)) for new, gap in zip(made, gaps, strict=True)]


def led_around(filled: FilledGap, gap: Gap) -> FilledGap:
    """The new frames of a gap with hands led around the body, and how deep a hand still is in it."""
    return AvoidCollisions().change_all([gap], [filled])[0]


def fill(transition: Transition, gaps: Sequence[Gap], avoids: bool | None) -> list[FilledGap]:
    """The frames that a transition makes for every gap, with hands led around the body where ``avoids`` is true;
    None: where the transition is learned.

    Raises ``InputError`` where a transition does not make as many frames as a gap asks for.
    """
    filled = FillGaps(transition).change_all(gaps, ())
    avoids = transition.learned if avoids is None else avoids
    return AvoidCollisions().change_all(gaps, filled) if avoids else filled


@dataclass(frozen=True)
class Refill:
    """Makes the frames of a planned seam anew, where its gap is another than before.

    transition, avoids: as in ``fill``.
    """

    transition: Transition
    avoids: bool

    def again(self, seam: PlannedSeam, n_frames: int) -> PlannedSeam:
        """The seam with ``n_frames`` new frames between its words as they are edited now."""
        seam = seam.with_gap(n_frames)
        return replace(seam, filled=fill(self.transition, [seam.gap], self.avoids)[0])

    def fresh(self, seam: PlannedSeam) -> PlannedSeam:
        """The seam itself, or, where its words were edited since its frames were made, with as many others."""
        return seam if seam.gap_edits == seam.edits else self.again(seam, seam.gap.n_frames)
