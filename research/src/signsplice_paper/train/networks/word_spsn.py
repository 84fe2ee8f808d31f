"""SPSN word by word: every word is read once and alone, and the partner enters as a summary.

SPSN reads both words as one sequence, so that one step teaches B pairs, and a word is learned anew beside every
partner. Here two LSTM layers run both ways over each word. Four weighted means of its states, with learned weights,
make its summary. The score of a frame as the last one kept before a partner is a bilinear form of the frame's state and
the partner's summary, and so for the first one kept after. A softmax over the word's own frames follows: there are no
tokens and no "none". One step on W words teaches up to W * W pairs.
Besides frames it reads what decides where a hand rests, and in which shape: steps, speeds and distances.

Shapes: W words, T frames, K numbers, D width, S size of a summary.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812

from signsplice_paper.train.networks.layers import Normaliser
from signsplice_paper.train.networks.recurrent import Lstm

STEP = 5e-4
"""Step of a number from frame to frame, 1 mm on the standard body, from which on steps are read as logarithms: hands at
rest move less, hands on their way up to 60 times as much."""
NEAREST, USUAL = 5e-3, 2.0
"""Distances are read as 2 (log(distance + ``NEAREST``) + ``USUAL``), which is about 0 for 29 cm."""
BENT = 3
"""A joint's distance to the joint so many above it shows how far the joints between are bent."""
BRANCHES = 3
"""Joints with so many children, as hips, chest and hands, are watched like those without any."""
LOOKS = 4
"""Weighted means of a word's states that make its summary."""
_MASKED = -1e4


@dataclass(frozen=True)
class WordSpsnConfig:
    """Sizes.

    - width: of states and embeddings
    - summary: numbers of a summary that each side reads
    - dropout: probability
    - parents: the joint above each, -1 for none; only where they are given, distances between joints are read
    """

    width: int = 64
    summary: int = 64
    dropout: float = 0.1
    parents: Sequence[int] = ()


def joint_pairs(parents: Sequence[int]) -> list[tuple[int, int]]:
    """The pairs of joints whose distance is read: each joint with the one ``BENT`` above it, and all pairs of those
    that end a limb or branch.
    """
    pairs = []
    for joint in range(len(parents)):
        above = joint
        for _ in range(BENT):
            above = parents[above] if above >= 0 else -1
        if above >= 0:
            pairs.append((joint, above))
    n_children = [list(parents).count(joint) for joint in range(len(parents))]
    watched = [joint for joint, count in enumerate(n_children) if count == 0 or count >= BRANCHES]
    return pairs + [(a, b) for a, b in combinations(watched, 2) if (b, a) not in pairs]


class BothWays(nn.Module):
    """An LSTM layer over each word forwards, and one backwards from its last frame."""

    def __init__(self, n_inputs: int, width: int) -> None:
        super().__init__()
        self.forwards, self.backwards = Lstm(n_inputs, width), Lstm(n_inputs, width)

    def forward(self, x: Tensor, turned: Tensor) -> Tensor:
        """States (W, T, 2 D) of inputs (W, T, I). turned: the frames (W, T) of each word from the last one on."""
        back = self.backwards(_gather(x, turned))[0]
        return torch.cat([self.forwards(x)[0], _gather(back, turned)], dim=-1)


def _gather(x: Tensor, frames: Tensor) -> Tensor:
    return x.gather(1, frames[..., None].expand(-1, -1, x.shape[-1]))


class WordSpsn(nn.Module):
    """The network: ``read`` depends on one word, ``pair_scores`` on all pairs of some; ``forward`` is as SPSN's."""

    def __init__(self, config: WordSpsnConfig, normaliser: Normaliser) -> None:
        super().__init__()
        self.config, self.normaliser = config, normaliser
        width, n_numbers = config.width, normaliser.n_numbers
        self.pairs = joint_pairs(config.parents)
        self.embedding = nn.Linear(2 * n_numbers + n_numbers // 3 + len(self.pairs), width)
        self.layers = nn.ModuleList([BothWays(width, width), BothWays(2 * width, width)])
        self.dropout = nn.Dropout(config.dropout)
        self.look = nn.Linear(2 * width, LOOKS)
        self.summary = nn.Sequential(
            nn.Linear(2 * width * LOOKS, width),
            nn.ReLU(),
            nn.Dropout(config.dropout),
            nn.Linear(width, 2 * config.summary),
        )
        self.keys = nn.Linear(2 * width, 2 * config.summary)
        self.usual = nn.Linear(2 * width, 2)

    def features(self, x: Tensor) -> Tensor:
        """What is read of words (W, T, K): numbers, steps from the frame before, the speed of each joint, and distances
        of joints.
        """
        steps = torch.cat([torch.zeros_like(x[:, :1]), x[:, 1:] - x[:, :-1]], dim=1) / STEP
        speeds = torch.log1p(steps.reshape(*steps.shape[:2], -1, 3).norm(dim=-1))
        read = [self.normaliser(x), torch.asinh(steps), speeds]
        if self.pairs:
            a, b = (list(joints) for joints in zip(*self.pairs, strict=True))
            joints = x.reshape(*x.shape[:2], -1, 3)
            read.append(2.0 * (((joints[:, :, a] - joints[:, :, b]).norm(dim=-1) + NEAREST).log() + USUAL))
        return torch.cat(read, dim=-1)

    def read(self, x: Tensor, mask: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Keys (W, T, 2 S) and usual scores (W, T, 2) of frames, and summaries (W, 2 S), of words (W, T, K)."""
        at = torch.arange(x.shape[1], device=x.device)
        turned = (mask.sum(1, keepdim=True) - 1 - at).clamp(min=0)  # (W, T)
        states = self.embedding(self.features(x))
        for layer in self.layers:
            states = self.dropout(layer(states, turned))  # (W, T, 2 D)
        weights = self.look(states).masked_fill(~mask[..., None], _MASKED).softmax(1)
        summary = self.summary(torch.einsum("wtd,wtl->wld", states, weights).flatten(1))
        return self.keys(states), self.usual(states), summary

    def pair_scores(self, x: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
        """Scores (W, W, T) of the frames of each word (first axis) before each partner, and (W, W, T) of the frames of
        each word (second axis) after each partner. mask (W, T): False at padding, which follows each word.
        """
        keys, usual, summary = self.read(x, mask)
        size = self.config.summary
        leave = usual[:, None, :, 0] + torch.einsum("pts,qs->pqt", keys[..., :size], summary[:, :size])
        enter = usual[None, :, :, 1] + torch.einsum("qts,ps->pqt", keys[..., size:], summary[:, size:])
        return leave.masked_fill(~mask[:, None], _MASKED), enter.masked_fill(~mask[None], _MASKED)

    def forward(self, x: Tensor, n_before: Tensor, mask: Tensor | None = None) -> Tensor:
        """Logits (B, S, 3) of the frames X (B, S, K), as SPSN gives them: the highest score of each word is 1, "none"
        is 0, so that both tokens are emitted.

        n_before (B,): N. mask (B, S): False at padding, which follows X.
        """
        at = torch.arange(x.shape[1], device=x.device)[None]
        real = torch.ones_like(x[..., 0], dtype=torch.bool) if mask is None else mask
        n, n_after = n_before[:, None], real.sum(1, keepdim=True) - n_before[:, None]
        is_before, is_after = at < n, (at >= n) & real
        shifted = (at + n).clamp(max=x.shape[1] - 1)
        p, q = self.read(x, is_before), self.read(_gather(x, shifted), at < n_after)
        size = self.config.summary
        leave = p[1][..., 0] + (p[0][..., :size] * q[2][:, None, :size]).sum(-1)  # (B, S)
        enter = q[1][..., 1] + (q[0][..., size:] * p[2][:, None, size:]).sum(-1)
        enter = enter.gather(1, (at - n).clamp(min=0))
        logits = [torch.zeros_like(leave)]
        for scores, own in ((leave, is_before), (enter, is_after)):
            scores = scores.masked_fill(~own, _MASKED)
            logits.append((scores - scores.amax(1, keepdim=True) + 1.0).clamp(min=_MASKED))
        return torch.stack(logits, dim=-1)


def position_loss(scores: tuple[Tensor, Tensor], cuts: Tensor, taught: Tensor) -> Tensor:
    """The cross-entropy () of both positions, a mean over pairs. cuts: (W, W, 2); taught: pairs (W, W) that count."""
    each = sum(
        F.cross_entropy(side.flatten(0, 1).float(), cuts[..., k].flatten(), reduction="none")
        for k, side in enumerate(scores)
    )
    return (each * taught.flatten()).sum() / taught.sum().clamp(min=1)
