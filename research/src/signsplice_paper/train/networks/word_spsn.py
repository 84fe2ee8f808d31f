"""SPSN word by word: every word is read once and alone, and the partner enters as a summary.

SPSN reads both words as one sequence, so that one step teaches B pairs, and a word is learned anew beside every
partner. Here two LSTM layers run both ways over each word. Four weighted means of its states, with learned weights,
make its summary. The score of a frame as the last one kept before a partner is a bilinear form of the frame's state and
the partner's summary, and so for the first one kept after. A softmax over the word's own frames follows: there are no
tokens and no "none". One step on W words teaches up to W * W pairs.

Shapes: W words, T frames, K numbers, D width, S size of a summary.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812

from signsplice_paper.train.networks.layers import Normaliser

STEP = 5e-4
"""Step of a number from frame to frame, 1 mm on the standard body, from which on steps are read as logarithms: hands at
rest move less, hands on their way up to 60 times as much."""
LOOKS = 4
_MASKED = -1e4


@dataclass(frozen=True)
class WordSpsnConfig:
    """Sizes.

    - width: of states and embeddings
    - summary: numbers of a summary that each side reads
    - dropout: probability
    """

    width: int = 64
    summary: int = 64
    dropout: float = 0.1


class WordSpsn(nn.Module):
    """The network; ``read`` depends on one word, ``score`` on two."""

    def __init__(self, config: WordSpsnConfig, normaliser: Normaliser) -> None:
        super().__init__()
        self.config, self.normaliser = config, normaliser
        width, n_numbers = config.width, normaliser.n_numbers
        self.embedding = nn.Linear(2 * n_numbers + n_numbers // 3, width)
        self.encoder = nn.LSTM(width, width, num_layers=2, batch_first=True, bidirectional=True, dropout=config.dropout)
        self.dropout = nn.Dropout(config.dropout)
        self.look = nn.Linear(2 * width, LOOKS)
        self.summary = nn.Sequential(
            nn.Linear(2 * width * LOOKS, width),
            nn.ReLU(),
            nn.Dropout(config.dropout),
            nn.Linear(width, 2 * config.summary),
        )
        self.keys = nn.Linear(2 * width, 2 * config.summary)
        self.usual = nn.Linear(2 * width, 2)

    def features(self, x: Tensor) -> Tensor:
        """What is read of words (W, T, K): numbers, steps from the frame before, and the speed of each joint."""
        steps = torch.cat([torch.zeros_like(x[:, :1]), x[:, 1:] - x[:, :-1]], dim=1) / STEP
        speeds = torch.log1p(steps.reshape(*steps.shape[:2], -1, 3).norm(dim=-1))
        return torch.cat([self.normaliser(x), torch.asinh(steps), speeds], dim=-1)

    def read(self, x: Tensor, mask: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Keys (W, T, 2 S) and usual scores (W, T, 2) of frames, and summaries (W, 2 S), of words (W, T, K)."""
        lengths = mask.sum(1)
        packed = nn.utils.rnn.pack_padded_sequence(
            self.embedding(self.features(x)), lengths.cpu(), batch_first=True, enforce_sorted=False
        )
        states, _ = nn.utils.rnn.pad_packed_sequence(self.encoder(packed)[0], batch_first=True, total_length=x.shape[1])
        states = self.dropout(states)  # (W, T, 2 D)
        weights = self.look(states).masked_fill(~mask[..., None], _MASKED).softmax(1)
        summary = self.summary(torch.einsum("wtd,wtl->wld", states, weights).flatten(1))
        return self.keys(states), self.usual(states), summary

    def forward(self, x: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
        """Scores (W, W, T) of the frames of each word (first axis) before each partner, and (W, W, T) of the frames of
        each word (second axis) after each partner. mask (W, T): False at padding, which follows each word.
        """
        keys, usual, summary = self.read(x, mask)
        size = self.config.summary
        leave = usual[:, None, :, 0] + torch.einsum("pts,qs->pqt", keys[..., :size], summary[:, :size])
        enter = usual[None, :, :, 1] + torch.einsum("qts,ps->pqt", keys[..., size:], summary[:, size:])
        return leave.masked_fill(~mask[:, None], _MASKED), enter.masked_fill(~mask[None], _MASKED)


def position_loss(scores: tuple[Tensor, Tensor], cuts: Tensor, taught: Tensor) -> Tensor:
    """The cross-entropy () of both positions. cuts: (W, W, 2); taught: pairs (W, W) that count."""
    leave, enter = (side[taught] for side in scores)
    pre, post = cuts[taught].unbind(-1)
    return F.cross_entropy(leave, pre) + F.cross_entropy(enter, post)
