"""Meshes of FBX files in the pose in which their skins are bound: triangles of one material, carried by joints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from signsplice.body.capsules import N_JOINTS, MeshPart
from signsplice.errors import InputError
from signsplice.formats.fbx_objects import Id, name_of
from signsplice.formats.fbx_records import Record
from signsplice.formats.fbx_scene import FbxScene
from signsplice.formats.fbx_takes import quats
from signsplice.formats.gltf_mesh import normals
from signsplice.motion import rotation
from signsplice.motion.arrays import FloatArray

Rows = NDArray[np.int64]
_VERTEX_BYTES, _CORNER_BYTES, _MOVE_BYTES = 300, 60, 48
"""Memory that is counted for a vertex, a corner of a triangle, and a vertex of a blend shape."""


class FbxMeshes:
    """The meshes of a scene on a skeleton.

    scene: what they are read from.
    worlds: model -> its matrix (4, 4) in the rest pose.
    rows: joint -> its number.
    """

    def __init__(self, scene: FbxScene, worlds: Mapping[Id, FloatArray], rows: Mapping[Id, int]) -> None:
        self.scene, self.worlds, self.rows = scene, worlds, rows
        self._to_metres = scene.metres * scene.axes

    def all(self) -> list[list[tuple[Id | None, MeshPart]]]:
        """Each mesh that joints carry, as parts of one material, None for none, in metres, Y up."""
        objects = self.scene.objects
        pairs = ((key, at) for key in self.scene.order for at, _ in objects.on(key, "Geometry", "Mesh"))
        return [parts for key, at in pairs if (parts := self._parts(key, at))]

    def _parts(self, key: Id, geometry: Id) -> list[tuple[Id | None, MeshPart]]:
        """A model's mesh by its materials."""
        objects, record = self.scene.objects, self.scene.objects.records[geometry]
        at, index = record.numbers("Vertices").reshape(-1, 3), record.numbers("PolygonVertexIndex")
        record.budget.take(_VERTEX_BYTES * len(at) + _CORNER_BYTES * len(index))  # again for each model that shares it
        carried = self._carried(key, geometry, len(at))
        if carried is None:
            return []
        blend, joints, weights = carried
        placed = np.einsum("vab,vb->va", blend[:, :, :3], at) + blend[:, :, 3]
        vertex, corners, polygons = _triangles(index)
        if len(vertex) and vertex.max() >= len(at):
            raise InputError(f"a mesh of {len(at)} vertices has triangles of others")
        if len(corners) and np.linalg.det(self._to_metres @ blend[vertex[0], :, :3]) < 0.0:
            corners = corners[:, ::-1]
        uvs, uv_of = _uvs(record, vertex)
        materials = [material for material, _ in objects.on(key, "Material")]
        number = _materials(record, polygons)
        parts = []
        for n in np.unique(number):
            own = corners[number == n]
            pairs = vertex[own] * (uv_of.max() + 1) + uv_of[own]
            _, first, triangles = np.unique(pairs, return_index=True, return_inverse=True)
            used, uv = vertex[own].ravel()[first], uv_of[own].ravel()[first]
            vertices, triangles = placed[used] @ self._to_metres.T, triangles.reshape(-1, 3)
            part = MeshPart(
                self.scene.models[key].name, (1.0, 1.0, 1.0), vertices, normals(vertices, triangles), triangles,
                joints[used], weights[used], self._morphs(geometry, used, blend),
                None if uvs is None else uvs[uv] * [1.0, -1.0] + [0.0, 1.0],
            )  # fmt: skip
            parts.append((materials[n] if n < len(materials) else None, part))
        return parts

    def _carried(self, key: Id, geometry: Id, n: int) -> tuple[FloatArray, Rows, FloatArray] | None:
        """Of N vertices the matrices (N, 3, 4) to the rest pose, and the joints and weights (N, 4) that carry them.
        None where no joint does.
        """
        objects, row, above = self.scene.objects, 0, key
        while above not in self.rows and above in self.scene.parents:
            above = self.scene.parents[above]
        skins = [skin for skin, _ in objects.on(geometry, "Deformer", "Skin")]
        clusters = [cluster for skin in skins for cluster, _ in objects.on(skin, "Deformer", "Cluster")]
        if above in self.rows:
            row = self.rows[above]
        elif not clusters:
            return None
        own = _geometric(self.scene, key)
        matrices, rows, vertices, weights, which = [self.worlds[key] @ own], [row], [], [], []
        for cluster in clusters:
            record = objects.records[cluster]
            to_bone, (bone, *_) = record.numbers("Transform"), [*(b for b, _ in objects.on(cluster, "Model")), None]
            if bone not in self.rows or len(to_bone) != 16:
                continue
            vertices.append(record.numbers("Indexes").astype(np.int64))
            weights.append(record.numbers("Weights")[: len(vertices[-1])])
            which.append(np.full(len(vertices[-1]), len(rows)))
            matrices.append(self.worlds[bone] @ to_bone.reshape(4, 4).T @ own)
            rows.append(self.rows[bone])
        clusters_of, kept = _heaviest(vertices, weights, which, n)
        blend = np.zeros((n, 3, 4))
        for k in range(N_JOINTS):
            blend += kept[:, k, None, None] * np.array(matrices)[clusters_of[:, k], :3]
        return blend, np.array(rows)[clusters_of] * (kept > 0.0), kept

    def _morphs(self, geometry: Id, used: Rows, blend: FloatArray) -> dict[str, tuple[Rows, FloatArray]]:
        """The blend shapes of a mesh on the vertices ``used`` (V,) of it, which may repeat."""
        objects, order = self.scene.objects, np.argsort(used, kind="stable")
        ordered = used[order]
        found: dict[str, tuple[Rows, FloatArray]] = {}
        for deformer, _ in objects.on(geometry, "Deformer", "BlendShape"):
            for channel, _ in objects.on(deformer, "Deformer", "BlendShapeChannel"):
                shapes = [objects.records[shape] for shape, _ in objects.on(channel, "Geometry", "Shape")]
                if not shapes:
                    continue
                index = shapes[-1].numbers("Indexes").astype(np.int64)  # the last is that at full strength
                shapes[-1].budget.take(_MOVE_BYTES * len(index))
                index, one = np.unique(index, return_index=True)
                moves = shapes[-1].numbers("Vertices").reshape(-1, 3)[one]
                first, end = (np.searchsorted(ordered, index, side) for side in ("left", "right"))
                counts = end - first
                each = np.repeat(np.arange(len(index)), counts)
                rows = order[np.arange(len(each)) + np.repeat(first - np.cumsum(counts) + counts, counts)]
                linear = np.einsum("vab,vb->va", blend[index[each], :, :3], moves[each])
                found.setdefault(name_of(objects.records[channel].values[1]), (rows, linear @ self._to_metres.T))
        return found


def _geometric(scene: FbxScene, key: Id) -> FloatArray:
    """The matrix (4, 4) of a model that reaches its mesh alone."""
    model, out = scene.models[key], np.eye(4)
    turned = rotation.to_matrix(quats(model.vector("GeometricRotation"), "XYZ"))
    out[:3, :3], out[:3, 3] = turned * model.vector("GeometricScaling", 1.0), model.vector("GeometricTranslation")
    return out


def _heaviest(
    vertices: Sequence[Rows], weights: Sequence[FloatArray], which: Sequence[Rows], n: int
) -> tuple[Rows, FloatArray]:
    """The clusters (N, 4) that carry most of each vertex, and their weights, which sum to 1; cluster 0 where none does.

    vertices, weights, which: of each cluster its vertices, how much it carries of them, and its number.
    """
    clusters, kept = np.zeros((n, N_JOINTS), np.int64), np.zeros((n, N_JOINTS))
    if vertices:
        vertex, weight, cluster = (np.concatenate(parts) for parts in (vertices, weights, which))
        if len(vertex) and (vertex.min() < 0 or vertex.max() >= n):
            raise InputError(f"a skin carries vertices that are none of {n}")
        order = np.lexsort((-weight, vertex))
        vertex, weight, cluster = vertex[order], weight[order], cluster[order]
        rank = np.arange(len(vertex)) - np.searchsorted(vertex, vertex)
        taken = (rank < N_JOINTS) & (weight > 0.0)
        clusters[vertex[taken], rank[taken]], kept[vertex[taken], rank[taken]] = cluster[taken], weight[taken]
    kept[kept.sum(axis=1) == 0.0, 0] = 1.0
    return clusters, kept / kept.sum(axis=1, keepdims=True)


def _triangles(index: FloatArray) -> tuple[Rows, Rows, Rows]:
    """The vertices (C,) of all corners of polygons, the corners (F, 3) of triangles that make these up, and the polygon
    (F,) of each; the last corner of a polygon has its vertex as its complement.
    """
    corners = index.astype(np.int64)
    ends = np.flatnonzero(corners < 0)
    starts = np.append(0, ends[:-1] + 1)[: len(ends)]
    counts = np.maximum(ends - starts - 1, 0)
    polygons = np.repeat(np.arange(len(ends)), counts)
    second = starts[polygons] + np.arange(len(polygons)) - np.repeat(np.cumsum(counts) - counts, counts) + 1
    return np.where(corners < 0, ~corners, corners), np.stack([starts[polygons], second, second + 1], axis=1), polygons


def _uvs(record: Record, vertex: Rows) -> tuple[FloatArray | None, Rows]:
    """Texture coordinates (N, 2) of a mesh, None for none, and their rows (C,) by corner."""
    layer = record.find("LayerElementUV")
    if layer is None:
        return None, np.zeros(len(vertex), np.int64)
    uvs, rows = layer.numbers("UV").reshape(-1, 2), layer.numbers("UVIndex").astype(np.int64)
    rows = rows if len(rows) else np.arange(len(uvs))
    mapping = layer.find("MappingInformationType")
    if mapping is not None and "ByVert" in str(mapping.values[:1]):
        rows = rows[vertex]
    if len(rows) < len(vertex) or (len(rows) and (rows.min() < 0 or rows.max() >= len(uvs))):
        raise InputError(f"a mesh has {len(uvs)} texture coordinates for {len(vertex)} corners")
    return uvs, rows


def _materials(record: Record, polygons: Rows) -> Rows:
    """The number of the material of each triangle, whose polygons are given (F,)."""
    layer = record.find("LayerElementMaterial")
    rows = np.zeros(1, np.int64) if layer is None else np.maximum(layer.numbers("Materials").astype(np.int64), 0)
    return rows[polygons] if len(rows) > polygons.max(initial=0) > 0 else np.full(len(polygons), rows[:1].sum())
