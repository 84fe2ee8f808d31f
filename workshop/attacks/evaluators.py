"""Evaluates where the joints of a glTF or BVH file are, with nothing but numpy and the standards: a second opinion.

glTF 2.0: 4 x 4 matrices from the roots of the node trees down (section 3.5), keys interpolated by appendix C. BVH:
OFFSET, or the position channels that replace it, then the product of the rotation channels in the file's order.
Nothing is imported from signsplice, so that both cannot share a mistake.
"""

from __future__ import annotations

import base64
import json
import re
import struct
from typing import Any

import numpy as np

Fields = dict[str, Any]

KEEPS_JOINTS = re.compile(
    r"(KHR|EXT|MSFT|ADOBE)_((materials|texture|lights|mesh|xmp)_\w+"
    r"|draco_mesh_compression|node_visibility|animation_pointer)|VRM|VRMC_\w+"
)
"""glTF extensions that a file may require although only its joints are read: none of them moves a node."""
_TYPES = {5120: "i1", 5121: "u1", 5122: "i2", 5123: "u2", 5125: "u4", 5126: "f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
PATHS = {"translation": 3, "rotation": 4, "scale": 3}


class MustRefuseError(ValueError):
    """A file that a program must not load if it knows no more than glTF 2.0."""


def evaluate_gltf(
    content: bytes, times: Any, animation: int | None = 0, near_s: float = 0.0
) -> tuple[list[str], np.ndarray]:
    """Returns the names of all nodes of a glTF file (.gltf or .glb), and their matrices (T, N, 4, 4) to the world,
    in m, at ``times``; at rest if ``animation`` is None.

    times: (T,) seconds by the file's keys; before the first and after the last key the value of that key holds.
    near_s: a time that is less off a key of a channel is at that key, since files store times in 32 bits.

    Nodes without a name are called "node 3". Raises ``MustRefuseError`` for a file that a reader has to refuse, and
    ``ValueError`` or another exception if it is not valid glTF, so that nothing can be said about it.
    """
    file = GltfFile(content)
    times_s = np.atleast_1d(np.asarray(times, np.float64))
    channels = {} if animation is None else file.channels(animation)
    animated = {target: (keys, values, kind, near_s) for target, (keys, values, kind) in channels.items()}
    nodes = file.json.get("nodes") or []
    parents = {child: node for node, fields in enumerate(nodes) for child in fields.get("children") or ()}
    if len(parents) != sum(len(fields.get("children") or ()) for fields in nodes):
        raise ValueError("a node has two parents")
    world: dict[int, np.ndarray] = {}
    order = [node for node in range(len(nodes)) if node not in parents]
    for node in order:  # the list grows: parents come first
        order += nodes[node].get("children") or ()
        local = _evaluate_node(nodes[node], {p: animated[node, p] for p in PATHS if (node, p) in animated}, times_s)
        world[node] = world[parents[node]] @ local if node in parents else local
    names = [fields.get("name") or f"node {node}" for node, fields in enumerate(nodes)]
    return names, np.stack([world[node] for node in range(len(nodes))], axis=1)


def compute_frame_times(keys: np.ndarray, n_frames: int, fps: float) -> np.ndarray:
    """Returns the times (T,) of a clip's frames, seconds by the keys (K,) of its file: the first at the first key, none
    after the last, and the last frame there if it is a tenth of a frame off: rates are rounded by as much.
    """
    times = np.minimum(keys[0] + np.arange(n_frames) / fps, keys[-1])
    if (keys[-1] - times[-1]) * fps < 0.11:
        times[-1] = keys[-1]
    return np.asarray(times)


_SITE = "End Site"
"""Name of what stands for an End Site with channels."""


def evaluate_bvh(content: bytes) -> tuple[list[str], np.ndarray]:
    """Returns the names of the joints of a BVH file in its order, and their matrices (T, J, 4, 4) to the world, in its
    unit. Raises ``ValueError`` or another exception if it is not valid.
    """
    joints, rows, _ = _parse_bvh(content)
    world: list[np.ndarray] = []  # of each joint: matrices (T, 4, 4)
    column = 0
    for _, parent, offset, channels in joints:
        local = np.tile(np.eye(4), (len(rows), 1, 1))
        local[:, :3, 3] = offset
        for channel in channels:
            kind, axis, values = channel[1:].lower(), "xyz".index(channel[0].lower()), rows[:, column]
            column += 1
            if kind == "position":
                local[:, axis, 3] = values
            elif kind == "rotation":
                local[:, :3, :3] = local[:, :3, :3] @ _rotate_about(axis, np.deg2rad(values))
            else:
                raise ValueError(f"channel {channel}")
        world.append(local if parent is None else world[parent] @ local)
    numbers = [number for number, (name, *_) in enumerate(joints) if name != _SITE]
    return [joints[number][0] for number in numbers], np.stack([world[number] for number in numbers], axis=1)


def read_frame_time(content: bytes) -> float:
    """Returns the Frame Time of a BVH file, seconds, as it is printed."""
    return _parse_bvh(content)[2]


# --- glTF


class GltfFile:
    """JSON document and buffers of a glTF file."""

    def __init__(self, data: bytes) -> None:
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
        min_version = [int(part) for part in asset.get("minVersion", "2.0").split(".")]
        if min_version > [2, 0]:
            raise MustRefuseError(f"minVersion {asset['minVersion']}")
        for name in self.json.get("extensionsRequired") or ():
            if not KEEPS_JOINTS.fullmatch(name):
                raise MustRefuseError(f"extension {name}")

    def channels(self, animation: int) -> dict[tuple[int, str], tuple[np.ndarray, np.ndarray, str]]:
        """Returns (node, path) -> key times (K,), values (K, n) or (K, 3, n), and interpolation of an animation."""
        channels: dict[tuple[int, str], tuple[np.ndarray, np.ndarray, str]] = {}
        fields = self.json["animations"][animation]
        for channel in fields["channels"]:
            node, path = channel["target"].get("node"), channel["target"]["path"]
            if node is None or path not in PATHS:
                continue
            if (node, path) in channels or not 0 <= node < len(self.json["nodes"]):
                raise ValueError(f"{path} of node {node} is animated twice, or of no node")
            sampler = fields["samplers"][channel["sampler"]]
            kind = sampler.get("interpolation") or "LINEAR"
            if kind not in ("LINEAR", "STEP", "CUBICSPLINE"):
                raise MustRefuseError(f"interpolation {kind}")
            keys, values = self.accessor(sampler["input"])[:, 0], self.accessor(sampler["output"])
            shape = (len(keys), 3, PATHS[path]) if kind == "CUBICSPLINE" else (len(keys), PATHS[path])
            if not len(keys) or (np.diff(keys) <= 0).any() or values.size != np.prod(shape):
                raise ValueError(f"{path} of node {node}: {values.shape} values for {len(keys)} keys")
            if not (np.isfinite(keys).all() and np.isfinite(values).all()):
                raise ValueError(f"{path} of node {node} is not finite")
            channels[node, path] = keys, values.reshape(shape), kind
        return channels

    def accessor(self, number: int) -> np.ndarray:
        """Returns the values (count, width) of an accessor."""
        fields = self.json["accessors"][number]
        dtype, width, count = np.dtype(_TYPES[fields["componentType"]]), _WIDTHS[fields["type"]], fields["count"]
        stored = self.rows(fields, dtype, width, count) if fields.get("bufferView") is not None else 0.0
        values = np.zeros((count, width)) + stored
        if sparse := fields.get("sparse"):
            index = sparse["indices"]
            rows = self.rows(index, np.dtype(_TYPES[index["componentType"]]), 1, sparse["count"])[:, 0]
            values[rows] = self.rows(sparse["values"], dtype, width, sparse["count"])
        if fields.get("normalized") and dtype.kind in "iu":
            values = np.maximum(values / np.iinfo(dtype).max, -1.0)
        return values

    def rows(self, reference: Fields, dtype: np.dtype[Any], width: int, count: int) -> np.ndarray:
        """Returns rows (count, width) as a buffer stores them; ``reference``: the fields that name view and offset."""
        view = self.json["bufferViews"][reference["bufferView"]]
        start, size = view.get("byteOffset", 0), width * dtype.itemsize
        view_bytes = self.buffer(view["buffer"])[start : start + view["byteLength"]][reference.get("byteOffset", 0) :]
        stride = view.get("byteStride", size)
        starts = range(0, count * stride, stride) if stride else [0] * count
        return np.stack([np.frombuffer(view_bytes[n : n + size], dtype.newbyteorder("<"), width) for n in starts])

    def buffer(self, number: int) -> bytes:
        """Returns the bytes of a buffer."""
        uri: str | None = self.json["buffers"][number].get("uri")
        if uri is None:
            return self.blob
        if uri.startswith("data:"):
            return base64.b64decode(uri.split(",", 1)[1])
        raise ValueError(f"buffer {number} lies in another file")


def _evaluate_node(
    node: Fields, animated: dict[str, tuple[np.ndarray, np.ndarray, str, float]], times_s: np.ndarray
) -> np.ndarray:
    """Returns the matrices (T, 4, 4) of a node to its parent at times (T,)."""
    if node.get("matrix"):
        if animated:
            raise ValueError("a node with a matrix is animated")
        return np.tile(np.reshape(node["matrix"], (4, 4)).T.astype(np.float64), (len(times_s), 1, 1))
    defaults = {"translation": [0.0, 0.0, 0.0], "rotation": [0.0, 0.0, 0.0, 1.0], "scale": [1.0, 1.0, 1.0]}
    pose = {
        path: _sample_channel(*animated[path], times_s, path == "rotation")
        if path in animated
        else np.tile(np.asarray(node.get(path) or defaults[path], np.float64), (len(times_s), 1))
        for path in PATHS
    }
    local_matrices = np.tile(np.eye(4), (len(times_s), 1, 1))
    local_matrices[:, :3, :3] = to_matrices(pose["rotation"]) * pose["scale"][:, None, :]
    local_matrices[:, :3, 3] = pose["translation"]
    return local_matrices


def _sample_channel(
    keys: np.ndarray, values: np.ndarray, kind: str, near_s: float, times_s: np.ndarray, is_rotation: bool
) -> np.ndarray:
    """Returns values (T, n) of a channel at times (T,), by appendix C of glTF 2.0, one time after another."""
    nearest = keys[np.abs(keys[:, None] - times_s).argmin(axis=0)]
    times_s = np.where(np.abs(nearest - times_s) < near_s, nearest, times_s)
    return np.stack([_interpolate(keys, values, kind, float(t), is_rotation) for t in times_s])


def _interpolate(keys: np.ndarray, values: np.ndarray, kind: str, t: float, is_rotation: bool) -> np.ndarray:
    key_values = values[:, 1] if kind == "CUBICSPLINE" else values
    if t <= keys[0]:
        return np.asarray(key_values[0])
    if t >= keys[-1]:
        return np.asarray(key_values[-1])
    k = int(np.searchsorted(keys, t, side="right")) - 1
    length = keys[k + 1] - keys[k]
    u = (t - keys[k]) / length
    a, b = key_values[k], key_values[k + 1]
    if kind == "STEP":
        return np.asarray(a)
    if kind == "CUBICSPLINE":
        out_tangent, in_tangent = length * values[k, 2], length * values[k + 1, 0]
        basis = (2 * u**3 - 3 * u**2 + 1, u**3 - 2 * u**2 + u, -2 * u**3 + 3 * u**2, u**3 - u**2)
        return np.asarray(basis[0] * a + basis[1] * out_tangent + basis[2] * b + basis[3] * in_tangent)
    if not is_rotation:
        return np.asarray((1 - u) * a + u * b)
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    cosine = float(a @ b)
    b, angle = (b if cosine >= 0 else -b), float(np.arccos(min(abs(cosine), 1.0)))
    if angle < 1e-6:
        return np.asarray((1 - u) * a + u * b)
    return np.asarray((np.sin((1 - u) * angle) * a + np.sin(u * angle) * b) / np.sin(angle))


def to_matrices(quats: np.ndarray) -> np.ndarray:
    """Returns matrices (T, 3, 3) of quaternions (T, 4), x y z w, of any length but 0."""
    x, y, z, w = (quats / np.linalg.norm(quats, axis=1, keepdims=True)).T
    matrix_rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(matrix_rows), -1, 0)


# --- BVH


def _parse_bvh(content: bytes) -> tuple[list[tuple[str, int | None, np.ndarray, list[str]]], np.ndarray, float]:
    """Returns joints (name, parent, OFFSET, channels) in the file's order, frames (T, C), and the Frame Time."""
    text = content.decode("utf-8-sig", errors="replace")
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    head, motion = re.split(r"(?im)^[ \t]*MOTION[ \t]*$", text, maxsplit=1)
    words = iter(re.sub(r"(?m)\{[ \t]*$", " {", head).split())  # a brace may touch a name
    joints: list[tuple[str, int | None, np.ndarray, list[str]]] = []
    stack: list[int | None] = []  # joints of the open braces, None for an End Site
    if next(words).upper() != "HIERARCHY":
        raise ValueError("no BVH file")
    for word in words:
        match word.upper():
            case "ROOT" | "JOINT":
                parent = stack[-1] if stack else None
                joints.append((" ".join(iter(lambda: next(words), "{")), parent, np.zeros(3), []))
                stack.append(len(joints) - 1)
            case "END":
                while next(words) != "{":
                    pass
                stack.append(None)
            case "OFFSET":
                offset = [float(next(words)) for _ in range(3)]
                if stack[-1] is not None:
                    joints[stack[-1]][2][:] = offset
            case "CHANNELS":
                channels = [next(words) for _ in range(int(next(words)))]
                if stack[-1] is None:  # of an End Site: numbers that turn no joint
                    joints.append((_SITE, next(n for n in reversed(stack) if n is not None), np.zeros(3), channels))
                else:
                    joints[stack[-1]][3].extend(channels)
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
    without_sites = sum(len(channels) for name, *_, channels in joints if name != _SITE)
    if len(motion[match.end() :].lstrip().partition("\n")[0].split()) == without_sites:
        joints = [row if row[0] != _SITE else (*row[:3], []) for row in joints]
    return joints, numbers.reshape(int(match[1]), sum(len(row[3]) for row in joints)), float(match[2])


def _rotate_about(axis: int, angles: np.ndarray) -> np.ndarray:
    """Returns matrices (T, 3, 3) of rotations about one axis by ``angles`` (T,), radians."""
    rotations = np.tile(np.eye(3), (len(angles), 1, 1))
    second, third = (axis + 1) % 3, (axis + 2) % 3
    rotations[:, second, second] = rotations[:, third, third] = np.cos(angles)
    rotations[:, third, second] = np.sin(angles)
    rotations[:, second, third] = -rotations[:, third, second]
    return rotations
