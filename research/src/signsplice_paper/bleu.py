"""BLEU over frames, where frames within a tolerance count as equal: the paper's, and Papineni's (2002).

Two frames are equal if the mean squared difference of their numbers is at most the tolerance. Two n-grams are equal if
their frames are, one by one.

**The paper's BLEU-n** (its section 4.2) is the fraction of a predicted transition's n-grams that are found anywhere in
the true one: for one n alone, without clipping and without a brevity penalty. It is computed for one pair; a set of
pairs has the mean. A pair of which no n-gram was predicted counts 0, and a pair whose truth has no n-gram is left out.
A prediction that repeats one right frame has BLEU-1 1.

**Papineni's BLEU-n.** The equality is not transitive, so counts cannot be clipped word by word as in the original.
Instead, each true n-gram is matched with at most one predicted n-gram, and the count is the size of a maximum matching
(Hopcroft and Karp 1973) between the n-grams of the two transitions. With a tolerance of 0 this equals Papineni's
clipped count. The rest follows Papineni: counts are summed over the corpus before dividing, BLEU is the geometric mean
of the precisions up to n, and the brevity penalty is exp(1 - r / c) if c predicted frames are fewer than r true frames.

**The tolerances.** The paper states none, so every table has three. Neighbouring frames of the true transitions differ
by a mean square of 6.9e-5 (median over the test pairs of version 2 of the corpus). At 1e-4, a root mean square of 2.2
cm per coordinate, 61 % of neighbours are equal: a predicted frame counts if it is about as near to the true frame as
that frame's neighbours. Tables that have room for one tolerance have this one. At 2e-5 17 % of neighbours are equal, so
that order counts. 3e-4 is the MSE of 0.002, below which the paper's viewers saw no difference, divided by the seven
frames of a transition; 89 % of neighbours are equal there, and order counts for little.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_bipartite_matching

from signsplice.motion import FloatArray

Bool = NDArray[np.bool_]

ORDERS = 4
TOLERANCE = 1e-4
TOLERANCES = (2e-5, TOLERANCE, 3e-4)


def format_signature(tolerance: float | str, compared: str) -> str:
    """Returns the recipe of the paper's BLEU in one line; ``tolerance`` is a number or a word for several."""
    return (
        f"bleu|n:1..{ORDERS}|{compared}|equal:msd<={_format_tolerance(tolerance)}|found/predicted|no-clip|one-n"
        "|no-brevity-penalty|mean:pairs|none-predicted:0|none-true:left-out"
    )


def format_papineni_signature(tolerance: float | str, compared: str) -> str:
    """Returns the recipe of Papineni's BLEU in one line."""
    return (
        f"papineni|n:1..{ORDERS}|{compared}|equal:msd<={_format_tolerance(tolerance)}|clip:maximum-matching"
        "|corpus-level|geometric-mean|brevity-penalty"
    )


def _format_tolerance(tolerance: float | str) -> str:
    return f"{tolerance:g}" if isinstance(tolerance, float) else tolerance


@dataclass(frozen=True)
class NGrams:
    """The counts of one pair.

    - hits: number of predicted n-grams that equal a true one, for n = 1..4
    - matched: size of the maximum matching, for n = 1..4
    - predicted: number of predicted n-grams, for n = 1..4
    - true: number of true n-grams, for n = 1..4
    - n_predicted: number of predicted frames
    - n_true: number of true frames
    """

    hits: tuple[int, ...]
    matched: tuple[int, ...]
    predicted: tuple[int, ...]
    true: tuple[int, ...]
    n_predicted: int
    n_true: int


@dataclass(frozen=True)
class Bleu:
    """Papineni's BLEU of a corpus of pairs.

    - bleu: BLEU-1 to BLEU-4, NaN if undefined
    - precisions: clipped precision of n-grams, for n = 1..4
    - brevity: brevity penalty, at most 1
    """

    bleu: tuple[float, ...]
    precisions: tuple[float, ...]
    brevity: float


def compute_frame_distances(predicted: FloatArray, true: FloatArray) -> FloatArray:
    """Returns the mean squared differences (n, m) between all frames (n, K) and (m, K)."""
    return np.asarray(((predicted[:, None] - true[None]) ** 2).mean(axis=-1))


def count_ngrams(
    predicted: FloatArray, true: FloatArray, tolerances: Sequence[float] = TOLERANCES
) -> dict[float, NGrams]:
    """Returns the n-gram counts of predicted (n, K) and true (m, K) frames, by tolerance."""
    n, m = len(predicted), len(true)
    errors = compute_frame_distances(predicted, true) if n and m else np.zeros((n, m))
    n_predicted = tuple(max(0, n - k) for k in range(ORDERS))
    n_true = tuple(max(0, m - k) for k in range(ORDERS))
    counts = {}
    for tolerance in tolerances:
        equal = [compare_ngrams(errors <= tolerance, k + 1) for k in range(ORDERS)]
        hits = tuple(int(pairs.any(axis=1).sum()) for pairs in equal)
        counts[tolerance] = NGrams(hits, tuple(map(_compute_matching_size, equal)), n_predicted, n_true, n, m)
    return counts


def compare_ngrams(equal: Bool, n: int) -> Bool:
    """Returns which n-grams are equal (N - n + 1, M - n + 1), given which frames are equal (N, M)."""
    rows, columns = (max(0, size - n + 1) for size in equal.shape)
    matches = np.ones((rows, columns), bool)
    for k in range(n):
        matches &= equal[k : k + rows, k : k + columns]
    return matches


def _compute_matching_size(pairs: Bool) -> int:
    """Returns the size of a maximum matching between equal predicted and true n-grams."""
    if not pairs.any():
        return 0
    partners = maximum_bipartite_matching(csr_array(pairs.astype(np.int8)), perm_type="column")
    return int((partners >= 0).sum())


def compute_mean_bleu(pairs: Sequence[NGrams]) -> tuple[float, ...]:
    """Returns the paper's BLEU-1 to BLEU-4: the mean over pairs of the fraction of predicted n-grams that are found;
    NaN if no pair has a true n-gram.
    """
    scores = []
    for n in range(ORDERS):
        precisions = [p.hits[n] / p.predicted[n] if p.predicted[n] else 0.0 for p in pairs if p.true[n]]
        scores.append(float(np.mean(precisions)) if precisions else float("nan"))
    return tuple(scores)


def compute_papineni_bleu(pairs: Sequence[NGrams]) -> Bleu:
    """Returns Papineni's BLEU of a corpus of pairs.

    An order n with true n-grams but no predicted ones has precision 0. An order without either has precision NaN, and
    so has BLEU from that order on.
    """
    matched = np.sum([p.matched for p in pairs], axis=0)
    predicted = np.sum([p.predicted for p in pairs], axis=0)
    true = np.sum([p.true for p in pairs], axis=0)
    precisions = tuple(
        float(a / b) if b else (0.0 if c else float("nan")) for a, b, c in zip(matched, predicted, true, strict=True)
    )
    brevity = _compute_brevity_penalty(sum(p.n_predicted for p in pairs), sum(p.n_true for p in pairs))
    return Bleu(
        tuple(brevity * _compute_geometric_mean(precisions[: n + 1]) for n in range(ORDERS)), precisions, brevity
    )


def _compute_brevity_penalty(n_predicted: int, n_true: int) -> float:
    if n_predicted >= n_true:
        return 1.0
    return math.exp(1.0 - n_true / n_predicted) if n_predicted else 0.0


def _compute_geometric_mean(values: Sequence[float]) -> float:
    if any(math.isnan(value) for value in values):
        return float("nan")
    if min(values) <= 0.0:
        return 0.0
    return math.exp(sum(math.log(value) for value in values) / len(values))
