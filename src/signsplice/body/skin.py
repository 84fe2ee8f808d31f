"""The body of an avatar: the capsules of the usual proportions, moved and resized to fit its mesh.

Every capsule keeps its key, its joint and its place along the bone, so that a contact on one body has its counterpart
on the other. The fit measures, in the rest pose with left +X, up +Y, forward +Z:

- limbs, neck and fingers: the middle and the radius of the vertices around the bone, in both halves of it;
- palms: the surfaces on the back and on the palm's side along each line from wrist to knuckle;
- trunk: front and back surface and width at several heights, with a line through each;
- head: chin, top, width, nose, and balls that touch the face in front and the skull behind.

A capsule with too few vertices keeps its usual proportions, scaled as its neighbours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from signsplice.body.capsules import ARM, TRUNK_SIZES, BodyCapsules, BodyShape, build_capsules
from signsplice.body.contacts import REGIONS
from signsplice.body.skin_surface import (
    HEAD,
    MIN_POINTS,
    TRUNK,
    AvatarSkin,
    SkinPoints,
    quantile,
    surface,
    window,
    without_doubtful,
)
from signsplice.motion import FloatArray, Skeleton, rotation
from signsplice.motion.kinematics import rest_positions, subtree
from signsplice.rig.info import rig_info
from signsplice.rig.roles import FINGERS, SIDES


@dataclass(frozen=True)
class BodyMeasures:
    """Places and limits of measurements of trunk, limbs and hands."""

    point_spacing: float = 0.004
    """Distance between points of the surface, as a fraction of stature."""
    level_distance: float = 0.015
    """Largest vertical distance of vertices at a height, as a fraction of stature."""
    window_half_width: float = 0.010
    """Half width of the window around a place seen from in front, as a fraction of stature."""
    column_heights: int = 7
    """Number of heights at which a column of the trunk is measured."""
    least_heights: int = 3
    """Least number of heights with skin that determine a column."""
    depth_offset: float = 0.55
    """Distance from the middle at which an outer column's depth is measured, in half widths of the trunk."""
    width_share: float = 0.98
    """Share of vertices that lie within the width of trunk or face."""
    least_column_offset: float = 0.3
    """Least distance of an outer column from the middle of the trunk, as a fraction of its half width."""
    largest_column_offset: float = 0.75
    """Largest distance of an outer column from the middle of the trunk, as a fraction of its half width."""
    lower_chest: float = 0.55
    """Part of the way down the chest from which on heights count less."""
    lower_chest_weight: float = 0.25
    """Weight of the heights of the lower chest."""
    hem_margin: float = 0.01
    """Distance below the hem up to which skin of the legs counts as the trunk's, as a fraction of stature."""
    limb_slices: int = 6
    """Number of slices along a bone in which a limb is measured."""
    taper_span: float = 0.4
    """Least part of a limb with measurements that determines its taper."""
    thin_end: float = 0.7
    """Least radius of a limb at its ends, in its least measured radius."""
    thick_end: float = 1.2
    """Largest radius of a limb at its ends, in its largest measured radius."""
    sleeve_radius: float = 1.7
    """Radius above which a limb is a sleeve or a skirt, in usual radii."""
    phalanx_range: tuple[float, float] = (-0.1, 1.1)
    """Range along a phalanx in which vertices count, in its usual length."""
    shortest_tip: float = 0.3
    """Least length of a last phalanx, in its usual length."""
    palm_slice_starts: tuple[float, float] = (0.2, 0.6)
    """Parts of the way to the knuckle at which both slices of a palm's capsule begin."""
    palm_slice_length: float = 0.45
    """Length of such a slice, as a part of the way to the knuckle."""
    palm_slice_half_width: float = 0.6
    """Half width of such a slice, in distances of neighbouring knuckles."""
    cloth_distance: float = 3.0
    """Distance from the middle of a palm above which vertices are cloth, in usual radii."""
    surface_shares: tuple[float, float] = (0.05, 0.95)
    """Shares of vertices below the lower and the upper surface of a palm or finger."""


_MEASURES = BodyMeasures()


@dataclass(frozen=True)
class HeadMeasures:
    """Sizes of the usual head, and places and limits of measurements of heads."""

    chin_height: float = -0.0092
    """Height of the usual head's chin above its joint, measured as here, as a fraction of stature."""
    top_height: float = 0.134
    """Height of the usual head's top above its joint, as a fraction of stature."""
    face_half_width: float = 0.045
    """Half width of the usual face, as a fraction of stature."""
    map_cell: float = 0.006
    """Cell size of the maps of front and back, as a fraction of stature."""
    vertex_multiple: int = 10
    """Least number of a head's vertices, in multiples of ``MIN_POINTS``."""
    face_depth: float = 0.4
    """Depth from which on vertices belong to the face, in depths of the nose."""
    jaw_depth: float = 0.6
    """Depth from which on vertices belong to the jaw, in depths of the nose."""
    jaw_half_width: float = 0.4
    """Half width of the jaw, in that of the face."""
    least_tallness: float = 0.8
    """Least ratio of a head's height to its width, relative to the usual head."""
    largest_tallness: float = 1.3
    """Largest ratio of a head's height to its width, relative to the usual head."""
    distance_below: float = 0.25
    """Distance below a ball up to which vertices count, as a part of that above (``_PROFILE``)."""
    distance_beside: float = 0.6
    """Distance beside a ball up to which vertices count, in half widths of the face."""
    open_distance: float = 0.25
    """Largest distance of the back of a skull in front of its usual place, in its radii; heads beyond it are open."""
    nose_half_width: float = 0.15
    """Half width of the nose, in half widths of the face."""
    lowest_nose: float = 0.2
    """Least height of the nose, as a part of the way from chin to top."""
    highest_nose: float = 0.6
    """Largest height of the nose, as a part of the way from chin to top."""
    bridge_distance: float = 0.5
    """Largest vertical distance of vertices from the bridge of the nose, in the length of the nose."""
    capsule_balls: int = 5
    """Number of balls along a capsule."""
    rim_share: float = 0.3
    """Least squared half thickness of a ball where it meets a vertex, as a share of its squared radius: a ball's rim
    does not count.
    """


_HEAD_MEASURES = HeadMeasures()


@dataclass(frozen=True, eq=False)
class TrunkSkin:
    """The skin of a trunk and the capsules, which the methods fit in place. World: left +X, up +Y, forward +Z.

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
        """Returns back and front (z) of the skin at a place seen from in front; None if there is none."""
        close = window(self.points, (x, y), _MEASURES.window_half_width * self.height)
        return None if close is None else (float(close[:, 2].min()), float(close[:, 2].max()))

    def column(self, name: str, row: int, n: int, middle: float) -> bool:
        """Fit one of three columns (0 on the left, 1 in the middle) with lines through front, back and side of the
        trunk, whose middle is at x = ``middle``; returns False if too few heights have skin.
        """
        start, end, seen = self.starts[row], self.ends[row], []
        side = (1.0, 0.0, -1.0)[n]
        for t in np.linspace(0.0, 1.0, _MEASURES.column_heights):
            y = start[1] + t * (end[1] - start[1])
            level = self.points[np.abs(self.points[:, 1] - y) < _MEASURES.level_distance * self.height]
            if len(level) < MIN_POINTS:
                continue
            wide = quantile(np.abs(level[:, 0] - middle), _MEASURES.width_share)
            depth = self.depth(middle + side * _MEASURES.depth_offset * wide, y)
            if depth is None:
                continue
            back, front = depth
            least, largest = _MEASURES.least_column_offset * wide, _MEASURES.largest_column_offset * wide
            offset = float(np.clip(wide - 0.5 * (front - back), least, largest))
            seen.append((t, middle + side * offset, back, front))
        if len(seen) < _MEASURES.least_heights:
            return False
        table = np.array(seen)
        for ends, t, k in ((self.starts, 0.0, 0), (self.ends, 1.0, 1)):
            is_upper = table[:, 0] < _MEASURES.lower_chest
            weight = np.where(is_upper, 1.0, _MEASURES.lower_chest_weight) if name == "chest" else None
            x, back, front = (line(table[:, 0], table[:, column], t, weight) for column in (1, 2, 3))
            ends[row][0], ends[row][2] = x, 0.5 * (back + front)
            self.radii[row, k] = 0.5 * (front - back)
        return True

    def behind(self, row: int, factor: float) -> None:
        """Fit a capsule under the skin of the back, as thick as the chest relative to the usual."""
        self.radii[row] *= factor
        for ends, k in ((self.starts, 0), (self.ends, 1)):
            depth = self.depth(ends[row][0], ends[row][1])
            if depth is not None:
                ends[row][2] = max(depth[0] + self.radii[row, k], min(ends[row][2], depth[1] - self.radii[row, k]))

    def between(self, row: int) -> None:
        """Fit both ends of a capsule between back and front."""
        for ends, k in ((self.starts, 0), (self.ends, 1)):
            depth = self.depth(ends[row][0], ends[row][1])
            if depth is not None:
                ends[row][2], self.radii[row, k] = 0.5 * (depth[0] + depth[1]), 0.5 * (depth[1] - depth[0])


def line(t: FloatArray, values: FloatArray, at: float, weight: FloatArray | None = None) -> float:
    """Returns the least-squares line through ``values`` (N,) at ``t`` (N,), with weights (N,), at one place."""
    w = np.full(len(t), 1.0 / len(t)) if weight is None else weight / weight.sum()
    middle, mean = float(w @ t), float(w @ values)
    spread = float(w @ (t - middle) ** 2)
    slope = float(w @ ((t - middle) * (values - mean))) / spread if spread > 0.0 else 0.0
    return mean + slope * (at - middle)


_BALLS = {"face": 0, "chin": 1, "nose": 2, "skull": 3}
"""Rows of the capsules with their own rules of placement."""
_PROFILE = (("chin", 0, 0.012), ("chin", 1, 0.012), ("face", 0, 0.012), ("face", 1, 0.02))
"""Balls that touch the face: capsule, end, and distance above up to which vertices count, statures."""


def fit_head(starts: FloatArray, ends: FloatArray, radii: FloatArray, points: FloatArray, height: float) -> bool:
    """Fit the head's capsules in place: ``starts`` and ``ends`` (8, 3) and ``radii`` (8, 2) of the usual proportions,
    to vertices (N, 3) of the head, all about its joint. Returns False if there are too few vertices.
    """
    measures = _HEAD_MEASURES
    if len(points) < measures.vertex_multiple * MIN_POINTS:
        return False
    cell = measures.map_cell * height
    front, back = (_map(points, sign, cell) for sign in (1.0, -1.0))
    nose = float(front[:, 2].max())
    face = front[front[:, 2] > measures.face_depth * nose]
    wide = quantile(np.abs(face[:, 0]), _MEASURES.width_share) if len(face) else 0.0
    jaw = face[(face[:, 2] > measures.jaw_depth * nose) & (np.abs(face[:, 0]) < measures.jaw_half_width * wide)]
    if len(jaw) < MIN_POINTS:
        return False
    chin, top = float(jaw[:, 1].min()), float(points[:, 1].max())
    x_scale = wide / (measures.face_half_width * height)
    y_scale = (top - chin) / ((measures.top_height - measures.chin_height) * height)
    y_scale = float(np.clip(y_scale, measures.least_tallness * x_scale, measures.largest_tallness * x_scale))
    top = chin + y_scale * (measures.top_height - measures.chin_height) * height
    radii *= x_scale
    for part in (starts, ends):
        part[:, 0] *= x_scale
        part[:, 1] = chin + y_scale * (part[:, 1] - measures.chin_height * height)
        part[:, 2] *= x_scale
    starts[_BALLS["skull"], 1] = top - radii[_BALLS["skull"], 0]
    upper, lower, skull = (_BALLS[name] for name in ("face", "chin", "skull"))
    balls = [(part[row].copy(), float(radii[row, k])) for row in (upper, lower) for part, k in ((starts, 0), (ends, 1))]
    template = _between(balls[:2]) + _between(balls[2:])
    for name, end, half in _PROFILE:
        part, row = (starts, ends)[end], _BALLS[name]
        above = front[:, 1] - part[row, 1]  # less from below, where a chin recedes
        counts = (above > -measures.distance_below * half * y_scale * height) & (above < half * y_scale * height)
        counts &= np.abs(front[:, 0]) < measures.distance_beside * wide
        part[row, 2] += _offset(front[counts], template, 1.0) or 0.0
    usual_middle, middle = (
        0.5 * (a + b) for a, b in ((balls[0][0][2], balls[1][0][2]), (starts[upper, 2], ends[upper, 2]))
    )
    balls = [(part[skull].copy(), float(radii[skull, k])) for k, part in enumerate((starts, ends))]
    skull_offset = _offset(back[np.abs(back[:, 0]) < measures.distance_beside * wide], _between(balls), -1.0)
    # A head that is open behind, under hair that does not count, shows only the inside of its face there.
    is_open = skull_offset is None or skull_offset > middle - usual_middle + measures.open_distance * radii[skull, 0]
    for part in (starts, ends):
        part[skull, 2] += middle - usual_middle if is_open or skull_offset is None else skull_offset
    _place_nose(starts, ends, radii, front, (chin, top, wide))
    for row in range(_BALLS["skull"] + 1, len(starts)):  # eyes and mouth, drawn on the face
        for k, part in enumerate((starts, ends)):
            part[row, 2] = _surface(front, part[row], cell, part[row, 2] + radii[row, k]) - radii[row, k]
    return True


def _place_nose(
    starts: FloatArray, ends: FloatArray, radii: FloatArray, front: FloatArray, sizes: tuple[float, float, float]
) -> None:
    """Put the nose's capsule below the foremost point of the middle of the face."""
    chin, top, wide = sizes
    height_fraction = (front[:, 1] - chin) / (top - chin)
    is_high = (height_fraction > _HEAD_MEASURES.lowest_nose) & (height_fraction < _HEAD_MEASURES.highest_nose)
    middle = front[(np.abs(front[:, 0]) < _HEAD_MEASURES.nose_half_width * wide) & is_high]
    row = _BALLS["nose"]
    if not len(middle):
        return
    tip = middle[int(np.argmax(middle[:, 2]))]
    rise = starts[row, 1] - ends[row, 1]
    ends[row] = 0.0, tip[1], tip[2] - radii[row, 1]
    bridge = middle[np.abs(middle[:, 1] - tip[1] - rise) < _HEAD_MEASURES.bridge_distance * rise]
    starts[row] = 0.0, tip[1] + rise, (float(bridge[:, 2].max()) if len(bridge) else tip[2]) - radii[row, 0]


def _map(points: FloatArray, sign: float, cell: float) -> FloatArray:
    """Returns the point (of N, 3) farthest in front, or behind with ``sign`` -1, in each square cell of the plane of x
    and y.
    """
    order = np.argsort(-sign * points[:, 2], kind="stable")
    _, first = np.unique(np.floor(points[order, :2] / cell).astype(np.int64), axis=0, return_index=True)
    return points[order[first]]


def _between(balls: list[tuple[FloatArray, float]]) -> list[tuple[FloatArray, float]]:
    """Returns middles and radii of balls from the first to the last of two."""
    (a, r), (b, q) = balls
    return [(a + t * (b - a), r + t * (q - r)) for t in np.linspace(0.0, 1.0, _HEAD_MEASURES.capsule_balls)]


def _offset(surface: FloatArray, balls: list[tuple[FloatArray, float]], sign: float) -> float | None:
    """Returns the median distance in z of a surface (N, 3) beyond the outermost of some balls, seen from in front, or
    from behind with ``sign`` -1; None if they do not overlap.
    """
    outer = np.full(len(surface), -np.inf)
    for middle, radius in balls:
        squared = radius**2 - ((surface[:, :2] - middle[:2]) ** 2).sum(axis=1)
        hit = squared > _HEAD_MEASURES.rim_share * radius**2
        outer[hit] = np.maximum(outer[hit], sign * middle[2] + np.sqrt(squared[hit]))
    met = np.isfinite(outer)
    if met.sum() < MIN_POINTS:
        return None
    return sign * quantile(sign * surface[met, 2] - outer[met], 0.5)


def _surface(front: FloatArray, at: FloatArray, cell: float, otherwise: float) -> float:
    """Returns the z of the front at a place; ``otherwise`` if no vertex is close."""
    close = front[np.abs(front[:, :2] - at[:2]).max(axis=1) < 1.5 * cell]
    return float(close[:, 2].max()) if len(close) else otherwise


BODY = (*TRUNK, *HEAD, "neck")
"""Roles of the joints whose skin hands touch."""
_REGION_PARTS = {"head": ("head",), "neck": ("neck",), "trunk": ("chest", "spine")}
"""Region that hands touch -> parts of the body, of which one needs skin."""
_LIMBS = {"arms": ARM, "legs": ("leg",), "neck": ("neck",)}


def fit_skin(
    skeleton: Skeleton, points: SkinPoints, is_doubtful: NDArray[np.bool_]
) -> tuple[BodyCapsules, tuple[str, ...]]:
    """Returns the capsules of a skeleton with known arms, fitted to the V vertices of its skin, and the parts with too
    few vertices, which keep the usual proportions. Vertices of ``is_doubtful`` (V,) count only on body parts without
    enough other skin.
    """
    info = rig_info(skeleton)
    points, known = without_doubtful(points, is_doubtful, info.roles.role_of, info.sizes.stature)
    fitting = _Fitting(skeleton, points)
    fitting.hands()
    fitting.limbs()
    fitting.trunk()
    fitting.head()
    skin, missed = _skin(skeleton, points), fitting.missed
    guessed = {region for region, parts in _REGION_PARTS.items() if known.isdisjoint(parts)}
    guessed |= {"arm"} if "arms" in missed else set()
    if skin is None or any(known.isdisjoint((f"{side}Hand", f"{side}Fingers")) for side in SIDES):
        guessed = {*REGIONS}
    body = replace(fitting.body(), skin=skin, guessed_regions=frozenset(guessed))
    return body, tuple(sorted(missed, key=lambda what: what not in _LIMBS))


def _skin(skeleton: Skeleton, points: SkinPoints) -> AvatarSkin | None:
    """Returns the skin of hands, head, neck and trunk; None if a part has none."""
    info, rest = rig_info(skeleton), rest_positions(skeleton)
    roles, spacing = info.roles.joints, _MEASURES.point_spacing * info.sizes.stature
    body = surface(points, [roles[role] for role in BODY if role in roles], rest, spacing)
    wrists = [roles[f"{side}Hand"] for side in SIDES if f"{side}Hand" in roles]
    hands = [surface(points, subtree(skeleton, wrist), rest, spacing, bare=True) for wrist in wrists]
    left, right = (*hands, None, None)[:2]
    return None if body is None or left is None or right is None else AvatarSkin(body, (left, right), points)


class _Fitting:
    """The capsules during the fit. World: the rest pose, root at the origin, left +X, up +Y, forward +Z."""

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
        rest = self.rest[self.usual.joints]
        self.starts, self.ends = rest + self.usual.starts @ self._turn.T, rest + self.usual.ends @ self._turn.T
        self.radii = self.usual.radii.copy()
        self.row = {key: n for n, key in enumerate(self.usual.keys)}
        self.missed: list[str] = []

    def body(self) -> BodyCapsules:
        """Returns the current capsules."""
        rest = self.rest[self.usual.joints]
        starts, ends = (self.starts - rest) @ self._turn, (self.ends - rest) @ self._turn
        return replace(self.usual, starts=starts, ends=ends, radii=self.radii)

    # --- limbs, neck, fingers ---

    def limbs(self) -> None:
        """Fit arms, legs and neck; those with too few vertices get the median factor of the others."""
        for what, parts in _LIMBS.items():
            rows = [n for n, part in enumerate(self.usual.parts) if part in parts]
            self._scale_others(what, rows, [n for n in rows if self._sleeve(n, halves=True)])
        for side in SIDES:
            shoulder, arm = self.row.get(f"{side}Shoulder"), self.row.get(f"{side}UpperArm")
            if shoulder is not None and arm is not None:
                self.radii[shoulder] *= self.radii[arm, 0] / self.usual.radii[arm, 0]

    def hands(self) -> None:
        """Fit palms and phalanges; those with too few vertices get the median factor of the others."""
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
        """Fit one capsule to the vertices around its bone; returns False if there are too few."""
        start, end = self.starts[row].copy(), self.ends[row].copy()
        vertices = self.points.of(int(self.usual.joints[row]))
        axis = end - start
        length = float(np.linalg.norm(axis))
        if len(vertices) < MIN_POINTS or not length > 0.0:
            return False
        axis /= length
        side = np.cross(axis, np.eye(3)[int(np.argmin(np.abs(axis)))])
        side /= np.linalg.norm(side)
        frame = np.stack([side, np.cross(axis, side)])  # (2, 3) at right angles to the bone
        shares, offsets = (vertices - start) @ axis / length, (vertices - start) @ frame.T
        if not halves:
            return self._finger_sleeve(row, start, axis, shares, offsets, frame)
        seen, distances = [], np.linalg.norm(offsets, axis=1)
        for t in (np.arange(_MEASURES.limb_slices) + 0.5) / _MEASURES.limb_slices:
            inside, widest = np.abs(shares - t) < 0.5 / _MEASURES.limb_slices, self._widest(row, t)
            ring = _ring(offsets[inside], is_centred=self.usual.parts[row] in ARM)
            if ring is not None and ring[1] > widest:  # a wide sleeve, or a skirt: skin may lie within
                ring = _ring(offsets[inside & (distances < widest)], is_centred=self.usual.parts[row] in ARM)
            if ring is not None:
                seen.append((t, *ring[0], ring[1]))
        if not seen:
            return False
        table, usual = np.array(seen), self.usual.radii[row]
        if np.ptp(table[:, 0]) < _MEASURES.taper_span:  # bare at one end alone: as the usual limb tapers
            self.radii[row] = usual * quantile(table[:, 3] / (usual[0] + table[:, 0] * (usual[1] - usual[0])), 0.5)
            return True
        low, high = _MEASURES.thin_end * table[:, 3].min(), _MEASURES.thick_end * table[:, 3].max()
        for ends, t, k in ((self.starts, 0.0, 0), (self.ends, 1.0, 1)):
            x, y, radius = (line(table[:, 0], table[:, column], t) for column in (1, 2, 3))
            ends[row] += np.array([x, y]) @ frame
            self.radii[row, k] = np.clip(radius, low, high)
        return True

    def _widest(self, row: int, t: float) -> float:
        """Returns the radius at part t of a limb beyond which its vertices are cloth; stout bodies have stout palms."""
        palms = [n for n, part in enumerate(self.usual.parts) if part == "palm"]
        stout = quantile(self.radii[palms].mean(axis=1) / self.usual.radii[palms].mean(axis=1), 0.5) if palms else 1.0
        start, end = self.usual.radii[row].tolist()
        return float(_MEASURES.sleeve_radius * max(1.0, stout) * (start + t * (end - start)))

    def _finger_sleeve(
        self, row: int, start: FloatArray, axis: FloatArray, shares: FloatArray, offsets: FloatArray, frame: FloatArray
    ) -> bool:
        """Fit one middle and one radius to a phalanx; the last one ends at its outermost vertex."""
        is_last = self.usual.parts[row].endswith("Tip")
        first, last = _MEASURES.phalanx_range
        inside = (shares > first) & ((shares < last) | is_last)
        ring = _ring(offsets[inside])
        if ring is None:
            return False
        middle, radius = ring
        usual = self.usual.radii[row]
        self.radii[row] = radius * usual / usual.mean()
        length = float(np.linalg.norm(self.ends[row] - start))
        if is_last:
            length = max(float(shares.max()) * length - self.radii[row, 1], _MEASURES.shortest_tip * length)
        self.starts[row] = start + middle @ frame
        self.ends[row] = start + length * axis + middle @ frame
        return True

    def _palm(self, row: int, side: str) -> bool:
        """Fit one capsule from wrist to knuckle between the palm's surfaces; returns False with too few vertices."""
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
        shares, height, sideways = since @ axis / length, since @ up, np.abs(since @ np.cross(axis, up))
        is_palm = sideways < _MEASURES.palm_slice_half_width * spacing
        is_palm &= np.abs(height) < _MEASURES.cloth_distance * self.usual.radii[row].max()
        surfaces = []
        for low in _MEASURES.palm_slice_starts:
            inside = height[is_palm & (shares >= low) & (shares < low + _MEASURES.palm_slice_length)]
            if len(inside) < MIN_POINTS:
                return False
            surfaces.append([quantile(inside, share) for share in _MEASURES.surface_shares])
        (b0, t0), (b1, t1) = surfaces
        self.radii[row] = 0.5 * (t0 - b0), 0.5 * (t1 - b1)
        self.starts[row] = start + 0.5 * (t0 + b0) * up
        self.ends[row] = end + 0.5 * (t1 + b1) * up
        return True

    def _scale_others(self, what: str, rows: Sequence[int], fitted: Sequence[int]) -> None:
        """Give unfitted rows the median factor of the fitted ones."""
        unfitted = [n for n in rows if n not in fitted]
        if rows and not fitted:
            self.missed.append(what)
        elif unfitted:
            factors = self.radii[list(fitted)].mean(axis=1) / self.usual.radii[list(fitted)].mean(axis=1)
            self.radii[unfitted] *= quantile(factors, 0.5)

    # --- trunk ---

    def trunk(self) -> None:
        """Fit chest and belly as three columns each, hips, back and collar."""
        low = self.rest[self.roles.get("hips", 0)][1] - (TRUNK_SIZES.hem_drop + _MEASURES.hem_margin) * self.height
        legs = [self.roles[role] for role in ("leftUpperLeg", "rightUpperLeg") if role in self.roles]
        trunk = [self.roles[role] for role in TRUNK if role in self.roles]
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
        """Returns points (N, 3) on the surface that these joints carry."""
        return self.points.surface(joints, _MEASURES.point_spacing * self.height)[0]

    def head(self) -> None:
        """Fit the head's capsules, about its joint."""
        rows = [n for n, key in enumerate(self.usual.keys) if key.startswith("head")]
        if not rows:
            return
        joint = self.rest[self.roles["head"]]
        points = self._surface([self.roles[role] for role in HEAD if role in self.roles]) - joint
        starts, ends, radii = self.starts[rows] - joint, self.ends[rows] - joint, self.radii[rows]
        if fit_head(starts, ends, radii, points, self.height):
            self.starts[rows], self.ends[rows], self.radii[rows] = starts + joint, ends + joint, radii
        else:
            self.missed.append("head")


def _ring(offsets: FloatArray, is_centred: bool = False) -> tuple[FloatArray, float] | None:
    """Returns middle (2,) and radius of the vertices (N, 2) around a bone; None if they are too few, or not all around.
    With ``is_centred`` the middle is the bone itself.
    """
    if len(offsets) < MIN_POINTS or len({(x > 0.0, y > 0.0) for x, y in offsets.tolist()}) < 4:
        return None
    if is_centred:
        return np.zeros(2), quantile(np.linalg.norm(offsets, axis=1), 0.5)
    middle = np.array([0.5 * sum(quantile(offsets[:, k], share) for share in _MEASURES.surface_shares) for k in (0, 1)])
    return middle, quantile(np.linalg.norm(offsets - middle, axis=1), 0.5)
