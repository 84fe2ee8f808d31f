"""Motion written into an avatar's own file: its meshes, materials, textures, names and extensions stay.

The binary chunk keeps its bytes, and the new keys follow them. In the document a new animation comes first, since most
players show the first; earlier ones follow it. Nodes change only where a joint was stored as a matrix, which glTF does
not animate: it becomes translation, rotation and scale.

With Q the global rotation of a joint at rest in the file and T the turn from the file's world to the avatar's, the
local rotation L of a clip, whose joints at rest have the world's axes, is that of the node

    Q_parent^-1 (T^-1 L T) Q.
"""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from typing import Any

import numpy as np

from signsplice.body.capsules import AvatarFile
from signsplice.formats.gltf_document import ROLES_EXTRA, Fields, chunks
from signsplice.formats.gltf_writer import DocumentWriter
from signsplice.formats.reading import format_errors
from signsplice.motion import rotation
from signsplice.motion.arrays import FloatArray
from signsplice.motion.clip import Clip
from signsplice.motion.face import bone_quats, target_weights
from signsplice.rig.align import place, placement
from signsplice.rig.info import rig_info

_SAME = 1e-12
"""A joint gets no animation channel where the cosine of its rotation with that at rest is nearer to 1 than this."""


def encode(clip: Clip, file: AvatarFile) -> bytes:
    """The bytes of an avatar's file, as .glb, with a clip of its skeleton as the first animation. The signer stands
    where the avatar stands. Raises ``FormatError`` where what was not read of the file is no glTF.
    """
    with format_errors("the avatar's file", "avatar"):
        return _written(clip, file)


def _written(clip: Clip, file: AvatarFile) -> bytes:
    text, blob = chunks("the avatar", file.content)
    document: Fields = json.loads(text)
    standing = Clip(clip.skeleton, np.tile(rotation.IDENTITY, (1, len(clip.skeleton), 1)),
                    (file.turn @ file.worlds[0, :3, 3])[None], clip.fps)  # fmt: skip
    clip = with_bones(place(clip, placement(standing)), file)
    writer = DocumentWriter()
    times = writer.times(clip)
    quats = _local_quats(clip, file)  # (T, J, 4)
    for k, node in enumerate(file.nodes):
        rest = _rest(document["nodes"][node])
        if k == 0:
            world = np.concatenate([clip.root_positions @ file.turn, np.ones((len(clip), 1))], axis=1)
            writer.channel(node, "translation", times, (world @ np.linalg.inv(file.above).T)[:, :3])
        if k == 0 or np.abs(1.0 - np.abs(quats[:, k] @ rest)).max() > _SAME:
            _free_matrix(document["nodes"][node])
            writer.channel(node, "rotation", times, rotation.continuous(quats[:, k]))
    for node, weights in _face(clip, file).items():
        writer.channel(node, "weights", times, weights.ravel())
    blob = _append(document, blob, writer, clip)
    extras = document.setdefault("extras", {})
    if isinstance(extras, dict) and clip.skeleton.roles:
        extras[ROLES_EXTRA] = dict(clip.skeleton.roles)
    return pack(document, blob)


def with_bones(clip: Clip, file: AvatarFile) -> Clip:
    """The clip with its face shown by the bones of eyes and jaw, where the avatar's file says that they show it."""
    found = {} if clip.face is None else bone_quats(clip.face, file.look_at, file.opens_jaw)
    if not found:
        return clip
    rig, quats = rig_info(clip.skeleton), np.array(clip.local_rotations)
    for role, turned in found.items():
        joint = rig.roles.joints[role]
        upright = rig.t_pose.rotations[joint]
        quats[:, joint] = rotation.multiply(rotation.multiply(rotation.inverse(upright), turned), upright)
    return replace(clip, local_rotations=quats)


def pack(document: Fields, blob: bytes) -> bytes:
    """A document and its buffer as the bytes of a .glb file."""
    text = json.dumps(document, ensure_ascii=False, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(blob), b"BIN\0") + blob
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def _local_quats(clip: Clip, file: AvatarFile) -> FloatArray:
    """The rotations (T, J, 4) of the nodes that are joints."""
    turn = rotation.from_matrix(file.turn)
    rest = np.stack([_quat(matrix) for matrix in file.worlds])
    parents = np.array([_quat(file.above), *rest])[clip.skeleton.parents + 1]
    local = rotation.multiply(rotation.multiply(rotation.inverse(turn), clip.local_rotations), turn)
    return rotation.normalize(rotation.multiply(rotation.multiply(rotation.inverse(parents), local), rest))


def _face(clip: Clip, file: AvatarFile) -> dict[int, FloatArray]:
    """The weights (T, n) of the morph targets of each node that a face moves; none where the clip has no face."""
    if clip.face is None or not file.face:
        return {}
    strength, _ = target_weights(clip.face, [control.name for control in file.face])
    out = {node: np.zeros((len(clip), n)) for node, n in file.n_targets.items()}
    for control, alpha in zip(file.face, strength.T, strict=True):
        for node, index, weight in control.binds:
            out[node][:, index] += weight * alpha
    return {node: np.clip(weights, 0.0, 1.0) for node, weights in out.items()}


def _quat(matrix: FloatArray) -> FloatArray:
    """The rotation (4,) nearest to a matrix (4, 4) that may scale."""
    u, _, vt = np.linalg.svd(matrix[:3, :3])
    return rotation.from_matrix(u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt)


def _rest(node: Fields) -> FloatArray:
    """A node's own rotation (4,)."""
    if node.get("matrix") is not None:
        return _quat(np.array(node["matrix"], np.float64).reshape(4, 4).T)
    return rotation.normalize(np.array(node.get("rotation") or rotation.IDENTITY, np.float64))


def _free_matrix(node: Fields) -> None:
    """Store a node's matrix as translation, rotation and scale."""
    if node.get("matrix") is None:
        return
    matrix, quat = np.array(node.pop("matrix"), np.float64).reshape(4, 4).T, None
    quat = _quat(matrix)
    scale = np.diag(rotation.to_matrix(quat).T @ matrix[:3, :3])
    node |= {"translation": matrix[:3, 3].tolist(), "rotation": quat.tolist(), "scale": scale.tolist()}


def _append(document: Fields, blob: bytes, writer: DocumentWriter, clip: Clip) -> bytes:
    """The blob with the writer's arrays; its animation, accessors and views become part of the document."""
    made: dict[str, Any] = writer.finish(clip.name, clip.fps).to_dict()
    blob += b"\0" * (-len(blob) % 4)
    document |= {name: document.get(name) or [] for name in ("bufferViews", "accessors")}
    views, accessors = document["bufferViews"], document["accessors"]
    for sampler in made["animations"][0]["samplers"]:
        sampler["input"] += len(accessors)
        sampler["output"] += len(accessors)
    accessors += [_given(row) | {"bufferView": row["bufferView"] + len(views)} for row in made["accessors"]]
    views += [_given(row) | {"byteOffset": row["byteOffset"] + len(blob)} for row in made["bufferViews"]]
    document["animations"] = [_given(made["animations"][0]), *(document.get("animations") or ())]
    blob += bytes(writer.content)
    document["buffers"] = document.get("buffers") or [{}]
    document["buffers"][0]["byteLength"] = len(blob)
    return blob


def _given(value: Any) -> Any:
    """Values without those that are null or empty."""
    if isinstance(value, dict):
        return {key: _given(one) for key, one in value.items() if one is not None and one not in ({}, [])}
    return [_given(one) for one in value] if isinstance(value, list) else value
