"""Inputs and outputs of cutters, durations and transitions: the parts of a splice that a user chooses.

    Cutter       where to leave the sign before and where to enter the sign after       clips -> Cut
    Duration     how long the frames between them take                                  clips, Cut -> seconds
    Transition   the frames between them                                                Gap -> Clip

All clips of a call are aligned to one skeleton, placement and rate; a cutter with ``own_rate`` sees their own rates.
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
"""Frames of each sign that a seam's scores use, and the least that a transition sees of a sign that has so many."""
_SHOWN_S = 7.0 / 30.0
"""Time of each sign that a transition sees, s: eight frames at 30 a second span seven intervals."""
MethodT = TypeVar("MethodT")


class Method:
    """A part of splicing that a user can choose.

    name: its name in options.
    summary: one line on how it works.
    learned: whether it uses a network.
    """

    name: str
    summary: str
    learned: bool = False


def find(kind: str, name: str, table: Mapping[str, MethodT]) -> MethodT:
    """Returns the method of that name. Raises ``InputError`` with the kind and the existing names."""
    if name not in table:
        raise InputError(f"no {kind} {name!r}, expected one of {', '.join(table)}")
    return table[name]


def require_either(kind: type, base: type, *names: str) -> None:
    """Raises ``TypeError`` if a subclass of ``base`` overrides none of these methods, which call one another."""
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
    """Chooses the cuts of clips of one skeleton and rate. Override ``cut`` to cut pairs, or ``cut_all`` to choose
    all seams of a sentence together.

    own_rate: whether it sees every clip at its recorded rate and speed instead of the output's: a word is then cut at
        the same moment whatever the output is.
    """

    own_rate: ClassVar[bool] = False

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        require_either(cls, Cutter, "cut", "cut_all")

    def cut(self, before: Clip, after: Clip) -> Cut:
        """Returns the splice position of two aligned clips."""
        return self.cut_all([before, after])[0]

    def cut_all(self, clips: Sequence[Clip]) -> list[Cut]:
        """Returns the splice positions of aligned clips in order, one fewer than clips."""
        return [self.cut(before, after) for before, after in pairwise(clips)]


def cut_clips(cutter: Cutter, clips: Sequence[Clip]) -> list[Cut]:
    """Returns a cutter's choice for aligned clips in order. Raises ``InputError`` if the number of cuts is wrong or a
    cut lies outside its clips.
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
        """Returns the time that the new frames take, s: their number over the rate. Raises ``InputError`` if the rig's
        arms are not known by name.
        """


@dataclass(frozen=True, eq=False)
class Gap:
    """``n_frames`` new frames between the last frame of ``before`` and the first frame of ``after``.

    before: the last kept frames of the sign before, at least one.
    after: the first kept frames of the sign after, on the same skeleton and at the same rate.
    n_frames: number of new frames; 0 if the signs follow one another directly.
    keyed: whether either sign was drawn between keys (``rig.keyedness``); None: judged from the gap's frames.
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
        """Time from the last frame before to the first frame after, s."""
        return (self.n_frames + 1) / self.before.fps

    def window(self, new: Clip | None) -> tuple[Clip, int]:
        """Returns the frames on which a seam is scored, and how many of them come before the new ones: ``new`` (None if
        there are none) with up to ``CONTEXT`` frames on either side.
        """
        before = self.before[-CONTEXT:]
        parts = [before, self.after[:CONTEXT]] if new is None else [before, new, self.after[:CONTEXT]]
        return concatenate(parts), len(before)


def gap_at(before: Clip, after: Clip, cut: Cut, n_frames: int, entry: int = 0, keyed: bool | None = None) -> Gap:
    """Returns the gap of two clips joined at ``cut``; it shows no frame of ``before`` earlier than ``entry``.

    keyed: whether either was drawn between keys; None: judged from both whole clips.
    """
    if keyed is None:
        keyed = any(judge_keyedness(clip).is_keyed for clip in (before, after))
    n_shown = max(CONTEXT, math.ceil(_SHOWN_S * before.fps - 1e-6) + 1)
    stop = cut.pre + 1
    return Gap(before[max(entry, stop - n_shown) : stop], after[cut.post : cut.post + n_shown], n_frames, keyed)


class Transition(Method):
    """Makes the frames between clips of one skeleton and rate. It sees only the gap's frames of both clips. Override
    ``between``, or ``fill`` if many gaps are cheaper together.
    """

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        require_either(cls, Transition, "between", "fill")

    def between(self, gap: Gap) -> Clip:
        """Returns the ``n_frames`` >= 1 new frames of one gap."""
        return self.fill([gap])[0]

    def fill(self, gaps: Sequence[Gap]) -> list[Clip]:
        """Returns the new frames of every gap."""
        return [self.between(gap) for gap in gaps]

    @property
    def identity(self) -> str | None:
        """Text that identifies how gaps are filled: two transitions with the same text fill a gap alike. None, the
        default: its frames are not kept for other sentences (``bulk_splice.TransitionCache``).
        """
        return None

    def warnings(self, gap: Gap) -> tuple[str, ...]:
        """Returns warnings about how a gap is filled; none by default."""
        return ()


def fill_gaps(transition: Transition, gaps: Sequence[Gap]) -> list[Clip]:
    """Returns the new frames of every gap. Raises ``InputError`` if a transition makes another number of frames."""
    clips = transition.fill(gaps)
    for new, gap in zip(clips, gaps, strict=True):
        if len(new) != gap.n_frames:
            raise InputError(f"transition {transition.name} made {len(new)} frames, expected {gap.n_frames}")
    return clips
