"""What a cutter, a duration and a transition are given, and what they give: the parts of a splice that a user chooses.

    Cutter       where to leave the sign before and where to enter the sign after       clips -> Cut
    Duration     how long the frames between them take                                  clips, Cut -> seconds
    Transition   the frames between them                                                Gap -> Clip

All clips of a call are aligned: one skeleton, one placement, and one rate, save for a cutter with ``own_rate``.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar, TypeVar

from signsplice.errors import InputError
from signsplice.motion import Clip, concatenate
from signsplice.rig.keyedness import judge_keyedness

CONTEXT = 8
"""Frames of each sign that a seam's scores see, and the least that a transition is shown."""
_SHOWN_S = 7.0 / 30.0
"""Time of each sign that a transition is shown: eight frames at 30 a second span seven intervals."""
MethodT = TypeVar("MethodT")


class Method:
    """A part of splicing that a user can choose.

    name: what a user calls it by.
    summary: one line on how it works.
    learned: whether a network does the work.
    """

    name: str
    summary: str
    learned: bool = False


def find(kind: str, name: str, table: Mapping[str, MethodT]) -> MethodT:
    """The method of that name. Raises ``InputError`` with the kind and the existing names."""
    if name not in table:
        raise InputError(f"no {kind} {name!r}, expected one of {', '.join(table)}")
    return table[name]


def require_either(kind: type, base: type, *names: str) -> None:
    """Raise ``TypeError`` where a class derived from ``base`` writes none of these methods, which call one another."""
    if all(getattr(kind, name) is getattr(base, name) for name in names):
        raise TypeError(f"{kind.__name__} writes neither {' nor '.join(names)}, expected one of them")


@dataclass(frozen=True)
class Cut:
    """A splice position, in frames of the two clips.

    pre: the last frame kept of the clip before.
    post: the first frame kept of the clip after.
    """

    pre: int
    post: int


class Cutter(Method):
    """Chooses where clips of one skeleton and rate are joined. Write ``cut`` for a cutter of pairs, or ``cut_all`` for
    one that chooses all seams of a sentence together.

    own_rate: whether it is shown every clip at the rate and speed at which that was recorded, in place of the output's:
        a word is then cut at the same moment whatever the output is.
    """

    own_rate: ClassVar[bool] = False

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        require_either(cls, Cutter, "cut", "cut_all")

    def cut(self, before: Clip, after: Clip) -> Cut:
        """The splice position of two aligned clips."""
        return self.cut_all([before, after])[0]

    def cut_all(self, clips: Sequence[Clip]) -> list[Cut]:
        """The splice positions of aligned clips in order, one fewer than clips."""
        return [self.cut(before, after) for before, after in pairwise(clips)]


def cut_clips(cutter: Cutter, clips: Sequence[Clip]) -> list[Cut]:
    """A cutter's choice for aligned clips in order. Raises ``InputError`` for a wrong number of cuts, and for frames
    that the clips do not have.
    """
    cuts = cutter.cut_all(clips)
    if len(cuts) != len(clips) - 1:
        raise InputError(f"cutter {cutter.name} chose {len(cuts)} cuts for {len(clips)} clips")
    for cut, (before, after) in zip(cuts, pairwise(clips), strict=True):
        if not (0 <= cut.pre < len(before) and 0 <= cut.post < len(after)):
            raise InputError(f"cutter {cutter.name} chose {cut} for clips of {len(before)} and {len(after)} frames")
    return cuts


class Duration(Method, ABC):
    """Chooses how long the transition between two clips of one skeleton and rate takes."""

    @abstractmethod
    def seconds(self, before: Clip, after: Clip, cut: Cut) -> float:
        """Seconds that the new frames take: their number over the rate. Raises ``InputError`` where the rig's arms are
        not known by name.
        """


@dataclass(frozen=True, eq=False)
class Gap:
    """``n_frames`` new frames between the last frame of ``before`` and the first frame of ``after``.

    before: the end of what is kept of the sign before, at least one frame.
    after: the beginning of what is kept of the sign after, on the same skeleton and at the same rate.
    n_frames: number of new frames; 0 where the signs follow one another directly.
    keyed: whether either sign was drawn between keys (``rig.keyedness``); None: judged from what the gap shows.
    """

    before: Clip
    after: Clip
    n_frames: int
    keyed: bool | None = None

    @property
    def is_keyed(self) -> bool:
        """Whether either sign was drawn between keys."""
        return judge_keyedness(self.before, self.after).is_keyed if self.keyed is None else self.keyed

    @property
    def seconds(self) -> float:
        """From the last frame before to the first frame after."""
        return (self.n_frames + 1) / self.before.fps

    def window(self, new: Clip | None) -> tuple[Clip, int]:
        """The new frames (None: there are none) with ``CONTEXT`` frames on either side, and how many come before them:
        what a seam is scored on.
        """
        before = self.before[-CONTEXT:]
        parts = [before, self.after[:CONTEXT]] if new is None else [before, new, self.after[:CONTEXT]]
        return concatenate(parts), len(before)


def gap_at(before: Clip, after: Clip, cut: Cut, n_frames: int, entry: int = 0, keyed: bool | None = None) -> Gap:
    """The gap of two clips that are joined at ``cut``; no frame of ``before`` earlier than ``entry`` is shown.

    keyed: whether either was drawn between keys; None: judged from both whole clips.
    """
    if keyed is None:
        keyed = any(judge_keyedness(clip).is_keyed for clip in (before, after))
    n_shown = max(CONTEXT, math.ceil(_SHOWN_S * before.fps - 1e-6) + 1)
    stop = cut.pre + 1
    return Gap(before[max(entry, stop - n_shown) : stop], after[cut.post : cut.post + n_shown], n_frames, keyed)


class Transition(Method):
    """Makes the frames between clips of one skeleton and rate. It sees what a gap shows of both clips, nothing else.
    Write ``between``, or ``fill`` where many gaps are cheaper together.
    """

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        require_either(cls, Transition, "between", "fill")

    def between(self, gap: Gap) -> Clip:
        """The ``n_frames`` >= 1 new frames of one gap."""
        return self.fill([gap])[0]

    def fill(self, gaps: Sequence[Gap]) -> list[Clip]:
        """The new frames of every gap."""
        return [self.between(gap) for gap in gaps]

    @property
    def identity(self) -> str | None:
        """What decides its frames besides a gap: two transitions of one identity fill a gap alike. None, as by default:
        that is not known, and its frames are not kept for other sentences (``bulk_splice.TransitionCache``).
        """
        return None

    def warnings(self, gap: Gap) -> tuple[str, ...]:
        """What a user should know about how a gap is filled; nothing by default."""
        return ()


def fill_gaps(transition: Transition, gaps: Sequence[Gap]) -> list[Clip]:
    """The new frames of every gap. Raises ``InputError`` where a transition does not make as many as a gap asks for."""
    made = transition.fill(gaps)
    for new, gap in zip(made, gaps, strict=True):
        if len(new) != gap.n_frames:
            raise InputError(f"transition {transition.name} made {len(new)} frames, expected {gap.n_frames}")
    return made
