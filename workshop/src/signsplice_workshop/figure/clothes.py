"""Shirt, trousers and shoes of the figure, cut from MakeHuman's tights, with hems and bands."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

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
        return Sheet(self.points[used], self.normals[used], corners.reshape(-1, 3), self.shares[used], self.carried[used])

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
    x, y, z = points.T
    waist = np.exp(-0.5 * ((y - 14.0) / 9.0) ** 2) * np.clip(np.abs(x) / 15.0, 0.0, 1.0) ** 2 * (np.abs(x) < 21.0)
    leg = np.clip((_HEM - y) / 30.0, 0.0, 1.0) * (y < _HEM)
    shoulder = np.clip((y - 41.0) / 6.0, 0.0, 1.0) * np.clip((np.abs(x) - 9.0) / 6.0, 0.0, 1.0)
    arm = np.clip((np.abs(x) - 19.0) / 4.0, 0.0, 1.0) * (y > 5.0)
    height = 0.25 - 2.2 * waist + 0.4 * leg - 1.8 * shoulder - 1.0 * arm * (1.0 - shoulder)
    points = follow_capsules(bodies, points, tights.triangles, height, np.ones(len(points)))
    points = smooth(points, tights.triangles, 3)
    tights = replace(tights, points=points, normals=compute_normals(points, tights.triangles))
    names = [*bodies.weights]
    mean, carried = mean_of_neighbours(tights.triangles, len(tights.points)), tights.carried
    near = np.clip((tights.points[:, 1:2] - 36.0) / 4.0, 0.0, 1.0) * np.clip((21.0 - np.abs(tights.points[:, :1])) / 4.0, 0.0, 1.0)
    for _ in range(8):
        carried = carried + near * (mean @ carried - carried)
    for side in SIDES:
        carried[:, names.index("hips")] += carried[:, names.index(f"{side}UpperLeg")]
        carried[:, names.index(f"{side}UpperLeg")] = 0.0
    low = np.clip((4.0 - tights.points[:, 1:2]) / 8.0, 0.0, 1.0)
    hang = np.maximum(low, np.clip(within_collar(tights.points)[:, None] / 4.0 + 1.0, 0.0, 1.0))
    hung = smooth(tights.points, tights.triangles, 30)
    points = tights.points + hang * (hung - tights.points)
    is_fine = (np.abs(points[:, 0]) > 17.0) & (points[:, 1] > 0.0) | (within_collar(points) > -7.0)
    shirt = replace(tights, points=points, carried=carried).finer(is_fine)
    shirt = shirt.cut(within_collar(shirt.points))[0]
    shirt = shirt.cut(along_forearm(bodies, shirt.points) - _CUFF)[0]
    shirt = shirt.cut(_HEM - shirt.points[:, 1])[0]
    flare = np.clip((_HEM + 14.0 - shirt.points[:, 1]) / 14.0, 0.0, 1.0) ** 1.5
    shirt = replace(shirt, points=shirt.points + (0.25 + 0.45 * flare)[:, None] * _level(shirt.normals, flare))
    shirt = replace(shirt, normals=compute_normals(shirt.points, shirt.triangles))
    line, mean = within_collar(shirt.points), mean_of_neighbours(shirt.triangles, len(shirt.points))
    for _ in range(10):
        line = mean @ line
    shirt, collar = shirt.cut(line + _BANDS["collar"])
    shirt, cuffs = shirt.cut(along_forearm(bodies, shirt.points) - _CUFF + _BANDS["cuff"])
    trim = join([thicken(band, 0.14, 0.6, 0.0) for band in (collar, cuffs)])
    lower = tights.cut(tights.points[:, 1] - _HEM - _OVERLAP)[0]
    lower = replace(lower, points=lower.points - 0.45 * np.clip((lower.points[:, 1:2] - _HEM + 6.0) / 6.0, 0.0, 1.0) * lower.normals)
    shoes, trousers = lower.cut(lower.points[:, 1] - _ANKLE)
    trousers = replace(trousers, points=trousers.points + 0.5 * np.clip((-45.0 - trousers.points[:, 1:2]) / 30.0, 0.0, 1.0) * trousers.normals)
    made = {"shirt": thicken(shirt, 0.0, 0.35, 1.0), "trim": trim, "trousers": thicken(trousers, 0.0, 0.3, 0.0)}
    for side, sign in (("left", 1.0), ("right", -1.0)):
        made[f"{side} shoe"] = shoes.rows(shoes.triangles[(sign * shoes.points[shoes.triangles, 0] > 0.0).all(axis=1)])
    return {name: to_bind_pose(bodies, sheet) for name, sheet in made.items()}


def _level(normals: Floats, share: Floats) -> Floats:
    """Returns normals (V, 3) that are level where ``share`` is 1."""
    turned = normals * np.stack([np.ones_like(share), 1.0 - share, np.ones_like(share)], axis=1)
    return np.asarray(turned / np.maximum(np.linalg.norm(turned, axis=1, keepdims=True), 1e-9))


def thicken(sheet: Sheet, lift: float, thickness: float, depth_in: float) -> Sheet:
    """Returns a sheet raised by ``lift``, whose rim turns inward by a ``thickness``, and then back below the sheet by
    ``depth_in``, cm.
    """
    sheet = replace(sheet, points=sheet.points + lift * sheet.normals)
    rim = find_rim(sheet.triangles)
    ends, corners = np.unique(rim, return_inverse=True)
    corners = corners.reshape(-1, 2)
    mean = np.zeros((len(ends), 3))
    inside = sheet.triangles[np.isin(sheet.triangles, ends).any(axis=1)]
    count = np.zeros(len(ends))
    number = np.full(len(sheet.points), -1)
    number[ends] = np.arange(len(ends))
    for k in range(3):
        for other in (1, 2):
            own, at = number[inside[:, k]], inside[:, (k + other) % 3]
            chosen = (own >= 0) & (number[at] < 0)
            np.add.at(mean, own[chosen], sheet.points[at[chosen]])
            np.add.at(count, own[chosen], 1.0)
    outer, normal = sheet.points[ends], sheet.normals[ends]
    inward = np.where(count[:, None] > 0, mean / np.maximum(count, 1.0)[:, None] - outer, 0.0)
    inward -= np.einsum("va,va->v", inward, normal)[:, None] * normal
    inward /= np.maximum(np.linalg.norm(inward, axis=1, keepdims=True), 1e-9)
    bottom = outer - thickness * normal
    back = bottom + depth_in * inward - 0.3 * normal
    n = len(ends)
    points = np.concatenate([outer, bottom, bottom, back])
    normals = np.concatenate([-inward, -inward, -normal, -normal])
    a, b = corners.T
    quads = [(b, a, a + n), (b, a + n, b + n), (b + 2 * n, a + 2 * n, a + 3 * n), (b + 2 * n, a + 3 * n, b + 3 * n)]
    k = 4 if depth_in else 2
    rows, wall_triangles = np.tile(ends, k), np.concatenate([np.stack(q, axis=1) for q in quads[:k]])
    wall = Sheet(points[: k * n], normals[: k * n], wall_triangles, sheet.shares[rows], sheet.carried[rows])
    return join([sheet, wall])


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
