"""The body of an avatar: the capsules of the usual proportions, moved and resized to fit its mesh.

Every capsule keeps its key, its joint and its place along the bone, so that what touches on one body has its
counterpart on the other. What is measured, all in the rest pose with left +X, up +Y, forward +Z:

- limbs, neck and fingers: the middle and the radius of the vertices around the bone, in both halves of it;
- palms: the surfaces on the back and on the palm's side along each line from wrist to knuckle;
- trunk: front and back surface and width at several heights, with a line through each;
- head: chin, top, width, nose, and balls that touch the face in front and the skull behind.

A capsule with too few vertices keeps its usual proportions, scaled as its neighbours are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from signsplice.body.capsules import ARM, HEM, BodyCapsules, BodyShape, build_capsules
from signsplice.body.skin_surface import MIN_POINTS, AvatarSkin, Relief, SkinPoints, quantile, surface, window
from signsplice.motion import FloatArray, Skeleton, rotation
from signsplice.motion.kinematics import rest_positions, subtree
from signsplice.rig.info import rig_info
from signsplice.rig.roles import FINGERS, SIDES

_LEVEL, _NEAR = 0.015, 0.010
"""Distances within which vertices are at a height, and at a place seen from in front, as fractions of stature."""
_HEIGHTS = 7
"""Heights at which a column of the trunk is measured."""
_ACROSS = 0.55
"""Where the depth of an outer column is measured, as a fraction of the trunk's half width."""
_WIDEST, _OUT = 0.98, (0.3, 0.75)
"""Share of vertices that lie within the width of trunk or face; how far out the middle of the trunk's outer columns
lies, in that.
"""
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


_CHIN, _TOP, _WIDTH = -0.0092, 0.134, 0.045
"""Of the usual head about its joint, measured as here: heights of chin and top, half width of the face; fractions of
stature.
"""
_BALLS = {"face": 0, "chin": 1, "nose": 2, "skull": 3}
"""Rows of the capsules that are placed by rules of their own."""
_CELL = 0.006
"""Cell of the maps of front and back, as a fraction of stature."""
_LEAST = 10
"""How many times the fewest vertices a head needs."""
_FRONT, _JAW = 0.4, (0.6, 0.4)
"""How far in front the face begins, in depths of the nose; the jaw, likewise, and how wide it is, in those of the face.
"""
_TALL = (0.8, 1.3)
"""Least and largest height of a head in its width, both in those of the usual one."""
_PROFILE = (("chin", 0, 0.012), ("chin", 1, 0.012), ("face", 0, 0.012), ("face", 1, 0.02))
"""Balls that touch the face: capsule, which end, and how far above vertices count, as a fraction of stature."""
_BELOW, _BESIDE, _OPEN = 0.25, 0.6, 0.25
"""Vertices below a ball count as far as this part of those above; beside it, in half widths of the face; and how far
the back of a skull may lie in front of its usual place, in its radii.
"""
_NOSE = (0.15, 0.2, 0.6, 0.5)
"""Where the nose is: half width, in those of the face; from and to which height between chin and top; and how near
vertices are to its bridge, in its length.
"""
_N_BALLS, _GRAZING = 5, 0.3
"""Balls along a capsule, and the share of their squared radius that a vertex must see in front of it."""


def fit_head(starts: FloatArray, ends: FloatArray, radii: FloatArray, points: FloatArray, height: float) -> bool:
    """Fit the head's capsules in place: ``starts`` and ``ends`` (8, 3) and ``radii`` (8, 2) of the usual proportions,
    to vertices (N, 3) of the head, all about its joint. False where there are too few vertices.
    """
    if len(points) < _LEAST * MIN_POINTS:
        return False
    front, back = (_map(points, sign, _CELL * height) for sign in (1.0, -1.0))
    nose = float(front[:, 2].max())
    face = front[front[:, 2] > _FRONT * nose]
    wide = quantile(np.abs(face[:, 0]), _WIDEST) if len(face) else 0.0
    jaw = face[(face[:, 2] > _JAW[0] * nose) & (np.abs(face[:, 0]) < _JAW[1] * wide)]
    if len(jaw) < MIN_POINTS:
        return False
    chin, top = float(jaw[:, 1].min()), float(points[:, 1].max())
    x_scale = wide / (_WIDTH * height)
    y_scale = (top - chin) / ((_TOP - _CHIN) * height)
    y_scale = float(np.clip(y_scale, _TALL[0] * x_scale, _TALL[1] * x_scale))
    top = chin + y_scale * (_TOP - _CHIN) * height
    radii *= x_scale
    for part in (starts, ends):
        part[:, 0] *= x_scale
        part[:, 1] = chin + y_scale * (part[:, 1] - _CHIN * height)
        part[:, 2] *= x_scale
    starts[_BALLS["skull"], 1] = top - radii[_BALLS["skull"], 0]
    upper, lower, skull = (_BALLS[name] for name in ("face", "chin", "skull"))
    balls = [(part[row].copy(), float(radii[row, k])) for row in (upper, lower) for part, k in ((starts, 0), (ends, 1))]
    template = _between(balls[:2]) + _between(balls[2:])
    for name, end, half in _PROFILE:
        part, row = (starts, ends)[end], _BALLS[name]
        above = front[:, 1] - part[row, 1]  # less is wanted from below, where the surface of a chin recedes
        near = (above > -_BELOW * half * y_scale * height) & (above < half * y_scale * height)
        near &= np.abs(front[:, 0]) < _BESIDE * wide
        part[row, 2] += _offset(front[near], template, 1.0) or 0.0
    usual_middle, middle = (
        0.5 * (a + b) for a, b in ((balls[0][0][2], balls[1][0][2]), (starts[upper, 2], ends[upper, 2]))
    )
    balls = [(part[skull].copy(), float(radii[skull, k])) for k, part in enumerate((starts, ends))]
    found = _offset(back[np.abs(back[:, 0]) < _BESIDE * wide], _between(balls), -1.0)
    # A head that is open behind, under hair that does not count, has only the inside of its face there.
    is_open = found is None or found > middle - usual_middle + _OPEN * radii[skull, 0]
    for part in (starts, ends):
        part[skull, 2] += middle - usual_middle if is_open or found is None else found
    _place_nose(starts, ends, radii, front, (chin, top, wide))
    for row in range(_BALLS["skull"] + 1, len(starts)):  # eyes and mouth, drawn on the face
        for k, part in enumerate((starts, ends)):
            part[row, 2] = _surface(front, part[row], _CELL * height, part[row, 2] + radii[row, k]) - radii[row, k]
    return True


def _place_nose(
    starts: FloatArray, ends: FloatArray, radii: FloatArray, front: FloatArray, sizes: tuple[float, float, float]
) -> None:
    """Put the nose's capsule below the foremost point of the middle of the face."""
    chin, top, wide = sizes
    height_fraction = (front[:, 1] - chin) / (top - chin)
    beside, low, high, near = _NOSE
    middle = front[(np.abs(front[:, 0]) < beside * wide) & (height_fraction > low) & (height_fraction < high)]
    row = _BALLS["nose"]
    if not len(middle):
        return
    tip = middle[int(np.argmax(middle[:, 2]))]
    rise = starts[row, 1] - ends[row, 1]
    ends[row] = 0.0, tip[1], tip[2] - radii[row, 1]
    bridge = middle[np.abs(middle[:, 1] - tip[1] - rise) < near * rise]
    starts[row] = 0.0, tip[1] + rise, (float(bridge[:, 2].max()) if len(bridge) else tip[2]) - radii[row, 0]


def _map(points: FloatArray, sign: float, cell: float) -> FloatArray:
    """Of the points (N, 3) in each square cell of the plane of x and y, the one that lies farthest in front, or behind
    with ``sign`` -1.
    """
    order = np.argsort(-sign * points[:, 2], kind="stable")
    _, first = np.unique(np.floor(points[order, :2] / cell).astype(np.int64), axis=0, return_index=True)
    return points[order[first]]


def _between(balls: list[tuple[FloatArray, float]]) -> list[tuple[FloatArray, float]]:
    """Middles and radii of balls from the first to the last of two."""
    (a, r), (b, q) = balls
    return [(a + t * (b - a), r + t * (q - r)) for t in np.linspace(0.0, 1.0, _N_BALLS)]


def _offset(surface: FloatArray, balls: list[tuple[FloatArray, float]], sign: float) -> float | None:
    """The median distance in z by which a surface (N, 3) lies beyond the outermost of some balls, seen from in front,
    or from behind with ``sign`` -1; None where they do not overlap.
    """
    outer = np.full(len(surface), -np.inf)
    for middle, radius in balls:
        squared = radius**2 - ((surface[:, :2] - middle[:2]) ** 2).sum(axis=1)
        near = squared > _GRAZING * radius**2
        outer[near] = np.maximum(outer[near], sign * middle[2] + np.sqrt(squared[near]))
    met = np.isfinite(outer)
    if met.sum() < MIN_POINTS:
        return None
    return sign * quantile(sign * surface[met, 2] - outer[met], 0.5)


def _surface(front: FloatArray, at: FloatArray, cell: float, otherwise: float) -> float:
    """The z of the front at a place; ``otherwise`` where no vertex is near."""
    near = front[np.abs(front[:, :2] - at[:2]).max(axis=1) < 1.5 * cell]
    return float(near[:, 2].max()) if len(near) else otherwise


_TRUNK = ("hips", "spine", "chest", "upperChest", "leftShoulder", "rightShoulder")
_HEAD = ("head", "jaw", "leftEye", "rightEye")
BODY = (*_TRUNK, *_HEAD, "neck")
"""Roles of the joints whose skin hands are put on."""
_LIMBS = {"arms": ARM, "legs": ("leg",), "neck": ("neck",)}
_BINS = 6
"""Slices of a bone in which limbs are measured."""
_STEP = 0.004
"""Distance of the points of the surface, as a fraction of stature."""
_BELOW_HEM = 0.01
"""How far below the hem skin of the legs counts as the trunk's, as a fraction of stature."""
_SPAN = 0.4
"""Part of a limb that has to be measured for its taper."""
_TAPERS = (0.7, 1.2)
"""A limb's radii at its ends lie between the least and the largest that were measured, times these."""
_ALONG, _SHORTEST = (-0.1, 1.1), 0.3
"""Where along a phalanx vertices count, and how long the last is at least, both in its usual length."""
_SLICES = ((0.2, 0.6), 0.45, 0.6)
"""Of a palm's capsule: where on the way to the knuckle its two slices begin, how long they are, and how wide on either
side, in distances of neighbouring knuckles.
"""
_WIDE, _THICK = 1.7, 3.0
"""A limb that is thicker than this many times the usual is a sleeve or a skirt, and so is what is farther than that
many radii of a palm from its middle.
"""
_BETWEEN = (0.05, 0.95)
"""Shares of vertices that lie below the one and the other surface of a palm or finger."""


def fit_skin(skeleton: Skeleton, points: SkinPoints) -> tuple[BodyCapsules, tuple[str, ...]]:
    """The capsules of a skeleton whose arms are known, fitted to the vertices of its skin, and the parts that had too
    few vertices and keep the usual proportions.
    """
    fitting = _Fitting(skeleton, points)
    fitting.hands()
    fitting.limbs()
    fitting.trunk()
    fitting.head()
    return replace(fitting.body(), skin=_skin(skeleton, points)), tuple(
        sorted(fitting.missed, key=lambda what: what not in _LIMBS)
    )


def _skin(skeleton: Skeleton, points: SkinPoints) -> AvatarSkin | None:
    """The skin of hands, head, neck and trunk; None where one of these has none."""
    info, rest = rig_info(skeleton), rest_positions(skeleton)
    roles, spacing = info.roles.joints, _STEP * info.sizes.stature
    body = surface(points, [roles[role] for role in BODY if role in roles], rest, spacing)
    hands = [
        surface(points, subtree(skeleton, roles[f"{side}Hand"]), rest, spacing, bare=True)
        for side in SIDES
        if f"{side}Hand" in roles
    ]
    left, right = (*hands, None, None)[:2]
    return None if body is None or left is None or right is None else AvatarSkin(body, (left, right), points)


class _Fitting:
    """The capsules while they are fitted. World: the rest pose, root at the origin, left +X, up +Y, forward +Z."""

    def __init__(self, skeleton: Skeleton, points: SkinPoints) -> None:
        info = rig_info(skeleton)
        self.usual, self.height = build_capsules(skeleton, BodyShape()), info.sizes.stature
        self.roles = info.roles.joints
        upright = info.t_pose.rotations[self.roles.get("hips", 0)]
        self._turn = rotation.to_matrix(upright)
        self.rest = rest_positions(skeleton) @ self._turn.T
        self.points = replace(points, positions=points.positions @ self._turn.T)
        self.hand_up = {
            side: self._turn @ rotation.rotate(rotation.inverse(info.t_pose.rotations[self.roles[f"{side}Hand"]]), up)
            for side in SIDES
            for up in [np.array([0.0, 1.0, 0.0])]
            if f"{side}Hand" in self.roles
        }
        at = self.rest[self.usual.joints]
        self.starts, self.ends = at + self.usual.starts @ self._turn.T, at + self.usual.ends @ self._turn.T
        self.radii = self.usual.radii.copy()
        self.row = {key: n for n, key in enumerate(self.usual.keys)}
        self.missed: list[str] = []

    def body(self) -> BodyCapsules:
        """The capsules as they are now."""
        at = self.rest[self.usual.joints]
        starts, ends, origins = (self.starts - at) @ self._turn, (self.ends - at) @ self._turn, at @ self._turn
        body = replace(self.usual, starts=starts, ends=ends, radii=self.radii)
        joints = [self.roles[role] for role in BODY if role in self.roles]
        points, normals = self.points.surface(joints, _STEP * self.height)
        cells = np.floor(points / (_STEP * self.height)).astype(np.int64)
        one_each = np.unique(cells, axis=0, return_index=True)[1]
        points, normals = points[one_each], normals[one_each]
        if not len(points):
            return body
        rows = np.sort(np.array([*body.groups.head, *body.groups.trunk], np.intp))
        at, turn = origins[rows], self._turn
        relief = Relief(
            points @ turn, normals @ turn, rows, at + starts[rows], at + ends[rows], self.radii[rows], origins
        )
        return replace(body, relief=relief)

    # --- limbs, neck, fingers ---

    def limbs(self) -> None:
        """Arms, legs and neck; those with too few vertices get the median factor of the others."""
        for what, parts in _LIMBS.items():
            rows = [n for n, part in enumerate(self.usual.parts) if part in parts]
            self._scale_others(what, rows, [n for n in rows if self._sleeve(n, halves=True)])
        for side in SIDES:
            shoulder, arm = self.row.get(f"{side}Shoulder"), self.row.get(f"{side}UpperArm")
            if shoulder is not None and arm is not None:
                self.radii[shoulder] *= self.radii[arm, 0] / self.usual.radii[arm, 0]

    def hands(self) -> None:
        """Palms and phalanges; those with too few vertices get the median factor of the others."""
        for side in SIDES:
            rows = [n for n, s in enumerate(self.usual.sides) if s == side]
            palms = [n for n in rows if self.usual.parts[n] == "palm"]
            fingers = [n for n in rows if n not in palms and self.usual.keys[n].startswith(side + self._finger(n))]
            fitted = [n for n in palms if "Thumb" not in self.usual.keys[n] and self._palm(n, side)]
            self._scale_others(f"{side} palm", palms, fitted)
            fitted = [n for n in fingers if self._sleeve(n, halves=False)]
            self._scale_others(f"{side} fingers", fingers, fitted)

    def _finger(self, row: int) -> str:
        part = self.usual.parts[row].removesuffix("Tip")
        return part if part in FINGERS else "-"

    def _sleeve(self, row: int, halves: bool) -> bool:
        """Fit one capsule to the vertices around its bone; False where there are too few."""
        start, end = self.starts[row].copy(), self.ends[row].copy()
        near = self.points.of(int(self.usual.joints[row]))
        axis = end - start
        length = float(np.linalg.norm(axis))
        if len(near) < MIN_POINTS or not length > 0.0:
            return False
        axis /= length
        side = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
        side /= np.linalg.norm(side)
        frame = np.stack([side, np.cross(axis, side)])  # (2, 3) at right angles to the bone
        along, across = (near - start) @ axis / length, (near - start) @ frame.T
        if not halves:
            return self._finger_sleeve(row, start, axis, along, across, frame)
        seen, away = [], np.linalg.norm(across, axis=1)
        for t in (np.arange(_BINS) + 0.5) / _BINS:
            inside, widest = np.abs(along - t) < 0.5 / _BINS, self._widest(row, t)
            ring = _ring(across[inside], is_centred=self.usual.parts[row] in ARM)
            if ring is not None and ring[1] > widest:  # a wide sleeve, or a skirt: what is within may be skin
                ring = _ring(across[inside & (away < widest)], is_centred=self.usual.parts[row] in ARM)
            if ring is not None:
                seen.append((t, *ring[0], ring[1]))
        if not seen:
            return False
        table, usual = np.array(seen), self.usual.radii[row]
        if np.ptp(table[:, 0]) < _SPAN:  # bare at one end alone: as the usual limb tapers
            self.radii[row] = usual * quantile(table[:, 3] / (usual[0] + table[:, 0] * (usual[1] - usual[0])), 0.5)
            return True
        low, high = _TAPERS[0] * table[:, 3].min(), _TAPERS[1] * table[:, 3].max()
        for ends, t, k in ((self.starts, 0.0, 0), (self.ends, 1.0, 1)):
            x, y, radius = (line(table[:, 0], table[:, column], t) for column in (1, 2, 3))
            ends[row] += np.array([x, y]) @ frame
            self.radii[row, k] = np.clip(radius, low, high)
        return True

    def _widest(self, row: int, t: float) -> float:
        """The radius at part t of a limb, from which on its vertices are cloth; stout bodies have stout palms."""
        palms = [n for n, part in enumerate(self.usual.parts) if part == "palm"]
        stout = quantile(self.radii[palms].mean(axis=1) / self.usual.radii[palms].mean(axis=1), 0.5) if palms else 1.0
        start, end = self.usual.radii[row].tolist()
        return float(_WIDE * max(1.0, stout) * (start + t * (end - start)))

    def _finger_sleeve(
        self, row: int, start: FloatArray, axis: FloatArray, along: FloatArray, across: FloatArray, frame: FloatArray
    ) -> bool:
        """One middle and one radius for a phalanx; the last one ends where its vertices do."""
        is_last = self.usual.parts[row].endswith("Tip")
        inside = (along > _ALONG[0]) & ((along < _ALONG[1]) | is_last)
        found = _ring(across[inside])
        if found is None:
            return False
        middle, radius = found
        usual = self.usual.radii[row]
        self.radii[row] = radius * usual / usual.mean()
        length = float(np.linalg.norm(self.ends[row] - start))
        if is_last:
            length = max(float(along.max()) * length - self.radii[row, 1], _SHORTEST * length)
        self.starts[row] = start + middle @ frame
        self.ends[row] = start + length * axis + middle @ frame
        return True

    def _palm(self, row: int, side: str) -> bool:
        """Fit one capsule from wrist to knuckle between the surfaces of the palm; False with too few vertices."""
        knuckles = [self.roles.get(f"{side}{finger}Proximal") for finger in ("Index", "Little")]
        if None in knuckles:
            return False
        spacing = float(np.linalg.norm(self.rest[knuckles[0]] - self.rest[knuckles[1]])) / 3.0
        start, end, up = self.starts[row].copy(), self.ends[row].copy(), self.hand_up[side]
        axis = end - start
        length = float(np.linalg.norm(axis))
        if not length > 0.0:
            return False
        axis /= length
        up = up - (up @ axis) * axis
        up /= np.linalg.norm(up)
        since = self.points.of(self.roles[f"{side}Hand"]) - start
        along, height, beside = since @ axis / length, since @ up, np.abs(since @ np.cross(axis, up))
        (lows, long, wide), found, thick = _SLICES, [], _THICK * self.usual.radii[row].max()
        for low in lows:
            inside = height[
                (beside < wide * spacing) & (along >= low) & (along < low + long) & (np.abs(height) < thick)
            ]
            if len(inside) < MIN_POINTS:
                return False
            found.append((quantile(inside, _BETWEEN[0]), quantile(inside, _BETWEEN[1])))
        (b0, t0), (b1, t1) = found
        self.radii[row] = 0.5 * (t0 - b0), 0.5 * (t1 - b1)
        self.starts[row] = start + 0.5 * (t0 + b0) * up
        self.ends[row] = end + 0.5 * (t1 + b1) * up
        return True

    def _scale_others(self, what: str, rows: Sequence[int], fitted: Sequence[int]) -> None:
        """Give the rows that were not fitted the median factor of those that were."""
        others = [n for n in rows if n not in fitted]
        if rows and not fitted:
            self.missed.append(what)
        elif others:
            factors = self.radii[list(fitted)].mean(axis=1) / self.usual.radii[list(fitted)].mean(axis=1)
            self.radii[others] *= quantile(factors, 0.5)

    # --- trunk ---

    def trunk(self) -> None:
        """Chest and belly as three columns each, hips, back and collar."""
        low = self.rest[self.roles.get("hips", 0)][1] - (HEM + _BELOW_HEM) * self.height
        legs = [self.roles[role] for role in ("leftUpperLeg", "rightUpperLeg") if role in self.roles]
        trunk = [self.roles[role] for role in _TRUNK if role in self.roles]
        points = np.concatenate([self._surface(trunk), (p := self._surface(legs))[p[:, 1] > low]])
        if len(points) < MIN_POINTS:
            self.missed.append("trunk")
            return
        skin = TrunkSkin(points, self.height, self.starts, self.ends, self.radii)
        middle = 0.5 * (self.rest[self.roles["leftUpperArm"]][0] + self.rest[self.roles["rightUpperArm"]][0])
        for name in ("chest", "belly"):
            rows = [self.row[f"{name}{n}"] for n in range(3) if f"{name}{n}" in self.row]
            if rows and not all(skin.column(name, row, n, middle) for n, row in enumerate(rows)):
                self.missed.append(name)
        factor = 1.0
        if "chest1" in self.row:
            chest = self.row["chest1"]
            factor = float(self.radii[chest].mean() / self.usual.radii[chest].mean())
        for key in ("back", "collar0", "collar1"):
            if key in self.row:
                skin.behind(self.row[key], factor)
        if "hips" in self.row:
            skin.between(self.row["hips"])

    def _surface(self, joints: Sequence[int]) -> FloatArray:
        """Points (N, 3) on the surface that these joints carry."""
        return self.points.surface(joints, _STEP * self.height)[0]

    def head(self) -> None:
        """The head's capsules, about its joint."""
        rows = [n for n, key in enumerate(self.usual.keys) if key.startswith("head")]
        if not rows:
            return
        joint = self.rest[self.roles["head"]]
        points = self._surface([self.roles[role] for role in _HEAD if role in self.roles]) - joint
        starts, ends, radii = self.starts[rows] - joint, self.ends[rows] - joint, self.radii[rows]
        if fit_head(starts, ends, radii, points, self.height):
            self.starts[rows], self.ends[rows], self.radii[rows] = starts + joint, ends + joint, radii
        else:
            self.missed.append("head")


def _ring(across: FloatArray, is_centred: bool = False) -> tuple[FloatArray, float] | None:
    """Middle (2,) and radius of the vertices (N, 2) around a bone; None where they are too few, or not all around. The
    middle is the bone itself where that is wanted (``is_centred``).
    """
    if len(across) < MIN_POINTS or len({(x > 0.0, y > 0.0) for x, y in across.tolist()}) < 4:
        return None
    if is_centred:
        return np.zeros(2), quantile(np.linalg.norm(across, axis=1), 0.5)
    middle = np.array([0.5 * sum(quantile(across[:, k], share) for share in _BETWEEN) for k in (0, 1)])
    return middle, quantile(np.linalg.norm(across - middle, axis=1), 0.5)
