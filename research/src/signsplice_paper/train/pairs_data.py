"""Batches of a part of a corpus of pairs: padded inputs, masks, labels and true transition frames.

A batch depends only on the seed and the step. An interrupted training therefore continues with the same batches, and
several processes divide one batch without communication. Only pairs of the chosen part are read.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.utils.rnn import pad_sequence

from signsplice.signer.signer import stream
from signsplice.splicing.lptransformer import cull
from signsplice_paper.train.networks.layers import Normaliser
from signsplice_workshop.corpora.pairs import Pairs

DEVIATION_FLOOR = 0.01
"""Smallest deviation of a number, so that joints that hardly move are not amplified."""
_POOL = 8
"""Number of batches that are drawn together and sorted by length, to limit padding."""


@dataclass(frozen=True)
class Batch:
    """B pairs, with S input frames and T transition frames of K numbers.

    - numbers: the pairs' numbers (B,)
    - x: the whole X, or the culled frames (B, S, K)
    - mask: False at padding and repeated edges (B, S)
    - n_before: number of frames of ``x`` that are of the first word (B,)
    - pre: frame of ``x`` with the pre token (B,)
    - post: frame of ``x`` with the post token (B,)
    - new: true transitions (B, T, K)
    - real: False at padding of ``new`` (B, T)
    - step: the training step of the batch
    """

    numbers: Tensor
    x: Tensor
    mask: Tensor
    n_before: Tensor
    pre: Tensor
    post: Tensor
    new: Tensor
    real: Tensor
    step: int = 0

    @property
    def marks(self) -> Tensor:
        """1 at the frames pre and post of ``x``, else 0 (B, S, 2)."""
        return mark_splice(self.pre, self.post, self.x.shape[1])

    def to(self, device: torch.device) -> Batch:
        """Returns the batch on a device. The pairs' numbers stay on the processor: noise is drawn from them there."""
        tensors = {
            field.name: getattr(self, field.name) for field in fields(self) if field.name not in ("step", "numbers")
        }
        if device.type == "cuda":  # pinned memory is copied while the processor goes on
            tensors = {name: tensor.pin_memory() for name, tensor in tensors.items()}
        moved_tensors = {name: tensor.to(device, non_blocking=True) for name, tensor in tensors.items()}
        return Batch(numbers=self.numbers, **moved_tensors, step=self.step)


def mark_splice(pre: Tensor, post: Tensor, n_frames: int) -> Tensor:
    """Returns 1 at the frames ``pre`` and ``post`` (B,), else 0 (B, n_frames, 2); a negative frame has no mark."""
    frames = torch.arange(n_frames, device=pre.device)
    return (torch.stack([pre, post], dim=-1)[:, None] == frames[None, :, None]).float()


class PairsData:
    """A part of a split, with its words and transitions in memory as float32."""

    def __init__(self, pairs: Pairs, split: str, part: str, fr: int | None = None) -> None:
        self.numbers = np.array(pairs.split(split, part), dtype=np.int64)
        self.fr = fr
        self._index = np.asarray(pairs.index[self.numbers]) if len(self.numbers) else np.zeros((0, 6), np.int32)
        words = sorted(set(self._index[:, :2].ravel().tolist()))
        self._words = {word: np.array(pairs.word(word), np.float32) for word in words}
        self._new = [np.array(pairs.truth(int(number))[2], np.float32) for number in self.numbers]
        self._lengths = np.array([len(self._words[p]) + len(self._words[q]) for p, q in self._index[:, :2].tolist()])

    def __len__(self) -> int:
        return len(self.numbers)

    def normaliser(self) -> Normaliser:
        """Returns the mean and deviation of every number over the words of this part."""
        frames = np.concatenate(list(self._words.values())).astype(np.float64)
        deviation = np.maximum(frames.std(axis=0), DEVIATION_FLOOR)
        return Normaliser(torch.from_numpy(frames.mean(axis=0)).float(), torch.from_numpy(deviation).float())

    def rows(self, step: int, size: int, seed: int) -> NDArray[np.int64]:
        """Returns the rows of the batch of a step, from 0. Every pass over all pairs has a new order; pairs of a batch
        have similar lengths.
        """
        size = min(size, len(self))
        n_batches = max(1, len(self) // size)
        epoch, index = divmod(step, n_batches)
        order = stream("batches", seed, epoch).permutation(len(self))[: n_batches * size]
        if self.fr is not None:
            return order[index * size : (index + 1) * size]
        pools = [order[k : k + _POOL * size] for k in range(0, len(order), _POOL * size)]
        by_length = np.concatenate([pool[np.argsort(self._lengths[pool], kind="stable")] for pool in pools])
        batches = by_length.reshape(n_batches, size)
        return np.asarray(batches[stream("batch-order", seed, epoch).permutation(n_batches)[index]])

    def batch(self, rows: Sequence[int] | NDArray[np.int64], step: int = 0) -> Batch:
        """Returns the batch of these rows of the part."""
        index = [self._index[row].tolist() for row in rows]
        inputs, masks = [], []
        for p, q, pre, post, _, _ in index:
            before, after = self._words[p], self._words[q]
            if self.fr is None:
                frames, mask = np.concatenate([before, after]), np.ones(len(before) + len(after), bool)
            else:
                frames, mask = cull(before, after, pre, post, self.fr)
            inputs.append(torch.from_numpy(frames))
            masks.append(torch.from_numpy(mask))
        new = [torch.from_numpy(self._new[row]) for row in rows]
        if self.fr is None:
            n_before = torch.tensor([len(self._words[entry[0]]) for entry in index])
            pre, post = (
                torch.tensor([entry[2] for entry in index]),
                torch.tensor([entry[3] for entry in index]) + n_before,
            )
        else:
            n_before = torch.full((len(index),), self.fr)
            pre, post = n_before - 1, n_before
        return Batch(
            numbers=torch.from_numpy(self.numbers[np.asarray(rows)]),
            x=pad_sequence(inputs, batch_first=True),
            mask=pad_sequence(masks, batch_first=True),
            n_before=n_before,
            pre=pre,
            post=post,
            new=pad_sequence(new, batch_first=True),
            real=pad_sequence([torch.ones(len(frames), dtype=torch.bool) for frames in new], batch_first=True),
            step=step,
        )
