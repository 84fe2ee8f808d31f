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
from signsplice.formats.gltf import FPS
from signsplice.formats.gltf import ROLES as TOLD_ROLES
from signsplice.motion import rotation
from signsplice.motion.clip import Clip, Skeleton
from signsplice.motion.humanoid import ROLES

Float = NDArray[np.float64]

LEAST_FPS, MOST_FPS = 10.0, 240.0
"""Keys that lie farther apart or nearer together tell no frame rate: such files are sampled at ``USUAL_FPS``."""
USUAL_FPS = 30.0
MAX_VALUES = 20_000_000
"""Rotations' numbers of a clip, frames times joints times four, and numbers of keys, above which a file is refused."""
_COMPONENTS = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_DRIFT = 0.1
"""A rate is taken for a whole number, or one of television's (k 1000 / 1001), where keys move by so few frames."""
_NEAR = 1e-3
"""Share of a frame by which a moment may lie before a key and yet be at it: files hold times in 32 bits."""
_HELD = 1e-5
"""Places that move by less than this share of the longest bone are held."""
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
        self.sizes: dict[int, Float] = {}
        self.known: dict[int, Float] = {}
        version = str(getattr(self.gltf.asset, "version", "") or "")
        if not version.startswith("2."):
            raise self._wrong(f"is glTF {version or 'of no version'}, expected 2.0")
        if "EXT_meshopt_compression" in (self.gltf.extensionsRequired or []):
            raise self._wrong("its buffers are compressed by EXT_meshopt_compression, which is not read")
        self.parents = self._parents()

    def clip(self, name: str | None) -> Clip:
        animation = self._animation(name)
        targets = self._targets(animation)
        joints, roles = self._joints(targets)
        order = self._order(joints, targets)
        channels = self._channels(animation, {key: n for key, n in targets.items() if key[0] in order})
        times, fps = self._times(channels, animation, len(order))
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
            still[k] = turn
            turns, moves = channels.get((node, "rotation")), channels.get((node, "translation"))
            local[:, k] = turn if turns is None else _sampled(turns, times, fps, turning=True)
            ways[:, k] = over * (place if moves is None else _sampled(moves, times, fps, turning=False))
            offsets[k] = ways[0, k]  # where a joint is held is its place, whatever the file says of rest
        roots = above[0] + rotation.rotate(above[1], ways[:, 0])
        local[:, 0], still[0] = rotation.multiply(above[1], local[:, 0]), rotation.multiply(above[1], still[0])
        bound = self._bound(order, parents, still)
        over = np.where((parents >= 0)[:, None], bound[parents], rotation.IDENTITY)
        local = rotation.normalize(rotation.multiply(rotation.multiply(over, local), rotation.inverse(bound)))
        offsets, ways = rotation.rotate(over, offsets), rotation.rotate(over, ways)
        moving = len(order) > 1 and float(np.ptp(ways[:, 1:], axis=0).max()) > _HELD * float(np.abs(offsets).max())
        names = _different([_name(self.gltf.nodes[node].name, node) for node in order])
        told = {role: names[rows[node]] for role, node in roles.items() if node in rows} or self._told_roles(names)
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

    def _told_roles(self, names: Sequence[str]) -> dict[str, str]:
        """Roles that a file of ours tells, of joints that are there."""
        told = (self.gltf.extras or {}).get(TOLD_ROLES) if isinstance(self.gltf.extras, dict) else None
        pairs = told.items() if isinstance(told, dict) else ()
        return {role: name for role, name in pairs if role in ROLES and name in names}

    def _targets(self, animation: Any) -> dict[tuple[int, str], int]:
        """Which node's rotation, translation or scale each sampler moves."""
        found: dict[tuple[int, str], int] = {}
        for channel in animation.channels:
            node, path = channel.target.node, channel.target.path
            if node is not None and path in ("rotation", "translation", "scale"):
                self._there(self.gltf.nodes, node, "joint")
                found.setdefault((node, path), channel.sampler)
        if not any(path != "scale" for _, path in found):
            raise self._wrong("animates no node's rotation or place, expected an animated skeleton")
        return found

    def _channels(self, animation: Any, targets: Mapping[tuple[int, str], int]) -> dict[tuple[int, str], _Keys]:
        """The keys of those samplers; sizes that stay the same become the nodes' own."""
        found, total = {}, 0
        for (node, path), number in targets.items():
            sampler = self._there(animation.samplers, number, "sampler")
            times, values = self._values(sampler.input)[:, 0], self._values(sampler.output)
            total += values.size
            if total > MAX_VALUES:
                raise self._wrong(f"more than {MAX_VALUES:,} numbers of keys are more than a clip may hold")
            spline = sampler.interpolation == "CUBICSPLINE"
            expected = (3 if spline else 1) * len(times)
            if not len(times) or len(values) != expected or np.any(np.diff(times) <= 0.0):
                raise self._wrong(f"{path} of node {node}: {len(values)} values for {len(times)} rising times")
            if not (np.isfinite(times).all() and np.isfinite(values).all()):
                raise self._wrong(f"{path} of node {node}: a number is not finite")
            if values.shape[1] != (4 if path == "rotation" else 3):
                raise self._wrong(f"{path} of node {node} has {values.shape[1]} numbers")
            values = values.reshape(len(times), 3, -1) if spline else values
            if path == "scale":
                sizes = values[:, 1] if spline else values
                if np.ptp(sizes, axis=0).max() > _EVEN * np.abs(sizes).max():
                    raise self._wrong(f"node {node} changes its size over time, expected rotations and places only")
                self.sizes[node] = sizes[0]
                continue
            found[node, path] = _Keys(times, values, sampler.interpolation or "LINEAR")
        if not found:
            raise self._wrong("animates none of its joints, expected an animated skeleton")
        return found

    def _there(self, rows: Any, number: Any, what: str) -> Any:
        """A row by its number. Raises ``FormatError`` where there is none."""
        if not isinstance(number, int) or not 0 <= number < len(rows or []):
            raise self._wrong(f"{what} {number} is no {'node' if what == 'joint' else 'such'}, of {len(rows or [])}")
        return rows[number]

    def _joints(self, targets: Mapping[tuple[int, str], int]) -> tuple[list[int], dict[str, int]]:
        """The nodes that are joints, and the roles of those that the file names."""
        told = {**(self.gltf.extensions or {})}
        humanoid = (
            (told.get("VRMC_vrm_animation") or told.get("VRMC_vrm") or {}).get("humanoid", {}).get("humanBones", {})
        )
        named = {role: int(bone["node"]) for role, bone in humanoid.items() if role in ROLES}
        if len(set(named.values())) < len(named):
            raise self._wrong("its humanoid has one node in two roles")
        roles = {role: node for role, node in named.items() if self._there(self.gltf.nodes, node, "joint")}
        skinned = [int(joint) for skin in self.gltf.skins or [] for joint in skin.joints or []]
        # Without skin and roles: what moves, and all that hangs on it.
        joints = skinned or [*roles.values()] or [node for moving, _ in targets for node in self._tree(moving)]
        joints = list(dict.fromkeys(joints))
        for joint in joints:
            self._there(self.gltf.nodes, joint, "joint")
        return joints, {role: node for role, node in roles.items() if node in joints}

    def _order(self, joints: list[int], targets: Mapping[tuple[int, str], int]) -> list[int]:
        """Joints and what lies between, parents first: from the nearest node above all, or a higher one that moves."""
        lines = [self._line(joint) for joint in joints]
        shared = set.intersection(*(set(line) for line in lines))
        if not shared:
            raise self._wrong("its joints hang from several roots, expected one skeleton")
        nearest = max(shared, key=lambda node: len(self._line(node)))
        moving = {node for node, _ in targets}
        root = next((node for node in reversed(self._line(nearest)) if node in moving), nearest)
        wanted = {node for line in lines for node in line[: line.index(root) + 1]}
        return [node for node in self._tree(root) if node in wanted]

    def _tree(self, node: int) -> list[int]:
        """A node and all below it, parents first."""
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

    def _times(self, channels: Mapping[tuple[int, str], _Keys], animation: Any, n_joints: int) -> tuple[Float, float]:
        """Even moments from the first to the last key, and their rate: what the file tells, or that of its densest
        keys.
        """
        start = min(float(keys.times[0]) for keys in channels.values())
        end = max(float(keys.times[-1]) for keys in channels.values())
        told = (animation.extras or {}).get(FPS) if isinstance(animation.extras, dict) else None
        if isinstance(told, int | float) and 1.0 <= told <= 1000.0:
            rate = float(told)
        else:
            rate = _rate(max((keys.times for keys in channels.values()), key=len))
        length = (end - start) * rate
        if not 4.0 * length * n_joints <= MAX_VALUES:
            raise self._wrong(
                f"{end - start:g} s of {n_joints} joints at {rate:g} a second are more than a clip may hold"
            )
        return start + np.arange(int(length + 1.01 * _DRIFT) + 1) / rate, rate

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
        scale = self.sizes.get(node, scale)
        if not (scale.min() > 0.0 and np.ptp(scale) <= _EVEN * scale.max()):
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
        if number not in self.known:
            self.known[number] = self._read_values(number)
        return self.known[number]

    def _read_values(self, number: int) -> Float:
        accessor = self._there(self.gltf.accessors, number, "accessor")
        if accessor.sparse is not None or accessor.bufferView is None:
            raise self._wrong(f"accessor {number} is sparse or empty, which is not read")
        view = self._there(self.gltf.bufferViews, accessor.bufferView, "bufferView")
        kind, width = np.dtype(_COMPONENTS[accessor.componentType]), _WIDTHS[accessor.type]
        data = self._buffer(view.buffer)
        start = (view.byteOffset or 0) + (accessor.byteOffset or 0)
        stride = view.byteStride or width * kind.itemsize
        end = start + (accessor.count - 1) * stride + width * kind.itemsize
        limit = (view.byteOffset or 0) + view.byteLength
        if accessor.count * width > MAX_VALUES:
            raise self._wrong(f"accessor {number} holds {accessor.count} rows, more than a clip may")
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
            uri = self._there(self.gltf.buffers, number, "buffer").uri
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


def _rate(times: Float) -> float:
    """The frame rate that rising key times tell."""
    if len(times) < 2:
        return USUAL_FPS
    steps = np.diff(times)
    even = np.ptp(steps) < 0.01 * steps.mean() + 1e-5
    rate = float(1.0 / (steps.mean() if even else np.median(steps)))
    if not LEAST_FPS <= rate <= MOST_FPS:
        return USUAL_FPS
    length = float(times[-1] - times[0])
    for likely in (float(round(rate)), round(rate * 1.001) / 1.001):
        if abs(likely - rate) * length < _DRIFT and abs(likely - rate) < 1e-3 * rate:
            return likely
    return rate


def _name(told: Any, node: int) -> str:
    """A node's name as text that can be written anywhere."""
    name = told.encode("utf-8", "replace").decode() if isinstance(told, str) else ""
    return name or f"node {node}"


def _sampled(keys: _Keys, times: Float, fps: float, turning: bool) -> Float:
    """A channel at moments (T,): between keys as the file says, before and after them as at the first and last."""
    at = np.clip(times, keys.times[0], keys.times[-1])
    low = np.clip(np.searchsorted(keys.times, at, side="right") - 1, 0, max(len(keys.times) - 2, 0))
    high = np.minimum(low + 1, len(keys.times) - 1)
    span = keys.times[high] - keys.times[low]
    share = np.divide(at - keys.times[low], span, out=np.zeros_like(at), where=span > 0.0)
    share[(at - keys.times[low]) * fps < _NEAR] = 0.0
    share[(keys.times[high] - at) * fps < _NEAR] = 1.0
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
    taken = set(names)
    for name in names:
        own = name
        if name in out:
            own = next(numbered for n in count(2) if (numbered := f"{name} {n}") not in taken)
            taken.add(own)
        out.append(own)
    return out
