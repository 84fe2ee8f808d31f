"""Shirt, trousers and shoes of the figure, cut from MakeHuman's tights, with hems and bands."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from signsplice.rig.roles import SIDES
from signsplice_workshop.figure.base import (
    Floats,
    Index,
    append_line,
    compute_normals,
    find_rim,
    mean_of_neighbours,
    refine,
    split_triangles,
)
from signsplice_workshop.figure.body import ABOVE, Bodies, anchor_shares, bind, follow_capsules, put_on

_HEM, _OVERLAP = -12.5, 5.0
"""Height of the shirt's hem above the hips' joints, and how far the trousers reach above it, cm."""
_COLLAR = (-1.2, 7.8, 51.6, 0.42)
"""Depth of the middle of the collar and its largest radius, seen from above, its height there, cm, and its slope."""
_CUFF = 0.88
"""End of the sleeves, in lengths of the forearm."""
_BANDS = {"collar": 1.7, "cuff": 0.10}
"""Widths of the bands: cm, lengths of the forearm."""
_ELBOW = 2.8
"""Radius of the balls in the elbows, cm."""
_OCTAHEDRON = ((0, 1, 2), (1, 3, 2), (3, 4, 2), (4, 0, 2), (1, 0, 5), (3, 1, 5), (4, 3, 5), (0, 4, 5))
"""Its triangles; vertices +X, +Y, +Z, -X, -Y, -Z."""
_LIFT = 0.14
"""Height of the bands above the shirt, cm."""
_ANKLE = -80.0
"""Height at which trousers end, cm."""


@dataclass(frozen=True, eq=False)
class Sheet:
    """A surface of V vertices in MakeHuman's pose, cm.

    points, normals: (V, 3).
    triangles: (F, 3).
    shares: (V, K) of the anchors.
    carried: (V, R) weights of the roles that carry the vertices.
    """

    points: Floats
    normals: Floats
    triangles: Index
    shares: Floats
    carried: Floats

    def rows(self, triangles: Index) -> Sheet:
        """Returns the sheet of some triangles, with only their vertices."""
        used, corners = np.unique(triangles, return_inverse=True)
        shares, carried = self.shares[used], self.carried[used]
        return Sheet(self.points[used], self.normals[used], corners.reshape(-1, 3), shares, carried)

    def cut(self, height: Floats) -> tuple[Sheet, Sheet]:
        """Returns the parts below and above the line where ``height`` (V,) is 0."""
        below, above, pairs, alpha = split_triangles(self.triangles, height)
        values = [append_line(v, pairs, alpha) for v in (self.points, self.normals, self.shares, self.carried)]
        whole = Sheet(values[0], values[1], self.triangles, values[2], values[3])
        return whole.rows(below), whole.rows(above)

    def finer(self, is_fine: NDArray[np.bool_]) -> Sheet:
        """Returns the sheet with smaller triangles where vertices (V,) are fine, smoothed."""
        triangles, pairs = refine(self.triangles, is_fine)
        half = np.full(len(pairs), 0.5)
        points, shares, carried = (append_line(v, pairs, half) for v in (self.points, self.shares, self.carried))
        points = smooth(points, triangles, 2)
        return Sheet(points, compute_normals(points, triangles), triangles, shares, carried)


def smooth(points: Floats, triangles: Index, times: int) -> Floats:
    """Returns points (V, 3) smoothed without shrinking (Taubin 1995)."""
    mean = mean_of_neighbours(triangles, len(points))
    for step in (0.5, -0.52) * times:
        points = points + step * (mean @ points - points)
    return points


def make_sheet(bodies: Bodies, group: str) -> Sheet:
    """Returns a group of the base mesh on the words' body, in MakeHuman's pose."""
    used, corners = np.unique(bodies.base.groups[group], return_inverse=True)
    triangles, theirs = corners.reshape(-1, 3), 10.0 * (bodies.base.points - bodies.base.joints["mixamorig:Hips"])[used]
    weights = {role: weight[used] for role, weight in bodies.weights.items()}
    shares = anchor_shares(bodies, theirs, weights)
    points = put_on(bodies, theirs, shares)
    return Sheet(
        points, compute_normals(points, triangles), triangles,
        np.stack([shares[name] for name in ABOVE], axis=1), np.stack([*weights.values()], axis=1),
    )  # fmt: skip


def to_bind_pose(bodies: Bodies, sheet: Sheet) -> Sheet:
    """Returns the sheet in the bind pose; its normals turn with it."""
    weights = dict(zip(bodies.weights, sheet.carried.T, strict=True))
    points = bind(bodies, sheet.points, weights)
    tips = bind(bodies, sheet.points + 0.01 * sheet.normals, weights) - points
    return replace(sheet, points=points, normals=tips / np.maximum(np.linalg.norm(tips, axis=1, keepdims=True), 1e-12))


def within_collar(points: Floats) -> Floats:
    """Returns how far points (V, 3) lie above the collar's line, cm."""
    depth, radius, height, slope = _COLLAR
    over = (points[:, 1] - height + slope * (points[:, 2] - depth)) / np.hypot(1.0, slope)
    round_seen = radius - np.hypot(points[:, 0], points[:, 2] - depth)
    return np.asarray(-np.logaddexp(-round_seen, -over))


def along_forearm(bodies: Bodies, points: Floats) -> Floats:
    """Returns how far points (V, 3) lie along a forearm, 0 at the elbow to 1 at the wrist; negative elsewhere."""
    along = np.full(len(points), -1.0)
    for side, sign in (("left", 1.0), ("right", -1.0)):
        start, axis = bodies.posed[f"{side}LowerArm"], bodies.posed[f"{side}Hand"] - bodies.posed[f"{side}LowerArm"]
        t = (points - start) @ axis / (axis @ axis)
        along = np.where(sign * points[:, 0] > 32.0, t, along)
    return along


def make_clothes(bodies: Bodies) -> dict[str, Sheet]:
    """Returns shirt, trim, trousers, left and right shoe in the bind pose."""
    tights = make_sheet(bodies, "helper-tights")
    points = smooth(tights.points, tights.triangles, 6)
    points = follow_capsules(bodies, points, tights.triangles, _heights(bodies, points))
    points = smooth(points, tights.triangles, 3)
    tights = replace(tights, points=points, normals=compute_normals(points, tights.triangles))
    made = _make_shirt(bodies, tights) | _make_trousers(tights)
    return {name: to_bind_pose(bodies, sheet) for name, sheet in made.items()}


def _heights(bodies: Bodies, points: Floats) -> Floats:
    """Returns the heights (V,) of clothes above the capsules: nearly none where hands touch; at waist, hips, shoulders
    and upper arms, whose capsules are stout, they lie deeper.
    """
    x, y = np.abs(points[:, 0]), points[:, 1]
    sideways = np.clip(x / 15.0, 0.0, 1.0) ** 2 * (x < 24.0)
    waist, hip = (sideways * np.exp(-0.5 * ((y - at) / wide) ** 2) for at, wide in ((14.0, 9.0), (-8.0, 6.0)))
    shoulder = np.clip((y - 41.0) / 6.0, 0.0, 1.0) * np.clip((x - 9.0) / 6.0, 0.0, 1.0)
    arm = np.clip((x - 19.0) / 4.0, 0.0, 1.0) * np.clip((0.8 - along_forearm(bodies, points)) / 0.4, 0.0, 1.0)
    neck = np.clip(within_collar(points) / 1.5 + 1.0, 0.0, 1.0)
    leg = np.clip((_HEM - y) / 30.0, 0.0, 1.0)
    above_legs = 2.0 * waist + 0.8 * hip + 1.6 * shoulder + 0.7 * arm * (1.0 - shoulder) * (y > 5.0) + 0.8 * neck
    return np.asarray(-0.1 + 0.7 * leg - above_legs)


def _make_shirt(bodies: Bodies, tights: Sheet) -> dict[str, Sheet]:
    """Returns the shirt, and its collar and cuffs as trim."""
    points, names = tights.points, [*bodies.weights]
    mean, carried = mean_of_neighbours(tights.triangles, len(points)), tights.carried.copy()
    near = np.clip((points[:, 1] - 36.0) / 4.0, 0.0, 1.0) * np.clip((21.0 - np.abs(points[:, 0])) / 4.0, 0.0, 1.0)
    for _ in range(8):  # shoulders that rise must not make a bump
        carried += near[:, None] * (mean @ carried - carried)
    for side in SIDES:  # a shirt hangs from the hips
        carried[:, names.index("hips")] += carried[:, names.index(f"{side}UpperLeg")]
        carried[:, names.index(f"{side}UpperLeg")] = 0.0
    low, high = np.clip((4.0 - points[:, 1]) / 8.0, 0.0, 1.0), np.clip(within_collar(points) / 4.0 + 1.0, 0.0, 1.0)
    points = points + np.maximum(low, 0.6 * high)[:, None] * (smooth(points, tights.triangles, 30) - points)
    is_arm = (np.abs(points[:, 0]) > 17.0) & (points[:, 1] > 0.0)
    shirt = replace(tights, points=points, carried=carried).finer(is_arm | (within_collar(points) > -5.0))
    shirt = shirt.cut(within_collar(shirt.points))[0]
    shirt = shirt.cut(along_forearm(bodies, shirt.points) - _CUFF)[0]
    shirt = shirt.cut(_HEM - shirt.points[:, 1])[0]
    flare = np.clip((_HEM + 14.0 - shirt.points[:, 1]) / 14.0, 0.0, 1.0) ** 1.5
    points = shirt.points + (0.25 + 0.3 * flare)[:, None] * _level(shirt.normals, flare)
    points = smooth_rim(points, shirt.triangles, 12)
    shirt = replace(shirt, points=points, normals=compute_normals(points, shirt.triangles))
    rim = np.unique(find_rim(shirt.triangles))
    rim_of_collar = cKDTree(points[rim[points[rim, 1] > 40.0]])
    shirt, collar = shirt.cut(_BANDS["collar"] - np.asarray(rim_of_collar.query(points)[0]))
    is_top = np.asarray(rim_of_collar.query(collar.points)[0]) < 0.1
    shirt, cuffs = shirt.cut(along_forearm(bodies, shirt.points) - _CUFF + _BANDS["cuff"])
    up = np.array([0.0, 1.0, 0.0])
    forearm = bodies.posed["leftLowerArm"] - bodies.posed["leftHand"]
    into = forearm / np.linalg.norm(forearm)
    into = np.where(cuffs.points[:, :1] > 0.0, into, into * [-1.0, 1.0, 1.0])
    collar, cuffs = (replace(band, points=band.points + _LIFT * band.normals) for band in (collar, cuffs))
    collar = thicken(thicken(collar, -up, 0.3, 2.5, is_top), up, 0.3, 0.0, ~is_top)
    elbows = [_make_elbow(bodies, f"{side}LowerArm") for side in SIDES]
    is_hem = shirt.points[:, 1] < _HEM + 1.0
    shirt = join([thicken(shirt, up, 0.35, 2.5, is_hem), *elbows])
    return {"shirt": shirt, "trim": join([collar, thicken(cuffs, into, 0.4, 0.0)])}


def _make_elbow(bodies: Bodies, role: str) -> Sheet:
    """Returns a ball in an elbow of the shirt, which keeps it round when it bends: skinning flattens it."""
    points, triangles = np.concatenate([np.eye(3), -np.eye(3)]), np.array(_OCTAHEDRON)
    for _ in range(2):
        triangles, pairs = refine(triangles, np.ones(len(points), bool))
        points = append_line(points, pairs, np.full(len(pairs), 0.5))
        points /= np.linalg.norm(points, axis=1, keepdims=True)
    shares, carried = np.zeros((len(points), len(ABOVE))), np.zeros((len(points), len(bodies.weights)))
    shares[:, [*ABOVE].index(role)] = carried[:, [*bodies.weights].index(role)] = 1.0
    return Sheet(_ELBOW * points + bodies.posed[role], points, triangles, shares, carried)


def _make_trousers(tights: Sheet) -> dict[str, Sheet]:
    """Returns trousers, which reach under the shirt, and the left and right shoe."""
    lower = tights.cut(tights.points[:, 1] - _HEM - _OVERLAP)[0]
    height = lower.points[:, 1:2]
    under_shirt, loose = np.clip((height - _HEM + 6.0) / 6.0, 0.0, 1.0), np.clip((-45.0 - height) / 30.0, 0.0, 1.0)
    is_trousers = height > _ANKLE
    lower = replace(lower, points=lower.points + (0.5 * loose * is_trousers - 0.45 * under_shirt) * lower.normals)
    shoes, trousers = lower.cut(lower.points[:, 1] - _ANKLE)
    is_ankle = trousers.points[:, 1] < _ANKLE + 1.0
    made = {"trousers": thicken(trousers, np.array([0.0, 1.0, 0.0]), 0.3, 0.0, is_ankle)}
    for side, sign in (("left", 1.0), ("right", -1.0)):
        made[f"{side} shoe"] = shoes.rows(shoes.triangles[(sign * shoes.points[shoes.triangles, 0] > 0.0).all(axis=1)])
    return made


def smooth_rim(points: Floats, triangles: Index, times: int) -> Floats:
    """Returns points (V, 3) whose rim is smoothed along itself."""
    mean, rim, points = mean_of_neighbours(triangles, len(points)), np.unique(find_rim(triangles)), points.copy()
    for _ in range(times):
        points[rim] += 0.5 * ((mean @ points)[rim] - points[rim])
    return points


def _level(normals: Floats, share: Floats) -> Floats:
    """Returns normals (V, 3) that are level where ``share`` is 1."""
    turned = normals * np.stack([np.ones_like(share), 1.0 - share, np.ones_like(share)], axis=1)
    return np.asarray(turned / np.maximum(np.linalg.norm(turned, axis=1, keepdims=True), 1e-9))


def thicken(
    sheet: Sheet, into: Floats, thickness: float, lining: float, where: NDArray[np.bool_] | None = None
) -> Sheet:
    """Returns a sheet with walls of a ``thickness`` below its rim, and a lining from there, cm.

    into: (3,) or (V, 3) unit vectors from the rim into the sheet. where: (V,) vertices of the rim that have a wall.
    """
    rim = find_rim(sheet.triangles)
    rim = rim if where is None else rim[np.pad(where, (0, len(sheet.points) - len(where)))[rim].all(axis=1)]
    ends, corners = np.unique(rim, return_inverse=True)
    a, b = corners.reshape(-1, 2).T
    n, normal, inward = len(ends), sheet.normals[ends], np.broadcast_to(into, sheet.points.shape)[ends]
    outer = sheet.points[ends]
    bottom = outer - thickness * normal
    points = np.concatenate([outer, bottom, bottom, bottom + lining * inward])
    normals = np.concatenate([-inward, -inward, -normal, -normal])
    quads = [(b, a, a + n), (b, a + n, b + n), (b + 2 * n, a + 2 * n, a + 3 * n), (b + 2 * n, a + 3 * n, b + 3 * n)]
    k = 4 if lining else 2
    rows, wall = np.tile(ends, k), np.concatenate([np.stack(quad, axis=1) for quad in quads[:k]])
    return join([sheet, Sheet(points[: k * n], normals[: k * n], wall, sheet.shares[rows], sheet.carried[rows])])


def join(sheets: list[Sheet]) -> Sheet:
    """Returns sheets as one."""
    starts = np.cumsum([0, *(len(sheet.points) for sheet in sheets)])
    return Sheet(
        np.concatenate([sheet.points for sheet in sheets]),
        np.concatenate([sheet.normals for sheet in sheets]),
        np.concatenate([sheet.triangles + k for sheet, k in zip(sheets, starts[:-1], strict=True)]),
        np.concatenate([sheet.shares for sheet in sheets]),
        np.concatenate([sheet.carried for sheet in sheets]),
    )
