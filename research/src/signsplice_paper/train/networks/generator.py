"""The base of all networks that make transition frames one after another, and decoding with them.

Start and stop tokens (eq. 15, 16): the first input is preIndexToken, and each frame comes with the logit of
postIndexToken, "this is the last frame". Eq. 15 prints a softmax over the output; here coordinates are regressed
linearly, and only the token is a probability. An input can be hidden. If all after the first are, every frame depends
only on the encoder, and all frames are made in one pass ("concurrently").
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import NamedTuple

import torch
from torch import Tensor, nn

from signsplice_paper.train.networks.layers import Normaliser

START, FRAME, HIDDEN = 0, 1, 2
"""Kinds of decoder inputs: the start token, the frame before, a hidden frame."""

State = tuple[Tensor, ...]


class Encoded(NamedTuple):
    """The outputs of an encoder.

    - tokens: logits of the position tokens (B, S, 3), None without a head for them
    - memory: tensors that the decoder attends to
    - state: the decoder's state before the first frame
    """

    tokens: Tensor | None
    memory: State
    state: State


class Generator(nn.Module, ABC):
    """A network that makes transition frames step by step.

    - concurrent: whether it can make all frames in one pass
    - marked: whether it is given the splice positions as marks on the whole X
    - feeds_own: whether half of the pairs are learned from its own frames instead of the true ones
    - normaliser: of frames
    """

    concurrent: bool
    marked: bool = False
    feeds_own: bool = False
    normaliser: Normaliser

    @abstractmethod
    def encode(self, x: Tensor, mask: Tensor, n_before: Tensor, marks: Tensor | None = None) -> Encoded:
        """Returns the encoded frames of two words.

        x (B, S, K): frames, not normalised. mask (B, S): False at padding. n_before (B,): number of frames of the first
        word. marks (B, S, 2): 1 at the frames pre and post, else 0; for a network that is ``marked``.
        """

    @abstractmethod
    def decode(
        self, fed: Tensor, kinds: Tensor, start: Tensor, memory: State, state: State
    ) -> tuple[Tensor, Tensor, State]:
        """Returns frames (B, T, K), logits (B, T) of being the last frame, and the state after them.

        fed (B, T, K): the frame before each, not normalised. kinds (B, T): kind of each input. start (): number of
        earlier frames.
        """

    def forward(
        self, x: Tensor, mask: Tensor, n_before: Tensor, fed: Tensor, kinds: Tensor, marks: Tensor | None = None
    ) -> tuple[Tensor | None, Tensor, Tensor]:
        """Returns logits of the position tokens (B, S, 3) or None, frames (B, T, K), and logits (B, T) of being the
        last, given the frame before each.
        """
        encoded = self.encode(x, mask, n_before, marks)
        return encoded.tokens, *self.decode_whole(encoded, fed, kinds)

    def decode_whole(self, encoded: Encoded, fed: Tensor, kinds: Tensor) -> tuple[Tensor, Tensor]:
        """Returns frames (B, T, K) and logits (B, T) of being the last, given the frame before each."""
        start = torch.zeros((), dtype=torch.long, device=fed.device)
        frames, last, _ = self.decode(fed, kinds, start, encoded.memory, encoded.state)
        return frames, last


@torch.no_grad()
def generate(
    network: Generator, encoded: Encoded, n_batch: int, most_frames: int, parallel: bool = False
) -> list[Tensor]:
    """Returns the frames (n, K) of each pair of a batch up to the first that is classified as the last one, at most
    ``most_frames``. ``parallel``: made in one pass, for a network that is ``concurrent``.
    """
    device = encoded.memory[0].device if encoded.memory else encoded.state[0].device
    zeros = torch.zeros(n_batch, 1, network.normaliser.n_numbers, device=device)
    if parallel:
        kinds = torch.full((n_batch, most_frames), HIDDEN, device=device)
        kinds[:, 0] = START
        fed = zeros.expand(-1, most_frames, -1)
        start = torch.zeros((), dtype=torch.long, device=device)
        generated, last, _ = network.decode(fed, kinds, start, encoded.memory, encoded.state)
    else:
        generated, last = _generate_one_by_one(network, encoded, zeros, most_frames)
    is_last = last > 0.0
    counts = torch.where(is_last.any(1), is_last.float().argmax(1) + 1, generated.shape[1]).tolist()
    return [frames[:count] for frames, count in zip(generated, counts, strict=True)]


def _generate_one_by_one(network: Generator, encoded: Encoded, fed: Tensor, most_frames: int) -> tuple[Tensor, Tensor]:
    n_batch, state = len(fed), encoded.state
    frames: list[Tensor] = []
    last_logits: list[Tensor] = []
    is_done = torch.zeros(n_batch, dtype=torch.bool, device=fed.device)
    while len(frames) < most_frames and not bool(is_done.all()):
        kinds = torch.full((n_batch, 1), FRAME if frames else START, device=fed.device)
        start = torch.tensor(len(frames), device=fed.device)
        fed, last, state = network.decode(fed, kinds, start, encoded.memory, state)
        frames.append(fed)
        last_logits.append(last)
        is_done |= last[:, 0] > 0.0
    return torch.cat(frames, dim=1), torch.cat(last_logits, dim=1)
