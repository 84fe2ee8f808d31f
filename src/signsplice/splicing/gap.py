"""A gap: the new frames between two clips, with the frames on either side that a transition is shown."""

from __future__ import annotations

import math
from dataclasses import dataclass

from signsplice.motion import Clip, concatenate

CONTEXT = 8
"""Frames of each sign that a seam's scores see, and the least that a transition is shown."""
_SHOWN_S = 7.0 / 30.0
"""Time of each sign that a transition is shown: eight frames at 30 a second span seven intervals."""


@dataclass(frozen=True)
class Cut:
    """A splice position, in frames of the two clips.

    pre: the last frame kept of the clip before.
    post: the first frame kept of the clip after.
    """

    pre: int
    post: int


@dataclass(frozen=True, eq=False)
class Gap:
    """``n_frames`` new frames between the last frame of ``before`` and the first frame of ``after``.

    before: the end of what is kept of the sign before, at least one frame.
    after: the beginning of what is kept of the sign after, on the same skeleton and at the same rate.
    n_frames: number of new frames; 0 where the signs follow one another directly.
    """

    before: Clip
    after: Clip
    n_frames: int

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


@dataclass(frozen=True, eq=False)
class FilledGap:
    """The new frames of a gap.

    clip: the new frames.
    depth: how deep a hand is in the body in them, m; None where that was not measured.
    warnings: what a user should know, one line each.
    peak_m_s: highest speed of a wrist in and beside them, m/s; None where that was not measured.
    """

    clip: Clip
    depth: float | None = None
    warnings: tuple[str, ...] = ()
    peak_m_s: float | None = None


def gap_at(before: Clip, after: Clip, cut: Cut, n_frames: int, entry: int = 0) -> Gap:
    """The gap of two clips that are joined at ``cut``; no frame of ``before`` earlier than ``entry`` is shown."""
    n_shown = max(CONTEXT, math.ceil(_SHOWN_S * before.fps - 1e-6) + 1)
    stop = cut.pre + 1
    return Gap(before[max(entry, stop - n_shown) : stop], after[cut.post : cut.post + n_shown], n_frames)
