"""Conversion of FBX avatars to ``.glb``: joints and meshes at rest, blend shapes, colours, PNG or JPEG textures.

The rest pose is the bind pose of the skins. Scales are applied to vertices and bone lengths.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pygltflib import Image, Material, PbrMetallicRoughness, Texture, TextureInfo

from signsplice.body.capsules import N_JOINTS, MeshPart
from signsplice.errors import FormatError, InputError
from signsplice.formats.fbx_records import Id, Record, name_of
from signsplice.formats.fbx_scene import FbxScene, Transforms, nearest_rotation
from signsplice.formats.fbx_takes import Take, quats
from signsplice.formats.gltf_document import unique
from signsplice.formats.gltf_mesh import normals
from signsplice.formats.gltf_writer import DocumentWriter
from signsplice.formats.reading import DEFAULT_LIMITS, ReadLimits, read_bytes
from signsplice.motion import FloatArray, rotation

Rows = NDArray[np.int64]
_PACKED = 3.0
"""Meshes, which are packed, may take this many times more memory for each byte of a file, and this many times more free
memory at most: 100,000 vertices with 52 blend shapes of 20,000 take 155 MB from a file of 3.3 MB.
"""
_VERTEX_BYTES = 300
"""Bytes of memory counted for a vertex."""
_CORNER_BYTES = 60
"""Bytes of memory counted for a corner of a triangle."""
_MOVE_BYTES = 48
"""Bytes of memory counted for a vertex of a blend shape."""


class FbxMeshes:
    """The meshes of a scene on a skeleton.

    scene: their scene.
    worlds: model -> its world matrix (4, 4) in the rest pose.
    rows: joint -> its number.
    """

    def __init__(self, scene: FbxScene, worlds: Mapping[Id, FloatArray], rows: Mapping[Id, int]) -> None:
        self.scene, self.worlds, self.rows = scene, worlds, rows
        self._to_metres = scene.metres * scene.axes

    def all(self) -> list[list[tuple[Id | None, MeshPart]]]:
        """Return each mesh that joints carry, split into parts by material, None for none, in metres, Y up."""
        objects = self.scene.objects
        pairs = ((key, geometry) for key in self.scene.order for geometry, _ in objects.on(key, "Geometry", "Mesh"))
        return [parts for key, geometry in pairs if (parts := self._parts(key, geometry))]

    def _parts(self, key: Id, geometry: Id) -> list[tuple[Id | None, MeshPart]]:
        """Split a model's mesh by its materials."""
        objects, record = self.scene.objects, self.scene.objects.records[geometry]
        positions, index = record.numbers("Vertices").reshape(-1, 3), record.numbers("PolygonVertexIndex")
        # Counted again for each model that shares the mesh.
        record.budget.take(_VERTEX_BYTES * len(positions) + _CORNER_BYTES * len(index))
        carried = self._read_skinning(key, geometry, len(positions))
        if carried is None:
            return []
        blend, joints, weights = carried
        placed = np.einsum("vab,vb->va", blend[:, :, :3], positions) + blend[:, :, 3]
        vertex, corners, polygons = _triangles(index)
        if len(vertex) and vertex.max() >= len(positions):
            raise InputError(f"a mesh of {len(positions)} vertices has triangles of others")
        if len(corners) and np.linalg.det(self._to_metres @ blend[vertex[0], :, :3]) < 0.0:
            corners = corners[:, ::-1]
        uvs, uv_of = _uvs(record, vertex)
        materials = [material for material, _ in objects.on(key, "Material")]
        number = _materials(record, polygons)
        parts = []
        for n in np.unique(number):
            part_corners = corners[number == n]
            pairs = vertex[part_corners] * (uv_of.max() + 1) + uv_of[part_corners]
            _, first, triangles = np.unique(pairs, return_index=True, return_inverse=True)
            used, uv = vertex[part_corners].ravel()[first], uv_of[part_corners].ravel()[first]
            vertices, triangles = placed[used] @ self._to_metres.T, triangles.reshape(-1, 3)
            part = MeshPart(
                self.scene.models[key].name, (1.0, 1.0, 1.0), vertices, normals(vertices, triangles), triangles,
                joints[used], weights[used], self._morphs(geometry, used, blend),
                None if uvs is None else uvs[uv] * [1.0, -1.0] + [0.0, 1.0],
            )  # fmt: skip
            parts.append((materials[n] if n < len(materials) else None, part))
        return parts

    def _read_skinning(self, key: Id, geometry: Id, n: int) -> tuple[FloatArray, Rows, FloatArray] | None:
        """Return, for N vertices, the matrices (N, 3, 4) to the rest pose, and the joints and weights (N, 4) that carry
        them; None if no joint does.
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
        mesh_matrix = _geometric(self.scene, key)
        matrices, rows, vertices, weights, which = [self.worlds[key] @ mesh_matrix], [row], [], [], []
        for cluster in clusters:
            record = objects.records[cluster]
            to_bone, (bone, *_) = record.numbers("Transform"), [*(b for b, _ in objects.on(cluster, "Model")), None]
            if bone not in self.rows or len(to_bone) != 16:
                continue
            vertices.append(record.numbers("Indexes").astype(np.int64))
            weights.append(record.numbers("Weights")[: len(vertices[-1])])
            which.append(np.full(len(vertices[-1]), len(rows)))
            matrices.append(self.worlds[bone] @ to_bone.reshape(4, 4).T @ mesh_matrix)
            rows.append(self.rows[bone])
        clusters_of, kept_weights = _heaviest(vertices, weights, which, n)
        blend = np.zeros((n, 3, 4))
        for k in range(N_JOINTS):
            blend += kept_weights[:, k, None, None] * np.array(matrices)[clusters_of[:, k], :3]
        return blend, np.array(rows)[clusters_of] * (kept_weights > 0.0), kept_weights

    def _morphs(self, geometry: Id, used: Rows, blend: FloatArray) -> dict[str, tuple[Rows, FloatArray]]:
        """Return the blend shapes of a mesh on its vertices ``used`` (V,), which may repeat."""
        objects, order = self.scene.objects, np.argsort(used, kind="stable")
        ordered = used[order]
        morphs: dict[str, tuple[Rows, FloatArray]] = {}
        for deformer, _ in objects.on(geometry, "Deformer", "BlendShape"):
            for channel, _ in objects.on(deformer, "Deformer", "BlendShapeChannel"):
                shapes = [objects.records[shape] for shape, _ in objects.on(channel, "Geometry", "Shape")]
                if not shapes:
                    continue
                index = shapes[-1].numbers("Indexes").astype(np.int64)  # the last is the shape at full strength
                shapes[-1].budget.take(_MOVE_BYTES * len(index))
                index, unique_rows = np.unique(index, return_index=True)
                moves = shapes[-1].numbers("Vertices").reshape(-1, 3)[unique_rows]
                first, end = (np.searchsorted(ordered, index, side) for side in ("left", "right"))
                counts = end - first
                each = np.repeat(np.arange(len(index)), counts)
                rows = order[np.arange(len(each)) + np.repeat(first - np.cumsum(counts) + counts, counts)]
                linear = np.einsum("vab,vb->va", blend[index[each], :, :3], moves[each])
                morphs.setdefault(name_of(objects.records[channel].values[1]), (rows, linear @ self._to_metres.T))
        return morphs


def _geometric(scene: FbxScene, key: Id) -> FloatArray:
    """Return a model's geometric matrix (4, 4), which applies to its mesh only."""
    model, matrix = scene.models[key], np.eye(4)
    turned = rotation.to_matrix(quats(model.vector("GeometricRotation"), "XYZ"))
    matrix[:3, :3], matrix[:3, 3] = turned * model.vector("GeometricScaling", 1.0), model.vector("GeometricTranslation")
    return matrix


def _heaviest(
    vertices: Sequence[Rows], weights: Sequence[FloatArray], which: Sequence[Rows], n: int
) -> tuple[Rows, FloatArray]:
    """Return the clusters (N, 4) with the largest weights of each vertex, and the weights, which sum to 1; cluster 0 if
    a vertex has none.

    vertices, weights, which: vertices of each cluster, their weights, and the cluster's number.
    """
    clusters, kept_weights = np.zeros((n, N_JOINTS), np.int64), np.zeros((n, N_JOINTS))
    if vertices:
        vertex, weight, cluster = (np.concatenate(parts) for parts in (vertices, weights, which))
        if len(vertex) and (vertex.min() < 0 or vertex.max() >= n):
            raise InputError(f"a skin carries vertices that are none of {n}")
        order = np.lexsort((-weight, vertex))
        vertex, weight, cluster = vertex[order], weight[order], cluster[order]
        rank = np.arange(len(vertex)) - np.searchsorted(vertex, vertex)
        taken = (rank < N_JOINTS) & (weight > 0.0)
        clusters[vertex[taken], rank[taken]], kept_weights[vertex[taken], rank[taken]] = cluster[taken], weight[taken]
    kept_weights[kept_weights.sum(axis=1) == 0.0, 0] = 1.0
    return clusters, kept_weights / kept_weights.sum(axis=1, keepdims=True)


def _triangles(index: FloatArray) -> tuple[Rows, Rows, Rows]:
    """Triangulate polygons: return the vertices (C,) of all corners, and the corners (F, 3) and polygon (F,) of each
    triangle. In ``index``, the last corner of a polygon is the complement of its vertex.
    """
    corners = index.astype(np.int64)
    ends = np.flatnonzero(corners < 0)
    starts = np.append(0, ends[:-1] + 1)[: len(ends)]
    counts = np.maximum(ends - starts - 1, 0)
    polygons = np.repeat(np.arange(len(ends)), counts)
    second = starts[polygons] + np.arange(len(polygons)) - np.repeat(np.cumsum(counts) - counts, counts) + 1
    return np.where(corners < 0, ~corners, corners), np.stack([starts[polygons], second, second + 1], axis=1), polygons


def _uvs(record: Record, vertex: Rows) -> tuple[FloatArray | None, Rows]:
    """Return a mesh's texture coordinates (N, 2), None for none, and the row (C,) of each corner."""
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
    """Return the material number (F,) of each triangle from its polygon (F,)."""
    layer = record.find("LayerElementMaterial")
    rows = np.zeros(1, np.int64) if layer is None else np.maximum(layer.numbers("Materials").astype(np.int64), 0)
    return rows[polygons] if len(rows) > polygons.max(initial=0) > 0 else np.full(len(polygons), rows[:1].sum())


_KINDS = {b"\x89PNG": "image/png", b"\xff\xd8\xff": "image/jpeg"}
"""First bytes of a picture -> its media type, of the kinds that glTF holds."""
_COLOURS = ("diffuse", "basecolor", "base_color")
"""Parts of the property names of a material's colour."""


def as_glb(content: bytes, file: str, folder: Path | None, limits: ReadLimits = DEFAULT_LIMITS) -> bytes:
    """Convert an FBX avatar to the bytes of a .glb; ``folder``: the folder of its texture files, None for none.

    Raises ``FormatError`` if it has no bones or is of version 6, and the errors that its content causes.
    """
    more = _PACKED * min(limits.growth * len(content), limits.free_bytes)
    scene = FbxScene(content, file, replace(limits, free_bytes=limits.free_bytes + more))
    if scene.objects.has_old_takes:
        what = "is of version 6, whose meshes are not read; FBX2glTF (npm: fbx2gltf, free) makes a .glb of it"
        raise FormatError(what, file=file)
    order = [key for joints in scene.skeletons() for key in joints]
    if not order:
        raise FormatError("is no avatar: it holds no bones", file=file)
    return _AvatarDocument(scene, order, folder, limits).content()


class _AvatarDocument:
    """A glTF document under construction, of a scene; ``order``: its joints, parents first."""

    def __init__(self, scene: FbxScene, order: list[Id], folder: Path | None, limits: ReadLimits) -> None:
        self.scene, self.order, self.folder, self.limits = scene, order, folder, limits
        self.rows = {key: row for row, key in enumerate(order)}
        self.writer = DocumentWriter()
        self._materials: dict[Id | None, int] = {}

    def content(self) -> bytes:
        """Return the bytes of the document."""
        writer, worlds = self.writer, _rest_worlds(self.scene, self.rows)
        for name in unique([self.scene.models[key].name for key in self.order]):
            writer.node(name)
        writer.scene(0)
        writer.skin(range(len(self.order)), *self._place(worlds), None)
        for parts in FbxMeshes(self.scene, worlds, self.rows).all():
            names = list(parts[0][1].morphs)
            primitives = [writer.primitive([part], 1.0, names, self._material(key)) for key, part in parts]
            writer.add_mesh(parts[0][1].name, primitives, names)
        document = writer.finish("", 1.0)
        document.animations = []
        return b"".join(document.save_to_bytes())

    def _place(self, worlds: dict[Id, FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Place the joints at rest; returns the matrices (J, 3, 3) that turn the world's axes to theirs, and their
        positions (J, 3).
        """
        matrices = np.stack([worlds[key] for key in self.order])
        nearest_quats = [nearest_rotation(matrix[:3, :3]) for matrix in matrices]
        quats = np.array([rotation.IDENTITY if quat is None else quat for quat in nearest_quats])
        self.scene.to_axes(quats)
        positions = self.scene.metres * matrices[:, :3, 3] @ self.scene.axes.T
        nodes, parents = self.writer.gltf.nodes, self.scene.parent_rows(self.order)
        for row, above in enumerate(parents):
            below = rotation.inverse(quats[above] if above >= 0 else rotation.IDENTITY)
            nodes[row].translation = rotation.rotate(
                below, positions[row] - (positions[above] if above >= 0 else 0.0)
            ).tolist()
            nodes[row].rotation = rotation.normalize(rotation.multiply(below, quats[row])).tolist()
            if above >= 0:
                nodes[above].children.append(row)
        tops = np.flatnonzero(parents < 0).tolist()
        if len(tops) > 1:  # several trees: hung below one more node, as a skeleton has one root
            above = self.scene.parents.get(self.order[tops[0]])
            name = "Root" if above is None else self.scene.models[above].name
            self.writer.node(unique([*(node.name for node in nodes), name])[-1])
            nodes[-1].children, tops = tops, [len(nodes) - 1]
        self.writer.gltf.scenes[0].nodes = tops
        return rotation.to_matrix(rotation.inverse(quats)), positions

    def _material(self, key: Id | None) -> int:
        """Return the number of a material, added if it is new."""
        if key not in self._materials:
            record = None if key is None else self.scene.objects.records[key]
            numbers = {} if record is None else self.scene.objects.numbers_of(record)
            colour = numbers.get("DiffuseColor", numbers.get("Diffuse", np.ones(3)))[:3]
            surface = PbrMetallicRoughness(metallicFactor=0.0, roughnessFactor=0.8)
            surface.baseColorFactor = [*np.clip(colour, 0.0, 1.0).tolist(), 1.0]
            material = Material(pbrMetallicRoughness=surface, doubleSided=True)
            if record is not None and key is not None:
                material.name = name_of(record.values[1])
                self._add_texture(key, material, surface)
            self.writer.gltf.materials.append(material)
            self._materials[key] = len(self.writer.gltf.materials) - 1
        return self._materials[key]

    def _add_texture(self, key: Id, material: Material, surface: PbrMetallicRoughness) -> None:
        """Give a material its picture, if it has one of a kind that glTF holds."""
        textures = [*self.scene.objects.on(key, "Texture")]
        for texture, what in textures:
            picture = self._picture(texture) if any(part in what.lower() for part in _COLOURS) else b""
            kind = next((kind for begin, kind in _KINDS.items() if picture.startswith(begin)), "")
            if kind:
                gltf = self.writer.gltf
                view = self.writer.view(np.frombuffer(picture, np.uint8))
                gltf.images.append(Image(bufferView=view, mimeType=kind))
                gltf.textures.append(Texture(source=len(gltf.images) - 1))
                surface.baseColorTexture = TextureInfo(index=len(gltf.textures) - 1)
                surface.baseColorFactor = [1.0] * 4
                if any("transparen" in property_name.lower() for _, property_name in textures):
                    material.alphaMode, material.alphaCutoff = "MASK", 0.5
                return

    def _picture(self, texture: Id) -> bytes:
        """Return the bytes of a texture's picture, from the file or a file in its folder; empty if it is missing."""
        records = [self.scene.objects.records[texture]]
        records += [self.scene.objects.records[video] for video, _ in self.scene.objects.on(texture, "Video")]
        for record in reversed(records):
            content: Any = next(iter(content_record.values if (content_record := record.find("Content")) else ()), b"")
            if isinstance(content, bytes) and content:
                return content
        names = [str(name_record.values[0]) for record in records for name in ("RelativeFilename", "FileName")
                 if (name_record := record.find(name)) is not None and name_record.values]  # fmt: skip
        for name in names:
            if self.folder is None:
                continue
            path = (self.folder / name.replace("\\", "/").rpartition("/")[2]).resolve()
            if path.is_relative_to(self.folder.resolve()) and path.is_file():
                return read_bytes(path, self.limits.file_bytes)
        return b""


def _rest_worlds(scene: FbxScene, joints: dict[Id, int]) -> dict[Id, FloatArray]:
    """Return model -> world matrix (4, 4) at rest: joints in their bind pose, other models relative to them."""
    still, transforms, rest = Take("", (0.0, 0.0), ()), dict[Id, Transforms](), dict[Id, FloatArray]()
    turned, worlds = dict[Id, FloatArray](), dict[Id, FloatArray]()  # as the file has them
    for key in scene.order:
        above = scene.parents.get(key)
        local = transforms[key] = scene.transforms(
            key, still, np.zeros(1), None if above is None else transforms[above]
        )
        turned[key], worlds[key] = rotation.to_matrix(local.quats[0]), np.eye(4)
        worlds[key][:3, 3] = local.positions[0]
        if above is not None:
            worlds[key][:3, 3] = worlds[above][:3, 3] + turned[above] @ local.positions[0]
            turned[key] = turned[above] @ turned[key]
        worlds[key][:3, :3] = turned[key] @ local.scaling[0]
        bound = scene.binds.get(key) if key in joints and key in scene.bound else None
        carried = worlds[key] if above is None else rest[above] @ np.linalg.inv(worlds[above]) @ worlds[key]
        rest[key] = carried if bound is None else bound
    return rest
