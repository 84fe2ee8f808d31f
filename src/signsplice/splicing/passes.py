"""Passes change planned seams. ``stages.passes`` lists those of a sentence in order.

A pass overrides ``change``, which takes and returns a seam. A pass that makes or changes new frames from gaps alone
sets ``batches`` and overrides ``change_all``: it receives the seams of many sentences at once, before any word is
edited, and its frames may be reused in other sentences (``bulk_splice.TransitionCache``). Other passes see one seam
after another, in the order of the sentence, and may edit its two words.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

from signsplice.splicing.collisions import avoid_all_collisions
from signsplice.splicing.contracts import Transition, fill_gaps, require_either
from signsplice.splicing.seam import LETTERS, REFORMED, SIGNS, SLID, Seam, SeamKind
from signsplice.splicing.word import Edit


class Pass:
    """Changes seams. A frozen dataclass: its class and fields determine its behaviour.

    batches: whether it makes new frames from gaps alone, for many sentences at once.
    kinds: the kinds of seams that it changes; by default all that a transition fills.
    follows_edits: whether it also changes seams of other kinds if this or an earlier pass edited their first word at
        the seam before.
    """

    batches: ClassVar[bool] = False
    kinds: ClassVar[frozenset[SeamKind]] = frozenset({SIGNS, LETTERS, SLID, REFORMED})
    follows_edits: ClassVar[bool] = False

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        require_either(cls, Pass, "change", "change_all")

    def change(self, seam: Seam) -> Seam:
        """Returns the seam with other frames, a longer gap, or edits of its words, or unchanged."""
        return self.change_all([seam])[0]

    def change_all(self, seams: Sequence[Seam]) -> list[Seam]:
        """Changes many seams."""
        return [self.change(seam) for seam in seams]

    def concerns(self, seam: Seam) -> bool:
        """Whether the pass changes seams like this one."""
        return (seam.kind in self.kinds or (self.follows_edits and bool(seam.earlier))) and seam.is_open


@dataclass(frozen=True)
class FillGaps(Pass):
    """The first pass: fills every gap by a transition."""

    transition: Transition
    batches: ClassVar[bool] = True

    def change_all(self, seams: Sequence[Seam]) -> list[Seam]:
        """Returns the seams with new frames. Raises as ``contracts.fill_gaps`` does."""
        clips = fill_gaps(self.transition, [seam.gap for seam in seams])
        return [
            replace(seam, frames=new, frame_warnings=self.transition.warnings(seam.gap), depth=None)
            for seam, new in zip(seams, clips, strict=True)
        ]


@dataclass(frozen=True)
class AvoidCollisions(Pass):
    """Leads hands around head, trunk and each other (``collisions``)."""

    batches: ClassVar[bool] = True

    def change_all(self, seams: Sequence[Seam]) -> list[Seam]:
        """Returns the seams with hands led around the body, and the remaining depth."""
        asked = [(seam.new_frames, seam.gap.before, seam.gap.after) for seam in seams]
        return [
            replace(seam, frames=cleared.clip, depth=cleared.depth)
            for seam, cleared in zip(seams, avoid_all_collisions(asked), strict=True)
        ]


@dataclass(frozen=True)
class Refill:
    """Remakes the frames of a seam after its gap has changed.

    transition: makes the frames.
    avoids: whether hands are led around the body in them.
    """

    transition: Transition
    avoids: bool

    def fill(self, seam: Seam) -> Seam:
        """Returns the seam with new frames in its gap."""
        seam = FillGaps(self.transition).change(seam)
        return AvoidCollisions().change(seam) if self.avoids else seam

    def again(self, seam: Seam, n_frames: int) -> Seam:
        """Returns the seam with ``n_frames`` new frames between its words as edited so far."""
        return self.fill(seam.with_gap(n_frames))

    def fresh(self, seam: Seam) -> Seam:
        """Returns the seam, with its frames remade if its words were edited since."""
        return seam if seam.gap_edits == seam.edits else self.again(seam, seam.gap.n_frames)


def check_order(passes: Sequence[Pass]) -> tuple[Pass, ...]:
    """Returns the passes. Raises ``ValueError`` if one that batches follows one that does not."""
    flags = [step.batches for step in passes]
    if flags != sorted(flags, reverse=True):
        raise ValueError("a pass that batches comes after one that does not, expected all of them before")
    return tuple(passes)


def fill(passes: Sequence[Pass], seams: Sequence[Seam]) -> list[Seam]:
    """Applies the passes that batch to the open seams, which get their frames."""
    done, rows = list(seams), [row for row, seam in enumerate(seams) if seam.is_open]
    filled = [done[row] for row in rows]
    for step in passes if rows else ():
        if step.batches:
            filled = step.change_all(filled)
    for row, seam in zip(rows, filled, strict=True):
        done[row] = seam
    return done


def signature(passes: Sequence[Pass], identity: Callable[[Transition], object]) -> tuple[tuple[object, ...], ...]:
    """Returns what determines new frames besides their gap, with each transition given by its ``identity``: in two
    lists of passes with the same signature, the passes that batch do the same.
    """
    return tuple(tuple(_pass_signature(step, identity)) for step in passes if step.batches)


def _pass_signature(part: Pass | Refill, identity: Callable[[Transition], object]) -> list[object]:
    described: list[object] = [f"{type(part).__module__}.{type(part).__qualname__}"]
    for value in vars(part).values():
        if isinstance(value, Refill):
            described += _pass_signature(value, identity)
        else:
            described.append(identity(value) if isinstance(value, Transition) else value)
    return described


Entering = tuple[tuple[Edit, ...], ...]
"""For each pass the edits that it and earlier passes made at the beginning of the last known word."""


def run(passes: Sequence[Pass], seams: Sequence[Seam], entering: Entering = ()) -> tuple[list[Seam], Entering]:
    """Applies all passes that do not batch to seams in order; returns the seams and the edits of the last word, which
    the next seam starts from.

    A pass sees every word with the edits of earlier passes, and its own at the seam before, never with those of a later
    pass: so the result is the same if a sentence comes a word at a time. ``entering``: edits of the first word.
    """
    chain = [step for step in passes if not step.batches]
    done, last_edits = list(seams), []
    for step, edits in zip(chain, entering or ((),) * len(chain), strict=True):
        for k, seam in enumerate(done):
            if seam.earlier != edits:
                seam = replace(seam, earlier=edits)
            done[k] = step.change(seam) if step.concerns(seam) else seam
            edits = done[k].entering
        last_edits.append(edits)
    return done, tuple(last_edits)
