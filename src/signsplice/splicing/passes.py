"""Passes: what changes seams once they are planned. ``stages.passes`` lists those of a sentence in order.

A pass writes ``change``: a seam in, a seam out. One that makes or changes new frames from gaps alone says so by
``batches`` and writes ``change_all``: it is given the seams of many sentences at once, before any word is edited, and
its frames may be used for other sentences (``bulk_splice.TransitionCache``). The others see one seam after another, in
the order of the sentence, and may edit the two words beside it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

from signsplice.motion import Clip, concatenate
from signsplice.rig import metrics
from signsplice.rig.info import arms, rig_info
from signsplice.splicing.collisions import avoid_all_collisions
from signsplice.splicing.contracts import Gap, Transition, fill_gaps, require_either
from signsplice.splicing.durations import FAST_M_S, most_frames
from signsplice.splicing.seam import LETTERS, REFORMED, SIGNS, SLID, Seam, SeamKind
from signsplice.splicing.word import Edit

_LONGER = (1.25, 1.5, 2.0)
"""Lengths that are tried for a transition, over the first one."""


class Pass:
    """Changes seams. A frozen dataclass: its class and its fields decide what it does.

    batches: whether it makes new frames from gaps alone, those of many sentences at once.
    kinds: the kinds of seams that it is shown; all that a transition fills by default.
    follows_edits: whether it is shown other seams too where this or an earlier pass edited their first word at the
        seam before.
    """

    batches: ClassVar[bool] = False
    kinds: ClassVar[frozenset[SeamKind]] = frozenset({SIGNS, LETTERS, SLID, REFORMED})
    follows_edits: ClassVar[bool] = False

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        require_either(cls, Pass, "change", "change_all")

    def change(self, seam: Seam) -> Seam:
        """The seam with other frames, a longer gap, or edits of its words; the seam itself where nothing is to do."""
        return self.change_all([seam])[0]

    def change_all(self, seams: Sequence[Seam]) -> list[Seam]:
        """The same for many seams."""
        return [self.change(seam) for seam in seams]

    def concerns(self, seam: Seam) -> bool:
        """Whether the pass is shown a seam."""
        return (seam.kind in self.kinds or (self.follows_edits and bool(seam.earlier))) and seam.is_open


@dataclass(frozen=True)
class FillGaps(Pass):
    """The first pass: a transition makes the frames of every gap."""

    transition: Transition
    batches: ClassVar[bool] = True

    def change_all(self, seams: Sequence[Seam]) -> list[Seam]:
        """The seams with new frames. Raises as ``contracts.fill_gaps`` does."""
        made = fill_gaps(self.transition, [seam.gap for seam in seams])
        return [
            replace(seam, frames=new, frame_warnings=self.transition.warnings(seam.gap), depth=None, peak_m_s=None)
            for seam, new in zip(seams, made, strict=True)
        ]


@dataclass(frozen=True)
class AvoidCollisions(Pass):
    """Hands are led around head, trunk and each other (``collisions``)."""

    batches: ClassVar[bool] = True

    def change_all(self, seams: Sequence[Seam]) -> list[Seam]:
        """The seams with hands led around the body, and how deep a hand still is in it."""
        asked = [(seam.new_frames, seam.gap.before, seam.gap.after) for seam in seams]
        return [
            replace(seam, frames=cleared.clip, depth=cleared.depth, peak_m_s=None)
            for seam, cleared in zip(seams, avoid_all_collisions(asked), strict=True)
        ]


@dataclass(frozen=True)
class Refill:
    """Makes the frames of a seam anew, where its gap is another than before.

    transition: makes them.
    avoids: whether hands are led around the body in them.
    """

    transition: Transition
    avoids: bool

    def fill(self, seam: Seam) -> Seam:
        """The seam with new frames in its gap."""
        seam = FillGaps(self.transition).change(seam)
        return AvoidCollisions().change(seam) if self.avoids else seam

    def again(self, seam: Seam, n_frames: int) -> Seam:
        """The seam with ``n_frames`` new frames between its words as they are edited now."""
        return self.fill(seam.with_gap(n_frames))

    def fresh(self, seam: Seam) -> Seam:
        """The seam itself, or, where its words were edited since its frames were made, with as many others."""
        return seam if seam.gap_edits == seam.edits else self.again(seam, seam.gap.n_frames)


@dataclass(frozen=True)
class LengthenGaps(Pass):
    """At a tempo: gaps in which a wrist would pass ``FAST_M_S`` get up to twice as many frames, so that no hand is
    faster between two signs than signs are.
    """

    refill: Refill
    batches: ClassVar[bool] = True

    def change(self, seam: Seam) -> Seam:
        """The seam with more new frames where a hand would be faster than signs are."""
        planned = seam.gap
        for factor in _LONGER:
            n_frames = min(math.ceil(factor * planned.n_frames), most_frames(planned.before.fps))
            if n_frames <= seam.gap.n_frames or not _is_too_fast(planned, seam.new_frames):
                break
            seam = self.refill.fill(replace(seam, gap=replace(planned, n_frames=n_frames)))
        return seam


def _is_too_fast(gap: Gap, new: Clip) -> bool:
    """Whether a wrist passes ``FAST_M_S`` in the new frames of a gap."""
    info = rig_info(new.skeleton)
    if not info.has_arms:
        return False
    window = concatenate([gap.before[-1:], new, gap.after[:1]])
    wrists = arms(window).wrists * info.sizes.unit.metres
    return metrics.peak_speed(wrists, 1, len(window) - 1, window.fps) > FAST_M_S


def check_order(passes: Sequence[Pass]) -> tuple[Pass, ...]:
    """The passes. Raises ``ValueError`` where one that batches comes after one that does not."""
    flags = [one.batches for one in passes]
    if flags != sorted(flags, reverse=True):
        raise ValueError("a pass that batches comes after one that does not, expected all of them before")
    return tuple(passes)


def fill(passes: Sequence[Pass], seams: Sequence[Seam]) -> list[Seam]:
    """The seams after the passes that batch, which make the frames of those that are open."""
    done, rows = list(seams), [row for row, seam in enumerate(seams) if seam.is_open]
    made = [done[row] for row in rows]
    for one in passes if rows else ():
        if one.batches:
            made = one.change_all(made)
    for row, seam in zip(rows, made, strict=True):
        done[row] = seam
    return done


def signature(passes: Sequence[Pass], identity: Callable[[Transition], object]) -> tuple[tuple[object, ...], ...]:
    """What decides new frames besides their gap, with each transition by an ``identity`` of it: of two lists of passes
    with one signature, those that batch do the same.
    """
    return tuple(tuple(_pass_signature(one, identity)) for one in passes if one.batches)


def _pass_signature(part: Pass | Refill, identity: Callable[[Transition], object]) -> list[object]:
    described: list[object] = [f"{type(part).__module__}.{type(part).__qualname__}"]
    for value in vars(part).values():
        if isinstance(value, Refill):
            described += _pass_signature(value, identity)
        else:
            described.append(identity(value) if isinstance(value, Transition) else value)
    return described


Entering = tuple[tuple[Edit, ...], ...]
"""For each pass the edits that it and those before it made at the beginning of the last word, as far as the sentence is
known."""


def run(passes: Sequence[Pass], seams: Sequence[Seam], entering: Entering = ()) -> tuple[list[Seam], Entering]:
    """Seams in order after all passes that do not batch, and the edits of the last word, with which the seam after them
    begins.

    A pass sees every word as the passes before it, and it itself at the seam before, have edited it, never as a later
    pass has: so it makes the same of a sentence that comes a word at a time. ``entering``: of the words before.
    """
    chain = [one for one in passes if not one.batches]
    done, left = list(seams), []
    for one, edits in zip(chain, entering or ((),) * len(chain), strict=True):
        for k, seam in enumerate(done):
            if seam.earlier != edits:
                seam = replace(seam, earlier=edits)
            done[k] = one.change(seam) if one.concerns(seam) else seam
            edits = done[k].entering
        left.append(edits)
    return done, tuple(left)
