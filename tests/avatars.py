"""Avatars made for tests: the mannequin of a body of other proportions, as .vrm (1.0, 0.x) or .glb files."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from signsplice.body.capsules import Avatar, BodyShape, MeshPart, build_capsules
from signsplice.lexicon import open_shipped_lexicon
from signsplice.motion import Skeleton, kinematics, rotation
from signsplice.rig.info import rig_info
from signsplice.rig.t_pose import positions_from_rotations
from signsplice_workshop.measure.bodies import BodyProportions, scale_bones

BODIES = {
    "narrow": BodyProportions(0.7, 0.85, shape=BodyShape(trunk_width=0.8)),
    "broad": BodyProportions(1.3, 0.95, 1.05, shape=BodyShape(trunk_width=1.3, trunk_depth=1.25, limbs=1.2)),
    "big head": BodyProportions(0.75, 0.85, 0.95, shape=BodyShape(head=1.35, trunk_width=0.85)),
}
_V0_THUMBS = {"ThumbProximal": "ThumbIntermediate", "ThumbMetacarpal": "ThumbProximal"}
_TYPES: dict[str, tuple[str, int]] = {
    "u8": ("<u1", 5121), "u16": ("<u2", 5123), "u32": ("<u4", 5125), "f32": ("<f4", 5126)
}  # fmt: skip


@dataclass
class Glb:
    """A binary glTF file under construction."""

    json: dict[str, Any] = field(default_factory=lambda: {
        "asset": {"version": "2.0"}, "nodes": [], "meshes": [], "skins": [], "materials": [],
        "accessors": [], "bufferViews": [], "buffers": [{}],
    })  # fmt: skip
    content: bytearray = field(default_factory=bytearray)

    def view(self, values: Any, kind: str) -> int:
        array = np.ascontiguousarray(values, _TYPES[kind][0])
        self.json["bufferViews"].append({"buffer": 0, "byteOffset": len(self.content), "byteLength": array.nbytes})
        self.content.extend(array.tobytes() + b"\0" * (-array.nbytes % 4))
        return len(self.json["bufferViews"]) - 1

    def array(self, values: Any, kind: str, shape: str, **more: Any) -> int:
        row = {"bufferView": self.view(values, kind), "componentType": _TYPES[kind][1], "count": len(values)}
        self.json["accessors"].append(row | {"type": shape} | more)
        return len(self.json["accessors"]) - 1

    def sparse(self, values: np.ndarray) -> int:
        """Positions that are stored as changes of rows of zeros."""
        (rows,) = np.nonzero(np.any(values != 0.0, axis=1))
        self.json["accessors"].append({
            "componentType": 5126, "count": len(values), "type": "VEC3",
            "sparse": {"count": len(rows), "indices": {"bufferView": self.view(rows, "u32"), "componentType": 5125},
                       "values": {"bufferView": self.view(values[rows], "f32")}},
        })  # fmt: skip
        return len(self.json["accessors"]) - 1

    def write(self, path: Path) -> Path:
        self.json["buffers"] = [{"byteLength": len(self.content)}]
        below = {child for node in self.json["nodes"] for child in node.get("children", ())}
        self.json["scenes"] = [{"nodes": [n for n in range(len(self.json["nodes"])) if n not in below]}]
        self.json["scene"] = 0
        document = {key: value for key, value in self.json.items() if value or key == "scene"}
        text = json.dumps(document).encode()
        text += b" " * (-len(text) % 4)
        body = struct.pack("<I4s", len(text), b"JSON") + text
        body += struct.pack("<I4s", len(self.content), b"BIN\0") + bytes(self.content)
        path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body)
        return path


def body(name: str, gloss: str = "NAME") -> Avatar:
    """A body of ``BODIES`` as an avatar in its T-pose, in metres, with the capsules and the mesh that it is made of."""
    skeleton = scale_bones(open_shipped_lexicon().clip(gloss).skeleton, BODIES[name])
    info = rig_info(skeleton)
    metres, turn = info.sizes.unit.metres, info.t_pose.rotations
    at = metres * positions_from_rotations(skeleton, turn)
    parents = skeleton.parents
    offsets = np.where((parents >= 0)[:, None], at - at[parents], 0.0)
    names = tuple(skeleton.names[joint] for joint in range(len(skeleton)))
    upright = Skeleton(names, parents, offsets)
    roles = {role: names[joint] for role, joint in rig_info(upright).roles.joints.items()}
    made = Avatar(names, parents, offsets, roles=roles, label=name)
    return replace(made, body=build_capsules(made, BODIES[name].shape))


def tubes(avatar: Avatar) -> tuple[MeshPart, ...]:
    """A closed tube around every capsule of an avatar, in its rest pose; each hangs on its joint alone."""
    assert avatar.body is not None
    rest, parts = kinematics.rest_positions(avatar), []
    angle = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
    latitude = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 9)
    for n, joint in enumerate(avatar.body.joints.tolist()):
        start, end, radii = avatar.body.starts[n], avatar.body.ends[n], avatar.body.radii[n]
        axis = end - start if np.linalg.norm(end - start) > 0.0 else np.array([0.0, 1e-6, 0.0])
        turn = rotation.between_vectors(np.array([0.0, 0.0, 1.0]), axis)
        rings = [(start, radii[0], up) for up in latitude[:5]]
        rings += [(start + t * (end - start), radii[0] + t * (radii[1] - radii[0]), 0.0) for t in np.linspace(0, 1, 8)]
        rings += [(end, radii[1], up) for up in latitude[4:]]
        rows = []
        for middle, radius, up in rings:
            flat = np.stack([np.cos(up) * np.cos(angle), np.cos(up) * np.sin(angle), np.full(16, np.sin(up))], axis=1)
            rows.append(rest[joint] + middle + radius * rotation.rotate(turn, flat))
        corner = (np.arange(len(rings) - 1)[:, None] * 16 + np.arange(16)).ravel()
        beside = corner - corner % 16 + (corner + 1) % 16
        faces = [np.stack(f, axis=1) for f in ((corner, beside, beside + 16), (corner, beside + 16, corner + 16))]
        vertices, carried = np.concatenate(rows), np.zeros((16 * len(rings), 4), np.int64)
        carried[:, 0] = joint
        weights = np.tile([1.0, 0.0, 0.0, 0.0], (len(vertices), 1))
        name = "Body_SKIN" if avatar.body.parts[n] != "hair" else "Scalp_SKIN"
        parts.append(MeshPart(name, (1.0, 0.8, 0.7), vertices, vertices, np.concatenate(faces), carried, weights))
    return tuple(parts)


def write(
    path: Path,
    avatar: Skeleton,
    parts: Sequence[MeshPart],
    version: str = "1.0",
    *,
    weights: str = "f32",
    axes: bool = True,
    roles: Mapping[str, str] | None = None,
    hair: bool = True,
    sparse: bool = False,
) -> Path:
    """Write an avatar in the rest pose: VRM ``version`` "1.0", "0.x" (facing -Z), or "" for a plain .glb.

    weights: how they are stored. axes: whether joints are turned at rest. hair: whether a mesh of hair hangs on the
    head, in front of the trunk, from a chain of joints that a spring moves, and a skirt on the hips without a spring.
    """
    glb, n = Glb(), len(avatar)
    behind = np.diag([-1.0, 1.0, -1.0]) if version == "0.x" else np.eye(3)
    at = kinematics.rest_positions(avatar) @ behind.T + [0.0, 1.0, 0.0]
    rng = np.random.default_rng(7)
    quats = rotation.exp(rng.normal(size=(n, 3))) if axes else np.tile(rotation.IDENTITY, (n, 1))
    for joint in range(n):
        parent = int(avatar.parents[joint])
        turn = rotation.IDENTITY if parent < 0 else rotation.inverse(quats[parent])
        away = at[joint] - (at[parent] if parent >= 0 else 0.0)
        glb.json["nodes"].append({
            "name": avatar.names[joint],
            "translation": rotation.rotate(turn, away).tolist(),
            "rotation": rotation.multiply(turn, quats[joint]).tolist(),
            "children": [int(child) for child in avatar.children[joint]],
        })  # fmt: skip
    humanoid = rig_info(avatar).roles.joints if roles is None else {r: avatar.index[x] for r, x in roles.items()}
    bones, matrices = list(range(n)), [(quats[joint], at[joint]) for joint in range(n)]
    springs: list[int] = []
    if hair:
        for over, name in (("head", "J_Sec_Hair"), ("hips", "SkirtFront")):
            joint = rig_info(avatar).roles.joints[over]
            for k in range(2):
                node = len(glb.json["nodes"])
                glb.json["nodes"].append({"name": f"{name}{k}", "children": []})
                glb.json["nodes"][node - 1 if k else joint]["children"].append(node)
                bones.append(node)
                matrices.append((quats[joint], at[joint]))
                springs += [node] if over == "head" else []
                if k:
                    parts = [*parts, _curtain(f"{over} N00_Locks", at[joint] @ behind, len(bones) - 1)]
    glb.json["nodes"] = [{k: v for k, v in node.items() if v != []} for node in glb.json["nodes"]]
    inverse = np.tile(np.eye(4), (len(bones), 1, 1))
    for k, (quat, position) in enumerate(matrices):
        inverse[k, :3, :3] = rotation.to_matrix(quat).T
        inverse[k, :3, 3] = -rotation.to_matrix(quat).T @ position
    bind = glb.array(inverse.transpose(0, 2, 1).reshape(-1, 16), "f32", "MAT4")
    glb.json["skins"].append({"joints": bones, "inverseBindMatrices": bind})
    _meshes(glb, parts, behind, weights, sparse)
    _humanoid(glb, version, humanoid, springs)
    return glb.write(path)


def _curtain(name: str, at: np.ndarray, joint: int) -> MeshPart:
    """A sheet of hair or cloth 15 cm in front of a joint, from 10 cm above to half a metre below."""
    x, y = (grid.ravel() for grid in np.meshgrid(np.linspace(-0.15, 0.15, 8), np.linspace(-0.5, 0.1, 20)))
    vertices = at - [0.0, 1.0, 0.0] + np.stack([x, y, np.full_like(x, 0.15)], axis=1)
    corner = (np.arange(19)[:, None] * 8 + np.arange(7)).ravel()
    triangles = np.stack([corner, corner + 1, corner + 8], axis=1)
    joints, weights = np.tile([joint, 0, 0, 0], (len(x), 1)), np.tile([1.0, 0.0, 0.0, 0.0], (len(x), 1))
    return MeshPart(name, (0.3, 0.2, 0.1), vertices, np.tile([0.0, 0.0, 1.0], (len(x), 1)), triangles, joints, weights)


def _meshes(glb: Glb, parts: Sequence[MeshPart], behind: np.ndarray, weights: str, sparse: bool) -> None:
    """One mesh of all parts but the last, and one of the last."""
    for group in (parts[:-1], parts[-1:]):
        primitives = []
        for part in group:
            vertices = part.vertices @ behind.T + [0.0, 1.0, 0.0]
            position = glb.sparse(vertices) if sparse else glb.array(vertices, "f32", "VEC3", **_corners(vertices))
            most = {"u8": 255, "u16": 65535, "f32": 1}[weights]
            stored = part.weights if most == 1 else np.round(part.weights * most)
            more = {} if most == 1 else {"normalized": True}
            colour = [*(float(c) ** 2.2 for c in part.colour), 1.0]
            look = {"baseColorFactor": colour, "metallicFactor": 0.0}
            glb.json["materials"].append({"name": part.name, "pbrMetallicRoughness": look})
            primitives.append({
                "attributes": {
                    "POSITION": position,
                    "NORMAL": glb.array(part.normals @ behind.T, "f32", "VEC3"),
                    "JOINTS_0": glb.array(part.joints, "u8" if part.joints.max() < 256 else "u16", "VEC4"),
                    "WEIGHTS_0": glb.array(stored, weights, "VEC4", **more),
                },
                "indices": glb.array(part.triangles.reshape(-1, 1), "u32", "SCALAR"),
                "material": len(glb.json["materials"]) - 1,
            })  # fmt: skip
        if primitives:
            glb.json["meshes"].append({"name": "Body", "primitives": primitives})
            glb.json["nodes"].append({"name": "Body", "mesh": len(glb.json["meshes"]) - 1, "skin": 0})


def _corners(vertices: np.ndarray) -> dict[str, list[float]]:
    return {"min": vertices.min(axis=0).tolist(), "max": vertices.max(axis=0).tolist()}


def _humanoid(glb: Glb, version: str, roles: Mapping[str, int], springs: list[int]) -> None:
    if version == "1.0":
        bones: Any = {role: {"node": node} for role, node in roles.items()}
        meta = {"name": "toy", "authors": ["signsplice"], "licenseUrl": "https://vrm.dev/licenses/1.0/"}
        spring = {"springs": [{"joints": [{"node": node} for node in springs]}]}
        glb.json["extensions"] = {
            "VRMC_vrm": {"specVersion": "1.0", "meta": meta, "humanoid": {"humanBones": bones}},
            "VRMC_springBone": {"specVersion": "1.0", **spring},
        }
        glb.json["extensionsUsed"] = ["VRMC_vrm", "VRMC_springBone"]
    elif version == "0.x":
        bones = []
        for role, node in roles.items():
            name = next((role.replace(new, old) for new, old in _V0_THUMBS.items() if role.endswith(new)), role)
            bones.append({"bone": name, "node": node, "useDefaultValues": True})
        groups = [{"bones": springs[:1]}] if springs else []
        glb.json["extensions"] = {
            "VRM": {
                "meta": {"title": "toy"},
                "humanoid": {"humanBones": bones},
                "secondaryAnimation": {"boneGroups": groups},
            }
        }
        glb.json["extensionsUsed"] = ["VRM"]


def with_face(
    path: Path, targets: Sequence[str] = (), expressions: Mapping[str, Mapping[int, float]] | None = None
) -> Path:
    """Give the last mesh of an avatar's file morph targets of these names, and VRM expressions of the file's version:
    name -> number of a target -> weight.
    """
    content = path.read_bytes()
    size = struct.unpack_from("<I", content, 12)[0]
    glb = Glb(json.loads(content[20 : 20 + size]), bytearray(content[28 + size :]))
    mesh = len(glb.json["meshes"]) - 1
    primitive = glb.json["meshes"][mesh]["primitives"][0]
    n = glb.json["accessors"][primitive["attributes"]["POSITION"]]["count"]
    moved = np.zeros((n, 3))
    moved[:3] = 0.01
    primitive["targets"] = [{"POSITION": glb.array(moved, "f32", "VEC3", **_corners(moved))} for _ in targets]
    glb.json["meshes"][mesh]["extras"] = {"targetNames": list(targets)}
    node = next(k for k, fields in enumerate(glb.json["nodes"]) if fields.get("mesh") == mesh)
    rows = (expressions or {}).items()
    if "VRMC_vrm" in glb.json.get("extensions", {}):
        binds = {
            name: {"morphTargetBinds": [{"node": node, "index": k, "weight": w} for k, w in row.items()]}
            for name, row in rows
        }
        glb.json["extensions"]["VRMC_vrm"]["expressions"] = {"preset": binds}
    elif "VRM" in glb.json.get("extensions", {}):
        glb.json["extensions"]["VRM"]["blendShapeMaster"] = {"blendShapeGroups": [
            {"name": name.upper(), "presetName": name,
             "binds": [{"mesh": mesh, "index": k, "weight": 100.0 * w} for k, w in row.items()]}
            for name, row in rows
        ]}  # fmt: skip
    return glb.write(path)


def edited(path: Path, change: Callable[[dict[str, Any]], object]) -> Path:
    """The .vrm or .glb file with its document changed."""
    content = path.read_bytes()
    size = int.from_bytes(content[12:16], "little")
    document = json.loads(content[20 : 20 + size])
    change(document)
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text + content[20 + size :]
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body)
    return path
