"""The loss and the scores of the network that cuts and times."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional as F  # noqa: N812

from signsplice.rig.info import FEATURE_FPS
from signsplice.splicing.networks import features
from signsplice.train.cut_data import CutBatch
from signsplice.train.networks.cutting import Cutting
from signsplice.train.processes import mean_counts
from signsplice.train.task import Task

PHASE_WEIGHT = 0.5
TIME_WEIGHT = 0.5
_IMPOSSIBLE = -1e4
"""Score of a frame of padding."""


@dataclass(frozen=True)
class CutPrediction:
    """The network's answers for a batch.

    - leave_scores, enter_scores: (G, W, W, T), very low at padding
    - seconds: (G, W, W), from ``timed_pre`` to ``timed_post`` of the batch
    - phase_logits: (G, W, T, 5)
    """

    leave_scores: Tensor
    enter_scores: Tensor
    seconds: Tensor
    phase_logits: Tensor


class CuttingTask(Task):
    """The network that cuts and times, with its loss: cross-entropy of both frames of every pair and of the phases,
    plus the mean absolute error of the logarithm of the seconds, so that short and long transitions count alike.
    """

    def __init__(self, network: Cutting) -> None:
        super().__init__()
        self.network: Cutting = network

    def predict(self, batch: CutBatch) -> CutPrediction:
        """The network's answers for all words and pairs of a batch."""
        n_draws, n_words = batch.mask.shape[:2]
        states, leave, enter, phase_logits = (
            part.float().reshape(n_draws, n_words, *part.shape[1:])
            for part in self.network.read(batch.tokens.flatten(0, 1), batch.mask.flatten(0, 1))
        )
        leave = leave[:, :, None].expand(-1, -1, n_words, -1)  # (G, W, W, S)
        enter = enter[:, None].expand(-1, n_words, -1, -1)
        condition = self.network.condition(leave, enter)  # (G, W, W, H)
        leave_scores = self.network.leaving(states[:, :, None], condition)
        enter_scores = self.network.entering(states[:, None], condition)
        numbers = batch.tokens[..., : features.N_FRAME]
        draw = torch.arange(n_draws, device=numbers.device)[:, None, None]
        word = torch.arange(n_words, device=numbers.device)
        left, entered = numbers[draw, word[:, None], batch.timed_pre], numbers[draw, word[None], batch.timed_post]
        return CutPrediction(
            leave_scores.masked_fill(~batch.mask[:, :, None], _IMPOSSIBLE),
            enter_scores.masked_fill(~batch.mask[:, None], _IMPOSSIBLE),
            self.network.seconds(left, entered, leave, enter).float(),
            phase_logits,
        )

    def forward(self, batch: CutBatch) -> Tensor:
        """The loss () of a batch."""
        found, known = self.predict(batch), batch.has_truth
        counts = torch.stack([known.sum(), batch.mask.sum()])
        n_known, n_frames = mean_counts(counts) if self.training else counts.clamp(min=1)
        cut_loss = F.cross_entropy(found.leave_scores[known], batch.pre[known], reduction="sum")
        cut_loss = cut_loss + F.cross_entropy(found.enter_scores[known], batch.post[known], reduction="sum")
        each = F.cross_entropy(found.phase_logits.flatten(0, 2), batch.phases.flatten(), reduction="none")
        phase_loss = (each * batch.mask.flatten()).sum() / n_frames
        time_loss = (found.seconds[known].log() - batch.seconds[known].log()).abs().sum() / n_known
        loss: Tensor = cut_loss / n_known + PHASE_WEIGHT * phase_loss + TIME_WEIGHT * time_loss
        return loss

    def judge(self, batch: CutBatch) -> dict[str, float]:
        """Scores over the pairs with a truth; empty where there is none.

        ``pre``, ``post``, ``both``: fractions of exact frames. ``within_2``: fraction with both frames within two.
        ``error_ms``, ``length``: mean error of the durations, and fraction with the exact number of frames, both
        between the true frames.
        """
        known = batch.has_truth
        if not bool(known.any()):
            return {}
        found = self.predict(batch)
        pre, post = found.leave_scores.argmax(-1), found.enter_scores.argmax(-1)  # (G, W, W)
        off = torch.stack([pre - batch.pre, post - batch.post], dim=-1).abs()[known]  # (pairs, 2)
        exact = off == 0
        seconds, true_seconds = found.seconds[known], batch.seconds[known]
        same_length = (seconds * FEATURE_FPS).round() == (true_seconds * FEATURE_FPS).round()
        return {
            "pre": exact[..., 0].float().mean().item(),
            "post": exact[..., 1].float().mean().item(),
            "both": exact.all(-1).float().mean().item(),
            "within_2": (off <= 2).all(-1).float().mean().item(),
            "error_ms": 1e3 * (seconds - true_seconds).abs().mean().item(),
            "length": same_length.float().mean().item(),
        }
