"""Stretches of one clip made anew from what surrounds them."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

from signsplice.errors import InputError
from signsplice.motion.clip import Clip, concatenate
from signsplice.splicing import methods as defaults
from signsplice.splicing.cut import Cut
from signsplice.splicing.engine import Span, SpliceResult
from signsplice.splicing.filling import CONTEXT, fill, n_shown_frames
from signsplice.splicing.seam import Seam, score
from signsplice.splicing.transition import Transition


def inbetween(
    clip: Clip,
    gaps: Sequence[tuple[int, int]],
    transition: str | Transition | None = None,
    body_sense: bool | None = None,
    bundle: str | Path | None = None,
) -> SpliceResult:
    """The clip with frames [a, b) of every gap made anew from what surrounds them; every other frame unchanged.

    Gaps are half-open frame ranges with at least one frame kept before, between and after them; transition,
    body_sense and bundle as in ``SpliceOptions``. Raises ``InputError`` for other gaps.
    """
    # Nothing is cut or timed here: no network is asked for that.
    methods = defaults.choose("ends", transition, "fixed", bundle)
    method = methods.transition
    seconds: dict[str, float] = defaultdict(float)
    spans: list[Span] = []
    seams: list[Seam] = []
    pieces: list[Clip] = []
    gaps = sorted(gaps)
    at = 0
    for start, stop in gaps:
        if not at < start < stop < len(clip):
            raise InputError(
                f"gap {start}:{stop} in {len(clip)} frames, expected {at + 1} <= A < B <= {len(clip) - 1}: "
                "frames must remain before, between and after gaps"
            )
        at = stop
    n_shown = n_shown_frames(clip.fps)
    kept_from = [0, *(stop for _, stop in gaps)]
    kept_until = [*(start for start, _ in gaps), len(clip)]
    began = time.perf_counter()
    asked = [
        (clip[kept_from[k] : start][-n_shown:], clip[stop : kept_until[k + 1]][:n_shown], stop - start)
        for k, (start, stop) in enumerate(gaps)
    ]
    made = fill(method, asked, body_sense)
    seconds["transition"] = time.perf_counter() - began
    at = 0
    for (start, stop), (kept, follows, _), filled in zip(gaps, asked, made, strict=True):
        pieces += [clip[at:start], filled.clip]
        spans += [
            Span("sign", 0, clip.name, (at, start), (at, start)),
            Span("transition", None, None, None, (start, stop)),
        ]
        kept = kept[-CONTEXT:]
        window = concatenate([kept, filled.clip, follows[:CONTEXT]])
        cut = Cut(start - 1, stop)
        seams.append(score(window, len(kept), stop - start, clip.name, clip.name, cut, filled.warnings, filled.depth))
        at = stop
    pieces.append(clip[at:])
    spans.append(Span("sign", 0, clip.name, (at, len(clip)), (at, len(clip))))
    began = time.perf_counter()
    joined = concatenate(pieces, name=clip.name)
    seconds["join"] = time.perf_counter() - began
    timing = {part: 1e3 * seconds[part] for part in ("harmonize", "cut", "transition", "join")}
    return SpliceResult(
        joined, tuple(spans), tuple(seams), methods.warnings, "none", method.name, timing, methods.bundle
    )
