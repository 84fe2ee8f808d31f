"""SPSN, the network that finds the splice positions (eq. 4-10).

X is the N frames of the first word, then the M of the second. LSTM encoder and decoder both run over X, frame by frame
(eq. 4 and 5; eq. 5 prints C_t = F_t * W_xc + ..., where an LSTM has C_t = F_t * C_{t-1} + I_t * C~_t, which torch
computes). The decoder's state at t is compared with every state of the encoder (eq. 6), the weights form the context
(eq. 7-9), and each frame is classified as {none, prePositionToken, postPositionToken} (our reading of eq. 9 and 10).

The paper does not specify what the decoder receives from the encoder besides attention. Here it starts from the
encoder's last state H_{N+M} through a learned linear layer (Bahdanau et al. 2015).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from signsplice_paper.train.networks.layers import Normaliser
from signsplice_paper.train.networks.recurrent import Lstm

NONE, PRE, POST = 0, 1, 2
"""The classes of a frame."""

USUAL_FRAMES = 150
"""Usual number of frames of two words. The printed weights (eq. 7, 8) sum to N + M - 1 in place of 1, so that the
context would saturate eq. 9 from the start; the half of W_c that reads it is divided by this number at the start."""


@dataclass(frozen=True)
class SpsnConfig:
    """Sizes and design of SPSN.

    - width: of states and embeddings
    - attention: whether it has attention; without it, it is the ablation WA
    - dropout: probability that a number of a state is dropped
    """

    width: int = 512
    attention: bool = True
    dropout: float = 0.1


def score(decoded: Tensor, encoded: Tensor) -> Tensor:
    """Returns the mean squared differences (B, T, S) of states (B, T, D) and (B, S, D) (eq. 6)."""
    device = decoded.device.type
    if torch.amp.is_autocast_available(device) and torch.is_autocast_enabled(device):
        with torch.autocast(device, enabled=False):  # half precision would lose small differences of large states
            return score(decoded.float(), encoded.float())
    squares = decoded.square().mean(-1)[:, :, None] + encoded.square().mean(-1)[:, None, :]
    return squares - 2.0 * decoded @ encoded.transpose(1, 2) / decoded.shape[-1]


def paper_attention_weights(scores: Tensor, mask: Tensor | None = None) -> Tensor:
    """Returns the weights a = 1 - softmax(score) (B, T, S), as printed (eq. 7, 8); 0 at padding."""
    if mask is None:
        return 1.0 - scores.softmax(-1)
    weights = 1.0 - scores.masked_fill(~mask[:, None], -torch.inf).softmax(-1)
    return weights * mask[:, None]


def mask_impossible_tokens(logits: Tensor, n_before: Tensor) -> Tensor:
    """Returns the logits (B, S, 3) with pre excluded in the second word, post in the first; ``n_before`` (B,) is N."""
    in_before = torch.arange(logits.shape[1], device=logits.device)[None] < n_before[:, None]  # (B, S)
    excluded = torch.stack([torch.zeros_like(in_before), ~in_before, in_before], dim=-1)
    return logits.masked_fill(excluded, -1e4)


def take_last_states(states: Tensor, mask: Tensor | None) -> Tensor:
    """Returns the state (B, D) of each row at its last frame before padding, from states (B, S, D)."""
    if mask is None:
        return states[:, -1]
    return take_states(states, mask.sum(1) - 1)


def take_states(states: Tensor, frames: Tensor) -> Tensor:
    """Returns the state (B, D) of each row at a frame (B,), from states (B, S, D)."""
    return states.gather(1, frames[:, None, None].expand(-1, 1, states.shape[-1]))[:, 0]


def take_end_states(states: Tensor, n_before: Tensor, mask: Tensor | None) -> Tensor:
    """Returns the states (B, 2 D) at the last frames of both words, from states (B, S, D)."""
    return torch.cat([take_states(states, n_before - 1), take_last_states(states, mask)], dim=-1)


class Spsn(nn.Module):
    """The network that classifies every frame of X."""

    def __init__(self, config: SpsnConfig, normaliser: Normaliser) -> None:
        super().__init__()
        self.config, self.normaliser = config, normaliser
        width = config.width
        self.embedding = nn.Linear(normaliser.n_numbers, width)
        self.encoder, self.decoder = Lstm(width, width), Lstm(width, width)
        self.bridge = nn.Linear(width, 2 * width)
        if config.attention:
            self.combine = nn.Linear(2 * width, width, bias=False)
            with torch.no_grad():
                self.combine.weight[:, :width] /= USUAL_FRAMES
        self.out = nn.Linear(width, 3)
        self.dropout = nn.Dropout(config.dropout)

    def forward(self, x: Tensor, n_before: Tensor, mask: Tensor | None = None) -> Tensor:
        """Returns the logits (B, S, 3) of the frames X (B, S, K), positions that are not normalised.

        n_before (B,): N. mask (B, S): False at padding, which follows X.
        """
        x = self.embedding(self.normaliser(x))
        encoded = self.dropout(self.encoder(x)[0])  # (B, S, D)
        hidden, cell = self.bridge(take_last_states(encoded, mask)).chunk(2, dim=-1)
        start = hidden.tanh()[None].contiguous(), cell[None].contiguous()
        decoded, _ = self.decoder(x, start)  # (B, S, D)
        return mask_impossible_tokens(self.out(self.attend(self.dropout(decoded), encoded, mask)), n_before)

    def attend(self, decoded: Tensor, encoded: Tensor, mask: Tensor | None) -> Tensor:
        """Returns H~ (B, T, D) = tanh(W_c [C_t, H_t]) with C_t = a_t H (eq. 9); without attention, ``decoded``."""
        if not self.config.attention:
            return decoded
        weights = paper_attention_weights(score(decoded, encoded), mask)
        return torch.tanh(self.combine(torch.cat([weights @ encoded, decoded], dim=-1)))
