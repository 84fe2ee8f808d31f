"""A glTF 2.0 file as stored: its JSON document, the trees of its nodes, and the arrays in its buffers."""

from __future__ import annotations

import base64
import binascii
import math
import re
import struct
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import FormatError, LimitError
from signsplice.formats.json_files import parse_json, shortened
from signsplice.formats.limits import ReadLimits
from signsplice.formats.reading import read_bytes
from signsplice.motion.arrays import FloatArray

VRM_ANIMATION = "VRMC_vrm_animation"
"""The glTF extension of VRM animations."""
FPS_EXTRA, FACE_EXTRA, ROLES_EXTRA, HUMANOID_EXTRA = "fps", "face", "roles", "humanoid"
"""Names of our extras. Of an animation: its frame rate, and the coefficients of a face that stay at rest. Of the
document: role -> joint name, the roles of a roles file, and all that were found, for viewers.
"""
GENERATOR = "signsplice"
"""What our files name as their program."""
_KEEPS_JOINTS = re.compile(
    r"(KHR|EXT|MSFT|ADOBE)_((materials|texture|lights|mesh|xmp)_\w+"
    r"|draco_mesh_compression|node_visibility|animation_pointer)|VRM|VRMC_\w+"
)
"""Extensions that a file may require: they move no joint by keys of their own, or a warning names what they animate."""
COMPRESSED = ("KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_meshopt_compression")
"""Extensions of packed meshes, which are not read."""
UNPACK = "`npx @gltf-transform/cli copy IN.glb OUT.glb` unpacks it"
"""What a user can do about them; the command is free (MIT), and keeps no extensions of VRM."""
_VALUE_BYTES = 50
"""Memory that a value of a JSON document takes, about."""
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
    """The content of a glTF file. Raises ``FormatError`` where it is not valid, or the error that its content causes.

    file: its name, for messages.
    folder: where the buffer files that it names lie; None where it may name none.
    limits: of nodes, and of memory.
    given_bytes: size of the file, and of the buffer files read so far.
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
        if len(self.nodes) > limits.nodes:
            raise LimitError(f"{len(self.nodes):,} nodes, expected at most {limits.nodes:,.0f}", file=file)
        self._buffers: dict[int, bytes] = {}
        self._files: dict[str, bytes] = {}
        self._arrays: dict[int, FloatArray] = {}
        self._array_bytes = 0
        self.parents = self._parents()
        self.order = self._order_of_nodes()

    def _check_versions(self) -> None:
        """Raise ``FormatError`` where the file is for readers of another version, or of an extension that changes it
        (glTF 2.0, sections 3.2 and 3.12).
        """
        asset = self.json.get("asset") or {}
        version, least = str(asset.get("version") or ""), str(asset.get("minVersion") or "2.0")
        if not version.startswith("2."):
            raise self._error(f"is glTF {version or 'of no version'}, expected 2.0")
        if [int(part) for part in least.split(".")] > [2, 0]:
            raise self._error(f"needs a reader of glTF {least:.20}, expected 2.0")
        for name in self.json.get("extensionsRequired") or ():
            if not _KEEPS_JOINTS.fullmatch(name):
                remedy = UNPACK if name in COMPRESSED else "export it without"
                raise self._error(f"requires the extension {name!r:.80}, which is not read; {remedy}")

    def _parents(self) -> dict[int, int]:
        parents: dict[int, int] = {}
        for node, fields in enumerate(self.nodes):
            for child in self._field(fields, "children", [], f"node {node}"):
                if type(child) is not int or not 0 <= child < len(self.nodes) or child in parents or child == node:
                    raise self._error(f"node {child!r:.20} is a child of node {node} and of another, or does not exist")
                parents[child] = node
        return parents

    def _order_of_nodes(self) -> list[int]:
        """All nodes, parents first. Raises ``FormatError`` where they are not trees."""
        order = [node for node in range(len(self.nodes)) if node not in self.parents]
        for parent in order:
            order += self.nodes[parent].get("children") or ()
        if len(order) < len(self.nodes):
            node = min({*range(len(self.nodes))} - {*order})
            raise self._error(f"node {node} is its own ancestor, or below such a node")
        return order

    def _field(self, fields: Fields, name: str, default: Any, where: str) -> Any:
        """A property of an object; ``default`` where it is absent or null. Raises ``FormatError`` where it is not of
        the default's type: true is no number, whole numbers begin at 0, a tuple stands for as many finite numbers.
        """
        value = fields.get(name)
        if value is None:
            return default
        if isinstance(default, tuple):
            fits = isinstance(value, list) and len(value) == len(default)
            fits = fits and all(type(number) in (int, float) and abs(number) < math.inf for number in value)
            expected = f"{len(default)} finite numbers"
        else:
            fits = type(value) is type(default) and not (isinstance(value, int) and value < 0)
            expected = _TYPES[type(default)]
        if not fits:
            raise self._error(f"{where}: {name} is {shortened(value)}, expected {expected}")
        return value

    def _row(self, rows: Any, number: Any, what: str) -> Any:
        """A row of a table of the document by its number. Raises ``FormatError`` where there is none."""
        if type(number) is not int or not 0 <= number < len(rows or []):
            kind = "node" if what == "joint" else "such"
            raise self._error(f"{what} {number!r:.20} is no {kind}, of {len(rows or [])}")
        return rows[number]

    def _subtree(self, node: int) -> list[int]:
        """A node and all its descendants, parents first."""
        out = [node]
        for parent in out:
            out += self.nodes[parent].get("children") or ()
        return out

    def _path_to_root(self, node: int) -> list[int]:
        """A node and its ancestors, the root last."""
        out = [node]
        while out[-1] in self.parents:
            out.append(self.parents[out[-1]])
        return out

    def _values(self, number: int) -> FloatArray:
        """The values (N, width) of an accessor; integers that are marked as normalized as -1..1 or 0..1."""
        accessor = self._row(self.json.get("accessors"), number, "accessor")
        if number not in self._arrays:
            self._arrays[number] = self._read_values(accessor, number)
        return self._arrays[number]

    def _read_values(self, accessor: Fields, number: int) -> FloatArray:
        where, kind, width = f"accessor {number}", _COMPONENTS[accessor["componentType"]], _WIDTHS[accessor["type"]]
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
        what, index = f"the sparse part of accessor {number}", sparse["indices"]
        count = self._field(sparse, "count", 0, what)
        self.limits.check_memory(what, 8 * count * (values.shape[1] + 1), self.given_bytes, self.file)
        rows = self._rows(index, _COMPONENTS[index["componentType"]], 1, count, what)[:, 0]
        if rows.dtype.kind != "u" or rows.max() >= len(values):
            raise self._error(f"{what} names rows beyond its {len(values)}")
        values[rows] = self._rows(sparse["values"], kind, values.shape[1], count, what)

    def _rows(self, place: Fields, kind: type[np.generic], width: int, count: int, what: str) -> NDArray[Any]:
        """Rows (count, width) of numbers as they lie in a buffer, at the view and offset that ``place`` names."""
        view, dtype = self._row(self.json.get("bufferViews"), place["bufferView"], "bufferView"), np.dtype(kind)
        where, size = f"bufferView {place['bufferView']}", width * dtype.itemsize
        data, first = self._buffer(view["buffer"]), self._field(view, "byteOffset", 0, where)
        start, stride = first + self._field(place, "byteOffset", 0, what), self._field(view, "byteStride", size, where)
        if view.get("byteStride") is not None and not 4 <= stride <= 252:
            raise self._error(f"{where}: byteStride is {stride}, expected 4 to 252")
        end, last = start + (count - 1) * stride + size, first + self._field(view, "byteLength", 0, where)
        if count < 1 or stride < size or end > min(last, len(data)):
            raise self._error(f"{what} reaches beyond its {len(data)} bytes")
        return np.ndarray((count, width), dtype.newbyteorder("<"), data, start, (stride, dtype.itemsize))

    def _buffer(self, number: int) -> bytes:
        """The bytes of a buffer: the binary chunk, a data URI, or a file in the same folder."""
        uri = self._row(self.json.get("buffers"), number, "buffer").get("uri")
        if number not in self._buffers:
            if uri is None:
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
        """The bytes of a file that lies in the document's own folder, and does not only seem to by a link."""
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
    """The JSON chunk and the binary chunk of a .glb file, which come first and second; any others are extensions."""
    if len(content) < 20:
        raise FormatError(f"{len(content)} bytes are no glTF file, expected 20 at least", file=file)
    version, length = struct.unpack_from("<II", content, 4)
    if version != 2:
        raise FormatError(f"is glTF {version}, expected 2", file=file)
    if length > len(content):
        raise FormatError(f"has {len(content)} of its {length} bytes; it is cut short", file=file)
    found = {b"JSON": b"", b"BIN\0": b""}
    at = 12
    for kind in found:
        if at + 8 > length:
            break
        (size,), found_kind = struct.unpack_from("<I", content, at), content[at + 4 : at + 8]
        if at + 8 + size > length:
            raise FormatError(f"a chunk of {size} bytes at {at} reaches beyond the file's end", file=file)
        if found_kind == kind:
            found[kind] = content[at + 8 : at + 8 + size]
        elif kind == b"JSON":
            raise FormatError("has no JSON chunk, expected one", file=file)
        at += 8 + size
    return found[b"JSON"], found[b"BIN\0"]
