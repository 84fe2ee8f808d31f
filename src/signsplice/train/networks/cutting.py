"""The network that cuts and times: the last frame to keep of the word before, the first of the word after, and the
duration of the transition between them.

Where to leave a word depends little on the next word: on how far and in which direction the hands have to go, and on
whether the handshape changes. So a Transformer encoder with rotary positions reads every word alone and once
(``networks.features.word_tokens``), two frames to a token. It yields a state for each frame and two summaries, one for
leaving the word and one for entering it; a summary is made by a few learned attention queries. For a pair of words, the
two summaries and their difference form a condition, and every frame's score follows from its state and the condition.
One reading of a word serves both of its seams in any sentence.

The network also classifies every frame by its phase (Kita et al. 1998), so that its states mark where movements begin.

Names of attributes that hold weights are stored in checkpoints and in ONNX graphs, from which training can continue:
do not rename them.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812

from signsplice.splicing.word_features import N_FRAME, N_WORD, PHASES
from signsplice.train.networks.bridge import BridgeConfig, RotaryLayer, rope_angles, standardised


@dataclass(frozen=True)
class CuttingConfig:
    """Sizes of a cutting network.

    - width: numbers of a state
    - n_heads: attention heads, which divide ``width``
    - n_layers: encoder layers
    - inner: units of a feed-forward layer
    - n_looks, look: a summary is made of ``n_looks`` attention queries with ``look`` numbers each
    - hidden: units of the layers that make a condition, a score and a duration
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
    """The cutting and timing network.

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
        self.timing = nn.Sequential(
            nn.Linear(3 * N_FRAME + 2 * summary, hidden), nn.GELU(), nn.Linear(hidden, hidden), nn.GELU(),
            nn.Linear(hidden, 1),
        )  # fmt: skip

    def read(self, tokens: Tensor, mask: Tensor | None = None) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """States (B, T, D) of frames, summaries (B, S) for leaving and for entering, and logits (B, T, 5) of phases.

        tokens: (B, T, N_WORD), with T even. mask: (B, T), False at padding.
        """
        numbers = standardised(tokens, self.mean, self.deviation)
        n_words, n_frames, width = *numbers.shape[:2], self.config.width
        pairs = self.embedding(numbers.reshape(n_words, n_frames // 2, 2 * N_WORD))  # (B, T / 2, D)
        allowed = None if mask is None else mask[:, None, None, ::2]
        rope = rope_angles(pairs.shape[1], width // self.config.n_heads, pairs)
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
        """The condition (..., H) of a pair, from the summaries (..., S) for leaving one word and entering the other."""
        out: Tensor = self.relation(torch.cat([leave, enter, enter - leave], dim=-1))
        return out

    def seconds(self, leaving: Tensor, entering: Tensor, leave: Tensor, enter: Tensor) -> Tensor:
        """Seconds (...,) of the transition between two frames (..., N_FRAME) of two words with the given summaries
        (..., S).
        """
        a, b = (standardised(x, self.mean[:N_FRAME], self.deviation[:N_FRAME]) for x in (leaving, entering))
        out: Tensor = self.timing(torch.cat([a, b, b - a, leave, enter], dim=-1))[..., 0]
        return F.softplus(out - 1.2)


class _FrameScores(nn.Module):
    """Scores of a word's frames under a condition."""

    def __init__(self, width: int, hidden: int) -> None:
        super().__init__()
        self.state, self.under = nn.Linear(width, hidden), nn.Linear(hidden, hidden)
        self.out = nn.Linear(hidden, 1)

    def forward(self, states: Tensor, condition: Tensor) -> Tensor:
        """Scores (..., T) of states (..., T, D) under a condition (..., H)."""
        out: Tensor = self.out(F.gelu(self.state(states) + self.under(condition)[..., None, :]))[..., 0]
        return out


class _Graph(nn.Module):
    """A part of the network, for export."""

    def __init__(self, network: Cutting) -> None:
        super().__init__()
        self.network = network


class ReadGraph(_Graph):
    """The part of the network that reads one word."""

    def forward(self, tokens: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """States, both summaries and logits of the phases, of one word (1, T, N_WORD)."""
        return self.network.read(tokens)


class ChooseGraph(_Graph):
    """The part of the network that scores a pair's frames."""

    def forward(self, before: Tensor, leave: Tensor, after: Tensor, enter: Tensor) -> tuple[Tensor, Tensor]:
        """Scores of leaving (1, P) and of entering (1, Q), from states (1, P, D) and (1, Q, D) and summaries (1, S)."""
        condition = self.network.condition(leave, enter)
        return self.network.leaving(before, condition), self.network.entering(after, condition)


class TimeGraph(_Graph):
    """The part of the network that times a pair."""

    def forward(self, leaving: Tensor, entering: Tensor, leave: Tensor, enter: Tensor) -> Tensor:
        """Seconds (1,) of the transition between two frames (1, N_FRAME) of two words with summaries (1, S)."""
        return self.network.seconds(leaving, entering, leave, enter)
