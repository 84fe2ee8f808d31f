"""Words to be cut, and what the network that cuts and times them learns.

A draw is a few words of one signer, and every pair of them teaches. Some words are noisy, as captures are, and some are
seen between the frames at which they were made. A batch is a function of seed and step alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional as F  # noqa: N812
from torch.nn.utils.rnn import pad_sequence

from signsplice.motion import rotation
from signsplice.rig.canonical import FEATURE_FPS, ROLES
from signsplice.splicing import features
from signsplice.splicing.features import PHASES, CanonicalTrajectory
from signsplice.synth.rng import stream
from signsplice.train.product.networks.cutting import Cutting
from signsplice.train.product.sampling import by_folder, drawn
from signsplice.train.task import Task

Float = NDArray[np.float64]

PHASE_WEIGHT = 0.5
TIME_WEIGHT = 0.5
N_WORDS = 12
"""Words of a draw."""
NOISY = 0.25
SET = 0.35
"""Share of the draws whose joints are turned by so much throughout: bodies are marked and rigged otherwise."""
SET_RAD = 0.2
"""Most spread of that."""
NOISE = (0.001, 0.006)
"""Least and most spread of a noisy capture: of the turns' columns, and of places in arm lengths."""
BETWEEN = 0.25
"""Share of the words that are seen between two frames."""
ASIDE = 0.5
"""Share of the pairs that teach the time between two other frames than the truth's."""
_IMPOSSIBLE = -1e4
_TRUTH = ("pre", "post", "leaving", "entering", "seconds", "known")


@dataclass(frozen=True, eq=False)
class SignerWords:
    """A signer's words: courses, phases (T,) by number in ``PHASES``, and the truth of every pair (W, W, 3), -1 where
    there is none; ``asides`` (W, W, 3): other frames near it and the time between, the truth itself where none are
    told.
    """

    trajectories: tuple[CanonicalTrajectory, ...]
    phases: tuple[NDArray[np.int64], ...]
    pairs: NDArray[np.int64]
    asides: NDArray[np.int64]


def read_words(path: Path) -> SignerWords:
    """The words of a part of ``synth.endless``."""
    there = np.ones(len(ROLES), bool)
    courses, phases = [], []
    with np.load(path) as stored:
        turns, places, events, pairs = (stored[name] for name in ("turns", "places", "events", "pairs"))
        for (first, n), told in zip(stored["words"].tolist(), events.tolist(), strict=True):
            own = rotation.to_6d(rotation.normalize(turns[first : first + n] / 32767.0))
            courses.append(CanonicalTrajectory(own, places[first : first + n], there))
            phases.append(phases_of(np.arange(n), tuple(told)))
        asides = stored.get("asides", pairs)
    return SignerWords(tuple(courses), tuple(phases), pairs.astype(np.int64), asides.astype(np.int64))


def phases_of(at: NDArray[np.int64], events: Sequence[int]) -> NDArray[np.int64]:
    """Which of ``PHASES`` frames ``at`` (T,) of a word with such events (8,) are; events as ``synth.endless`` tells."""
    up, start, end, down, begin, _, _, stop = events
    stroke = (at >= begin) & (at <= stop) & (begin >= 0)
    rest, preparation, hold, moving, retraction = range(len(PHASES))
    after = [at <= up, at < start, stroke, at <= end, at < down]
    return np.select(after, [rest, preparation, moving, hold, retraction], rest)


@dataclass(frozen=True)
class CutBatch:
    """Draws side by side, W words each: tokens (G, W, T, N_WORD), mask (G, W, T) and phases (G, W, T); for every word
    (row) before every other (column): the last frame kept ``pre`` and the first kept ``post`` (G, W, W); the two frames
    ``leaving`` and ``entering`` (G, W, W), these or others near them, between which a transition takes ``seconds`` (G,
    W, W); ``known`` (G, W, W) which of these pairs have a truth.
    """

    tokens: Tensor
    mask: Tensor
    phases: Tensor
    pre: Tensor
    post: Tensor
    leaving: Tensor
    entering: Tensor
    seconds: Tensor
    known: Tensor
    step: int = 0

    def to(self, device: torch.device) -> CutBatch:
        """The same on a device."""
        moved = {f.name: getattr(self, f.name).to(device) for f in fields(self) if f.name != "step"}
        return CutBatch(**moved, step=self.step)


class CutDataset:
    """Words drawn from some signers, as often from each folder; ``fixed``: so many draws, always the same and clean,
    for judging; ``as_made``: no noise, nothing turned aside or seen between frames.
    """

    def __init__(self, paths: Sequence[Path], seed: int = 0, fixed: int | None = None, as_made: bool = False) -> None:
        self.signers = [[read_words(path) for path in folder] for folder in by_folder(paths)]
        self.seed, self.fixed, self.as_made = seed, fixed, as_made or fixed is not None
        self.n_words = min(N_WORDS, *(len(signer.trajectories) for signer in chain(*self.signers)))

    def __len__(self) -> int:
        return self.fixed if self.fixed is not None else sum(len(s.trajectories) ** 2 for s in chain(*self.signers))

    def rows(self, step: int, size: int, seed: int) -> NDArray[np.int64]:
        """Numbers of the draws of a step."""
        return np.arange(step * size, (step + 1) * size)

    def batch(self, rows: Sequence[int] | NDArray[np.int64], step: int = 0) -> CutBatch:
        """The draws of these numbers side by side."""
        made = [self.draw(int(row)) for row in rows]
        words = [word for one in made for word in one["words"]]
        shape = len(made), self.n_words

        def padded(parts: Sequence[NDArray[Any]]) -> Tensor:
            whole = pad_sequence([torch.from_numpy(part) for part in parts], batch_first=True)
            return whole.reshape(*shape, *whole.shape[1:])

        return CutBatch(
            tokens=padded([tokens for tokens, _ in words]),
            mask=padded([np.ones(len(tokens), bool) for tokens, _ in words]),
            phases=padded([phases for _, phases in words]),
            **{name: torch.from_numpy(np.stack([one[name] for one in made])) for name in _TRUTH},
            step=step,
        )

    def draw(self, number: int) -> dict[str, Any]:
        """One draw: words as (tokens, phases), and the truth of every pair."""
        rng = stream("cut", self.seed, "fixed" if self.fixed is not None else "endless", number)
        signer = drawn(self.signers, rng)
        chosen = rng.choice(len(signer.trajectories), self.n_words, replace=False)
        late = np.zeros(self.n_words)
        words = []
        turned = None
        if not self.as_made and rng.random() < SET:
            turned = rotation.to_matrix(rotation.exp(rng.normal(0.0, rng.uniform(0.0, SET_RAD), (len(ROLES), 3))))
        for k, word in enumerate(chosen):
            course, phases = signer.trajectories[word], signer.phases[word]
            if turned is not None:
                course = CanonicalTrajectory(
                    rotation.matrix_to_6d(rotation.matrix_from_6d(course.turns) @ turned), course.places, course.there
                )
            if not self.as_made:
                if rng.random() < BETWEEN:
                    late[k] = rng.random()
                    course, phases = _between(course, float(late[k])), phases[: len(phases) - 1]
                if rng.random() < NOISY:
                    course = _noisy(course, float(rng.uniform(*NOISE)), rng)
            words.append((course, phases[: features.WORD_FRAMES]))
        # One hand leads in all of a signer's words: whether it is the left is told from all together.
        if features.left_hand_busier(*(course for course, _ in words)):
            words = [(features.mirrored(course), phases) for course, phases in words]
        rows = np.ix_(chosen, chosen)
        truth = signer.pairs[rows]
        # A cut a frame or two aside of the truth has another way to time.
        timed = truth
        if not self.as_made:
            timed = np.where(rng.random(truth.shape[:2])[..., None] < ASIDE, signer.asides[rows], truth)
        known = truth[..., 2] >= 0
        lengths = np.array([min(len(course), features.WORD_FRAMES) for course, _ in words])

        def frames(told: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
            """Frames to leave and to enter at, of words that are seen late."""
            left, entered = np.rint(told[..., 0] - late[:, None]), np.rint(told[..., 1] - late)
            clipped = np.clip(left, 0, lengths[:, None] - 1), np.clip(entered, 0, lengths - 1)
            return clipped[0].astype(np.int64), clipped[1].astype(np.int64)

        (pre, post), (leaving, entering) = frames(truth), frames(timed)
        seen = [_seen(course, phases) for course, phases in words]
        return {
            "words": seen,
            "pre": pre,
            "post": post,
            "leaving": leaving,
            "entering": entering,
            "seconds": (np.where(known, timed[..., 2] + 1, 1) / FEATURE_FPS).astype(np.float32),
            "known": known,
        }


def _seen(course: CanonicalTrajectory, phases: NDArray[np.int64]) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
    tokens = features.word_tokens(course)[: features.WORD_FRAMES]
    return tokens, np.concatenate([phases, phases[-1:]])[: len(tokens)]


def _between(course: CanonicalTrajectory, late: float) -> CanonicalTrajectory:
    """The course as it is ``late`` frames after each of its frames."""
    turns = (1.0 - late) * course.rotations_6d[:-1] + late * course.rotations_6d[1:]
    places = (1.0 - late) * course.positions[:-1] + late * course.positions[1:]
    return CanonicalTrajectory(rotation.matrix_to_6d(rotation.matrix_from_6d(turns)), places, course.has_role)


def _noisy(course: CanonicalTrajectory, spread: float, rng: np.random.Generator) -> CanonicalTrajectory:
    turns = course.rotations_6d + rng.normal(0.0, spread, course.rotations_6d.shape)
    places = course.positions + rng.normal(0.0, spread, course.positions.shape)
    return CanonicalTrajectory(rotation.matrix_to_6d(rotation.matrix_from_6d(turns)), places, course.has_role)


class CuttingTask(Task):
    """The network that cuts and times, with its loss: cross-entropy of both frames of every pair and of the phases, and
    the mean error of the logarithm of seconds, so that short transitions count like long ones.
    """

    def __init__(self, network: Cutting) -> None:
        super().__init__()
        self.network: Cutting = network

    def _said(self, batch: CutBatch) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Scores of leaving and entering (G, W, W, T), seconds (G, W, W), and phases (G, W, T, 5)."""
        groups, words = batch.mask.shape[:2]
        states, leave, enter, phases = (
            part.float().reshape(groups, words, *part.shape[1:])
            for part in self.network.read(batch.tokens.flatten(0, 1), batch.mask.flatten(0, 1))
        )
        leave = leave[:, :, None].expand(-1, -1, words, -1)
        enter = enter[:, None].expand(-1, words, -1, -1)
        condition = self.network.condition(leave, enter)
        left = self.network.leaving(states[:, :, None], condition).masked_fill(~batch.mask[:, :, None], _IMPOSSIBLE)
        entered = self.network.entering(states[:, None], condition).masked_fill(~batch.mask[:, None], _IMPOSSIBLE)
        numbers = batch.tokens[..., : features.N_FRAME]
        group = torch.arange(groups, device=numbers.device)[:, None, None]
        word = torch.arange(words, device=numbers.device)
        seconds = self.network.seconds(
            numbers[group, word[:, None], batch.leaving], numbers[group, word[None], batch.entering], leave, enter
        )
        return left, entered, seconds.float(), phases

    def forward(self, batch: CutBatch) -> Tensor:
        """The loss () of a batch."""
        left, entered, seconds, phases = self._said(batch)
        known = batch.known
        n_known = known.sum().clamp(min=1)
        cut = F.cross_entropy(left[known], batch.pre[known], reduction="sum")
        cut = (cut + F.cross_entropy(entered[known], batch.post[known], reduction="sum")) / n_known
        each = F.cross_entropy(phases.flatten(0, 2), batch.phases.flatten(), reduction="none")
        phase = (each * batch.mask.flatten()).sum() / batch.mask.sum()
        timed = (seconds[known].log() - batch.seconds[known].log()).abs().sum() / n_known
        return cut + PHASE_WEIGHT * phase + TIME_WEIGHT * timed

    def judge(self, batch: CutBatch) -> dict[str, float]:
        """Shares of pairs with exact positions, both, and both within two frames; error (ms) and exact frames of the
        durations, told the true positions; nothing where no pair has a truth.
        """
        if not bool(batch.known.any()):
            return {}
        left, entered, seconds, _ = self._said(batch)
        known, told = batch.known, batch.seconds[batch.known]
        off = torch.stack([left.argmax(-1) - batch.pre, entered.argmax(-1) - batch.post], dim=-1).abs()[known]
        exact = off == 0
        frames = (seconds[known] * FEATURE_FPS).round() == (told * FEATURE_FPS).round()
        return {
            "pre": exact[..., 0].float().mean().item(),
            "post": exact[..., 1].float().mean().item(),
            "both": exact.all(-1).float().mean().item(),
            "within_2": (off <= 2).all(-1).float().mean().item(),
            "error_ms": 1e3 * (seconds[known] - told).abs().mean().item(),
            "length": frames.float().mean().item(),
        }
