"""Networks that make all transition frames at once, for a given or predicted number of frames.

* NAT (after Huang et al. 2021 [10]): a non-autoregressive Transformer. It predicts a number of frames, spreads the
  encoder's states at the splice over it (their length regulator; here a blend of the two inner states), refines all
  frames together in the decoder, and makes positions by a graph convolution over the skeleton's joints. Their gloss
  input, and the external aligner for lengths, have no counterpart, because lengths are known here.
* Convolutional interpolation (after Zhou et al. 2021 [11]): kept frames on both sides and a linear interpolation
  between them pass through residual convolutions over time; the output is added to the interpolation. Theirs works on
  rotations followed by kinematics, this one on positions, as all systems of the comparison.

Both see the culled frames X_c and predict no positions; those come from SPSN or the truth.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812

from signsplice_paper.train.networks.layers import (
    DecoderLayer,
    Encoder,
    Normaliser,
    bones,
    positional_code,
    with_deltas,
)


@dataclass(frozen=True)
class NatConfig:
    """Sizes.

    - fr: frames that Culling keeps on each side
    - width: of states
    - n_heads: attention heads
    - n_encoder_layers: number of encoder layers
    - n_decoder_layers: number of decoder layers
    - inner: width of the feed-forward layers
    - graph: numbers per joint in the graph convolution
    - dropout: probability
    - most_frames: longest transition
    """

    fr: int = 8
    width: int = 512
    n_heads: int = 8
    n_encoder_layers: int = 6
    n_decoder_layers: int = 6
    inner: int = 2048
    graph: int = 16
    dropout: float = 0.1
    most_frames: int = 32


@dataclass(frozen=True)
class InterpolationConfig:
    """Sizes.

    - fr: frames that Culling keeps on each side
    - width: of states
    - n_layers: number of convolutions, with dilations 1, 2, 4, 1, 2, 4, ...
    - most_frames: longest transition
    """

    fr: int = 8
    width: int = 512
    n_layers: int = 9
    most_frames: int = 32


class Filler(nn.Module, ABC):
    """A network that predicts a number of frames and makes them together."""

    @abstractmethod
    def length(self, x: Tensor, mask: Tensor) -> Tensor:
        """Logits (B, most_frames) of 1, 2, ... frames, from culled frames (B, 2 fr, K), not normalised, and their
        mask (B, 2 fr).
        """

    @abstractmethod
    def fill(self, x: Tensor, mask: Tensor, real: Tensor) -> Tensor:
        """Frames (B, T, K), not normalised; ``real`` (B, T) is True for the frames that each row needs."""

    def forward(self, x: Tensor, mask: Tensor, real: Tensor) -> tuple[Tensor, Tensor]:
        """Logits of the lengths, and frames."""
        return self.length(x, mask), self.fill(x, mask, real)


def gap_fractions(real: Tensor) -> Tensor:
    """The times (B, T) of n frames between the kept frames, which lie at 0 and 1: 1 / (n + 1), 2 / (n + 1), ..."""
    n = real.sum(1, keepdim=True)
    return torch.arange(1, real.shape[1] + 1, device=real.device) / (n + 1.0)


class GraphConvolution(nn.Module):
    """Mixes the features of joints along bones, by a row-normalised adjacency with self-loops, and then over time."""

    adjacency: Tensor

    def __init__(self, parents: Sequence[int], n_features: int) -> None:
        super().__init__()
        links = bones(parents).float()
        self.register_buffer("adjacency", links / links.sum(1, keepdim=True))
        self.own, self.near = nn.Linear(n_features, n_features), nn.Linear(n_features, n_features)
        self.time = nn.Conv2d(n_features, n_features, (3, 1), padding=(1, 0))

    def forward(self, x: Tensor, real: Tensor) -> Tensor:
        """Features (B, T, J, G) of features (B, T, J, G); frames that are not ``real`` (B, T) count as zero for their
        neighbours.
        """
        mixed = torch.relu(self.own(x) + self.adjacency @ self.near(x)) * real[:, :, None, None]
        over_time = self.time(mixed.permute(0, 3, 1, 2)).permute(0, 2, 3, 1)
        return x + torch.relu(over_time)


class Nat(Filler):
    """Non-autoregressive Transformer that ends in a graph convolution."""

    def __init__(self, config: NatConfig, normaliser: Normaliser, parents: Sequence[int]) -> None:
        super().__init__()
        self.config, self.normaliser = config, normaliser
        width, sizes = config.width, (config.width, config.n_heads)
        self.encoder = Encoder(2 * normaliser.n_numbers, *sizes, config.n_encoder_layers, config.inner, config.dropout)
        self.number = nn.Linear(2 * width, config.most_frames)
        self.layers = nn.ModuleList(
            DecoderLayer(*sizes, config.inner, config.dropout) for _ in range(config.n_decoder_layers)
        )
        self.norm = nn.LayerNorm(width)
        self.joints = nn.Linear(width, normaliser.n_numbers // 3 * config.graph)
        self.graph = GraphConvolution(parents, config.graph)
        self.out = nn.Linear(config.graph, 3)

    def length(self, x: Tensor, mask: Tensor) -> Tensor:
        """Logits (B, most_frames)."""
        return self._length_logits(self._encode(x, mask))

    def fill(self, x: Tensor, mask: Tensor, real: Tensor) -> Tensor:
        """Frames (B, T, K)."""
        return self._frames(self._encode(x, mask), mask, real)

    def forward(self, x: Tensor, mask: Tensor, real: Tensor) -> tuple[Tensor, Tensor]:
        """Logits of the lengths, and frames; the encoder runs once."""
        states = self._encode(x, mask)
        return self._length_logits(states), self._frames(states, mask, real)

    def _encode(self, x: Tensor, mask: Tensor) -> Tensor:
        n_before = torch.full((x.shape[0],), self.config.fr, device=x.device)
        out: Tensor = self.encoder(with_deltas(self.normaliser(x), n_before), mask)
        return out

    def _length_logits(self, states: Tensor) -> Tensor:
        fr = self.config.fr
        out: Tensor = self.number(states[:, fr - 1 : fr + 1].flatten(1))
        return out

    def _frames(self, states: Tensor, mask: Tensor, real: Tensor) -> Tensor:
        fr, alpha = self.config.fr, gap_fractions(real)[..., None]  # (B, T, 1)
        x = (1.0 - alpha) * states[:, fr - 1 : fr] + alpha * states[:, fr : fr + 1]  # (B, T, D)
        x = x + positional_code(torch.arange(real.shape[1], device=x.device), x.shape[-1]).to(x.dtype)
        x = x + positional_code(100.0 * alpha.flatten(), x.shape[-1]).to(x.dtype).reshape(x.shape)
        for layer in self.layers:
            assert isinstance(layer, DecoderLayer)
            cross = layer.cross.keys_values(states)
            no_cache = (cross[0][:, :, :0], cross[1][:, :, :0])
            x, _ = layer(x, no_cache, cross, real[:, None, None, :], mask[:, None, None, :])
        joints = self.joints(self.norm(x)).reshape(*real.shape, -1, self.config.graph)
        return self.normaliser.inverse(self.out(self.graph(joints, real)).flatten(-2))


class Interpolation(Filler):
    """Residual convolutions over kept frames and a linear interpolation."""

    def __init__(self, config: InterpolationConfig, normaliser: Normaliser) -> None:
        super().__init__()
        self.config, self.normaliser = config, normaliser
        width = config.width
        self.number = nn.Sequential(
            nn.Linear(2 * config.fr * normaliser.n_numbers, width), nn.ReLU(), nn.Linear(width, config.most_frames)
        )
        self.embedding = nn.Linear(normaliser.n_numbers + 3, width)
        self.layers = nn.ModuleList(
            nn.Conv1d(width, width, 3, dilation=2 ** (k % 3), padding=2 ** (k % 3)) for k in range(config.n_layers)
        )
        self.norms = nn.ModuleList(nn.LayerNorm(width) for _ in range(config.n_layers))
        self.out = nn.Linear(width, normaliser.n_numbers)
        nn.init.zeros_(self.out.weight)
        nn.init.zeros_(self.out.bias)

    def length(self, x: Tensor, mask: Tensor) -> Tensor:
        """Logits (B, most_frames)."""
        out: Tensor = self.number(self.normaliser(x).flatten(1))
        return out

    def fill(self, x: Tensor, mask: Tensor, real: Tensor) -> Tensor:
        """Frames (B, T, K)."""
        fr, n_gap = self.config.fr, real.shape[1]
        x = self.normaliser(x)
        alpha = gap_fractions(real)[..., None]  # (B, T, 1)
        line = (1.0 - alpha) * x[:, fr - 1 : fr] + alpha * x[:, fr : fr + 1]  # (B, T, K)
        # Rows are [P, gap, Q, padding]; frame k of a row is frame source[k] of [P, Q, line].
        count = real.sum(1, keepdim=True)  # (B, 1)
        frames = torch.arange(2 * fr + n_gap, device=x.device)[None]
        source = torch.where(frames < fr + count, frames + fr, frames - count)
        source = torch.where(frames < fr, frames, source).clamp(max=2 * fr + n_gap - 1)
        within = (frames < 2 * fr + count)[..., None].to(x.dtype)
        gap = ((frames >= fr) & (frames < fr + count))[..., None].to(x.dtype)
        row = torch.cat([x, line], dim=1).gather(1, source[..., None].expand(-1, -1, x.shape[-1]))
        phase = ((frames - fr + 1) / (count + 1.0))[..., None]
        states = self.embedding(torch.cat([row, gap, phase * gap, 8.0 / (count + 1.0)[..., None] * gap], dim=-1))
        for layer, norm in zip(self.layers, self.norms, strict=True):
            inner = (norm(states) * within).transpose(1, 2)
            states = states + F.relu(layer(inner).transpose(1, 2))
        return self.normaliser.inverse(line + self.out(states)[:, fr : fr + n_gap])
