"""Baselines of transition frames that need no gradient: ridge regression, and answers to compare with.

Ridge regression sees what TFGN sees, fr frames on each side of the
cut, and gives the transition resampled to ``RESAMPLED`` frames, less the straight line between its ends; a second one
gives the number of frames from how far every joint has to go. Both have their weights from the normal equations, and
the regulariser with the least error on the validation part.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

import signsplice as ss
from signsplice.motion import FloatArray
from signsplice.splicing.contracts import Cut
from signsplice.splicing.lptransformer import cull
from signsplice_paper.clip_methods import prediction_of
from signsplice_paper.extra_metrics import resample_frames
from signsplice_paper.position_baselines import Positions
from signsplice_paper.prediction import Prediction
from signsplice_paper.published import BEST_FR
from signsplice_workshop.corpora.pairs import Pairs

RESAMPLED = 10
REGULARISERS = (1e-4, 1e-3, 1e-2, 1e-1, 1.0)
"""Times the mean variance of an input."""
NEAR = 0.02
"""Distance in the numbers' unit from which on the logarithm of a distance grows."""
MOST_FRAMES = 32


@dataclass(frozen=True, eq=False)
class Linear:
    """Ridge regression.

    - mean: of the inputs (I,)
    - weights: (I, O)
    - offset: mean of the outputs (O,)
    - regulariser: the one that was chosen
    """

    mean: FloatArray
    weights: FloatArray
    offset: FloatArray
    regulariser: float

    def __call__(self, inputs: FloatArray) -> FloatArray:
        """Outputs (..., O) of inputs (..., I)."""
        return np.asarray((inputs - self.mean) @ self.weights + self.offset)


def fit_ridge(taught: tuple[FloatArray, FloatArray], valid: tuple[FloatArray, FloatArray]) -> Linear:
    """The regression of inputs (N, I) and outputs (N, O) with the least error on ``valid``; the least regulariser where
    that is empty.
    """
    mean, offset = taught[0].mean(axis=0), taught[1].mean(axis=0)
    inputs, outputs = taught[0] - mean, taught[1] - offset
    covariance, target = inputs.T @ inputs, inputs.T @ outputs
    scale = float(np.trace(covariance)) / len(covariance)
    made = [
        Linear(mean, np.linalg.solve(covariance + r * scale * np.eye(len(covariance)), target), offset, r)
        for r in REGULARISERS
    ]
    if not len(valid[0]):
        return made[0]
    return min(made, key=lambda one: float(np.mean((one(valid[0]) - valid[1]) ** 2)))


class Ridge:
    """Ridge regression of frames and their number on what Culling keeps, fitted to the training part of a split."""

    def __init__(self, pairs: Pairs, split: str, fr: int = BEST_FR) -> None:
        self.pairs, self.fr = pairs, fr
        parts: list[tuple[FloatArray, FloatArray, FloatArray, FloatArray]] = []
        for part in ("train", "valid"):
            numbers = pairs.split(split, part)
            kept = [self._cull_pair(k, *pairs.index[k, 2:4].tolist()) for k in numbers]
            true = [np.asarray(pairs.truth(k)[2], np.float64) for k in numbers]
            seen = np.array([x.ravel() for x in kept])
            made = [resample_frames(t, RESAMPLED) - self._line(x, RESAMPLED) for x, t in zip(kept, true, strict=True)]
            far = np.array([self._distances(x) for x in kept])
            counts = np.array([[float(len(t))] for t in true])
            parts.append((seen, np.array(made).reshape(len(made), RESAMPLED * pairs.spaces[0].n_numbers), far, counts))
        taught, valid = parts
        self.frames = fit_ridge(taught[:2], valid[:2])
        self.count = fit_ridge(taught[2:], valid[2:])

    @property
    def n_parameters(self) -> int:
        """Number of weights and offsets."""
        return sum(one.weights.size + one.offset.size for one in (self.frames, self.count))

    def fill(self, number: int, pre: int, post: int, count: int | None = None) -> FloatArray:
        """The transition (n, K) of a pair at a cut; of ``count`` frames where that is given."""
        kept = self._cull_pair(number, pre, post)
        if count is None:
            count = min(max(1, round(float(self.count(self._distances(kept))[0]))), MOST_FRAMES)
        made = self.frames(kept.ravel()).reshape(RESAMPLED, -1) + self._line(kept, RESAMPLED)
        return resample_frames(made, count)

    def _cull_pair(self, number: int, pre: int, post: int) -> FloatArray:
        p, q = self.pairs.index[number, :2].tolist()
        return np.asarray(cull(self.pairs.word(p), self.pairs.word(q), pre, post, self.fr)[0], np.float64)

    def _line(self, kept: FloatArray, count: int) -> FloatArray:
        """The straight line (count, K) between the frames of the cut."""
        alpha = (np.arange(1, count + 1) / (count + 1))[:, None]
        return np.asarray((1.0 - alpha) * kept[self.fr - 1] + alpha * kept[self.fr])

    def _distances(self, kept: FloatArray) -> FloatArray:
        """How far every joint has to go, as logarithms, after the travel law of transitions (J,)."""
        way = (kept[self.fr] - kept[self.fr - 1]).reshape(-1, 3)
        return np.asarray(np.log2(1.0 + np.linalg.norm(way, axis=-1) / NEAR))


class RidgeAnswers:
    """Positions of any kind with the frames of ridge regression: a callable from a pair's number to a prediction."""

    def __init__(self, ridge: Ridge, positions: Positions) -> None:
        self.ridge, self.positions = ridge, positions

    def __call__(self, number: int) -> Prediction:
        """The prediction for a pair; without frames where a position is missing."""
        pre, post = self.positions(number)
        if pre is None or post is None:
            return Prediction(pre, post, np.zeros((0, self.ridge.pairs.spaces[0].n_numbers)))
        return Prediction(pre, post, self.ridge.fill(number, pre, post))


class TrueAnswers:
    """The truth itself, as a measure of what the scores of ``viewed`` are without any error."""

    def __init__(self, pairs: Pairs) -> None:
        self.pairs = pairs

    def __call__(self, number: int) -> Prediction:
        """The true splice of a pair."""
        (pre, post, frames), rotations = self.pairs.truth(number), self.pairs.truth(number, "rotations")[2]
        return Prediction(pre, post, frames.astype(np.float64), rotations=rotations.astype(np.float64))


class DefaultAnswers:
    """What ``signsplice splice`` makes of the words without any option, for a viewer's comfort."""

    def __init__(self, pairs: Pairs) -> None:
        self.pairs = pairs

    def __call__(self, number: int) -> Prediction:
        """The prediction for a pair."""
        p, q = self.pairs.index[number, :2].tolist()
        result = ss.splice([self.pairs.word_clip(p), self.pairs.word_clip(q)])
        seam = result.seams[0]
        new = next(span.output for span in result.spans if span.kind == "transition")
        return prediction_of(self.pairs, p, Cut(seam.pre_frame, seam.post_frame), result.clip[new[0] : new[1]])
