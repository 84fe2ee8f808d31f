"""Networks that make all transition frames at once, their number being told or guessed before.

* NAT (after Huang et al. 2021 [10]): a non-autoregressive Transformer. A number of frames is predicted, the encoder's
  states at the splice are spread over it (their length regulator; here a blend of the two inner states), the decoder
  refines all frames together, and a graph convolution over the skeleton's joints puts them out. Their gloss input, and
  the external aligner that taught lengths, have no counterpart: lengths are known here.
* Convolutional interpolation (after Zhou et al. 2021 [11]): kept frames on both sides and a linear interpolation
  between them go through residual convolutions over time; the output is added to the interpolation. Theirs works on
  rotations with kinematics behind it; here on positions, as all systems of the comparison.

Both see the culled frames X_c and know no positions of their own: those are SPSN's, or the truth.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812

from signsplice.train.paper.networks.layers import (
    N_NUMBERS,
    DecoderLayer,
    Encoder,
    Normaliser,
    positional_code,
    with_steps,
)


@dataclass(frozen=True)
class NatConfig:
    """Sizes; ``graph`` numbers a joint in the graph convolution."""

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
    """Sizes; dilations go 1, 2, 4, 1, 2, 4, ..."""

    fr: int = 8
    width: int = 512
    n_layers: int = 9
    most_frames: int = 32


class Filler(nn.Module, ABC):
    """A network that guesses a number of frames and makes them together."""

    @abstractmethod
    def length(self, x: Tensor, mask: Tensor) -> Tensor:
        """Logits (B, most_frames) of 1, 2, ... frames, of culled frames (B, 2 fr, 159), raw, and their mask."""

    @abstractmethod
    def fill(self, x: Tensor, mask: Tensor, real: Tensor) -> Tensor:
        """Frames (B, T, 159), raw; ``real`` (B, T) says how many of each row are asked for."""

    def forward(self, x: Tensor, mask: Tensor, real: Tensor) -> tuple[Tensor, Tensor]:
        """Logits of the lengths, and frames."""
        return self.length(x, mask), self.fill(x, mask, real)


def shares(real: Tensor) -> Tensor:
    """Where each of n frames lies between the two kept ones (B, T): 1 / (n + 1), 2 / (n + 1), ..."""
    n = real.sum(1, keepdim=True)
    return torch.arange(1, real.shape[1] + 1, device=real.device) / (n + 1.0)


class GraphConvolution(nn.Module):
    """Joints' features (B, T, J, G) mixed along bones by a row-normalised adjacency with self-loops, then over time."""

    adjacency: Tensor

    def __init__(self, parents: Sequence[int], n_features: int) -> None:
        super().__init__()
        links = torch.eye(len(parents))
        for joint, parent in enumerate(parents):
            if parent >= 0:
                links[joint, parent] = links[parent, joint] = 1.0
        self.register_buffer("adjacency", links / links.sum(1, keepdim=True))
        self.own, self.near = nn.Linear(n_features, n_features), nn.Linear(n_features, n_features)
        self.time = nn.Conv2d(n_features, n_features, (3, 1), padding=(1, 0))

    def forward(self, x: Tensor, real: Tensor) -> Tensor:
        """Features of the same shape; frames that are not ``real`` (B, T) count as zero for their neighbours."""
        mixed = torch.relu(self.own(x) + self.adjacency @ self.near(x)) * real[:, :, None, None]
        over_time = self.time(mixed.permute(0, 3, 1, 2)).permute(0, 2, 3, 1)
        return x + torch.relu(over_time)


class Nat(Filler):
    """Non-autoregressive Transformer with a graph convolution at its end."""

    def __init__(self, config: NatConfig, normaliser: Normaliser, parents: Sequence[int]) -> None:
        super().__init__()
        self.config, self.normaliser = config, normaliser
        width, sizes = config.width, (config.width, config.n_heads)
        self.encoder = Encoder(*sizes, config.n_encoder_layers, config.inner, config.dropout)
        self.number = nn.Linear(2 * width, config.most_frames)
        self.layers = nn.ModuleList(
            DecoderLayer(*sizes, config.inner, config.dropout) for _ in range(config.n_decoder_layers)
        )
        self.norm = nn.LayerNorm(width)
        self.joints = nn.Linear(width, N_NUMBERS // 3 * config.graph)
        self.graph = GraphConvolution(parents, config.graph)
        self.out = nn.Linear(config.graph, 3)

    def length(self, x: Tensor, mask: Tensor) -> Tensor:
        """Logits (B, most_frames)."""
        return self._number(self._encoded(x, mask))

    def fill(self, x: Tensor, mask: Tensor, real: Tensor) -> Tensor:
        """Frames (B, T, 159)."""
        return self._fill(self._encoded(x, mask), mask, real)

    def forward(self, x: Tensor, mask: Tensor, real: Tensor) -> tuple[Tensor, Tensor]:
        """Logits of the lengths, and frames; the encoder runs once."""
        states = self._encoded(x, mask)
        return self._number(states), self._fill(states, mask, real)

    def _encoded(self, x: Tensor, mask: Tensor) -> Tensor:
        n_before = torch.full((x.shape[0],), self.config.fr, device=x.device)
        out: Tensor = self.encoder(with_steps(self.normaliser(x), n_before), mask)
        return out

    def _number(self, states: Tensor) -> Tensor:
        fr = self.config.fr
        out: Tensor = self.number(states[:, fr - 1 : fr + 1].flatten(1))
        return out

    def _fill(self, states: Tensor, mask: Tensor, real: Tensor) -> Tensor:
        fr, share = self.config.fr, shares(real)[..., None]
        x = (1.0 - share) * states[:, fr - 1 : fr] + share * states[:, fr : fr + 1]
        x = x + positional_code(torch.arange(real.shape[1], device=x.device), x.shape[-1]).to(x.dtype)
        x = x + positional_code(100.0 * share.flatten(), x.shape[-1]).to(x.dtype).reshape(x.shape)
        for layer in self.layers:
            assert isinstance(layer, DecoderLayer)
            cross = layer.cross.keys_values(states)
            empty = (cross[0][:, :, :0], cross[1][:, :, :0])
            x, _ = layer(x, empty, cross, real[:, None, None, :], mask[:, None, None, :])
        joints = self.joints(self.norm(x)).reshape(*real.shape, N_NUMBERS // 3, self.config.graph)
        return self.normaliser.inverse(self.out(self.graph(joints, real)).flatten(-2))


class Interpolation(Filler):
    """Residual convolutions over kept frames and a linear interpolation."""

    def __init__(self, config: InterpolationConfig, normaliser: Normaliser) -> None:
        super().__init__()
        self.config, self.normaliser = config, normaliser
        width = config.width
        self.number = nn.Sequential(
            nn.Linear(2 * config.fr * N_NUMBERS, width), nn.ReLU(), nn.Linear(width, config.most_frames)
        )
        self.embedding = nn.Linear(N_NUMBERS + 3, width)
        self.layers = nn.ModuleList(
            nn.Conv1d(width, width, 3, dilation=2 ** (k % 3), padding=2 ** (k % 3)) for k in range(config.n_layers)
        )
        self.norms = nn.ModuleList(nn.LayerNorm(width) for _ in range(config.n_layers))
        self.out = nn.Linear(width, N_NUMBERS)
        nn.init.zeros_(self.out.weight)
        nn.init.zeros_(self.out.bias)

    def length(self, x: Tensor, mask: Tensor) -> Tensor:
        """Logits (B, most_frames)."""
        out: Tensor = self.number(self.normaliser(x).flatten(1))
        return out

    def fill(self, x: Tensor, mask: Tensor, real: Tensor) -> Tensor:
        """Frames (B, T, 159)."""
        fr, n_gap = self.config.fr, real.shape[1]
        x = self.normaliser(x)
        share = shares(real)[..., None]
        line = (1.0 - share) * x[:, fr - 1 : fr] + share * x[:, fr : fr + 1]  # (B, T, 159)
        # Rows are [P, gap, Q, padding]: place k of the row comes from place `source` of [P, Q, line].
        count = real.sum(1, keepdim=True)
        places = torch.arange(2 * fr + n_gap, device=x.device)[None]
        source = torch.where(places < fr + count, places + fr, places - count)
        source = torch.where(places < fr, places, source).clamp(max=2 * fr + n_gap - 1)
        within = (places < 2 * fr + count)[..., None].to(x.dtype)
        gap = ((places >= fr) & (places < fr + count))[..., None].to(x.dtype)
        row = torch.cat([x, line], dim=1).gather(1, source[..., None].expand(-1, -1, N_NUMBERS))
        phase = ((places - fr + 1) / (count + 1.0))[..., None]
        states = self.embedding(torch.cat([row, gap, phase * gap, 8.0 / (count + 1.0)[..., None] * gap], dim=-1))
        for layer, norm in zip(self.layers, self.norms, strict=True):
            inner = (norm(states) * within).transpose(1, 2)
            states = states + F.relu(layer(inner).transpose(1, 2))
        return self.normaliser.inverse(line + self.out(states)[:, fr : fr + n_gap])
