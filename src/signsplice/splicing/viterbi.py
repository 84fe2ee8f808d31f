"""The best choice over all seams of a sentence together.

A cutter that scores every choice of two frames for every seam cannot take each seam's best alone: a word may not be
left before it was entered. The best sentence is found by dynamic programming over the frames at which words are
entered (Viterbi 1967), in time linear in the number of words.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

_MISSING = 1e6
"""What every frame costs that a word is left too early: more than any score, less than not to answer."""


@dataclass(frozen=True, eq=False)
class SeamScores:
    """The scores (P, Q) of a seam: of leaving the word before at frame ``leaves_from`` + row, and entering the word
    after at frame ``enters_from`` + column.
    """

    scores: Float
    leaves_from: int
    enters_from: int = 0


def best_path(seams: Sequence[SeamScores], least: int = 1) -> list[tuple[int, int]]:
    """The frames (left, entered) of every seam whose scores have the largest sum, among all with at least ``least``
    frames between a word's being entered and being left; where a word is too short for that, as many as it has.
    """
    carried, entered_from = np.zeros(1), 0  # best sum so far by the frame at which the word before was entered
    back: list[tuple[NDArray[np.intp], NDArray[np.intp]]] = []
    for seam in seams:
        latest = seam.leaves_from + np.arange(len(seam.scores)) - least
        kept, entered = _entered_before(carried, latest - entered_from)
        sums = seam.scores + kept[:, None]
        rows = sums.argmax(axis=0)
        carried, entered_from = sums[rows, np.arange(sums.shape[1])], seam.enters_from
        back.append((rows, entered))
    chosen: list[tuple[int, int]] = []
    column = int(carried.argmax()) if back else 0
    for seam, (rows, entered) in zip(reversed(seams), reversed(back), strict=True):
        row = int(rows[column])
        chosen.append((seam.leaves_from + row, seam.enters_from + column))
        column = int(entered[row])
    return chosen[::-1]


def _entered_before(carried: Float, latest: NDArray[np.intp]) -> tuple[Float, NDArray[np.intp]]:
    """The best sum, and its frame of entering, no later than each of ``latest``."""
    so_far = np.maximum.accumulate(carried)
    improves = np.concatenate([[True], carried[1:] > so_far[:-1]])
    where = np.maximum.accumulate(np.where(improves, np.arange(len(carried)), 0))
    at = np.minimum(latest, len(carried) - 1)
    missing = np.maximum(-at, 0)  # before the word's first frame there is none to enter at
    at = np.maximum(at, 0)
    return np.where(missing > 0, carried[0], so_far[at]) - _MISSING * missing, np.where(missing > 0, 0, where[at])
