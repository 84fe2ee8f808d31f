"""Training data of the network that makes transitions: gaps hidden in signing on the canonical humanoid.

Half of the gaps are true transitions between two words. The other half hide any stretch of a sentence or of an isolated
word, strokes too, because that is what filling a hole in a take asks for. These are augmented, because the synthetic
signer is too regular: a network could predict a hidden stretch from its two ends alone, and would then be overconfident
on captures. Some stretches get a varying tempo, joints that lag, or the left arm of another take; in others nothing is
signed while the body stands still and the arms wander. Captures also differ in how bodies stand, are marked and are
rigged, they sway, and they are noisy. A batch depends on the seed and the step alone.

Augmentations take canonical rotations, quaternions (T, R, 4) with one for each role of ``rig.canonical.ROLES``, and
return an array of the same form, with the number of frames that they state.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
from signsplice.motion import Clip, FloatArray, Skeleton, concatenate, rotation
from signsplice.rig.info import FEATURE_FPS, LEFT, MIRROR, RIGHT, ROLES, canonical_motion
from signsplice.rig.roles import ARM, SIDES
from signsplice.signer.signer import stream
from signsplice.splicing import features as gap_features
from signsplice.splicing.contracts import Gap
from signsplice.splicing.curves import find_transition
from signsplice_workshop.corpora.rekeying import with_keys
from signsplice_workshop.train.prefetch import draw_from_folders, group_by_folder, open_signer_file

STILL, WANDERING = 0.12, 0.18
"""Fractions of the hidden stretches in which the body stands still, and in which the arms wander."""
WANDER_RAD, WANDER_HZ = 0.4, (0.15, 1.5)
"""Largest standard deviation of the wandering rotations, and the range of their frequencies."""
TEMPO_RANGE = (0.6, 1.7)
TEMPO_PROBABILITY = 0.7
TEMPO_WAVES_PROBABILITY = 0.7
TEMPO_WAVES = 0.5
"""Largest standard deviation of the logarithm of a tempo that varies within a stretch."""
TEMPO_WAVES_HZ = (0.5, 3.0)
LAG_PROBABILITY = 0.6
LAG_FRAMES = 2.5
"""Largest standard deviation of the lags of single joints."""
OFFSET_PROBABILITY = 0.6
OFFSET_RAD = 0.25
"""Largest standard deviation of constant rotations added to all joints."""
SWAY_PROBABILITY = 0.4
SWAY_RAD, SWAY_HZ = 0.1, (0.2, 2.0)
"""Largest standard deviation of slow rotations added to all joints, and the range of their frequencies."""
NOISE_PROBABILITY = 0.3
NOISE_RAD = (0.001, 0.008)
"""Range of the standard deviation of noise."""
KEYED_PROBABILITY = 0.25
"""Fraction of the hidden stretches that a program drew between keys: there the curve is hard to improve, and a clip
that is not recognised as keyed must not be made worse.
"""
OTHER_ARM_PROBABILITY = 0.3
_MIN_FRAMES = gap_features.MIN_GAP_FRAMES + 2 * gap_features.N_CONTEXT
"""The shortest gap with all the frames that the network sees on either side."""


def draw_augmented_take(draw_take: Callable[[], FloatArray], rng: np.random.Generator, idle: bool = True) -> FloatArray:
    """Returns a take of ``draw_take`` with a random tempo, lags, another take's left arm; at least ``_MIN_FRAMES``
    long.

    ``idle``: a fraction of the results shows no signing, but a body that stands still or arms that wander.
    """
    quats = with_random_tempo(draw_take(), rng)
    kind = rng.random() if idle else 1.0
    if kind < STILL or rng.random() < 0.5 * (kind < STILL + WANDERING):
        quats = np.repeat(quats[int(rng.integers(len(quats)))][None], len(quats), axis=0)
    if STILL <= kind < STILL + WANDERING:
        quats = with_wandering_arms(quats, rng)
    if rng.random() < OTHER_ARM_PROBABILITY:
        quats = with_left_arm_of(quats, draw_take())
    if rng.random() < LAG_PROBABILITY:
        quats = with_joint_lags(quats, rng)
    return quats


def with_random_tempo(quats: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Returns the motion at a random tempo; unchanged if it would become shorter than ``_MIN_FRAMES``."""
    tempo = float(rng.uniform(*TEMPO_RANGE)) if rng.random() < TEMPO_PROBABILITY else 1.0
    varies = rng.random() < TEMPO_WAVES_PROBABILITY
    retimed = with_tempo(quats, _draw_varying_tempo(tempo, len(quats), rng) if varies else tempo)
    return retimed if len(retimed) >= _MIN_FRAMES else quats


def with_tempo(quats: FloatArray, tempo: float | FloatArray) -> FloatArray:
    """Returns the same motion ``tempo`` times as fast; ``tempo`` is one number, or one for each frame of the result."""
    if isinstance(tempo, float):
        times = np.arange(0.0, len(quats) - 1.0, tempo)
    else:
        times = np.cumsum(tempo) - tempo[0]
        times = times[times < len(quats) - 1.0]
    lower = times.astype(int)
    return rotation.nlerp(quats[lower], quats[lower + 1], (times - lower)[:, None])


def _draw_varying_tempo(tempo: float, n_frames: int, rng: np.random.Generator) -> FloatArray:
    """Returns tempos that vary around one value, enough of them to reach the end of ``n_frames``."""
    times = np.arange(int(2.0 * n_frames / tempo) + 1) / FEATURE_FPS
    rates, phases = rng.uniform(*TEMPO_WAVES_HZ, 3), rng.uniform(0.0, 2.0 * np.pi, 3)
    waves = np.sin(2.0 * np.pi * rates * times[:, None] + phases).sum(axis=1) * np.sqrt(2.0 / 3.0)
    return np.asarray(tempo * np.exp(rng.uniform(0.0, TEMPO_WAVES) * waves))


def with_wandering_arms(quats: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Returns the motion with slow random rotations added: large ones to arms and hands, small ones to all other
    joints.
    """
    scale = np.full(quats.shape[1], 0.15)  # (R,)
    for side in (LEFT, RIGHT):
        scale[side.start + 1 : side.start + len(ARM)] = 1.0
    rotvecs = rng.normal(0.0, rng.uniform(0.05, WANDER_RAD), (quats.shape[1], 3)) * scale[:, None]
    return _with_waves(quats, rotvecs, WANDER_HZ, 3, rng)


def _with_waves(
    quats: FloatArray, rotvecs: FloatArray, hz: tuple[float, float], n_waves: int, rng: np.random.Generator
) -> FloatArray:
    """Returns the motion with every joint rotated by ``n_waves`` sine waves of amplitude ``rotvecs`` (R, 3)."""
    times = np.arange(len(quats))[:, None, None, None] / FEATURE_FPS  # (T, 1, 1, 1)
    shape = (*rotvecs.shape, n_waves)
    rates, phases = rng.uniform(*hz, shape), rng.uniform(0.0, 2.0 * np.pi, shape)
    waves = np.sin(2.0 * np.pi * rates * times + phases).sum(axis=-1) / np.sqrt(n_waves)  # (T, R, 3)
    return rotation.multiply(quats, rotation.exp(rotvecs * waves))


def with_joint_lags(quats: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Returns the motion with every joint delayed or advanced by a constant time of its own."""
    lags = rng.normal(0.0, rng.uniform(0.0, LAG_FRAMES), quats.shape[1])
    times = np.clip(np.arange(len(quats))[:, None] + lags, 0.0, len(quats) - 1.001)  # (T, R)
    lower, roles = times.astype(int), np.arange(quats.shape[1])
    return rotation.nlerp(quats[lower, roles], quats[lower + 1, roles], times - lower)


def with_left_arm_of(quats: FloatArray, other_quats: FloatArray) -> FloatArray:
    """Returns the motion with the left arm of another take; as many frames as the shorter of the two."""
    n_frames = min(len(quats), len(other_quats))
    mixed_quats = quats[:n_frames].copy()
    mixed_quats[:, LEFT] = other_quats[:n_frames, LEFT]
    return mixed_quats


def with_offsets_and_sway(quats: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Returns the motion of a body that stands or is rigged a little differently, or that sways; each with a
    probability.
    """
    n_roles = quats.shape[1]
    if rng.random() < OFFSET_PROBABILITY:
        rotvecs = rng.normal(0.0, rng.uniform(0.0, OFFSET_RAD), (n_roles, 3))
        quats = rotation.multiply(quats, rotation.exp(rotvecs))
    if rng.random() < SWAY_PROBABILITY:
        quats = _with_waves(quats, rng.normal(0.0, rng.uniform(0.0, SWAY_RAD), (n_roles, 3)), SWAY_HZ, 1, rng)
    return quats


def with_noise(quats: FloatArray, deviation: float, rng: np.random.Generator) -> FloatArray:
    """Returns the motion with noise of standard ``deviation``, rad; noise of neighbouring frames is correlated."""
    noise = rng.normal(0.0, deviation, (len(quats), quats.shape[1], 3))
    noise[1:] = 0.5 * noise[:-1] + np.sqrt(0.75) * noise[1:]
    return rotation.multiply(quats, rotation.exp(noise))


SEAM_FRACTION = 0.5
"""Fraction of the gaps that are true transitions."""
WORD_FRACTION = 0.3
"""Fraction of the other gaps that are hidden in an isolated word, with its preparation from rest and its retraction."""
STRETCH_TARGET = 0.6
"""Target of other gaps, as a fraction of the rotation from the classical transition to the truth. The synthetic signer
is easier to predict than people are, and most captures are filled better with half of the answer
(docs/decisions.md).
"""
_BASE = find_transition("hermite")


@dataclass(frozen=True, eq=False)
class SignerMotion:
    """A signer's motion as canonical rotations, on a skeleton with the canonical roles that the signer has.

    - skeleton: hips, then one joint for each role in ``roles``
    - roles: rows in ``ROLES`` of the skeleton's joints after the hips
    - role_parents: the row above each of all ``ROLES``, -1 for the hips
    - bones: (R, 3), from the joint above to each role's joint, arm lengths
    - sentences, words: quaternions (T, R, 4) each; words are isolated
    - seams: sentence, first transition frame, number of transition frames
    """

    skeleton: Skeleton
    roles: NDArray[np.intp]
    role_parents: NDArray[np.intp]
    bones: NDArray[np.float32]
    sentences: tuple[FloatArray, ...]
    seams: tuple[tuple[int, int, int], ...]
    words: tuple[FloatArray, ...]

    def draw_take(self, rng: np.random.Generator) -> FloatArray:
        """Returns a sentence or a word, quaternions (T, R, 4)."""
        use_words = self.words and (not self.sentences or rng.random() < WORD_FRACTION)
        takes = self.words if use_words else self.sentences
        return takes[int(rng.integers(len(takes)))]


def read_signer(path: Path) -> SignerMotion:
    """Returns the motion of a signer's file, as ``synth.training_data`` writes it."""
    with open_signer_file(path) as stored:
        quats = rotation.normalize(stored["turns"].astype(np.float32) / 32767.0)
        sentences, words = (
            tuple(quats[first : first + n_frames] for first, n_frames in stored[key].tolist())
            for key in ("sentences", "words")
        )
        bones, seams = stored["bones"].astype(np.float32), stored["seams"].tolist()
    return make_signer_motion(
        bones, np.ones(len(ROLES), bool), sentences, tuple((s, start, n) for s, start, n in seams), words
    )


def make_signer_motion(
    bones: NDArray[np.float32],
    has_role: NDArray[np.bool_],
    sentences: tuple[FloatArray, ...],
    seams: tuple[tuple[int, int, int], ...] = (),
    words: tuple[FloatArray, ...] = (),
) -> SignerMotion:
    """Returns a signer's motion on a skeleton that has the roles in ``has_role`` (R,) and no others."""
    role_parents = _role_parents()
    rows = np.flatnonzero(has_role)
    joint_of = {-1: 0} | {int(row): k + 1 for k, row in enumerate(rows)}
    parents = []
    for row in rows.tolist():
        ancestor = int(role_parents[row])
        while ancestor >= 0 and not has_role[ancestor]:
            ancestor = int(role_parents[ancestor])
        parents.append(joint_of[ancestor])
    names = ("hips", *(ROLES[row] for row in rows))
    skeleton = Skeleton(names, np.array([-1, *parents]), np.concatenate([np.zeros((1, 3)), bones[rows]]))
    return SignerMotion(skeleton, rows, role_parents, bones, sentences, seams, words)


def _role_parents() -> NDArray[np.intp]:
    """Returns the row above each role of a complete canonical humanoid (R,), -1 for the hips."""
    parents = {"spine": "", "chest": "spine", "upperChest": "chest", "neck": "upperChest", "head": "neck"}
    for side in SIDES:
        arm = [f"{side}{part}" for part in ("Shoulder", "UpperArm", "LowerArm", "Hand")]
        parents |= dict(zip(arm, ["upperChest", *arm[:-1]], strict=True))
        fingers = [role for role in ROLES if role.startswith(side) and role not in arm]
        for k, role in enumerate(fingers):
            parents[role] = arm[-1] if k % 3 == 0 else fingers[k - 1]
    return np.array([ROLES.index(parents[role]) if parents[role] else -1 for role in ROLES])


@dataclass(frozen=True)
class GapBatch:
    """B gaps of up to T frames, in windows of up to S frames.

    - tokens: (B, N_SEEN, N_TOKEN)
    - base, true: quaternions (B, T, R, 4), the classical transition and the target; real: (B, T), False at padding
    - basis: (B, T, N_TERMS) polynomials of the network's answer; weights: (B, A) its factors (``gap_features``)
    - bones: (B, R, 3), arm lengths
    - seam: (B,), whether the gap is a true transition
    - step: the training step, for messages
    """

    tokens: Tensor
    base: Tensor
    true: Tensor
    real: Tensor
    basis: Tensor
    weights: Tensor
    bones: Tensor
    seam: Tensor
    step: int = 0

    def to(self, device: torch.device) -> GapBatch:
        """Returns the batch on a device."""
        tensors = {f.name: getattr(self, f.name).to(device) for f in fields(self) if f.name != "step"}
        return GapBatch(**tensors, step=self.step)


@dataclass(frozen=True, eq=False)
class _GapPlan:
    """The first choices drawn for a gap.

    - rng: the generator for everything else
    - signer: whose motion it is
    - seam: index into the signer's seams, None for any stretch
    - n_gap: frames to hide
    """

    rng: np.random.Generator
    signer: SignerMotion
    seam: int | None
    n_gap: int


class GapDataset:
    """Gaps drawn from signers' files; every folder has the same probability.

    - signers: motion of every signer, by folder
    - seed: all gaps depend on it and on their number alone
    - n_fixed: the number of gaps, always the same ones, for validation; None: gaps without end
    - clean: true transitions only, without augmentation
    - stretch_target: see ``STRETCH_TARGET``; idle: whether some stretches show no signing
    """

    stretch_target, idle = STRETCH_TARGET, True

    def __init__(self, paths: Sequence[Path], seed: int = 0, n_fixed: int | None = None, clean: bool = False) -> None:
        self.signers = [[read_signer(path) for path in folder] for folder in group_by_folder(paths)]
        self.seed, self.n_fixed, self.clean = seed, n_fixed, clean
        if clean and not all(signer.seams for signer in chain(*self.signers)):
            raise InputError("a signer has no transition to train on; name folders with seams")

    def __len__(self) -> int:
        return self.n_fixed if self.n_fixed is not None else sum(len(signer.seams) for signer in chain(*self.signers))

    @cached_property
    def role_parents(self) -> NDArray[np.intp]:
        """Returns the row above each role, -1 for the hips."""
        return self.signers[0][0].role_parents

    def rows(self, step: int, size: int, seed: int) -> NDArray[np.int64]:
        """Returns the numbers of the gaps of a step; no gap is drawn twice."""
        return np.arange(step * size, (step + 1) * size)

    def batch(self, rows: Sequence[int] | NDArray[np.int64], step: int = 0) -> GapBatch:
        """Returns the gaps with these numbers, padded to one length."""
        gaps = [self.draw_gap(int(row)) for row in rows]
        padded = {
            name: pad_sequence([torch.from_numpy(np.asarray(gap[name])) for gap in gaps], batch_first=True)
            for name in ("base", "true", "basis")
        }
        stacked = {
            name: torch.from_numpy(np.stack([gap[name] for gap in gaps])) for name in ("tokens", "weights", "bones")
        }
        return GapBatch(
            **padded,
            **stacked,
            real=pad_sequence([torch.ones(len(gap["basis"]), dtype=torch.bool) for gap in gaps], batch_first=True),
            seam=torch.tensor([gap["seam"] for gap in gaps]),
            step=step,
        )

    def draw_gap(self, number: int) -> dict[str, Any]:
        """Returns the gap of a number, as the fields of ``GapBatch`` for one gap."""
        plan = self._draw_plan(number)
        rng, signer, n_gap = plan.rng, plan.signer, plan.n_gap
        if plan.seam is not None:
            sentence, start, n_gap = signer.seams[plan.seam]
            quats = signer.sentences[sentence]
        else:
            quats = draw_augmented_take(lambda: signer.draw_take(rng), rng, self.idle)
            n_gap = min(n_gap, len(quats) - 4)
            start = int(rng.integers(2, len(quats) - n_gap - 1))
        first_frame, stop = (
            max(0, start - gap_features.N_CONTEXT),
            min(len(quats), start + n_gap + gap_features.N_CONTEXT),
        )
        quats, start = quats[first_frame:stop], start - first_frame
        if self.n_fixed is None and not self.clean:
            quats = with_offsets_and_sway(quats, rng)
            if plan.seam is None and rng.random() < KEYED_PROBABILITY:
                quats = with_keys(quats, rng)
        if not self.clean and rng.random() < NOISE_PROBABILITY:
            quats = with_noise(quats, float(rng.uniform(*NOISE_RAD)), rng)
        arrays = self.make_arrays(signer, quats, start, n_gap)
        if plan.seam is None and self.n_fixed is None:
            target = rotation.slerp(arrays["base"], arrays["true"], self.stretch_target)
            arrays["true"] = target.astype(np.float32)
        return arrays | {"seam": plan.seam is not None}

    def _draw_plan(self, number: int) -> _GapPlan:
        """Returns the choices for a gap, without its motion."""
        rng = stream("window", self.seed, "fixed" if self.n_fixed is not None else "endless", number)
        signer = draw_from_folders(self.signers, rng)
        if (self.clean or rng.random() < SEAM_FRACTION) and signer.seams:
            seam = int(rng.integers(len(signer.seams)))
            return _GapPlan(rng, signer, seam, signer.seams[seam][2])
        log_frames = rng.uniform(np.log(gap_features.MIN_GAP_FRAMES), np.log(gap_features.MAX_GAP_FRAMES))
        return _GapPlan(rng, signer, None, round(float(np.exp(log_frames))))

    def make_arrays(self, signer: SignerMotion, quats: FloatArray, start: int, n_gap: int) -> dict[str, Any]:
        """Returns ``n_gap`` frames of a motion (T, R, 4) from ``start`` on as tokens, base, true, basis, weights and
        bones.
        """
        hips = np.broadcast_to(rotation.IDENTITY, (len(quats), 1, 4))
        local_quats = np.concatenate([hips, quats[:, signer.roles]], axis=1)
        clip = Clip(signer.skeleton, local_quats, np.zeros((len(quats), 3)), FEATURE_FPS)
        before, after = clip[:start], clip[start + n_gap :]
        base = _BASE.between(Gap(before, after, n_gap))
        window = gap_features.gap_features(canonical_motion(concatenate([before, base, after])), start, n_gap)
        base_quats = np.tile(rotation.IDENTITY, (n_gap, len(ROLES), 1))
        base_quats[:, signer.roles] = base.local_rotations[:, 1:]
        true_quats, bones = quats[start : start + n_gap], signer.bones
        if window.mirrored:
            base_quats, true_quats = (q[:, MIRROR] * [1.0, -1.0, -1.0, 1.0] for q in (base_quats, true_quats))
            bones = bones[MIRROR] * np.array([-1.0, 1.0, 1.0], np.float32)
        alpha = np.arange(1, n_gap + 1) / (n_gap + 1)
        return {
            "tokens": window.tokens,
            "base": base_quats.astype(np.float32),
            "true": true_quats.astype(np.float32),
            "basis": gap_features.answer_basis(alpha).astype(np.float32),
            "weights": window.weights.astype(np.float32),
            "bones": bones,
        }
