"""Stretches of one clip made anew from what surrounds them."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

from signsplice.errors import InputError
from signsplice.motion import Clip, concatenate, unchecked_copy
from signsplice.rig.inspection import clip_warnings
from signsplice.rig.rest_pose import with_rest_pose
from signsplice.splicing.gap import Cut, gap_at
from signsplice.splicing.methods import choice as methods
from signsplice.splicing.methods.transition import Transition
from signsplice.splicing.passes.face_seams import eased
from signsplice.splicing.passes.filling import fill
from signsplice.splicing.result import Span, SpliceResult
from signsplice.splicing.seam import Seam, score


def inbetween(
    clip: Clip,
    gaps: Sequence[tuple[int, int]],
    transition: str | Transition | None = None,
    avoid_collisions: bool | None = None,
    bundle: str | Path | None = None,
) -> SpliceResult:
    """The clip with frames [a, b) of every gap made anew from what surrounds them; every other frame unchanged.

    Gaps are half-open frame ranges with at least one frame kept before, between and after them; ``transition``,
    ``avoid_collisions`` and ``bundle`` as in ``SpliceOptions``. Raises ``InputError`` for other gaps.
    """
    # No word is cut and no duration chosen here: those two methods open no network.
    chosen = methods.choose("ends", transition, "fixed", bundle)
    clip = with_rest_pose(clip)
    ranges = _checked(gaps, len(clip))
    entries = [0, *(stop for _, stop in ranges)]  # where each stretch that is kept begins
    ends = [*(start for start, _ in ranges), len(clip)]  # and where it ends
    began = time.perf_counter()
    asked = [
        gap_at(clip, clip[: ends[k + 1]], Cut(start - 1, stop), stop - start, entry=entries[k])
        for k, (start, stop) in enumerate(ranges)
    ]
    filled = fill(chosen.transition, asked, avoid_collisions)
    transition_s = time.perf_counter() - began
    spans: list[Span] = []
    seams: list[Seam] = []
    pieces: list[Clip] = []
    for k, ((start, stop), gap, new) in enumerate(zip(ranges, asked, filled, strict=True)):
        kept = entries[k], start
        made = new.clip
        if clip.face is not None:
            face = eased(clip.face[:start], clip.face[stop:], start - 1, 0, stop - start, clip.fps)
            made = unchecked_copy(made, face=face)
        pieces += [clip[kept[0] : kept[1]], made]
        spans += [Span("sign", 0, clip.name, kept, kept), Span("transition", None, None, None, (start, stop))]
        seams.append(score(gap, new, clip.name, clip.name, Cut(start - 1, stop), of_one_clip=True))
    kept = entries[-1], len(clip)
    pieces.append(clip[kept[0] :])
    spans.append(Span("sign", 0, clip.name, kept, kept))
    began = time.perf_counter()
    joined = concatenate(pieces, name=clip.name)
    timing = {"harmonize": 0.0, "cut": 0.0, "transition": transition_s, "join": time.perf_counter() - began}
    return SpliceResult(
        clip=joined,
        spans=tuple(spans),
        seams=tuple(seams),
        warnings=(*chosen.warnings, *(f"{clip.name}: {line}" for line in clip_warnings(clip))),
        cutter="none",
        transition=chosen.transition.name,
        timing_ms={part: 1e3 * seconds for part, seconds in timing.items()},
        bundle=chosen.bundle,
    )


def _checked(gaps: Sequence[tuple[int, int]], n_frames: int) -> list[tuple[int, int]]:
    """The gaps in order. Raises ``InputError`` where frames do not remain before, between and after them."""
    at = 0
    for start, stop in sorted(gaps):
        if not at < start < stop < n_frames:
            raise InputError(
                f"gap {start}:{stop} in {n_frames} frames, expected {at + 1} <= A < B <= {n_frames - 1}: "
                "frames must remain before, between and after gaps"
            )
        at = stop
    return sorted(gaps)
