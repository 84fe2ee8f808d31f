"""The paper's scores (eq. 18 to 23), each with a signature that holds every parameter.

**What is compared.** Only the transition frames, predicted O against true, not the whole utterance Y. The text below
eq. 18 calls both lengths "the length of the transition frame sequence", introduces MSE as an error "in the prediction
of transition frames", and BLEU as the overlap of "predicted and true transition frames". PTA and PAA score the
positions. Frames are scored whenever a system makes them, with or without position tokens: no other reading allows
ConvS2S both PTA 0.251 and BLEU-1 0.744.

**sigma and lambda** are not in the paper. Here a transition that is one frame too long or too short costs as much as
one frame with a mean squared error of 0.002, below which the paper's viewers saw no difference:
lambda^2 / 159 = sigma^2 = 0.002.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signsplice.paper import bleu, extra_metrics
from signsplice.paper.prediction import Prediction

Float = NDArray[np.float64]

NUMBERS = 159
E_MAX = 1.0
"""Largest possible error of a number (E_M): positions lie in a cube of side 1."""
VISIBLE = 0.002
"""MSE below which the paper's viewers saw no difference."""
SIGMA = math.sqrt(VISIBLE)
LAMBDA = math.sqrt(NUMBERS * VISIBLE)

COMPARED = "compared:transition"
SIGNATURES = {
    "accuracy": f"accuracy|eq:18,19|{COMPARED}|E_M:{E_MAX:g}|sigma:{SIGMA:.4f}|abs|mean:frames,numbers,pairs",
    "mse": f"mse|eq:20,21|{COMPARED}|sum:frames|mean:numbers,pairs|lambda:{LAMBDA:.4f}",
    "bleu": bleu.signature(bleu.TOLERANCE, COMPARED),
    "bleu_at": bleu.signature("each", COMPARED),
    "pta": "pta|eq:22|both-tokens|of:all",
    "paa": "paa|eq:23|both-exact|of:predicted",
    "paa_all": "paa|eq:23|both-exact|of:all",
    "positions_off": "positions-off|frames|mean:pre,post,pairs|of:predicted",
    **extra_metrics.SIGNATURES,
}


@dataclass(frozen=True)
class PairScore:
    """Scores of one pair.

    - accuracy: eq. 18
    - mse: eq. 20
    - ngrams: counts for corpus-level BLEU, by tolerance
    - off: errors of pre and post, frames; None if a token is missing
    - n_predicted: number of predicted frames
    - n_true: number of true frames
    - motion: metrics beyond the paper's
    """

    accuracy: float
    mse: float
    ngrams: dict[float, bleu.NGrams]
    off: tuple[int, int] | None
    n_predicted: int
    n_true: int
    motion: extra_metrics.PairMotion


def accuracy(predicted: Float, true: Float, sigma: float = SIGMA) -> float:
    """Accuracy of one pair (eq. 18, with the absolute value and the divisions that the print omits).

    predicted, true: (n, 159) and (m, 159). If n = m, the mean of (E_M - |T - L|) / E_M over frames and numbers. Else
    (E_M - |n - m| sigma) / E_M, as printed; it is negative for very wrong lengths.
    """
    if len(predicted) == len(true):
        return float(np.mean((E_MAX - np.abs(predicted - true)) / E_MAX)) if len(true) else 1.0
    return (E_MAX - abs(len(predicted) - len(true)) * sigma) / E_MAX


def squared_error(predicted: Float, true: Float, lambda_: float = LAMBDA) -> float:
    """MSE of one pair (eq. 20): summed over frames, averaged over the 159 numbers; (|n - m| lambda)^2 / 159 for another
    length.
    """
    if len(predicted) == len(true):
        return float(np.sum((predicted - true) ** 2) / NUMBERS)
    return (abs(len(predicted) - len(true)) * lambda_) ** 2 / NUMBERS


def score(
    prediction: Prediction,
    true: tuple[int, int, Float],
    words: tuple[Float, Float],
    layout: extra_metrics.NumberLayout,
    tolerances: Sequence[float] = bleu.TOLERANCES,
) -> PairScore:
    """All scores of one pair.

    true: pre, post and frames (m, 159). words: frames (N, 159) and (M, 159) of both words.
    """
    pre, post, frames = true
    off = None
    if prediction.pre is not None and prediction.post is not None:
        off = (abs(prediction.pre - pre), abs(prediction.post - post))
    return PairScore(
        accuracy=accuracy(prediction.frames, frames),
        mse=squared_error(prediction.frames, frames),
        ngrams=bleu.count(prediction.frames, frames, tolerances),
        off=off,
        n_predicted=len(prediction.frames),
        n_true=len(frames),
        motion=extra_metrics.pair_motion(prediction, true, words, layout),
    )


def summary(scores: Sequence[PairScore]) -> dict[str, float]:
    """Scores of a test set, by name; NaN where there is nothing to count.

    - accuracy, mse: means over the pairs (eq. 19 and 21, which print sums)
    - bleu-1 .. bleu-4: BLEU at ``bleu.TOLERANCE``; bleu-n@t at tolerance t
    - ngram-1 .. ngram-4: the precisions behind bleu-1 .. bleu-4
    - pta: fraction of pairs with both tokens (eq. 22)
    - paa, paa_all: fraction of exact positions among pairs with both tokens (eq. 23), and among all
    - positions_off: mean error of the positions, frames
    - within_2: fraction of pairs with both positions within two frames, among those with both tokens
    - length_off: mean error of the transition's length, frames
    - length_exact: fraction of exact lengths
    - the scores of ``extra_metrics.summary``
    """
    if not scores:
        return {}
    known = [s.off for s in scores if s.off is not None]
    exact = sum(off == (0, 0) for off in known)
    out = {
        "accuracy": _mean([s.accuracy for s in scores]),
        "mse": _mean([s.mse for s in scores]),
        "pta": len(known) / len(scores),
        "paa": exact / len(known) if known else float("nan"),
        "paa_all": exact / len(scores),
        "positions_off": _mean([sum(off) / 2.0 for off in known]),
        "within_2": _mean([float(max(off) <= 2) for off in known]),
        "length_off": _mean([float(abs(s.n_predicted - s.n_true)) for s in scores]),
        "length_exact": _mean([float(s.n_predicted == s.n_true) for s in scores]),
    }
    for tolerance in scores[0].ngrams:
        found = bleu.corpus([s.ngrams[tolerance] for s in scores])
        if tolerance == bleu.TOLERANCE:
            out |= {f"bleu-{n}": value for n, value in enumerate(found.bleu, 1)}
            out |= {f"ngram-{n}": value for n, value in enumerate(found.precisions, 1)}
        for n, value in enumerate(found.bleu, 1):
            out[f"bleu-{n}@{tolerance:g}"] = value
    return out | extra_metrics.summary([s.motion for s in scores])


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if values else float("nan")
