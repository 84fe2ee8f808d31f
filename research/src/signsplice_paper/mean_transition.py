"""The mean transition: the mean of the true transitions of the training part, of their mean length, for every pair.

It looks at neither word and finds no position. A system whose Accuracy is below its own has learned nothing.
"""

from __future__ import annotations

import numpy as np

from signsplice.motion import FloatArray
from signsplice_paper.extra_metrics import resample_frames
from signsplice_paper.prediction import Prediction
from signsplice_workshop.corpora.pairs import Pairs

NAME = "mean-transition"


def mean_transition(pairs: Pairs, split: str) -> FloatArray:
    """The mean (n, K) of the true transitions of a split's training part, each stretched to their mean length."""
    numbers = pairs.split(split, "train")
    count = max(1, round(float(pairs.index[numbers, 5].mean())))
    total = sum(resample_frames(np.asarray(pairs.truth(k)[2], np.float64), count) for k in numbers)
    return np.asarray(total / len(numbers))


class MeanAnswers:
    """The mean transition as a callable from a pair's number to a prediction; the same for every pair."""

    def __init__(self, pairs: Pairs, split: str) -> None:
        self._frames = mean_transition(pairs, split)

    def __call__(self, number: int) -> Prediction:
        """The prediction for a pair."""
        return Prediction(None, None, self._frames)
