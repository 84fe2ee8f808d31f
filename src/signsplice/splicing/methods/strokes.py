"""Where a word is left and entered beside its strokes: these stay whole, and ways from and to rest are left out."""

from __future__ import annotations

import numpy as np

from signsplice.splicing.networks.word_reader import WordReading

BELOW, NEXT_BELOW = 0.015, 0.03
"""How far below the end of its stroke, arm lengths (0.8 cm), a hand is still kept, and in the next frame beside it,
where movements are too slow to be told from holds: a hand that is farther below in a thirtieth of a second falls. Of
the words that ship, twice as many transitions dip by over 3 cm at 0.02, and at 0.01 one stroke in a hundred loses a
frame.
"""
_BESIDE = 2
"""Frames beside a stroke that are kept, unless a hand is below it there."""


def outside_strokes(cut: tuple[int, int], p: WordReading, q: WordReading) -> tuple[int, int]:
    """A cut, frames at ``FEATURE_FPS``, moved outwards until it leaves both words' strokes whole, then inwards, as far
    as these, past frames in which a hand has begun to sink or still rises: a transition that ends in them goes down
    first, below both signs.
    """
    pre, post = cut
    if p.stroke is not None:
        last, end = p.first + p.stroke[1], p.first + len(p.features) - 1
        pre = last + _n_raised(p, range(last, min(max(pre, last + _BESIDE), end) + 1))
    if q.stroke is not None:
        first = q.first + q.stroke[0]
        post = first - _n_raised(q, range(first, max(min(post, first - _BESIDE), q.first) - 1, -1))
    return pre, post


def _n_raised(word: WordReading, frames: range) -> int:
    """How many of a word's frames, away from its stroke, lie before the last at which both hands are still as high as
    in the first.
    """
    heights = word.wrists[np.array(frames) - word.first, :, 1]  # (n, 2)
    below = (heights[0] - heights).max(axis=1)
    return int(np.flatnonzero(below <= np.where(np.arange(len(below)) == 1, NEXT_BELOW, BELOW))[-1])
