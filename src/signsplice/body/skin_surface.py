"""An avatar's skin: its vertices, points on it that follow the joints as players move them, and how far it lies above
the avatar's capsules, which are even where bodies are not.

The height at a place p of a capsule with outward direction n is that of the mesh along n: over the surface points v
around, in the rest pose, with h = (v - p) . n and r their distance from the line through p along n,

    height = sum w h / sum w,  w = (1 - r^2 / R^2)^2 exp(h / s)

so that the outermost decides. Places that lie in another capsule are no skin: their height fades to 0.

"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from signsplice.motion import FloatArray

if TYPE_CHECKING:
    from scipy.spatial import cKDTree


Index = NDArray[np.intp]

_AROUND_M = 0.015
"""R: distance from the line within which surface points count, m."""
_SHARP_M = 0.005
"""s: points that lie lower than the outermost by this, m, count less by a factor e."""
_FARTHEST_M, _NEAREST = 0.05, 64
"""Surface points that are farther than this from the place, m, do not count; and how many of the others do."""
_HIDDEN_M, _SHOWN_M = 0.008, 0.003
"""Depth in another capsule, m, from which on a place is no skin, and up to which it is."""


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


_BLEND_M = 0.05
"""How far a point may lie from where its main joint alone would carry it, m."""
_MOST_WEIGHTS, _CHUNK = 20_000_000, 4096
"""Points times joints of a surface, at most; and points that are looked at together."""
_COVER, _AROUND, _FACING = (0.0015, 0.015), 24, 0.3
"""A point is covered where another lies this far above it, m; how many around it are looked at; and the cosine between
both normals, at least.
"""


@dataclass(frozen=True, eq=False)
class SkinSurface:
    """N points of skin and the K joints that carry them.

    points, normals: (N, 3) in the rest pose, from the root.
    joints: (K,) rows of the skeleton.
    weights: (N, K) how much each joint carries.
    origins: (K, 3) the joints at rest.
    spacing: distance between neighbouring points.
    """

    points: FloatArray
    normals: FloatArray
    joints: NDArray[np.intp]
    weights: FloatArray
    origins: FloatArray
    spacing: float

    def deform(
        self, rotations: FloatArray, positions: FloatArray, around: tuple[FloatArray, float] | None = None
    ) -> tuple[FloatArray, FloatArray]:
        """Points and normals in the world, from the globals (J, 3, 3) and (J, 3) of one frame; of those within a
        distance ``around`` a place (3,) alone where that is given.
        """
        turn, at = rotations[self.joints], positions[self.joints]
        points, normals, weights = self.points, self.normals, self.weights
        if around is not None:
            places = np.einsum("kba,kb->ka", turn, around[0] - at) + self.origins  # as each joint sees it at rest
            near = np.linalg.norm(points - places[self._main], axis=1) < around[1] + _BLEND_M
            points, normals, weights = points[near], normals[near], weights[near]
        move = at - np.einsum("kab,kb->ka", turn, self.origins)
        blend = (weights @ turn.reshape(-1, 9)).reshape(-1, 3, 3)
        normals = np.einsum("nab,nb->na", blend, normals)
        points = np.einsum("nab,nb->na", blend, points) + weights @ move
        if around is not None:
            near = np.linalg.norm(points - around[0], axis=1) < around[1]
            points, normals = points[near], normals[near]
        return points, normals / (np.linalg.norm(normals, axis=1, keepdims=True) + 1e-12)

    @cached_property
    def _main(self) -> NDArray[np.intp]:
        """The column (N,) of the joint that carries most of each point."""
        return np.asarray(self.weights.argmax(axis=1))


@dataclass(frozen=True, eq=False)
class AvatarSkin:
    """The skin that hands meet, and that of the hands.

    body: head, neck and trunk, the outermost layer of skin and clothes.
    hands: the left and the right hand.
    mesh: the vertices that these are of.
    """

    body: SkinSurface
    hands: tuple[SkinSurface, SkinSurface]
    mesh: SkinPoints


def surface(
    points: SkinPoints, joints: Sequence[int], rest: FloatArray, spacing: float, bare: bool = False
) -> SkinSurface | None:
    """The outermost skin that ``joints`` carry, with points about ``spacing`` apart; None where there is none, or more
    than ``_MOST_WEIGHTS`` allows.

    rest: (J, 3) joints in the rest pose, from the root. bare: without clothes, where enough skin is modelled.
    """
    corners, shares, normals = points.samples(joints, spacing, bare)
    at = np.einsum("sc,scx->sx", shares, points.positions[corners])
    one_each = np.unique(np.floor(at / spacing).astype(np.int64), axis=0, return_index=True)[1]
    kept = one_each[~_is_covered(at[one_each], normals[one_each], spacing)]
    used = np.unique(points.joints[corners[kept]])
    if not 0 < len(kept) * len(used) < _MOST_WEIGHTS:
        return None
    corners, shares = corners[kept], shares[kept]
    columns = np.searchsorted(used, points.joints[corners])
    weights = np.zeros((len(kept), len(used)))
    rows = np.arange(len(kept))[:, None, None]
    np.add.at(weights, (rows, columns), shares[..., None] * points.weights[corners])
    return SkinSurface(at[kept], normals[kept], used.astype(np.intp), weights, rest[used], spacing)


REACH_M, THICK_M = 0.03, (0.03, 0.015)
"""Distance up to which points of two skins are compared, m; and half the thickness of the body, and of a hand: what
lies deeper than that under the nearest skin sees it from behind, through the end of an open mesh.
"""


def least_height(
    hand: FloatArray, tree: cKDTree, normals: FloatArray, most_across: float, thick: float
) -> tuple[float, FloatArray, FloatArray]:
    """The least height of a hand's points (H, 3) above a surface of N points, along the normal of the nearest of these,
    and the heights (K,) and normals (K, 3) of all; infinite where none is near. Points farther from that normal than
    ``most_across``, or deeper than ``thick``, are beyond the surface's edge.
    """
    apart, near = (np.asarray(found) for found in tree.query(hand, distance_upper_bound=REACH_M))
    met = np.flatnonzero(np.isfinite(apart))
    out = normals[near[met]]
    height = np.einsum("nx,nx->n", hand[met] - tree.data[near[met]], out)
    over = (apart[met] ** 2 - height**2 < most_across**2) & (height > -thick)
    return float(height[over].min(initial=np.inf)), height[over], out[over]


def _is_covered(points: FloatArray, normals: FloatArray, spacing: float) -> NDArray[np.bool_]:
    """Which points (N,) lie under others that face the same way: skin below a shirt."""
    from scipy.spatial import cKDTree  # takes long to import; only avatars need it

    tree, out = cKDTree(points), np.zeros(len(points), bool)
    for start in range(0, len(points), _CHUNK):
        part = slice(start, start + _CHUNK)
        found = tree.query(points[part], np.arange(1, _AROUND + 1), distance_upper_bound=_COVER[1])
        apart, near = (np.asarray(one) for one in found)
        met = np.isfinite(apart)
        near = np.where(met, near, 0)
        away = points[near] - points[part, None]
        height = np.einsum("nkx,nx->nk", away, normals[part])
        across = np.einsum("nkx,nkx->nk", away, away) - height**2
        facing = np.einsum("nkx,nx->nk", normals[near], normals[part]) > _FACING
        out[part] = (met & (height > _COVER[0]) & (across < spacing**2) & facing).any(axis=1)
    return out
