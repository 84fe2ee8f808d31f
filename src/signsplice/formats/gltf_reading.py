"""Skeletal animation out of glTF 2.0 files: .glb, .gltf, and VRM's .vrma.

Joints keep their hierarchy and names. The pose in which a skin is bound (the file's own rest, where there is none)
becomes the clip's rest pose: with B a joint's global rotation there and L its local rotation in the file, a clip's is
B_parent L B^-1. Keys may lie anywhere in time; they are sampled at an even rate, that of the file's densest keys.
"""

from __future__ import annotations

import base64
import binascii
import json
import struct
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray
from pygltflib import GLTF2

from signsplice.errors import FormatError, InputError
from signsplice.formats.atomic import read_bytes
from signsplice.motion import rotation
from signsplice.motion.clip import Clip, Skeleton

Float = NDArray[np.float64]

LEAST_FPS = 20.0
"""Keys that lie farther apart than this tell no frame rate: such files are sampled at ``USUAL_FPS``."""
USUAL_FPS = 30.0
MAX_VALUES = 200_000_000
"""Rotations' numbers of a clip, frames times joints times four, above which a file is refused."""
_COMPONENTS = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_WHOLE = 5e-4
"""A rate that differs by less than this share from a whole number is that number; 29.97 is not."""
_EVEN = 1e-3
"""Scales along three axes that differ by less than this share are one."""


def read(path: str | Path, animation: str | None = None) -> Clip:
    """The clip of a file's animation, by default its first; metres as the file has them.

    Raises ``FormatError`` where the file is no sound glTF, has no animation (of that name) or scales joints unevenly;
    ``InputError`` where it cannot be read.
    """
    content = read_bytes(path)
    try:
        return _File(Path(path), content).clip(animation)
    except FormatError:
        raise
    except InputError as error:
        raise FormatError(f"holds no sound clip ({error})", file=str(path)) from error
    except (ValueError, KeyError, TypeError, IndexError, AttributeError, OverflowError, RecursionError, MemoryError,
            struct.error) as error:  # fmt: skip
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise FormatError(f"is no sound glTF file ({reason[:200]})", file=str(path)) from error


@dataclass(frozen=True)
class _Keys:
    """A channel's keys: times (K,), values (K, 3 or 4), with tangents (K, 3, ...) where it is a spline."""

    times: Float
    values: Float
    interpolation: str


class _File:
    """A glTF file that is being read."""

    def __init__(self, path: Path, content: bytes) -> None:
        self.path = path
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about extensions that mean nothing here
            if content[:4] == b"glTF":
                self.gltf, self.blob = _binary(path, content)
            else:
                self.gltf, self.blob = GLTF2.from_json(content.decode("utf-8-sig"), infer_missing=True), b""
        self.buffers: dict[int, bytes] = {}
        self.parents = self._parents()

    def clip(self, name: str | None) -> Clip:
        animation = self._animation(name)
        channels = self._channels(animation)
        joints, roles = self._joints(channels)
        order = self._order(joints, channels)
        times, fps = self._times(channels)
        if len(times) * len(order) * 4 > MAX_VALUES:
            raise self._wrong(f"{len(times)} frames of {len(order)} joints are more than a clip may hold")
        return self._made(order, roles, channels, times, fps, animation.name)

    def _made(
        self,
        order: list[int],
        roles: Mapping[str, int],
        channels: Mapping[tuple[int, str], _Keys],
        times: Float,
        fps: float,
        name: str | None,
    ) -> Clip:
        rows = {node: k for k, node in enumerate(order)}
        parents = np.array([rows.get(self.parents.get(node, -1), -1) for node in order])
        local, ways = np.empty((len(times), len(order), 4)), np.empty((len(times), len(order), 3))
        still, offsets, scales = np.empty((len(order), 4)), np.empty((len(order), 3)), np.empty(len(order))
        above = self._world(self.parents.get(order[0]))
        for k, node in enumerate(order):
            place, turn, scale = self._pose(node)
            over = above[2] if k == 0 else scales[parents[k]]
            scales[k] = over * scale
            still[k], offsets[k] = turn, over * place
            turns, moves = channels.get((node, "rotation")), channels.get((node, "translation"))
            local[:, k] = turn if turns is None else _sampled(turns, times, turning=True)
            ways[:, k] = over * (place if moves is None else _sampled(moves, times, turning=False))
        roots = above[0] + rotation.rotate(above[1], ways[:, 0])
        local[:, 0], still[0] = rotation.multiply(above[1], local[:, 0]), rotation.multiply(above[1], still[0])
        bound = self._bound(order, parents, still)
        over = np.where((parents >= 0)[:, None], bound[parents], rotation.IDENTITY)
        local = rotation.normalize(rotation.multiply(rotation.multiply(over, local), rotation.inverse(bound)))
        offsets, ways = rotation.rotate(over, offsets), rotation.rotate(over, ways)
        moving = len(order) > 1 and float(np.ptp(ways[:, 1:], axis=0).max()) > 1e-6 * float(np.abs(offsets).max())
        names = _different([self.gltf.nodes[node].name or f"node {node}" for node in order])
        told = {role: names[rows[node]] for role, node in roles.items() if node in rows}
        return Clip(
            Skeleton(tuple(names), parents, np.concatenate([np.zeros((1, 3)), offsets[1:]]), roles=told or None),
            rotation.continuous(local),
            roots,
            fps,
            name=name or self.path.stem,
            translations=np.concatenate([np.zeros((len(times), 1, 3)), ways[:, 1:]], axis=1) if moving else None,
        )

    def _parents(self) -> dict[int, int]:
        """Every node's parent. Raises ``FormatError`` where nodes are no trees."""
        parents: dict[int, int] = {}
        for node, told in enumerate(self.gltf.nodes or []):
            for child in told.children or []:
                if not 0 <= child < len(self.gltf.nodes) or child in parents or child == node:
                    raise self._wrong(f"node {child} is a child of node {node} and of another, or is not there")
                parents[child] = node
        for node in parents:
            seen, at = {node}, parents[node]
            while at in parents and at not in seen:
                seen.add(at)
                at = parents[at]
            if at in seen:
                raise self._wrong(f"node {node} lies above itself")
        return parents

    def _animation(self, name: str | None) -> Any:
        there = self.gltf.animations or []
        if not there:
            raise self._wrong("holds no animation, expected an animated skeleton")
        if name is None:
            return there[0]
        named = [animation for animation in there if animation.name == name]
        if not named:
            known = ", ".join(repr(animation.name) for animation in there[:8])
            raise self._wrong(f"holds no animation {name!r}, expected one of {known}")
        return named[0]

    def _channels(self, animation: Any) -> dict[tuple[int, str], _Keys]:
        found = {}
        for channel in animation.channels:
            node, path = channel.target.node, channel.target.path
            if node is None or path not in ("rotation", "translation", "scale"):
                continue
            sampler = animation.samplers[channel.sampler]
            times, values = self._values(sampler.input)[:, 0], self._values(sampler.output)
            spline = sampler.interpolation == "CUBICSPLINE"
            expected = (3 if spline else 1) * len(times)
            if not len(times) or len(values) != expected or np.any(np.diff(times) <= 0.0):
                raise self._wrong(f"{path} of node {node}: {len(values)} values for {len(times)} rising times")
            if not (np.isfinite(times).all() and np.isfinite(values).all()):
                raise self._wrong(f"{path} of node {node}: a number is not finite")
            if path == "scale":
                if np.ptp(values[1::3] if spline else values, axis=0).max() > _EVEN:
                    raise self._wrong(f"node {node} changes its size over time, expected rotations and places only")
                continue
            if values.shape[1] != (4 if path == "rotation" else 3):
                raise self._wrong(f"{path} of node {node} has {values.shape[1]} numbers")
            values = values.reshape(len(times), 3, -1) if spline else values
            found[node, path] = _Keys(times, values, sampler.interpolation or "LINEAR")
        if not found:
            raise self._wrong("animates no node's rotation or place, expected an animated skeleton")
        return found

    def _joints(self, channels: Mapping[tuple[int, str], _Keys]) -> tuple[list[int], dict[str, int]]:
        """The nodes that are joints, and the roles of those that the file names."""
        told = {**(self.gltf.extensions or {})}
        humanoid = (
            (told.get("VRMC_vrm_animation") or told.get("VRMC_vrm") or {}).get("humanoid", {}).get("humanBones", {})
        )
        roles = {role: int(bone["node"]) for role, bone in humanoid.items()} if isinstance(humanoid, dict) else {}
        skinned = [int(joint) for skin in self.gltf.skins or [] for joint in skin.joints or []]
        # Without skin and roles: what moves, and all that hangs on it.
        joints = skinned or [*roles.values()] or [node for moving, _ in channels for node in self._tree(moving)]
        joints = list(dict.fromkeys(joints))
        for joint in joints:
            if not 0 <= joint < len(self.gltf.nodes):
                raise self._wrong(f"joint {joint} is no node, expected one of {len(self.gltf.nodes)}")
        return joints, {role: node for role, node in roles.items() if node in joints}

    def _order(self, joints: list[int], channels: Mapping[tuple[int, str], _Keys]) -> list[int]:
        """Joints and what lies between, parents first: from the nearest node above all, or a higher one that moves."""
        lines = [self._line(joint) for joint in joints]
        shared = set.intersection(*(set(line) for line in lines))
        if not shared:
            raise self._wrong("its joints hang from several roots, expected one skeleton")
        nearest = max(shared, key=lambda node: len(self._line(node)))
        moving = {node for node, _ in channels}
        root = next((node for node in reversed(self._line(nearest)) if node in moving), nearest)
        wanted = {node for line in lines for node in line[: line.index(root) + 1]}
        return [node for node in self._tree(root) if node in wanted]

    def _tree(self, node: int) -> list[int]:
        """A node and all below it, parents first."""
        if not 0 <= node < len(self.gltf.nodes):
            raise self._wrong(f"joint {node} is no node, expected one of {len(self.gltf.nodes)}")
        out = [node]
        for above in out:
            out += self.gltf.nodes[above].children or []
        return out

    def _line(self, node: int) -> list[int]:
        """A node and all above it."""
        out = [node]
        while out[-1] in self.parents:
            out.append(self.parents[out[-1]])
        return out

    def _times(self, channels: Mapping[tuple[int, str], _Keys]) -> tuple[Float, float]:
        """Even moments from the first to the last key, and their rate."""
        start = min(float(keys.times[0]) for keys in channels.values())
        end = max(float(keys.times[-1]) for keys in channels.values())
        steps = [float(np.median(np.diff(keys.times))) for keys in channels.values() if len(keys.times) > 1]
        rate = 1.0 / min(steps) if steps else USUAL_FPS
        if rate < LEAST_FPS:
            rate = USUAL_FPS
        if abs(rate - round(rate)) < _WHOLE * rate:
            rate = float(round(rate))
        length = (end - start) * rate
        if not length < MAX_VALUES:
            raise self._wrong(f"lasts {end - start:g} s, longer than a clip may")
        return start + np.arange(int(length + 1e-3) + 1) / rate, rate

    def _pose(self, node: int) -> tuple[Float, Float, float]:
        """A node's own place (3,), turn (4,) and scale at rest."""
        told = self.gltf.nodes[node]
        if told.matrix:
            matrix = np.array(told.matrix, np.float64).reshape(4, 4).T
            scale = np.linalg.norm(matrix[:3, :3], axis=0)
            place, turn = matrix[:3, 3], rotation.from_matrix(matrix[:3, :3] / np.where(scale == 0.0, 1.0, scale))
        else:
            place = np.array(told.translation or [0.0, 0.0, 0.0], np.float64)
            turn = rotation.normalize(np.array(told.rotation or [0.0, 0.0, 0.0, 1.0], np.float64))
            scale = np.array(told.scale or [1.0, 1.0, 1.0], np.float64)
        if scale.min() <= 0.0 or np.ptp(scale) > _EVEN * scale.max():
            raise self._wrong(f"node {told.name or node!r} is scaled by {scale.tolist()}, expected one positive number")
        return place, turn, float(scale.mean())

    def _world(self, node: int | None) -> tuple[Float, Float, float]:
        """Place, turn and scale of a node in the world at rest; those of the world where there is none."""
        place, turn, scale = np.zeros(3), rotation.IDENTITY, 1.0
        for above in reversed([] if node is None else self._line(node)):
            own_place, own_turn, own_scale = self._pose(above)
            place = place + rotation.rotate(turn, scale * own_place)
            turn, scale = rotation.multiply(turn, own_turn), scale * own_scale
        return place, turn, scale

    def _bound(self, order: Sequence[int], parents: NDArray[np.intp], still: Float) -> Float:
        """Global rotations (J, 4) of the pose in which the skin is bound; of the file's rest where there is no skin."""
        known: dict[int, Float] = {}
        for skin in self.gltf.skins or []:
            if skin.inverseBindMatrices is None:
                continue
            matrices = self._values(skin.inverseBindMatrices).reshape(-1, 4, 4).transpose(0, 2, 1)
            if len(matrices) < len(skin.joints) or not np.isfinite(matrices).all():
                raise self._wrong(f"a skin binds {len(skin.joints)} joints with {len(matrices)} sound matrices")
            for joint, matrix in zip(skin.joints, matrices, strict=False):
                turn = np.linalg.inv(matrix)[:3, :3]
                u, _, vt = np.linalg.svd(turn)
                known.setdefault(int(joint), rotation.from_matrix(u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt))
        out = np.empty_like(still)
        for k, node in enumerate(order):
            above = rotation.IDENTITY if parents[k] < 0 else out[parents[k]]
            out[k] = known[node] if node in known else rotation.multiply(above, still[k])
        return out

    def _values(self, number: int) -> Float:
        """An accessor's values (N, width)."""
        accessor = self.gltf.accessors[number]
        if accessor.sparse is not None or accessor.bufferView is None:
            raise self._wrong(f"accessor {number} is sparse or empty, which is not read")
        view = self.gltf.bufferViews[accessor.bufferView]
        kind, width = np.dtype(_COMPONENTS[accessor.componentType]), _WIDTHS[accessor.type]
        data = self._buffer(view.buffer)
        start = (view.byteOffset or 0) + (accessor.byteOffset or 0)
        stride = view.byteStride or width * kind.itemsize
        end = start + (accessor.count - 1) * stride + width * kind.itemsize
        limit = (view.byteOffset or 0) + view.byteLength
        if accessor.count < 1 or start < 0 or stride < width * kind.itemsize or end > min(limit, len(data)):
            raise self._wrong(f"accessor {number} reaches beyond its {len(data)} bytes")
        rows = np.ndarray((accessor.count, width), kind.newbyteorder("<"), data, start, (stride, kind.itemsize))
        values = rows.astype(np.float64)
        if accessor.normalized and kind.kind in "iu":
            values = np.maximum(values / float(2 ** (8 * kind.itemsize - (kind.kind == "i")) - 1), -1.0)
        return values

    def _buffer(self, number: int) -> bytes:
        """The bytes of a buffer: those of the file itself, written into it, or of a file beside it."""
        if number not in self.buffers:
            uri = self.gltf.buffers[number].uri
            if uri is None:
                if number != 0:
                    raise self._wrong(f"buffer {number} has no data")
                self.buffers[number] = self.blob
            elif uri.startswith("data:"):
                try:
                    self.buffers[number] = base64.b64decode(uri.partition(",")[2], validate=True)
                except binascii.Error as error:
                    raise self._wrong(f"buffer {number} is no base64 ({error})") from error
            else:
                name = unquote(uri)
                if not name or Path(name).name != name or "\\" in name or "\0" in name:
                    raise self._wrong(f"buffer {number} lies at {uri!r}, expected a file beside this one")
                self.buffers[number] = read_bytes(self.path.parent / name)
        return self.buffers[number]

    def _wrong(self, what: str) -> FormatError:
        return FormatError(what, file=str(self.path))


def _binary(path: Path, content: bytes) -> tuple[GLTF2, bytes]:
    """The document and the binary part of a .glb."""
    if len(content) < 20:
        raise FormatError(f"{len(content)} bytes are no glTF file, expected 20 at least", file=str(path))
    version, length = struct.unpack_from("<II", content, 4)
    if version != 2:
        raise FormatError(f"is glTF {version}, expected 2", file=str(path))
    if length > len(content):
        raise FormatError(f"has {len(content)} of its {length} bytes; it is cut short", file=str(path))
    parts: dict[bytes, bytes] = {}
    at = 12
    while at + 8 <= length:
        (size,), kind = struct.unpack_from("<I", content, at), content[at + 4 : at + 8]
        if at + 8 + size > length:
            raise FormatError(f"a chunk of {size} bytes at {at} reaches beyond the file's end", file=str(path))
        parts.setdefault(kind, content[at + 8 : at + 8 + size])
        at += 8 + size
    if b"JSON" not in parts:
        raise FormatError("has no JSON chunk, expected one", file=str(path))
    told = parts[b"JSON"].decode("utf-8")
    if not isinstance(json.loads(told), dict):
        raise FormatError("its JSON is no object", file=str(path))
    return GLTF2.from_json(told, infer_missing=True), parts.get(b"BIN\0", b"")


def _sampled(keys: _Keys, times: Float, turning: bool) -> Float:
    """A channel at moments (T,): between keys as the file says, before and after them as at the first and last."""
    at = np.clip(times, keys.times[0], keys.times[-1])
    low = np.clip(np.searchsorted(keys.times, at, side="right") - 1, 0, max(len(keys.times) - 2, 0))
    high = np.minimum(low + 1, len(keys.times) - 1)
    span = keys.times[high] - keys.times[low]
    share = np.divide(at - keys.times[low], span, out=np.zeros_like(at), where=span > 0.0)
    if keys.interpolation == "CUBICSPLINE":
        s, t = share[:, None], span[:, None]
        a, leaving = keys.values[low, 1], t * keys.values[low, 2]
        b, arriving = keys.values[high, 1], t * keys.values[high, 0]
        out = (
            (1 + 2 * s) * (1 - s) ** 2 * a
            + s * (1 - s) ** 2 * leaving
            + s**2 * (3 - 2 * s) * b
            + s**2 * (s - 1) * arriving
        )
        return rotation.normalize(out) if turning else np.asarray(out)
    if keys.interpolation == "STEP":
        share = np.where(share >= 1.0, 1.0, 0.0)
    a, b = keys.values[low], keys.values[high]
    if turning:
        return rotation.slerp(rotation.normalize(a), rotation.normalize(b), share)
    return np.asarray(a + share[:, None] * (b - a))


def _different(names: Sequence[str]) -> list[str]:
    """The names, those that come again with a number."""
    out: list[str] = []
    for name in names:
        numbered = (f"{name} {n}" for n in count(2))
        out.append(name if name not in out else next(own for own in numbered if own not in {*names, *out}))
    return out
