"""How far an avatar's skin lies above its capsules, where hands come near: capsules are even, bodies are not.

The height at a place p of a capsule with outward direction n is that of the mesh along n: over the surface points v
around, in the rest pose, with h = (v - p) . n and r their distance from the line through p along n,

    height = sum w h / sum w,  w = (1 - r^2 / R^2)^2 exp(h / s)

so that the outermost decides. Places that lie in another capsule are no skin: their height fades to 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from signsplice.motion.arrays import FloatArray

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

Index = NDArray[np.intp]

_AROUND_M = 0.015
"""R: distance from the line within which surface points count, m."""
_SHARP_M = 0.005
"""s: points that lie lower than the outermost by this, m, count less by a factor e."""
_FARTHEST_M, _NEAREST = 0.05, 64
"""Surface points that are farther than this from the place, m, do not count; and how many of the others do."""
_FACING = 0.3
"""Cosine between a surface point's normal and the direction, at least."""
_HIDDEN_M, _SHOWN_M = 0.008, 0.003
"""Depth in another capsule, m, from which on a place is no skin, and up to which it is."""
_CHUNK = 4096


@dataclass(frozen=True, eq=False)
class Relief:
    """The surface of an avatar's head, neck and trunk, in its rest pose, m.

    points, normals: (S, 3) of the surface.
    rows: (K,) capsules that lie under it.
    starts, ends: (K, 3) their axes.
    radii: (K, 2).
    origins: (C, 3) the joint of each of the body's capsules.
    """

    points: FloatArray
    normals: FloatArray
    rows: Index
    starts: FloatArray
    ends: FloatArray
    radii: FloatArray
    origins: FloatArray

    @cached_property
    def _tree(self) -> cKDTree:
        from scipy.spatial import cKDTree  # takes as long to import as a small clip to convert; only avatars need it

        return cKDTree(self.points)

    def heights(self, rows: Index, points: FloatArray, directions: FloatArray) -> FloatArray:
        """Heights (N,) of the skin above capsules ``rows`` (N,) at points (N, 3) on them with outward directions
        (N, 3), in the axes of their joints and from them, m; 0 for capsules that are not under the surface.
        """
        out = np.zeros(len(rows))
        own = np.flatnonzero(np.isin(rows, self.rows))
        for start in range(0, len(own), _CHUNK):
            part = own[start : start + _CHUNK]
            rest_points = points[part] + self.origins[rows[part]]
            visible = self._visible(rows[part], rest_points)
            out[part] = visible * self._above(rest_points, directions[part])
        return out

    def _above(self, points: FloatArray, directions: FloatArray) -> FloatArray:
        apart, near = self._tree.query(points, _NEAREST, distance_upper_bound=_FARTHEST_M)
        met = np.isfinite(apart)
        near = np.where(met, near, 0)
        away = self.points[near] - points[:, None]
        height = np.einsum("nkx,nx->nk", away, directions)
        beside = np.maximum(np.einsum("nkx,nkx->nk", away, away) - height**2, 0.0) / _AROUND_M**2
        faces = met & (np.einsum("nkx,nx->nk", self.normals[near], directions) > _FACING)
        weight = np.where(faces, np.maximum(1.0 - beside, 0.0) ** 2, 0.0) * np.exp(height / _SHARP_M)
        total = weight.sum(axis=1)
        return np.asarray((weight * height).sum(axis=1) / np.where(total > 0.0, total, 1.0))

    def _visible(self, rows: Index, points: FloatArray) -> FloatArray:
        """How much of each place is skin (N,): 1 on the outside of all capsules, 0 within another."""
        axis = self.ends - self.starts
        since = points[:, None] - self.starts
        t = np.einsum("nkx,kx->nk", since, axis) / (np.einsum("kx,kx->k", axis, axis) + 1e-12)
        t = np.clip(t, 0.0, 1.0)
        away = np.linalg.norm(since - t[..., None] * axis, axis=-1)
        depth = self.radii[:, 0] + t * (self.radii[:, 1] - self.radii[:, 0]) - away
        depth[rows[:, None] == self.rows] = 0.0
        return np.asarray(np.clip((_HIDDEN_M - depth.max(axis=1)) / (_HIDDEN_M - _SHOWN_M), 0.0, 1.0))
