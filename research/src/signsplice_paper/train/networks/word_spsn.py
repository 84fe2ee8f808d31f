"""SPSN word by word: every word is read once and alone, and the partner enters as a summary.

SPSN reads both words as one sequence, so that one step teaches B pairs, and a word is learned anew with every partner.
Here two bidirectional LSTM layers run over each word. Four weighted means of its states, with learned weights, make its
summary. The score of a frame as the last one kept before a partner is a bilinear form of the frame's state and the
partner's summary; so is the score of a frame as the first one kept after a partner. A softmax over the word's frames
follows: there are no tokens and no "none". One step on W words teaches up to W * W pairs.
Besides frames it reads features that show where and in which shape a hand rests: steps, speeds, and measures of joints.

Shapes: W words, T frames, K numbers, D width, S size of a summary.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812

from signsplice_paper.train.networks.layers import Normaliser
from signsplice_paper.train.networks.recurrent import Lstm

STEP = 5e-4
"""Step of a number from frame to frame, 1 mm on the standard body, from which on steps are read as logarithms: hands at
rest move less, moving hands up to 60 times as much."""
BENT = 3
"""Number of bones of a chain whose reach is measured: reach over length shows how far the chain is bent, whatever the
body's size."""
NEAREST, SLOWEST = 5e-3, 2e-4
"""Distances and speeds of hands are read as logarithms from these on: 11 mm, and .4 mm a frame."""
FINE = (0.05, 0.04, 1 / 6, 0.5)
"""Units of the fine measures of each hand: mean reach of its fingers, height of the wrist, logarithm of its nearest gap
to the rest of the body, and of its speed."""
WAVES = (1.0, 2.0, 4.0, 8.0)
"""Frequencies, in radians a unit, of the sines and cosines that encode fine measures, as positional encodings do: a
network that reads a number alone is slow to learn where it passes a limit."""
DEVIATION_FLOOR = 0.05
"""Smallest deviation by which a measure is divided: lengths that never change on the taught bodies would be huge on
another body."""
LOOKS = 4
"""Number of weighted means of a word's states that make its summary."""
_MASKED = -1e4


@dataclass(frozen=True)
class WordSpsnConfig:
    """Sizes.

    - width: of states and embeddings
    - summary: numbers of a summary that each side reads
    - dropout: probability
    - parents: the parent of each joint, -1 for none; if empty, nothing is measured between joints
    - hands: of each hand the wrist, and the last joints of index to little finger
    """

    width: int = 64
    summary: int = 64
    dropout: float = 0.1
    parents: Sequence[int] = ()
    hands: Sequence[Sequence[int]] = ()


class Measures:
    """Measures of a skeleton's joints in each frame: the reach of chains of ``BENT`` bones, gaps of both hands to
    trunk, head, arms and each other, and speeds of hands; some are also read finely.

    - count: number of measures
    - n_fine: number of values that encode the fine measures
    """

    def __init__(self, parents: Sequence[int], hands: Sequence[Sequence[int]]) -> None:
        ancestors = [[joint] for joint in range(len(parents))]
        for chain in ancestors:
            while parents[chain[-1]] >= 0:
                chain.append(parents[chain[-1]])
        wrists = [hand[0] for hand in hands]
        fingers = [joint for joint, chain in enumerate(ancestors) if not set(chain[1:]).isdisjoint(wrists)]
        trunk = {ancestors[wrist][-2] for wrist in wrists}
        body = [joint for joint, chain in enumerate(ancestors) if not trunk.isdisjoint(chain) and joint not in fingers]
        tips = [joint for joint in fingers if joint not in parents]
        self.wrists, self.parents = wrists, [chain[min(1, len(chain) - 1)] for chain in ancestors]
        self.chains = [chain[: BENT + 1] for chain in ancestors if len(chain) > BENT]
        self.hands = [[wrist, *(joint for joint in tips if wrist in ancestors[joint])] for wrist in wrists]
        self.gaps = [
            (joint, body_joint) for hand in self.hands for joint in hand for body_joint in body if joint != body_joint
        ]
        chain_tips = [chain[0] for chain in self.chains]
        self.fingers = [[chain_tips.index(joint) for joint in hand[1:] if joint in chain_tips] for hand in hands]
        self.body_gaps = [
            [
                k
                for k, (joint, body_joint) in enumerate(self.gaps)
                if joint in hand and body_joint not in ancestors[hand[0]][:2]
            ]
            for hand in self.hands
        ]
        self.count = len(self.chains) + len(self.gaps) + len(self.hands)
        self.n_fine = 2 * len(WAVES) * len(FINE) * len(self.hands)

    def __call__(self, joints: Tensor) -> tuple[Tensor, Tensor]:
        """Returns the measures (W, T, M), and the fine ones as waves (W, T, N), of joints (W, T, J, 3)."""
        tips, *between, roots = (list(column) for column in zip(*self.chains, strict=True))
        bones = (joints - joints[:, :, self.parents]).norm(dim=-1)
        lengths = torch.stack([bones[:, :, column] for column in (tips, *between)]).sum(0)
        reach = (joints[:, :, tips] - joints[:, :, roots]).norm(dim=-1) / lengths.clamp(min=NEAREST)
        joints_a, joints_b = (list(column) for column in zip(*self.gaps, strict=True))
        gaps = ((joints[:, :, joints_a] - joints[:, :, joints_b]).norm(dim=-1) + NEAREST).log()
        steps = torch.cat([torch.zeros_like(joints[:, :1]), joints[:, 1:] - joints[:, :-1]], dim=1).norm(dim=-1)
        speeds = (torch.stack([steps[:, :, hand].mean(-1) for hand in self.hands], dim=-1) + SLOWEST).log()
        zeros = torch.zeros_like(reach[:, :, 0])
        bent = torch.stack([reach[:, :, chains].mean(-1) if chains else zeros for chains in self.fingers], dim=-1)
        nearest = torch.stack([gaps[:, :, indices].amin(-1) for indices in self.body_gaps], dim=-1)
        values = (bent, joints[:, :, self.wrists, 1], nearest, speeds)
        fine = torch.cat([value / unit for value, unit in zip(values, FINE, strict=True)], dim=-1)
        angles = torch.cat([wave * fine for wave in WAVES], dim=-1)
        return torch.cat([reach, gaps, speeds], dim=-1), torch.cat([angles.sin(), angles.cos()], dim=-1)


class BidirectionalLstm(nn.Module):
    """An LSTM layer over each word forwards, and one backwards from its last frame."""

    def __init__(self, n_inputs: int, width: int) -> None:
        super().__init__()
        self.forwards, self.backwards = Lstm(n_inputs, width), Lstm(n_inputs, width)

    def forward(self, x: Tensor, reversed_frames: Tensor) -> Tensor:
        """Returns the states (W, T, 2 D) of inputs (W, T, I). reversed_frames: the frames (W, T) of each word from the
        last one on.
        """
        backward_states = self.backwards(_gather(x, reversed_frames))[0]
        return torch.cat([self.forwards(x)[0], _gather(backward_states, reversed_frames)], dim=-1)


def _gather(x: Tensor, frames: Tensor) -> Tensor:
    return x.gather(1, frames[..., None].expand(-1, -1, x.shape[-1]))


class WordSpsn(nn.Module):
    """The network: ``read`` depends on one word, ``pair_scores`` on all pairs of a batch's words; ``forward`` is as
    SPSN's.

    mean, deviation: of each measure over the frames that are taught.
    """

    mean: Tensor
    deviation: Tensor

    def __init__(self, config: WordSpsnConfig, normaliser: Normaliser) -> None:
        super().__init__()
        self.config, self.normaliser = config, normaliser
        width, n_numbers = config.width, normaliser.n_numbers
        self.measures = Measures(config.parents, config.hands) if config.parents else None
        n_measures, n_fine = (0, 0) if self.measures is None else (self.measures.count, self.measures.n_fine)
        self.register_buffer("mean", torch.zeros(n_measures))
        self.register_buffer("deviation", torch.ones(n_measures))
        self.embedding = nn.Linear(2 * n_numbers + n_numbers // 3 + n_measures + n_fine, width)
        self.layers = nn.ModuleList([BidirectionalLstm(width, width), BidirectionalLstm(2 * width, width)])
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

    def fit_measures(self, words: Iterable[Tensor]) -> None:
        """Sets mean and deviation so that each measure has mean 0 and deviation 1 over the frames of words (T, K)."""
        if self.measures is not None:
            measured = torch.cat([self.measures(word.reshape(1, len(word), -1, 3))[0][0] for word in words])
            self.mean = measured.mean(0)
            self.deviation = measured.std(0).clamp(min=DEVIATION_FLOOR)

    def features(self, x: Tensor) -> Tensor:
        """Returns the features of words (W, T, K): numbers, steps from the frame before, speeds, and measures of
        joints, some finely.
        """
        joints = x.reshape(*x.shape[:2], -1, 3)
        steps = torch.cat([torch.zeros_like(x[:, :1]), x[:, 1:] - x[:, :-1]], dim=1) / STEP
        speeds = torch.log1p(steps.reshape(joints.shape).norm(dim=-1))
        columns = [self.normaliser(x), torch.asinh(steps), speeds]
        if self.measures is not None:
            measures, fine = self.measures(joints)
            columns += [(measures - self.mean) / self.deviation, fine]
        return torch.cat(columns, dim=-1)

    def read(self, x: Tensor, mask: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Returns the keys (W, T, 2 S) and usual scores (W, T, 2) of frames, and summaries (W, 2 S), of words
        (W, T, K).
        """
        frames = torch.arange(x.shape[1], device=x.device)
        reversed_frames = (mask.sum(1, keepdim=True) - 1 - frames).clamp(min=0)  # (W, T)
        states = self.embedding(self.features(x))
        for layer in self.layers:
            states = self.dropout(layer(states, reversed_frames))  # (W, T, 2 D)
        weights = self.look(states).masked_fill(~mask[..., None], _MASKED).softmax(1)
        summary = self.summary(torch.einsum("wtd,wtl->wld", states, weights).flatten(1))
        return self.keys(states), self.usual(states), summary

    def pair_scores(self, x: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
        """Returns the scores (W, W, T) of the frames of each word (first axis) before each partner, and (W, W, T) of
        the frames of each word (second axis) after each partner. mask (W, T): False at padding, which follows each
        word.
        """
        keys, usual, summary = self.read(x, mask)
        size = self.config.summary
        pre_scores = usual[:, None, :, 0] + torch.einsum("pts,qs->pqt", keys[..., :size], summary[:, :size])
        post_scores = usual[None, :, :, 1] + torch.einsum("qts,ps->pqt", keys[..., size:], summary[:, size:])
        return pre_scores.masked_fill(~mask[:, None], _MASKED), post_scores.masked_fill(~mask[None], _MASKED)

    def forward(self, x: Tensor, n_before: Tensor, mask: Tensor | None = None) -> Tensor:
        """Returns the logits (B, S, 3) of the frames X (B, S, K), as SPSN gives them: the highest score of each word is
        1, "none" is 0, so that both tokens are emitted.

        n_before (B,): N. mask (B, S): False at padding, which follows X.
        """
        frames = torch.arange(x.shape[1], device=x.device)[None]
        real = torch.ones_like(x[..., 0], dtype=torch.bool) if mask is None else mask
        n, n_after = n_before[:, None], real.sum(1, keepdim=True) - n_before[:, None]
        is_before, is_after = frames < n, (frames >= n) & real
        shifted_frames = (frames + n).clamp(max=x.shape[1] - 1)
        before, after = self.read(x, is_before), self.read(_gather(x, shifted_frames), frames < n_after)
        size = self.config.summary
        pre_scores = before[1][..., 0] + (before[0][..., :size] * after[2][:, None, :size]).sum(-1)  # (B, S)
        post_scores = after[1][..., 1] + (after[0][..., size:] * before[2][:, None, size:]).sum(-1)
        post_scores = post_scores.gather(1, (frames - n).clamp(min=0))
        logits = [torch.zeros_like(pre_scores)]
        for scores, is_word in ((pre_scores, is_before), (post_scores, is_after)):
            scores = scores.masked_fill(~is_word, _MASKED)
            logits.append((scores - scores.amax(1, keepdim=True) + 1.0).clamp(min=_MASKED))
        return torch.stack(logits, dim=-1)


def position_loss(scores: tuple[Tensor, Tensor], cuts: Tensor, taught: Tensor) -> Tensor:
    """Returns the cross-entropy () of both positions, a mean over pairs. cuts: (W, W, 2); taught: pairs (W, W) that
    count.
    """
    pair_losses = sum(
        F.cross_entropy(side.flatten(0, 1).float(), cuts[..., k].flatten(), reduction="none")
        for k, side in enumerate(scores)
    )
    return (pair_losses * taught.flatten()).sum() / taught.sum().clamp(min=1)
