"""Training data of the network that cuts.

A draw is a few words of one signer, and all pairs of them are trained on. Some words are noisy, as captures are, and
some are sampled between the frames at which they were generated. A batch depends on the seed and the step alone.
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
from torch.nn.utils.rnn import pad_sequence

from signsplice.motion import FloatArray, rotation
from signsplice.rig.info import ROLES
from signsplice.signer.signer import stream
from signsplice.splicing import features
from signsplice.splicing.features import PHASES, CanonicalTrajectory
from signsplice_workshop.train.prefetch import draw_from_folders, group_by_folder, open_signer_file

Int = NDArray[np.int64]

WORDS_PER_DRAW = 12
NOISE_PROBABILITY = 0.25
"""Fraction of the words that are noisy."""
NOISE = (0.001, 0.006)
"""Range of the noise's standard deviation: of numbers of the 6D rotations, and of positions in arm lengths."""
OFFSET_PROBABILITY = 0.35
"""Fraction of the draws in which every joint has a constant extra rotation: bodies differ in markers and rigs."""
OFFSET_RAD = 0.2
"""Largest standard deviation of that rotation."""
SUBFRAME_PROBABILITY = 0.25
"""Fraction of the words that are sampled between two frames."""


@dataclass(frozen=True, eq=False)
class SignerWords:
    """A signer's W words with their truth.

    - trajectories: the words on the canonical humanoid
    - phases: (T,) for each word, indices into ``PHASES``
    - true_cuts: (W, W, 3) for word before and word after: last kept frame, first kept frame, number of transition
      frames; -1 if a pair has no truth
    """

    trajectories: tuple[CanonicalTrajectory, ...]
    phases: tuple[Int, ...]
    true_cuts: Int


def read_words(path: Path) -> SignerWords:
    """Returns the words of a signer's file, as ``synth.training_data`` writes it."""
    has_role = np.ones(len(ROLES), bool)
    trajectories, phases = [], []
    with open_signer_file(path) as stored:
        packed_quats, positions, events, true_cuts = (stored[key] for key in ("turns", "places", "events", "pairs"))
        for (first, n_frames), word_events in zip(stored["words"].tolist(), events.tolist(), strict=True):
            frames = slice(first, first + n_frames)
            rotations_6d = rotation.to_6d(rotation.normalize(packed_quats[frames] / 32767.0))
            trajectories.append(CanonicalTrajectory(rotations_6d, positions[frames], has_role))
            phases.append(classify_phases(np.arange(n_frames), word_events))
    return SignerWords(tuple(trajectories), tuple(phases), true_cuts.astype(np.int64))


def classify_phases(frames: Int, events: Sequence[int]) -> Int:
    """Returns indices (T,) into ``PHASES`` of ``frames`` (T,) of a word with events (8,) of ``synth.training_data``."""
    up, start, end, down, begin, _, _, stop = events
    in_stroke = (frames >= begin) & (frames <= stop) & (begin >= 0)
    rest, preparation, hold, stroke, retraction = range(len(PHASES))
    conditions = [frames <= up, frames < start, in_stroke, frames <= end, frames < down]
    return np.select(conditions, [rest, preparation, stroke, hold, retraction], rest)


@dataclass(frozen=True)
class CutBatch:
    """G draws of W words each, padded to T frames; pairs are indexed by word before, word after.

    - tokens: (G, W, T, N_WORD)
    - mask: (G, W, T), False at padding
    - phases: (G, W, T), indices into ``PHASES``
    - pre, post: (G, W, W), last kept frame of the word before, first kept frame of the word after
    - has_truth: (G, W, W), False if the two frames are meaningless
    - step: the training step, for messages
    """

    tokens: Tensor
    mask: Tensor
    phases: Tensor
    pre: Tensor
    post: Tensor
    has_truth: Tensor
    step: int = 0

    def to(self, device: torch.device) -> CutBatch:
        """Returns the batch on a device."""
        tensors = {f.name: getattr(self, f.name).to(device) for f in fields(self) if f.name != "step"}
        return CutBatch(**tensors, step=self.step)


@dataclass(frozen=True, eq=False)
class CutDraw:
    """W words of one signer, with the truth of every pair: the fields of ``CutBatch`` for one draw.

    - words: tokens (T, N_WORD) and phases (T,) of each word
    - pre, post, has_truth: (W, W), as in ``CutBatch``
    """

    words: list[tuple[NDArray[np.float32], Int]]
    pre: Int
    post: Int
    has_truth: NDArray[np.bool_]


class CutDataset:
    """Draws of words from signers' files; every folder has the same probability.

    - signers: words of every signer, by folder
    - seed: all draws depend on it and on their number alone
    - n_fixed: the number of draws, always the same ones, for validation; None: draws without end
    - clean: no augmentation; validation data are always clean
    - n_words: words in a draw
    """

    def __init__(self, paths: Sequence[Path], seed: int = 0, n_fixed: int | None = None, clean: bool = False) -> None:
        self.signers = [[read_words(path) for path in folder] for folder in group_by_folder(paths)]
        self.seed, self.n_fixed, self.clean = seed, n_fixed, clean or n_fixed is not None
        self.n_words = min(WORDS_PER_DRAW, *(len(signer.trajectories) for signer in chain(*self.signers)))

    def __len__(self) -> int:
        if self.n_fixed is not None:
            return self.n_fixed
        return sum(len(signer.trajectories) ** 2 for signer in chain(*self.signers))

    def rows(self, step: int, size: int, seed: int) -> Int:
        """Returns the numbers of the draws of a step."""
        return np.arange(step * size, (step + 1) * size)

    def batch(self, rows: Sequence[int] | Int, step: int = 0) -> CutBatch:
        """Returns the draws with these numbers, padded to one length."""
        draws = [self.draw(int(row)) for row in rows]
        words = [word for draw in draws for word in draw.words]
        shape = len(draws), self.n_words

        def pad_arrays(arrays: Sequence[NDArray[Any]]) -> Tensor:
            padded = pad_sequence([torch.from_numpy(array) for array in arrays], batch_first=True)
            return padded.reshape(*shape, *padded.shape[1:])

        pair_fields = [f.name for f in fields(CutDraw) if f.name != "words"]
        return CutBatch(
            tokens=pad_arrays([tokens for tokens, _ in words]),
            mask=pad_arrays([np.ones(len(tokens), bool) for tokens, _ in words]),
            phases=pad_arrays([phases for _, phases in words]),
            **{name: torch.from_numpy(np.stack([getattr(draw, name) for draw in draws])) for name in pair_fields},
            step=step,
        )

    def draw(self, number: int) -> CutDraw:
        """Returns the draw of a number."""
        rng = stream("cut", self.seed, "fixed" if self.n_fixed is not None else "endless", number)
        signer = draw_from_folders(self.signers, rng)
        chosen_words = rng.choice(len(signer.trajectories), self.n_words, replace=False)
        words, delays = self._augment_words(signer, chosen_words, rng)
        lengths = np.array([min(len(trajectory), features.WORD_FRAMES) for trajectory, _ in words])
        pairs = np.ix_(chosen_words, chosen_words)
        truth = signer.true_cuts[pairs]
        pre, post = _shift_cuts(truth, delays, lengths)
        tokens = [_make_tokens(trajectory, phases) for trajectory, phases in words]
        return CutDraw(tokens, pre, post, truth[..., 2] >= 0)

    def _augment_words(
        self, signer: SignerWords, chosen: Int, rng: np.random.Generator
    ) -> tuple[list[tuple[CanonicalTrajectory, Int]], FloatArray]:
        """Returns the chosen words, augmented, with their phases; and by how many frames (W,) each is sampled later."""
        delays = np.zeros(len(chosen))
        words = []
        offsets = None
        if not self.clean and rng.random() < OFFSET_PROBABILITY:
            rotvecs = rng.normal(0.0, rng.uniform(0.0, OFFSET_RAD), (len(ROLES), 3))
            offsets = rotation.to_matrix(rotation.exp(rotvecs))  # (R, 3, 3)
        for k, word in enumerate(chosen):
            trajectory, phases = signer.trajectories[word], signer.phases[word]
            if offsets is not None:
                matrices = rotation.matrix_from_6d(trajectory.rotations_6d) @ offsets
                trajectory = CanonicalTrajectory(
                    rotation.matrix_to_6d(matrices), trajectory.positions, trajectory.has_role
                )
            if not self.clean:
                if rng.random() < SUBFRAME_PROBABILITY:
                    delays[k] = rng.random()
                    trajectory, phases = _delay_trajectory(trajectory, float(delays[k])), phases[: len(phases) - 1]
                if rng.random() < NOISE_PROBABILITY:
                    trajectory = _with_noise(trajectory, float(rng.uniform(*NOISE)), rng)
            words.append((trajectory, phases[: features.WORD_FRAMES]))
        # One hand is dominant in all words of a signer, so all words together decide whether it is the left one.
        if features.left_hand_busier(*(trajectory for trajectory, _ in words)):
            words = [(features.mirror_trajectory(trajectory), phases) for trajectory, phases in words]
        return words, delays


def _shift_cuts(cuts: Int, delays: FloatArray, lengths: Int) -> tuple[Int, Int]:
    """Returns the frames (W, W) to leave and to enter at, of cuts (W, W, 3), in words that are sampled ``delays`` (W,)
    later.
    """
    pre, post = np.rint(cuts[..., 0] - delays[:, None]), np.rint(cuts[..., 1] - delays)
    clipped = np.clip(pre, 0, lengths[:, None] - 1), np.clip(post, 0, lengths - 1)
    return clipped[0].astype(np.int64), clipped[1].astype(np.int64)


def _make_tokens(trajectory: CanonicalTrajectory, phases: Int) -> tuple[NDArray[np.float32], Int]:
    """Returns the tokens that the network sees of a word, an even number of frames, and their phases."""
    tokens = features.word_tokens(trajectory)[: features.WORD_FRAMES]
    return tokens, np.concatenate([phases, phases[-1:]])[: len(tokens)]


def _delay_trajectory(trajectory: CanonicalTrajectory, delay: float) -> CanonicalTrajectory:
    """Returns the trajectory sampled ``delay`` frames, 0 to 1, after each of its frames but the last."""
    rotations_6d = (1.0 - delay) * trajectory.rotations_6d[:-1] + delay * trajectory.rotations_6d[1:]
    positions = (1.0 - delay) * trajectory.positions[:-1] + delay * trajectory.positions[1:]
    return _orthonormalise(rotations_6d, positions, trajectory)


def _with_noise(trajectory: CanonicalTrajectory, deviation: float, rng: np.random.Generator) -> CanonicalTrajectory:
    rotations_6d = trajectory.rotations_6d + rng.normal(0.0, deviation, trajectory.rotations_6d.shape)
    positions = trajectory.positions + rng.normal(0.0, deviation, trajectory.positions.shape)
    return _orthonormalise(rotations_6d, positions, trajectory)


def _orthonormalise(
    rotations_6d: FloatArray, positions: FloatArray, source: CanonicalTrajectory
) -> CanonicalTrajectory:
    """Returns a trajectory with orthonormalised rotations."""
    return CanonicalTrajectory(rotation.matrix_to_6d(rotation.matrix_from_6d(rotations_6d)), positions, source.has_role)
