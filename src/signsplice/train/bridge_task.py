"""The loss and the scores of the network that makes transitions.

The loss is the mean distance of elbow, wrist and finger joints from their true positions, in arm lengths, which is also
the score that the network is judged by (``rig.metrics.position_error``), plus a smaller term for the rotations, since
positions depend little on twists.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from signsplice.rig.info import ROLES, TRUNK
from signsplice.train.gap_data import GapBatch
from signsplice.train.networks.bridge import Bridge
from signsplice.train.task import Task

ROTATION_WEIGHT = 0.1
SCORED_ROLES = [k for k, role in enumerate(ROLES) if role not in TRUNK and not role.endswith(("Shoulder", "UpperArm"))]
"""Rows of elbows, wrists and fingers in ``ROLES``."""


def to_matrices(quats: Tensor) -> Tensor:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4), x y z w."""
    x, y, z, w = quats.unbind(-1)
    rows = (
        *(1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        *(2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        *(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return torch.stack(rows, dim=-1).reshape(*quats.shape[:-1], 3, 3)


def rotate(quats: Tensor, rotvecs: Tensor) -> Tensor:
    """Quats exp(rotvecs), quaternions (..., 4), of quaternions (..., 4) and rotation vectors (..., 3)."""
    half = 0.5 * (rotvecs.square().sum(-1, keepdim=True) + 1e-12).sqrt()
    v, w = rotvecs * (0.5 * torch.sinc(half / torch.pi)), half.cos()
    qv, qw = quats[..., :3], quats[..., 3:]
    return torch.cat([qw * v + w * qv + torch.linalg.cross(qv, v), qw * w - (qv * v).sum(-1, keepdim=True)], dim=-1)


def joint_positions(rotations: Tensor, bones: Tensor, role_parents: Sequence[int]) -> Tensor:
    """Joint positions (..., R, 3) relative to the hips, arm lengths, by forward kinematics.

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
        """The loss () of a batch: mean over its gaps."""
        position_errors, rotation_errors = self.errors(batch, self.filled(batch))
        return 10.0 * position_errors.mean() + ROTATION_WEIGHT * rotation_errors.mean()

    def filled(self, batch: GapBatch) -> Tensor:
        """The network's transitions, quaternions (B, T, R, 4)."""
        # The gap's frames come first in the network's answer, whatever the length of the padded window.
        answer = self.network(batch.tokens, batch.mask)[:, : batch.weights.shape[1]].float()  # (B, T, R, 3)
        return rotate(batch.base, answer * batch.weights[..., None])

    def errors(self, batch: GapBatch, quats: Tensor) -> tuple[Tensor, Tensor]:
        """Errors of transitions ``quats`` (B, T, R, 4): mean distance (B,) of the scored joints, arm lengths, and mean
        squared sine (B,) of half the angle to the true rotation.
        """
        bones = batch.bones[:, None].expand(-1, quats.shape[1], -1, -1)
        with torch.autocast(quats.device.type, enabled=False):  # bfloat16 moves joints by 0.002
            found, true = (joint_positions(to_matrices(q), bones, self.role_parents) for q in (quats, batch.true))
        distances = (found - true)[..., SCORED_ROLES, :].square().sum(-1).add(1e-10).sqrt().mean(-1)  # (B, T)
        sines = (1.0 - (quats * batch.true).sum(-1).square()).clamp(min=0.0).mean(-1)  # (B, T)
        n_frames = batch.real.sum(1)
        return (distances * batch.real).sum(1) / n_frames, (sines * batch.real).sum(1) / n_frames

    def judge(self, batch: GapBatch) -> dict[str, float]:
        """Mean position error, arm length / 1000, of the network (``_error``) and of the classical transition
        (``_base``), for true transitions (``seam``) and for other hidden stretches (``stretch``).
        """
        errors, base_errors = self.errors(batch, self.filled(batch))[0], self.errors(batch, batch.base)[0]
        scores = {}
        for name, rows in (("seam", batch.seam), ("stretch", ~batch.seam)):
            if rows.any():
                scores[f"{name}_error"] = 1000.0 * errors[rows].mean().item()
                scores[f"{name}_base"] = 1000.0 * base_errors[rows].mean().item()
        return scores
