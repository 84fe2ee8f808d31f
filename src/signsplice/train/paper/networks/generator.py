"""What every network that makes transition frames one after another is, and how frames are drawn from it.

Start and stop tokens (eq. 15, 16): the first input is preIndexToken, and each frame comes with the logit of
postIndexToken, "this is the last one". Eq. 15 prints a softmax over the output; coordinates are regressed linearly, and
only the token is a probability. An input can also be hidden: where all of them are, every frame depends on the encoder
alone, and all frames come out in one pass ("concurrently").
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import NamedTuple

import torch
from torch import Tensor, nn

START, FRAME, HIDDEN = 0, 1, 2
"""Kinds of decoder inputs: the start token, the frame before, a frame that is not shown."""

State = tuple[Tensor, ...]


class Encoded(NamedTuple):
    """What an encoder hands on: logits of the tokens where the network gives them (B, S, 3), what the decoder looks at,
    and the decoder's state before the first frame.
    """

    tokens: Tensor | None
    memory: State
    state: State


class Generator(nn.Module, ABC):
    """A network that puts out transition frames step by step; ``n_fed`` numbers of a frame are fed back."""

    n_fed: int
    concurrent: bool
    """Whether it can put out all frames in one pass."""

    @abstractmethod
    def encode(self, x: Tensor, mask: Tensor, n_before: Tensor) -> Encoded:
        """The input (B, S, 159), raw; ``mask`` (B, S) False at padding; ``n_before`` (B,) frames are of the first
        word.
        """

    @abstractmethod
    def decode(
        self, fed: Tensor, kinds: Tensor, start: Tensor, memory: State, state: State
    ) -> tuple[Tensor, Tensor, State]:
        """Frames (B, T, n_fed), logits (B, T) of being the last one, and the state after them.

        fed (B, T, n_fed): the frame before each, raw; kinds (B, T); start (): how many frames came before these.
        """

    def forward(
        self, x: Tensor, mask: Tensor, n_before: Tensor, fed: Tensor, kinds: Tensor
    ) -> tuple[Tensor | None, Tensor, Tensor]:
        """Tokens, frames and last-logits of whole sequences, the true frames before being given."""
        encoded = self.encode(x, mask, n_before)
        start = torch.zeros((), dtype=torch.long, device=x.device)
        made, last, _ = self.decode(fed, kinds, start, encoded.memory, encoded.state)
        return encoded.tokens, made, last


@torch.no_grad()
def generate(network: Generator, encoded: Encoded, n_batch: int, most: int, parallel: bool = False) -> list[Tensor]:
    """Frames (n, 159) of each of a batch, up to and with the first that is called the last one; at most ``most``."""
    device = encoded.memory[0].device if encoded.memory else encoded.state[0].device
    zero = torch.zeros(n_batch, 1, network.n_fed, device=device)
    if parallel:
        kinds = torch.full((n_batch, most), HIDDEN, device=device)
        kinds[:, 0] = START
        fed = zero.expand(-1, most, -1)
        start = torch.zeros((), dtype=torch.long, device=device)
        made, last, _ = network.decode(fed, kinds, start, encoded.memory, encoded.state)
    else:
        made, last = _one_by_one(network, encoded, zero, most)
    ended = last > 0.0
    counts = torch.where(ended.any(1), ended.float().argmax(1) + 1, made.shape[1]).tolist()
    return [frames[:count, :159] for frames, count in zip(made, counts, strict=True)]


def _one_by_one(network: Generator, encoded: Encoded, fed: Tensor, most: int) -> tuple[Tensor, Tensor]:
    n_batch, state = len(fed), encoded.state
    frames: list[Tensor] = []
    ends: list[Tensor] = []
    done = torch.zeros(n_batch, dtype=torch.bool, device=fed.device)
    while len(frames) < most and not bool(done.all()):
        kinds = torch.full((n_batch, 1), FRAME if frames else START, device=fed.device)
        start = torch.tensor(len(frames), device=fed.device)
        fed, last, state = network.decode(fed, kinds, start, encoded.memory, state)
        frames.append(fed)
        ends.append(last)
        done |= last[:, 0] > 0.0
    return torch.cat(frames, dim=1), torch.cat(ends, dim=1)
