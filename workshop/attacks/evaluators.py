"""Where the joints of a glTF or BVH file are, worked out by nothing but numpy and the standards: a second opinion.

glTF 2.0: 4 x 4 matrices from the roots of the node trees down (section 3.5), keys interpolated as appendix C says. BVH:
OFFSET, or the position channels that replace it, then the product of the rotation channels in the file's order.
Nothing here comes from signsplice, so that what both say is not one mistake made twice.
"""

from __future__ import annotations

import base64
import json
import re
import struct
from collections.abc import Collection
from pathlib import Path
from typing import Any

import numpy as np

Fields = dict[str, Any]

KEEPS_JOINTS = re.compile(
    r"(KHR|EXT|MSFT|ADOBE)_((materials|texture|lights|mesh|xmp)_\w+"
    r"|draco_mesh_compression|node_visibility|animation_pointer)|VRM|VRMC_\w+"
)
"""glTF extensions that a file may require although only its joints are read: none of them moves a node by itself."""
_TYPES = {5120: "i1", 5121: "u1", 5122: "i2", 5123: "u2", 5125: "u4", 5126: "f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_PATHS = {"translation": 3, "rotation": 4, "scale": 3}


class MustRefuseError(ValueError):
    """A file that no program may load which does not know more than glTF 2.0."""


def gltf_joints(
    content: bytes | Path, times: Any, animation: int = 0, near_s: float = 0.0
) -> tuple[list[str], np.ndarray]:
    """Names of all nodes of a glTF file (.gltf or .glb), and their world positions (T, N, 3) in metres at ``times``.

    times: (T,) seconds as the file's keys count them; before the first and after the last key the value there holds.
    near_s: a time that is less off a key of a channel is at that key, since files store times in 32 bits.
    Nodes without a name are called "node 3". Raises ``MustRefuseError`` for what a reader has to refuse, and
    ``ValueError`` or what the content causes where it is not valid glTF, so that nothing can be said about it.
    """
    names, world = gltf_worlds(content, times, animation, near_s)
    return names, world[..., :3, 3]


def gltf_worlds(
    content: bytes | Path, times: Any, animation: int | None = 0, near_s: float = 0.0
) -> tuple[list[str], np.ndarray]:
    """As ``gltf_joints``, but the nodes' matrices (T, N, 4, 4) to the world; at rest where ``animation`` is None."""
    file = _File(content)
    at = np.atleast_1d(np.asarray(times, np.float64))
    channels = {} if animation is None else file.channels(animation)
    animated = {of: (keys, values, kind, near_s) for of, (keys, values, kind) in channels.items()}
    nodes = file.json.get("nodes") or []
    parents = {child: node for node, fields in enumerate(nodes) for child in fields.get("children") or ()}
    if len(parents) != sum(len(fields.get("children") or ()) for fields in nodes):
        raise ValueError("a node has two parents")
    world: dict[int, np.ndarray] = {}
    order = [node for node in range(len(nodes)) if node not in parents]
    for node in order:  # it grows: parents come first
        order += nodes[node].get("children") or ()
        local = _local(nodes[node], {p: animated[node, p] for p in _PATHS if (node, p) in animated}, at)
        world[node] = world[parents[node]] @ local if node in parents else local
    return _names(nodes), np.stack([world[node] for node in range(len(nodes))], axis=1)


def gltf_keys(content: bytes | Path, names: Collection[str] | None = None, animation: int = 0) -> np.ndarray:
    """The times (K,) of all keys of rotations and translations, of the nodes with these names only where some are
    given, each once, rising. Raises as ``gltf_joints`` does.
    """
    file = _File(content)
    called = _names(file.json["nodes"])
    return np.unique(np.concatenate([
        keys for (node, path), (keys, _, _) in file.channels(animation).items()
        if path != "scale" and (names is None or called[node] in names)
    ]))  # fmt: skip


def n_animations(content: bytes | Path) -> int:
    """How many animations a glTF file holds."""
    return len(_File(content).json.get("animations") or ())


def frame_times(keys: np.ndarray, n_frames: int, fps: float) -> np.ndarray:
    """When the frames of a clip are (T,), seconds as the keys (K,) of its file count them: the first at the first key,
    none after the last, and the last frame there if it is a tenth of a frame off: rates are rounded by as much.
    """
    times = np.minimum(keys[0] + np.arange(n_frames) / fps, keys[-1])
    if (keys[-1] - times[-1]) * fps < 0.11:
        times[-1] = keys[-1]
    return np.asarray(times)


def bvh_joints(content: bytes) -> tuple[list[str], np.ndarray]:
    """Names of the joints of a BVH file in its order, and their positions (T, J, 3) in its unit. Raises ``ValueError``
    or what the content causes where it is not valid.
    """
    names, world = bvh_worlds(content)
    return names, world[..., :3, 3]


def bvh_worlds(content: bytes) -> tuple[list[str], np.ndarray]:
    """As ``bvh_joints``, but the joints' matrices (T, J, 4, 4) to the world."""
    joints, rows, _ = _bvh(content)
    eye = np.broadcast_to(np.eye(3), (len(rows), 3, 3))
    world: list[tuple[np.ndarray, np.ndarray]] = []  # of each joint: axes (T, 3, 3), position (T, 3)
    column = 0
    for _, parent, offset, channels in joints:
        axes, moved = eye, np.tile(offset, (len(rows), 1))
        for channel in channels:
            kind, axis, values = channel[1:].lower(), "xyz".index(channel[0].lower()), rows[:, column]
            column += 1
            if kind == "position":
                moved[:, axis] = values
            elif kind == "rotation":
                axes = axes @ _about(axis, np.deg2rad(values))
            else:
                raise ValueError(f"channel {channel}")
        if parent is not None:
            above, at = world[parent]
            moved, axes = at + np.einsum("tij,tj->ti", above, moved), above @ axes
        world.append((axes, moved))
    out = np.tile(np.eye(4), (len(rows), len(joints), 1, 1))
    for joint, (axes, at) in enumerate(world):
        out[:, joint, :3, :3], out[:, joint, :3, 3] = axes, at
    return [name for name, *_ in joints], out


def bvh_frame_time(content: bytes) -> float:
    """The Frame Time of a BVH file, seconds, as it is printed."""
    return _bvh(content)[2]


# --- glTF


def _names(nodes: list[Fields]) -> list[str]:
    return [fields.get("name") or f"node {node}" for node, fields in enumerate(nodes)]


class _File:
    """The JSON document and the buffers of a glTF file."""

    def __init__(self, content: bytes | Path) -> None:
        self.folder = content.parent if isinstance(content, Path) else None
        data = content.read_bytes() if isinstance(content, Path) else content
        self.blob = b""
        if data[:4] == b"glTF":
            version, length, size, _ = struct.unpack_from("<IIII", data, 4)
            if version != 2 or length > len(data):
                raise ValueError("no whole .glb file of version 2")
            if length >= 28 + size:
                (n_bytes,) = struct.unpack_from("<I", data, 20 + size)
                self.blob = data[28 + size : 28 + size + n_bytes]
            data = data[20 : 20 + size]
        self.json: Fields = json.loads(data.decode("utf-8-sig"))
        asset = self.json["asset"]
        if int(asset["version"].split(".")[0]) != 2:
            raise MustRefuseError(f"version {asset['version']}")
        least = [int(part) for part in asset.get("minVersion", "2.0").split(".")]
        if least > [2, 0]:
            raise MustRefuseError(f"minVersion {asset['minVersion']}")
        for name in self.json.get("extensionsRequired") or ():
            if not KEEPS_JOINTS.fullmatch(name):
                raise MustRefuseError(f"extension {name}")

    def channels(self, animation: int) -> dict[tuple[int, str], tuple[np.ndarray, np.ndarray, str]]:
        """(node, path) -> key times (K,), values (K, n) or (K, 3, n), and interpolation of an animation."""
        found: dict[tuple[int, str], tuple[np.ndarray, np.ndarray, str]] = {}
        fields = self.json["animations"][animation]
        for channel in fields["channels"]:
            node, path = channel["target"].get("node"), channel["target"]["path"]
            if node is None or path not in _PATHS:
                continue
            if (node, path) in found or not 0 <= node < len(self.json["nodes"]):
                raise ValueError(f"{path} of node {node} is animated twice, or of no node")
            sampler = fields["samplers"][channel["sampler"]]
            kind = sampler.get("interpolation") or "LINEAR"
            if kind not in ("LINEAR", "STEP", "CUBICSPLINE"):
                raise MustRefuseError(f"interpolation {kind}")
            keys, values = self.accessor(sampler["input"])[:, 0], self.accessor(sampler["output"])
            shape = (len(keys), 3, _PATHS[path]) if kind == "CUBICSPLINE" else (len(keys), _PATHS[path])
            if not len(keys) or (np.diff(keys) <= 0).any() or values.size != np.prod(shape):
                raise ValueError(f"{path} of node {node}: {values.shape} values for {len(keys)} keys")
            if not (np.isfinite(keys).all() and np.isfinite(values).all()):
                raise ValueError(f"{path} of node {node} is not finite")
            found[node, path] = keys, values.reshape(shape), kind
        return found

    def accessor(self, number: int) -> np.ndarray:
        """The values (count, width) of an accessor."""
        fields = self.json["accessors"][number]
        dtype, width, count = np.dtype(_TYPES[fields["componentType"]]), _WIDTHS[fields["type"]], fields["count"]
        stored = self.rows(fields, dtype, width, count) if fields.get("bufferView") is not None else 0.0
        out = np.zeros((count, width)) + stored
        if sparse := fields.get("sparse"):
            index = sparse["indices"]
            rows = self.rows(index, np.dtype(_TYPES[index["componentType"]]), 1, sparse["count"])[:, 0]
            out[rows] = self.rows(sparse["values"], dtype, width, sparse["count"])
        if fields.get("normalized") and dtype.kind in "iu":
            out = np.maximum(out / np.iinfo(dtype).max, -1.0)
        return out

    def rows(self, place: Fields, dtype: np.dtype[Any], width: int, count: int) -> np.ndarray:
        """Rows (count, width) as they lie in a buffer."""
        view = self.json["bufferViews"][place["bufferView"]]
        first, size = view.get("byteOffset", 0), width * dtype.itemsize
        part = self.buffer(view["buffer"])[first : first + view["byteLength"]][place.get("byteOffset", 0) :]
        step = view.get("byteStride", size)
        chosen = [np.frombuffer(part[n * step : n * step + size], dtype.newbyteorder("<"), width) for n in range(count)]
        return np.stack(chosen)

    def buffer(self, number: int) -> bytes:
        """The bytes of a buffer."""
        uri: str | None = self.json["buffers"][number].get("uri")
        if uri is None:
            return self.blob
        if uri.startswith("data:"):
            return base64.b64decode(uri.split(",", 1)[1])
        if self.folder is None:
            raise ValueError(f"buffer {number} lies in another file")
        return (self.folder / uri).read_bytes()


def _local(node: Fields, animated: dict[str, tuple[np.ndarray, np.ndarray, str, float]], at: np.ndarray) -> np.ndarray:
    """A node's own matrices (T, 4, 4) at times (T,)."""
    if node.get("matrix"):
        if animated:
            raise ValueError("a node with a matrix is animated")
        return np.tile(np.reshape(node["matrix"], (4, 4)).T.astype(np.float64), (len(at), 1, 1))
    value = {"translation": [0.0, 0.0, 0.0], "rotation": [0.0, 0.0, 0.0, 1.0], "scale": [1.0, 1.0, 1.0]}
    pose = {
        path: _sampled(*animated[path], at, path == "rotation")
        if path in animated
        else np.tile(np.asarray(node.get(path) or value[path], np.float64), (len(at), 1))
        for path in _PATHS
    }
    out = np.tile(np.eye(4), (len(at), 1, 1))
    out[:, :3, :3] = matrices(pose["rotation"]) * pose["scale"][:, None, :]
    out[:, :3, 3] = pose["translation"]
    return out


def _sampled(keys: np.ndarray, values: np.ndarray, kind: str, near_s: float, at: np.ndarray, turns: bool) -> np.ndarray:
    """Values (T, n) of a channel at times (T,), by appendix C of glTF 2.0, one time after another."""
    nearest = keys[np.abs(keys[:, None] - at).argmin(axis=0)]
    at = np.where(np.abs(nearest - at) < near_s, nearest, at)
    return np.stack([_value(keys, values, kind, float(t), turns) for t in at])


def _value(keys: np.ndarray, values: np.ndarray, kind: str, t: float, turns: bool) -> np.ndarray:
    middle = values[:, 1] if kind == "CUBICSPLINE" else values
    if t <= keys[0]:
        return np.asarray(middle[0])
    if t >= keys[-1]:
        return np.asarray(middle[-1])
    k = int(np.searchsorted(keys, t, side="right")) - 1
    length = keys[k + 1] - keys[k]
    u = (t - keys[k]) / length
    a, b = middle[k], middle[k + 1]
    if kind == "STEP":
        return np.asarray(a)
    if kind == "CUBICSPLINE":
        leaving, entering = length * values[k, 2], length * values[k + 1, 0]
        basis = (2 * u**3 - 3 * u**2 + 1, u**3 - 2 * u**2 + u, -2 * u**3 + 3 * u**2, u**3 - u**2)
        return np.asarray(basis[0] * a + basis[1] * leaving + basis[2] * b + basis[3] * entering)
    if not turns:
        return np.asarray((1 - u) * a + u * b)
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    cosine = float(a @ b)
    b, angle = (b if cosine >= 0 else -b), float(np.arccos(min(abs(cosine), 1.0)))
    if angle < 1e-6:
        return np.asarray((1 - u) * a + u * b)
    return np.asarray((np.sin((1 - u) * angle) * a + np.sin(u * angle) * b) / np.sin(angle))


def matrices(quats: np.ndarray) -> np.ndarray:
    """Matrices (T, 3, 3) of quaternions (T, 4), x y z w, of any length but 0."""
    x, y, z, w = (quats / np.linalg.norm(quats, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


# --- BVH


def _bvh(content: bytes) -> tuple[list[tuple[str, int | None, np.ndarray, list[str]]], np.ndarray, float]:
    """Joints (name, parent, OFFSET, channels) in the file's order, frames (T, C), and the Frame Time."""
    text = content.decode("utf-8-sig", errors="replace")
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    head, motion = re.split(r"(?im)^[ \t]*MOTION[ \t]*$", text, maxsplit=1)
    words = iter(head.split())
    joints: list[tuple[str, int | None, np.ndarray, list[str]]] = []
    stack: list[int | None] = []  # open braces: the joint, None for an End Site
    if next(words).upper() != "HIERARCHY":
        raise ValueError("no BVH file")
    for word in words:
        match word.upper():
            case "ROOT" | "JOINT":
                above = stack[-1] if stack else None
                joints.append((next(words), above, np.zeros(3), []))
                stack.append(len(joints) - 1)
            case "END":
                next(words)
                stack.append(None)
            case "OFFSET":
                offset = [float(next(words)) for _ in range(3)]
                if stack[-1] is not None:
                    joints[stack[-1]][2][:] = offset
            case "CHANNELS":
                joints[stack[-1] or 0][3].extend([next(words) for _ in range(int(next(words)))])
            case "}":
                stack.pop()
            case "{":
                pass
            case _:
                raise ValueError(f"the word {word!r}")
    match = re.match(r"\s*frames\s*:\s*(\S+)\s+frame\s+time\s*:\s*(\S+)", motion, re.IGNORECASE)
    if match is None:
        raise ValueError("no Frames and Frame Time")
    numbers = np.array(motion[match.end() :].split(), np.float64)
    return joints, numbers.reshape(int(match[1]), sum(len(row[3]) for row in joints)), float(match[2])


def _about(axis: int, angles: np.ndarray) -> np.ndarray:
    """Matrices (T, 3, 3) of rotations about one axis."""
    out = np.tile(np.eye(3), (len(angles), 1, 1))
    one, other = (axis + 1) % 3, (axis + 2) % 3
    out[:, one, one] = out[:, other, other] = np.cos(angles)
    out[:, other, one] = np.sin(angles)
    out[:, one, other] = -out[:, other, one]
    return out
