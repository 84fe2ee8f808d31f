"""SPSN, the network that searches the splice positions (eq. 4-10).

LSTM encoder and decoder both run over X, frame by frame (eq. 4 and 5; eq. 5 prints C_t = F_t * W_xc + ..., the LSTM is
C_t = F_t * C_{t-1} + I_t * C~_t, which torch computes). How the decoder learns what the encoder has seen, but by
attention, is not said: here a learned bridge turns the encoder's states at the ends of the two words, H_N and H_{N+M},
into the decoder's first state (Bahdanau et al. 2015) and into a summary that it reads beside every frame (Cho et al.
2014). The decoder's state at t is compared with every state of the encoder (eq. 6), the weights rebuild the encoding
(eq. 7-9), and each frame is classified as {none, prePositionToken, postPositionToken} (the reading of eq. 9 and 10).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from signsplice.train.paper.networks.layers import N_NUMBERS, N_READ, Normaliser, with_steps
from signsplice.train.paper.networks.recurrent import Lstm

NONE, PRE, POST = 0, 1, 2
"""The classes of a frame."""

ATTENTIONS = ("normalised", "printed", "none")


@dataclass(frozen=True)
class SpsnConfig:
    """SPSN's sizes. ``attention``: "printed" is a = 1 - softmax(score), whose weights sum to N + M - 1; "normalised" is
    softmax(-sharpness * score), with a learned sharpness, which begins at the root of the width; "none" is the ablation
    WA. ``steps``: whether it reads the steps between frames too, or frames alone, as printed.
    """

    width: int = 512
    attention: str = "normalised"
    dropout: float = 0.1
    steps: bool = True

    def __post_init__(self) -> None:
        if self.attention not in ATTENTIONS:
            raise ValueError(f"attention {self.attention!r}, expected one of {', '.join(ATTENTIONS)}")


def score(decoded: Tensor, encoded: Tensor) -> Tensor:
    """Mean squared differences (B, T, S) of states (B, T, D) and (B, S, D) (eq. 6)."""
    squares = decoded.square().mean(-1)[:, :, None] + encoded.square().mean(-1)[:, None, :]
    return squares - 2.0 * decoded @ encoded.transpose(1, 2) / decoded.shape[-1]


def printed_weights(scores: Tensor, mask: Tensor | None = None) -> Tensor:
    """Weights a = 1 - softmax(score) (B, T, S), as printed (eq. 7, 8); 0 at padding."""
    if mask is None:
        return 1.0 - scores.softmax(-1)
    weights = 1.0 - scores.masked_fill(~mask[:, None], -torch.inf).softmax(-1)
    return weights * mask[:, None]


def normalised_weights(scores: Tensor, sharpness: Tensor, mask: Tensor | None = None) -> Tensor:
    """softmax(-sharpness * score) (B, T, S): near states weigh more, as in eq. 7, and the weights sum to 1."""
    scores = -sharpness * scores
    if mask is not None:
        scores = scores.masked_fill(~mask[:, None], -torch.inf)
    return scores.softmax(-1)


def admissible(logits: Tensor, n_before: Tensor) -> Tensor:
    """Logits (B, S, 3) with pre ruled out in Q and post in P; ``n_before`` (B,) is N."""
    in_before = torch.arange(logits.shape[1], device=logits.device)[None] < n_before[:, None]  # (B, S)
    ruled_out = torch.stack([torch.zeros_like(in_before), ~in_before, in_before], dim=-1)
    return logits.masked_fill(ruled_out, -1e4)


def last_states(states: Tensor, mask: Tensor | None) -> Tensor:
    """Each row's state (B, D) at its last frame that is no padding, of states (B, S, D)."""
    if mask is None:
        return states[:, -1]
    return states_at(states, mask.sum(1) - 1)


def states_at(states: Tensor, frames: Tensor) -> Tensor:
    """Each row's state (B, D) at a frame (B,), of states (B, S, D)."""
    return states.gather(1, frames[:, None, None].expand(-1, 1, states.shape[-1]))[:, 0]


class Spsn(nn.Module):
    """Classifies every frame of X."""

    def __init__(self, config: SpsnConfig, normaliser: Normaliser) -> None:
        super().__init__()
        self.config, self.normaliser = config, normaliser
        width = config.width
        self.embedding = nn.Linear(N_READ if config.steps else N_NUMBERS, width)
        self.encoder, self.decoder = Lstm(width, width), Lstm(2 * width, width)
        self.bridge = nn.Linear(2 * width, 3 * width)
        if config.attention != "none":
            self.combine = nn.Linear(2 * width, width, bias=False)
        self.sharpness = nn.Parameter(torch.tensor(0.5).mul(torch.tensor(float(width)).log()))
        self.sharpness.requires_grad_(config.attention == "normalised")
        self.out = nn.Linear(width, 3)
        self.dropout = nn.Dropout(config.dropout)

    def forward(self, x: Tensor, n_before: Tensor, mask: Tensor | None = None) -> Tensor:
        """Logits (B, S, 3) of the frames X (B, S, 159); ``n_before`` (B,) is N, ``mask`` (B, S) is False at padding,
        which follows X.
        """
        x = self.normaliser(x)
        x = self.embedding(with_steps(x, n_before) if self.config.steps else x)
        encoded = self.dropout(self.encoder(x)[0])  # (B, S, D)
        ends = torch.cat([states_at(encoded, n_before - 1), last_states(encoded, mask)], dim=-1)
        hidden, cell, summary = self.bridge(ends).chunk(3, dim=-1)
        beside = summary.tanh()[:, None].expand(-1, x.shape[1], -1)
        start = hidden.tanh()[None].contiguous(), cell[None].contiguous()
        decoded, _ = self.decoder(torch.cat([x, beside], dim=-1), start)  # (B, S, D)
        return admissible(self.out(self.attend(self.dropout(decoded), encoded, mask)), n_before)

    def attend(self, decoded: Tensor, encoded: Tensor, mask: Tensor | None) -> Tensor:
        """H~ (B, T, D) = tanh(W_c [C_t, H_t]) with C_t = a_t H (eq. 9); without attention, the decoder's states."""
        if self.config.attention == "none":
            return decoded
        scores = score(decoded, encoded)
        if self.config.attention == "printed":
            weights = printed_weights(scores, mask)
        else:
            weights = normalised_weights(scores, self.sharpness.exp(), mask)
        return torch.tanh(self.combine(torch.cat([weights @ encoded, decoded], dim=-1)))
