"""The network that cuts: which frame of the word before is the last to keep, and which of the word after the first.

A Transformer encoder over the end of the one and the beginning of the other (``motion.features.cut_window``), with
rotary positions. Every frame gets a score as the place to leave or to enter, and a short vector; a choice of two frames
weighs both scores and how the vectors agree, so that the two are chosen together. Beside it every frame is told apart
by its phase (Kita et al. 1998), which makes the states know where movements begin.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812

from signsplice.motion.features import N_CUT, N_FRAME
from signsplice.train.networks.bridge import BridgeConfig, RotaryLayer

PHASES = ("rest", "preparation", "sign", "retraction")


@dataclass(frozen=True)
class CuttingConfig:
    """Sizes; ``agreeing`` numbers in the vectors of a choice."""

    width: int = 128
    n_heads: int = 8
    n_layers: int = 4
    inner: int = 512
    agreeing: int = 16
    dropout: float = 0.0


class Cutting(nn.Module):
    """Tokens of two words -> scores of every choice."""

    mean: Tensor
    deviation: Tensor

    def __init__(self, config: CuttingConfig, mean: Tensor | None = None, deviation: Tensor | None = None) -> None:
        super().__init__()
        self.config = config
        self.register_buffer("mean", torch.zeros(N_CUT) if mean is None else mean)
        self.register_buffer("deviation", torch.ones(N_CUT) if deviation is None else deviation)
        width = config.width
        self.embedding = nn.Linear(N_CUT, width)
        sizes = BridgeConfig(width, config.n_heads, config.n_layers, config.inner, config.dropout)
        self.layers = nn.ModuleList(RotaryLayer(sizes) for _ in range(config.n_layers))
        self.norm = nn.LayerNorm(width)
        self.score, self.vector = nn.Linear(width, 2), nn.Linear(width, 2 * config.agreeing)
        self.phase = nn.Linear(width, len(PHASES))

    def forward(self, tokens: Tensor, mask: Tensor | None = None) -> tuple[Tensor, Tensor]:
        """Scores (B, S, S) of leaving at one frame (row) and entering at another, and logits of the phases (B, S, 4),
        of tokens (B, S, N_CUT); ``mask`` (B, S) is False at padding. Only rows of the word before and columns of the
        word after mean something.
        """
        states = self.embedding((tokens - self.mean) / self.deviation)
        allowed = None if mask is None else mask[:, None, None]
        for layer in self.layers:
            states = layer(states, allowed)
        states = self.norm(states)
        leave, enter = self.score(states).unbind(-1)
        left, right = self.vector(states).chunk(2, dim=-1)
        agree = left @ right.transpose(1, 2) * self.config.agreeing**-0.5
        return leave[:, :, None] + enter[:, None] + agree, self.phase(states)


class Duration(nn.Module):
    """Seconds of a transition, of the two frames that it joins."""

    mean: Tensor
    deviation: Tensor

    def __init__(self, width: int = 128, mean: Tensor | None = None, deviation: Tensor | None = None) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(N_FRAME) if mean is None else mean)
        self.register_buffer("deviation", torch.ones(N_FRAME) if deviation is None else deviation)
        self.first, self.second = nn.Linear(3 * N_FRAME, width), nn.Linear(width, width)
        self.out = nn.Linear(width, 1)

    def forward(self, leaving: Tensor, entering: Tensor) -> Tensor:
        """Seconds (B,) of the numbers (B, N_FRAME) of the last frame kept and the first one kept."""
        a, b = (leaving - self.mean) / self.deviation, (entering - self.mean) / self.deviation
        x = F.gelu(self.first(torch.cat([a, b, b - a], dim=-1)), approximate="tanh")
        x = F.gelu(self.second(x), approximate="tanh")
        out: Tensor = F.softplus(self.out(x)[:, 0] - 1.2)
        return out
