"""The vertices of a mesh that are skin, and the plain statistics that capsules are fitted with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from signsplice.motion.arrays import FloatArray

MIN_POINTS = 6
"""Fewer vertices than this are too few to measure."""
_BARE = 4
"""Vertices of bare skin, in those, from which on clothes around it do not count."""
_MOST_ROWS = 8
"""Rows of points on a triangle, at most: large triangles do not ask for more memory than small ones."""
_MOST_SAMPLES = 300_000
"""Points on all triangles, from which on each has but one."""
_OWN = 0.49
"""A vertex belongs to the joints that carry at least this much of it: half, and the rounding of bytes."""
_WIDER = (1.0, 2.0, 4.0)
"""By how much a window grows where it holds too few points."""


@dataclass(frozen=True, eq=False)
class SkinPoints:
    """Vertices of skin, without hair, skirts and accessories.

    positions: (V, 3) in the rest pose, root at the origin.
    joints, weights: (V, 4) which joints carry each, and how much.
    triangles: (F, 3) those between such vertices.
    is_cloth: (V,) which lie on clothing, by its name.
    """

    positions: FloatArray
    joints: NDArray[np.int64]
    weights: FloatArray
    triangles: NDArray[np.int64]
    is_cloth: NDArray[np.bool_]

    def of(self, joints: int | Sequence[int]) -> FloatArray:
        """Positions (N, 3) of the vertices that these joints carry together: of bare skin where enough is modelled."""
        return np.asarray(self.positions[self.is_of(joints, bare=True)])

    def is_of(self, joints: int | Sequence[int], bare: bool = False) -> NDArray[np.bool_]:
        """Which vertices (V,) these joints carry together, by half or more; of bare skin alone where enough of it is
        modelled and it is asked for (``bare``).
        """
        own = np.asarray((self.weights * np.isin(self.joints, joints)).sum(axis=1) >= _OWN)
        skin = own & ~self.is_cloth
        return skin if bare and skin.sum() >= _BARE * MIN_POINTS else own

    def surface(self, joints: Sequence[int], step: float) -> tuple[FloatArray, FloatArray]:
        """Points and normals (S, 3) on the triangles that these joints carry, about ``step`` apart."""
        corners, shares, normals = self.samples(joints, step)
        return np.einsum("sc,scx->sx", shares, self.positions[corners]), normals

    def samples(
        self, joints: Sequence[int], step: float, bare: bool = False
    ) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
        """Points on the triangles that these joints carry, about ``step`` apart: the vertices at the corners (S, 3),
        how much of each is in the point (S, 3), and normals (S, 3); ``bare`` as in ``is_of``.
        """
        rows = self.triangles[self.is_of(joints, bare)[self.triangles].all(axis=1)]
        corners = self.positions[rows]  # (F, 3, 3)
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = np.linalg.norm(across, axis=1)
        rows, corners, across = rows[area > 0.0], corners[area > 0.0], across[area > 0.0] / area[area > 0.0, None]
        longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1, initial=0.0)
        n_rows = np.clip(np.ceil(longest / step), 1, _MOST_ROWS).astype(np.int64)
        if (n_rows * (n_rows + 1) // 2).sum() > _MOST_SAMPLES:
            n_rows[:] = 1
        vertices, shares, normals = [np.empty((0, 3), np.int64)], [np.empty((0, 3))], [np.empty((0, 3))]
        for n in np.unique(n_rows).tolist():  # a triangle in n rows has its points at the middles of small ones
            i, j = (grid.ravel() for grid in np.meshgrid(np.arange(n), np.arange(n)))
            u, v = ((k[i + j < n] + 1.0 / 3.0) / n for k in (i, j))
            of = n_rows == n
            vertices.append(np.repeat(rows[of], len(u), axis=0))
            shares.append(np.tile(np.stack([1.0 - u - v, u, v], axis=1), (int(of.sum()), 1)))
            normals.append(np.repeat(across[of], len(u), axis=0))
        return np.concatenate(vertices), np.concatenate(shares), np.concatenate(normals)


def quantile(values: FloatArray, fraction: float) -> float:
    """The value (one of them) below which a fraction of values (N,) lies."""
    return float(np.sort(values)[int(fraction * (len(values) - 1) + 0.5)])


def window(points: FloatArray, at: tuple[float, float], half: float) -> FloatArray | None:
    """Points (N, 3) whose x and y lie within ``half`` of a place, or within two or four times that where there are too
    few; None where these are too few too.
    """
    away = np.maximum(np.abs(points[:, 0] - at[0]), np.abs(points[:, 1] - at[1]))
    for wider in _WIDER:
        near = points[away < wider * half]
        if len(near) >= MIN_POINTS:
            return np.asarray(near)
    return None
