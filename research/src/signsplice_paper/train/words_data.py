"""Words of a corpus of pairs, to teach all pairs of the same signer in one step.

A batch depends only on seed and step, as in ``pairs_data``. In a corpus whose truth can be read, any pair of a signer's
words has a cut, which follows from their cards; in others only the pairs of a split have one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.utils.rnn import pad_sequence

from signsplice.signer.signer import stream
from signsplice_paper.train.networks.layers import Normaliser
from signsplice_paper.train.pairs_data import DEVIATION_FLOOR
from signsplice_workshop.corpora import readable, readable_pairs
from signsplice_workshop.corpora.pairs import Pairs

Cuts = Callable[[int, int], tuple[int, int] | None]
"""Numbers of two words -> pre and post; None for a pair that is not taught."""


@dataclass(frozen=True)
class WordBatch:
    """A batch of W words.

    - x: numbers (W, T, K)
    - mask: False at padding (W, T)
    - cuts: pre and post of every pair (W, W, 2), each a frame of its word
    - taught: True at the pairs that count (W, W)
    """

    x: Tensor
    mask: Tensor
    cuts: Tensor
    taught: Tensor

    def to(self, device: torch.device) -> WordBatch:
        """Returns the same batch on a device."""
        return WordBatch(*(getattr(self, field.name).to(device) for field in fields(self)))


class WordsData:
    """The words of several signers, in memory. Rows number the words, signer by signer.

    - words: the numbers (T, K) of each row
    """

    def __init__(self, pairs: Pairs, signers: Sequence[Sequence[int]], cuts: Cuts) -> None:
        self.numbers = [word for words in signers for word in words]
        self.words = [torch.from_numpy(np.array(pairs.word(word), np.float32)) for word in self.numbers]
        self._cuts = cuts
        self._sizes = np.array([len(words) for words in signers])

    def __len__(self) -> int:
        return len(self.numbers)

    def normaliser(self) -> Normaliser:
        """Returns the mean and deviation of every number over all words."""
        frames = torch.cat(self.words).double()
        deviation = frames.std(0, unbiased=False).clamp(min=DEVIATION_FLOOR)
        return Normaliser(frames.mean(0).float(), deviation.float())

    def rows(self, step: int, size: int, seed: int) -> NDArray[np.int64]:
        """Returns the rows of ``size`` words of one signer, or of all its words if it has fewer."""
        rng = stream("word-batches", seed, step)
        signer = rng.choice(len(self._sizes), p=self._sizes / self._sizes.sum())
        rows = rng.permutation(self._sizes[signer])[:size] + self._sizes[:signer].sum()
        return np.asarray(rows, np.int64)

    def pair_cut(self, p: int, q: int) -> tuple[int, int] | None:
        """Returns pre and post of the words in two rows; None for a pair that is not taught."""
        return self._cuts(self.numbers[p], self.numbers[q])

    def batch(self, rows: Sequence[int] | NDArray[np.int64], step: int = 0) -> WordBatch:
        """Returns the batch of the words in these rows."""
        words = [self.words[row] for row in rows]
        cuts = [[self.pair_cut(p, q) for q in rows] for p in rows]
        mask = pad_sequence([torch.ones(len(word), dtype=torch.bool) for word in words], batch_first=True)
        return WordBatch(
            x=pad_sequence(words, batch_first=True),
            mask=mask,
            cuts=torch.tensor([[cut or (0, 0) for cut in row] for row in cuts]),
            taught=torch.tensor([[cut is not None for cut in row] for row in cuts]),
        )


def load_split_words(pairs: Pairs, split: str, part: str) -> WordsData:
    """Returns the words of a part of a split, with the cuts of its pairs. A corpus to teach on gives the cuts of any
    two words of a signer.
    """
    index = pairs.index[pairs.split(split, part)].tolist()
    cuts = {(p, q): (pre, post) for p, q, pre, post, _, _ in index}
    signers: dict[int, set[int]] = {}
    for p, q in cuts:
        signers.setdefault(pairs.signer(p), set()).update((p, q))
    words = [sorted(signers[k]) for k in sorted(signers)]
    if split == readable_pairs.TAUGHT:
        return load_card_words(pairs, words)
    return WordsData(pairs, words, lambda p, q: cuts.get((p, q)))


def load_card_words(
    pairs: Pairs, signers: Sequence[Sequence[int]], held_back: frozenset[tuple[int, int]] = frozenset()
) -> WordsData:
    """Returns words of a corpus whose truth can be read, by signer. All pairs but ``held_back`` have a cut."""
    cards = {k: readable.Card(**pairs.head["words"][k]["card"]) for words in signers for k in words}

    def pair_cut(p: int, q: int) -> tuple[int, int] | None:
        return (
            None
            if (p, q) in held_back
            else (readable.find_leave_frame(cards[p], cards[q]), readable.find_enter_frame(cards[p], cards[q]))
        )

    return WordsData(pairs, signers, pair_cut)
