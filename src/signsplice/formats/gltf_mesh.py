"""Meshes of glTF files in the rest pose of their nodes, carried by the joints of a skeleton, and which vertices are
skin rather than hair, skirts or accessories.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from signsplice.body.mesh_part import N_JOINTS, MeshPart
from signsplice.body.skin_points import SkinPoints
from signsplice.formats.gltf_document import Fields
from signsplice.formats.gltf_skeleton import VRM_0, SkeletonDocument
from signsplice.motion import rotation

Float = NDArray[np.float64]

_TRIANGLES = 4
_DRACO = "KHR_draco_mesh_compression"
_VERTEX_BYTES = 400
"""Memory that a vertex takes while it is read."""
_LOOSE = {
    *("hair", "ahoge", "bangs", "ponytail", "twintail", "braid", "wig", "eyelash", "eyelashes", "lash", "lashes"),
    *("skirt", "cape", "cloak", "coat", "scarf", "ribbon", "bow", "necktie", "tail", "wing", "horn", "outline"),
    *("hat", "cap", "hood", "helmet", "glasses", "goggles", "mask", "earring", "earrings", "necklace", "accessory"),
    *("accessories", "acc", "weapon", "bag", "backpack"),
}
"""Words in the names of what is no skin: of joints without a role, meshes, nodes and materials."""
_SOFT = {
    *("bust", "breast", "breasts", "boob", "boobs", "oppai", "mune", "chichi", "butt", "hip", "hips", "belly"),
    *("twist", "roll", "muscle", "helper"),
}
"""Words in the names of joints without a role that carry skin, though a spring may move them."""
_LOOSE_SIGNS, _SOFT_SIGNS = ("髪", "スカート", "リボン", "帽", "眼鏡"), ("胸", "乳")
_WORD = re.compile("[A-Z]?[a-z]+|[A-Z]+")


def words(name: str) -> frozenset[str]:
    """The words of a name in lower case: "J_Sec_HairBack1" has j, sec, hair and back."""
    return frozenset(word.lower() for word in _WORD.findall(name))


def is_loose(name: str) -> bool:
    """Whether a name is that of hair, clothing that hangs, or an accessory."""
    return bool(words(name) & _LOOSE) or any(sign in name for sign in _LOOSE_SIGNS)


class MeshReader(SkeletonDocument):
    """A document whose meshes are being read."""

    def world(self, node: int) -> Float:
        """The matrix (4, 4) of a node in the world at rest."""
        if node not in self._worlds:
            for each in reversed(self._path_to_root(node)):
                if each not in self._worlds:
                    above = self.parents.get(each)
                    self._worlds[each] = (np.eye(4) if above is None else self._worlds[above]) @ self._matrix(each)
        return self._worlds[node]

    @cached_property
    def _worlds(self) -> dict[int, Float]:
        return {}

    def _matrix(self, node: int) -> Float:
        fields = self.nodes[node]
        if fields.get("matrix"):
            matrix = np.array(fields["matrix"], np.float64).reshape(4, 4).T
        else:
            matrix = np.eye(4)
            quat = rotation.normalize(np.array(fields.get("rotation") or [0.0, 0.0, 0.0, 1.0], np.float64).reshape(4))
            scale = np.array(fields.get("scale") or [1.0, 1.0, 1.0], np.float64).reshape(3)
            matrix[:3, :3] = rotation.to_matrix(quat) * scale
            matrix[:3, 3] = fields.get("translation") or [0.0, 0.0, 0.0]
        if not np.isfinite(matrix).all():
            raise self._error(f"node {node}: a number is not finite")
        return matrix

    def skin(
        self, rows: Mapping[int, int], turn: Float, origin: Float
    ) -> tuple[tuple[MeshPart, ...], SkinPoints | None]:
        """The meshes that joints carry, and their vertices that are skin, None where there are none.

        rows: joint node -> row of the skeleton. Positions are turned by ``turn`` (3, 3), and relative to ``origin``.
        """
        self._rows_of = rows
        parts: list[MeshPart] = []
        skin: list[NDArray[np.bool_]] = []
        self._n_vertices = 0
        for node, fields in enumerate(self.nodes):
            if fields.get("mesh") is None:
                continue
            mesh = self._row(self.json.get("meshes"), fields["mesh"], "mesh")
            bones = self._bones(node)
            if bones is None:
                continue
            for primitive in mesh["primitives"]:
                if (primitive.get("mode", _TRIANGLES)) != _TRIANGLES or primitive.get("indices") is None:
                    continue
                names = (str(mesh.get("name")), str(fields.get("name")), self._material(primitive)[0])
                part, is_skin = self._part(primitive, bones, turn, origin)
                parts.append(part)
                skin.append(is_skin & (not any(map(is_loose, names))))
        kept = [mask for mask in skin if mask.any()]
        if not kept:
            return tuple(parts), None
        counts = np.concatenate([[0], np.cumsum([len(part.vertices) for part in parts])])
        row = np.cumsum(np.concatenate(skin)) - 1
        triangles = np.concatenate([part.triangles + k for part, k in zip(parts, counts[:-1], strict=True)])
        triangles = row[triangles[np.concatenate(skin)[triangles].all(axis=1)]]
        masked = list(zip(parts, skin, strict=True))
        vertices, weights = (
            np.concatenate([getattr(part, name)[mask] for part, mask in masked]) for name in ("vertices", "weights")
        )
        joints = np.concatenate([part.joints[mask] for part, mask in masked])
        return tuple(parts), SkinPoints(vertices, joints, weights, triangles)

    def _bones(self, node: int) -> tuple[Float, NDArray[np.int64], NDArray[np.bool_]] | None:
        """Of the joints that carry a node's mesh: matrices (B, 4, 4) to the rest pose, rows of the skeleton (B,), and
        whether they carry skin (B,). None for a mesh that hangs on no joint.
        """
        number = self.nodes[node].get("skin")
        if number is None:
            joints, matrices = [node], self.world(node)[None]
        else:
            skin = self._row(self.json.get("skins"), number, "skin")
            joints = skin["joints"]
            bind = np.tile(np.eye(4), (len(joints), 1, 1))
            if skin.get("inverseBindMatrices") is not None:
                bind = self._values(skin["inverseBindMatrices"])[: len(joints)].reshape(-1, 4, 4).transpose(0, 2, 1)
            if len(bind) < len(joints) or not np.isfinite(bind).all():
                raise self._error(f"a skin binds {len(joints)} joints with {len(bind)} valid matrices")
            matrices = np.stack([self.world(joint) for joint in joints]) @ bind
        carried = [self._carrier(joint) for joint in joints]
        if number is None and carried[0][0] < 0:
            return None
        return matrices, np.array([max(row, 0) for row, _ in carried]), np.array([skin for _, skin in carried])

    def _carrier(self, node: int) -> tuple[int, bool]:
        """The row of the skeleton's joint at or above a node, -1 where there is none, and whether the node carries
        skin.
        """
        is_skin = True
        for each in self._path_to_root(node):
            if each in self._rows_of:
                return self._rows_of[each], is_skin
            name = str(self.nodes[each].get("name"))
            is_soft = bool(words(name) & _SOFT) or any(sign in name for sign in _SOFT_SIGNS)
            is_skin = is_skin and (is_soft or not (is_loose(name) or each in self._springs))
        return -1, False

    @cached_property
    def _springs(self) -> set[int]:
        """The nodes that springs move."""
        extensions = self.json.get("extensions") or {}
        springs = (extensions.get("VRMC_springBone") or {}).get("springs") or ()
        found = {joint["node"] for spring in springs for joint in spring.get("joints") or ()}
        groups = ((extensions.get(VRM_0) or {}).get("secondaryAnimation") or {}).get("boneGroups") or ()
        return found | {bone for group in groups for bone in group.get("bones") or ()}

    def _material(self, primitive: Fields) -> tuple[str, tuple[float, float, float]]:
        """Name and colour, sRGB 0 to 1, of a primitive's material."""
        number = primitive.get("material")
        material = {} if number is None else self._row(self.json.get("materials"), number, "material")
        factor = (material.get("pbrMetallicRoughness") or {}).get("baseColorFactor") or [1.0] * 4
        linear = np.clip(np.array(factor[:3], np.float64).reshape(3), 0.0, 1.0)
        red, green, blue = np.where(linear < 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055).tolist()
        return str(material.get("name")), (red, green, blue)

    def _part(
        self, primitive: Fields, bones: tuple[Float, NDArray[np.int64], NDArray[np.bool_]], turn: Float, origin: Float
    ) -> tuple[MeshPart, NDArray[np.bool_]]:
        """A primitive in the rest pose, and which of its vertices are skin (V,)."""
        if _DRACO in (primitive.get("extensions") or {}):
            raise self._error(f"its meshes are compressed by {_DRACO}, which is not read; export it without")
        attributes, (matrices, rows, is_skin) = primitive["attributes"], bones
        indices = self._values(primitive["indices"])[:, 0].astype(np.int64)
        used, triangles = np.unique(indices[: len(indices) // 3 * 3], return_inverse=True)
        self._n_vertices += len(used)
        self.limits.check_memory(
            f"{self._n_vertices:,} vertices", _VERTEX_BYTES * self._n_vertices, self.given_bytes, self.file
        )
        positions = self._values(attributes["POSITION"])
        if not len(used) or used[0] < 0 or used[-1] >= len(positions) or positions.shape[1] != 3:
            raise self._error(f"a mesh of {len(positions)} vertices has triangles of others")
        joints, weights = self._carried(attributes, used, len(rows))
        at = np.concatenate([positions[used], np.ones((len(used), 1))], axis=1)
        placed = np.zeros((len(used), 3))
        for k in range(joints.shape[1]):
            placed += weights[:, k, None] * np.einsum("vab,vb->va", matrices[joints[:, k], :3], at)
        if not np.isfinite(placed).all():
            raise self._error("a vertex is not finite")
        loose = (weights * ~is_skin[joints]).sum(axis=1)
        name, colour = self._material(primitive)
        vertices, triangles = (placed - origin) @ turn.T, triangles.reshape(-1, 3)
        part = MeshPart(name, colour, vertices, _normals(vertices, triangles), triangles, rows[joints], weights)
        return part, loose < 0.5

    def _carried(self, attributes: Fields, used: NDArray[np.int64], n_bones: int) -> tuple[NDArray[np.int64], Float]:
        """Rows of bones and weights (V, 4) of the vertices ``used``: the four that carry most."""
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


def _normals(vertices: Float, triangles: NDArray[np.int64]) -> Float:
    """Unit normals (V, 3) of vertices: of the triangles around them, by their area."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    across = np.cross(b - a, c - a)
    out = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(out, triangles[:, k], across)
    length = np.linalg.norm(out, axis=1, keepdims=True)
    return np.where(length > 0.0, out / np.where(length > 0.0, length, 1.0), [0.0, 1.0, 0.0])
