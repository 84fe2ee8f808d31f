"""The tasks of the paper's networks: their losses, and their scores on validation pairs.

**Exposure bias.** A decoder that always sees the true frame before learns to copy it, and its errors accumulate on its
own output. Three measures counter this, all drawn from seed and step: noise on the frames fed to the decoder; hiding a
quarter of these frames; and, for half of the pairs, no true frame at all: in networks that can make all frames in one
pass every frame is hidden, and LSTM and ConvS2S are fed their own, made one by one without gradients (scheduled
sampling, Bengio et al. 2015, by pair). Without the last, LSTM found 87 % of the lengths after true frames, and 23 %
after its own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from signsplice.signer.signer import stream
from signsplice_paper import bias
from signsplice_paper.metrics import accuracy
from signsplice_paper.train.losses import frame_loss, last_loss, token_loss
from signsplice_paper.train.networks.generator import FRAME, HIDDEN, START, Encoded, Generator, generate
from signsplice_paper.train.networks.layers import Normaliser
from signsplice_paper.train.networks.spsn import NONE, POST, PRE, Spsn
from signsplice_paper.train.networks.word_spsn import WordSpsn, position_loss
from signsplice_paper.train.pairs_data import Batch, PairsData
from signsplice_paper.train.words_data import WordBatch
from signsplice_workshop.train.tasks import Task

NOISE = 0.1
"""Deviation of the noise on frames fed to a decoder, in deviations of the training pairs."""
HIDDEN_FRAMES = 0.25
"""Probability that a fed frame is hidden."""
UNTAUGHT_PAIRS = 0.5
"""Probability that no true frame of a pair is fed."""
MOST_FRAMES = 32
"""Longest transition that is generated."""


def positions(logits: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
    """The frames where pre and post are likeliest (B, 2), and whether each is emitted (B, 2), from logits (B, S, 3)."""
    odds = (logits[..., [PRE, POST]] - logits[..., NONE : NONE + 1]).masked_fill(~mask[..., None], -1e4)
    wins = logits.argmax(-1)[..., None] == torch.tensor([PRE, POST], device=logits.device)
    return odds.argmax(1), (wins & mask[..., None]).any(1)


@torch.no_grad()
def token_bias(task: Task, valid: PairsData) -> float:
    """The bias for the logits of both tokens with which a system emits them on nearly all validation pairs (``bias``).

    The weight of a token against "none" in the loss is our choice (``TOKEN_WEIGHT``), and it affects how often a
    network emits no token. The bias removes that effect for every system but those as printed. It changes no
    position.
    """
    if not len(valid):
        return 0.0
    task.eval()
    network: Any = task.network
    device = next(network.parameters()).device
    missing = []
    for first in range(0, len(valid), 64):
        batch = valid.batch(range(first, min(first + 64, len(valid)))).to(device)
        if isinstance(network, Spsn):
            logits = network(batch.x, batch.n_before, batch.mask)
        else:
            logits = network.encode(batch.x, batch.mask, batch.n_before).tokens
        margins = (logits[..., [NONE]] - logits[..., [PRE, POST]]).masked_fill(~batch.mask[..., None], torch.inf)
        missing.append(margins.amin(1).amax(1).cpu())  # (B,)
    return bias.of_margins(torch.cat(missing).double().numpy())


def _judge_positions(logits: Tensor, batch: Batch) -> dict[str, float]:
    frames, emitted = positions(logits, batch.mask)
    right = frames == torch.stack([batch.pre, batch.post], dim=1)
    return {
        "pre": right[:, 0].float().mean().item(),
        "post": right[:, 1].float().mean().item(),
        "paa": (right & emitted).all(1).float().mean().item(),
        "pta": emitted.all(1).float().mean().item(),
    }


def _judge_frames(made: list[Tensor], batch: Batch, suffix: str = "") -> dict[str, float]:
    """Accuracy, fraction of right lengths and squared error of frames (n, K) by pair; ``suffix`` ends the names."""
    counts = batch.real.sum(1).tolist()
    pairs = [
        (frames.double().cpu().numpy(), true[:count].double().cpu().numpy())
        for frames, true, count in zip(made, batch.new, counts, strict=True)
    ]
    right = [len(frames) == len(true) for frames, true in pairs]
    errors = [float(np.mean((a - b) ** 2)) for a, b in pairs if len(a) == len(b)]
    scores = {
        f"accuracy{suffix}": float(np.mean([accuracy(frames, true) for frames, true in pairs])),
        f"length{suffix}": float(np.mean(right)),
    }
    return scores | ({f"frame_mse{suffix}": float(np.mean(errors))} if errors else {})


@dataclass(frozen=True)
class DecoderInput:
    """The inputs of a decoder in training.

    - frames: the frames that are fed (B, T, K)
    - kinds: their kinds (B, T)
    - untaught: pairs of which no true frame is fed (B,)
    """

    frames: Tensor
    kinds: Tensor
    untaught: Tensor


def decoder_input(batch: Batch, network: Generator, normaliser: Normaliser, seed: int) -> DecoderInput:
    """The true frames, delayed by one step, with noise, some of them hidden; depends only on seed, step and pair."""
    n_frames, n_numbers = batch.new.shape[1:]
    rows = []
    kinds, untaught = np.full(batch.real.shape, FRAME), np.zeros(len(batch.real), bool)
    for k, number in enumerate(batch.numbers.tolist()):
        rng = stream("fed", seed, batch.step, number)
        untaught[k] = rng.random() < UNTAUGHT_PAIRS
        hidden = 1.0 if network.concurrent and untaught[k] else HIDDEN_FRAMES
        kinds[k, np.resize(rng.random(MOST_FRAMES), n_frames) < hidden] = HIDDEN
        rows.append(np.resize(rng.standard_normal((MOST_FRAMES, n_numbers), np.float32), (n_frames, n_numbers)))
    kinds[:, 0] = START
    noise = torch.from_numpy(np.stack(rows)).to(batch.new.device) * NOISE * normaliser.deviation
    delayed = torch.cat([torch.zeros_like(batch.new[:, :1]), batch.new[:, :-1]], dim=1) + noise
    return DecoderInput(delayed, *(torch.from_numpy(drawn).to(delayed.device) for drawn in (kinds, untaught)))


@torch.no_grad()
def own_frames(network: Generator, encoded: Encoded, inputs: DecoderInput) -> DecoderInput:
    """The inputs with the network's own frames, delayed by one step, in pairs of which no true frame is fed."""
    fed, state, frames = inputs.frames[:, :1], encoded.state, [inputs.frames[:, :1]]
    for index in range(inputs.frames.shape[1] - 1):
        start = torch.tensor(index, device=fed.device)
        fed, _, state = network.decode(fed, inputs.kinds[:, index : index + 1], start, encoded.memory, state)
        frames.append(fed.to(inputs.frames.dtype))
    own = torch.where(inputs.untaught[:, None, None], torch.cat(frames, dim=1), inputs.frames)
    return replace(inputs, frames=own)


class TokenTask(Task):
    """SPSN, which predicts the splice positions; ``plain``: trained with plain cross-entropy, as printed."""

    def __init__(self, network: Spsn, plain: bool = False) -> None:
        super().__init__()
        self.network: Spsn = network
        self.plain = plain

    def forward(self, batch: Batch) -> Tensor:
        """The loss () of the tokens."""
        logits = self.network(batch.x, batch.n_before, batch.mask)
        return token_loss(logits, batch.pre, batch.post, batch.mask, self.plain)

    def judge(self, batch: Batch) -> dict[str, float]:
        """Fractions of right positions and of emitted tokens."""
        return _judge_positions(self.network(batch.x, batch.n_before, batch.mask), batch)


class WordTask(Task):
    """SPSN word by word, which predicts the splice positions of all pairs of some words."""

    def __init__(self, network: WordSpsn) -> None:
        super().__init__()
        self.network: WordSpsn = network

    def forward(self, batch: WordBatch) -> Tensor:
        """The loss () of both positions."""
        return position_loss(self.network.pair_scores(batch.x, batch.mask), batch.cuts, batch.taught)

    def judge(self, batch: WordBatch) -> dict[str, float]:
        """Fractions of right positions over the pairs that count; both are always found. Empty where none counts."""
        if not bool(batch.taught.any()):
            return {}
        leave, enter = self.network.pair_scores(batch.x, batch.mask)
        guesses = torch.stack([leave.argmax(-1), enter.argmax(-1)], dim=-1)
        right = (guesses == batch.cuts)[batch.taught].float()  # (pairs, 2)
        pre, post = right.mean(0).tolist()
        return {"pre": pre, "post": post, "paa": right.amin(1).mean().item(), "pta": 1.0}


class FrameTask(Task):
    """A generator, which predicts the transition frames, and the positions if it has a head for them; ``plain``: these
    learn by plain cross-entropy.
    """

    def __init__(self, network: Generator, normaliser: Normaliser, seed: int, plain: bool = False) -> None:
        super().__init__()
        self.network: Generator = network
        self.normaliser, self.seed, self.plain = normaliser, seed, plain

    def forward(self, batch: Batch) -> Tensor:
        """The loss () of frames, of last frames, and of tokens."""
        inputs = decoder_input(batch, self.network, self.normaliser, self.seed)
        encoded = self.network.encode(batch.x, batch.mask, batch.n_before, batch.marks)
        if self.network.feeds_own:
            inputs = own_frames(self.network, encoded, inputs)
        made, last = self.network.decode_whole(encoded, inputs.frames, inputs.kinds)
        loss = frame_loss(made, batch.new, batch.real, self.normaliser.deviation) + last_loss(last, batch.real)
        if encoded.tokens is not None:
            loss = loss + token_loss(encoded.tokens, batch.pre, batch.post, batch.mask, self.plain)
        return loss

    def judge(self, batch: Batch) -> dict[str, float]:
        """The paper's accuracy, and fractions of right lengths and positions; also for one pass, if the network can."""
        encoded: Encoded = self.network.encode(batch.x, batch.mask, batch.n_before, batch.marks)
        made = generate(self.network, encoded, len(batch.x), MOST_FRAMES)
        scores = _judge_frames(made, batch)
        if self.network.concurrent:
            made = generate(self.network, encoded, len(batch.x), MOST_FRAMES, parallel=True)
            scores |= _judge_frames(made, batch, "_parallel")
        return scores if encoded.tokens is None else scores | _judge_positions(encoded.tokens, batch)
