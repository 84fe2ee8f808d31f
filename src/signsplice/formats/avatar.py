"""Avatars: reads the skeleton and mesh of a ``.vrm`` (0.x or 1.0), ``.glb`` or ``.fbx`` file in its rest pose, and
writes motion into such a file. The file needs no animation.

The skeleton holds the joints with a role and those between them. Vertices of other joints (hair, skirts, twisted
forearms, the joints of a spine between its roles) follow the nearest ancestor with a role. A VRM avatar of
version 0.x, which faces -Z, is turned to face +Z, as those of version 1.0 do. VRM's players take its rest pose as the
T-pose.

Writing motion keeps meshes, materials, textures, names and extensions. New keys follow the bytes of the binary chunk.
The new animation comes first in the document, since most players show the first. A node changes only if it is stored as
a matrix, which glTF does not animate: it becomes translation, rotation and scale. With Q the global rotation of a joint
at rest in the file and T the turn from the file's world to the avatar's, the local rotation L of a clip, whose joints
at rest have the world's axes, becomes the node's rotation

    Q_parent^-1 (T^-1 L T) Q.
"""

from __future__ import annotations

import copy
import json
import struct
from collections.abc import Mapping, Sequence, Set
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from signsplice.body.capsules import Avatar, AvatarFile, MeshPart
from signsplice.body.contacts import REGIONS
from signsplice.body.skin import fit_skin
from signsplice.errors import InputError
from signsplice.formats import join_suffixes
from signsplice.formats.fbx_avatar import as_glb
from signsplice.formats.gltf_document import REPORT_EXTRA, ROLES_EXTRA, VRM_0, VRM_1, Fields, chunks
from signsplice.formats.gltf_face import face_controls, split_controls
from signsplice.formats.gltf_mesh import MeshReader
from signsplice.formats.gltf_unpack import DRACO, unpack_meshes
from signsplice.formats.gltf_writer import DocumentWriter
from signsplice.formats.reading import DEFAULT_LIMITS, ReadLimits, check_most, format_errors, read_bytes, stem
from signsplice.motion import Clip, EndSite, FloatArray, Skeleton, rotation
from signsplice.motion.face import bone_quats, target_weights
from signsplice.motion.kinematics import rest_positions
from signsplice.rig.align import place, placement
from signsplice.rig.info import RigInfo, rig_info
from signsplice.rig.roles import FINGERS, SIDES

_SAME = 1e-12
"""A joint whose rotations differ from rest by less than this, 1 - |dot product|, gets no animation channel."""


def encode(clip: Clip, file: AvatarFile) -> bytes:
    """Encode an avatar's file as .glb with a clip of its skeleton as the first animation. The signer stands in the
    avatar's place. Raises ``FormatError`` if a part of the file that was not read before is not valid glTF.
    """
    with format_errors("the avatar's file", "avatar"):
        return _encode_avatar(clip, file)


def _encode_avatar(clip: Clip, file: AvatarFile) -> bytes:
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
    if isinstance(extras, dict) and clip.report is not None:
        extras[REPORT_EXTRA] = json.dumps(clip.report, ensure_ascii=False)
    return pack(document, blob)


def with_bones(clip: Clip, file: AvatarFile) -> Clip:
    """Return the clip with its face on the bones of eyes and jaw, if the avatar's file says that they show it."""
    bone_rotations = {} if clip.face is None else bone_quats(clip.face, file.look_at, file.opens_jaw)
    if not bone_rotations:
        return clip
    rig, quats = rig_info(clip.skeleton), np.array(clip.local_rotations)
    for role, turned in bone_rotations.items():
        joint = rig.roles.joints[role]
        upright = rig.t_pose.rotations[joint]
        quats[:, joint] = rotation.multiply(rotation.multiply(rotation.inverse(upright), turned), upright)
    return replace(clip, local_rotations=quats)


def pack(document: Fields, blob: bytes) -> bytes:
    """Pack a document and its buffer into the bytes of a .glb file."""
    text = json.dumps(document, ensure_ascii=False, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(blob), b"BIN\0") + blob
    return struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body


def _local_quats(clip: Clip, file: AvatarFile) -> FloatArray:
    """Return the rotations (T, J, 4) of the joints' nodes."""
    turn, above = rotation.from_matrix(file.turn), rotation.nearest(file.above[:3, :3])
    quats = np.array(in_file_axes(clip, file).local_rotations)
    quats[:, 0] = rotation.normalize(rotation.multiply(rotation.inverse(rotation.multiply(turn, above)), quats[:, 0]))
    return quats


def in_file_axes(clip: Clip, file: AvatarFile) -> Clip:
    """Return a clip of the avatar on joints that have the axes of the file's nodes at rest: local rotations become
    those of the nodes, but for the root's, which stays a rotation in the avatar's world.
    """
    rest = np.stack([rotation.nearest(matrix[:3, :3]) for matrix in file.worlds])
    rest = rotation.multiply(rotation.from_matrix(file.turn), rest)  # (J, 4) in the avatar's world
    to_parents = rotation.inverse(np.array([rotation.IDENTITY, *rest])[clip.skeleton.parents + 1])
    local = rotation.multiply(rotation.multiply(to_parents, clip.local_rotations), rest)
    offsets, at_rest = rotation.rotate(to_parents, clip.skeleton.offsets), rotation.multiply(to_parents, rest)
    names, roles = clip.skeleton.names, clip.skeleton.roles
    skeleton = Skeleton(names, clip.skeleton.parents, offsets, roles=roles, rest_pose=at_rest)
    return Clip(skeleton, rotation.normalize(local), clip.root_positions, clip.fps, clip.name)


def morph_weights(clip: Clip, file: AvatarFile) -> tuple[tuple[str, ...], FloatArray] | None:
    """Return the morph targets of the file that the clip's face moves, as NODE/NUMBER, and their weights (T, n) there;
    None if the clip has no face.
    """
    if clip.face is None:
        return None
    columns = {
        f"{node}/{k}": column
        for node, weights in _face(clip, file).items()
        for k, column in enumerate(weights.T)
        if column.any()
    }
    return tuple(columns), np.stack([*columns.values()], axis=1) if columns else np.zeros((len(clip), 0))


def _face(clip: Clip, file: AvatarFile) -> dict[int, FloatArray]:
    """Return node -> weights (T, n) of its morph targets that a face moves; empty if the clip has no face."""
    if clip.face is None or not file.face:
        return {}
    strength, _ = target_weights(clip.face, [control.name for control in file.face])
    node_weights = {node: np.zeros((len(clip), n)) for node, n in file.n_targets.items()}
    for control, alpha in zip(file.face, strength.T, strict=True):
        for node, index, weight in control.binds:
            node_weights[node][:, index] += weight * alpha
    return {node: np.clip(weights, 0.0, 1.0) for node, weights in node_weights.items()}


def _rest(node: Fields) -> FloatArray:
    """Return a node's rotation (4,) at rest."""
    if node.get("matrix") is not None:
        return rotation.nearest(np.array(node["matrix"], np.float64).reshape(4, 4).T[:3, :3])
    return rotation.normalize(np.array(node.get("rotation") or rotation.IDENTITY, np.float64))


def _free_matrix(node: Fields) -> None:
    """Replace a node's matrix by translation, rotation and scale."""
    if node.get("matrix") is None:
        return
    matrix = np.array(node.pop("matrix"), np.float64).reshape(4, 4).T
    quat = rotation.nearest(matrix[:3, :3])
    scale = np.diag(rotation.to_matrix(quat).T @ matrix[:3, :3])
    node |= {"translation": matrix[:3, 3].tolist(), "rotation": quat.tolist(), "scale": scale.tolist()}


def _append(document: Fields, blob: bytes, writer: DocumentWriter, clip: Clip) -> bytes:
    """Return the blob with the writer's arrays appended; adds its animation, accessors and views to the document."""
    added: dict[str, Any] = writer.finish(clip.name, clip.fps).to_dict()
    blob += b"\0" * (-len(blob) % 4)
    document |= {name: document.get(name) or [] for name in ("bufferViews", "accessors")}
    views, accessors = document["bufferViews"], document["accessors"]
    for sampler in added["animations"][0]["samplers"]:
        sampler["input"] += len(accessors)
        sampler["output"] += len(accessors)
    accessors += [
        _drop_empty_values(row) | {"bufferView": row["bufferView"] + len(views)} for row in added["accessors"]
    ]
    views += [_drop_empty_values(row) | {"byteOffset": row["byteOffset"] + len(blob)} for row in added["bufferViews"]]
    document["animations"] = [_drop_empty_values(added["animations"][0]), *(document.get("animations") or ())]
    blob += bytes(writer.content)
    document["buffers"] = document.get("buffers") or [{}]
    document["buffers"][0]["byteLength"] = len(blob)
    return blob


def _drop_empty_values(value: Any) -> Any:
    """Return a value of JSON without null or empty properties."""
    if isinstance(value, dict):
        return {
            key: _drop_empty_values(item) for key, item in value.items() if item is not None and item not in ({}, [])
        }
    return [_drop_empty_values(item) for item in value] if isinstance(value, list) else value


AVATAR_SUFFIXES = (".vrm", ".glb", ".gltf", ".fbx")
"""Suffixes that ``read_avatar`` reads."""
_BEHIND = np.diag([-1.0, 1.0, -1.0])
_MOST_MISSED = 4
_MOST_TREES = 4


def read_avatar(
    path: str | Path,
    roles: Mapping[str, str] | None = None,
    limits: ReadLimits = DEFAULT_LIMITS,
    skin: Sequence[str] = (),
) -> Avatar:
    """Read the avatar in a file with one of ``AVATAR_SUFFIXES``: its skeleton at rest and its body, fitted to its mesh.

    roles: role -> joint name, if the file is no VRM avatar and its joint names are not recognised.
    skin: names of the meshes, nodes or materials that are skin; if empty, names and shape tell skin from cloth.

    Raises ``InputError`` for another suffix, a file that cannot be read, or missing arms, ``FormatError`` if its
    content is not valid, and ``LimitError`` if it exceeds ``limits``.
    """
    _check_suffix(str(path))
    return _parse_content(read_bytes(path, limits.file_bytes), str(path), limits, Path(path).parent, roles or {}, skin)


def parse_avatar(content: bytes, file: str, limits: ReadLimits = DEFAULT_LIMITS) -> Avatar:
    """Parse the avatar in the bytes of a file. For uploads: no file is opened, whatever the bytes refer to. Raises
    the errors of ``read_avatar``.
    """
    _check_suffix(file)
    check_most(len(content), "bytes", limits.file_bytes, file)
    return _parse_content(content, file, limits, None, {}, ())


def with_figure(clip: Clip, path: str | Path, limits: ReadLimits = DEFAULT_LIMITS) -> Clip:
    """Return a clip that was read from a file, on an ``Avatar`` whose mesh is the figure that the file's skins bind to
    the clip's joints; the clip itself if there is none. Raises as ``read_avatar`` does.
    """
    suffix, content = Path(path).suffix.lower(), b""
    if suffix in (".glb", ".gltf", ".fbx"):
        content = read_bytes(path, limits.file_bytes)
    with format_errors(str(path), "figure"), np.errstate(all="ignore"):
        if suffix == ".fbx":
            content = as_glb(content, str(path), Path(path).parent, limits)
        parts = AvatarReader(str(path), content, limits, Path(path).parent).figure(clip.skeleton) if content else ()
    known = {field.name: getattr(clip.skeleton, field.name) for field in fields(Skeleton)}
    return replace(clip, skeleton=Avatar(**known, label=clip.name, mesh=parts)) if parts else clip


def avatars_in(path: Path) -> list[Path]:
    """Return the file itself, or the avatar files of a folder. Raises ``InputError`` if the folder has none."""
    if not path.is_dir():
        return [path]
    files = sorted(file for file in path.iterdir() if file.suffix.lower() in AVATAR_SUFFIXES and file.is_file())
    if not files:
        raise InputError(f"{path}: a folder without avatars, expected {join_suffixes(AVATAR_SUFFIXES)} files in it")
    return files


def _check_suffix(file: str) -> None:
    suffix = Path(file).suffix.lower()
    if suffix not in AVATAR_SUFFIXES:
        expected = f"expected {join_suffixes(AVATAR_SUFFIXES)}"
        raise InputError(f"{file}: a file with suffix {suffix or '(none)'} is no avatar, {expected}")


def _parse_content(
    content: bytes, file: str, limits: ReadLimits, folder: Path | None, roles: Mapping[str, str], skin: Sequence[str]
) -> Avatar:
    with format_errors(file, "avatar"), np.errstate(all="ignore"):
        if Path(file).suffix.lower() == ".fbx":
            content = as_glb(content, file, folder, limits)
        return AvatarReader(file, content, limits, folder).avatar(roles, content, skin)


class AvatarReader(MeshReader):
    """A document whose avatar is being read."""

    def __init__(self, file: str, content: bytes, limits: ReadLimits, folder: Path | None) -> None:
        super().__init__(file, content, limits, folder)
        if DRACO in (self.json.get("extensionsUsed") or ()):
            self._unpack(unpack_meshes)

    def avatar(self, roles: Mapping[str, str], content: bytes, skin: Sequence[str]) -> Avatar:
        """Return the avatar in ``content``; ``roles``: role -> joint name, which override the file's; ``skin``: names
        of meshes, nodes or materials that are skin.
        """
        nodes = self._roles(roles)
        order = self._joint_order(set(nodes.values()))
        _, _, names = self._tree(order)
        named = {role: names[order.index(node)] for role, node in nodes.items()}
        extensions = self.json.get("extensions") or {}
        turn = _BEHIND if VRM_0 in extensions and VRM_1 not in extensions else np.eye(3)
        avatar = self._skeleton(order, named, turn)
        _ = rig_info(avatar).arm_joints  # raises if there are no arms
        origin = self.world(order[0])[:3, 3]
        above = self.parents.get(order[0])
        controls, n_targets, expressions = face_controls(self)
        controls, look_at, opens_jaw = split_controls(self.json, nodes, controls)
        file = AvatarFile(
            self._whole(content), tuple(order), turn, np.stack([self.world(node) for node in order]),
            np.eye(4) if above is None else self.world(above), controls, n_targets, expressions, look_at, opens_jaw,
        )  # fmt: skip
        lacks = _lacking_fingers(avatar.label, named)
        avatar = replace(avatar, is_vrm=bool({VRM_0, VRM_1} & {*extensions}), file=file, warnings=lacks)
        # Joints without a role stay at rest: their vertices follow the nearest ancestor with a role.
        rows = {node: k for k, node in enumerate(order) if k == 0 or node in nodes.values()}
        parts, points, is_doubtful = self.read_meshes(rows, turn, origin, skin, controls)
        if self.n_unread_parts:
            n_parts = f"{self.n_unread_parts} mesh part{'s' * (self.n_unread_parts > 1)}"
            lacks = (*lacks, f"{avatar.label}: holds {n_parts} without indexed triangles, not read")
        body, missed = fit_skin(avatar, points, is_doubtful)
        lines = _warnings(avatar.label, missed)
        if not len(points.positions):
            lines = (f"{avatar.label}: holds no mesh that its bones carry; its body gets the usual proportions",)
        if body.guessed_regions.issuperset(REGIONS):
            line = next(iter(lines), f"{avatar.label}: has too little skin on body or hands")
            lines = (f"{line}; contacts on it are not measured",)
        return replace(avatar, mesh=parts, body=body, warnings=(*lacks, *lines))

    def figure(self, skeleton: Skeleton) -> tuple[MeshPart, ...]:
        """Return the mesh that joints of a clip of this file carry, in the rest pose of its skeleton; empty if there is
        none. Joints of a clip have the world's axes in the bind pose of their skin (``gltf_reader``).
        """
        skinned = {joint for skin in self.skins for joint in skin["joints"]}
        channels = [row for animation in (self.json.get("animations") or ())[:1] for row in animation["channels"]]
        if not skinned:
            return ()
        order = self._joint_order(skinned, {channel["target"].get("node") for channel in channels})
        nodes = dict(zip(self._tree(order)[2], order, strict=True))
        if not set(skeleton.names) <= nodes.keys():
            return ()
        bound = {node: matrix for skin in reversed(self.skins) if (matrices := self._bind_matrices(skin)) is not None
                 for node, matrix in zip(skin["joints"], np.linalg.inv(matrices), strict=True)}  # fmt: skip
        rows = {nodes[name]: k for k, name in enumerate(skeleton.names)}
        worlds: dict[int, FloatArray] = {}
        for node, position in zip(rows, rest_positions(skeleton), strict=True):
            above = worlds.get(self.parents.get(node, -1), np.eye(4))
            axes = rotation.to_matrix(rotation.nearest(bound.get(node, above @ self._matrix(node))[:3, :3]))
            worlds[node] = np.eye(4)
            worlds[node][:3, :3] = np.linalg.norm(self.world(node)[:3, :3], axis=0).mean() * axes
            worlds[node][:3, 3] = position
        self._worlds = worlds
        return self.read_meshes(rows, np.eye(3), np.zeros(3), face=face_controls(self)[0])[0]

    def _whole(self, content: bytes) -> bytes:
        """Return the file as one .glb that names no other file; unchanged if it already is one. An image that is
        missing or lies outside of the file's folder stays a name.
        """
        buffers: list[Fields] = self.json.get("buffers") or []
        pictures = {
            n: image_file
            for n, image in enumerate(self.json.get("images") or ())
            if (image_file := self.image_file(image))
        }
        if content[:4] == b"glTF" and not pictures and len(buffers) == 1 and "uri" not in buffers[0]:
            return content
        document, blob, starts = copy.deepcopy(self.json), bytearray(), []
        for n in range(len(buffers)):
            starts.append(len(blob))
            blob += self._buffer(n) + b"\0" * (-len(self._buffer(n)) % 4)
        views = document.setdefault("bufferViews", [])
        for view in views:
            view["byteOffset"], view["buffer"] = view.get("byteOffset", 0) + starts[view["buffer"]], 0
        for n, (kind, picture) in pictures.items():
            document["images"][n] |= {"bufferView": len(views), "mimeType": kind}
            del document["images"][n]["uri"]
            views.append({"buffer": 0, "byteOffset": len(blob), "byteLength": len(picture)})
            blob += picture + b"\0" * (-len(picture) % 4)
        document["buffers"] = [{"byteLength": len(blob)}]
        return pack(document, bytes(blob))

    def _skeleton(self, order: list[int], roles: Mapping[str, str], turn: FloatArray) -> Avatar:
        """Return the skeleton of nodes ``order`` at rest, turned, with finger tips as end sites."""
        rows, parents, names = self._tree(order)
        positions = np.array([self.world(node)[:3, 3] for node in order]) @ turn.T
        offsets = np.where((parents >= 0)[:, None], positions - positions[parents], 0.0)
        tips = [order[names.index(name)] for role, name in roles.items() if role.endswith("Distal")]
        sites = [
            EndSite(rows[node], turn @ self.world(child)[:3, 3] - positions[rows[node]])
            for node in tips
            for child in self.nodes[node].get("children") or ()
            if child not in rows
        ]
        return Avatar(tuple(names), parents, offsets, tuple(sites), dict(roles), label=stem(self.file))

    def _roles(self, given: Mapping[str, str]) -> dict[str, int]:
        """Return role -> node: from the given names, else from a VRM humanoid, else from recognised joint names."""
        humanoid = self._humanoid()
        joints = {node for skin in self.skins for node in skin["joints"]} | {*humanoid.values()}
        if not joints:
            raise self._error("is no avatar: it holds neither a VRM humanoid nor a mesh with a skin")
        if humanoid and not given:
            return humanoid
        # Of joints that hang apart, such as targets of inverse kinematics, those with most roles are the person's.
        trees = self._joint_trees(joints)
        names = [{str(self.nodes[node].get("name")) for node in tree} for tree in trees]
        holding = [tree for tree, known in zip(trees, names, strict=True) if known.issuperset(given.values())]
        found = [self._recognised(tree, humanoid, given) for tree in holding or trees[-1:]]
        order, info = max(found, key=lambda tree: len(tree[1].roles.joints))
        _ = info.arm_joints  # raises if there are no arms
        return {role: order[joint] for role, joint in info.roles.joints.items()}

    def _joint_trees(self, joints: Set[int]) -> list[set[int]]:
        """Return the joints below each one that has no joint above, the largest ``_MOST_TREES`` of such trees, and, if
        they are several with a common ancestor, all joints.
        """
        check_most(len(joints), "joints", self.limits.joints, self.file)
        tops: dict[int, int] = {}
        trees: dict[int, set[int]] = {}
        for node in self.order:
            above = self.parents.get(node, -1)
            if above in tops or node in joints:
                tops[node] = tops.get(above, node)
            if node in joints:
                trees.setdefault(tops[node], set()).add(node)
        has_ancestor = len(trees) > 1 and len(joints) in self._count_below(joints)
        return [*sorted(trees.values(), key=len)[: -_MOST_TREES - 1 : -1], *([{*joints}] if has_ancestor else [])]

    def _recognised(
        self, joints: Set[int], humanoid: Mapping[str, int], given: Mapping[str, str]
    ) -> tuple[list[int], RigInfo]:
        """Return the nodes of joints and those between them, parents first, and the roles that names tell."""
        order = self._joint_order(joints)
        rows, parents, names = self._tree(order)
        positions = np.array([self.world(node)[:3, 3] for node in order])
        skeleton = Skeleton(
            tuple(names), parents, np.where((parents >= 0)[:, None], positions - positions[parents], 0.0)
        )
        known = {role: names[rows[node]] for role, node in humanoid.items() if node in rows}
        if set(given.values()) & {*names} or not (humanoid or rig_info(skeleton).roles.rig != "unknown"):
            known = {role: name for role, name in known.items() if name not in given.values()} | dict(given)
        return order, rig_info(replace(skeleton, roles=known or None))


def _lacking_fingers(label: str, roles: Mapping[str, str]) -> tuple[str, ...]:
    """Return a line about hands with fewer than five fingers."""
    lacking = [f.lower() for f in FINGERS if any(f"{side}{f}Proximal" not in roles for side in SIDES)]
    if not lacking:
        return ()
    finger_names = " or ".join([*([", ".join(lacking[:-1])] if lacking[1:] else []), lacking[-1]])
    what = "fingers" if len(lacking) == len(FINGERS) else f"{finger_names}{' finger' * (finger_names != 'thumb')}"
    return (f"{label}: has no {what} to move, so it cannot spell, and many handshapes look alike",)


def _warnings(label: str, missed: tuple[str, ...]) -> tuple[str, ...]:
    """Return a line about the body parts that could not be fitted."""
    if not missed:
        return ()
    suffix = f" and {len(missed) - _MOST_MISSED} more" if len(missed) > _MOST_MISSED else ""
    shown = ", ".join(missed[:_MOST_MISSED])
    return (f"{label}: too few vertices of skin for {shown}{suffix}, which get the usual proportions",)
