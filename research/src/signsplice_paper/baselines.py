"""Baselines of transition frames without gradient training: ridge regression, and reference answers.

Ridge regression sees what TFGN sees, fr frames on each side of the cut. It predicts the transition resampled to
``RESAMPLED`` frames, less the straight line between its ends; a second regression predicts the number of frames from
the distance that every joint has to travel. Both get their weights from the normal equations, and the regulariser with
the least error on the validation part.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import signsplice as ss
from signsplice.motion import FloatArray
from signsplice.splicing.contracts import Cut
from signsplice.splicing.lptransformer import cull
from signsplice_paper.clip_methods import make_prediction
from signsplice_paper.extra_metrics import resample_frames
from signsplice_paper.position_baselines import Positions
from signsplice_paper.prediction import Prediction
from signsplice_paper.published import BEST_FR
from signsplice_workshop.corpora.pairs import Pairs

RESAMPLED = 10
REGULARISERS = (1e-4, 1e-3, 1e-2, 1e-1, 1.0)
"""Regularisers, in mean variances of an input."""
DISTANCE_FLOOR = 0.02
"""Distance, in the numbers' unit, added to every distance before its logarithm: shorter ones hardly count."""
MOST_FRAMES = 32


@dataclass(frozen=True, eq=False)
class Linear:
    """Ridge regression.

    - mean: of the inputs (I,)
    - weights: (I, O)
    - offset: mean of the outputs (O,)
    - regulariser: the chosen one
    """

    mean: FloatArray
    weights: FloatArray
    offset: FloatArray
    regulariser: float

    def __call__(self, inputs: FloatArray) -> FloatArray:
        """Returns the outputs (..., O) of inputs (..., I)."""
        return np.asarray((inputs - self.mean) @ self.weights + self.offset)


def fit_ridge(training: tuple[FloatArray, FloatArray], validation: tuple[FloatArray, FloatArray]) -> Linear:
    """Returns the regression of inputs (N, I) and outputs (N, O) with the least error on ``validation``, or with the
    least regulariser if ``validation`` is empty.
    """
    mean, offset = training[0].mean(axis=0), training[1].mean(axis=0)
    inputs, outputs = training[0] - mean, training[1] - offset
    covariance, target = inputs.T @ inputs, inputs.T @ outputs
    scale = float(np.trace(covariance)) / len(covariance)
    candidates = [
        Linear(mean, np.linalg.solve(covariance + r * scale * np.eye(len(covariance)), target), offset, r)
        for r in REGULARISERS
    ]
    if not len(validation[0]):
        return candidates[0]
    return min(candidates, key=lambda candidate: float(np.mean((candidate(validation[0]) - validation[1]) ** 2)))


class Ridge:
    """Ridge regression of frames and their number on what Culling keeps, fitted to the training part of a split."""

    def __init__(self, pairs: Pairs, split: str, fr: int = BEST_FR) -> None:
        self.pairs, self.fr = pairs, fr
        parts: list[tuple[FloatArray, FloatArray, FloatArray, FloatArray]] = []
        for part in ("train", "valid"):
            numbers = pairs.split(split, part)
            culled = [self._cull_pair(k, *pairs.index[k, 2:4].tolist()) for k in numbers]
            true_frames = [np.asarray(pairs.truth(k)[2], np.float64) for k in numbers]
            inputs = np.array([x.ravel() for x in culled])
            residuals = [
                resample_frames(t, RESAMPLED) - self._interpolate_cut(x, RESAMPLED)
                for x, t in zip(culled, true_frames, strict=True)
            ]
            distances = np.array([self._measure_distances(x) for x in culled])
            counts = np.array([[float(len(t))] for t in true_frames])
            parts.append(
                (
                    inputs,
                    np.array(residuals).reshape(len(residuals), RESAMPLED * pairs.spaces[0].n_numbers),
                    distances,
                    counts,
                )
            )
        training, validation = parts
        self.frames = fit_ridge(training[:2], validation[:2])
        self.count = fit_ridge(training[2:], validation[2:])

    @property
    def n_parameters(self) -> int:
        """Number of weights and offsets."""
        return sum(regression.weights.size + regression.offset.size for regression in (self.frames, self.count))

    def fill(self, number: int, pre: int, post: int, count: int | None = None) -> FloatArray:
        """Returns the transition (n, K) of a pair at a cut; with ``count`` frames if it is given."""
        culled = self._cull_pair(number, pre, post)
        if count is None:
            count = min(max(1, round(float(self.count(self._measure_distances(culled))[0]))), MOST_FRAMES)
        frames = self.frames(culled.ravel()).reshape(RESAMPLED, -1) + self._interpolate_cut(culled, RESAMPLED)
        return resample_frames(frames, count)

    def _cull_pair(self, number: int, pre: int, post: int) -> FloatArray:
        p, q = self.pairs.index[number, :2].tolist()
        return np.asarray(cull(self.pairs.word(p), self.pairs.word(q), pre, post, self.fr)[0], np.float64)

    def _interpolate_cut(self, culled: FloatArray, count: int) -> FloatArray:
        """Returns the straight line (count, K) between the frames of the cut."""
        alpha = (np.arange(1, count + 1) / (count + 1))[:, None]
        return np.asarray((1.0 - alpha) * culled[self.fr - 1] + alpha * culled[self.fr])

    def _measure_distances(self, culled: FloatArray) -> FloatArray:
        """Returns the logarithms (J,) of the joints' distances over the cut, after the travel law of transitions."""
        displacements = (culled[self.fr] - culled[self.fr - 1]).reshape(-1, 3)
        return np.asarray(np.log2(1.0 + np.linalg.norm(displacements, axis=-1) / DISTANCE_FLOOR))


class RidgeAnswers:
    """Predicts any given positions with frames of ridge regression; a callable from a pair's number to a prediction."""

    def __init__(self, ridge: Ridge, positions: Positions) -> None:
        self.ridge, self.positions = ridge, positions

    def __call__(self, number: int) -> Prediction:
        """Returns the prediction for a pair; without frames if a position is missing."""
        pre, post = self.positions(number)
        if pre is None or post is None:
            return Prediction(pre, post, np.zeros((0, self.ridge.pairs.spaces[0].n_numbers)))
        return Prediction(pre, post, self.ridge.fill(number, pre, post))


class TrueAnswers:
    """Predicts the truth itself: the scores of ``viewed`` for a prediction without error."""

    def __init__(self, pairs: Pairs) -> None:
        self.pairs = pairs

    def __call__(self, number: int) -> Prediction:
        """Returns the true splice of a pair."""
        (pre, post, frames), rotations = self.pairs.truth(number), self.pairs.truth(number, "rotations")[2]
        return Prediction(pre, post, frames.astype(np.float64), rotations=rotations.astype(np.float64))


class DefaultAnswers:
    """Predicts the result of ``signsplice splice`` without options, which is tuned for a viewer's comfort; without the
    motion that no word owns (``splicing.person``).
    """

    def __init__(self, pairs: Pairs) -> None:
        self.pairs = pairs

    def __call__(self, number: int) -> Prediction:
        """Returns the prediction for a pair."""
        p, q = self.pairs.index[number, :2].tolist()
        words = [self.pairs.word_clip(p), self.pairs.word_clip(q)]
        result = ss.splice(words, ss.SpliceOptions(free_hand="transition", person=0.0))
        seam = result.seams[0]
        transition = next(span.output for span in result.spans if span.kind == "transition")
        return make_prediction(
            self.pairs, p, Cut(seam.pre_frame, seam.post_frame), result.clip[transition[0] : transition[1]]
        )
