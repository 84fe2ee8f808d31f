"""LSTM, one of the systems that the paper compares with: sequence to sequence without attention.

One encoder reads X. One decoder starts from the encoder's last state, through a learned linear layer, and does both
jobs with the same weights: it reads X again and classifies every frame as {none, pre, post}, and it makes frames from
the start token on, without differences between frames. All information about the words passes through that one state.
"""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812

from signsplice.train.paper.networks.generator import FRAME, Encoded, Generator, State
from signsplice.train.paper.networks.layers import N_NUMBERS, N_READ, Normaliser, with_deltas
from signsplice.train.paper.networks.recurrent import Lstm
from signsplice.train.paper.networks.spsn import admissible, last_states


@dataclass(frozen=True)
class LstmConfig:
    """Sizes.

    - width: of states and embeddings
    """

    width: int = 512


class LstmSeq2Seq(Generator):
    """Encoder and decoder LSTM."""

    n_fed = N_NUMBERS
    concurrent = False

    def __init__(self, config: LstmConfig, normaliser: Normaliser) -> None:
        super().__init__()
        self.config, self.normaliser = config, normaliser
        width = config.width
        self.embedding = nn.Linear(N_READ, width)
        self.encoder, self.decoder = Lstm(width, width), Lstm(width, width)
        self.bridge = nn.Linear(width, 2 * width)
        self.kind = nn.Embedding(3, width)
        self.token, self.frame, self.last = nn.Linear(width, 3), nn.Linear(width, N_NUMBERS), nn.Linear(width, 1)

    def encode(self, x: Tensor, mask: Tensor, n_before: Tensor) -> Encoded:
        """Memory: none. State: the decoder's hidden and cell state (1, B, D)."""
        x = self.embedding(with_deltas(self.normaliser(x), n_before))
        hidden, cell = self.bridge(last_states(self.encoder(x)[0], mask)).chunk(2, dim=-1)
        state = (hidden.tanh()[None].contiguous(), cell[None].contiguous())
        states, _ = self.decoder(x, state)
        return Encoded(admissible(self.token(states), n_before), (), state)

    def decode(
        self, fed: Tensor, kinds: Tensor, start: Tensor, memory: State, state: State
    ) -> tuple[Tensor, Tensor, State]:
        """Frames, logits of the last frame, and the decoder's state."""
        shown = (kinds == FRAME)[..., None].to(fed.dtype)
        inputs = self.kind(kinds) + shown * self.embedding(F.pad(self.normaliser(fed), (0, N_NUMBERS)))
        states, (hidden, cell) = self.decoder(inputs, (state[0], state[1]))
        return self.normaliser.inverse(self.frame(states)), self.last(states)[..., 0], (hidden, cell)
