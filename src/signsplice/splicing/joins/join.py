"""A planned seam as data, and what plans one: ``Join.plan`` of two words.

A planned seam is frozen. Planning gives it a cut and a gap; every pass gives another one (``passes``), with new frames
in the gap, and edits of the two words beside it. (``splicing.seam.Seam`` is its row in the public result.)
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

from signsplice.motion import Clip
from signsplice.splicing.gap import Cut, FilledGap, Gap, gap_at
from signsplice.splicing.words.word import Edit, SentenceWord, edited

SeamKind = Literal["signs", "letters", "slid letters", "reformed letters", "system"]
"""signs: two words of which at least one is no letter. letters: two of one spelled word that look different. slid,
reformed letters: two that look the same, told apart by a slide or by forming the second again. system: made by a system
that splices words whole."""
SIGNS: SeamKind = "signs"
LETTERS: SeamKind = "letters"
SLID: SeamKind = "slid letters"
REFORMED: SeamKind = "reformed letters"
SYSTEM: SeamKind = "system"


@dataclass(frozen=True, eq=False)
class PlannedSeam:
    """Two words of a sentence and what lies between them.

    kind: what joins them.
    before, after: the words; ``after.entry`` is where this seam enters it.
    cut: the last frame kept of the one, the first kept of the other, as recorded (``SentenceWord.clip``).
    gap: the new frames' number, with the retimed frames on either side.
    warnings: what a user should know, one line each.
    filled: the new frames; None before any were made, or where there are none.
    earlier: edits of ``before`` at the seam by which it is entered.
    leaving: edits of ``before`` at this seam.
    entering: edits of ``after`` at this seam.
    gap_edits: the edits that the gap shows.
    n_held: how many of the new frames are a pause, in which ``before`` is held; they come first.
    """

    kind: SeamKind
    before: SentenceWord
    after: SentenceWord
    cut: Cut
    gap: Gap
    warnings: tuple[str, ...] = ()
    filled: FilledGap | None = None
    earlier: tuple[Edit, ...] = ()
    leaving: tuple[Edit, ...] = ()
    entering: tuple[Edit, ...] = ()
    gap_edits: tuple[Edit, ...] = ()
    n_held: int = 0

    @cached_property
    def is_open(self) -> bool:
        """Whether a transition has to make its frames: there are some, and no system made them."""
        return self.gap.n_frames > 0 and self.kind != SYSTEM

    @property
    def made(self) -> FilledGap:
        """Its new frames. Raises ``ValueError`` where there are none."""
        if self.filled is None:
            raise ValueError(f"no frames between {self.before.clip.name} and {self.after.clip.name}")
        return self.filled

    @cached_property
    def retimed_cut(self) -> Cut:
        """The cut in frames of the retimed words."""
        return Cut(self.before.frames.last(self.cut.pre), self.after.frames.first(self.cut.post))

    @property
    def edits(self) -> tuple[Edit, ...]:
        """All edits of both words so far."""
        return (*self.earlier, *self.leaving, *self.entering)

    @cached_property
    def before_clip(self) -> Clip:
        """The retimed word before, with its edits so far."""
        return edited(self.before.retimed, (*self.earlier, *self.leaving))

    @cached_property
    def after_clip(self) -> Clip:
        """The retimed word after, with its edits so far."""
        return edited(self.after.retimed, self.entering)

    def with_gap(self, n_frames: int) -> PlannedSeam:
        """The seam with a gap of ``n_frames`` between the words as they are edited now; its frames are those that were
        there.
        """
        gap = gap_at(self.before_clip, self.after_clip, self.retimed_cut, n_frames, self.before.first_frame)
        return replace(self, gap=gap, gap_edits=self.edits)


def planned(
    kind: SeamKind,
    before: SentenceWord,
    after: SentenceWord,
    cut: Cut,
    n_frames: int,
    warnings: tuple[str, ...],
    arrival_s: float = 0.0,
    slide_m: float = 0.0,
) -> PlannedSeam:
    """The seam of two words at a cut of the recorded ones, its gap not filled yet; ``arrival_s`` and ``slide_m``: of
    the word after.
    """
    if cut.pre <= before.entry and before.entry > 0:
        frame = before.frames.n_left_out + before.entry
        line = f"{before.clip.name} is left at frame {frame}, where it was entered: only that frame is kept"
        warnings = (*warnings, line)
    after = replace(after, entry=cut.post, arrival_s=arrival_s, slide_m=slide_m)
    retimed = Cut(before.frames.last(cut.pre), after.first_frame)
    gap = gap_at(before.retimed, after.retimed, retimed, n_frames, before.first_frame)
    return PlannedSeam(kind, before, after, cut, gap, warnings)


class Join(ABC):
    """Plans the seam of two neighbouring words."""

    @abstractmethod
    def plan(self, before: SentenceWord, after: SentenceWord, chosen: Cut) -> PlannedSeam:
        """The seam of two words, before any frame is made; ``chosen``: the cutter's choice for them."""
