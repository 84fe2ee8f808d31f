"""The two shipped networks: one makes transitions, one cuts words and times transitions.

**Transitions** (``Bridge``): one pass over the sign before, a classical transition, and the sign after. It is a
Transformer encoder with pre-layer normalisation and rotary positions (Su et al. 2021), because what matters is how far
apart two frames are. Its answer is a polynomial of rotation vectors for every joint of the arms, times a window that
is flat at both ends (``features.answer_basis``), added to the classical transition: it cannot shake. The last layer
is initialised with zeros, so that an untrained network is the classical method.

**Cuts** (``Cutting``): where to leave a word depends little on the next word: on how far and in which
direction the hands have to go, and on whether the handshape changes. So a Transformer encoder with rotary positions
reads every word alone and once (``networks.features.word_tokens``), two frames to a token. It yields a state for each
frame and two summaries, one for leaving the word and one for entering it; a summary is made by a few learned attention
queries. For a pair of words, the two summaries and their difference form a condition, and every frame's score follows
from its state and the condition. One reading of a word serves both of its seams in any sentence. The network also
classifies every frame by its phase (Kita et al. 1998), so that its states mark where movements begin.

Names of attributes that hold weights are stored in checkpoints and in ONNX graphs, from which training can continue:
do not rename them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.polynomial.legendre import legvander
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812

from signsplice.splicing.features import IS_ARM, N_CONTEXT, N_MOMENTS, N_TERMS, N_TOKEN, N_WORD, PHASES

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

    width: int = 128
    n_heads: int = 4
    n_layers: int = 3
    inner: int = 512
    dropout: float = 0.0


def compute_rope_angles(n_frames: int, width: int, like: Tensor) -> tuple[Tensor, Tensor]:
    """Returns cosines and signed sines (S, W) with which ``rotate_by_rope`` rotates queries and keys of S frames and W
    numbers.
    """
    half = width // 2
    rates = 100.0 ** (-torch.arange(half, device=like.device, dtype=torch.float32) / half)
    angles = torch.arange(n_frames, device=like.device)[:, None].float() * rates  # (S, W / 2)
    cos, sin = angles.cos().to(like.dtype), angles.sin().to(like.dtype)
    return torch.cat([cos, cos], dim=-1), torch.cat([-sin, sin], dim=-1)


def rotate_by_rope(x: Tensor, rope: tuple[Tensor, Tensor]) -> Tensor:
    """Returns queries or keys (..., S, W) with numbers k and k + W / 2 rotated by the frame's
    ``compute_rope_angles``.
    """
    a, b = x.chunk(2, dim=-1)
    return x * rope[0] + torch.cat([b, a], dim=-1) * rope[1]


def standardise(x: Tensor, mean: Tensor, deviation: Tensor) -> Tensor:
    """Returns numbers (..., N) minus their mean, divided by their standard deviation, at most ``MAX_DEVIATIONS``:
    captures may hold values that were never trained on.
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
        """Returns states (B, S, D) after the layer. rope: ``compute_rope_angles`` of a head. allowed: (B, 1, 1, S),
        which frames may be attended to.
        """
        n_batch, n_frames, width = x.shape
        # (3, B, H, S, D / H): queries, keys and values
        qkv = self.mixed(self.before(x)).reshape(n_batch, n_frames, 3, self.n_heads, -1).permute(2, 0, 3, 1, 4)
        rotated = rotate_by_rope(qkv[:2], rope)
        attended = F.scaled_dot_product_attention(rotated[0], rotated[1], qkv[2], attn_mask=allowed)
        x = x + self.dropout(self.out(attended.transpose(1, 2).reshape(n_batch, n_frames, width)))
        inner = F.gelu(self.first(self.between(x)), approximate="tanh")
        output: Tensor = x + self.dropout(self.second(inner))
        return output


class Bridge(nn.Module):
    """The transition network.

    - config: its sizes
    - mean, deviation: (N_TOKEN,) of the tokens that it was trained on
    - fit: (N_TERMS, N_MOMENTS) from values at the gap's moments to the polynomial nearest to them
    """

    mean: Tensor
    deviation: Tensor
    fit: Tensor

    def __init__(self, config: BridgeConfig, mean: Tensor | None = None, deviation: Tensor | None = None) -> None:
        super().__init__()
        self.config = config
        self.register_buffer("mean", torch.zeros(N_TOKEN) if mean is None else mean)
        self.register_buffer("deviation", torch.ones(N_TOKEN) if deviation is None else deviation)
        moments = np.arange(1, N_MOMENTS + 1) / (N_MOMENTS + 1)
        fit = np.linalg.pinv(legvander(2.0 * moments - 1.0, N_TERMS - 1))
        self.register_buffer("fit", torch.from_numpy(fit.astype(np.float32)))
        self.embedding = nn.Linear(N_TOKEN, config.width)
        self.layers = nn.ModuleList(RotaryLayer(config) for _ in range(config.n_layers))
        self.norm = nn.LayerNorm(config.width)
        self.out = nn.Linear(config.width, 3 * int(IS_ARM.sum()))
        nn.init.zeros_(self.out.weight)
        nn.init.zeros_(self.out.bias)

    def forward(self, tokens: Tensor) -> Tensor:
        """Returns the terms (B, N_TERMS, A, 3) of a polynomial of rotation vectors (``features.answer_basis``), for
        tokens (B, N_SEEN, N_TOKEN).
        """
        states = self.embedding(standardise(tokens, self.mean, self.deviation))
        rope = compute_rope_angles(states.shape[1], self.config.width // self.config.n_heads, states)
        for layer in self.layers:
            states = layer(states, rope, None)
        terms: Tensor = self.fit @ self.out(self.norm(states[:, N_CONTEXT:-N_CONTEXT]))
        return terms.reshape(terms.shape[0], N_TERMS, -1, 3)


@dataclass(frozen=True)
class CuttingConfig:
    """Sizes of a cutting network.

    - width: numbers of a state
    - n_heads: attention heads, which divide ``width``
    - n_layers: encoder layers
    - inner: units of a feed-forward layer
    - n_looks, look: a summary is made of ``n_looks`` attention queries with ``look`` numbers each
    - hidden: units of the layers that make a condition and a score
    - dropout: probability
    """

    width: int = 128
    n_heads: int = 8
    n_layers: int = 4
    inner: int = 512
    n_looks: int = 4
    look: int = 48
    hidden: int = 96
    dropout: float = 0.0


class Cutting(nn.Module):
    """The cutting network.

    - config: its sizes
    - mean, deviation: (N_WORD,) of the tokens that it was trained on
    """

    mean: Tensor
    deviation: Tensor

    def __init__(self, config: CuttingConfig, mean: Tensor | None = None, deviation: Tensor | None = None) -> None:
        super().__init__()
        self.config = config
        self.register_buffer("mean", torch.zeros(N_WORD) if mean is None else mean)
        self.register_buffer("deviation", torch.ones(N_WORD) if deviation is None else deviation)
        width, hidden, summary = config.width, config.hidden, config.n_looks * config.look
        self.embedding = nn.Linear(2 * N_WORD, width)
        self.apart, self.own = nn.Linear(width, 2 * width), nn.Linear(N_WORD, width)
        sizes = BridgeConfig(width, config.n_heads, config.n_layers, config.inner, config.dropout)
        self.layers = nn.ModuleList(RotaryLayer(sizes) for _ in range(config.n_layers))
        self.norm = nn.LayerNorm(width)
        self.phase = nn.Linear(width, len(PHASES))
        self.looks = nn.Linear(width, 2 * config.n_looks)
        self.look = nn.Linear(width + N_WORD, config.look)
        self.relation = nn.Sequential(nn.Linear(3 * summary, hidden), nn.GELU(), nn.Linear(hidden, hidden), nn.GELU())
        self.leaving = _FrameScores(width, hidden)
        self.entering = _FrameScores(width, hidden)

    def read(self, tokens: Tensor, mask: Tensor | None = None) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Returns states (B, T, D) of frames, summaries (B, S) for leaving and for entering, and logits (B, T, 5) of
        phases.

        tokens: (B, T, N_WORD), with T even. mask: (B, T), False at padding.
        """
        numbers = standardise(tokens, self.mean, self.deviation)
        n_words, n_frames, width = *numbers.shape[:2], self.config.width
        pairs = self.embedding(numbers.reshape(n_words, n_frames // 2, 2 * N_WORD))  # (B, T / 2, D)
        allowed = None if mask is None else mask[:, None, None, ::2]
        rope = compute_rope_angles(pairs.shape[1], width // self.config.n_heads, pairs)
        for layer in self.layers:
            pairs = layer(pairs, rope, allowed)
        states = self.norm(self.apart(pairs).reshape(n_words, n_frames, width) + self.own(numbers))  # (B, T, D)
        weights = self.looks(states)  # (B, T, 2 n_looks)
        if mask is not None:
            weights = weights.masked_fill(~mask[..., None], -1e4)
        pooled = weights.softmax(dim=1).transpose(1, 2) @ self.look(torch.cat([states, numbers], dim=-1))
        leave, enter = pooled.flatten(1).chunk(2, dim=-1)
        return states, leave, enter, self.phase(states)

    def condition(self, leave: Tensor, enter: Tensor) -> Tensor:
        """Returns the condition (..., H) of a pair, from the summaries (..., S) for leaving one word and entering the
        other.
        """
        condition: Tensor = self.relation(torch.cat([leave, enter, enter - leave], dim=-1))
        return condition


class _FrameScores(nn.Module):
    """Scores of a word's frames under a condition."""

    def __init__(self, width: int, hidden: int) -> None:
        super().__init__()
        self.state, self.under = nn.Linear(width, hidden), nn.Linear(hidden, hidden)
        self.out = nn.Linear(hidden, 1)

    def forward(self, states: Tensor, condition: Tensor) -> Tensor:
        """Returns scores (..., T) of states (..., T, D) under a condition (..., H)."""
        scores: Tensor = self.out(F.gelu(self.state(states) + self.under(condition)[..., None, :]))[..., 0]
        return scores


class _Graph(nn.Module):
    """A part of the network, for export."""

    def __init__(self, network: Cutting) -> None:
        super().__init__()
        self.network = network


class ReadGraph(_Graph):
    """The part of the network that reads one word."""

    def forward(self, tokens: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Returns states, both summaries and logits of the phases, of one word (1, T, N_WORD)."""
        return self.network.read(tokens)


class ChooseGraph(_Graph):
    """The part of the network that scores a pair's frames."""

    def forward(self, before: Tensor, leave: Tensor, after: Tensor, enter: Tensor) -> tuple[Tensor, Tensor]:
        """Returns scores of leaving (1, P) and of entering (1, Q), from states (1, P, D) and (1, Q, D) and summaries
        (1, S).
        """
        condition = self.network.condition(leave, enter)
        return self.network.leaving(before, condition), self.network.entering(after, condition)
