"""A body over time: where its capsules and arms are in every frame of a clip."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from signsplice.body.capsules import BodyCapsules, capsule_ends
from signsplice.body.clearance import Near, SkinPairs, pair_clearances
from signsplice.motion import kinematics
from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import Clip
from signsplice.rig.info import rig_info
from signsplice.rig.roles import SIDES

_LEG = ("leg", "shoe")


@dataclass(frozen=True, eq=False)
class PosedBody:
    """A body over time, in metres.

    body: its capsules.
    starts, ends: (T, C, 3) of their axes in the world.
    radii: (C, 2).
    shoulders, wrists: (T, 2, 3) left and right.
    arm_lengths: (2,) upper arm and forearm together.
    relief_rotations: (T, K, 3, 3) rotations of the K capsules under the body's relief; None where it has none.
    """

    body: BodyCapsules
    starts: FloatArray
    ends: FloatArray
    radii: FloatArray
    shoulders: FloatArray
    wrists: FloatArray
    arm_lengths: FloatArray
    relief_rotations: FloatArray | None = None

    @property
    def hand_length(self) -> float:
        """Median length of the palms' capsules, m."""
        palms = [n for n, part in enumerate(self.body.parts) if part == "palm"]
        return float(np.median(np.linalg.norm(self.ends[0, palms] - self.starts[0, palms], axis=-1)))

    def heights(self, pairs: SkinPairs, near: Near) -> FloatArray:
        """How far (N,) the skin of head or trunk lies above the other capsule of near pairs, where they are nearest, m;
        0 where the capsules are the skin.
        """
        relief, body, out = self.body.relief, self.body, np.zeros(len(near.k))
        if relief is None or self.relief_rotations is None:
            return out
        own = np.flatnonzero(np.isin(pairs.other[near.k], relief.rows))
        frames, k = near.frames[own], near.k[own]
        rows, now = pairs.other[k], pair_clearances(self.starts, self.ends, self.radii, pairs, frames, k)
        outward = np.einsum(
            "nba,nb->na", self.relief_rotations[frames, np.searchsorted(relief.rows, rows)], now.normals
        )
        radius = body.radii[rows, 0] + now.other_at * (body.radii[rows, 1] - body.radii[rows, 0])
        along = now.other_at[:, None] * (body.ends - body.starts)[rows]
        points = body.starts[rows] + along + radius[:, None] * outward
        out[own] = relief.heights(rows, points, outward) * (self.radii[0, 0] / body.radii[0, 0])
        return out

    def with_arms(self, elbows: FloatArray, wrists: FloatArray) -> PosedBody:
        """The same body with elbows and wrists (T, 2, 3) elsewhere; hands keep their rotations."""
        starts, ends, moves = self.starts.copy(), self.ends.copy(), wrists - self.wrists
        for n, (part, side) in enumerate(zip(self.body.parts, self.body.sides, strict=True)):
            if not side or part in _LEG:
                continue
            arm = SIDES.index(side)
            if part == "sleeve":
                ends[:, n] = elbows[:, arm]
            elif part == "cuff":
                starts[:, n], ends[:, n] = elbows[:, arm], wrists[:, arm]
            else:
                starts[:, n] += moves[:, arm]
                ends[:, n] += moves[:, arm]
        return replace(self, starts=starts, ends=ends, wrists=wrists)


def posed_body(clip: Clip, body: BodyCapsules) -> PosedBody:
    """A clip's body over time, in metres."""
    info = rig_info(clip.skeleton)
    metres = info.sizes.unit.metres
    rotations, positions = kinematics.forward(clip)
    starts, ends = capsule_ends(body, rotations, positions)
    joints = info.arm_joints
    shoulders, elbows, wrists = (metres * positions[:, [joints[k], joints[3 + k]]] for k in range(3))
    lengths = np.linalg.norm(elbows[0] - shoulders[0], axis=-1) + np.linalg.norm(wrists[0] - elbows[0], axis=-1)
    relief_rotations = None if body.relief is None else rotations[:, body.joints[body.relief.rows]]
    return PosedBody(
        body, metres * starts, metres * ends, metres * body.radii, shoulders, wrists, lengths, relief_rotations
    )
