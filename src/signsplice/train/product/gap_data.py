"""Gaps to be filled, drawn without end from signing on the canonical humanoid (``synth.endless``).

Half of them are true transitions between two words; half hide any stretch of a sentence or of a word alone, strokes
too, since that is what filling a hole in a take asks for, made as various as captures are (``variety``). A batch is a
function of seed and step alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.utils.rnn import pad_sequence

from signsplice.errors import InputError
from signsplice.motion import rotation
from signsplice.motion.clip import Clip, Skeleton, concatenate
from signsplice.rig.canonical import FEATURE_FPS, MIRROR, ROLES, canonical_motion
from signsplice.splicing import features
from signsplice.splicing.transition import find_transition
from signsplice.synth.rng import stream
from signsplice.train.product import augmentation
from signsplice.train.product.sampling import by_folder, drawn

Float = NDArray[np.float64]

SEAMS = 0.5
"""Share of the gaps that are true transitions."""
ALONE = 0.3
"""Share of the hidden stretches that are a word's alone, with its way from rest and back, holds and all."""
SURE = 0.6
"""How much of the way from the classical transition to the truth hidden stretches teach: the procedural signer can be
told from its ends better than people can, and most captures are filled better with half of what was learned in full
(lab/LOG.md, Half of it).
"""
_POOL = 8
"""Steps that share their gaps out by length."""
_BASE = find_transition("hermite")


@dataclass(frozen=True, eq=False)
class SignerData:
    """A signer: the skeleton of the canonical humanoid in this signer's sizes, with the rows of the roles that are its
    joints after the hips, and sentences and words alone as turns (T, 43, 4).
    """

    skeleton: Skeleton
    roles: NDArray[np.intp]
    above: NDArray[np.intp]
    bones: NDArray[np.float32]
    sentences: tuple[Float, ...]
    seams: tuple[tuple[int, int, int], ...]
    words: tuple[Float, ...]

    def take(self, rng: np.random.Generator) -> Float:
        """A sentence or a word."""
        among = self.words if self.words and (not self.sentences or rng.random() < ALONE) else self.sentences
        return among[int(rng.integers(len(among)))]


def read_signer(path: Path) -> SignerData:
    """A part of ``synth.endless``."""
    with np.load(path) as stored:
        turns = rotation.normalize(stored["turns"].astype(np.float32) / 32767.0)
        sentences, words = (
            tuple(turns[first : first + n] for first, n in stored[kind].tolist()) for kind in ("sentences", "words")
        )
        bones, seams = stored["bones"].astype(np.float32), stored["seams"].tolist()
    return signer_data(
        bones, np.ones(len(ROLES), bool), sentences, tuple((s, start, n) for s, start, n in seams), words
    )


def signer_data(
    bones: NDArray[np.float32],
    there: NDArray[np.bool_],
    sentences: tuple[Float, ...],
    seams: tuple[tuple[int, int, int], ...] = (),
    words: tuple[Float, ...] = (),
) -> SignerData:
    """A part on a skeleton that has the roles that are there, and no others."""
    above = _above()
    rows = np.flatnonzero(there)
    joint = {-1: 0} | {int(row): k + 1 for k, row in enumerate(rows)}
    parents = []
    for row in rows.tolist():
        over = int(above[row])
        while over >= 0 and not there[over]:
            over = int(above[over])
        parents.append(joint[over])
    names = ("hips", *(ROLES[row] for row in rows))
    skeleton = Skeleton(names, np.array([-1, *parents]), np.concatenate([np.zeros((1, 3)), bones[rows]]))
    return SignerData(skeleton, rows, above, bones, sentences, seams, words)


def _above() -> NDArray[np.intp]:
    """The row above each role of a whole canonical humanoid (-1: the hips)."""
    lines = {"spine": "", "chest": "spine", "upperChest": "chest", "neck": "upperChest", "head": "neck"}
    for side in ("left", "right"):
        arm = [f"{side}{part}" for part in ("Shoulder", "UpperArm", "LowerArm", "Hand")]
        lines |= dict(zip(arm, ["upperChest", *arm[:-1]], strict=True))
        fingers = [role for role in ROLES if role.startswith(side) and role not in arm]
        for k, role in enumerate(fingers):
            lines[role] = arm[-1] if k % 3 == 0 else fingers[k - 1]
    return np.array([ROLES.index(lines[role]) if lines[role] else -1 for role in ROLES])


@dataclass(frozen=True)
class GapBatch:
    """Gaps side by side: tokens (B, S, N_TOKEN) and mask (B, S); base and true turns (B, T, R, 4) with real (B, T);
    weights (B, T, R) of the answer (``features.answer_weights``); bones (B, R, 3); seam (B,): whether it is a true transition.
    """

    tokens: Tensor
    mask: Tensor
    base: Tensor
    true: Tensor
    real: Tensor
    weights: Tensor
    bones: Tensor
    seam: Tensor
    step: int = 0

    def to(self, device: torch.device) -> GapBatch:
        """The same on a device."""
        return GapBatch(
            **{f.name: getattr(self, f.name).to(device) for f in fields(self) if f.name != "step"}, step=self.step
        )


@dataclass(frozen=True, eq=False)
class _GapPlan:
    """A gap's signer, its seam's number (None: any stretch), the frames to hide, and what else will be drawn from."""

    rng: np.random.Generator
    part: SignerData
    seam: int | None
    n_gap: int


class GapDataset:
    """Gaps drawn from some parts, as often from each folder; ``fixed``: so many, always the same, for judging;
    ``as_made``: true transitions alone, without noise, sway or joints turned aside.
    """

    sure, idle = SURE, True

    def __init__(self, paths: Sequence[Path], seed: int = 0, fixed: int | None = None, as_made: bool = False) -> None:
        self.parts = [[read_signer(path) for path in folder] for folder in by_folder(paths)]
        self.seed, self.fixed, self.as_made = seed, fixed, as_made
        if as_made and not all(part.seams for part in chain(*self.parts)):
            raise InputError("signing that is seen as it was made holds no transition; name folders with seams")
        self._shared: dict[tuple[int, int, int], NDArray[np.int64]] = {}

    def __len__(self) -> int:
        return self.fixed if self.fixed is not None else sum(len(part.seams) for part in chain(*self.parts))

    @cached_property
    def above(self) -> NDArray[np.intp]:
        """The row above each role."""
        return self.parts[0][0].above

    def rows(self, step: int, size: int, seed: int) -> NDArray[np.int64]:
        """Numbers of the gaps of a step: no gap is drawn twice. Some steps share their gaps out by length, and go
        through them in any order, so that a batch is hardly padded.
        """
        pool, turn = divmod(step, _POOL)
        key = (pool, size, seed)
        if key not in self._shared:
            numbers = np.arange(pool * _POOL * size, (pool + 1) * _POOL * size)
            by_length = numbers[np.argsort([self._plan(int(n)).n_gap for n in numbers], kind="stable")]
            order = stream("pool", seed, pool).permutation(_POOL)
            self._shared = {k: v for k, v in self._shared.items() if k[0] == pool - 1}
            self._shared[key] = by_length.reshape(_POOL, size)[order]
        rows: NDArray[np.int64] = self._shared[key][turn]
        return rows

    def batch(self, rows: Sequence[int] | NDArray[np.int64], step: int = 0) -> GapBatch:
        """The gaps of these numbers side by side."""
        made = [self.gap(int(row)) for row in rows]
        tensors = {
            name: pad_sequence([torch.from_numpy(np.asarray(one[name])) for one in made], batch_first=True)
            for name in ("tokens", "base", "true", "weights")
        }
        return GapBatch(
            **tensors,
            mask=pad_sequence([torch.ones(len(one["tokens"]), dtype=torch.bool) for one in made], batch_first=True),
            real=pad_sequence([torch.ones(len(one["weights"]), dtype=torch.bool) for one in made], batch_first=True),
            bones=torch.from_numpy(np.stack([one["bones"] for one in made])),
            seam=torch.tensor([one["seam"] for one in made]),
            step=step,
        )

    def gap(self, number: int) -> dict[str, Any]:
        """One gap as arrays."""
        plan = self._plan(number)
        rng, part, n_gap = plan.rng, plan.part, plan.n_gap
        if plan.seam is not None:
            sentence, start, n_gap = part.seams[plan.seam]
            turns = part.sentences[sentence]
        else:
            turns = augmentation.stretch(lambda: part.take(rng), rng, self.idle)
            n_gap = min(n_gap, len(turns) - 4)
            start = int(rng.integers(2, len(turns) - n_gap - 1))
        low, high = max(0, start - features.CONTEXT), min(len(turns), start + n_gap + features.CONTEXT)
        turns, start = turns[low:high], start - low
        if self.fixed is None and not self.as_made:
            turns = augmentation.elsewhere(turns, rng)
        if not self.as_made and rng.random() < augmentation.NOISY:
            turns = augmentation.noisy(turns, float(rng.uniform(*augmentation.NOISE_RAD)), rng)
        seen = self._seen(part, turns, start, n_gap)
        if plan.seam is None and self.fixed is None:
            seen["true"] = rotation.slerp(seen["base"], seen["true"], self.sure).astype(np.float32)
        return seen | {"seam": plan.seam is not None}

    def _plan(self, number: int) -> _GapPlan:
        """What a gap is, before any of it is made."""
        rng = stream("window", self.seed, "fixed" if self.fixed is not None else "endless", number)
        part = drawn(self.parts, rng)
        if (self.as_made or rng.random() < SEAMS) and part.seams:
            seam = int(rng.integers(len(part.seams)))
            return _GapPlan(rng, part, seam, part.seams[seam][2])
        return _GapPlan(
            rng,
            part,
            None,
            round(float(np.exp(rng.uniform(np.log(features.MIN_GAP_FRAMES), np.log(features.MAX_GAP_FRAMES))))),
        )

    def _seen(self, part: SignerData, turns: Float, start: int, n_gap: int) -> dict[str, Any]:
        local = np.concatenate([np.broadcast_to(rotation.IDENTITY, (len(turns), 1, 4)), turns[:, part.roles]], axis=1)
        clip = Clip(part.skeleton, local, np.zeros((len(turns), 3)), FEATURE_FPS)
        before, after = clip[:start], clip[start + n_gap :]
        base = _BASE.between(before, after, n_gap)
        seen = features.gap_features(canonical_motion(concatenate([before, base, after])), start, n_gap)
        whole = np.tile(rotation.IDENTITY, (n_gap, len(ROLES), 1))
        whole[:, part.roles] = base.local_rotations[:, 1:]
        pair = [whole, turns[start : start + n_gap]]
        bones = part.bones
        if seen.mirrored:
            pair = [q[:, MIRROR] * [1.0, -1.0, -1.0, 1.0] for q in pair]
            bones = bones[MIRROR] * np.array([-1.0, 1.0, 1.0], np.float32)
        share = np.arange(1, n_gap + 1) / (n_gap + 1)
        return {
            "tokens": seen.tokens,
            "base": pair[0].astype(np.float32),
            "true": pair[1].astype(np.float32),
            "weights": features.answer_weights(share, seen).astype(np.float32),
            "bones": bones,
        }
