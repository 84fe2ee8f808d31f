"""Meshes of glTF files in the rest pose, carried by a skeleton's joints, and their vertices that are skin.

Skin is what joints with a role carry, or joints below them but for hair, skirts and the like. Names of meshes and nodes
decide nothing unless they are given; the name of a material can make its vertices doubtful (``body.skin``), or cloth.
"""

from __future__ import annotations

import base64
import re
from collections.abc import Mapping, Sequence, Set
from functools import cached_property
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from signsplice.body.capsules import N_JOINTS, FaceControl, MeshPart
from signsplice.body.skin_surface import SkinPoints
from signsplice.errors import InputError
from signsplice.formats.gltf_document import VRM_0, Fields, SkeletonDocument
from signsplice.formats.json_files import as_object
from signsplice.formats.reading import ReadLimits, read_bytes
from signsplice.motion import FloatArray, rotation

_TRIANGLES = 4
"""glTF's primitive mode for triangles."""
_IMAGES = {f".{kind}": f"image/{kind}" for kind in ("png", "jpeg", "webp", "ktx2")} | {".jpg": "image/jpeg"}
"""Suffix -> media type."""
_VERTEX_BYTES = 400
"""Bytes of memory counted for a vertex."""
_INDEX_BYTES = 64
"""Bytes of memory counted for an index of a triangle's corner: half of what reading may take, so that dense meshes
without textures pass.
"""
_PART_BYTES = 4000
"""Bytes of memory counted for a mesh part."""
_JOINT_BYTES = 400
"""Bytes of memory counted for a joint of a glTF skin."""
_LOOSE = {"hair", "skirt", "glasses", "hat", "cape", "tail", "wing", "outline"}
"""Words in names of materials that are doubtful skin, and of joints without a role that carry none."""
_CLOTH = {"cloth", "clothes", "clothing", "outfit", "tops", "shirt", "dress", "coat", "jacket", "sleeve"}
"""Words in names of materials that cover skin."""
_SKIN_JOINTS = {"bust", "breast", "breasts"}
"""Words in names of joints without a role that carry skin even if a spring moves them."""
_LOOSE_JAPANESE = ("髪", "スカート")
"""Japanese words with the meaning of ``_LOOSE``."""
_SKIN_JOINTS_JAPANESE = ("胸", "乳")
"""Japanese words with the meaning of ``_SKIN_JOINTS``."""
_WORD = re.compile("[A-Z]?[a-z]+|[A-Z]+")


def words(name: str) -> frozenset[str]:
    """Split a name into words in lower case: "J_Sec_HairBack1" has j, sec, hair and back."""
    return frozenset(word.lower() for word in _WORD.findall(name))


def is_loose(name: str, ignored: Set[str] = frozenset()) -> bool:
    """Whether a name, without ``ignored`` words, denotes hair, hanging clothing, or an accessory."""
    return bool((words(name) - ignored) & _LOOSE) or any(word in name for word in _LOOSE_JAPANESE)


_Bones = tuple[FloatArray, NDArray[np.int64], NDArray[np.bool_]]
"""Joints that carry a mesh: matrices (B, 4, 4) from the mesh's space to the rest pose, skeleton rows (B,), and whether
they carry skin (B,).
"""


class MeshReader(SkeletonDocument):
    """A document whose meshes are being read."""

    def __init__(self, file: str, content: bytes, limits: ReadLimits, folder: Path | None) -> None:
        super().__init__(file, content, limits, folder)
        self._worlds: dict[int, FloatArray] = {}
        self._triangles_of: dict[int, list[Fields]] = {}
        self._skins: dict[int, _Bones] = {}
        self._pictures: dict[int, bytes] = {}
        self.n_unread_parts = 0
        """Number of mesh parts that are not read: not triangles, or without indices."""

    def world(self, node: int) -> FloatArray:
        """Return the world matrix (4, 4) of a node at rest."""
        path = [node]
        while path[-1] not in self._worlds and path[-1] in self.parents:
            path.append(self.parents[path[-1]])
        for ancestor in reversed(path):
            if ancestor not in self._worlds:
                above = self.parents.get(ancestor)
                self._worlds[ancestor] = (np.eye(4) if above is None else self._worlds[above]) @ self._matrix(ancestor)
        return self._worlds[node]

    def _matrix(self, node: int) -> FloatArray:
        matrix = self._node_matrix(node)
        if matrix is None:
            position, quat, scale = self._node_trs(node)
            matrix = np.eye(4)
            matrix[:3, :3], matrix[:3, 3] = rotation.to_matrix(quat) * scale, position
        if not np.isfinite(matrix).all():
            raise self._error(f"node {node}: a number is not finite")
        return matrix

    def read_meshes(
        self,
        rows: Mapping[int, int],
        turn: FloatArray,
        origin: FloatArray,
        skin_names: Sequence[str] = (),
        face: Sequence[FaceControl] = (),
    ) -> tuple[tuple[MeshPart, ...], SkinPoints, NDArray[np.bool_]]:
        """Return the meshes that joints carry, their V vertices that joints with skin carry, and whether each of these
        (V,) is doubtful, by the name of its material.

        rows: joint node -> row of the skeleton. Positions are turned by ``turn`` (3, 3), and relative to ``origin``.
        skin_names: meshes, nodes and materials that are skin: all others are then cloth. If empty, names of materials
        tell what is cloth, unless they hold "skin". Raises ``InputError`` for a name that matches none.
        face: controls whose morph targets are read.
        """
        self._carriers = self._carriers_of(rows)
        self._mesh_bytes = 0
        parts: list[MeshPart] = []
        masks = [np.empty((3, 0), bool)]
        seen: set[str] = set()
        for node, fields in enumerate(self.nodes):
            if fields.get("mesh") is None:
                continue
            mesh = self._row(self.json.get("meshes"), fields["mesh"], "mesh")
            bones = self._bones(node)
            if bones is None:
                continue
            primitives = self._triangle_primitives(fields["mesh"])
            self.n_unread_parts += len(mesh["primitives"]) - len(primitives)
            for primitive in primitives:
                material = str(self._material(primitive).get("name"))
                names = {str(mesh.get("name")), str(fields.get("name")), material}
                moved = [
                    (control.name, index, weight) for control in face for n, index, weight in control.binds if n == node
                ]
                part, on_skin = self._part(primitive, bones, turn, origin, moved)
                parts.append(part)
                seen |= names
                is_named = not names.isdisjoint(skin_names)
                is_cloth = (
                    not is_named if skin_names else bool(words(material) & _CLOTH) and "skin" not in words(material)
                )
                flags = np.array([[True], [is_cloth], [is_loose(material) and not is_named]])
                masks.append(flags & on_skin)
        if unknown := [name for name in skin_names if name not in seen]:
            known = ", ".join(sorted(seen - {"None"}))  # "None": of what has no name
            raise InputError(
                f"{self.file}: {unknown[0]!r} is no mesh, node or material that joints carry: {known:.300}"
            )
        on_skin, is_cloth, is_doubtful = np.concatenate(masks, axis=1)
        return tuple(parts), _join_points(parts, is_cloth).where(on_skin), is_doubtful[on_skin]

    def _triangle_primitives(self, mesh: int) -> list[Fields]:
        """Return the primitives of a mesh that are indexed triangles."""
        if mesh not in self._triangles_of:
            self._triangles_of[mesh] = [
                primitive
                for primitive in self._field(self.json["meshes"][mesh], "primitives", list, f"mesh {mesh}")
                if self._field(primitive, "mode", _TRIANGLES, f"a primitive of mesh {mesh}") == _TRIANGLES
                and primitive.get("indices") is not None
            ]
        return self._triangles_of[mesh]

    def _bones(self, node: int) -> _Bones | None:
        """Return the joints that carry a node's mesh; None for a mesh without a joint."""
        number = self.nodes[node].get("skin")
        if number is None:
            row, carries_skin = self._carriers[node]
            return None if row < 0 else (self.world(node)[None], np.array([row]), np.array([carries_skin]))
        skin = self._row(self.skins, number, "skin")
        if number not in self._skins:
            self._skins[number] = self._bones_of_binding(skin)
        return self._skins[number]

    def _bones_of_binding(self, skin: Fields) -> _Bones:
        """Return the joints of a glTF skin, which binds a mesh to joints."""
        joints = skin["joints"]
        if len(joints) > len(self.nodes):
            raise self._error(f"a skin names {len(joints)} joints, of {len(self.nodes)} nodes")
        self._count(f"{len(joints):,} joints of a skin", _JOINT_BYTES * len(joints))
        matrices, bind = np.stack([self.world(joint) for joint in joints]), self._bind_matrices(skin)
        carried = [self._carriers[joint] for joint in joints]
        rows, carries_skin = (
            np.array([max(row, 0) for row, _ in carried]),
            np.array([carries for _, carries in carried]),
        )
        return matrices if bind is None else matrices @ bind, rows, carries_skin

    def _count(self, what: str, n_bytes: int) -> None:
        """Count memory of meshes. Raises ``LimitError`` if the total is too large."""
        self._mesh_bytes += n_bytes
        self.limits.check_memory(f"meshes up to {what}", self._mesh_bytes, self.given_bytes, self.file)

    def _carriers_of(self, rows: Mapping[int, int]) -> dict[int, tuple[int, bool]]:
        """Return node -> the skeleton row of the joint at or above it, -1 for none, and whether it carries skin."""
        carriers: dict[int, tuple[int, bool]] = {}
        common = frozenset[str]().union(*(words(str(self.nodes[node].get("name"))) for node in rows))
        for node in self.order:
            above = carriers.get(self.parents.get(node, -1), (-1, False))
            row, carries_skin = (rows[node], True) if node in rows else above
            if carries_skin and node not in rows:
                # A node with a mesh is no joint, and what joints with a role are called too names their rig.
                name = "" if self.nodes[node].get("mesh") is not None else str(self.nodes[node].get("name"))
                is_named = bool(words(name) & _SKIN_JOINTS) or any(word in name for word in _SKIN_JOINTS_JAPANESE)
                carries_skin = is_named or not (is_loose(name, common) or node in self._springs)
            carriers[node] = row, carries_skin
        return carriers

    @cached_property
    def _springs(self) -> set[int]:
        """The nodes moved by springs."""
        extensions = as_object(self.json.get("extensions"))
        springs = as_object(extensions.get("VRMC_springBone")).get("springs") or ()
        nodes = {joint["node"] for spring in springs for joint in as_object(spring).get("joints") or ()}
        groups = as_object(as_object(extensions.get(VRM_0)).get("secondaryAnimation")).get("boneGroups") or ()
        return nodes | {bone for group in groups for bone in as_object(group).get("bones") or ()}

    def _material(self, primitive: Fields) -> Fields:
        number = primitive.get("material")
        material: Fields = {} if number is None else self._row(self.json.get("materials"), number, "material")
        return material

    def _surface(self, primitive: Fields, used: NDArray[np.int64]) -> dict[str, Any]:
        """Return the fields of a ``MeshPart`` that its material sets, for the vertices ``used``."""
        material = self._material(primitive)
        surface = as_object(material.get("pbrMetallicRoughness"))
        factor = np.array((surface.get("baseColorFactor") or [1.0] * 4)[:4], np.float64)
        linear = np.clip(factor[:3].reshape(3), 0.0, 1.0)
        colour = np.where(linear < 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
        info, cutoff = as_object(surface.get("baseColorTexture")), 0.0
        if (mode := material.get("alphaMode")) in ("MASK", "BLEND"):
            least = material.get("alphaCutoff", 0.5) if mode == "MASK" else 0.5
            cutoff = float(least) / max(float(factor[3:].sum()), 1e-3)
        uvs, texture = primitive["attributes"].get(f"TEXCOORD_{info.get('texCoord', 0)}"), b""
        if info and uvs is not None:
            texture = self._texture(self._row(self.json.get("textures"), info.get("index"), "texture"))
        fields: dict[str, Any] = {"colour": tuple(colour.tolist()), "cutoff": cutoff, "texture": texture}
        if texture:
            shift = as_object(as_object(info.get("extensions")).get("KHR_texture_transform"))
            fields["uvs"] = self._values(uvs)[used] * (shift.get("scale") or 1.0) + (shift.get("offset") or 0.0)
        return {"name": str(material.get("name")), "both_sides": material.get("doubleSided") is True, **fields}

    def _texture(self, texture: Fields) -> bytes:
        """Return the encoded picture of a texture; empty if it is missing or of a kind that is not read."""
        number = as_object(as_object(texture.get("extensions")).get("EXT_texture_webp")).get("source")
        number = texture.get("source") if number is None else number
        if number is None:
            return b""
        if number not in self._pictures:
            image = self._row(self.json.get("images"), number, "image")
            if (view_number := image.get("bufferView")) is not None:
                view = self._row(self.json.get("bufferViews"), view_number, "bufferView")
                start = view.get("byteOffset", 0)
                self._pictures[number] = self._buffer(view.get("buffer"))[start : start + view["byteLength"]]
            elif str(image.get("uri")).startswith("data:"):
                self._pictures[number] = base64.b64decode(image["uri"].partition(",")[2])
            else:
                self._pictures[number] = (self.image_file(image) or ("", b""))[1]
        return self._pictures[number]

    def image_file(self, image: Fields) -> tuple[str, bytes] | None:
        """Return media type and bytes of an image file in the document's folder or below; None for any other image."""
        uri = image.get("uri")
        if self.folder is None or not isinstance(uri, str) or uri.startswith("data:"):
            return None
        path = (self.folder / unquote(uri)).resolve()
        kind = _IMAGES.get(path.suffix.lower())
        if kind is None or not path.is_relative_to(self.folder.resolve()) or not path.is_file():
            return None
        if uri not in self._files:
            self._files[uri] = read_bytes(path, self.limits.file_bytes - self.given_bytes)
            self.given_bytes += len(self._files[uri])
        return kind, self._files[uri]

    def _part(
        self,
        primitive: Fields,
        bones: _Bones,
        turn: FloatArray,
        origin: FloatArray,
        moved: Sequence[tuple[str, int, float]],
    ) -> tuple[MeshPart, NDArray[np.bool_]]:
        """Return a primitive in the rest pose, and the mask (V,) of its vertices that joints with skin carry.
        ``moved``: name of a morph, number of a morph target, and its weight in the morph.
        """
        attributes, (matrices, rows, carries_skin) = primitive["attributes"], bones
        # Counted for each part, even if parts share an accessor, or nodes a mesh.
        indices = self._values(primitive["indices"])[:, 0]
        self._count(f"{len(indices):,} indices", _PART_BYTES + _INDEX_BYTES * len(indices))
        used, triangles = np.unique(indices[: len(indices) // 3 * 3].astype(np.int64), return_inverse=True)
        self._count(f"{len(used):,} vertices", _VERTEX_BYTES * len(used))
        positions = self._values(attributes["POSITION"])
        if not len(used) or used[0] < 0 or used[-1] >= len(positions) or positions.shape[1] != 3:
            raise self._error(f"a mesh of {len(positions)} vertices has triangles of others")
        joints, weights = self._read_skinning(attributes, used, len(rows))
        blend = np.zeros((len(used), 3, 4))
        for k in range(joints.shape[1]):
            blend += weights[:, k, None, None] * matrices[joints[:, k], :3]
        placed = np.einsum("vab,vb->va", blend[..., :3], positions[used]) + blend[..., 3]
        if not np.isfinite(placed).all():
            raise self._error("a vertex is not finite")
        blend = turn @ blend[..., :3]
        vertices, triangles = (placed - origin) @ turn.T, triangles.reshape(-1, 3)
        morphs: dict[str, FloatArray] = {}
        targets = primitive.get("targets") or []
        for name, target, weight in moved:
            number: Any = as_object(targets[target]).get("POSITION") if target < len(targets) else None
            stored = {} if number is None else self._row(self.json.get("accessors"), number, "accessor")
            if stored.get("bufferView") is not None or stored.get("sparse") is not None:  # else all zero
                moves = weight * np.einsum("vab,vb->va", blend, self._values(number)[used])
                morphs[name] = morphs[name] + moves if name in morphs else moves
        part = MeshPart(
            vertices=vertices,
            normals=self._normals(attributes, used, blend, vertices, triangles),
            triangles=triangles,
            joints=rows[joints],
            weights=weights,
            morphs={name: (at, moves[at]) for name, moves in morphs.items()
                    if len(at := np.flatnonzero(moves.any(axis=1)))},
            **self._surface(primitive, used),
        )  # fmt: skip
        return part, (weights * ~carries_skin[joints]).sum(axis=1) < 0.5

    def _normals(
        self,
        attributes: Fields,
        used: NDArray[np.int64],
        blend: FloatArray,
        vertices: FloatArray,
        triangles: NDArray[np.int64],
    ) -> FloatArray:
        """Return the normals (V, 3) that a primitive stores, or those of its shape; ``blend``: (V, 3, 3) to the rest
        pose.
        """
        if attributes.get("NORMAL") is None:
            return normals(vertices, triangles)
        stored = np.einsum("vab,vb->va", blend, self._values(attributes["NORMAL"])[used])
        return np.asarray(stored / np.maximum(np.linalg.norm(stored, axis=1, keepdims=True), 1e-12))

    def _read_skinning(
        self, attributes: Fields, used: NDArray[np.int64], n_bones: int
    ) -> tuple[NDArray[np.int64], FloatArray]:
        """Return bone rows and weights (V, 4) of the vertices ``used``: the four largest weights."""
        sets = [n for n in range(4) if f"JOINTS_{n}" in attributes and f"WEIGHTS_{n}" in attributes]
        if not sets:
            return np.zeros((len(used), N_JOINTS), np.int64), np.tile([1.0, 0.0, 0.0, 0.0], (len(used), 1))
        joints, weights = (
            np.concatenate([self._values(attributes[f"{name}_{n}"])[used] for n in sets], axis=1)
            for name in ("JOINTS", "WEIGHTS")
        )
        weights = np.where(weights > 0.0, weights, 0.0)
        joints = np.where(weights > 0.0, joints, 0.0).astype(np.int64)
        if joints.shape != weights.shape or joints.min() < 0 or joints.max() >= n_bones:
            raise self._error(f"a vertex is carried by a joint that is none of the {n_bones} of its skin")
        order = np.argsort(-weights, axis=1, kind="stable")[:, :N_JOINTS]
        joints, weights = np.take_along_axis(joints, order, axis=1), np.take_along_axis(weights, order, axis=1)
        total = weights.sum(axis=1, keepdims=True)
        weights = np.where(total > 0.0, weights / np.where(total > 0.0, total, 1.0), [1.0, 0.0, 0.0, 0.0])
        return joints, weights


def _join_points(parts: Sequence[MeshPart], is_cloth: NDArray[np.bool_]) -> SkinPoints:
    """Return the V vertices of all parts; ``is_cloth``: (V,) whether each lies on clothing."""
    firsts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    vertices, weights = (
        np.concatenate([np.empty((0, n)), *(getattr(part, name) for part in parts)])
        for name, n in (("vertices", 3), ("weights", N_JOINTS))
    )
    joints = np.concatenate([np.empty((0, N_JOINTS), np.int64), *(part.joints for part in parts)])
    triangles = [part.triangles + first for part, first in zip(parts, firsts, strict=False)]
    return SkinPoints(vertices, joints, weights, np.concatenate([np.empty((0, 3), np.int64), *triangles]), is_cloth)


def normals(vertices: FloatArray, triangles: NDArray[np.int64]) -> FloatArray:
    """Return unit normals (V, 3) of vertices, averaged over adjacent triangles by area."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    area_normals = np.cross(b - a, c - a)
    vertex_normals = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(vertex_normals, triangles[:, k], area_normals)
    length = np.linalg.norm(vertex_normals, axis=1, keepdims=True)
    return np.where(length > 0.0, vertex_normals / np.where(length > 0.0, length, 1.0), [0.0, 1.0, 0.0])
