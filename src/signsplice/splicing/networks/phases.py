"""A word's strokes by the phases that the network sees in its frames, and by which hand moves when."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_closing, binary_opening, find_objects, label

from signsplice.splicing.networks import features

Mask = NDArray[np.bool_]

_PREPARATION, _HOLD, _STROKE, _RETRACTION = range(1, len(features.PHASES))
_POSSIBLE, _SURE = 0.05, 0.5
"""Probability from which on a frame may be part of a stroke, and that of one frame of it at least."""
_JOINED = np.ones(4, bool)
"""Strokes that are fewer frames apart than these are one."""
_PARTING, _PARTING_HEIGHT = 9, 0.05
"""Hands that lie on one another part before they rise, and meet as they sink: that takes so many frames at most, at no
more than this height, arm lengths, above where the higher one rests.
"""
_MOMENT = 5
"""A stroke takes so many frames at least where it lies amid a way from or to rest."""
_AT_REST = 0.12
"""Distance, arm lengths, from where it begins or ends up to which a hand rests."""
_ALONE = 6
"""Frames, 0.2 s, from which on a hand moves alone."""


def stroke_span(scores: NDArray[np.float32], raised: Mask, wrists: NDArray[np.floating]) -> tuple[int, int] | None:
    """First and last frame of a word's strokes by the scores (T, 5) of its frames' phases; ``raised`` (T,): frames in
    which a stroke may lie; ``wrists`` (T, 2, 3), arm lengths.

    All frames count that are not surely something else; but not a stroke of which no frame is sure, or none is raised,
    nor hands that part before their preparation or meet after their retraction. The middle frame of a sign that is all
    hold; None where neither is seen.
    """
    weights = np.exp(scores.astype(np.float64) - scores.max(axis=-1, keepdims=True))
    phases = weights / weights.sum(axis=-1, keepdims=True)
    possible = phases[:, _STROKE] > _POSSIBLE
    strokes, _ = label(binary_closing(possible, _JOINED) | possible)
    rows = [
        rows.start + np.flatnonzero(possible[rows])
        for (rows,) in find_objects(strokes)
        if raised[rows].any() and phases[rows, _STROKE].max() > _SURE
    ]
    heights, surest = wrists[..., 1].max(axis=1), phases.argmax(axis=-1)
    while len(rows) > 1 and _is_on_way(rows[0], rows[1][0], heights, surest == _PREPARATION, surest == _HOLD):
        rows = rows[1:]
    last = len(surest) - 1
    ends = [last - row[::-1] for row in reversed(rows)]
    back = heights[::-1], (surest == _RETRACTION)[::-1], (surest == _HOLD)[::-1]
    while len(ends) > 1 and _is_on_way(ends[0], ends[1][0], *back):
        ends = ends[1:]
    rows = rows[: len(ends)]
    if rows:
        return int(rows[0][0]), int(rows[-1][-1])
    held = np.flatnonzero(raised & (phases[:, _HOLD] > 0.5))
    return (int(held[len(held) // 2]),) * 2 if len(held) else None


def _is_on_way(
    frames: NDArray[np.intp], next_frame: int, heights: NDArray[np.floating], goes: Mask, holds: Mask
) -> bool:
    """Whether hands that seem to begin a stroke in some frames of a word only leave rest: the higher one is as low as
    it rests, by ``heights`` (T,), or it is a moment amid the way. Frames (T,) of the way, ``goes``, and ``holds`` lead
    to the next stroke.
    """
    first, stop = int(frames[0]), int(frames[-1]) + 1
    between = goes[stop:next_frame][~holds[stop:next_frame]]
    is_low = heights[frames].max() <= heights[0] + _PARTING_HEIGHT and stop - first <= _PARTING
    is_moment = first > 0 and goes[first - 1] and stop - first < _MOMENT
    return bool(len(between) and between.mean() > 0.5 and (is_low or is_moment))


def are_away(wrists: NDArray[np.floating]) -> Mask:
    """Whether each wrist of wrists (T, 2, 3), arm lengths, is away from where it begins and ends (T, 2)."""
    away = [np.linalg.norm(wrists - wrists[end], axis=-1) > _AT_REST for end in (0, -1)]
    return np.asarray(away[0] & away[1])


def frames_alone(wrists: NDArray[np.floating]) -> Mask:
    """Frames (T,) in which the first wrist of wrists (T, 2, 3) is away from rest while the second rests, for longer
    than a hand that comes or goes a little before the other.
    """
    away = are_away(wrists)
    return np.asarray(binary_opening(away[:, 0] & ~away[:, 1], np.ones(_ALONE, bool)))
