"""TFGN (eq. 12-16), and the network of the same design: the paper's Transformer.

* TFGN: encoder over the culled frames X_c, decoder for the transition frames. With Culling the positions lie in the
  middle of X_c. Without it (the ablation WC) the encoder reads all of X, with the positions of SPSN as marks on two
  frames: without marks its frames could not depend on SPSN, and WC would equal WAC. It reads frames alone, as printed.
* Transformer: the same over all of X, without marks, with differences beside the frames; a linear layer on the
  encoder's states classifies every frame as {none, pre, post}: one network and one loss for both jobs, which the paper
  does not specify.

Decoding is causal both one by one with a key-value cache and all at once with hidden inputs, so that a frame does not
depend on how many come after it.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from signsplice_paper.train.networks.generator import FRAME, Encoded, Generator, State
from signsplice_paper.train.networks.layers import (
    DecoderLayer,
    Encoder,
    Normaliser,
    append_deltas,
    causal_mask,
    positional_encoding,
)
from signsplice_paper.train.networks.spsn import mask_impossible_tokens


@dataclass(frozen=True)
class TransformerConfig:
    """Sizes and design.

    - width: of states
    - n_heads: attention heads
    - n_encoder_layers: number of encoder layers
    - n_decoder_layers: number of decoder layers
    - inner: width of the feed-forward layers
    - dropout: probability
    - tokens: whether it has a head for positions
    - steps: whether it reads differences between frames beside the frames
    - marks: whether it is given the splice positions as marks on two frames
    """

    width: int = 512
    n_heads: int = 8
    n_encoder_layers: int = 6
    n_decoder_layers: int = 6
    inner: int = 2048
    dropout: float = 0.1
    tokens: bool = False
    steps: bool = False
    marks: bool = False


class Transformer(Generator):
    """Encoder and decoder of attention layers."""

    concurrent = True

    def __init__(self, config: TransformerConfig, normaliser: Normaliser) -> None:
        super().__init__()
        self.config, self.normaliser = config, normaliser
        self.marked = config.marks
        n_numbers = normaliser.n_numbers
        width, sizes = config.width, (config.width, config.n_heads)
        n_read = (1 + config.steps) * n_numbers + 2 * config.marks
        self.encoder = Encoder(n_read, *sizes, config.n_encoder_layers, config.inner, config.dropout)
        self.kind = nn.Embedding(3, width)
        self.embedding = nn.Linear(n_numbers, width)
        self.layers = nn.ModuleList(
            DecoderLayer(*sizes, config.inner, config.dropout) for _ in range(config.n_decoder_layers)
        )
        self.norm = nn.LayerNorm(width)
        self.frame = nn.Linear(width, n_numbers)
        self.last = nn.Linear(width, 1)
        if config.tokens:
            self.token = nn.Linear(width, 3)

    def encode(self, x: Tensor, mask: Tensor, n_before: Tensor, marks: Tensor | None = None) -> Encoded:
        """Encodes the input. Memory: mask (B, S), then keys and values (B, H, S, D / H) of each decoder layer. State:
        empty caches.
        """
        x = self.normaliser(x)
        if self.config.steps:
            x = append_deltas(x, n_before)
        if self.marked:
            assert marks is not None
            x = torch.cat([x, marks.to(x.dtype)], dim=-1)
        states = self.encoder(x, mask)
        tokens = mask_impossible_tokens(self.token(states), n_before) if self.config.tokens else None
        memory = [mask]
        state = []
        for layer in self.layers:
            assert isinstance(layer, DecoderLayer)
            keys_values = layer.cross.keys_values(states)
            memory += keys_values
            state += [part[:, :, :0] for part in keys_values]
        return Encoded(tokens, tuple(memory), tuple(state))

    def decode(
        self, fed: Tensor, kinds: Tensor, start: Tensor, memory: State, state: State
    ) -> tuple[Tensor, Tensor, State]:
        """Returns frames, logits of the last frame, and extended caches."""
        is_shown = (kinds == FRAME)[..., None].to(fed.dtype)
        x = self.kind(kinds) + is_shown * self.embedding(self.normaliser(fed))
        n_new, n_past = fed.shape[1], state[0].shape[2]
        positions = start + torch.arange(n_new, device=fed.device)
        x = x + positional_encoding(positions, x.shape[-1]).to(x.dtype)
        self_allowed, cross_allowed = causal_mask(n_new, n_past, fed.device), memory[0][:, None, None, :]
        caches: list[Tensor] = []
        for k, layer in enumerate(self.layers):
            cross = (memory[2 * k + 1], memory[2 * k + 2])
            x, cache = layer(x, (state[2 * k], state[2 * k + 1]), cross, self_allowed, cross_allowed)
            caches += cache
        x = self.norm(x)
        return self.normaliser.inverse(self.frame(x)), self.last(x)[..., 0], tuple(caches)
