"""The training losses. Every loss is a mean over pairs, so that it does not depend on how processes divide a batch.

**Tokens.** Only one frame in about 140 bears a token. Plain cross-entropy over frames would favour "none" everywhere,
and emit nothing where it is undecided between neighbours. As in the paper, each frame is classified, but tokens weigh
``TOKEN_WEIGHT`` times as much as "none". A second, pointer term is the cross-entropy of a softmax over frames of the
log-odds of token against none. It makes the right frame stand out among all, because the position is the frame where
the token is likeliest. The paper names no loss: weights and pointer term are additions, and the system as printed is
trained with plain cross-entropy.

**Frames.** Mean squared error, with each number divided by its deviation over the training pairs, and cross-entropy of
"this is the last frame".
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional as F  # noqa: N812

from signsplice_paper.train.networks.spsn import NONE, POST, PRE

TOKEN_WEIGHT = 40.0
FRAME_WEIGHT = 10.0
"""Scales errors of frames, which are some hundredths, to about the size of the tokens' loss."""
_MASKED = -1e4


def token_loss(logits: Tensor, pre: Tensor, post: Tensor, mask: Tensor | None = None, plain: bool = False) -> Tensor:
    """Returns the loss () of logits (B, S, 3) for tokens at frames ``pre`` and ``post`` (B,) of X.

    mask (B, S): False at padding. plain: cross-entropy alone, each frame with the same weight.
    """
    logits = logits.float()
    labels = torch.full(logits.shape[:2], NONE, device=logits.device)
    labels = labels.scatter(1, pre[:, None], PRE).scatter(1, post[:, None], POST)
    weights = torch.where(labels == NONE, 1.0, 1.0 if plain else TOKEN_WEIGHT)
    if mask is not None:
        weights = weights * mask
    per_frame = F.cross_entropy(logits.transpose(1, 2), labels, reduction="none")
    total = ((per_frame * weights).sum(1) / weights.sum(1)).mean()
    if plain:
        return total
    for token, position in ((PRE, pre), (POST, post)):
        log_odds = logits[..., token] - logits[..., NONE]
        if mask is not None:
            log_odds = log_odds.masked_fill(~mask, _MASKED)
        total = total + F.cross_entropy(log_odds, position)
    return total


def frame_loss(predicted: Tensor, true: Tensor, real: Tensor, deviation: Tensor) -> Tensor:
    """Returns the loss () of frames (B, T, K): scaled mean squared error; ``real`` (B, T) is False at padding."""
    per_frame = (((predicted.float() - true) / deviation) ** 2).mean(-1) * real
    return FRAME_WEIGHT * (per_frame.sum(1) / real.sum(1)).mean()


def last_loss(last: Tensor, real: Tensor) -> Tensor:
    """Returns the loss () of logits (B, T) for "this is the last frame": cross-entropy, summed over a pair's frames."""
    is_last = torch.arange(last.shape[1], device=last.device) == real.sum(1, keepdim=True) - 1
    per_frame = F.binary_cross_entropy_with_logits(last.float(), is_last.float(), reduction="none") * real
    return per_frame.sum(1).mean()
