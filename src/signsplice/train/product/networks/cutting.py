"""The network that cuts and times: which frame of the word before is the last to keep, which of the word after the
first, and how long the way between takes.

Where a word is left depends on the next one, but on little of it: how far and which way the hands have to go, and
whether the handshape changes. So every word is read alone, once, by a Transformer encoder with rotary positions
(``motion.features.word_tokens``), two frames to a token, into a state for each frame and two summaries, one for
leaving it and one for entering it: a few learned looks (attention pooling) at the moments that matter. For a pair the
two summaries and their difference make a condition, and every frame's score is read off its state under that condition.
A word's reading serves both of its seams, and any sentence that it stands in.

Beside it every frame is told apart by its phase (Kita et al. 1998), which makes the states know where movements begin.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812

from signsplice.splicing.features import N_FRAME, N_WORD, PHASES
from signsplice.train.product.networks.bridge import BridgeConfig, RotaryLayer, rope_angles, standard


@dataclass(frozen=True)
class CuttingConfig:
    """Sizes; ``n_looks`` of ``look`` numbers make a summary, ``hidden`` units read a condition and a score."""

    width: int = 128
    n_heads: int = 8
    n_layers: int = 4
    inner: int = 512
    n_looks: int = 4
    look: int = 48
    hidden: int = 96
    dropout: float = 0.0


class Cutting(nn.Module):
    """Words read one by one, and what two of them say together."""

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
        self.leaving = _WordGraph(width, hidden)
        self.entering = _WordGraph(width, hidden)
        self.timing = nn.Sequential(
            nn.Linear(3 * N_FRAME + 2 * summary, hidden), nn.GELU(), nn.Linear(hidden, hidden), nn.GELU(),
            nn.Linear(hidden, 1),
        )  # fmt: skip

    def read(self, tokens: Tensor, mask: Tensor | None = None) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """States (B, T, D), summaries (B, S) for leaving and for entering, and logits of the phases (B, T, 5), of words
        (B, T, N_WORD) of even lengths; ``mask`` (B, T) is False at padding.
        """
        seen = standard(tokens, self.mean, self.deviation)
        n_words, n_frames, width = *seen.shape[:2], self.config.width
        pairs = self.embedding(seen.reshape(n_words, n_frames // 2, 2 * N_WORD))
        allowed = None if mask is None else mask[:, None, None, ::2]
        turns = rope_angles(pairs.shape[1], width // self.config.n_heads, pairs)
        for layer in self.layers:
            pairs = layer(pairs, turns, allowed)
        states = self.norm(self.apart(pairs).reshape(n_words, n_frames, width) + self.own(seen))
        weights = self.looks(states)
        if mask is not None:
            weights = weights.masked_fill(~mask[..., None], -1e4)
        looked = weights.softmax(dim=1).transpose(1, 2) @ self.look(torch.cat([states, seen], dim=-1))
        leave, enter = looked.flatten(1).chunk(2, dim=-1)
        return states, leave, enter, self.phase(states)

    def condition(self, leave: Tensor, enter: Tensor) -> Tensor:
        """What two words are to one another (..., H), of the one's summary for leaving (..., S) and the other's for
        entering (..., S).
        """
        made: Tensor = self.relation(torch.cat([leave, enter, enter - leave], dim=-1))
        return made

    def seconds(self, leaving: Tensor, entering: Tensor, leave: Tensor, enter: Tensor) -> Tensor:
        """Seconds (...,) of the transition between two frames (..., N_FRAME) of two words with those summaries
        (..., S).
        """
        a, b = (standard(x, self.mean[:N_FRAME], self.deviation[:N_FRAME]) for x in (leaving, entering))
        out: Tensor = self.timing(torch.cat([a, b, b - a, leave, enter], dim=-1))[..., 0]
        return F.softplus(out - 1.2)


class _WordGraph(nn.Module):
    """Scores of frames under a condition."""

    def __init__(self, width: int, hidden: int) -> None:
        super().__init__()
        self.state, self.under = nn.Linear(width, hidden), nn.Linear(hidden, hidden)
        self.out = nn.Linear(hidden, 1)

    def forward(self, states: Tensor, condition: Tensor) -> Tensor:
        """Scores (..., T) of states (..., T, D) under a condition (..., H)."""
        out: Tensor = self.out(F.gelu(self.state(states) + self.under(condition)[..., None, :]))[..., 0]
        return out


class ReadGraph(nn.Module):
    """A word's reading, as a graph."""

    def __init__(self, network: Cutting) -> None:
        super().__init__()
        self.network = network

    def forward(self, tokens: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """States, both summaries, and the phases, of one word (1, T, N_WORD)."""
        return self.network.read(tokens)


class ChooseGraph(nn.Module):
    """A pair's scores, as a graph."""

    def __init__(self, network: Cutting) -> None:
        super().__init__()
        self.network = network

    def forward(self, before: Tensor, leave: Tensor, after: Tensor, enter: Tensor) -> tuple[Tensor, Tensor]:
        """Scores of leaving (1, P) and entering (1, Q), of both words' states (1, P, D) and (1, Q, D) and summaries."""
        condition = self.network.condition(leave, enter)
        return self.network.leaving(before, condition), self.network.entering(after, condition)


class TimeGraph(nn.Module):
    """A pair's seconds, as a graph."""

    def __init__(self, network: Cutting) -> None:
        super().__init__()
        self.network = network

    def forward(self, leaving: Tensor, entering: Tensor, leave: Tensor, enter: Tensor) -> Tensor:
        """Seconds (1,)."""
        return self.network.seconds(leaving, entering, leave, enter)
