"""The paper's scores (eq. 18 to 23), each with a signature that holds every parameter.

**What is compared.** Only the transition frames, predicted O against true, not the whole utterance Y. The text below
eq. 18 calls both lengths "the length of the transition frame sequence", introduces MSE as an error "in the prediction
of transition frames", and BLEU as the overlap of "predicted and true transition frames". PTA and PAA score the
positions. Frames are scored whenever a system makes them, with or without position tokens: no other reading allows
ConvS2S both PTA 0.251 and BLEU-1 0.744.

**sigma and lambda** are not in the paper. Here a transition that is one frame too long or too short costs as much as
one frame with a mean squared error of 0.002, below which the paper's viewers saw no difference:
lambda^2 / K = sigma^2 = 0.002, with K numbers a frame (159 in the paper, where lambda is 0.5639). The share of wrong
lengths then decides MSE and Accuracy, so both are also measured over the pairs of right length alone, and MSE for a
quarter and for four times that cost.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from signsplice.motion import FloatArray
from signsplice_paper import bleu, extra_metrics, pair_samples
from signsplice_paper.prediction import Prediction

NUMBERS = 159
E_MAX = 1.0
"""Largest possible error of a number (E_M): positions lie in a cube of side 1."""
VISIBLE = 0.002
"""MSE below which the paper's viewers saw no difference."""
SIGMA = math.sqrt(VISIBLE)
FRAME_COSTS = (VISIBLE / 4.0, VISIBLE, 4.0 * VISIBLE)
"""lambda^2 / K: squared error of a frame too many or too few; lambda is halved, as it is, and doubled."""

COMPARED = "compared:transition"
SIGNATURES = {
    "accuracy": f"accuracy|eq:18,19|{COMPARED}|E_M:{E_MAX:g}|sigma:{SIGMA:.4f}|abs|mean:frames,numbers,pairs",
    "accuracy_equal": "accuracy|eq:18,19|of:equal-lengths",
    "mse": f"mse|eq:20,21|{COMPARED}|sum:frames|mean:numbers,pairs|lambda^2/K:{VISIBLE:g}",
    "mse_at": f"mse|eq:20,21|lambda^2/K:{','.join(f'{cost:g}' for cost in FRAME_COSTS)}",
    "mse_equal": "mse|eq:20|of:equal-lengths",
    "bleu": bleu.format_signature(bleu.TOLERANCE, COMPARED),
    "bleu_at": bleu.format_signature("each", COMPARED),
    "papineni": bleu.format_papineni_signature(bleu.TOLERANCE, COMPARED),
    "papineni_at": bleu.format_papineni_signature("each", COMPARED),
    "pta": "pta|eq:22|both-tokens|of:all",
    "paa": "paa|eq:23|both-exact|of:predicted",
    "paa_all": "paa|eq:23|both-exact|of:all",
    "within": "within|both-positions|frames:1,2|of:predicted",
    "positions_off": "positions-off|frames|mean:pre,post,pairs|of:predicted",
    "lengths": "length|off:mean|exact:share|ratio:predicted/true",
    **extra_metrics.SIGNATURES,
    **pair_samples.SIGNATURES,
}


@dataclass(frozen=True)
class PairScore:
    """Scores of one pair.

    - accuracy: eq. 18
    - mse: eq. 20, by the cost of a frame
    - ngrams: counts for BLEU, by tolerance
    - position_errors: errors of pre and post, frames; None if a token is missing
    - n_predicted: number of predicted frames
    - n_true: number of true frames
    - motion: metrics beyond the paper's
    """

    accuracy: float
    mse: dict[float, float]
    ngrams: dict[float, bleu.NGrams]
    position_errors: tuple[int, int] | None
    n_predicted: int
    n_true: int
    motion: extra_metrics.PairMotion

    @property
    def same_length(self) -> bool:
        """Whether the transition has the right number of frames."""
        return self.n_predicted == self.n_true


def compute_accuracy(predicted: FloatArray, true: FloatArray, sigma: float = SIGMA) -> float:
    """Returns the Accuracy of one pair (eq. 18, with the absolute value and the divisions that the print omits).

    predicted, true: (n, K) and (m, K). If n = m, the mean of (E_M - |T - L|) / E_M over frames and numbers. Else (E_M -
    |n - m| sigma) / E_M, as printed; it is negative for very wrong lengths.
    """
    if len(predicted) == len(true):
        return float(np.mean((E_MAX - np.abs(predicted - true)) / E_MAX)) if len(true) else 1.0
    return (E_MAX - abs(len(predicted) - len(true)) * sigma) / E_MAX


def compute_mse(predicted: FloatArray, true: FloatArray, frame_cost: float = VISIBLE) -> float:
    """Returns the MSE of one pair (eq. 20): summed over frames, averaged over the K numbers (159 in the print); for
    another length (|n - m| lambda)^2 / K.

    frame_cost: lambda^2 / K.
    """
    if len(predicted) == len(true):
        return float(np.sum((predicted - true) ** 2) / true.shape[1])
    return (len(predicted) - len(true)) ** 2 * frame_cost


def score(
    prediction: Prediction,
    true: tuple[int, int, FloatArray],
    words: tuple[FloatArray, FloatArray],
    layout: extra_metrics.NumberLayout,
    tolerances: Sequence[float] = bleu.TOLERANCES,
) -> PairScore:
    """Returns all scores of one pair.

    true: pre, post and frames (m, K). words: frames (N, K) and (M, K) of both words.
    """
    pre, post, frames = true
    predicted_positions = (prediction.pre, prediction.post)
    return PairScore(
        accuracy=compute_accuracy(prediction.frames, frames),
        mse={cost: compute_mse(prediction.frames, frames, cost) for cost in FRAME_COSTS},
        ngrams=bleu.count_ngrams(prediction.frames, frames, tolerances),
        position_errors=measure_position_errors(predicted_positions, (pre, post)),
        n_predicted=len(prediction.frames),
        n_true=len(frames),
        motion=extra_metrics.measure_pair_motion(prediction, true, words, layout),
    )


def measure_position_errors(predicted: tuple[int | None, int | None], true: tuple[int, int]) -> tuple[int, int] | None:
    """Returns the errors of pre and post, frames; None if one is missing."""
    (pre, post), (true_pre, true_post) = predicted, true
    return None if pre is None or post is None else (abs(pre - true_pre), abs(post - true_post))


def summarise(scores: Sequence[PairScore]) -> dict[str, float]:
    """Returns the scores of a test set, by name; NaN if there is nothing to count.

    - accuracy, mse: means over the pairs (eq. 19 and 21, which print sums); mse@c with a cost c of a frame
    - accuracy_equal, mse_equal: the same over pairs of equal lengths alone
    - bleu-1 .. bleu-4: the paper's BLEU at ``bleu.TOLERANCE``; bleu-n@t at tolerance t
    - papineni-1 .. papineni-4: Papineni's, in the same way
    - pta, paa, paa_all and others of the positions, see ``summarise_positions``
    - length_off: mean error of the transition's length, frames
    - length_exact: fraction of exact lengths
    - length_ratio: number of predicted frames over that of true frames
    - n_frames: mean number of true frames
    - the scores of ``extra_metrics.summarise``
    """
    if not scores:
        return {}
    equal_lengths = [s for s in scores if s.same_length]
    summary = {
        "accuracy": _compute_mean([s.accuracy for s in scores]),
        "accuracy_equal": _compute_mean([s.accuracy for s in equal_lengths]),
        "mse": _compute_mean([s.mse[VISIBLE] for s in scores]),
        "mse_equal": _compute_mean([s.mse[VISIBLE] for s in equal_lengths]),
        "length_off": _compute_mean([float(abs(s.n_predicted - s.n_true)) for s in scores]),
        "length_exact": len(equal_lengths) / len(scores),
        "length_ratio": sum(s.n_predicted for s in scores) / max(1, sum(s.n_true for s in scores)),
        "n_frames": _compute_mean([float(s.n_true) for s in scores]),
    }
    summary |= {f"mse@{cost:g}": _compute_mean([s.mse[cost] for s in scores]) for cost in FRAME_COSTS}
    summary |= summarise_positions([s.position_errors for s in scores])
    for tolerance in scores[0].ngrams:
        counts = [s.ngrams[tolerance] for s in scores]
        for kind, values in (
            ("bleu", bleu.compute_mean_bleu(counts)),
            ("papineni", bleu.compute_papineni_bleu(counts).bleu),
        ):
            if tolerance == bleu.TOLERANCE:
                summary |= {f"{kind}-{n}": value for n, value in enumerate(values, 1)}
            summary |= {f"{kind}-{n}@{tolerance:g}": value for n, value in enumerate(values, 1)}
    return summary | extra_metrics.summarise([s.motion for s in scores])


def summarise_positions(errors: Sequence[tuple[int, int] | None]) -> dict[str, float]:
    """Returns the scores of the positions of some pairs, from their errors.

    - pta: fraction of pairs with both tokens (eq. 22)
    - paa, paa_all: fraction of exact positions among pairs with both tokens (eq. 23), and among all
    - positions_off: mean error, frames
    - within_1, within_2: fraction with both positions within so many frames, among those with both tokens
    """
    known = [pair_errors for pair_errors in errors if pair_errors is not None]
    exact = sum(pair_errors == (0, 0) for pair_errors in known)
    return {
        "pta": len(known) / len(errors) if errors else float("nan"),
        "paa": exact / len(known) if known else float("nan"),
        "paa_all": exact / len(errors) if errors else float("nan"),
        "positions_off": _compute_mean([sum(pair_errors) / 2.0 for pair_errors in known]),
        "within_1": _compute_mean([float(max(pair_errors) <= 1) for pair_errors in known]),
        "within_2": _compute_mean([float(max(pair_errors) <= 2) for pair_errors in known]),
    }


def _compute_mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if values else float("nan")
