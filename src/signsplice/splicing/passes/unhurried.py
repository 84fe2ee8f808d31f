"""Longer gaps at a tempo: no hand is faster between two signs than signs are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from signsplice.motion import Clip, concatenate
from signsplice.rig import metrics
from signsplice.rig.info import arms, rig_info
from signsplice.splicing.gap import FilledGap, Gap
from signsplice.splicing.methods.duration import most_frames
from signsplice.splicing.methods.transition import Transition
from signsplice.splicing.passes.filling import fill
from signsplice.splicing.passes.seam_pass import GapPass
from signsplice.splicing.tempo import FAST_M_S

_LONGER = (1.25, 1.5, 2.0)
"""Lengths that are tried for a transition, over the first one."""


@dataclass(frozen=True)
class LengthenGaps(GapPass):
    """Gaps in which a wrist would pass ``FAST_M_S`` get up to twice as many frames.

    transition, avoids: as in ``filling.fill``.
    """

    transition: Transition
    avoids: bool

    def change_all(self, gaps: Sequence[Gap], filled: Sequence[FilledGap]) -> list[FilledGap]:
        """The frames of every gap, more where a hand would be faster than signs are."""
        return [self._unhurried(gap, made) for gap, made in zip(gaps, filled, strict=True)]

    def _unhurried(self, gap: Gap, made: FilledGap) -> FilledGap:
        for factor in _LONGER:
            n_frames = min(math.ceil(factor * gap.n_frames), most_frames(gap.before.fps))
            if n_frames <= len(made.clip) or not _is_too_fast(gap, made.clip):
                break
            (made,) = fill(self.transition, [replace(gap, n_frames=n_frames)], self.avoids)
        return made


def _is_too_fast(gap: Gap, new: Clip) -> bool:
    """Whether a wrist passes ``FAST_M_S`` in the new frames of a gap."""
    info = rig_info(new.skeleton)
    if not info.has_arms:
        return False
    window = concatenate([gap.before[-1:], new, gap.after[:1]])
    wrists = arms(window).wrists * info.sizes.unit.metres
    return metrics.peak_speed(wrists, 1, len(window) - 1, window.fps) > FAST_M_S
