"""The tasks of the paper's networks: their losses, and their scores on validation pairs.

**Exposure bias.** A decoder that always sees the true previous frame learns to copy it, and its errors accumulate on
its own output. Three measures counter this, all drawn from seed and step: noise on the frames fed to the decoder;
hiding a quarter of these frames; and, for half of the pairs, no true frame at all: in networks that can make all frames
in one pass every frame is hidden, and LSTM and ConvS2S are fed their own frames, made one by one without gradients
(scheduled sampling, Bengio et al. 2015, by pair). Without the last measure, LSTM predicted 87 % of the lengths after
true frames, and 23 % after its own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from torch import Tensor

from signsplice.signer.signer import stream
from signsplice_paper import bias
from signsplice_paper.metrics import compute_accuracy
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


def find_positions(logits: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
    """Returns the frames where pre and post are likeliest (B, 2), and whether each is emitted (B, 2), from logits
    (B, S, 3).
    """
    log_odds = (logits[..., [PRE, POST]] - logits[..., NONE : NONE + 1]).masked_fill(~mask[..., None], -1e4)
    is_likeliest = logits.argmax(-1)[..., None] == torch.tensor([PRE, POST], device=logits.device)
    return log_odds.argmax(1), (is_likeliest & mask[..., None]).any(1)


@torch.no_grad()
def fit_token_bias(task: Task, valid: PairsData) -> float:
    """Returns the bias for the logits of both tokens with which a system emits them on nearly all validation pairs
    (``bias``).

    The weight of a token against "none" in the loss is our choice (``TOKEN_WEIGHT``), and it affects how often a
    network emits no token. The bias removes that effect for every system but those as printed. It changes no position.
    """
    if not len(valid):
        return 0.0
    task.eval()
    network: Any = task.network
    device = next(network.parameters()).device
    shortfalls = []
    for first in range(0, len(valid), 64):
        batch = valid.batch(range(first, min(first + 64, len(valid)))).to(device)
        if isinstance(network, Spsn):
            logits = network(batch.x, batch.n_before, batch.mask)
        else:
            logits = network.encode(batch.x, batch.mask, batch.n_before).tokens
        margins = (logits[..., [NONE]] - logits[..., [PRE, POST]]).masked_fill(~batch.mask[..., None], torch.inf)
        shortfalls.append(margins.amin(1).amax(1).cpu())  # (B,)
    return bias.choose_bias(torch.cat(shortfalls).double().numpy())


def _judge_positions(logits: Tensor, batch: Batch) -> dict[str, float]:
    frames, emitted = find_positions(logits, batch.mask)
    is_right = frames == torch.stack([batch.pre, batch.post], dim=1)
    return {
        "pre": is_right[:, 0].float().mean().item(),
        "post": is_right[:, 1].float().mean().item(),
        "paa": (is_right & emitted).all(1).float().mean().item(),
        "pta": emitted.all(1).float().mean().item(),
    }


def _judge_frames(generated: list[Tensor], batch: Batch, suffix: str = "") -> dict[str, float]:
    """Returns accuracy, fraction of right lengths and squared error of frames (n, K) by pair; ``suffix`` ends the
    names.
    """
    counts = batch.real.sum(1).tolist()
    pairs = [
        (frames.double().cpu().numpy(), true_frames[:count].double().cpu().numpy())
        for frames, true_frames, count in zip(generated, batch.new, counts, strict=True)
    ]
    is_right_length = [len(frames) == len(true_frames) for frames, true_frames in pairs]
    errors = [float(np.mean((a - b) ** 2)) for a, b in pairs if len(a) == len(b)]
    scores = {
        f"accuracy{suffix}": float(np.mean([compute_accuracy(frames, true_frames) for frames, true_frames in pairs])),
        f"length{suffix}": float(np.mean(is_right_length)),
    }
    return scores | ({f"frame_mse{suffix}": float(np.mean(errors))} if errors else {})


@dataclass(frozen=True)
class DecoderInput:
    """The inputs of a decoder in training.

    - frames: the frames that are fed (B, T, K)
    - kinds: their kinds (B, T)
    - untaught: True at pairs of which no true frame is fed (B,)
    """

    frames: Tensor
    kinds: Tensor
    untaught: Tensor


def make_decoder_input(batch: Batch, network: Generator, normaliser: Normaliser, seed: int) -> DecoderInput:
    """Returns the true frames, delayed by one step, with noise, some of them hidden; they depend only on seed, step and
    pair.
    """
    n_frames, n_numbers = batch.new.shape[1:]
    noise_rows = []
    kinds, is_untaught = np.full(batch.real.shape, FRAME), np.zeros(len(batch.real), bool)
    for k, number in enumerate(batch.numbers.tolist()):
        rng = stream("fed", seed, batch.step, number)
        is_untaught[k] = rng.random() < UNTAUGHT_PAIRS
        p_hidden = 1.0 if network.concurrent and is_untaught[k] else HIDDEN_FRAMES
        kinds[k, np.resize(rng.random(MOST_FRAMES), n_frames) < p_hidden] = HIDDEN
        noise_rows.append(np.resize(rng.standard_normal((MOST_FRAMES, n_numbers), np.float32), (n_frames, n_numbers)))
    kinds[:, 0] = START
    noise = torch.from_numpy(np.stack(noise_rows)).to(batch.new.device) * NOISE * normaliser.deviation
    delayed = torch.cat([torch.zeros_like(batch.new[:, :1]), batch.new[:, :-1]], dim=1) + noise
    return DecoderInput(delayed, *(torch.from_numpy(array).to(delayed.device) for array in (kinds, is_untaught)))


@torch.no_grad()
def feed_own_frames(network: Generator, encoded: Encoded, inputs: DecoderInput) -> DecoderInput:
    """Returns the inputs with the network's own frames, delayed by one step, in pairs of which no true frame is fed."""
    fed, state, frames = inputs.frames[:, :1], encoded.state, [inputs.frames[:, :1]]
    for index in range(inputs.frames.shape[1] - 1):
        start = torch.tensor(index, device=fed.device)
        fed, _, state = network.decode(fed, inputs.kinds[:, index : index + 1], start, encoded.memory, state)
        frames.append(fed.to(inputs.frames.dtype))
    mixed_frames = torch.where(inputs.untaught[:, None, None], torch.cat(frames, dim=1), inputs.frames)
    return replace(inputs, frames=mixed_frames)


class TokenTask(Task):
    """SPSN, which predicts the splice positions; ``plain``: trained with plain cross-entropy, as printed."""

    def __init__(self, network: Spsn, plain: bool = False) -> None:
        super().__init__()
        self.network: Spsn = network
        self.plain = plain

    def forward(self, batch: Batch) -> Tensor:
        """Returns the loss () of the tokens."""
        logits = self.network(batch.x, batch.n_before, batch.mask)
        return token_loss(logits, batch.pre, batch.post, batch.mask, self.plain)

    def judge(self, batch: Batch) -> dict[str, float]:
        """Returns fractions of right positions and of emitted tokens."""
        return _judge_positions(self.network(batch.x, batch.n_before, batch.mask), batch)


class WordTask(Task):
    """SPSN word by word, which predicts the splice positions of all pairs of a batch's words."""

    def __init__(self, network: WordSpsn) -> None:
        super().__init__()
        self.network: WordSpsn = network

    def forward(self, batch: WordBatch) -> Tensor:
        """Returns the loss () of both positions."""
        return position_loss(self.network.pair_scores(batch.x, batch.mask), batch.cuts, batch.taught)

    def judge(self, batch: WordBatch) -> dict[str, float]:
        """Returns fractions of right positions over the pairs that count, or none if no pair counts; both tokens are
        always emitted.
        """
        if not bool(batch.taught.any()):
            return {}
        pre_scores, post_scores = self.network.pair_scores(batch.x, batch.mask)
        predicted = torch.stack([pre_scores.argmax(-1), post_scores.argmax(-1)], dim=-1)
        is_right = (predicted == batch.cuts)[batch.taught].float()  # (pairs, 2)
        pre, post = is_right.mean(0).tolist()
        return {"pre": pre, "post": post, "paa": is_right.amin(1).mean().item(), "pta": 1.0}


class FrameTask(Task):
    """A generator, which predicts the transition frames, and the positions if it has a head for them; ``plain``: the
    head is trained with plain cross-entropy.
    """

    def __init__(self, network: Generator, normaliser: Normaliser, seed: int, plain: bool = False) -> None:
        super().__init__()
        self.network: Generator = network
        self.normaliser, self.seed, self.plain = normaliser, seed, plain

    def forward(self, batch: Batch) -> Tensor:
        """Returns the loss () of frames, of last frames, and of tokens."""
        inputs = make_decoder_input(batch, self.network, self.normaliser, self.seed)
        encoded = self.network.encode(batch.x, batch.mask, batch.n_before, batch.marks)
        if self.network.feeds_own:
            inputs = feed_own_frames(self.network, encoded, inputs)
        frames, last = self.network.decode_whole(encoded, inputs.frames, inputs.kinds)
        loss = frame_loss(frames, batch.new, batch.real, self.normaliser.deviation) + last_loss(last, batch.real)
        if encoded.tokens is not None:
            loss = loss + token_loss(encoded.tokens, batch.pre, batch.post, batch.mask, self.plain)
        return loss

    def judge(self, batch: Batch) -> dict[str, float]:
        """Returns the paper's accuracy, and fractions of right lengths and positions; also for one pass, if the network
        can.
        """
        encoded: Encoded = self.network.encode(batch.x, batch.mask, batch.n_before, batch.marks)
        generated = generate(self.network, encoded, len(batch.x), MOST_FRAMES)
        scores = _judge_frames(generated, batch)
        if self.network.concurrent:
            generated = generate(self.network, encoded, len(batch.x), MOST_FRAMES, parallel=True)
            scores |= _judge_frames(generated, batch, "_parallel")
        return scores if encoded.tokens is None else scores | _judge_positions(encoded.tokens, batch)
