"""The join of two words by a system that splices them whole (``whole_system``)."""

from __future__ import annotations

from dataclasses import dataclass, replace

from signsplice.errors import SignspliceError
from signsplice.splicing.gap import Cut, FilledGap, gap_at
from signsplice.splicing.joins.join import SYSTEM, Join, PlannedSeam
from signsplice.splicing.whole_system import SystemSplice, WholeSystem
from signsplice.splicing.words.word import SentenceWord


class NoSpliceError(SignspliceError):
    """A system has no splice of two words; the message says why."""


@dataclass(frozen=True)
class SystemJoin(Join):
    """Plans seams as a system makes them: it chooses the cut, and makes the frames with it."""

    system: WholeSystem

    def plan(self, before: SentenceWord, after: SentenceWord, chosen: Cut | None = None) -> PlannedSeam:
        """The seam of two words, with its frames, whatever a cutter has ``chosen``. Raises ``NoSpliceError`` where the
        system has none.
        """
        found = self.system.splice_words(before.clip, after.clip)
        reason = failure_reason(self.system, found, before)
        if found.pre is None or found.post is None or reason:
            raise NoSpliceError(reason)
        cut, frames = Cut(found.pre, found.post), found.frames
        gap = gap_at(before.clip, after.clip, cut, 0 if frames is None else len(frames), before.entry)
        filled = None if frames is None else FilledGap(frames)
        return PlannedSeam(SYSTEM, before, replace(after, entry=cut.post), cut, gap, found.warnings, filled)


def failure_reason(system: WholeSystem, found: SystemSplice, before: SentenceWord) -> str:
    """Why there is no splice of two words, ``before`` the first; empty where there is one."""
    if found.pre is None or found.post is None:
        lacks = {(True, True): "neither position", (True, False): "no prePosition", (False, True): "no postPosition"}
        return f"{system.name} finds {lacks[found.pre is None, found.post is None]}"
    if found.pre < before.entry:
        n_left_out = before.frames.n_left_out
        left, entered = found.pre + n_left_out, before.entry + n_left_out
        return f"{system.name} leaves the first word at frame {left}, before its entry at frame {entered}"
    return ""
