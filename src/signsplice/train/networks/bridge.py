"""The network that makes transitions: one pass over the sign before, a classical transition, and the sign after.

It is a Transformer encoder with pre-layer normalisation and rotary positions (Su et al. 2021), because what matters is
how far apart two frames are. Its answer is a rotation vector for every joint at every frame of the gap, weighted by a
window that is flat at both ends (``gap_features.delta_rotvecs``) and added to the classical transition. The
last layer is initialised with zeros, so that an untrained network is the classical method.

Names of attributes that hold weights are stored in checkpoints and in ONNX graphs, from which training can continue:
do not rename them.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812

from signsplice.rig.info import ROLES
from signsplice.splicing.networks.gap_features import N_CONTEXT, N_TOKEN

MAX_DEVIATIONS = 5.0
"""Inputs are clamped to this many standard deviations from the mean."""


@dataclass(frozen=True)
class BridgeConfig:
    """Sizes of a transition network.

    - width: numbers of a state
    - n_heads: attention heads, which divide ``width``
    - n_layers: encoder layers
    - inner: units of a feed-forward layer
    - dropout: probability
    """

    width: int = 256
    n_heads: int = 8
    n_layers: int = 4
    inner: int = 1024
    dropout: float = 0.0


def rope_angles(n_frames: int, width: int, like: Tensor) -> tuple[Tensor, Tensor]:
    """Cosines and signed sines (S, W) with which ``rotary`` rotates queries and keys of S frames and W numbers."""
    half = width // 2
    rates = 100.0 ** (-torch.arange(half, device=like.device, dtype=torch.float32) / half)
    angles = torch.arange(n_frames, device=like.device)[:, None].float() * rates  # (S, W / 2)
    cos, sin = angles.cos().to(like.dtype), angles.sin().to(like.dtype)
    return torch.cat([cos, cos], dim=-1), torch.cat([-sin, sin], dim=-1)


def rotary(x: Tensor, rope: tuple[Tensor, Tensor]) -> Tensor:
    """Queries or keys (..., S, W) in which number k and number k + W / 2 are rotated by the frame's ``rope_angles``."""
    a, b = x.chunk(2, dim=-1)
    return x * rope[0] + torch.cat([b, a], dim=-1) * rope[1]


def standardised(x: Tensor, mean: Tensor, deviation: Tensor) -> Tensor:
    """Numbers (..., N) minus their mean, divided by their standard deviation, at most ``MAX_DEVIATIONS``: captures may
    hold values that were never trained on.
    """
    return ((x - mean) / deviation).clamp(-MAX_DEVIATIONS, MAX_DEVIATIONS)


class RotaryLayer(nn.Module):
    """Self-attention and a feed-forward layer, each with a residual connection."""

    def __init__(self, config: BridgeConfig) -> None:
        super().__init__()
        width = config.width
        self.n_heads = config.n_heads
        self.before, self.between = nn.LayerNorm(width), nn.LayerNorm(width)
        self.mixed, self.out = nn.Linear(width, 3 * width), nn.Linear(width, width)
        self.first, self.second = nn.Linear(width, config.inner), nn.Linear(config.inner, width)
        self.dropout = nn.Dropout(config.dropout)

    def forward(self, x: Tensor, rope: tuple[Tensor, Tensor], allowed: Tensor | None) -> Tensor:
        """States (B, S, D) after the layer. rope: ``rope_angles`` of a head. allowed: (B, 1, 1, S), which frames may be
        attended to.
        """
        n_batch, n_frames, width = x.shape
        # (3, B, H, S, D / H): queries, keys and values
        qkv = self.mixed(self.before(x)).reshape(n_batch, n_frames, 3, self.n_heads, -1).permute(2, 0, 3, 1, 4)
        rotated = rotary(qkv[:2], rope)
        attended = F.scaled_dot_product_attention(rotated[0], rotated[1], qkv[2], attn_mask=allowed)
        x = x + self.dropout(self.out(attended.transpose(1, 2).reshape(n_batch, n_frames, width)))
        inner = F.gelu(self.first(self.between(x)), approximate="tanh")
        out: Tensor = x + self.dropout(self.second(inner))
        return out


class Bridge(nn.Module):
    """The transition network.

    - config: its sizes
    - mean, deviation: (N_TOKEN,) of the tokens that it was trained on
    """

    mean: Tensor
    deviation: Tensor

    def __init__(self, config: BridgeConfig, mean: Tensor | None = None, deviation: Tensor | None = None) -> None:
        super().__init__()
        self.config = config
        self.register_buffer("mean", torch.zeros(N_TOKEN) if mean is None else mean)
        self.register_buffer("deviation", torch.ones(N_TOKEN) if deviation is None else deviation)
        self.embedding = nn.Linear(N_TOKEN, config.width)
        self.layers = nn.ModuleList(RotaryLayer(config) for _ in range(config.n_layers))
        self.norm = nn.LayerNorm(config.width)
        self.out = nn.Linear(config.width, 3 * len(ROLES))
        nn.init.zeros_(self.out.weight)
        nn.init.zeros_(self.out.bias)

    def forward(self, tokens: Tensor, mask: Tensor | None = None) -> Tensor:
        """Rotation vectors (B, S - 2 N_CONTEXT, R, 3) for the frames of the gap.

        tokens: (B, S, N_TOKEN), padded at the end. mask: (B, S), False at padding, whose answers are meaningless.
        """
        states = self.embedding(standardised(tokens, self.mean, self.deviation))
        allowed = None if mask is None else mask[:, None, None]
        rope = rope_angles(states.shape[1], self.config.width // self.config.n_heads, states)
        for layer in self.layers:
            states = layer(states, rope, allowed)
        gap = self.norm(states[:, N_CONTEXT : states.shape[1] - N_CONTEXT])
        out: Tensor = self.out(gap)
        return out.reshape(*out.shape[:2], len(ROLES), 3)
