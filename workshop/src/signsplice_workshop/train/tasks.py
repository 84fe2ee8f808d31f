"""The tasks of the training loop: a network with its loss and its scores, for both shipped networks.

The loss of the network that makes transitions is the mean distance of elbow, wrist and finger joints from their true
positions, in arm lengths, which is also its score (``motion_scores.position_error``), plus a smaller term for the
rotations, since positions depend little on twists.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn import functional as F  # noqa: N812

from signsplice.rig.info import ROLES, TRUNK
from signsplice.splicing.features import IS_ARM
from signsplice_workshop.train.cut_data import CutBatch
from signsplice_workshop.train.gap_data import GapBatch
from signsplice_workshop.train.networks import Bridge, Cutting
from signsplice_workshop.train.processes import average_counts


class Task(nn.Module, ABC):
    """A network with its loss; ``forward`` returns the loss, so that ``DistributedDataParallel`` can wrap a task.

    - network: the module that is trained and exported
    """

    network: nn.Module

    @abstractmethod
    def forward(self, batch: Any) -> Tensor:
        """Returns the loss () of a batch."""

    @abstractmethod
    def judge(self, batch: Any) -> dict[str, float]:
        """Returns scores of a batch by name, means over its pairs."""


ROTATION_WEIGHT = 0.1
SCORED_ROLES = [k for k, role in enumerate(ROLES) if role not in TRUNK and not role.endswith(("Shoulder", "UpperArm"))]
"""Rows of elbows, wrists and fingers in ``ROLES``."""


def to_matrices(quats: Tensor) -> Tensor:
    """Returns rotation matrices (..., 3, 3) of unit quaternions (..., 4), x y z w."""
    x, y, z, w = quats.unbind(-1)
    rows = (
        *(1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        *(2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        *(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return torch.stack(rows, dim=-1).reshape(*quats.shape[:-1], 3, 3)


def rotate(quats: Tensor, rotvecs: Tensor) -> Tensor:
    """Returns quats exp(rotvecs), quaternions (..., 4), of quaternions (..., 4) and rotation vectors (..., 3)."""
    half = 0.5 * (rotvecs.square().sum(-1, keepdim=True) + 1e-12).sqrt()
    v, w = rotvecs * (0.5 * torch.sinc(half / torch.pi)), half.cos()
    qv, qw = quats[..., :3], quats[..., 3:]
    return torch.cat([qw * v + w * qv + torch.linalg.cross(qv, v), qw * w - (qv * v).sum(-1, keepdim=True)], dim=-1)


def compute_joint_positions(rotations: Tensor, bones: Tensor, role_parents: Sequence[int]) -> Tensor:
    """Returns joint positions (..., R, 3) relative to the hips, arm lengths, by forward kinematics.

    rotations: matrices (..., R, 3, 3). bones: (..., R, 3). role_parents: the row above each role, -1 for the hips.
    """
    global_rotations: list[Tensor] = []
    positions: list[Tensor] = []
    for role, parent in enumerate(role_parents):
        local, bone = rotations[..., role, :, :], bones[..., role, :]
        if parent < 0:
            positions.append(bone.expand(local.shape[:-1]))
            global_rotations.append(local)
        else:
            positions.append(positions[parent] + (global_rotations[parent] @ bone[..., None])[..., 0])
            global_rotations.append(global_rotations[parent] @ local)
    return torch.stack(positions, dim=-2)


class BridgeTask(Task):
    """The network that fills gaps, with its loss.

    - network: maps a gap's tokens to rotation vectors that are added to the classical transition
    - role_parents: the row above each role of ``ROLES``, -1 for the hips
    """

    def __init__(self, network: Bridge, role_parents: Sequence[int]) -> None:
        super().__init__()
        self.network: Bridge = network
        self.role_parents = tuple(int(row) for row in role_parents)

    def forward(self, batch: GapBatch) -> Tensor:
        """Returns the loss () of a batch: mean over its gaps."""
        position_errors, rotation_errors = self.measure_errors(batch, self.predict_transitions(batch))
        return 10.0 * position_errors.mean() + ROTATION_WEIGHT * rotation_errors.mean()

    def predict_transitions(self, batch: GapBatch) -> Tensor:
        """Returns the network's transitions, quaternions (B, T, R, 4)."""
        terms = self.network(batch.tokens).float()  # (B, N_TERMS, A, 3)
        rotvecs = torch.einsum("btk,bkac->btac", batch.basis, terms) * batch.weights[:, None, :, None]
        quats = batch.base.clone()
        quats[:, :, IS_ARM] = rotate(batch.base[:, :, IS_ARM], rotvecs)
        return quats

    def measure_errors(self, batch: GapBatch, quats: Tensor) -> tuple[Tensor, Tensor]:
        """Returns errors of transitions ``quats`` (B, T, R, 4): mean distance (B,) of the scored joints, arm lengths,
        and mean squared sine (B,) of half the angle to the true rotation.
        """
        bones = batch.bones[:, None].expand(-1, quats.shape[1], -1, -1)
        with torch.autocast(quats.device.type, enabled=False):  # bfloat16 moves joints by 0.002
            predicted, target = (
                compute_joint_positions(to_matrices(q), bones, self.role_parents) for q in (quats, batch.true)
            )
        distances = (predicted - target)[..., SCORED_ROLES, :].square().sum(-1).add(1e-10).sqrt().mean(-1)  # (B, T)
        sines = (1.0 - (quats * batch.true).sum(-1).square()).clamp(min=0.0).mean(-1)  # (B, T)
        n_frames = batch.real.sum(1)
        return (distances * batch.real).sum(1) / n_frames, (sines * batch.real).sum(1) / n_frames

    def judge(self, batch: GapBatch) -> dict[str, float]:
        """Returns the mean position error, arm length / 1000, of the network (``_error``) and of the classical
        transition (``_base``), for true transitions (``seam``) and for other hidden stretches (``stretch``).
        """
        errors, base_errors = (
            self.measure_errors(batch, self.predict_transitions(batch))[0],
            self.measure_errors(batch, batch.base)[0],
        )
        scores = {}
        for name, rows in (("seam", batch.seam), ("stretch", ~batch.seam)):
            if rows.any():
                scores[f"{name}_error"] = 1000.0 * errors[rows].mean().item()
                scores[f"{name}_base"] = 1000.0 * base_errors[rows].mean().item()
        return scores


PHASE_WEIGHT = 0.5
_IMPOSSIBLE = -1e4
"""Score of a frame of padding."""


@dataclass(frozen=True)
class CutPrediction:
    """The network's predictions for a batch.

    - leave_scores, enter_scores: (G, W, W, T), very low at padding
    - phase_logits: (G, W, T, 5)
    """

    leave_scores: Tensor
    enter_scores: Tensor
    phase_logits: Tensor


class CuttingTask(Task):
    """The network that cuts, with its loss: cross-entropy of both frames of every pair and of the phases."""

    def __init__(self, network: Cutting) -> None:
        super().__init__()
        self.network: Cutting = network

    def predict(self, batch: CutBatch) -> CutPrediction:
        """Returns the network's predictions for all words and pairs of a batch."""
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
        return CutPrediction(
            leave_scores.masked_fill(~batch.mask[:, :, None], _IMPOSSIBLE),
            enter_scores.masked_fill(~batch.mask[:, None], _IMPOSSIBLE),
            phase_logits,
        )

    def forward(self, batch: CutBatch) -> Tensor:
        """Returns the loss () of a batch."""
        prediction, known = self.predict(batch), batch.has_truth
        counts = torch.stack([known.sum(), batch.mask.sum()])
        n_known, n_frames = average_counts(counts) if self.training else counts.clamp(min=1)
        cut_loss = F.cross_entropy(prediction.leave_scores[known], batch.pre[known], reduction="sum")
        cut_loss = cut_loss + F.cross_entropy(prediction.enter_scores[known], batch.post[known], reduction="sum")
        frame_losses = F.cross_entropy(prediction.phase_logits.flatten(0, 2), batch.phases.flatten(), reduction="none")
        phase_loss = (frame_losses * batch.mask.flatten()).sum() / n_frames
        loss: Tensor = cut_loss / n_known + PHASE_WEIGHT * phase_loss
        return loss

    def judge(self, batch: CutBatch) -> dict[str, float]:
        """Returns scores over the pairs with a truth; empty if there is none.

        ``pre``, ``post``, ``both``: fractions of exact frames. ``within_2``: fraction with both frames within two.
        """
        known = batch.has_truth
        if not bool(known.any()):
            return {}
        prediction = self.predict(batch)
        pre, post = prediction.leave_scores.argmax(-1), prediction.enter_scores.argmax(-1)  # (G, W, W)
        distances = torch.stack([pre - batch.pre, post - batch.post], dim=-1).abs()[known]  # (pairs, 2)
        exact = distances == 0
        return {
            "pre": exact[..., 0].float().mean().item(),
            "post": exact[..., 1].float().mean().item(),
            "both": exact.all(-1).float().mean().item(),
            "within_2": (distances <= 2).all(-1).float().mean().item(),
        }
