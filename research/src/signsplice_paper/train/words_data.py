"""Words of a corpus whose truth can be read, to teach all pairs of the same signer from their cards alone.

A batch depends only on seed and step, as in ``pairs_data``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn.utils.rnn import pad_sequence

from signsplice.signer.signer import stream
from signsplice_paper.train.networks.layers import Normaliser
from signsplice_paper.train.pairs_data import DEVIATION_FLOOR
from signsplice_workshop.corpora import readable
from signsplice_workshop.corpora.pairs import Pairs


@dataclass(frozen=True)
class WordBatch:
    """W words of one signer.

    - x: numbers (W, T, K)
    - mask: False at padding (W, T)
    - cuts: pre and post of every pair (W, W, 2), each a frame of its word
    - taught: pairs that count (W, W)
    """

    x: Tensor
    mask: Tensor
    cuts: Tensor
    taught: Tensor


class WordsData:
    """Words by signer, in memory.

    - signers: for each signer the numbers of its words
    - held_back: pairs of words that no batch counts
    """

    def __init__(
        self, pairs: Pairs, signers: Sequence[Sequence[int]], held_back: frozenset[tuple[int, int]] = frozenset()
    ) -> None:
        self.signers = [list(words) for words in signers]
        self.held_back = held_back
        numbers = [word for words in self.signers for word in words]
        self.words = {word: torch.from_numpy(np.array(pairs.word(word), np.float32)) for word in numbers}
        self.cards = {word: readable.Card(**pairs.head["words"][word]["card"]) for word in numbers}
        self._sizes = np.array([len(words) for words in self.signers], np.float64)

    def normaliser(self) -> Normaliser:
        """The mean and deviation of every number over all words."""
        frames = torch.cat(list(self.words.values())).double()
        deviation = frames.std(0, unbiased=False).clamp(min=DEVIATION_FLOOR)
        return Normaliser(frames.mean(0).float(), deviation.float())

    def pick(self, step: int, size: int, seed: int) -> list[int]:
        """Numbers of ``size`` words of a signer, or of all that it has."""
        rng = stream("word-batches", seed, step)
        words = self.signers[rng.choice(len(self.signers), p=self._sizes / self._sizes.sum())]
        return [words[k] for k in rng.permutation(len(words))[:size]]

    def batch(self, numbers: Sequence[int]) -> WordBatch:
        """The batch of these words, which are of one signer."""
        words = [self.words[number] for number in numbers]
        cards = [self.cards[number] for number in numbers]
        cuts = [[(readable.leave(p, q), readable.enter(p, q)) for q in cards] for p in cards]
        taught = [[(p, q) not in self.held_back for q in numbers] for p in numbers]
        mask = pad_sequence([torch.ones(len(word), dtype=torch.bool) for word in words], batch_first=True)
        return WordBatch(pad_sequence(words, batch_first=True), mask, torch.tensor(cuts), torch.tensor(taught))
