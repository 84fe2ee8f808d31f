"""Points on an avatar's skin that follow its joints as players move them, for a last look at what hands touch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from signsplice.body.skin_points import SkinPoints
from signsplice.motion.arrays import FloatArray

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

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

    def posed(
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
    kept = one_each[~_covered(at[one_each], normals[one_each], spacing)]
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


def _covered(points: FloatArray, normals: FloatArray, spacing: float) -> NDArray[np.bool_]:
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
