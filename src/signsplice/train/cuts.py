"""Pairs of words to be cut, and what the networks that cut and time them learn.

Every pair of two words of one signer is drawn, in any order, without end; words are seen at a random moment between two
frames of the rate, and some are noisy, as captures are. A batch is a function of seed and step alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional as F  # noqa: N812
from torch.nn.utils.rnn import pad_sequence

from signsplice.motion import features, rotation
from signsplice.motion.canonical import ROLES
from signsplice.motion.features import Course
from signsplice.synth.rng import stream
from signsplice.train.networks.cutting import Cutting, Duration
from signsplice.train.tasks import Accuracy, Task

Float = NDArray[np.float64]

PHASE_WEIGHT = 0.2
_IMPOSSIBLE = -1e4


@dataclass(frozen=True, eq=False)
class Words:
    """A signer's words: courses, phases (T,) by number in ``PHASES``, and the truth of every pair (W, W, 3)."""

    courses: tuple[Course, ...]
    phases: tuple[NDArray[np.int64], ...]
    pairs: NDArray[np.int64]


def read_words(path: Path) -> Words:
    """The words of a part of ``synth.endless``."""
    there = np.ones(len(ROLES), bool)
    courses, phases = [], []
    with np.load(path) as stored:
        turns, places, events, pairs = (stored[name] for name in ("turns", "places", "events", "pairs"))
        for (first, n), (up, start, end, down, *_) in zip(stored["words"].tolist(), events.tolist(), strict=True):
            own = rotation.to_6d(rotation.normalize(turns[first : first + n] / 32767.0))
            courses.append(Course(own, places[first : first + n], there))
            at = np.arange(n)
            phases.append(np.select([at <= up, at < start, at <= end, at < down], [0, 1, 2, 3], 0))
    return Words(tuple(courses), tuple(phases), pairs.astype(np.int64))


@dataclass(frozen=True)
class Cuts:
    """Pairs side by side: tokens (B, S, N_CUT), mask (B, S), which frames are of the word before and after (B, S),
    positions ``pre`` and ``post`` (B,) among the tokens, phases (B, S), seconds (B,) of the transition, and the
    numbers of the two frames it joins (B, N_FRAME).
    """

    tokens: Tensor
    mask: Tensor
    before: Tensor
    after: Tensor
    pre: Tensor
    post: Tensor
    phases: Tensor
    seconds: Tensor
    leaving: Tensor
    entering: Tensor
    step: int = 0

    def to(self, device: torch.device) -> Cuts:
        """The same on a device."""
        moved = {f.name: getattr(self, f.name).to(device) for f in fields(self) if f.name != "step"}
        return Cuts(**moved, step=self.step)


class CutPairs:
    """Pairs drawn from some signers; ``fixed``: so many, always the same, for judging."""

    def __init__(self, paths: Sequence[Path], seed: int = 0, fixed: int | None = None) -> None:
        self.signers = [read_words(path) for path in paths]
        self.seed, self.fixed = seed, fixed

    def __len__(self) -> int:
        return self.fixed if self.fixed is not None else sum(len(s.courses) ** 2 for s in self.signers)

    def rows(self, step: int, size: int, seed: int) -> NDArray[np.int64]:
        """Numbers of the pairs of a step."""
        return np.arange(step * size, (step + 1) * size)

    def batch(self, rows: Sequence[int] | NDArray[np.int64], step: int = 0) -> Cuts:
        """The pairs of these numbers side by side."""
        made = [self.pair(int(row)) for row in rows]

        def padded(name: str) -> Tensor:
            return pad_sequence([torch.from_numpy(one[name]) for one in made], batch_first=True)

        mask = pad_sequence([torch.ones(len(one["tokens"]), dtype=torch.bool) for one in made], batch_first=True)
        n_before = torch.tensor([one["n_before"] for one in made])
        before = torch.arange(mask.shape[1])[None] < n_before[:, None]
        told = {name: torch.tensor([one[name] for one in made]) for name in ("pre", "post")}
        ends = {name: torch.from_numpy(np.stack([one[name] for one in made])) for name in ("leaving", "entering")}
        seconds = torch.tensor([one["seconds"] for one in made], dtype=torch.float32)
        return Cuts(
            padded("tokens"), mask, before, mask & ~before, **told, phases=padded("phases"), seconds=seconds, **ends,
            step=step,
        )  # fmt: skip

    def pair(self, number: int) -> dict[str, Any]:
        """One pair as arrays."""
        rng = stream("cut", self.seed, "fixed" if self.fixed is not None else "endless", number)
        signer = self.signers[int(rng.integers(len(self.signers)))]
        p, q = (int(k) for k in rng.integers(len(signer.courses), size=2))
        pre, post, n_new = signer.pairs[p, q].tolist()
        seen = features.cut_window(signer.courses[p], signer.courses[q])
        phases = np.concatenate([signer.phases[p][seen.first :], signer.phases[q][: features.CUT_FRAMES]])
        pre = min(max(pre - seen.first, 0), seen.n_before - 1)
        post = min(post, len(seen.tokens) - seen.n_before - 1) + seen.n_before
        n = features.N_FRAME
        return {
            "tokens": seen.tokens,
            "n_before": seen.n_before,
            "pre": pre,
            "post": post,
            "phases": phases,
            "seconds": (n_new + 1) / features.RATE,
            "leaving": seen.tokens[pre, :n],
            "entering": seen.tokens[post, :n],
        }


class CuttingTask(Task):
    """The network that cuts, with its loss: cross-entropy over all choices of two frames, and over phases."""

    def __init__(self, network: Cutting) -> None:
        super().__init__()
        self.network: Cutting = network

    def _scores(self, batch: Cuts) -> tuple[Tensor, Tensor]:
        """Scores (B, S * S) of all choices, and phases."""
        scores, phases = self.network(batch.tokens, batch.mask)
        possible = batch.before[:, :, None] & batch.after[:, None]
        return scores.float().masked_fill(~possible, _IMPOSSIBLE).flatten(1), phases.float()

    def forward(self, batch: Cuts) -> Tensor:
        """The loss () of a batch."""
        scores, phases = self._scores(batch)
        target = batch.pre * batch.mask.shape[1] + batch.post
        each = F.cross_entropy(phases.transpose(1, 2), batch.phases, reduction="none") * batch.mask
        phase = (each.sum(1) / batch.mask.sum(1)).mean()
        return F.cross_entropy(scores, target) + PHASE_WEIGHT * phase

    def judge(self, batch: Cuts, accuracy: Accuracy | None) -> dict[str, float]:
        """Shares of exact positions, of both, and of both within two frames."""
        best = self._scores(batch)[0].argmax(1)
        size = batch.mask.shape[1]
        off = torch.stack([best // size - batch.pre, best % size - batch.post], dim=1).abs()
        exact = off == 0
        return {
            "pre": exact[:, 0].float().mean().item(),
            "post": exact[:, 1].float().mean().item(),
            "both": exact.all(1).float().mean().item(),
            "within_2": (off <= 2).all(1).float().mean().item(),
        }


class DurationTask(Task):
    """The network that times, with its loss: the logarithm's mean error, so that short ones count like long ones."""

    def __init__(self, network: Duration) -> None:
        super().__init__()
        self.network: Duration = network

    def forward(self, batch: Cuts) -> Tensor:
        """The loss () of a batch."""
        seconds: Tensor = self.network(batch.leaving, batch.entering).float()
        return (seconds.log() - batch.seconds.log()).abs().mean()

    def judge(self, batch: Cuts, accuracy: Accuracy | None) -> dict[str, float]:
        """Mean error, ms, and the share of exact numbers of frames."""
        seconds = self.network(batch.leaving, batch.entering).float()
        frames = (seconds * features.RATE).round() == (batch.seconds * features.RATE).round()
        return {
            "error_ms": 1e3 * (seconds - batch.seconds).abs().mean().item(),
            "exact": frames.float().mean().item(),
        }
