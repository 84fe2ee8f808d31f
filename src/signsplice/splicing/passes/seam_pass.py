"""What a pass is: a change of planned seams. ``splicing.stages`` lists the passes of a sentence in order.

A ``GapPass`` sees gaps alone, those of many sentences at once: its frames may be kept and used for other sentences
(``transition_cache``). A ``SeamPass`` sees one planned seam, with the two words beside it, which it may edit.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

from signsplice.splicing.gap import FilledGap, Gap
from signsplice.splicing.joins.join import LETTERS, REFORMED, SIGNS, SLID, PlannedSeam, SeamKind
from signsplice.splicing.methods.transition import Transition
from signsplice.splicing.words.word import Edit


class GapPass(ABC):
    """Makes or changes the new frames of gaps. A frozen dataclass: its class and its fields decide what it does."""

    @abstractmethod
    def change_all(self, gaps: Sequence[Gap], filled: Sequence[FilledGap]) -> list[FilledGap]:
        """The new frames of every gap, from those that the passes before made; the first pass is given none."""


@dataclass(frozen=True)
class GapPasses:
    """The gap passes of a sentence in order; the first makes the frames."""

    passes: tuple[GapPass, ...]

    def fill(self, gaps: Sequence[Gap]) -> list[FilledGap]:
        """The new frames of every gap."""
        filled: list[FilledGap] = []
        for one in self.passes if gaps else ():
            filled = one.change_all(gaps, filled)
        return filled

    def signature(self, identity: Callable[[Transition], object]) -> tuple[tuple[object, ...], ...]:
        """What decides the frames besides the gaps, with each transition by an identity of it: two lists of passes with
        one signature do the same.
        """
        return tuple(
            (
                f"{type(one).__module__}.{type(one).__qualname__}",
                *(identity(value) if isinstance(value, Transition) else value for value in vars(one).values()),
            )
            for one in self.passes
        )


class SeamPass(ABC):
    """Changes planned seams one after another, in the order of the sentence.

    kinds: the kinds of seams that it is shown; all that a transition fills by default.
    follows_edits: whether it is shown other seams too where this or an earlier pass edited their first word at the
        seam before.
    """

    kinds: ClassVar[frozenset[SeamKind]] = frozenset({SIGNS, LETTERS, SLID, REFORMED})
    follows_edits: ClassVar[bool] = False

    @abstractmethod
    def change(self, seam: PlannedSeam) -> PlannedSeam:
        """The seam with other frames, a longer gap, or edits of its words; the seam itself where nothing is to do. Its
        ``filled`` is never None.
        """

    def concerns(self, seam: PlannedSeam) -> bool:
        """Whether the pass is shown a seam."""
        return seam.is_open and (seam.kind in self.kinds or (self.follows_edits and bool(seam.earlier)))


Pass = GapPass | SeamPass


def split(passes: Sequence[Pass]) -> tuple[GapPasses, tuple[SeamPass, ...]]:
    """The gap passes and the seam passes of a list. Raises ``ValueError`` where a gap pass comes after a seam pass."""
    n_gap = sum(isinstance(one, GapPass) for one in passes)
    gap = tuple(one for one in passes[:n_gap] if isinstance(one, GapPass))
    seam = tuple(one for one in passes[n_gap:] if isinstance(one, SeamPass))
    if len(gap) + len(seam) != len(passes):
        raise ValueError("a pass of gaps comes after one of seams, expected all of them before")
    return GapPasses(gap), seam


Entering = tuple[tuple[Edit, ...], ...]
"""For each pass the edits that it and those before it made at the beginning of the last word, as far as the sentence is
known."""


def run(
    passes: Sequence[SeamPass], seams: Sequence[PlannedSeam], entering: Entering = ()
) -> tuple[list[PlannedSeam], Entering]:
    """Seams in order after all passes, and the edits of the last word, with which the seam after them begins.

    A pass sees every word as the passes before it, and it itself at the seam before, have edited it, never as a later
    pass has: so it makes the same of a sentence that comes a word at a time. ``entering``: of the words before.
    """
    done, left = list(seams), []
    for one, edits in zip(passes, entering or ((),) * len(passes), strict=True):
        for k, seam in enumerate(done):
            if seam.earlier != edits:
                seam = replace(seam, earlier=edits)
            done[k] = one.change(seam) if one.concerns(seam) else seam
            edits = done[k].entering
        left.append(edits)
    return done, tuple(left)
