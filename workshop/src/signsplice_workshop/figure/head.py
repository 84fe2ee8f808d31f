"""The head of the figure: MakeHuman's, scaled to the capsules that hands touch, with the 52 units of its face.

Heights of chin, mouth, nose and eyes are scaled by lines between them; then all points follow the capsules' surface
through a smooth field, so that eyes, lips and nose keep their shape. Eyes, brows and hair are made here. Places are dm
from the head's joint, left +X, up +Y, forward +Z.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from signsplice.body.capsules import body_capsules
from signsplice.body.mesh import bind_pose
from signsplice.lexicon import open_shipped_lexicon
from signsplice.motion import rotation
from signsplice.motion.face import ARKIT_CHANNELS
from signsplice.rig.info import rig_info
from signsplice_workshop.figure.base import (
    Floats,
    Index,
    append_line,
    compute_normals,
    find_rim,
    read_target,
    split_triangles,
)
from signsplice_workshop.figure.blends import BoundCapsules, distances_from, pose_capsules, union
from signsplice_workshop.figure.body import ABOVE, Bodies, anchor_shares, bind, follow_capsules
from signsplice_workshop.figure.clothes import Sheet, make_sheet, smooth_rim, thicken, within_collar

STATURE_DM = 16.535
_HEIGHTS = ((-1.2, -1.1), (-0.2, -0.15), (0.3, 0.34), (0.52, 0.62), (0.8, 0.96), (1.88, 2.12))
"""Heights of MakeHuman's head above its joint, dm, and of the mannequin's: neck, chin, mouth, nose, eyes, top."""
_WIDE, _DEEP = 1.04, 0.95
_AROUND, _TIMES = 0.40, 4
"""Width of the smooth field, dm, and number of steps along it."""


def scale_to_mannequin(points: Floats) -> Floats:
    """Returns points of MakeHuman's head (N, 3) at the heights, width and depth of the mannequin's."""
    theirs, ours = np.array(_HEIGHTS).T
    return np.stack([_WIDE * points[:, 0], np.interp(points[:, 1], theirs, ours), _DEEP * points[:, 2]], axis=1)


class Mannequin:
    """The surface of the mannequin's head and neck, dm from the head's joint."""

    def __init__(self) -> None:
        skeleton = open_shipped_lexicon().clip("NAME").skeleton
        shape, info = body_capsules(skeleton), rig_info(skeleton)
        chosen = [n for n, part in enumerate(shape.parts) if part in ("face", "hair", "neck")]
        posed = pose_capsules(skeleton, shape, chosen)
        scale, origin = STATURE_DM / info.sizes.stature, bind_pose(skeleton)[1][info.roles.joints["head"]]
        self._capsules = BoundCapsules(
            (posed.starts - origin) * scale, (posed.ends - origin) * scale, posed.radii * scale, posed.joints
        )

    def depth(self, points: Floats) -> Floats:
        """Returns distances (N,) from the surface, negative inside, dm."""
        return union(distances_from(points, self._capsules), 0.0035 * STATURE_DM)

    def outward(self, points: Floats) -> Floats:
        """Returns unit vectors (N, 3) along which the distance grows."""
        slope = np.stack(
            [self.depth(points + 1e-4 * axis) - self.depth(points - 1e-4 * axis) for axis in np.eye(3)], axis=1
        )
        return np.asarray(slope / np.linalg.norm(slope, axis=1, keepdims=True))


def follow_field(points: Floats, guides: Floats, mannequin: Mannequin) -> Floats:
    """Returns points moved by the smooth field that takes ``guides`` (G, 3), of the skin, onto the mannequin."""
    points, guides = points.copy(), guides.copy()
    for _ in range(_TIMES):
        offsets = mannequin.depth(guides)[:, None] * mannequin.outward(guides)
        moves = []
        for part in (points, guides):
            weight = np.exp(-0.5 * ((part[:, None] - guides) ** 2).sum(axis=2) / _AROUND**2) + 1e-12
            moves.append((weight @ offsets) / weight.sum(axis=1, keepdims=True))
        points, guides = points - moves[0], guides - moves[1]
    return points


def find_outermost(points: Floats) -> NDArray[np.bool_]:
    """Returns which points (N,) are not hidden by another from outside, as seen from the middle of the head."""
    vectors = points - [0.0, 0.8, 0.1]
    distances = np.linalg.norm(vectors, axis=1)
    is_near = (vectors / distances[:, None]) @ (vectors / distances[:, None]).T > np.cos(np.deg2rad(4.0))
    return np.asarray(distances > 0.94 * np.where(is_near, distances[None], 0.0).max(axis=1))


_HAIRLINE = (
    *((-1.2, 0.0), (-0.6, -0.1), (-0.3, 0.0), (-0.12, 0.3), (0.15, 0.55), (0.38, 0.62), (0.43, 1.0)),
    *((0.54, 1.35), (0.64, 1.6), (0.75, 1.68), (1.3, 1.72)),
)
"""Depth and height of the hairline, dm."""
_EAR = ((0.66, 0.09), (0.49, 0.245))
"""Height and depth of the middle of an ear with the bare skin around it, and its extents, dm."""


def measure_above_hairline(points: Floats) -> Floats:
    """Returns how far points (N, 3) lie above the hairline and outside of the ears, dm."""
    depth, height = np.array(_HAIRLINE).T
    middle, reach = np.array(_EAR)
    around = 0.3 * (np.linalg.norm((points[:, 1:] - middle) / reach, axis=1) - 1.0)
    line = np.interp(points[:, 2], depth, height)
    in_front = np.clip((points[:, 2] - 0.2) / 0.5, 0.0, 1.0)
    line += in_front * (0.20 * np.exp(-(((points[:, 0] - _PARTING) / 0.2) ** 2)) - 0.12)
    return np.asarray(np.minimum(points[:, 1] - line, around))


_LIPS = (0.303, 0.235, 0.105, 0.095)
"""Height of the line between the lips, half their width, height of the upper and of the lower, dm."""


def measure_within_lips(points: Floats) -> Floats:
    """Returns approximately how far points (N, 3) lie within the lips, dm."""
    middle, wide, upper, lower = _LIPS
    x, y = points[:, 0] / wide, points[:, 1] - middle
    return np.where(points[:, 2] > 0.7, 0.1 * (1.0 - x**2 - (y / np.where(y > 0.0, upper, lower)) ** 2), -0.1)


_EYE_PARTS = ("pupil", "iris", "eye")


def make_eye(middle: Floats, radius: float) -> tuple[Floats, Index, Index]:
    """Returns an eye: vertices (V, 3), triangles (F, 3), and their parts: white, iris, pupil."""
    rings, n = np.deg2rad([0.0, 11.0, 12.0, 22.0, 30.0, 31.0, 45.0, 65.0, 90.0, 115.0]), 20
    around = np.linspace(0.0, 2.0 * np.pi, n, endpoint=False)
    rows = [np.stack([np.sin(a) * np.cos(around), np.sin(a) * np.sin(around), np.full(n, np.cos(a))], 1) for a in rings]
    corner = np.arange(n)
    next_corner = (corner + 1) % n
    faces, parts = [], []
    for k in range(len(rings) - 1):
        low, high = k * n, (k + 1) * n
        faces += [
            np.stack([low + corner, high + corner, high + next_corner], 1),
            np.stack([low + corner, high + next_corner, low + next_corner], 1),
        ]
        parts += [np.full(2 * n, 0 if k < 1 else 1 if k < 4 else 2)]
    return middle + radius * np.concatenate(rows), np.concatenate(faces), np.concatenate(parts)


_LOOKS = {"Up": (-1.0, 0.0), "Down": (1.0, 0.0), "In": (0.0, -1.0), "Out": (0.0, 1.0)}
_LOOK_DEG = {"Up": 25.0, "Down": 30.0, "In": 30.0, "Out": 30.0}


def make_brow(
    side: float, skin: Floats, triangles: Index, moves: dict[str, Floats]
) -> tuple[Floats, Index, dict[str, Floats]]:
    """Returns a brow: a strip on the skin above an eye, and its displacements by the units of the skin."""
    t = np.linspace(0.0, 1.0, 13)
    x = side * (0.13 + 0.40 * t)
    y = np.interp(t, [0.0, 0.35, 0.65, 1.0], [1.185, 1.215, 1.225, 1.165])
    half_width = 0.026 * (1.0 - 0.7 * t**2)
    rows = np.concatenate([np.stack([x, y + s * half_width], 1) for s in (1.0, 0.0, -1.0)])
    a, b, c = (skin[triangles[:, k]] for k in range(3))
    facing = np.cross(b - a, c - a)[:, 2] > 0.0
    points: list[list[float]] = []
    carried: dict[str, list[Floats]] = {name: [] for name in moves}
    for p in rows:
        best = None
        for f in np.flatnonzero(facing & (a[:, 2] > 0.5) & (np.abs(a[:, :2] - p).max(axis=1) < 0.4)):
            corners = skin[triangles[f]]
            basis = np.stack([corners[1, :2] - corners[0, :2], corners[2, :2] - corners[0, :2]], axis=1)
            if abs(np.linalg.det(basis)) < 1e-9:
                continue
            u, v = np.linalg.solve(basis, p - corners[0, :2])
            weights = np.array([1.0 - u - v, u, v])
            if weights.min() > -1e-6 and (best is None or weights @ corners[:, 2] > best[2]):
                best = (f, weights, weights @ corners[:, 2])
        assert best is not None, p
        points.append([*p, best[2] + 0.012])
        for name, of_skin in moves.items():
            carried[name].append(best[1] @ of_skin[triangles[best[0]]])
    n, k = len(t), np.arange(len(t) - 1)
    faces = []
    for low in (0, n):
        quads = [
            np.stack([low + k, low + n + k, low + n + k + 1], 1),
            np.stack([low + k, low + n + k + 1, low + k + 1], 1),
        ]
        faces += quads
    strip_faces = np.concatenate(faces)
    return (
        np.array(points),
        strip_faces if side > 0.0 else strip_faces[:, ::-1],
        {name: np.array(m) for name, m in carried.items()},
    )


_NECK_BEGINS = ((-0.5, 0.02), (0.2, -0.25))
"""Depth and height of the line where the head passes into the neck, dm."""
_NECK_LENGTH = 0.45
"""Height over which it does, dm."""


def make_head(bodies: Bodies, folder: Path) -> dict[str, tuple[Sheet, dict[str, Floats]]]:
    """Returns the parts of the head in the bind pose, and how the units of the face move their vertices, cm."""
    base, mannequin = bodies.base, Mannequin()
    joint = base.joints["mixamorig:Head"]
    positions = base.points - [0.0, *joint[1:]]
    scaled = scale_to_mannequin(positions)
    theirs, ours = np.array(_HEIGHTS).T
    slope = np.interp(positions[:, 1], 0.5 * (theirs[1:] + theirs[:-1]), np.diff(ours) / np.diff(theirs))
    stretch = np.stack([np.full(len(slope), _WIDE), slope, np.full(len(slope), _DEEP)], axis=1)
    moves = {}
    for name in ARKIT_CHANNELS:
        index, delta = read_target(folder / f"faceunits01/targets/faceunits/{name}.target")
        moves[name] = np.zeros_like(scaled)
        moves[name][index] = delta * stretch[index] * _get_strength(name)
    scaled += sum(_SMILE * moves[f"mouthSmile{side}"] for side in ("Left", "Right"))
    groups = base.groups
    neck = find_neck(bodies)
    is_head = (bodies.weights["head"] + bodies.weights["neck"] > 0.2) & (positions[:, 1] > -1.3)
    skin = groups["body"]
    used = np.unique(skin[is_head[skin].all(axis=1)])
    middles = [find_middle(scaled[np.unique(groups[f"helper-{side}-eye"])]) for side in "lr"]
    in_socket = np.min([np.linalg.norm(scaled - middle, axis=1) for middle in middles], axis=0) < 0.30
    lips = np.linalg.norm(moves["mouthRollLower"], axis=1) + np.linalg.norm(moves["mouthRollUpper"], axis=1)
    is_ear = (np.abs(scaled[:, 0]) > 0.70) & (scaled[:, 2] < 0.35) & (scaled[:, 1] > 0.3) & (scaled[:, 1] < 1.3)
    guides = np.array(
        [v for v in used[find_outermost(scaled[used])] if not in_socket[v] and not is_ear[v] and lips[v] < 0.03]
    )
    shown = np.unique(
        np.concatenate([used, *(np.unique(t) for name, t in groups.items() if name.startswith("helper"))])
    )
    shown = shown[np.abs(scaled[shown]).max(axis=1) < 3.0]
    positions = scaled.copy()
    positions[shown] = follow_field(scaled[shown], scaled[guides], mannequin)
    away_mm = 100.0 * mannequin.depth(positions[guides])
    print("head: mm from the capsules, 2.5 50 97.5 %", np.percentile(away_mm, [2.5, 50, 97.5]).round(1))
    depth, height = np.array(_NECK_BEGINS).T
    begins = np.interp(scaled[:, 2], depth, height)
    share = np.clip((begins - scaled[:, 1]) / _NECK_LENGTH, 0.0, 1.0)
    share = np.where(np.isfinite(neck[:, 0]), share * share * (3.0 - 2.0 * share), 0.0)[:, None]
    positions = (1.0 - share) * positions + share * np.nan_to_num(neck)
    skin = skin[(is_head | np.isfinite(neck[:, 0]))[skin].all(axis=1)]
    carried, shares = np.stack([*bodies.weights.values()], axis=1), _shares(bodies)
    values = [positions, carried, shares, *moves.values()]

    def split(triangles: Index, heights: Floats) -> tuple[Index, Index]:
        below, above, pairs, alpha = split_triangles(triangles, heights)
        values[:] = [append_line(array, pairs, alpha) for array in values]
        return below, above

    skin, lip = split(skin, measure_within_lips(positions))
    skin, scalp = split(skin, measure_above_hairline(values[0]))
    positions, carried, shares, *rows = values
    moves = dict(zip(moves, rows, strict=True))
    normals = compute_normals(positions, np.concatenate([skin, lip, scalp]))
    parts: dict[str, tuple[Sheet, dict[str, Floats]]] = {}

    def add(name: str, triangles: Index, points: Floats = positions, own: Floats = normals) -> None:
        whole = Sheet(10.0 * points + bodies.bound["head"], own, triangles, shares, carried)
        chosen = np.unique(triangles)
        parts[name] = whole.rows(triangles), {unit: 10.0 * move[chosen] for unit, move in moves.items()}

    # Also below the hair, which readers of avatars do not count as skin.
    add("face", np.concatenate([skin, scalp]))
    add("lips", lip)
    add("hair", scalp)
    parts["hair"] = (make_hair(parts["hair"][0], bodies.bound["head"], mannequin), {})
    eyes, brows, lashes = [], [], []
    face, face_moves = parts["face"]
    in_dm = {unit: 0.1 * move for unit, move in face_moves.items()}
    for side, middle, sign in (("Left", middles[0], 1.0), ("Right", middles[1], -1.0)):
        centre = follow_field(middle[None], scaled[guides], mannequin)[0]
        points, triangles, kinds = make_eye(centre - [0.0, 0.0, _EYE_BACK], _EYE)
        looks = {}
        for direction, (over_x, over_y) in _LOOKS.items():
            turn = rotation.exp(np.deg2rad(_LOOK_DEG[direction]) * np.array([over_x, sign * over_y, 0.0]))
            looks[f"eyeLook{direction}{side}"] = rotation.rotate(turn, points - centre) - (points - centre)
        eyes.append((points, triangles, kinds, looks))
        brows.append(make_brow(sign, 0.1 * (face.points - bodies.bound["head"]), face.triangles, in_dm))
        own = groups[f"helper-{side[0].lower()}-eyelashes-2"]
        lashes.append((own, compute_normals(positions, own)))
    kinds = np.concatenate([kinds for _, _, kinds, _ in eyes])
    of_eyes = merge_alone(bodies, [(points, triangles, looks) for points, triangles, _, looks in eyes])
    for number, name in enumerate(_EYE_PARTS):
        parts[name] = choose(of_eyes, of_eyes[0].triangles[kinds == number])
    parts["brow"] = merge_alone(bodies, brows)
    both = np.concatenate([own for own, _ in lashes])
    add("lash", np.concatenate([both, both[:, ::-1]]), positions, lashes[0][1] + lashes[1][1])
    for name, pieces in (("teeth", ("upper-teeth", "lower-teeth")), ("tongue", ("tongue",))):
        triangles = np.concatenate([groups[f"helper-{piece}"] for piece in pieces])
        add(name, triangles, positions, compute_normals(positions, triangles))
    return parts


def _shares(bodies: Bodies) -> Floats:
    """Returns the shares (V, K) of the anchors in all vertices of the base mesh."""
    points = 10.0 * (bodies.base.points - bodies.base.joints["mixamorig:Hips"])
    shares = anchor_shares(bodies, points, bodies.weights)
    return np.stack([shares[name] for name in ABOVE], axis=1)


def find_middle(points: Floats) -> Floats:
    """Returns the middle (3,) of the box around points."""
    return np.asarray(0.5 * (points.min(axis=0) + points.max(axis=0)))


def choose(part: tuple[Sheet, dict[str, Floats]], triangles: Index) -> tuple[Sheet, dict[str, Floats]]:
    """Returns some triangles of a part."""
    chosen = np.unique(triangles)
    return part[0].rows(triangles), {unit: move[chosen] for unit, move in part[1].items()}


def merge_alone(
    bodies: Bodies, pieces: list[tuple[Floats, Index, dict[str, Floats]]]
) -> tuple[Sheet, dict[str, Floats]]:
    """Returns pieces that the head alone carries as one part: their points (V, 3), triangles and moves, dm."""
    starts = np.cumsum([0, *(len(points) for points, _, _ in pieces)])
    points = np.concatenate([points for points, _, _ in pieces])
    triangles = np.concatenate([rows + k for (_, rows, _), k in zip(pieces, starts[:-1], strict=True)])
    moves: dict[str, Floats] = {}
    for (_, _, own), start in zip(pieces, starts[:-1], strict=True):
        for unit, move in own.items():
            moves.setdefault(unit, np.zeros_like(points))[start : start + len(move)] = 10.0 * move
    shares = np.tile(np.eye(len(ABOVE))[[*ABOVE].index("head")], (len(points), 1))
    carried = np.tile(np.eye(len(bodies.weights))[[*bodies.weights].index("head")], (len(points), 1))
    placed = 10.0 * points + bodies.bound["head"]
    return Sheet(placed, compute_normals(placed, triangles), triangles, shares, carried), moves


def find_neck(bodies: Bodies) -> Floats:
    """Returns places (V, 3) of the skin of neck and chest down to below the collar, dm from the head's joint, NaN for
    other vertices of the base mesh.
    """
    sheet = make_sheet(bodies, "body")
    rows = np.unique(bodies.base.groups["body"])
    is_near = (sheet.points[:, 1] > 41.0) & (within_collar(sheet.points) > -3.0) & (sheet.points[:, 1] < 62.0)
    triangles = sheet.triangles[is_near[sheet.triangles].all(axis=1)]
    used, corners = np.unique(triangles, return_inverse=True)
    triangles, points = corners.reshape(-1, 3), sheet.points[used]
    height = -0.9 - 0.7 * np.clip(0.4 - within_collar(points), 0.0, 1.0)
    points = smooth_rim(follow_capsules(bodies, points, triangles, height), triangles, 4)
    weights = dict(zip(bodies.weights, sheet.carried[used].T, strict=True))
    places = np.full(bodies.base.points.shape, np.nan)
    places[rows[used]] = 0.1 * (bind(bodies, points, weights) - bodies.bound["head"])
    return places


_PARTING = 0.28
"""Distance of the parting to the left, dm."""
_CROWN = (0.10, -0.45)
"""Where locks begin, left and forward of the head's joint, dm."""
_FINE = -6.0
"""Depth from which on hair has smaller triangles, cm."""
_LOCKS, _LOCK = 17.0, 0.028
"""Number of locks around the crown, and half their height, dm."""
_HAIR = ((0.0, 0.02), (0.12, 0.05), (0.45, 0.065), (1.2, 0.07))
"""Distance above the hairline and thickness of the hair there, dm."""


def lock_phase(points: Floats) -> Floats:
    """Returns the phase (V,) of locks of hair, which spread from the crown, at points (V, 3), dm."""
    x, y, z = points[:, 0] - _CROWN[0], points[:, 1], points[:, 2] - _CROWN[1]
    around = np.arctan2(x, z) + 0.35 * (y - 1.6)
    return np.asarray(_LOCKS * around + 1.7 * np.sin(3.0 * around) + 1.1 * np.sin(2.0 * y + 5.0 * around))


def in_largest(triangles: Index) -> NDArray[np.bool_]:
    """Tells which triangles (F,) belong to the largest connected piece."""
    a, b = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]]]).T
    graph = coo_array((np.ones(len(a)), (a, b)), (triangles.max() + 1,) * 2)
    piece = connected_components(graph, directed=False)[1][triangles[:, 0]]
    return np.asarray(piece == np.bincount(piece).argmax())


def make_hair(scalp: Sheet, origin: Floats, mannequin: Mannequin) -> Sheet:
    """Returns the hair above the scalp, with locks and an edge."""
    scalp = scalp.rows(scalp.triangles[in_largest(scalp.triangles)])
    fine = scalp.finer(scalp.points[:, 2] - origin[2] > _FINE)
    points = 0.1 * (smooth_rim(fine.points, fine.triangles, 10) - origin)
    edge, thick = np.array(_HAIR).T
    above = measure_above_hairline(points)
    on_top = np.clip((points[:, 1] - 0.9) / 0.9, 0.0, 1.0)
    height = np.interp(above, edge, thick) * (0.65 + 0.45 * on_top)
    far = np.clip(np.hypot(points[:, 0] - _CROWN[0], points[:, 2] - _CROWN[1]) / 0.5, 0.0, 1.0)
    height += _LOCK * far * (1.0 - np.abs(np.sin(0.5 * lock_phase(points))) * 2.0) * np.clip(above / 0.1, 0.3, 1.0)
    placed = points + height[:, None] * mannequin.outward(points)
    is_front = np.clip((points[:, 2] + 0.3) / 0.3, 0.0, 1.0)
    height *= 1.0 - 0.6 * is_front * on_top * np.exp(-(((points[:, 0] - _PARTING) / 0.07) ** 2))
    hair = replace(fine, points=10.0 * placed + origin)
    normals, rim = compute_normals(hair.points, hair.triangles), np.unique(find_rim(hair.triangles))
    normals[rim] = mannequin.outward(points[rim])
    hair = replace(hair, normals=normals)
    return thicken(hair, np.array([0.0, 1.0, 0.0]), 0.7, 0.0)


_EYE, _EYE_BACK, _SMILE = 0.147, 0.016, 0.12
"""Radius of an eye, and its distance to the back, dm; the smile of a face at rest, which looks stern without it."""
_STRENGTHS = {"eyeBlink": 0.6, "brow": 1.5, "cheekPuff": 2.0}
"""Scale of a unit: these eyes close so far, and brows and cheeks are visible in a picture of a whole signer."""


def _get_strength(unit: str) -> float:
    return next((factor for name, factor in _STRENGTHS.items() if unit.startswith(name)), 1.0)
