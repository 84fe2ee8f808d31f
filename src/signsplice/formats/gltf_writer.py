"""Shared by the writers of ``.glb`` and ``.vrma``: a glTF 2.0 document under construction, and the signer's placement.

Lengths are metres, up is +Y; the signer stands at the origin, soles at height 0, and faces +Z.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pygltflib
from numpy.typing import NDArray

from signsplice.body.capsules import MeshPart, body_capsules, capsule_ends
from signsplice.body.mesh import bind_pose
from signsplice.formats.gltf_document import FPS_EXTRA, GENERATOR, REPORT_EXTRA
from signsplice.motion import Clip, FloatArray, Skeleton, rotation
from signsplice.rig.align import Placement, place
from signsplice.rig.info import rig_info

Array = NDArray[Any]

_FLOAT = 5126
"""glTF component type: 32-bit float."""
_UBYTE = 5121
"""glTF component type: unsigned 8-bit integer."""
_USHORT = 5123
"""glTF component type: unsigned 16-bit integer."""
_UINT = 5125
"""glTF component type: unsigned 32-bit integer."""
_TYPES = {_FLOAT: np.float32, _UBYTE: np.uint8, _USHORT: np.uint16, _UINT: np.uint32}
_VERTICES = 34962
"""Target of buffer views of vertices: ARRAY_BUFFER."""
_INDICES = 34963
"""Target of buffer views of indices: ELEMENT_ARRAY_BUFFER."""


def in_front(clip: Clip) -> Clip:
    """Move the clip rigidly so that its signer stands at the origin, soles at 0, up +Y, and faces +Z."""
    ankles = np.array([0.0, sole_depth(clip.skeleton), 0.0])
    return place(clip, Placement(ankles, np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])))


def sole_depth(skeleton: Skeleton) -> float:
    """Return how far the mannequin's soles are below the foot joints, clip units; 0 if no feet are known."""
    joints = rig_info(skeleton).roles.joints
    feet = [joints[role] for role in ("leftFoot", "rightFoot") if role in joints]
    shape = body_capsules(skeleton)
    shoes = [n for n, part in enumerate(shape.parts) if part in ("leg", "shoe")]
    if not feet or not shoes:
        return 0.0
    rotations, positions = bind_pose(skeleton)
    starts, ends = capsule_ends(shape, rotation.to_matrix(rotations)[None], positions[None])
    low = min((points[0, shoes, 1] - shape.radii[shoes, k]).min() for k, points in enumerate((starts, ends)))
    return float(positions[feet, 1].mean() - low)


@dataclass
class DocumentWriter:
    """A glTF document under construction.

    gltf: the document.
    content: the bytes of its buffer so far.
    """

    gltf: pygltflib.GLTF2 = field(
        default_factory=lambda: pygltflib.GLTF2(
            asset=pygltflib.Asset(version="2.0", generator=GENERATOR),
            animations=[pygltflib.Animation(samplers=[], channels=[])],
            extensionsUsed=[],
            extensions={},
        )
    )
    content: bytearray = field(default_factory=bytearray)

    def node(self, name: str) -> int:
        """Add a node; returns its number."""
        self.gltf.nodes.append(pygltflib.Node(name=name, children=[]))
        return len(self.gltf.nodes) - 1

    def scene(self, root: int) -> None:
        """Create the only scene, which shows a node and its descendants."""
        self.gltf.scenes, self.gltf.scene = [pygltflib.Scene(nodes=[root])], 0

    def array(self, values: Array, kind: str, component: int, target: int | None = None, **bounds: Any) -> int:
        """Add an array to the buffer; returns the number of its accessor.

        kind: "SCALAR", "VEC3", ... component: glTF's number of the component type. bounds: further fields of the
        accessor, such as ``min`` and ``max``.
        """
        values = np.ascontiguousarray(values, _TYPES[component])
        view = self.view(values, target)
        accessor = pygltflib.Accessor(bufferView=view, componentType=component, count=len(values),
                            type=kind, **bounds)  # fmt: skip
        self.gltf.accessors.append(accessor)
        return len(self.gltf.accessors) - 1

    def view(self, values: Array, target: int | None = None) -> int:
        """Add an array to the buffer; returns the number of its view."""
        self.content += b"\0" * (-len(self.content) % 4)
        view = pygltflib.BufferView(buffer=0, byteOffset=len(self.content), byteLength=values.nbytes, target=target)
        self.gltf.bufferViews.append(view)
        self.content += values.tobytes()
        return len(self.gltf.bufferViews) - 1

    def skin(self, joints: Sequence[int], to_joint: FloatArray, positions: FloatArray, root: int | None) -> None:
        """Add a skin of joint nodes, bound at ``positions`` (J, 3), with matrices ``to_joint`` (J, 3, 3) from the
        world's axes to theirs.
        """
        inverse_bind = np.tile(np.eye(4), (len(positions), 1, 1))
        inverse_bind[:, :3, :3] = to_joint
        inverse_bind[:, :3, 3] = -np.einsum("jab,jb->ja", to_joint, positions)
        matrices = self.array(inverse_bind.transpose(0, 2, 1).reshape(-1, 16), "MAT4", _FLOAT)
        self.gltf.skins = [pygltflib.Skin(joints=list(joints), inverseBindMatrices=matrices, skeleton=root)]

    def mesh(self, parts: Sequence[MeshPart], metres: float, morphs: Collection[str] = ()) -> None:
        """Add a mesh that the skin moves, one primitive for each colour; ``metres``: length of one clip unit. Parts
        that have some of ``morphs`` form a separate mesh, with only these as targets.
        """
        moved = [part for part in parts if not part.morphs.keys().isdisjoint(morphs)]
        for name, mesh_parts in (("mannequin", [part for part in parts if part not in moved]), ("face", moved)):
            if not mesh_parts:
                continue
            colours = dict.fromkeys(part.colour for part in mesh_parts)
            names = tuple(name for name in morphs if mesh_parts is moved and any(name in part.morphs for part in moved))
            grouped = [[part for part in mesh_parts if part.colour == colour] for colour in colours]
            primitives = [self.primitive(parts, metres, names, self._material(parts[0])) for parts in grouped]
            self.add_mesh(name, primitives, names)

    def add_mesh(self, name: str, primitives: Sequence[pygltflib.Primitive], targets: Sequence[str] = ()) -> None:
        """Add a mesh that the skin moves, with named morph targets."""
        self.gltf.meshes.append(pygltflib.Mesh(name=name, primitives=list(primitives)))
        if targets:
            self.gltf.meshes[-1].extras, self.gltf.meshes[-1].weights = {"targetNames": targets}, [0.0] * len(targets)
        self.gltf.nodes.append(pygltflib.Node(name=name, mesh=len(self.gltf.meshes) - 1, skin=0))
        self.gltf.scenes[0].nodes.append(len(self.gltf.nodes) - 1)

    def _material(self, part: MeshPart) -> int:
        """Add a material in a part's colour; returns its number."""
        surface = pygltflib.PbrMetallicRoughness(
            baseColorFactor=[*_linear(part.colour), 1.0], metallicFactor=0.0, roughnessFactor=0.8
        )
        self.gltf.materials.append(pygltflib.Material(name=part.name, pbrMetallicRoughness=surface))
        return len(self.gltf.materials) - 1

    def primitive(
        self, parts: Sequence[MeshPart], metres: float, targets: Sequence[str], material: int
    ) -> pygltflib.Primitive:
        """Add a primitive of parts of one material, with named morph targets."""
        starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
        positions = np.concatenate([part.vertices for part in parts]).astype(np.float32) * np.float32(metres)
        joints = np.concatenate([part.joints for part in parts])
        weights = np.concatenate([part.weights for part in parts])
        indices = np.concatenate([part.triangles + k for part, k in zip(parts, starts[:-1], strict=True)]).ravel()
        corners = {"min": positions.min(axis=0).tolist(), "max": positions.max(axis=0).tolist()}
        attributes = pygltflib.Attributes(
            POSITION=self.array(positions, "VEC3", _FLOAT, _VERTICES, **corners),
            NORMAL=self.array(np.concatenate([part.normals for part in parts]), "VEC3", _FLOAT, _VERTICES),
            JOINTS_0=self.array(joints, "VEC4", _UBYTE if joints.max() < 256 else _USHORT, _VERTICES),
            WEIGHTS_0=self.array(_to_bytes(weights), "VEC4", _UBYTE, _VERTICES, normalized=True),
        )
        if parts[0].uvs is not None:
            attributes.TEXCOORD_0 = self.array(parts[0].uvs, "VEC2", _FLOAT, _VERTICES)
        small = len(positions) < 65536
        still = self.moves(len(positions), np.zeros(0, np.int64), np.zeros((0, 3))) if targets else 0
        moved: list[pygltflib.Attributes] = []
        for name in targets:
            part_morphs = [
                (part.morphs[name], k) for part, k in zip(parts, starts[:-1], strict=True) if name in part.morphs
            ]
            if not part_morphs:
                moved.append(pygltflib.Attributes(POSITION=still))
                continue
            rows = np.concatenate([rows + k for (rows, _), k in part_morphs])
            moves = metres * np.concatenate([moves for (_, moves), _ in part_morphs])
            moved.append(pygltflib.Attributes(POSITION=self.moves(len(positions), rows, moves)))
        return pygltflib.Primitive(
            attributes=attributes,
            indices=self.array(indices, "SCALAR", _USHORT if small else _UINT, _INDICES),
            material=material,
            targets=moved,
        )

    def moves(self, count: int, rows: NDArray[np.int64], moves: FloatArray) -> int:
        """Add displacements (count, 3) that are zero except in some rows; returns their accessor."""
        values = np.concatenate([np.zeros((min(1, count - len(rows)), 3)), moves]).astype(np.float32)
        corners = {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        accessor = pygltflib.Accessor(byteOffset=None, componentType=_FLOAT, count=count, type="VEC3", **corners)
        if len(rows):
            order, small = np.argsort(rows), count < 65536
            index, value = (
                self.view(array)
                for array in (rows[order].astype(np.uint16 if small else np.uint32), moves[order].astype(np.float32))
            )
            accessor.sparse = pygltflib.Sparse(
                count=len(rows),
                indices=pygltflib.AccessorSparseIndices(bufferView=index, componentType=_USHORT if small else _UINT),
                values=pygltflib.AccessorSparseValues(bufferView=value),
            )
        self.gltf.accessors.append(accessor)
        return len(self.gltf.accessors) - 1

    def times(self, clip: Clip) -> int:
        """Add the times of a clip's frames, seconds from the first; returns their accessor."""
        seconds = (np.arange(len(clip)) / clip.fps).astype(np.float32)
        return self.array(seconds, "SCALAR", _FLOAT, min=[float(seconds[0])], max=[float(seconds[-1])])

    def channel(self, node: int, path: str, times: int, values: FloatArray) -> None:
        """Animate a node's "rotation" (T, 4), "translation" (T, 3), or "weights" (T * targets,), one linear key a
        frame.
        """
        animation = self.gltf.animations[0]
        output = self.array(values, {"rotation": "VEC4", "weights": "SCALAR"}.get(path, "VEC3"), _FLOAT)
        animation.samplers.append(pygltflib.AnimationSampler(input=times, output=output, interpolation="LINEAR"))
        target = pygltflib.AnimationChannelTarget(node=node, path=path)
        animation.channels.append(pygltflib.AnimationChannel(sampler=len(animation.samplers) - 1, target=target))

    def finish(self, name: str, fps: float, report: Mapping[str, Any] | None = None) -> pygltflib.GLTF2:
        """Return the complete document; its animation gets a name and a frame rate, its extras a splice's report."""
        if report is not None:
            self.gltf.extras[REPORT_EXTRA] = json.dumps(report, ensure_ascii=False)
        self.gltf.animations[0].name = name or "signing"
        self.gltf.animations[0].extras = {**(self.gltf.animations[0].extras or {}), FPS_EXTRA: fps}
        self.content += b"\0" * (-len(self.content) % 4)
        self.gltf.buffers = [pygltflib.Buffer(byteLength=len(self.content))]
        self.gltf.set_binary_blob(bytes(self.content))
        return self.gltf


def _to_bytes(weights: FloatArray) -> NDArray[np.uint8]:
    """Convert weights (V, 4) to bytes that sum to 255."""
    quantized = np.floor(255.0 * weights).astype(np.int64)
    quantized[:, 0] += 255 - quantized.sum(axis=1)
    return quantized.astype(np.uint8)


def _linear(colour: Sequence[float]) -> list[float]:
    """Convert an sRGB colour to linear light, as glTF requires (IEC 61966-2-1)."""
    return [round(c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4, 6) for c in colour]
