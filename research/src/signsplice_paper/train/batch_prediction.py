"""Predictions of a whole system for many pairs at once, by torch: positions, Culling there, and frames.

They equal those of the exported system (``systems``), which predicts one pair at a time.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn.utils.rnn import pad_sequence

from signsplice.splicing.lptransformer import cull, splice_positions
from signsplice_paper.prediction import Prediction
from signsplice_paper.train.networks.generator import generate
from signsplice_paper.train.pairs_data import mark_splice
from signsplice_paper.train.tasks import MOST_FRAMES

Frames = NDArray[np.float32]
Words = tuple[Frames, Frames]
"""The frames (N, K) and (M, K) of the two words of a pair."""
Positions = tuple[int | None, int | None]
Answer = TypeVar("Answer")
BATCH = 64


@dataclass(frozen=True)
class BatchPredictor:
    """The networks of a system, in evaluation mode and on one device.

    - networks: the one for positions, if it is separate, then the one for frames
    - fr: frames that Culling keeps on each side, None without Culling
    - token_bias: added to the logits of both tokens
    """

    networks: Sequence[nn.Module]
    fr: int | None
    token_bias: float

    def predict(self, pairs: Sequence[Words]) -> list[Prediction]:
        """Returns the predictions, in order."""
        return self._answer_in_batches(self._predict_batch, pairs)

    def predict_positions(self, pairs: Sequence[Words]) -> list[Positions]:
        """Returns the positions alone, in order."""
        return self._answer_in_batches(self._predict_positions, pairs)

    @torch.no_grad()
    def _answer_in_batches(
        self, answer_batch: Callable[[Sequence[Words]], list[Answer]], pairs: Sequence[Words]
    ) -> list[Answer]:
        """Returns answers for pairs, in order. Pairs of similar length are computed together."""
        order = np.argsort([len(before) + len(after) for before, after in pairs], kind="stable").tolist()
        answers: dict[int, Answer] = {}
        for first in range(0, len(order), BATCH):
            chosen = order[first : first + BATCH]
            answers |= zip(chosen, answer_batch([pairs[k] for k in chosen]), strict=True)
        return [answers[k] for k in range(len(pairs))]

    def _predict_positions(self, pairs: Sequence[Words]) -> list[Positions]:
        x, mask, n_before = self._pad_pairs(pairs)
        network: Any = self.networks[0]
        is_one_network = len(self.networks) == 1
        return self._find_positions(
            network.encode(x, mask, n_before).tokens if is_one_network else network(x, n_before, mask), pairs
        )

    def _predict_batch(self, pairs: Sequence[Words]) -> list[Prediction]:
        x, mask, n_before = self._pad_pairs(pairs)
        generator: Any = self.networks[-1]
        if len(self.networks) == 1:
            encoded = generator.encode(x, mask, n_before)
            positions = self._find_positions(encoded.tokens, pairs)
            transitions = generate(generator, encoded, len(pairs), MOST_FRAMES, parallel=generator.concurrent)
            return [_to_prediction(p, frames) for p, frames in zip(positions, transitions, strict=True)]
        positions = self._find_positions(self.networks[0](x, n_before, mask), pairs)
        if self.fr is None:
            marks = self._mark_positions(pairs, positions, x.shape[1]) if generator.marked else None
            encoded = generator.encode(x, mask, n_before, marks)
            transitions = generate(generator, encoded, len(pairs), MOST_FRAMES, parallel=generator.concurrent)
            return [_to_prediction(p, frames) for p, frames in zip(positions, transitions, strict=True)]
        return self._predict_with_culling(pairs, positions)

    def _predict_with_culling(self, pairs: Sequence[Words], positions: Sequence[Positions]) -> list[Prediction]:
        """Returns predictions from culled frames; without frames if a position is missing."""
        predictions = [Prediction(*p, np.zeros((0, pairs[0][0].shape[1]))) for p in positions]
        inputs = {
            k: cull(*words, pre, post, self.fr)
            for k, (words, (pre, post)) in enumerate(zip(pairs, positions, strict=True))
            if pre is not None and post is not None and self.fr is not None
        }
        if inputs:
            x = torch.from_numpy(np.stack([frames for frames, _ in inputs.values()])).to(self._device)
            mask = torch.from_numpy(np.stack([is_real for _, is_real in inputs.values()])).to(self._device)
            for k, frames in zip(inputs, self._generate_transitions(x, mask), strict=True):
                predictions[k] = _to_prediction(positions[k], frames)
        return predictions

    def _generate_transitions(self, x: Tensor, mask: Tensor) -> list[Tensor]:
        """Returns the transitions (n, K) of culled frames (B, 2 fr, K)."""
        network: Any = self.networks[-1]
        n_before = torch.full((len(x),), self.fr or 0, device=x.device)
        encoded = network.encode(x, mask, n_before)
        return generate(network, encoded, len(x), MOST_FRAMES, parallel=network.concurrent)

    def _pad_pairs(self, pairs: Sequence[Words]) -> tuple[Tensor, Tensor, Tensor]:
        """Returns X (B, S, K) of each pair, False at its padding (B, S), and the number of frames of the first word
        (B,).
        """
        x = [torch.from_numpy(np.concatenate(words)) for words in pairs]
        mask = [torch.ones(len(frames), dtype=torch.bool) for frames in x]
        n_before = torch.tensor([len(before) for before, _ in pairs])
        padded = (pad_sequence(x, batch_first=True), pad_sequence(mask, batch_first=True), n_before)
        return padded[0].to(self._device), padded[1].to(self._device), padded[2].to(self._device)

    def _mark_positions(self, pairs: Sequence[Words], positions: Sequence[Positions], n_frames: int) -> Tensor:
        """Returns marks (B, n_frames, 2) of the positions in X; a missing position has none."""
        pre = [-1 if p is None else p for p, _ in positions]
        post = [-1 if q is None else len(before) + q for (before, _), (_, q) in zip(pairs, positions, strict=True)]
        return mark_splice(torch.tensor(pre), torch.tensor(post), n_frames).to(self._device)

    def _find_positions(self, logits: Tensor, pairs: Sequence[Words]) -> list[Positions]:
        rows = logits.float().cpu().numpy()
        return [
            splice_positions(row[: len(before) + len(after)], len(before), self.token_bias)
            for row, (before, after) in zip(rows, pairs, strict=True)
        ]

    @property
    def _device(self) -> torch.device:
        return next(self.networks[0].parameters()).device


def _to_prediction(positions: Positions, frames: Tensor) -> Prediction:
    return Prediction(*positions, frames.double().cpu().numpy())
