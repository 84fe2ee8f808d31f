"""An avatar's skin: its vertices, and points on it that follow the joints as players move them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from signsplice.motion import FloatArray
from signsplice.rig.roles import SIDES

Index = NDArray[np.intp]

MIN_POINTS = 6
"""Least number of vertices for a measurement."""
HALF_THICKNESS_M = (0.03, 0.015)
"""Half the thickness of the body, and of a hand, m: a point deeper than that under the nearest skin sees it from
behind, through the end of an open mesh.
"""


@dataclass(frozen=True)
class SurfaceSettings:
    """Numbers, weights and distances of points of skin."""

    bare_multiple: int = 4
    """Least number of vertices of bare skin with which clothes are ignored, in multiples of ``MIN_POINTS``."""
    triangle_rows: int = 8
    """Largest number of rows of points on a triangle: limits the memory for large triangles."""
    most_samples: int = 300_000
    """Largest number of points on all triangles; beyond it each triangle has one."""
    owned_weight: float = 0.49
    """Least weight with which joints own a vertex: half, less the rounding of bytes."""
    window_factors: tuple[float, ...] = (1.0, 2.0, 4.0)
    """Factors by which a window grows while it holds too few points."""
    blend_distance_m: float = 0.05
    """Largest distance of a point from the place to which its main joint alone would carry it, m."""
    most_weights: int = 20_000_000
    """Product of the numbers of points and joints from which on a surface is too large."""
    chunk: int = 4096
    """Number of points that are processed together."""
    cover_height_m: float = 0.0015
    """Least height of a point above another that it covers, m."""
    cover_distance_m: float = 0.015
    """Largest distance of a point from another that it covers, m."""
    cover_points: int = 24
    """Number of points around each that may cover it."""
    facing_cosine: float = 0.3
    """Least cosine between the normals of two points that face the same way."""
    comparison_m: float = 0.03
    """Largest distance of points of two skins that are compared, m."""
    sheet_m: float = 0.0015
    """Distance beyond the nearest point of skin up to which others count as near, m: both sides of a nail do."""
    patch_m: float = 0.03
    """Size of a patch of points that is tested as a whole, m."""


_SURFACE = SurfaceSettings()


@dataclass(frozen=True, eq=False)
class SkinPoints:
    """Vertices on skin or clothing.

    positions: (V, 3) in the rest pose, root at the origin, m.
    joints, weights: (V, 4) joints that carry each, and their weights.
    triangles: (F, 3) rows of such vertices.
    is_cloth: (V,) whether each lies on clothing, by the name of its material.
    """

    positions: FloatArray
    joints: NDArray[np.int64]
    weights: FloatArray
    triangles: NDArray[np.int64]
    is_cloth: NDArray[np.bool_]

    def where(self, kept: NDArray[np.bool_]) -> SkinPoints:
        """Returns the vertices that ``kept`` (V,) tells, and the triangles between them."""
        triangles = (np.cumsum(kept) - 1)[self.triangles[kept[self.triangles].all(axis=1)]]
        return SkinPoints(self.positions[kept], self.joints[kept], self.weights[kept], triangles, self.is_cloth[kept])

    def areas(self, parts: NDArray[np.intp], n_parts: int) -> FloatArray:
        """Returns the area (P,) of each body part's triangles; ``parts``: (V,) the part of each vertex."""
        edges = self.positions[self.triangles[:, 1:]] - self.positions[self.triangles[:, :1]]
        area = 0.5 * np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
        return np.asarray(np.bincount(parts[self.triangles[:, 0]], area, n_parts), np.float64)

    def of(self, joints: int | Sequence[int]) -> FloatArray:
        """Returns positions (N, 3) of the vertices that these joints carry: of bare skin if the mesh has enough."""
        return np.asarray(self.positions[self.is_of(joints, bare=True)])

    def is_of(self, joints: int | Sequence[int], bare: bool = False) -> NDArray[np.bool_]:
        """Tells which vertices (V,) these joints carry together, by half or more; with ``bare`` only bare skin, if the
        mesh has enough of it.
        """
        carried = np.asarray((self.weights * np.isin(self.joints, joints)).sum(axis=1) >= _SURFACE.owned_weight)
        skin = carried & ~self.is_cloth
        return skin if bare and skin.sum() >= _SURFACE.bare_multiple * MIN_POINTS else carried

    def surface(self, joints: Sequence[int], step: float) -> tuple[FloatArray, FloatArray]:
        """Returns points and normals (S, 3) on the triangles that these joints carry, about ``step`` m apart."""
        corners, shares, normals = self.samples(joints, step)
        return np.einsum("sc,scx->sx", shares, self.positions[corners]), normals

    def samples(
        self, joints: Sequence[int], step: float, bare: bool = False
    ) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
        """Returns points on the triangles that these joints carry, about ``step`` m apart: vertices at the corners
        (S, 3), their shares in the point (S, 3), and normals (S, 3); ``bare`` as in ``is_of``.
        """
        rows = self.triangles[self.is_of(joints, bare)[self.triangles].all(axis=1)]
        corners = self.positions[rows]  # (F, 3, 3)
        cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        area = np.linalg.norm(cross, axis=1)
        rows, corners, cross = rows[area > 0.0], corners[area > 0.0], cross[area > 0.0] / area[area > 0.0, None]
        longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1, initial=0.0)
        n_rows = np.clip(np.ceil(longest / step), 1, _SURFACE.triangle_rows).astype(np.int64)
        if (n_rows * (n_rows + 1) // 2).sum() > _SURFACE.most_samples:
            n_rows[:] = 1
        vertices, shares, normals = [np.empty((0, 3), np.int64)], [np.empty((0, 3))], [np.empty((0, 3))]
        for n in np.unique(n_rows).tolist():  # a triangle in n rows has its points at the middles of small ones
            i, j = (grid.ravel() for grid in np.meshgrid(np.arange(n), np.arange(n)))
            u, v = ((k[i + j < n] + 1.0 / 3.0) / n for k in (i, j))
            mask = n_rows == n
            vertices.append(np.repeat(rows[mask], len(u), axis=0))
            shares.append(np.tile(np.stack([1.0 - u - v, u, v], axis=1), (int(mask.sum()), 1)))
            normals.append(np.repeat(cross[mask], len(u), axis=0))
        return np.concatenate(vertices), np.concatenate(shares), np.concatenate(normals)


TRUNK = ("hips", "spine", "chest", "upperChest", "leftShoulder", "rightShoulder")
HEAD = ("head", "jaw", "leftEye", "rightEye")
_LIMB_AREAS = {
    **{"Shoulder": 0.0005, "UpperArm": 0.008, "LowerArm": 0.008, "Hand": 0.0008, "Fingers": 0.0025},
    **{"UpperLeg": 0.015, "LowerLeg": 0.015, "Foot": 0.01},
}
_LEAST_AREAS = {"head": 0.015, "neck": 0.003, "chest": 0.025, "spine": 0.006, "hips": 0.015}
_LEAST_AREAS |= {side + part: area for side in SIDES for part, area in _LIMB_AREAS.items()}
"""Least area of the skin of a body part, squared statures: under half of the least on four avatars of as many makers;
their eyes, teeth and mouths have up to 0.009.
"""


def without_doubtful(
    points: SkinPoints, is_doubtful: NDArray[np.bool_], role_of: Mapping[int, str], stature: float
) -> tuple[SkinPoints, set[str]]:
    """Returns points without doubtful ones (V,) on body parts that have enough other skin, and the parts, of
    ``_LEAST_AREAS``, that then have enough; ``role_of``: joint -> its role.
    """
    names = [*_LEAST_AREAS]
    part_of = np.array([names.index(_part(role_of.get(k, "hips"))) for k in range(points.joints.max(initial=0) + 1)])
    parts = part_of[points.joints[np.arange(len(points.joints)), points.weights.argmax(axis=1)]]
    least = np.array([*_LEAST_AREAS.values()]) * stature**2
    is_enough = points.where(~is_doubtful).areas(parts[~is_doubtful], len(names)) >= least
    kept = ~(is_doubtful & is_enough[parts])
    points = points.where(kept)
    return points, {names[k] for k in np.flatnonzero(points.areas(parts[kept], len(names)) >= least)}


def _part(role: str) -> str:
    """Returns the part of the body, of ``_LEAST_AREAS``, to which a role belongs."""
    if role in _LEAST_AREAS:
        return role
    if role in (*HEAD, *TRUNK):
        return "head" if role in HEAD else "chest"
    side = "left" if role.startswith("left") else "right"
    return side + ("Foot" if role.endswith("Toes") else "Fingers")


def quantile(values: FloatArray, fraction: float) -> float:
    """Returns the one of the values (N,) below which a fraction of them lies."""
    return float(np.sort(values)[int(fraction * (len(values) - 1) + 0.5)])


def window(points: FloatArray, at: tuple[float, float], half_width: float) -> FloatArray | None:
    """Returns the points whose x and y lie within ``half_width`` of a place, or within two or four times that if too
    few do; None if these are too few as well.
    """
    distance = np.maximum(np.abs(points[:, 0] - at[0]), np.abs(points[:, 1] - at[1]))
    for wider in _SURFACE.window_factors:
        close = points[distance < wider * half_width]
        if len(close) >= MIN_POINTS:
            return np.asarray(close)
    return None


@dataclass(frozen=True, eq=False)
class SkinSurface:
    """N points of skin and the K joints that carry them.

    points, normals: (N, 3) in the rest pose, from the root, m.
    joints: (K,) rows of the skeleton.
    weights: (N, K) of the joints.
    origins: (K, 3) places of the joints in the rest pose, m.
    spacing: about the distance between neighbouring points, m.
    """

    points: FloatArray
    normals: FloatArray
    joints: NDArray[np.intp]
    weights: FloatArray
    origins: FloatArray
    spacing: float

    def deform(self, rotations: FloatArray, positions: FloatArray, rows: Index) -> FloatArray:
        """Returns points (T, R, 3) in the world, of some rows, from global rotations (T, J, 3, 3) and positions
        (T, J, 3).
        """
        weights, points = self.weights.take(rows, axis=0), self.points.take(rows, axis=0)
        used = np.flatnonzero(weights.any(axis=0))
        weights, joints = weights[:, used], self.joints[used]
        turns = rotations[:, joints]
        moves = positions[:, joints] - np.einsum("tkab,kb->tka", turns, self.origins[used])
        matrices = np.concatenate([turns, moves[..., None]], axis=-1).transpose(1, 3, 0, 2)  # (K, 4, T, 3)
        shares = np.einsum("rk,rc->rkc", weights, np.column_stack([points, np.ones(len(points))]))
        n_shares, n_values = 4 * len(used), 3 * len(turns)
        moved = shares.reshape(len(rows), n_shares) @ matrices.reshape(n_shares, n_values)
        return np.asarray(moved.reshape(len(rows), len(turns), 3).swapaxes(0, 1))

    def turn_normals(self, rotations: FloatArray, rows: Index) -> FloatArray:
        """Returns normals (R, 3) in the world, of some rows, from global rotations (J, 3, 3) of one frame."""
        blend = (self.weights.take(rows, axis=0) @ rotations[self.joints].reshape(-1, 9)).reshape(-1, 3, 3)
        normals = np.einsum("nab,nb->na", blend, self.normals[rows])
        return np.asarray(normals / (np.linalg.norm(normals, axis=1, keepdims=True) + 1e-12))

    def near(self, rotations: FloatArray, positions: FloatArray, place: FloatArray, distance: float) -> Index:
        """Returns the patches (R,) with points that may lie within ``distance`` of a place (3,) in the world, from
        global rotations (J, 3, 3) and positions (J, 3) of one frame.
        """
        patches = self.patches
        seen = np.einsum("kba,kb->ka", rotations[self.joints], place - positions[self.joints]) + self.origins
        offsets = seen[patches.main] - self.points[patches.firsts]  # as its main joint sees the place at rest
        limit = distance + _SURFACE.blend_distance_m + patches.radii
        return np.flatnonzero(np.einsum("px,px->p", offsets, offsets) < limit * limit)

    @cached_property
    def patches(self) -> Patches:
        """The points in patches of some centimetres."""
        main = self.weights.argmax(axis=1)
        cells = np.column_stack([main, np.floor(self.points / _SURFACE.patch_m).astype(np.int64)])
        _, firsts, of_points = np.unique(cells, axis=0, return_index=True, return_inverse=True)
        of_points, radii = of_points.reshape(-1), np.zeros(len(firsts))
        np.maximum.at(radii, of_points, np.linalg.norm(self.points - self.points[firsts[of_points]], axis=1))
        return Patches(of_points, firsts, radii, main[firsts])


@dataclass(frozen=True, eq=False)
class Patches:
    """P patches of a surface of N points, each carried mainly by one joint; far ones are left out as a whole.

    of_points: (N,) the patch of each point.
    firsts: (P,) the row of one point of each.
    radii: (P,) of balls about these points in the rest pose, m.
    main: (P,) the column of the joint that carries each.
    """

    of_points: Index
    firsts: Index
    radii: FloatArray
    main: Index


@dataclass(frozen=True, eq=False)
class AvatarSkin:
    """The skin that hands meet, and the skin of the hands.

    body: head, neck and trunk, the outermost layer of skin and clothes.
    hands: the left and the right hand.
    mesh: the vertices of both.
    """

    body: SkinSurface
    hands: tuple[SkinSurface, SkinSurface]
    mesh: SkinPoints


def surface(
    points: SkinPoints, joints: Sequence[int], rest: FloatArray, spacing: float, bare: bool = False
) -> SkinSurface | None:
    """Returns the outermost skin that ``joints`` carry, with points about ``spacing`` m apart; None if there is none,
    or more than ``SurfaceSettings.most_weights`` allows.

    rest: (J, 3) joints in the rest pose, from the root. bare: without clothes, if the mesh has enough skin.
    """
    corners, shares, normals = points.samples(joints, spacing, bare)
    places = np.einsum("sc,scx->sx", shares, points.positions[corners])
    one_each = np.unique(np.floor(places / spacing).astype(np.int64), axis=0, return_index=True)[1]
    outermost = one_each[~_is_covered(places[one_each], normals[one_each], spacing)]
    used = np.unique(points.joints[corners[outermost]])
    if not 0 < len(outermost) * len(used) < _SURFACE.most_weights:
        return None
    corners, shares = corners[outermost], shares[outermost]
    columns = np.searchsorted(used, points.joints[corners])
    weights = np.zeros((len(outermost), len(used)))
    rows = np.arange(len(outermost))[:, None, None]
    np.add.at(weights, (rows, columns), shares[..., None] * points.weights[corners])
    return SkinSurface(places[outermost], normals[outermost], used.astype(np.intp), weights, rest[used], spacing)


def squared_distances(a: FloatArray, b: FloatArray) -> FloatArray:
    """Returns the squared distances (..., A, B) of points (..., A, 3) from points (..., B, 3), in single precision: all
    near the origin, since differences of large numbers lose digits.
    """
    first, second = (np.ones((*points.shape[:-1], 5), np.float32) for points in (a, b))
    first[..., :3], first[..., 3] = a, np.einsum("...x,...x->...", a, a)
    second[..., :3], second[..., 4] = -2.0 * b, np.einsum("...x,...x->...", b, b)
    return np.asarray(first @ second.swapaxes(-1, -2))


def least_height(
    hand: FloatArray, points: FloatArray, normals: FloatArray, most_across: float, half_thickness: float
) -> tuple[float, FloatArray, FloatArray]:
    """Returns the least height of a hand's points (H, 3) above a surface's points and normals (N, 3), along the normal
    of the nearest one (infinite if none is near), and the heights (K,) and normals (K, 3) of all. Points farther from
    the line of that normal than ``most_across``, or deeper than ``half_thickness``, are beyond the surface's edge; all
    in m, near the origin. Where the nearest one sees the hand's point from behind, as the lower side of a nail and a
    crease that linear blend turns inside out do, the one with the largest height within ``sheet_m`` farther counts.
    """
    squared = squared_distances(hand, points)
    nearest = squared.argmin(axis=1)
    outward, offsets = normals.take(nearest, axis=0), hand - points.take(nearest, axis=0)
    height, apart = np.einsum("nx,nx->n", offsets, outward), np.einsum("nx,nx->n", offsets, offsets)
    behind = np.flatnonzero((height < 0.0) & (apart < _SURFACE.comparison_m**2))
    if len(behind):
        limits = (np.sqrt(apart[behind]) + _SURFACE.sheet_m) ** 2
        heights = hand[behind] @ normals.T - np.einsum("nx,nx->n", points, normals)
        highest = np.where(squared[behind] < limits[:, None], heights, -np.inf).argmax(axis=1)
        outward[behind], offsets[behind] = normals[highest], hand[behind] - points[highest]
        height, apart = np.einsum("nx,nx->n", offsets, outward), np.einsum("nx,nx->n", offsets, offsets)
    over = (apart < _SURFACE.comparison_m**2) & (apart - height**2 < most_across**2) & (height > -half_thickness)
    return float(height[over].min(initial=np.inf)), height[over], outward[over]


def _is_covered(points: FloatArray, normals: FloatArray, spacing: float) -> NDArray[np.bool_]:
    """Tells which points (N,) lie under others that face the same way: skin below a shirt."""
    from scipy.spatial import cKDTree  # takes long to import; only avatars need it

    tree, covered = cKDTree(points), np.zeros(len(points), bool)
    for start in range(0, len(points), _SURFACE.chunk):
        part = slice(start, start + _SURFACE.chunk)
        neighbours = tree.query(
            points[part], np.arange(1, _SURFACE.cover_points + 1), distance_upper_bound=_SURFACE.cover_distance_m
        )
        distances, index = (np.asarray(values) for values in neighbours)
        met = np.isfinite(distances)
        index = np.where(met, index, 0)
        offsets = points[index] - points[part, None]
        height = np.einsum("nkx,nx->nk", offsets, normals[part])
        radial_squared = np.einsum("nkx,nkx->nk", offsets, offsets) - height**2
        facing = np.einsum("nkx,nx->nk", normals[index], normals[part]) > _SURFACE.facing_cosine
        covered[part] = (met & (height > _SURFACE.cover_height_m) & (radial_squared < spacing**2) & facing).any(axis=1)
    return covered
