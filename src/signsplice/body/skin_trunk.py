"""The trunk of an avatar: columns of capsules, hips and back fitted to its skin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from signsplice.body.skin_points import MIN_POINTS, quantile, window
from signsplice.motion.arrays import FloatArray

_LEVEL, _NEAR = 0.015, 0.010
"""Distances within which vertices are at a height, and at a place seen from in front, as fractions of stature."""
_HEIGHTS = 7
"""Heights at which a column of the trunk is measured."""
_ACROSS = 0.55
"""Where the depth of an outer column is measured, as a fraction of the trunk's half width."""
_WIDEST, _OUT = 0.98, (0.3, 0.75)
"""Share of vertices that lie within the trunk's width; how far out the middle of its outer columns lies, in that."""
_LEAST_HEIGHTS = 3
_LOWER_CHEST = (0.55, 0.25)
"""Heights of the chest from which on, downward, they count less, and how much."""


@dataclass(frozen=True, eq=False)
class TrunkSkin:
    """The skin of a trunk and the capsules that are fitted to it, in place. World: left +X, up +Y, forward +Z.

    points: (N, 3) on the surface.
    height: stature.
    starts, ends, radii: (C, 3), (C, 3) and (C, 2) of all capsules of the body.
    """

    points: FloatArray
    height: float
    starts: FloatArray
    ends: FloatArray
    radii: FloatArray

    def depth(self, x: float, y: float) -> tuple[float, float] | None:
        """Back and front (z) of the skin at a place seen from in front; None where there is none."""
        near = window(self.points, (x, y), _NEAR * self.height)
        return None if near is None else (float(near[:, 2].min()), float(near[:, 2].max()))

    def column(self, name: str, row: int, n: int, middle: float) -> bool:
        """Fit one of three columns (0 on the left, 1 in the middle) with lines through front, back and side of the
        trunk, whose middle is at x = ``middle``; False where too little of it is seen.
        """
        start, end, seen = self.starts[row], self.ends[row], []
        side = (1.0, 0.0, -1.0)[n]
        for t in np.linspace(0.0, 1.0, _HEIGHTS):
            y = start[1] + t * (end[1] - start[1])
            level = self.points[np.abs(self.points[:, 1] - y) < _LEVEL * self.height]
            if len(level) < MIN_POINTS:
                continue
            wide = quantile(np.abs(level[:, 0] - middle), _WIDEST)
            depth = self.depth(middle + side * _ACROSS * wide, y)
            if depth is None:
                continue
            back, front = depth
            out = float(np.clip(wide - 0.5 * (front - back), _OUT[0] * wide, _OUT[1] * wide))
            seen.append((t, middle + side * out, back, front))
        if len(seen) < _LEAST_HEIGHTS:
            return False
        table = np.array(seen)
        for ends, t, k in ((self.starts, 0.0, 0), (self.ends, 1.0, 1)):
            weight = np.where(table[:, 0] < _LOWER_CHEST[0], 1.0, _LOWER_CHEST[1]) if name == "chest" else None
            x, back, front = (line(table[:, 0], table[:, column], t, weight) for column in (1, 2, 3))
            ends[row][0], ends[row][2] = x, 0.5 * (back + front)
            self.radii[row, k] = 0.5 * (front - back)
        return True

    def behind(self, row: int, factor: float) -> None:
        """A capsule under the skin of the back: as thick as the chest is, relative to the usual, and as far back."""
        self.radii[row] *= factor
        for ends, k in ((self.starts, 0), (self.ends, 1)):
            depth = self.depth(ends[row][0], ends[row][1])
            if depth is not None:
                ends[row][2] = max(depth[0] + self.radii[row, k], min(ends[row][2], depth[1] - self.radii[row, k]))

    def between(self, row: int) -> None:
        """A capsule from the back to the front, at both of its ends."""
        for ends, k in ((self.starts, 0), (self.ends, 1)):
            depth = self.depth(ends[row][0], ends[row][1])
            if depth is not None:
                ends[row][2], self.radii[row, k] = 0.5 * (depth[0] + depth[1]), 0.5 * (depth[1] - depth[0])


def line(t: FloatArray, values: FloatArray, at: float, weight: FloatArray | None = None) -> float:
    """The least-squares line through ``values`` (N,) at ``t`` (N,), with a weight for each, at one place."""
    w = np.full(len(t), 1.0 / len(t)) if weight is None else weight / weight.sum()
    middle, mean = float(w @ t), float(w @ values)
    spread = float(w @ (t - middle) ** 2)
    slope = float(w @ ((t - middle) * (values - mean))) / spread if spread > 0.0 else 0.0
    return mean + slope * (at - middle)
