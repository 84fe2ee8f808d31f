"""The mean transition: the mean of the true transitions of the training part, of their mean length, for every pair.

It depends on neither word and finds no position. A system whose Accuracy is below its own has learned nothing.
"""

from __future__ import annotations

import numpy as np

from signsplice.motion import FloatArray
from signsplice_paper.extra_metrics import resample_frames
from signsplice_paper.prediction import Prediction
from signsplice_workshop.corpora.pairs import Pairs

NAME = "mean-transition"


def compute_mean_transition(pairs: Pairs, split: str) -> FloatArray:
    """Returns the mean (n, K) of the true transitions of a split's training part, resampled to their mean length."""
    numbers = pairs.split(split, "train")
    count = max(1, round(float(pairs.index[numbers, 5].mean())))
    total = sum(resample_frames(np.asarray(pairs.truth(k)[2], np.float64), count) for k in numbers)
    return np.asarray(total / len(numbers))


class MeanAnswers:
    """Predicts the mean transition for every pair; a callable from a pair's number to a prediction."""

    def __init__(self, pairs: Pairs, split: str) -> None:
        self._frames = compute_mean_transition(pairs, split)

    def __call__(self, number: int) -> Prediction:
        """Returns the prediction for a pair."""
        return Prediction(None, None, self._frames)
