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
from dataclasses import replace

import numpy as np

from signsplice.body.capsules import HEM, BodyCapsules, BodyShape, shaped_capsules
from signsplice.body.relief import Relief
from signsplice.body.skin_head import fit_head
from signsplice.body.skin_points import MIN_POINTS, SkinPoints, quantile
from signsplice.body.skin_surface import AvatarSkin, surface
from signsplice.body.skin_trunk import TrunkSkin, line
from signsplice.motion import rotation
from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import Skeleton
from signsplice.motion.kinematics import rest_positions, subtree
from signsplice.rig.info import rig_info
from signsplice.rig.roles import FINGERS, SIDES

_TRUNK = ("hips", "spine", "chest", "upperChest", "leftShoulder", "rightShoulder")
_HEAD = ("head", "jaw", "leftEye", "rightEye")
BODY = (*_TRUNK, *_HEAD, "neck")
"""Roles of the joints whose skin hands are put on."""
_ARM = ("sleeve", "cuff")
"""Parts whose capsules lie along their bones, from joint to joint, as the fit of clips has them."""
_LIMBS = {"arms": ("sleeve", "cuff"), "legs": ("leg",), "neck": ("neck",)}
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
        self.usual, self.height = shaped_capsules(skeleton, BodyShape()), info.sizes.stature
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
            ring = _ring(across[inside], is_centred=self.usual.parts[row] in _ARM)
            if ring is not None and ring[1] > widest:  # a wide sleeve, or a skirt: what is within may be skin
                ring = _ring(across[inside & (away < widest)], is_centred=self.usual.parts[row] in _ARM)
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
