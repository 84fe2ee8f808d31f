"""BLEU over frames (Papineni et al. 2002), for frames that are equal within a tolerance.

Two frames are equal where the mean squared difference of their 159 numbers is at most the tolerance; two n-grams are
equal where their frames are, one by one. Such equality is not transitive, so counts cannot be clipped word by word as
in the original; clipping means instead that each true n-gram answers for at most one predicted one, and the matched
count is that of a maximum matching (Hopcroft and Karp 1973) between the n-grams of the two transitions. With a
tolerance of 0 this is Papineni's clipped count exactly. The rest is his: counts summed over the corpus before
dividing, geometric mean of the precisions up to n, brevity penalty exp(1 - r / c) where c predicted frames are fewer
than r true ones.

**The tolerance.** The paper states none. Neighbouring frames of the true transitions differ by 9.3e-5 (median over
the standard corpus's test pairs), so 1e-4, a root mean square of 2.2 cm a coordinate, calls a predicted frame equal
to the true one where it comes as near as that one's neighbours. Beside it stand 2e-5, half the way to a neighbour,
and 3e-4, the level 0.002 under which the paper's viewers saw no difference shared out over a transition's seven
frames; there five out of six neighbours are equal, and order counts for little.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_bipartite_matching

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]

ORDERS = 4
TOLERANCE = 1e-4
TOLERANCES = (2e-5, 5e-5, TOLERANCE, 3e-4)


def signature(tolerance: float | str, compared: str) -> str:
    """How BLEU is computed, in one line."""
    told = f"{tolerance:g}" if isinstance(tolerance, float) else tolerance
    return (
        f"bleu|n:1..{ORDERS}|{compared}|equal:msd<={told}|clip:maximum-matching|corpus-level|geometric-mean|"
        "brevity-penalty"
    )


@dataclass(frozen=True)
class NGrams:
    """What one pair adds: n-grams matched and predicted and true, for n = 1..4; frames predicted and true."""

    matched: tuple[int, ...]
    predicted: tuple[int, ...]
    true: tuple[int, ...]
    n_predicted: int
    n_true: int


@dataclass(frozen=True)
class Bleu:
    """BLEU-1..4 of a corpus, the clipped precisions behind them, and the brevity penalty."""

    bleu: tuple[float, ...]
    precisions: tuple[float, ...]
    brevity: float


def distances(predicted: Float, true: Float) -> Float:
    """Mean squared differences (n, m) of all frames (n, K) and (m, K)."""
    return np.asarray(((predicted[:, None] - true[None]) ** 2).mean(axis=-1))


def count(predicted: Float, true: Float, tolerances: Sequence[float] = TOLERANCES) -> dict[float, NGrams]:
    """Matched n-grams of predicted (n, K) and true (m, K) frames, by tolerance."""
    n, m = len(predicted), len(true)
    away = distances(predicted, true) if n and m else np.zeros((n, m))
    there = tuple(max(0, n - k) for k in range(ORDERS))
    wanted = tuple(max(0, m - k) for k in range(ORDERS))
    return {
        tolerance: NGrams(tuple(_matched(away <= tolerance, k + 1) for k in range(ORDERS)), there, wanted, n, m)
        for tolerance in tolerances
    }


def equal_ngrams(equal: Bool, n: int) -> Bool:
    """Which n-grams are equal: (n_frames - n + 1, m_frames - n + 1) from equal frames (n_frames, m_frames)."""
    rows, columns = (max(0, size - n + 1) for size in equal.shape)
    out = np.ones((rows, columns), bool)
    for k in range(n):
        out &= equal[k : k + rows, k : k + columns]
    return out


def _matched(equal: Bool, n: int) -> int:
    """Size of a maximum matching between predicted and true n-grams that are equal."""
    pairs = equal_ngrams(equal, n)
    if not pairs.any():
        return 0
    found = maximum_bipartite_matching(csr_array(pairs.astype(np.int8)), perm_type="column")
    return int((found >= 0).sum())


def corpus(pairs: Sequence[NGrams]) -> Bleu:
    """BLEU of a corpus of pairs.

    An order of which nothing was predicted though there was something to predict has precision 0; one of which the
    truth has nothing either leaves BLEU undefined (NaN) from there on.
    """
    matched = np.sum([p.matched for p in pairs], axis=0)
    predicted = np.sum([p.predicted for p in pairs], axis=0)
    true = np.sum([p.true for p in pairs], axis=0)
    precisions = tuple(
        float(a / b) if b else (0.0 if c else float("nan")) for a, b, c in zip(matched, predicted, true, strict=True)
    )
    brevity = _brevity(sum(p.n_predicted for p in pairs), sum(p.n_true for p in pairs))
    return Bleu(tuple(brevity * _geometric(precisions[: n + 1]) for n in range(ORDERS)), precisions, brevity)


def _brevity(n_predicted: int, n_true: int) -> float:
    if n_predicted >= n_true:
        return 1.0
    return math.exp(1.0 - n_true / n_predicted) if n_predicted else 0.0


def _geometric(values: Sequence[float]) -> float:
    if any(math.isnan(value) for value in values):
        return float("nan")
    if min(values) <= 0.0:
        return 0.0
    return math.exp(sum(math.log(value) for value in values) / len(values))
