"""Layers shared by networks: normaliser, positional encoding (eq. 12), attention (eq. 13), feed-forward (eq. 14).

Shapes: B pairs, S input frames, T output frames, P earlier output frames, K numbers of a frame (159 for the 53 joints
of the paper), D width, H heads. The names of modules are keys of checkpoints.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812

DELTA_SCALE = 5.0
"""Scales differences between frames, some tenths of a deviation, to the size of positions."""


class Normaliser(nn.Module):
    """Normalises positions in [-0.5, 0.5] to numbers of mean 0 and deviation 1 over the training pairs, and back.

    mean, deviation: of every number of a frame (K,).

    Most joints move little compared with their offset, so that raw positions would start every network near a constant.
    """

    mean: Tensor
    deviation: Tensor

    def __init__(self, mean: Tensor, deviation: Tensor) -> None:
        super().__init__()
        self.register_buffer("mean", mean)
        self.register_buffer("deviation", deviation)

    @property
    def n_numbers(self) -> int:
        """Numbers of a frame, K."""
        return self.mean.shape[0]

    def forward(self, x: Tensor) -> Tensor:
        """Returns normalised frames (..., K)."""
        return (x - self.mean) / self.deviation

    def inverse(self, x: Tensor) -> Tensor:
        """Returns the positions (..., K) of normalised frames."""
        return x * self.deviation + self.mean


def append_deltas(x: Tensor, n_before: Tensor) -> Tensor:
    """Returns the encoder's input (B, S, 2 K) for two words (B, S, K): every frame and its difference to the one
    before, which is 0 at the first frame of either word. ``n_before`` (B,): number of frames of the first word.

    The paper's networks read only frames. The differences are an addition: they show where a movement begins and ends.
    """
    deltas = torch.cat([torch.zeros_like(x[:, :1]), x[:, 1:] - x[:, :-1]], dim=1)
    is_first = torch.arange(x.shape[1], device=x.device)[None] == n_before[:, None]  # (B, S)
    return torch.cat([x, DELTA_SCALE * deltas.masked_fill(is_first[..., None], 0.0)], dim=-1)


def positional_encoding(positions: Tensor, width: int) -> Tensor:
    """Returns the encoding (T, D) of frame positions (T,), with D even: sin in even and cos in odd dimensions (eq. 12,
    which prints sin twice).
    """
    rates = torch.exp(torch.arange(0, width, 2, device=positions.device) * (-math.log(10000.0) / width))
    angles = positions.to(rates.dtype)[:, None] * rates
    return torch.stack([angles.sin(), angles.cos()], dim=-1).flatten(-2)


def causal_mask(n_new: int, n_past: int, device: torch.device) -> Tensor:
    """Returns the mask (T, P + T) of causal attention: each of T new frames may attend to itself and all frames before
    it.
    """
    queries = torch.arange(n_new, device=device)
    keys = torch.arange(n_past + n_new, device=device)
    return keys[None] <= queries[:, None] + n_past


class MultiHead(nn.Module):
    """Multi-head attention (eq. 13); Q, K and V are learned projections of the layer's inputs."""

    def __init__(self, width: int, n_heads: int) -> None:
        super().__init__()
        self.n_heads = n_heads
        self.query, self.key = nn.Linear(width, width), nn.Linear(width, width)
        self.value, self.out = nn.Linear(width, width), nn.Linear(width, width)

    def split(self, x: Tensor) -> Tensor:
        """Returns heads (B, H, T, D / H) of states (B, T, D)."""
        return x.reshape(*x.shape[:2], self.n_heads, -1).transpose(1, 2)

    def keys_values(self, x: Tensor) -> tuple[Tensor, Tensor]:
        """Returns keys and values (B, H, T, D / H) of states (B, T, D), to be cached between steps."""
        return self.split(self.key(x)), self.split(self.value(x))

    def forward(self, x: Tensor, keys: Tensor, values: Tensor, allowed: Tensor | None = None) -> Tensor:
        """Returns Z (B, T, D). ``allowed``: True where a frame may be attended to; broadcasts to (B, H, T, S)."""
        heads = F.scaled_dot_product_attention(self.split(self.query(x)), keys, values, attn_mask=allowed)
        output: Tensor = self.out(heads.transpose(1, 2).flatten(-2))
        return output


class FeedForward(nn.Module):
    """Relu(Z W1 + b1) W3 + b3 (eq. 14); its "+ Z" is the layer's residual connection."""

    def __init__(self, width: int, inner: int) -> None:
        super().__init__()
        self.first, self.second = nn.Linear(width, inner), nn.Linear(inner, width)

    def forward(self, z: Tensor) -> Tensor:
        """Returns the term (B, T, D) that is added to Z (B, T, D)."""
        output: Tensor = self.second(torch.relu(self.first(z)))
        return output


class EncoderLayer(nn.Module):
    """Self-attention and feed-forward, each added to its input.

    Layer norms come first in each block; the paper does not specify their place, and the original's norm-last order
    needs a slow warm-up.
    """

    def __init__(self, width: int, n_heads: int, inner: int, dropout: float) -> None:
        super().__init__()
        self.attention, self.feed = MultiHead(width, n_heads), FeedForward(width, inner)
        self.norms = nn.ModuleList(nn.LayerNorm(width) for _ in range(2))
        self.dropout = nn.Dropout(dropout)

    def forward(self, x: Tensor, allowed: Tensor | None) -> Tensor:
        """Returns the states (B, S, D) for the next layer."""
        normed = self.norms[0](x)
        x = x + self.dropout(self.attention(normed, *self.attention.keys_values(normed), allowed))
        output: Tensor = x + self.dropout(self.feed(self.norms[1](x)))
        return output


class DecoderLayer(nn.Module):
    """Self-attention over the frames so far, attention to the encoder's states, and feed-forward."""

    def __init__(self, width: int, n_heads: int, inner: int, dropout: float) -> None:
        super().__init__()
        self.own, self.cross = MultiHead(width, n_heads), MultiHead(width, n_heads)
        self.feed = FeedForward(width, inner)
        self.norms = nn.ModuleList(nn.LayerNorm(width) for _ in range(3))
        self.dropout = nn.Dropout(dropout)

    def forward(
        self,
        x: Tensor,
        cache: tuple[Tensor, Tensor],
        cross: tuple[Tensor, Tensor],
        self_allowed: Tensor,
        cross_allowed: Tensor | None,
    ) -> tuple[Tensor, tuple[Tensor, Tensor]]:
        """Returns the states (B, T, D), and the cache (keys and values (B, H, P, D / H)) extended by the T new frames.

        cross: keys and values of the encoder's states.
        """
        normed = self.norms[0](x)
        keys, values = self.own.keys_values(normed)
        keys, values = torch.cat([cache[0], keys], dim=2), torch.cat([cache[1], values], dim=2)
        x = x + self.dropout(self.own(normed, keys, values, self_allowed))
        x = x + self.dropout(self.cross(self.norms[1](x), *cross, cross_allowed))
        return x + self.dropout(self.feed(self.norms[2](x))), (keys, values)


class Encoder(nn.Module):
    """Embedding of ``n_read`` numbers a frame, positional encoding and a stack of encoder layers."""

    def __init__(self, n_read: int, width: int, n_heads: int, n_layers: int, inner: int, dropout: float) -> None:
        super().__init__()
        self.embedding = nn.Linear(n_read, width)
        self.layers = nn.ModuleList(EncoderLayer(width, n_heads, inner, dropout) for _ in range(n_layers))
        self.norm = nn.LayerNorm(width)

    def forward(self, x: Tensor, mask: Tensor | None) -> Tensor:
        """Returns the states (B, S, D) of normalised inputs (B, S, n_read); ``mask`` (B, S) is False at padding."""
        states = self.embedding(x)
        positions = torch.arange(x.shape[1], device=x.device)
        states = states + positional_encoding(positions, states.shape[-1]).to(states.dtype)
        allowed = None if mask is None else mask[:, None, None, :]
        for layer in self.layers:
            states = layer(states, allowed)
        output: Tensor = self.norm(states)
        return output
