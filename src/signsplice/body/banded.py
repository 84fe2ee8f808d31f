"""Moves of wrists over time whose frames are tied to their neighbours alone, solved in bands."""

from __future__ import annotations

import numpy as np
from scipy.linalg import solveh_banded

from signsplice.motion.arrays import FloatArray


def solve_blocks(block: FloatArray, rhs: FloatArray, smoothness: float) -> FloatArray:
    """The moves (T, 2, 3) that solve a block (T, 6, 6) and right side (T, 6) for each frame, tied by the squares of
    their second differences with weight ``smoothness``.
    """
    n = len(block)
    band = np.zeros((18, 6 * n))
    for k in range(6):
        for i in range(6 - k):
            band[k, i::6] = block[:, i + k, i]
    d0, d1, d2 = second_differences(n)
    band[0] += np.repeat(smoothness * d0, 6)
    band[6, : 6 * (n - 1)] += np.repeat(smoothness * d1, 6)
    band[12, : 6 * max(n - 2, 0)] += np.repeat(smoothness * d2, 6)
    return np.asarray(solveh_banded(band, rhs.ravel(), lower=True, check_finite=False)).reshape(n, 2, 3)


def second_differences(n: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """The three diagonals of D'D, D the second differences of n values."""
    if n < 3:
        return np.zeros(n), np.zeros(max(n - 1, 0)), np.zeros(max(n - 2, 0))
    d0, d1, d2 = np.zeros(n), np.zeros(n - 1), np.ones(n - 2)
    d0[:-2] += 1.0
    d0[1:-1] += 4.0
    d0[2:] += 1.0
    d1[:-1] -= 2.0
    d1[1:] -= 2.0
    return d0, d1, d2
