"""The vertices of a mesh that are skin, and the plain statistics that capsules are fitted with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

MIN_POINTS = 6
"""Fewer vertices than this are too few to measure."""
_OWN = 0.5
"""A vertex belongs to the joints that carry at least this much of it."""


@dataclass(frozen=True, eq=False)
class SkinPoints:
    """Vertices of skin, without hair, skirts and accessories.

    positions: (V, 3) in the rest pose, root at the origin.
    joints, weights: (V, 4) which joints carry each, and how much.
    """

    positions: Float
    joints: NDArray[np.int64]
    weights: Float

    def of(self, joints: int | Sequence[int]) -> Float:
        """Positions (N, 3) of the vertices that these joints carry together, by half or more."""
        return self.positions[(self.weights * np.isin(self.joints, joints)).sum(axis=1) >= _OWN - 0.01]


def quantile(values: Float, share: float) -> float:
    """The value (one of them) below which a share of values (N,) lies."""
    return float(np.sort(values)[int(share * (len(values) - 1) + 0.5)])


def window(points: Float, at: tuple[float, float], half: float) -> Float | None:
    """Points (N, 3) whose x and y lie within ``half`` of a place, or within two or four times that where there are too
    few; None where these are too few too.
    """
    away = np.abs(points[:, :2] - np.array(at)).max(axis=1)
    for wider in (1.0, 2.0, 4.0):
        near = points[away < wider * half]
        if len(near) >= MIN_POINTS:
            return near
    return None
