"""ConvS2S (Gehring et al. 2017 [18]), the paper's first rival: 20 + 20 convolutional layers of width 3.

Encoder: frames and learned positions, then layers of convolution, gated linear unit and residual path, scaled by
sqrt(0.5); a linear layer on its states classifies every frame of X. Decoder: the same layers, causal, each followed by
attention to the encoder, whose values are its states plus its inputs. Weights begin as the original's do (spread
sqrt(4 p / n), inputs embedded with a spread of 0.1: gated units keep the size of small states, and of larger ones
double their variance, layer on layer), without its weight normalisation.

After 20 layers of width 3 a frame's state has seen 20 frames to either side and no more, so that at the end of one word
little is known of the other: a limit of the architecture that the paper chose, left as it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812

from signsplice.train.paper.networks.generator import FRAME, Encoded, Generator, State
from signsplice.train.paper.networks.layers import N_NUMBERS, N_READ, Normaliser, with_steps
from signsplice.train.paper.networks.spsn import admissible

_KERNEL = 3
_HALF = 0.5**0.5
_SPREAD = 0.1


@dataclass(frozen=True)
class ConvS2SConfig:
    """Sizes; ``most_positions`` learned positions, the last of them for all frames beyond."""

    width: int = 512
    n_encoder_layers: int = 20
    n_decoder_layers: int = 20
    dropout: float = 0.1
    most_positions: int = 512


def _linear(n_in: int, n_out: int, spread: float = 1.0) -> nn.Linear:
    """A layer whose outputs begin with a spread, where its inputs have 1."""
    layer = nn.Linear(n_in, n_out)
    nn.init.normal_(layer.weight, std=spread * n_in**-0.5)
    nn.init.zeros_(layer.bias)
    return layer


class GatedConvolution(nn.Module):
    """Convolution over frames and gated linear unit, (B, S + 2, D) -> (B, S, D)."""

    def __init__(self, width: int, dropout: float) -> None:
        super().__init__()
        self.convolution = nn.Conv1d(width, 2 * width, _KERNEL)
        self.dropout = nn.Dropout(dropout)
        nn.init.normal_(self.convolution.weight, std=(4.0 * (1.0 - dropout) / (_KERNEL * width)) ** 0.5)
        if self.convolution.bias is not None:
            nn.init.zeros_(self.convolution.bias)

    def forward(self, x: Tensor) -> Tensor:
        """States (B, S, D) of inputs with a frame more at either end, or two before."""
        return F.glu(self.convolution(self.dropout(x).transpose(1, 2)), dim=1).transpose(1, 2)


class ConvS2S(Generator):
    """Encoder and decoder of gated convolutions."""

    n_fed = N_NUMBERS
    concurrent = False

    def __init__(self, config: ConvS2SConfig, normaliser: Normaliser) -> None:
        super().__init__()
        self.config, self.normaliser = config, normaliser
        width = config.width
        self.embedding, self.positions = _linear(N_READ, width, _SPREAD), nn.Embedding(config.most_positions, width)
        self.encoder = nn.ModuleList(GatedConvolution(width, config.dropout) for _ in range(config.n_encoder_layers))
        self.token = _linear(width, 3)
        self.kind, self.fed = nn.Embedding(3, width), _linear(N_NUMBERS, width, _SPREAD)
        self.decoder = nn.ModuleList(GatedConvolution(width, config.dropout) for _ in range(config.n_decoder_layers))
        self.queries = nn.ModuleList(_linear(width, width) for _ in range(config.n_decoder_layers))
        self.read = nn.ModuleList(_linear(width, width) for _ in range(config.n_decoder_layers))
        self.frame, self.last = _linear(width, N_NUMBERS), _linear(width, 1)
        for table in (self.positions, self.kind):
            nn.init.normal_(table.weight, std=_SPREAD)

    def _placed(self, x: Tensor, start: Tensor | int) -> Tensor:
        """With the code of each frame's position added."""
        at = (start + torch.arange(x.shape[1], device=x.device)).clamp(max=self.config.most_positions - 1)
        placed: Tensor = x + self.positions(at)
        return placed

    def encode(self, x: Tensor, mask: Tensor, n_before: Tensor) -> Encoded:
        """Memory: mask (B, S), keys and values (B, S, D). State: the last two inputs (B, 2, D) of every layer."""
        real = mask[..., None].to(x.dtype)
        inputs = self._placed(self.embedding(with_steps(self.normaliser(x), n_before)), 0) * real
        states = inputs
        for layer in self.encoder:
            states = (states + layer(F.pad(states, (0, 0, 1, 1)))) * _HALF * real
        tokens = admissible(self.token(states), n_before)
        nothing = x.new_zeros(x.shape[0], _KERNEL - 1, self.config.width)
        return Encoded(tokens, (mask, states, (states + inputs) * _HALF), (nothing,) * len(self.decoder))

    def decode(
        self, fed: Tensor, kinds: Tensor, start: Tensor, memory: State, state: State
    ) -> tuple[Tensor, Tensor, State]:
        """Frames, last-logits and each layer's last two inputs."""
        mask, keys, values = memory
        shown = (kinds == FRAME)[..., None].to(fed.dtype)
        target = self._placed(self.kind(kinds) + shown * self.fed(self.normaliser(fed)), start)
        x, after = target, []
        for layer, query, value, past in zip(self.decoder, self.queries, self.read, state, strict=True):
            window = torch.cat([past, x], dim=1)
            after.append(window[:, -(_KERNEL - 1) :])
            made = layer(window)
            looking = (query(made) + target) * _HALF
            weights = (looking @ keys.transpose(1, 2)).masked_fill(~mask[:, None], -torch.inf).softmax(-1)
            made = (made + value(weights @ values)) * _HALF
            x = (x + made) * _HALF
        return self.normaliser.inverse(self.frame(x)), self.last(x)[..., 0], tuple(after)
