"""What training makes small. Every loss is a mean over pairs of what each pair alone costs, so that a batch shared by
several processes costs the same as in one.

**Tokens.** One frame in about 140 bears a token, so plain cross-entropy over frames would be content with "none"
everywhere, and silent where it doubts between neighbours. The paper's reading, each frame a class, stays; tokens weigh
``TOKEN_WEIGHT`` times as much as "none", and a pointer term, the cross-entropy of a softmax over frames of the log-odds
of token against none, asks that the right frame stand out among all, since the position is where the token is
likeliest.

**Frames.** Mean squared error, each number over its own deviation in the training pairs, and cross-entropy of "this is
the last frame".
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F  # noqa: N812

from signsplice.train.paper.networks.spsn import NONE, POST, PRE

TOKEN_WEIGHT = 40.0
FRAME_WEIGHT = 10.0
"""Frames' errors are some hundredths: scaled up, so that they weigh about as much as the tokens'."""
_NEVER = -1e4


def token_loss(logits: Tensor, pre: Tensor, post: Tensor, mask: Tensor | None = None) -> Tensor:
    """Loss of logits (B, S, 3) for tokens at frames ``pre`` and ``post`` (B,) of X; ``mask`` (B, S): no padding."""
    logits = logits.float()
    labels = torch.full(logits.shape[:2], NONE, device=logits.device)
    labels = labels.scatter(1, pre[:, None], PRE).scatter(1, post[:, None], POST)
    weights = torch.where(labels == NONE, 1.0, TOKEN_WEIGHT)
    if mask is not None:
        weights = weights * mask
    each = F.cross_entropy(logits.transpose(1, 2), labels, reduction="none")
    total = ((each * weights).sum(1) / weights.sum(1)).mean()
    for token, at in ((PRE, pre), (POST, post)):
        odds = logits[..., token] - logits[..., NONE]
        if mask is not None:
            odds = odds.masked_fill(~mask, _NEVER)
        total = total + F.cross_entropy(odds, at)
    return total


def frame_loss(made: Tensor, true: Tensor, real: Tensor, deviation: Tensor) -> Tensor:
    """Mean squared error of frames (B, T, 159); ``real`` (B, T) False at padding."""
    each = (((made.float() - true) / deviation) ** 2).mean(-1) * real
    return FRAME_WEIGHT * (each.sum(1) / real.sum(1)).mean()


def last_loss(last: Tensor, real: Tensor) -> Tensor:
    """Cross-entropy of logits (B, T) against "this is the last frame", summed over a pair's frames."""
    is_last = torch.arange(last.shape[1], device=last.device) == real.sum(1, keepdim=True) - 1
    each = F.binary_cross_entropy_with_logits(last.float(), is_last.float(), reduction="none") * real
    return each.sum(1).mean()
