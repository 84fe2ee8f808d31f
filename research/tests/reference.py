"""Slow reference implementations of the paper's scores, written from the equations, not from the code they check."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from signsplice.motion import FloatArray


def accuracy(predicted: FloatArray, true: FloatArray, sigma: float) -> float:
    if len(predicted) != len(true):
        return (1.0 - abs(len(predicted) - len(true)) * sigma) / 1.0
    total = 0.0
    for t, l in zip(predicted, true, strict=True):  # noqa: E741
        for a, b in zip(t, l, strict=True):
            total += (1.0 - abs(a - b)) / 1.0
    return total / (len(true) * 159)


def squared_error(predicted: FloatArray, true: FloatArray, lambda_: float) -> float:
    if len(predicted) != len(true):
        return (abs(len(predicted) - len(true)) * lambda_) ** 2 / 159
    total = 0.0
    for t, l in zip(predicted, true, strict=True):  # noqa: E741
        for a, b in zip(t, l, strict=True):
            total += (a - b) ** 2
    return total / 159


def matched(predicted: FloatArray, true: FloatArray, n: int, tolerance: float) -> int:
    """The size of a maximum matching of n-grams, by augmenting paths (Kuhn 1955)."""

    def equal(i: int, j: int) -> bool:
        return all(float(np.mean((predicted[i + k] - true[j + k]) ** 2)) <= tolerance for k in range(n))

    rows, columns = max(0, len(predicted) - n + 1), max(0, len(true) - n + 1)
    partner: dict[int, int] = {}

    def match(i: int, tried: set[int]) -> bool:
        for j in range(columns):
            if j not in tried and equal(i, j):
                tried.add(j)
                if j not in partner or match(partner[j], tried):
                    partner[j] = i
                    return True
        return False

    return sum(match(i, set()) for i in range(rows))


def matched_by_trying(equal: NDArray[np.bool_]) -> int:
    """The size of a maximum matching for a small table of equal n-grams, by trying every assignment."""
    n, m = equal.shape
    if n > m:
        return matched_by_trying(equal.T)
    return max((sum(equal[i, j] for i, j in enumerate(p)) for p in itertools.permutations(range(m), n)), default=0)


def bleu(pairs: Sequence[tuple[FloatArray, FloatArray]], order: int, tolerance: float) -> float:
    logs = 0.0
    for n in range(1, order + 1):
        n_matched = sum(matched(p, t, n, tolerance) for p, t in pairs)
        n_predicted = sum(max(0, len(p) - n + 1) for p, _ in pairs)
        if n_matched == 0:
            return 0.0
        logs += math.log(n_matched / n_predicted) / order
    c, r = sum(len(p) for p, _ in pairs), sum(len(t) for _, t in pairs)
    return math.exp(logs) * (1.0 if c >= r else math.exp(1.0 - r / c))
