"""A glTF 2.0 file as stored: its JSON document, node trees, arrays in buffers and animation keys.

Also the code that skeleton readers share: roles of VRM humanoids, the order of joints, and rest poses of nodes.
"""

from __future__ import annotations

import base64
import binascii
import math
import re
import struct
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import FormatError
from signsplice.formats.gltf_unpack import MESHOPT, Check, View, unpack_views
from signsplice.formats.json_files import parse_json, shorten_json
from signsplice.formats.reading import ReadLimits, check_most, read_bytes
from signsplice.motion import FloatArray, rotation
from signsplice.rig.roles import ROLES

VRM_ANIMATION = "VRMC_vrm_animation"
"""The glTF extension of VRM animations."""
FPS_EXTRA = "fps"
"""Our extra of an animation: its frame rate."""
FACE_EXTRA = "face"
"""Our extra of an animation: the face coefficients that stay at rest."""
ROLES_EXTRA = "roles"
"""Our extra of the document: role -> joint name, from a roles file."""
HUMANOID_EXTRA = "humanoid"
"""Our extra of the document: role -> joint name of all known roles, for viewers."""
REPORT_EXTRA = "signsplice_report"
"""Our extra of the document: the report of the splice that made its animation, as JSON text."""
GENERATOR = "signsplice"
"""What our files name as their program."""
_KEEPS_JOINTS = re.compile(
    r"(KHR|EXT|MSFT|ADOBE)_((materials|texture|lights|mesh|xmp)_\w+"
    r"|draco_mesh_compression|meshopt_compression|node_visibility|animation_pointer)|VRM|VRMC_\w+"
)
"""Extensions that a file may require: they move no joint by keys of their own, or a warning names what they animate."""
_VALUE_BYTES = 50
"""Approximate bytes of memory that a value of a JSON document takes."""
_COMPONENTS: dict[int, type[np.generic]] = {
    5120: np.int8,
    5121: np.uint8,
    5122: np.int16,
    5123: np.uint16,
    5125: np.uint32,
    5126: np.float32,
}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_TYPES = {bool: "true or false", int: "a whole number from 0", str: "a text", dict: "an object", list: "a list"}

Fields = dict[str, Any]
"""An object of the document: its property names and values, as glTF 2.0 defines them."""


class Document:
    """The content of a glTF file. Raises ``FormatError`` if it is not valid, or whatever error broken content causes,
    which ``reading.format_errors`` turns into one.

    file: its name, for messages.
    folder: the folder of its buffer files; None if it may name none.
    limits: of nodes and memory.
    given_bytes: size of the file and of the buffer files read so far.
    json: the document.
    nodes: its nodes.
    parents: node -> parent node; roots are left out.
    order: all nodes, parents before children.
    """

    def __init__(self, file: str, content: bytes, limits: ReadLimits, folder: Path | None) -> None:
        self.file, self.limits, self.folder, self.given_bytes = file, limits, folder, len(content)
        text, self._blob = chunks(file, content) if content[:4] == b"glTF" else (content, b"")
        n_values = sum(text.count(mark) for mark in (b",", b"{", b"["))
        limits.check_memory(f"{n_values:,} values of JSON", _VALUE_BYTES * n_values, len(text), file)
        self.json: Fields = parse_json(text, file, "a glTF document")
        if not isinstance(self.json, dict):
            raise self._error("its JSON is no object")
        self._check_versions()
        self.nodes: list[Fields] = self._field(self.json, "nodes", [], "the document")
        check_most(len(self.nodes), "nodes", limits.nodes, file)
        self._buffers: dict[int, bytes] = {}
        self._files: dict[str, bytes] = {}
        self._arrays: dict[int, FloatArray] = {}
        self._array_bytes = 0
        if {*MESHOPT} & {*(self.json.get("extensionsUsed") or ())}:
            self._unpack(unpack_views)
        self.parents = self._parents()
        self.order = self._order_of_nodes()

    def _unpack(self, unpack: Callable[[Fields, View, Check], bytes]) -> None:
        """Unpack content of the document, one of the functions of ``gltf_unpack``."""
        content = unpack(self.json, self._packed, self._check_unpacked)
        self._buffers[len(self.json["buffers"]) - 1] = content

    def _packed(self, place: Fields) -> bytes:
        """Return the bytes at a place in a buffer."""
        first = self._field(place, "byteOffset", 0, "packed content")
        return self._buffer(place.get("buffer"))[first : first + self._field(place, "byteLength", 0, "packed content")]

    def _check_unpacked(self, what: str, n_bytes: int) -> None:
        self.limits.check_memory(what, n_bytes, self.given_bytes, self.file)

    def _check_versions(self) -> None:
        """Raise ``FormatError`` if the file needs another glTF version or an extension that is not read (glTF 2.0,
        sections 3.2 and 3.12).
        """
        asset = self._field(self.json, "asset", {}, "the document")
        version, least = str(asset.get("version") or ""), str(asset.get("minVersion") or "2.0")
        if not version.startswith("2."):
            raise self._error(f"is glTF {version or 'of no version':.40}, expected 2.0")
        if [int(part) for part in least.split(".")] > [2, 0]:
            raise self._error(f"needs a reader of glTF {least:.20}, expected 2.0")
        for name in self.json.get("extensionsRequired") or ():
            if not _KEEPS_JOINTS.fullmatch(name):
                raise self._error(f"requires the extension {name!r:.80}, which is not read; export it without")

    def _parents(self) -> dict[int, int]:
        parents: dict[int, int] = {}
        for node, fields in enumerate(self.nodes):
            for child in self._field(fields, "children", [], f"node {node}"):
                if type(child) is not int or not 0 <= child < len(self.nodes) or child in parents or child == node:
                    raise self._error(f"node {child!r:.20} is a child of node {node} and of another, or does not exist")
                parents[child] = node
        return parents

    def _order_of_nodes(self) -> list[int]:
        """Return all nodes, parents first. Raises ``FormatError`` if they are not trees."""
        order = [node for node in range(len(self.nodes)) if node not in self.parents]
        for parent in order:
            order += self.nodes[parent].get("children") or ()
        if len(order) < len(self.nodes):
            node = min({*range(len(self.nodes))} - {*order})
            raise self._error(f"node {node} is its own ancestor, or below such a node")
        return order

    def _field(self, fields: Fields, name: str, default: Any, where: str) -> Any:
        """Return a property of an object, or ``default`` if it is absent or null; a type as default requires it.

        Raises ``FormatError`` if it has not the default's type: true is not a number, whole numbers begin at 0, a tuple
        stands for as many finite numbers.
        """
        if not isinstance(fields, dict):
            raise self._error(f"{where} is {shorten_json(fields)}, expected an object")
        value: Any = fields.get(name)
        kind = default if isinstance(default, type) else type(default)
        if value is None and kind is not default:
            return default
        if isinstance(default, tuple):
            fits = isinstance(value, list) and len(value) == len(default)
            fits = fits and all(type(number) in (int, float) and abs(number) < math.inf for number in value)
            expected = f"{len(default)} finite numbers"
        else:
            fits = type(value) is kind and not (isinstance(value, int) and value < 0)
            expected = _TYPES[kind]
        if not fits:
            raise self._misfit(where, name, value, expected)
        return value

    def _misfit(self, where: str, name: str, value: Any, expected: str) -> FormatError:
        found = f"{where} has no {name}" if value is None else f"{where}: {name} is {shorten_json(value)}"
        return self._error(f"{found}, expected {expected}")

    def _choice(self, fields: Fields, name: str, choices: Mapping[Any, Any], where: str) -> Any:
        """Return what stands for a property's value in a table. Raises ``FormatError`` if it is none of its keys."""
        value = fields.get(name)
        if type(value) not in (int, str) or value not in choices:
            raise self._misfit(where, name, value, f"one of {', '.join(map(str, choices))}")
        return choices[value]

    def _row(self, rows: Any, number: Any, what: str) -> Any:
        """Return a row of a table of the document. Raises ``FormatError`` if the number is out of range."""
        rows = rows if isinstance(rows, list) else []
        if type(number) is not int or not 0 <= number < len(rows):
            kind = "node" if what == "joint" else "such"
            raise self._error(f"{what} {number!r:.20} is no {kind}, of {len(rows)}")
        if not isinstance(rows[number], dict):
            raise self._error(f"{what} {number} is {shorten_json(rows[number])}, expected an object")
        return rows[number]

    def _subtree(self, node: int) -> list[int]:
        """A node and all its descendants, parents first."""
        nodes = [node]
        for parent in nodes:
            nodes += self.nodes[parent].get("children") or ()
        return nodes

    def _path_to_root(self, node: int) -> list[int]:
        """A node and its ancestors, the root last."""
        path = [node]
        while path[-1] in self.parents:
            path.append(self.parents[path[-1]])
        return path

    def _values(self, number: int) -> FloatArray:
        """Return the values (N, width) of an accessor; normalized integers become -1..1 or 0..1."""
        accessor = self._row(self.json.get("accessors"), number, "accessor")
        if number not in self._arrays:
            self._arrays[number] = self._read_values(accessor, number)
        return self._arrays[number]

    def _read_values(self, accessor: Fields, number: int) -> FloatArray:
        where = f"accessor {number}"
        kind = self._choice(accessor, "componentType", _COMPONENTS, where)
        width = self._choice(accessor, "type", _WIDTHS, where)
        count = self._field(accessor, "count", 0, where)
        stored = accessor.get("bufferView") is not None
        if not stored and accessor.get("sparse") is None:
            raise self._error(f"{where} is empty, expected values")
        rows = self._rows(accessor, kind, width, count, where) if stored else None
        self._array_bytes += 8 * count * width
        self.limits.check_memory(f"accessors up to {number}", self._array_bytes, self.given_bytes, self.file)
        values = np.zeros((count, width)) if rows is None else rows.astype(np.float64)
        if accessor.get("sparse") is not None:
            self._replace_sparse(values, accessor["sparse"], kind, number)
        if self._field(accessor, "normalized", False, where):
            if np.dtype(kind).itemsize > 2:
                raise self._error(f"{where} is normalized, but not of numbers of 8 or 16 bits, as it has to be")
            bits = 8 * np.dtype(kind).itemsize - (np.dtype(kind).kind == "i")
            values = np.maximum(values / float(2**bits - 1), -1.0)
        return values

    def _replace_sparse(self, values: FloatArray, sparse: Fields, kind: type[np.generic], number: int) -> None:
        """Write the rows that a sparse accessor replaces into its ``values`` (N, width)."""
        what = f"the sparse part of accessor {number}"
        count, index = self._field(sparse, "count", 0, what), self._field(sparse, "indices", dict, what)
        self.limits.check_memory(what, 8 * count * (values.shape[1] + 1), self.given_bytes, self.file)
        rows = self._rows(index, self._choice(index, "componentType", _COMPONENTS, what), 1, count, what)[:, 0]
        if rows.dtype.kind != "u" or rows.max() >= len(values):
            raise self._error(f"{what} names rows beyond its {len(values)}")
        values[rows] = self._rows(self._field(sparse, "values", dict, what), kind, values.shape[1], count, what)

    def _rows(self, place: Fields, kind: type[np.generic], width: int, count: int, what: str) -> NDArray[Any]:
        """Return a view of rows (count, width) of numbers in a buffer, at the view and offset that ``place`` names."""
        number, dtype = place.get("bufferView"), np.dtype(kind)
        view = self._row(self.json.get("bufferViews"), number, "bufferView")
        where, size = f"bufferView {number}", width * dtype.itemsize
        data, first = self._buffer(view.get("buffer")), self._field(view, "byteOffset", 0, where)
        start, stride = first + self._field(place, "byteOffset", 0, what), self._field(view, "byteStride", size, where)
        if view.get("byteStride") is not None and not 4 <= stride <= 252:
            raise self._error(f"{where}: byteStride is {stride}, expected 4 to 252")
        end, last = start + (count - 1) * stride + size, first + self._field(view, "byteLength", 0, where)
        if count < 1 or stride < size or end > min(last, len(data)):
            raise self._error(f"{what} reaches beyond its {len(data)} bytes")
        return np.ndarray((count, width), dtype.newbyteorder("<"), data, start, (stride, dtype.itemsize))

    def _buffer(self, number: Any) -> bytes:
        """Return the bytes of a buffer: the binary chunk, a data URI, or a file in the same folder."""
        fields = self._row(self.json.get("buffers"), number, "buffer")
        if number not in self._buffers:
            uri = self._field(fields, "uri", "", f"buffer {number}")
            if fields.get("uri") is None:
                if number != 0:
                    raise self._error(f"buffer {number} has no data")
                self._buffers[number] = self._blob
            elif uri.startswith("data:"):
                try:
                    self._buffers[number] = base64.b64decode(uri.partition(",")[2], validate=True)
                except binascii.Error as error:
                    raise self._error(f"buffer {number} is no base64 ({error})") from error
            else:
                self._buffers[number] = self._buffer_file(number, unquote(uri))
        return self._buffers[number]

    def _buffer_file(self, number: int, name: str) -> bytes:
        """Return the bytes of a file in the document's own folder; links that lead out of it are refused."""
        if self.folder is None:
            raise self._error(f"buffer {number} lies in another file, {name!r:.80}, expected all in one")
        if not name or Path(name).name != name or "\\" in name or "\0" in name:
            raise self._error(f"buffer {number} lies at {name!r:.80}, expected a file in the same folder")
        if name not in self._files:
            path = (self.folder / name).resolve()
            if path.parent != self.folder.resolve():
                raise self._error(f"buffer {number} lies at {name!r}, a link out of the folder; copy the file there")
            self._files[name] = read_bytes(path, self.limits.file_bytes - self.given_bytes)
            self.given_bytes += len(self._files[name])
        return self._files[name]

    def _error(self, what: str) -> FormatError:
        return FormatError(what, file=self.file)


def chunks(file: str, content: bytes) -> tuple[bytes, bytes]:
    """Return the JSON chunk and the binary chunk of a .glb file, its first two; further chunks are extensions."""
    if len(content) < 20:
        raise FormatError(f"{len(content)} bytes are no glTF file, expected 20 at least", file=file)
    version, length = struct.unpack_from("<II", content, 4)
    if version != 2:
        raise FormatError(f"is glTF {version}, expected 2", file=file)
    if length > len(content):
        raise FormatError(f"has {len(content)} of its {length} bytes; it is cut short", file=file)
    parts = {b"JSON": b"", b"BIN\0": b""}
    position = 12
    for kind in parts:
        if position + 8 > length:
            break
        (size,), found_kind = struct.unpack_from("<I", content, position), content[position + 4 : position + 8]
        if position + 8 + size > length:
            raise FormatError(f"a chunk of {size} bytes at {position} reaches beyond the file's end", file=file)
        if found_kind == kind:
            parts[kind] = content[position + 8 : position + 8 + size]
        elif kind == b"JSON":
            raise FormatError("has no JSON chunk, expected one", file=file)
        position += 8 + size
    return parts[b"JSON"], parts[b"BIN\0"]


LEAST_FPS = 10.0
"""Lowest frame rate that keys imply; files with sparser keys are sampled at ``USUAL_FPS``."""
MOST_FPS = 240.0
"""Highest frame rate that keys imply; files with denser keys are sampled at ``USUAL_FPS``."""
USUAL_FPS = 30.0
"""Frame rate of a file whose keys imply none."""
DRIFT = 0.1
"""A rate is rounded to a whole number or an NTSC rate (k 1000 / 1001) if that moves no key by more frames than this."""
INTERPOLATIONS = ("LINEAR", "STEP", "CUBICSPLINE")
_NEAR = 1e-3
"""A time within this fraction of a frame of a key is at that key: files store times in 32 bits."""


@dataclass(frozen=True)
class Keys:
    """The keys of one animated channel.

    times: (K,) seconds, rising.
    values: (K, 3) or (K, 4); for splines (K, 3, 3) or (K, 3, 4): in-tangent, value, out-tangent.
    interpolation: one of ``INTERPOLATIONS``.
    """

    times: FloatArray
    values: FloatArray
    interpolation: str


def frame_rate(times: FloatArray) -> float:
    """Return the frame rate that rising key times (K,) imply."""
    if len(times) < 2:
        return USUAL_FPS
    steps = np.diff(times)
    even = np.ptp(steps) < 0.01 * steps.mean() + 1e-5
    rate = float(1.0 / (steps.mean() if even else np.median(steps)))
    if not LEAST_FPS <= rate <= MOST_FPS:
        return USUAL_FPS
    length = float(times[-1] - times[0])
    for likely in (float(round(rate)), round(rate * 1.001) / 1.001):
        if abs(likely - rate) * length < DRIFT and abs(likely - rate) < 1e-3 * rate:
            return likely
    return rate


def sample(keys: Keys, times: FloatArray, fps: float, rotations: bool) -> FloatArray:
    """Sample a channel at ``times`` (T,): (T, 3), or unit quaternions (T, 4) for ``rotations``.

    Interpolates between keys as the file says; before the first and after the last key, holds the value there.
    """
    clamped_times = np.clip(times, keys.times[0], keys.times[-1])
    low = np.clip(np.searchsorted(keys.times, clamped_times, side="right") - 1, 0, max(len(keys.times) - 2, 0))
    high = np.minimum(low + 1, len(keys.times) - 1)
    since, until = clamped_times - keys.times[low], keys.times[high] - clamped_times
    span = keys.times[high] - keys.times[low]
    weight = np.divide(since, span, out=np.zeros_like(clamped_times), where=span > 0.0)
    weight[since * fps < _NEAR] = 0.0
    weight[(until * fps < _NEAR) & (until < since)] = 1.0
    if keys.interpolation == "CUBICSPLINE":
        s, t = weight[:, None], span[:, None]
        a, out_tangent = keys.values[low, 1], t * keys.values[low, 2]
        b, in_tangent = keys.values[high, 1], t * keys.values[high, 0]
        values = (
            (1 + 2 * s) * (1 - s) ** 2 * a
            + s * (1 - s) ** 2 * out_tangent
            + s**2 * (3 - 2 * s) * b
            + s**2 * (s - 1) * in_tangent
        )
        return rotation.normalize(values) if rotations else np.asarray(values)
    if keys.interpolation == "STEP":
        weight = np.where(weight >= 1.0, 1.0, 0.0)
    a, b = keys.values[low], keys.values[high]
    if rotations:
        return rotation.slerp(rotation.normalize(a), rotation.normalize(b), weight)
    return np.asarray(a + weight[:, None] * (b - a))


EVEN = 1e-3
"""Scales that differ by less than this fraction, between axes or over time, are equal."""
VRM_0 = "VRM"
"""The glTF extension of VRM 0.x avatars."""
VRM_1 = "VRMC_vrm"
"""The glTF extension of VRM 1.0 avatars."""
_LENGTH = 0.05
"""By how much the length of a stored rotation may differ from 1; rounding to 8 bits changes it by less than 0.02."""
_ROW = 1e-5
"""By how much a matrix's last row may differ from 0, 0, 0, 1."""
_NAMED = 5
"""Most items that a note names."""
_THUMBS = {"ThumbProximal": "ThumbMetacarpal", "ThumbIntermediate": "ThumbProximal"}
"""Bones of a thumb in VRM 0.x -> their roles in VRM 1.0."""


class SkeletonDocument(Document):
    """A document whose skeleton is being read.

    notes: a line about joints whose names stand twice.
    scales: node -> scale (3,), of nodes whose scale an animation sets.
    skins: the document's skins, whose joints are nodes.
    """

    def __init__(self, file: str, content: bytes, limits: ReadLimits, folder: Path | None) -> None:
        super().__init__(file, content, limits, folder)
        self.notes: tuple[str, ...] = ()
        self.scales: dict[int, FloatArray] = {}
        self.skins: list[Fields] = self._field(self.json, "skins", [], "the document")
        for number, skin in enumerate(self.skins):
            joints: list[Any] = self._field(skin, "joints", list, f"skin {number}")
            for joint in joints:
                self._row(self.nodes, joint, "joint")

    def _humanoid(self) -> dict[str, int]:
        """Role -> node of the VRM humanoid; empty if the file has none."""
        extensions = self._field(self.json, "extensions", {}, "the document")
        name = next((name for name in (VRM_ANIMATION, VRM_1) if extensions.get(name) is not None), VRM_0)
        humanoid = self._field(self._field(extensions, name, {}, "extensions"), "humanoid", {}, name)
        bones = self._field(humanoid, "humanBones", [] if name == VRM_0 else {}, name)
        if name == VRM_0:
            bones = {_role_of_vrm_0(self._field(bone, "bone", str, "a bone of the humanoid")): bone for bone in bones}
        roles = {role: self._field(bones, role, dict, "the humanoid").get("node") for role in bones if role in ROLES}
        for node in roles.values():
            self._row(self.nodes, node, "joint")
        if len(set(roles.values())) < len(roles):
            raise self._error("its humanoid has one node in two roles")
        return roles

    def _joint_order(self, joints: Set[int], animated: Collection[int] = ()) -> list[int]:
        """Return the joints and the nodes between them, parents first. Raises ``LimitError`` if there are too many.

        The root is the nearest common ancestor of all joints, or the highest animated node above it.
        """
        n_below = self._count_below(joints)
        above_all = [node for node in self.order if n_below[node] == len(joints)]  # a path from the root down
        if not above_all:
            raise self._error("its joints hang from several roots, expected one skeleton")
        root = next((node for node in above_all if node in animated), above_all[-1])
        order = [node for node in self._subtree(root) if n_below[node]]
        check_most(len(order), "joints", self.limits.joints, self.file)
        return order

    def _count_below(self, joints: Set[int]) -> list[int]:
        """Return how many joints are at or below each node."""
        n_below = [int(node in joints) for node in range(len(self.nodes))]
        for node in reversed(self.order):
            if node in self.parents:
                n_below[self.parents[node]] += n_below[node]
        return n_below

    def _tree(self, order: Sequence[int]) -> tuple[dict[int, int], NDArray[np.intp], list[str]]:
        """Return, for J joints, parents first: node -> row, the row of each one's parent (J,), -1 for none, and unique
        names.
        """
        rows = {node: k for k, node in enumerate(order)}
        parents = np.array([rows.get(self.parents.get(node, -1), -1) for node in order])
        stored_names = [printable(self.nodes[node].get("name"), f"node {node}") for node in order]
        names = unique(stored_names)
        self.notes = renamed(stored_names, names)
        return rows, parents, names

    def _bind_matrices(self, skin: Fields) -> FloatArray | None:
        """Return a skin's inverse bind matrices (B, 4, 4), from mesh to joint axes; None if it has none."""
        if skin.get("inverseBindMatrices") is None:
            return None
        n_joints = len(skin["joints"])
        matrices = self._affine(self._values(skin["inverseBindMatrices"])[:n_joints], "an inverse bind matrix")
        if len(matrices) < n_joints or not np.isfinite(matrices).all():
            raise self._error(f"a skin binds {n_joints} joints with {len(matrices)} valid matrices")
        return matrices

    def _affine(self, columns: FloatArray, what: str) -> FloatArray:
        """Return matrices (N, 4, 4) stored by columns (N, 16). Raises ``FormatError`` if one is a projection."""
        matrices = columns.reshape(-1, 4, 4).transpose(0, 2, 1)
        wrong = matrices[np.abs(matrices[:, 3] - [0.0, 0.0, 0.0, 1.0]).max(axis=1) > _ROW]
        if len(wrong):
            raise self._error(f"{what} has the last row {wrong[0, 3].tolist()}, expected 0, 0, 0, 1")
        return matrices

    def _check_rotations(self, quats: FloatArray, what: str) -> None:
        """Raise ``FormatError`` if the length of a quaternion (..., 4) is not 1."""
        lengths = np.linalg.norm(quats, axis=-1)
        wrong = lengths[~(np.abs(lengths - 1.0) <= _LENGTH)]
        if len(wrong):
            raise self._error(f"{what}: a rotation has length {wrong[0]:.3g}, expected 1; export the file anew")

    def _node_label(self, node: int) -> str:
        return f"node {self.nodes[node].get('name') or node!r:.80}"

    def _node_matrix(self, node: int) -> FloatArray | None:
        """Return a node's matrix (4, 4), or None if the node is stored without one."""
        if self.nodes[node].get("matrix") is None:
            return None
        columns = np.array(self._field(self.nodes[node], "matrix", (0.0,) * 16, self._node_label(node)), np.float64)
        return self._affine(columns, f"the matrix of {self._node_label(node)}").reshape(4, 4)

    def _node_trs(self, node: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return position (3,), rotation (4,) and scale (3,) of a node that is stored without a matrix."""
        defaults = (("translation", (0.0,) * 3), ("rotation", (0.0, 0.0, 0.0, 1.0)), ("scale", (1.0,) * 3))
        position, quat, scale = (
            np.array(self._field(self.nodes[node], name, default, self._node_label(node)), np.float64)
            for name, default in defaults
        )
        self._check_rotations(quat[None], self._node_label(node))
        return position, rotation.normalize(quat), scale

    def _local_pose(self, node: int) -> tuple[FloatArray, FloatArray, float]:
        """Return a node's position (3,), rotation (4,) and scale at rest, relative to its parent."""
        matrix, named = self._node_matrix(node), self._node_label(node)
        if matrix is not None:
            scale = np.linalg.norm(matrix[:3, :3], axis=0)
            axes = matrix[:3, :3] / np.where(scale == 0.0, 1.0, scale)
            if not (np.linalg.det(axes) > 0.0 and np.abs(axes.T @ axes - np.eye(3)).max() <= EVEN):
                raise self._error(f"the matrix of {named} mirrors or shears, expected rotation and even scale")
            position, quat = matrix[:3, 3], rotation.from_matrix(axes)
        else:
            position, quat, scale = self._node_trs(node)
        scale = self.scales.get(node, scale)
        if not (scale.min() > 0.0 and np.ptp(scale) <= EVEN * scale.max()):
            raise self._error(f"{named} is scaled by {scale.tolist()}, expected one positive number")
        return position, quat, float(scale.mean())

    def _world_pose(self, node: int | None) -> tuple[FloatArray, FloatArray, float]:
        """Return a node's position (3,), rotation (4,) and scale in the world at rest; the identity for None."""
        position, quat, scale = np.zeros(3), rotation.IDENTITY, 1.0
        for ancestor in reversed([] if node is None else self._path_to_root(node)):
            local_position, local_quat, local_scale = self._local_pose(ancestor)
            position = position + rotation.rotate(quat, scale * local_position)
            quat, scale = rotation.multiply(quat, local_quat), scale * local_scale
        return position, quat, scale


def _role_of_vrm_0(bone: str) -> str:
    """Translate a bone name of VRM 0.x into a role, which has VRM 1.0's name."""
    for old, new in _THUMBS.items():
        if bone.endswith(old):
            return bone.removesuffix(old) + new
    return bone


def to_rest_axes(quats: FloatArray, translations: FloatArray, bound: FloatArray, parent_bound: FloatArray) -> None:
    """Convert local rotations (T, J, 4) and translations (T, J, 3), in place, to joints with the world's axes at rest.

    bound, parent_bound: (J, 4) global rest rotations of each joint and of its parent.
    """
    for k in range(len(bound)):  # joint by joint, to keep the memory of intermediate results small
        turned = rotation.multiply(rotation.multiply(parent_bound[k], quats[:, k]), rotation.inverse(bound[k]))
        quats[:, k] = rotation.continuous(rotation.normalize(turned))
        translations[:, k] = rotation.rotate(parent_bound[k], translations[:, k])


def others_left(what: str, others: Sequence[str]) -> tuple[str, ...]:
    """Return a line that says what is read and what is not; none if nothing is left out."""
    if not others:
        return ()
    names = ", ".join(f"{name!r:.80}" for name in others[:_NAMED])
    suffix = f", nor {len(others) - _NAMED} more" if len(others) > _NAMED else ""
    return (f"{what} is read, not {names}{suffix}",)


def printable(name: Any, otherwise: str) -> str:
    """Return a name as text that can be written to any file; ``otherwise`` if there is none."""
    return (name.encode("utf-8", "replace").decode() if isinstance(name, str) else "") or otherwise


def renamed(names: Sequence[str], new_names: Sequence[str]) -> tuple[str, ...]:
    """Return a line with the new names of joints whose names stood twice; none if there are none."""
    changed = [f"{new!r:.80}" for name, new in zip(names, new_names, strict=True) if name != new]
    more = f" and {len(changed) - _NAMED} more" if len(changed) > _NAMED else ""
    return (f"joint names that stand twice get a number: {', '.join(changed[:_NAMED])}{more}",) if changed else ()


def unique(names: Sequence[str], separator: str = " ") -> list[str]:
    """Make names unique: a repeated name gets a number, after a separator."""
    unique_names: list[str] = []
    taken, used = set(names), set()
    numbers: dict[str, Iterator[int]] = {}
    for name in names:
        candidate = name
        if name in used:
            counter = numbers.setdefault(name, count(2))
            candidate = next(numbered for n in counter if (numbered := f"{name}{separator}{n}") not in taken)
            taken.add(candidate)
        used.add(candidate)
        unique_names.append(candidate)
    return unique_names
