"""What the network that makes transitions learns: joints where the signer had them.

The loss is the mean distance of elbow, wrist and finger joints from their true places, in arm lengths, which is the
score it is judged by (``motion.measures.position_error``), and a smaller part for the turns themselves, since places
say little of twists.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from signsplice.rig.canonical import ROLES, TRUNK
from signsplice.train.product.gap_data import GapBatch
from signsplice.train.product.networks.bridge import Bridge
from signsplice.train.task import Task

TURN_WEIGHT = 0.1
JUDGED = [k for k, role in enumerate(ROLES) if role not in TRUNK and not role.endswith(("Shoulder", "UpperArm"))]
"""Rows of elbows, wrists and fingers."""


def to_matrices(q: Tensor) -> Tensor:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4), x y z w."""
    x, y, z, w = q.unbind(-1)
    rows = (
        *(1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        *(2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        *(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    )
    return torch.stack(rows, dim=-1).reshape(*q.shape[:-1], 3, 3)


def turned(base: Tensor, deltas: Tensor) -> Tensor:
    """Quaternions base exp(deltas) (..., 4) of quaternions (..., 4) and rotation vectors (..., 3)."""
    half = 0.5 * (deltas.square().sum(-1, keepdim=True) + 1e-12).sqrt()
    v, w = deltas * (0.5 * torch.sinc(half / torch.pi)), half.cos()
    bv, bw = base[..., :3], base[..., 3:]
    return torch.cat([bw * v + w * bv + torch.linalg.cross(bv, v), bw * w - (bv * v).sum(-1, keepdim=True)], dim=-1)


def places(turns: Tensor, bones: Tensor, above: Sequence[int]) -> Tensor:
    """Where the joints lie from the hips (..., R, 3), arm lengths, of turns (..., R, 3, 3) and bones (..., R, 3)."""
    carried: list[Tensor] = []
    at: list[Tensor] = []
    for row, over in enumerate(above):
        own, bone = turns[..., row, :, :], bones[..., row, :]
        if over < 0:
            at.append(bone.expand(own.shape[:-1]))
            carried.append(own)
        else:
            at.append(at[over] + (carried[over] @ bone[..., None])[..., 0])
            carried.append(carried[over] @ own)
    return torch.stack(at, dim=-2)


class BridgeTask(Task):
    """A network that fills gaps, with its loss."""

    def __init__(self, network: Bridge, above: Sequence[int]) -> None:
        super().__init__()
        self.network: Bridge = network
        self.above = tuple(int(row) for row in above)

    def forward(self, batch: GapBatch) -> Tensor:
        """The loss () of a batch: mean over its gaps."""
        error, turn = self._errors(batch, self._made(batch))
        return 10.0 * error.mean() + TURN_WEIGHT * turn.mean()

    def _made(self, batch: GapBatch) -> Tensor:
        """Turns (B, T, R, 4); the gap's frames lead the network's answer, whatever the window's length."""
        answer = self.network(batch.tokens, batch.mask)[:, : batch.weights.shape[1]].float()
        return turned(batch.base, answer * batch.weights[..., None])

    def _errors(self, batch: GapBatch, made: Tensor) -> tuple[Tensor, Tensor]:
        """Mean distance of the judged joints (B,), arm lengths, and mean squared sine of half the turn away (B,)."""
        bones = batch.bones[:, None].expand(-1, made.shape[1], -1, -1)
        here, there = (places(to_matrices(q), bones, self.above) for q in (made, batch.true))
        apart = (here - there)[..., JUDGED, :].square().sum(-1).add(1e-10).sqrt().mean(-1)
        turn = (1.0 - (made * batch.true).sum(-1).square()).clamp(min=0.0).mean(-1)
        count = batch.real.sum(1)
        return (apart * batch.real).sum(1) / count, (turn * batch.real).sum(1) / count

    def judge(self, batch: GapBatch) -> dict[str, float]:
        """Mean error, arm / 1000, beside the classical transition's, for true transitions and for hidden stretches."""
        ours, base = self._errors(batch, self._made(batch))[0], self._errors(batch, batch.base)[0]
        out = {}
        for name, rows in (("seam", batch.seam), ("stretch", ~batch.seam)):
            if rows.any():
                out[f"{name}_error"] = 1000.0 * ours[rows].mean().item()
                out[f"{name}_base"] = 1000.0 * base[rows].mean().item()
        return out
