"""LSTM, one of the systems that the paper compares with: sequence to sequence without attention.

One encoder reads X. One decoder does both jobs with the same weights: it reads X again and classifies every frame as
{none, pre, post}, and it makes frames from the start token on, without differences between frames. A learned linear
layer maps the encoder's states at the ends of both words, H_N and H_{N+M}, to the decoder's first state and to a
summary that the decoder reads with every frame (Cho et al. 2014), as in SPSN: with the first state alone its frames
begin elsewhere than the first word ends. All information about the words passes through these two states.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812

from signsplice_paper.train.networks.generator import FRAME, Encoded, Generator, State
from signsplice_paper.train.networks.layers import Normaliser, append_deltas
from signsplice_paper.train.networks.recurrent import Lstm
from signsplice_paper.train.networks.spsn import mask_impossible_tokens, take_end_states


@dataclass(frozen=True)
class LstmConfig:
    """Sizes.

    - width: of states and embeddings
    """

    width: int = 512


class LstmSeq2Seq(Generator):
    """Encoder and decoder LSTM."""

    concurrent = False
    feeds_own = True

    def __init__(self, config: LstmConfig, normaliser: Normaliser) -> None:
        super().__init__()
        self.config, self.normaliser = config, normaliser
        width, n_numbers = config.width, normaliser.n_numbers
        self.embedding = nn.Linear(2 * n_numbers, width)
        self.encoder, self.decoder = Lstm(width, width), Lstm(2 * width, width)
        self.bridge = nn.Linear(2 * width, 3 * width)
        self.kind = nn.Embedding(3, width)
        self.token, self.frame, self.last = nn.Linear(width, 3), nn.Linear(width, n_numbers), nn.Linear(width, 1)

    def encode(self, x: Tensor, mask: Tensor, n_before: Tensor, marks: Tensor | None = None) -> Encoded:
        """Encodes the input. Memory: the summary (B, D). State: the decoder's hidden and cell state (1, B, D)."""
        x = self.embedding(append_deltas(self.normaliser(x), n_before))
        hidden, cell, summary = self.bridge(take_end_states(self.encoder(x)[0], n_before, mask)).chunk(3, dim=-1)
        summary = summary.tanh()
        state = (hidden.tanh()[None].contiguous(), cell[None].contiguous())
        states, _ = self.decoder(_append_summary(x, summary), state)
        return Encoded(mask_impossible_tokens(self.token(states), n_before), (summary,), state)

    def decode(
        self, fed: Tensor, kinds: Tensor, start: Tensor, memory: State, state: State
    ) -> tuple[Tensor, Tensor, State]:
        """Returns frames, logits of the last frame, and the decoder's state."""
        is_shown = (kinds == FRAME)[..., None].to(fed.dtype)
        inputs = self.kind(kinds) + is_shown * self.embedding(
            F.pad(self.normaliser(fed), (0, self.normaliser.n_numbers))
        )
        states, (hidden, cell) = self.decoder(_append_summary(inputs, memory[0]), (state[0], state[1]))
        return self.normaliser.inverse(self.frame(states)), self.last(states)[..., 0], (hidden, cell)


def _append_summary(x: Tensor, summary: Tensor) -> Tensor:
    """Returns inputs (B, T, 2 D): x (B, T, D), and the summary (B, D) with every frame."""
    return torch.cat([x, summary[:, None].expand(-1, x.shape[1], -1)], dim=-1)
