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
"""Strokes that are fewer frames apart than these are one, unless those are a way from or to rest."""
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
    surest = phases.argmax(axis=-1)
    goes = np.isin(surest, (_PREPARATION, _RETRACTION))
    strokes, _ = label((binary_closing(possible, _JOINED) & ~goes) | possible)
    rows = [
        rows.start + np.flatnonzero(possible[rows])
        for (rows,) in find_objects(strokes)
        if raised[rows].any() and phases[rows, _STROKE].max() > _SURE
    ]
    heights, last = wrists[..., 1].max(axis=1), len(surest) - 1
    rows = _without_rest_moves(rows, heights, surest, _PREPARATION)
    rows = _without_rest_moves([last - row[::-1] for row in rows[::-1]], heights[::-1], surest[::-1], _RETRACTION)
    rows = [last - row[::-1] for row in rows[::-1]]
    if rows:
        return int(rows[0][0]), int(rows[-1][-1])
    held = np.flatnonzero(raised & (phases[:, _HOLD] > 0.5))
    return (int(held[len(held) // 2]),) * 2 if len(held) else None


def _without_rest_moves(
    strokes: list[NDArray[np.intp]], heights: NDArray[np.floating], phases: NDArray[np.intp], rest_phase: int
) -> list[NDArray[np.intp]]:
    """The frames of each of a word's strokes without the first ones in which hands only leave rest, by the height (T,)
    of the higher one and the phase (T,) that each frame is surest in: it is as low as it rests, and goes from there to
    the next stroke, or it is a moment within the phase ``rest_phase``.
    """
    while len(strokes) > 1:
        first, stop, then = int(strokes[0][0]), int(strokes[0][-1]) + 1, phases[strokes[0][-1] + 1 : strokes[1][0]]
        then = then[then != _HOLD]
        is_low = stop - first <= _PARTING and heights[strokes[0]].max() <= heights[0] + _PARTING_HEIGHT
        goes = len(then) > 0 and np.isin(then, (_PREPARATION, _RETRACTION)).mean() > 0.5
        is_moment = stop - first < _MOMENT and first > 0 and phases[first - 1] == phases[stop] == rest_phase
        if not (is_low and goes) and not is_moment:
            break
        strokes = strokes[1:]
    return strokes


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
