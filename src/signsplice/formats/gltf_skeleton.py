"""What readers of glTF skeletons share: the roles of VRM humanoids, the order of joints, and poses of nodes at rest."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence, Set
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from signsplice.errors import LimitError
from signsplice.formats.gltf_document import VRM_ANIMATION, Document, Fields
from signsplice.formats.limits import ReadLimits
from signsplice.motion import rotation
from signsplice.motion.arrays import FloatArray
from signsplice.rig.roles import ROLES

EVEN = 1e-3
"""Scales along three axes, or over time, that differ by less than this fraction are equal."""
VRM_0, VRM_1 = "VRM", "VRMC_vrm"
"""The glTF extensions of VRM avatars, version 0.x and 1.0."""
_LENGTH, _ROW = 0.05, 1e-5
"""By how much the length of a stored rotation may differ from 1, which is below 0.02 in 8 bits, and the numbers of a
matrix's last row from 0, 0, 0, 1.
"""
_THUMBS = {"ThumbProximal": "ThumbMetacarpal", "ThumbIntermediate": "ThumbProximal"}
"""Bones of a thumb in VRM 0.x -> their roles in VRM 1.0."""


class SkeletonDocument(Document):
    """A document whose skeleton is being read.

    scales: node -> scale (3,), where an animation sets it.
    skins: those of the document, whose joints are nodes.
    """

    def __init__(self, file: str, content: bytes, limits: ReadLimits, folder: Path | None) -> None:
        super().__init__(file, content, limits, folder)
        self.scales: dict[int, FloatArray] = {}
        self.skins: list[Fields] = self._field(self.json, "skins", [], "the document")
        for number, skin in enumerate(self.skins):
            for joint in self._field(skin, "joints", [], f"skin {number}"):
                self._row(self.nodes, joint, "joint")

    def _humanoid(self) -> dict[str, int]:
        """Role -> node of a VRM humanoid; empty where there is none."""
        extensions = self._field(self.json, "extensions", {}, "the document")
        name = next((name for name in (VRM_ANIMATION, VRM_1) if extensions.get(name) is not None), VRM_0)
        humanoid = self._field(self._field(extensions, name, {}, "extensions"), "humanoid", {}, name)
        bones = self._field(humanoid, "humanBones", [] if name == VRM_0 else {}, name)
        if name == VRM_0:
            roles = {_role_of_vrm_0(bone["bone"]): bone["node"] for bone in bones}
        else:
            roles = {role: bone["node"] for role, bone in bones.items()}
        roles = {role: node for role, node in roles.items() if role in ROLES}
        if len(set(roles.values())) < len(roles):
            raise self._error("its humanoid has one node in two roles")
        for node in roles.values():
            self._row(self.nodes, node, "joint")
        return roles

    def _joint_order(self, joints: Set[int], animated: Collection[int] = ()) -> list[int]:
        """The joints and the nodes between them, parents first. Raises ``LimitError`` where there are too many.

        The root is the nearest common ancestor of all joints, or the highest animated node above it.
        """
        n_below = [int(node in joints) for node in range(len(self.nodes))]  # joints at or below each node
        for node in reversed(self.order):
            if node in self.parents:
                n_below[self.parents[node]] += n_below[node]
        above_all = [node for node in self.order if n_below[node] == len(joints)]  # a path from the root down
        if not above_all:
            raise self._error("its joints hang from several roots, expected one skeleton")
        root = next((node for node in above_all if node in animated), above_all[-1])
        order = [node for node in self._subtree(root) if n_below[node]]
        if len(order) > self.limits.joints:
            what = f"{len(order):,} joints, expected at most {self.limits.joints:,.0f}"
            raise LimitError(what, file=self.file)
        return order

    def _bind_matrices(self, skin: Fields) -> FloatArray | None:
        """The matrices (B, 4, 4) that take a skin's mesh to the axes of its joints; None where it has none."""
        if skin.get("inverseBindMatrices") is None:
            return None
        n_joints = len(skin["joints"])
        matrices = self._affine(self._values(skin["inverseBindMatrices"])[:n_joints], "an inverse bind matrix")
        if len(matrices) < n_joints or not np.isfinite(matrices).all():
            raise self._error(f"a skin binds {n_joints} joints with {len(matrices)} valid matrices")
        return matrices

    def _affine(self, columns: FloatArray, what: str) -> FloatArray:
        """Matrices (N, 4, 4) that are stored by columns (N, 16). Raises ``FormatError`` where one projects."""
        matrices = columns.reshape(-1, 4, 4).transpose(0, 2, 1)
        wrong = matrices[np.abs(matrices[:, 3] - [0.0, 0.0, 0.0, 1.0]).max(axis=1) > _ROW]
        if len(wrong):
            raise self._error(f"{what} has the last row {wrong[0, 3].tolist()}, expected 0, 0, 0, 1")
        return matrices

    def _check_rotations(self, quats: FloatArray, what: str) -> None:
        """Raise ``FormatError`` where quaternions (..., 4) are no rotations, for their length is not 1."""
        lengths = np.linalg.norm(quats, axis=-1)
        wrong = lengths[~(np.abs(lengths - 1.0) <= _LENGTH)]
        if len(wrong):
            raise self._error(f"{what}: a rotation has length {wrong[0]:.3g}, expected 1; export the file anew")

    def _named(self, node: int) -> str:
        return f"node {self.nodes[node].get('name') or node!r:.80}"

    def _stored_matrix(self, node: int) -> FloatArray | None:
        """The matrix (4, 4) of a node that is stored as one, else None."""
        if self.nodes[node].get("matrix") is None:
            return None
        columns = np.array(self._field(self.nodes[node], "matrix", (0.0,) * 16, self._named(node)), np.float64)
        return self._affine(columns, f"the matrix of {self._named(node)}").reshape(4, 4)

    def _stored_pose(self, node: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position (3,), rotation (4,) and scale (3,) of a node that is stored without a matrix."""
        defaults = (("translation", (0.0,) * 3), ("rotation", (0.0, 0.0, 0.0, 1.0)), ("scale", (1.0,) * 3))
        position, quat, scale = (
            np.array(self._field(self.nodes[node], name, default, self._named(node)), np.float64)
            for name, default in defaults
        )
        self._check_rotations(quat[None], self._named(node))
        return position, rotation.normalize(quat), scale

    def _local_pose(self, node: int) -> tuple[FloatArray, FloatArray, float]:
        """A node's own position (3,), rotation (4,) and scale at rest, relative to its parent."""
        matrix, named = self._stored_matrix(node), self._named(node)
        if matrix is not None:
            scale = np.linalg.norm(matrix[:3, :3], axis=0)
            axes = matrix[:3, :3] / np.where(scale == 0.0, 1.0, scale)
            if not (np.linalg.det(axes) > 0.0 and np.abs(axes.T @ axes - np.eye(3)).max() <= EVEN):
                raise self._error(f"the matrix of {named} mirrors or shears, expected rotation and even scale")
            position, quat = matrix[:3, 3], rotation.from_matrix(axes)
        else:
            position, quat, scale = self._stored_pose(node)
        scale = self.scales.get(node, scale)
        if not (scale.min() > 0.0 and np.ptp(scale) <= EVEN * scale.max()):
            raise self._error(f"{named} is scaled by {scale.tolist()}, expected one positive number")
        return position, quat, float(scale.mean())

    def _world_pose(self, node: int | None) -> tuple[FloatArray, FloatArray, float]:
        """Position (3,), rotation (4,) and scale of a node in the world at rest; the identity for None."""
        position, quat, scale = np.zeros(3), rotation.IDENTITY, 1.0
        for ancestor in reversed([] if node is None else self._path_to_root(node)):
            local_position, local_quat, local_scale = self._local_pose(ancestor)
            position = position + rotation.rotate(quat, scale * local_position)
            quat, scale = rotation.multiply(quat, local_quat), scale * local_scale
        return position, quat, scale


def _role_of_vrm_0(bone: str) -> str:
    """The role, a name of VRM 1.0, of a bone as VRM 0.x names it."""
    for old, new in _THUMBS.items():
        if bone.endswith(old):
            return bone.removesuffix(old) + new
    return bone


def printable(name: Any, otherwise: str) -> str:
    """A name as text that can be written to any file."""
    return (name.encode("utf-8", "replace").decode() if isinstance(name, str) else "") or otherwise


def unique(names: Sequence[str]) -> list[str]:
    """The names; one that is already taken gets a number."""
    out: list[str] = []
    taken, used = set(names), set()
    numbers: dict[str, Iterator[int]] = {}
    for name in names:
        unique = name
        if name in used:
            counter = numbers.setdefault(name, count(2))
            unique = next(numbered for n in counter if (numbered := f"{name} {n}") not in taken)
            taken.add(unique)
        used.add(unique)
        out.append(unique)
    return out
