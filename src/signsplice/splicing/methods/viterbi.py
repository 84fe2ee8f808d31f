"""The best cuts of a whole sentence, by dynamic programming (Viterbi 1967).

A cutter that scores every pair of frames for every seam cannot take the best pair of each seam alone: a word must not
be left before it was entered. The best sentence is found over the frames at which words are entered, in time linear in
the number of words.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signsplice.motion import FloatArray

_TOO_EARLY = 1e6
"""Cost of every frame that a word is left too early: larger than any score, but finite, so that there is an answer."""


@dataclass(frozen=True, eq=False)
class SeamScores:
    """The scores of a seam.

    scores: (P, Q) of leaving the word before at frame ``leaves_from`` + row, and entering the word after at frame
        ``enters_from`` + column.
    leaves_from, enters_from: first frames of rows and columns.
    """

    scores: FloatArray
    leaves_from: int
    enters_from: int = 0


def best_path(seams: Sequence[SeamScores], least: int = 1) -> list[tuple[int, int]]:
    """The frames (left, entered) of every seam whose scores have the largest sum, among all with at least ``least``
    frames between entering and leaving a word; of a word that is too short for that, as many as it has.
    """
    sums_so_far, entered_from = np.zeros(1), 0  # best sum by the frame at which the word before was entered
    back: list[tuple[NDArray[np.intp], NDArray[np.intp]]] = []
    for seam in seams:
        latest = seam.leaves_from + np.arange(len(seam.scores)) - least
        kept, entered = _best_entry(sums_so_far, latest - entered_from)
        sums = seam.scores + kept[:, None]  # (P, Q)
        rows = sums.argmax(axis=0)
        sums_so_far, entered_from = sums[rows, np.arange(sums.shape[1])], seam.enters_from
        back.append((rows, entered))
    chosen: list[tuple[int, int]] = []
    column = int(sums_so_far.argmax()) if back else 0
    for seam, (rows, entered) in zip(reversed(seams), reversed(back), strict=True):
        row = int(rows[column])
        chosen.append((seam.leaves_from + row, seam.enters_from + column))
        column = int(entered[row])
    return chosen[::-1]


def _best_entry(sums: FloatArray, latest: NDArray[np.intp]) -> tuple[FloatArray, NDArray[np.intp]]:
    """The best sum no later than each of ``latest``, and the frame of entering that it belongs to."""
    running = np.maximum.accumulate(sums)
    improves = np.concatenate([[True], sums[1:] > running[:-1]])
    where = np.maximum.accumulate(np.where(improves, np.arange(len(sums)), 0))
    at = np.minimum(latest, len(sums) - 1)
    missing = np.maximum(-at, 0)  # frames before the word's first one, at which it cannot be entered
    at = np.maximum(at, 0)
    return np.where(missing > 0, sums[0], running[at]) - _TOO_EARLY * missing, np.where(missing > 0, 0, where[at])
