"""What a network learns from a batch, and how well it does on pairs that it does not learn from.

**Exposure bias.** A decoder that always sees the true frame before learns to copy it, and errs more and more on its own
output. Three measures, all drawn from seed and step: noise on the frames fed to it; single frames hidden from it (a
quarter of them); and, in networks that can put out all frames in one pass, half of the pairs with every frame hidden.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional as F  # noqa: N812

from signsplice.paper.metrics import accuracy
from signsplice.synth.rng import stream
from signsplice.train.paper.losses import frame_loss, last_loss, token_loss
from signsplice.train.paper.networks.filling import Filler
from signsplice.train.paper.networks.generator import FRAME, HIDDEN, START, Encoded, Generator, generate
from signsplice.train.paper.networks.layers import Normaliser
from signsplice.train.paper.networks.spsn import NONE, POST, PRE, Spsn
from signsplice.train.paper.pairs_data import Batch, PairsData
from signsplice.train.task import Task

NOISE = 0.1
"""Spread of the noise on frames fed to a decoder, in deviations of the training pairs."""
HIDDEN_FRAMES = 0.25
HIDDEN_PAIRS = 0.5
MOST_FRAMES = 32
"""Transitions are at most this long; longer ones are cut off."""


def positions(logits: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
    """Of logits (B, S, 3): where pre and post are likeliest (B, 2), and whether each is emitted (B, 2)."""
    odds = (logits[..., [PRE, POST]] - logits[..., NONE : NONE + 1]).masked_fill(~mask[..., None], -1e4)
    wins = logits.argmax(-1)[..., None] == torch.tensor([PRE, POST], device=logits.device)
    return odds.argmax(1), (wins & mask[..., None]).any(1)


EMITTED = 0.999
"""Share of validation pairs for which both tokens are emitted at the least."""


@torch.no_grad()
def token_bias(task: Task, valid: PairsData) -> float:
    """What is added to the logits of both tokens, so that a system speaks on validation pairs as good as always.

    How much a token weighs against "none" in the loss is a choice of ours (``TOKEN_WEIGHT``), and so is then how often
    a network is silent; this takes that choice back, for every system alike. Positions do not change by it.
    """
    if not len(valid):
        return 0.0
    task.eval()
    network: Any = task.network
    short = []
    for first in range(0, len(valid), 64):
        batch = valid.batch(range(first, min(first + 64, len(valid))))
        if isinstance(network, Spsn):
            logits = network(batch.x, batch.n_before, batch.mask)
        else:
            logits = network.encode(batch.x, batch.mask, batch.n_before).tokens
        lacking = (logits[..., [NONE]] - logits[..., [PRE, POST]]).masked_fill(~batch.mask[..., None], torch.inf)
        short.append(lacking.amin(1).amax(1))
    return max(0.0, float(np.quantile(torch.cat(short).double().numpy(), EMITTED, method="higher")) + 1e-3)


def _judge_positions(logits: Tensor, batch: Batch) -> dict[str, float]:
    at, emitted = positions(logits, batch.mask)
    right = at == torch.stack([batch.pre, batch.post], dim=1)
    return {
        "pre": right[:, 0].float().mean().item(),
        "post": right[:, 1].float().mean().item(),
        "paa": (right & emitted).all(1).float().mean().item(),
        "pta": emitted.all(1).float().mean().item(),
    }


def _judge_frames(made: list[Tensor], batch: Batch, mark: str = "") -> dict[str, float]:
    counts = batch.real.sum(1).tolist()
    pairs = [
        (frames.double().cpu().numpy(), true[:count].double().cpu().numpy())
        for frames, true, count in zip(made, batch.new, counts, strict=True)
    ]
    right = [len(frames) == len(true) for frames, true in pairs]
    errors = [float(np.mean((a - b) ** 2)) for a, b in pairs if len(a) == len(b)]
    scores = {
        f"accuracy{mark}": float(np.mean([accuracy(frames, true) for frames, true in pairs])),
        f"length{mark}": float(np.mean(right)),
    }
    return scores | ({f"frame_mse{mark}": float(np.mean(errors))} if errors else {})


@dataclass(frozen=True)
class DecoderInput:
    """What a decoder is fed in training: frames (B, T, n_fed) and their kinds (B, T)."""

    frames: Tensor
    kinds: Tensor


def decoder_input(batch: Batch, network: Generator, normaliser: Normaliser, seed: int) -> DecoderInput:
    """The true frames, one step late, with noise and hidden ones; the draws belong to seed, step and pair alone."""
    n_batch, n_frames = batch.real.shape
    rows = []
    kinds = np.full((n_batch, n_frames), FRAME)
    for k, number in enumerate(batch.numbers.tolist()):
        rng = stream("fed", seed, batch.step, number)
        hidden = network.concurrent and rng.random() < HIDDEN_PAIRS
        drawn = rng.random(MOST_FRAMES)
        kinds[k, np.resize(drawn, n_frames) < (1.0 if hidden else HIDDEN_FRAMES)] = HIDDEN
        rows.append(np.resize(rng.standard_normal((MOST_FRAMES, 159), np.float32), (n_frames, 159)))
    kinds[:, 0] = START
    noise = torch.from_numpy(np.stack(rows)).to(batch.new.device) * NOISE * normaliser.deviation
    late = torch.cat([torch.zeros_like(batch.new[:, :1]), batch.new[:, :-1]], dim=1) + noise
    if network.n_fed > late.shape[-1]:
        at = torch.arange(n_frames, device=late.device) / batch.real.sum(1, keepdim=True)
        late = torch.cat([late, at[..., None]], dim=-1)
    return DecoderInput(late, torch.from_numpy(kinds).to(late.device))


class TokenTask(Task):
    """SPSN: the splice positions."""

    def __init__(self, network: Spsn) -> None:
        super().__init__()
        self.network: Spsn = network

    def forward(self, batch: Batch) -> Tensor:
        """Loss of the tokens."""
        return token_loss(self.network(batch.x, batch.n_before, batch.mask), batch.pre, batch.post, batch.mask)

    def judge(self, batch: Batch) -> dict[str, float]:
        """Shares of right positions."""
        return _judge_positions(self.network(batch.x, batch.n_before, batch.mask), batch)


class FrameTask(Task):
    """A generator: the transition frames, and the positions where it has a head for them."""

    def __init__(self, network: Generator, normaliser: Normaliser, seed: int) -> None:
        super().__init__()
        self.network: Generator = network
        self.normaliser, self.seed = normaliser, seed

    def forward(self, batch: Batch) -> Tensor:
        """Loss of frames, of last frames, and of tokens."""
        inputs = decoder_input(batch, self.network, self.normaliser, self.seed)
        tokens, made, last = self.network(batch.x, batch.mask, batch.n_before, inputs.frames, inputs.kinds)
        loss = frame_loss(made[..., :159], batch.new, batch.real, self.normaliser.deviation)
        if self.network.n_fed > 159:
            counter = torch.arange(1, made.shape[1] + 1, device=made.device) / batch.real.sum(1, keepdim=True)
            each = (made[..., 159].float() - counter).square() * batch.real
            loss = loss + 10.0 * (each.sum(1) / batch.real.sum(1)).mean()
        else:
            loss = loss + last_loss(last, batch.real)
        if tokens is not None:
            loss = loss + token_loss(tokens, batch.pre, batch.post, batch.mask)
        return loss

    def judge(self, batch: Batch) -> dict[str, float]:
        """The paper's accuracy, shares of right lengths and positions; in one pass too, where the network can."""
        encoded: Encoded = self.network.encode(batch.x, batch.mask, batch.n_before)
        made = generate(self.network, encoded, len(batch.x), MOST_FRAMES)
        scores = _judge_frames(made, batch)
        if self.network.concurrent:
            made = generate(self.network, encoded, len(batch.x), MOST_FRAMES, parallel=True)
            scores |= _judge_frames(made, batch, "_parallel")
        return scores if encoded.tokens is None else scores | _judge_positions(encoded.tokens, batch)


class FillTask(Task):
    """A filler: the number of frames, and all of them together."""

    def __init__(self, network: Filler, normaliser: Normaliser) -> None:
        super().__init__()
        self.network: Filler = network
        self.normaliser = normaliser

    def forward(self, batch: Batch) -> Tensor:
        """Loss of frames and of their number."""
        numbers, made = self.network(batch.x, batch.mask, batch.real)
        length = F.cross_entropy(numbers.float(), (batch.real.sum(1) - 1).clamp(max=numbers.shape[1] - 1))
        return length + frame_loss(made, batch.new, batch.real, self.normaliser.deviation)

    def judge(self, batch: Batch) -> dict[str, float]:
        """The paper's accuracy and the share of right lengths."""
        counts = self.network.length(batch.x, batch.mask).argmax(1) + 1
        most = int(counts.max())
        real = torch.arange(most, device=counts.device)[None] < counts[:, None]
        made: Any = self.network.fill(batch.x, batch.mask, real)
        return _judge_frames([row[:count] for row, count in zip(made, counts.tolist(), strict=True)], batch)
