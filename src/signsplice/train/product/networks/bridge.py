"""The network that makes transitions: one pass over the sign before, a classical transition, and the sign after.

A plain Transformer encoder, norms first, with rotary positions (Su et al. 2021): what matters is how far two frames lie
apart. Its answer is a turn of every joint at every frame of the gap, which is added to the classical transition under
a window that is flat at both ends (``motion.features.delta_rotvecs``); its last layer begins at zero, so that an untrained
network is the classical method.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812

from signsplice.rig.canonical import ROLES
from signsplice.splicing.features import CONTEXT, N_TOKEN

FARTHEST = 5.0
"""Deviations from the mean beyond which numbers are cut."""


@dataclass(frozen=True)
class BridgeConfig:
    """Sizes."""

    width: int = 256
    n_heads: int = 8
    n_layers: int = 4
    inner: int = 1024
    dropout: float = 0.0


def rope_angles(n_frames: int, width: int, like: Tensor) -> tuple[Tensor, Tensor]:
    """Cosines and sines (S, W) by which ``rotary`` turns S frames' queries and keys of W numbers."""
    half = width // 2
    rates = 100.0 ** (-torch.arange(half, device=like.device, dtype=torch.float32) / half)
    angles = torch.arange(n_frames, device=like.device)[:, None].float() * rates
    cos, sin = angles.cos().to(like.dtype), angles.sin().to(like.dtype)
    return torch.cat([cos, cos], dim=-1), torch.cat([-sin, sin], dim=-1)


def rotary(x: Tensor, turns: tuple[Tensor, Tensor]) -> Tensor:
    """Queries or keys (..., S, W), each pair of numbers turned by its frame's place times a rate (``rope_angles``)."""
    a, b = x.chunk(2, dim=-1)
    return x * turns[0] + torch.cat([b, a], dim=-1) * turns[1]


def standard(x: Tensor, mean: Tensor, deviation: Tensor) -> Tensor:
    """Numbers (..., N) as deviations from the mean, ``FARTHEST`` at most: captures may hold what training never had."""
    return ((x - mean) / deviation).clamp(-FARTHEST, FARTHEST)


class RotaryLayer(nn.Module):
    """Self-attention and feed-forward, each added to its input."""

    def __init__(self, config: BridgeConfig) -> None:
        super().__init__()
        width = config.width
        self.n_heads = config.n_heads
        self.before, self.between = nn.LayerNorm(width), nn.LayerNorm(width)
        self.mixed, self.out = nn.Linear(width, 3 * width), nn.Linear(width, width)
        self.first, self.second = nn.Linear(width, config.inner), nn.Linear(config.inner, width)
        self.dropout = nn.Dropout(config.dropout)

    def forward(self, x: Tensor, turns: tuple[Tensor, Tensor], allowed: Tensor | None) -> Tensor:
        """States (B, S, D) of the next layer; ``turns``: the ``rope_angles`` of its heads; ``allowed`` (B, 1, 1, S): which
        frames may be looked at.
        """
        n_batch, n_frames, width = x.shape
        parts = self.mixed(self.before(x)).reshape(n_batch, n_frames, 3, self.n_heads, -1).permute(2, 0, 3, 1, 4)
        turned = rotary(parts[:2], turns)
        seen = F.scaled_dot_product_attention(turned[0], turned[1], parts[2], attn_mask=allowed)
        x = x + self.dropout(self.out(seen.transpose(1, 2).reshape(n_batch, n_frames, width)))
        inner = F.gelu(self.first(self.between(x)), approximate="tanh")
        out: Tensor = x + self.dropout(self.second(inner))
        return out


class Bridge(nn.Module):
    """Tokens of a window -> turns."""

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
        """Turns (B, S - 2 CONTEXT, R, 3) of tokens (B, S, N_TOKEN); ``mask`` (B, S) is False at padding, which follows
        a window, and whose turns mean nothing.
        """
        states = self.embedding(standard(tokens, self.mean, self.deviation))
        allowed = None if mask is None else mask[:, None, None]
        turns = rope_angles(states.shape[1], self.config.width // self.config.n_heads, states)
        for layer in self.layers:
            states = layer(states, turns, allowed)
        gap = self.norm(states[:, CONTEXT : states.shape[1] - CONTEXT])
        out: Tensor = self.out(gap)
        return out.reshape(*out.shape[:2], len(ROLES), 3)
