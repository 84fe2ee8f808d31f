"""Culling (eq. 11), the layer without weights before the network; training and running share it.

Frames are rows, usually of positions (N, 159). The layer after the network, Filter (eq. 17), is the splice itself:
``signsplice.splicing.engine``, with a ``WholeSystem``.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import InputError

Array = NDArray[Any]


def cull(before: Array, after: Array, pre: int, post: int, fr: int) -> tuple[Array, NDArray[np.bool_]]:
    """X_c (2 fr, 159) and which of its rows are real frames (2 fr,): the ``fr`` frames up to and with ``pre``, and the
    ``fr`` frames from ``post`` on (eq. 11; its last index is printed as post - fr + 1 and read as post + fr - 1).

    Where a clip has fewer, its edge frame is repeated, and the mask is False there.
    """
    check(before, after, pre, post)
    if fr < 1:
        raise InputError(f"fr {fr}, expected at least 1 frame on each side")
    left, right = np.arange(pre - fr + 1, pre + 1), np.arange(post, post + fr)
    rows = np.concatenate([before[np.maximum(left, 0)], after[np.minimum(right, len(after) - 1)]])
    return rows, np.concatenate([left >= 0, right < len(after)])


def check(before: Array, after: Array, pre: int, post: int) -> None:
    """Raise ``InputError`` for a splice position that lies outside the two clips."""
    if not (0 <= pre < len(before) and 0 <= post < len(after)):
        raise InputError(
            f"splice position {pre}, {post} in clips of {len(before)} and {len(after)} frames, expected frames of them"
        )
