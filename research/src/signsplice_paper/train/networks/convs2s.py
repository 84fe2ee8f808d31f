"""ConvS2S (Gehring et al. 2017 [18]), one of the systems that the paper compares with: 20 + 20 layers of width 3.

Encoder: frames and learned positions, then layers of convolution, gated linear unit and residual connection, scaled by
sqrt(0.5). Decoder: the same layers, causal, each followed by attention to the encoder, whose values are its states plus
its inputs. It does both jobs with the same weights: it reads X again and classifies every frame of it, and it makes the
transition frames from the start token on.

Weights are initialised as in the original, with a deviation of sqrt(4 p / n) for n inputs of which dropout keeps the
fraction p, and inputs with a deviation of 0.1. As in the original, all weights but those of tables are normalised: the
length of an output's weights is a number of its own, so that a step of Adam changes it by no more than the rate.
Without that, it can change by the rate times the root of their number; gated units double the variance of large states
in every layer, and trainings diverged. The original takes its inputs from a table; ours come from a linear layer, whose
output is multiplied by 0.1. As in the original, the gradient that reaches the encoder through attention is divided by
twice the number of attending layers.

After 20 layers of width 3 a state of the encoder depends on only 20 frames to either side. Through attention the
decoder knows both words at every frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812
from torch.nn.utils.parametrizations import weight_norm

from signsplice_paper.train.networks.generator import FRAME, Encoded, Generator, State
from signsplice_paper.train.networks.layers import Normaliser, append_deltas
from signsplice_paper.train.networks.spsn import mask_impossible_tokens

_KERNEL = 3
_SQRT_HALF = 0.5**0.5
_INPUT_DEVIATION = 0.1


@dataclass(frozen=True)
class ConvS2SConfig:
    """Sizes.

    - width: of states and embeddings
    - n_encoder_layers: number of encoder layers
    - n_decoder_layers: number of decoder layers
    - dropout: probability
    - most_positions: number of learned positions; later frames share the last one
    """

    width: int = 512
    n_encoder_layers: int = 20
    n_decoder_layers: int = 20
    dropout: float = 0.1
    most_positions: int = 512


def _make_linear(n_in: int, n_out: int) -> nn.Linear:
    """Returns a linear layer whose outputs have the deviation 1 at the start of training, for inputs of deviation 1."""
    layer = nn.Linear(n_in, n_out)
    nn.init.normal_(layer.weight, std=n_in**-0.5)
    nn.init.zeros_(layer.bias)
    weight_norm(layer)
    return layer


def _embed_inputs(layer: nn.Linear, numbers: Tensor) -> Tensor:
    """Returns inputs (B, S, D) from the numbers of frames (B, S, K), scaled to ``_INPUT_DEVIATION``."""
    inputs: Tensor = layer(numbers) * _INPUT_DEVIATION
    return inputs


class GatedConvolution(nn.Module):
    """Convolution over frames and gated linear unit, (B, S + 2, D) -> (B, S, D)."""

    def __init__(self, width: int, dropout: float) -> None:
        super().__init__()
        self.convolution = nn.Conv1d(width, 2 * width, _KERNEL)
        self.dropout = nn.Dropout(dropout)
        nn.init.normal_(self.convolution.weight, std=(4.0 * (1.0 - dropout) / (_KERNEL * width)) ** 0.5)
        if self.convolution.bias is not None:
            nn.init.zeros_(self.convolution.bias)
        weight_norm(self.convolution)

    def forward(self, x: Tensor) -> Tensor:
        """Returns the states (B, S, D) of inputs padded by one frame at either end, or by two before."""
        return F.glu(self.convolution(self.dropout(x).transpose(1, 2)), dim=1).transpose(1, 2)


class ConvS2S(Generator):
    """Encoder and decoder of gated convolutions."""

    concurrent = False
    feeds_own = True

    def __init__(self, config: ConvS2SConfig, normaliser: Normaliser) -> None:
        super().__init__()
        self.config, self.normaliser = config, normaliser
        width, n_numbers = config.width, normaliser.n_numbers
        self.embedding = _make_linear(2 * n_numbers, width)
        self.positions = nn.Embedding(config.most_positions, width)
        self.encoder = nn.ModuleList(GatedConvolution(width, config.dropout) for _ in range(config.n_encoder_layers))
        self.token = _make_linear(width, 3)
        self.kind, self.fed = nn.Embedding(3, width), _make_linear(n_numbers, width)
        self.decoder = nn.ModuleList(GatedConvolution(width, config.dropout) for _ in range(config.n_decoder_layers))
        self.queries = nn.ModuleList(_make_linear(width, width) for _ in range(config.n_decoder_layers))
        self.read = nn.ModuleList(_make_linear(width, width) for _ in range(config.n_decoder_layers))
        self.frame, self.last = _make_linear(width, n_numbers), _make_linear(width, 1)
        for table in (self.positions, self.kind):
            nn.init.normal_(table.weight, std=_INPUT_DEVIATION)

    def _add_positions(self, x: Tensor, start: Tensor | int) -> Tensor:
        """Returns embeddings (B, S, D) plus the learned encoding of each frame's position."""
        frames = (start + torch.arange(x.shape[1], device=x.device)).clamp(max=self.config.most_positions - 1)
        output: Tensor = x + self.positions(frames)
        return output

    def encode(self, x: Tensor, mask: Tensor, n_before: Tensor, marks: Tensor | None = None) -> Encoded:
        """Encodes the input. Memory: mask (B, S), keys and values (B, S, D). State: the last two inputs (B, 2, D) of
        every layer.
        """
        real = mask[..., None].to(x.dtype)
        embedded = _embed_inputs(self.embedding, append_deltas(self.normaliser(x), n_before))
        inputs = self._add_positions(embedded, 0) * real
        states = inputs
        for layer in self.encoder:
            states = (states + layer(F.pad(states, (0, 0, 1, 1)))) * _SQRT_HALF * real
        if states.requires_grad:
            states.register_hook(self._scale_gradient)  # type: ignore[no-untyped-call]
        padding = x.new_zeros(x.shape[0], _KERNEL - 1, self.config.width)
        memory, start = (mask, states, (states + inputs) * _SQRT_HALF), (padding,) * len(self.decoder)
        decoded, _ = self._run_decoder(inputs, memory, start)
        return Encoded(mask_impossible_tokens(self.token(decoded), n_before), memory, start)

    def _scale_gradient(self, gradient: Tensor) -> Tensor:
        return gradient / (2 * len(self.decoder))

    def decode(
        self, fed: Tensor, kinds: Tensor, start: Tensor, memory: State, state: State
    ) -> tuple[Tensor, Tensor, State]:
        """Returns frames, logits of the last frame, and the last two inputs of every layer."""
        is_shown = (kinds == FRAME)[..., None].to(fed.dtype)
        embedded = self.kind(kinds) + is_shown * _embed_inputs(self.fed, self.normaliser(fed))
        target = self._add_positions(embedded, start)
        x, new_state = self._run_decoder(target, memory, state)
        return self.normaliser.inverse(self.frame(x)), self.last(x)[..., 0], new_state

    def _run_decoder(self, target: Tensor, memory: State, state: State) -> tuple[Tensor, State]:
        """Returns the states (B, T, D) of inputs (B, T, D), and the last two inputs of every layer."""
        mask, keys, values = memory
        x, new_state = target, []
        for layer, query, value, past in zip(self.decoder, self.queries, self.read, state, strict=True):
            window = torch.cat([past, x], dim=1)
            new_state.append(window[:, -(_KERNEL - 1) :])
            convolved = layer(window)
            queries = (query(convolved) + target) * _SQRT_HALF
            weights = (queries @ keys.transpose(1, 2)).masked_fill(~mask[:, None], -torch.inf).softmax(-1)
            convolved = (convolved + value(weights @ values)) * _SQRT_HALF
            x = (x + convolved) * _SQRT_HALF
        return x, tuple(new_state)
