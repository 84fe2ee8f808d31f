"""A glTF 2.0 file as stored: its JSON document, the tree of its nodes, and the arrays in its buffers."""

from __future__ import annotations

import base64
import binascii
import json
import struct
import warnings
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray
from pygltflib import GLTF2

from signsplice.errors import FormatError
from signsplice.formats.atomic import read_bytes

Float = NDArray[np.float64]

VRM_ANIMATION = "VRMC_vrm_animation"
"""The glTF extension of VRM animations."""
FPS_EXTRA, ROLES_EXTRA, HUMANOID_EXTRA = "fps", "roles", "humanoid"
"""Names of our extras. Of an animation: its frame rate. Of the document: role -> joint name, the roles of a roles file,
and all that were found, for viewers.
"""
MAX_VALUES = 20_000_000
"""A file is refused that has more numbers in its keys, or in its clip's rotations (frames x joints x 4)."""
_COMPONENTS = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


class Document:
    """The content of a glTF file. Raises ``FormatError`` where it is not valid.

    file: its name, for messages.
    folder: where the buffer files that it names lie; None where it may name none.
    gltf: the document.
    blob: the binary chunk of a .glb, else empty.
    parents: node -> parent node; roots are left out.
    """

    def __init__(self, file: str, content: bytes, folder: Path | None) -> None:
        self.file, self.folder = file, folder
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about extensions that are not read
            if content[:4] == b"glTF":
                self.gltf, self.blob = _binary(file, content)
            else:
                self.gltf, self.blob = GLTF2.from_json(content.decode("utf-8-sig"), infer_missing=True), b""
        self._buffers: dict[int, bytes] = {}
        self._arrays: dict[int, Float] = {}
        version = str(getattr(self.gltf.asset, "version", "") or "")
        if not version.startswith("2."):
            raise self._error(f"is glTF {version or 'of no version'}, expected 2.0")
        if "EXT_meshopt_compression" in (self.gltf.extensionsRequired or []):
            raise self._error("its buffers are compressed by EXT_meshopt_compression, which is not read")
        self.parents = self._parents()

    def _parents(self) -> dict[int, int]:
        """Node -> parent node. Raises ``FormatError`` where the nodes are not trees."""
        parents: dict[int, int] = {}
        for node, fields in enumerate(self.gltf.nodes or []):
            for child in fields.children or []:
                if not 0 <= child < len(self.gltf.nodes) or child in parents or child == node:
                    raise self._error(f"node {child} is a child of node {node} and of another, or does not exist")
                parents[child] = node
        for node in parents:
            seen, ancestor = {node}, parents[node]
            while ancestor in parents and ancestor not in seen:
                seen.add(ancestor)
                ancestor = parents[ancestor]
            if ancestor in seen:
                raise self._error(f"node {node} is its own ancestor")
        return parents

    def _row(self, rows: Any, number: Any, what: str) -> Any:
        """A row of a table of the document by its number. Raises ``FormatError`` where there is none."""
        if not isinstance(number, int) or not 0 <= number < len(rows or []):
            raise self._error(f"{what} {number} is no {'node' if what == 'joint' else 'such'}, of {len(rows or [])}")
        return rows[number]

    def _subtree(self, node: int) -> list[int]:
        """A node and all its descendants, parents first."""
        out = [node]
        for parent in out:
            out += self.gltf.nodes[parent].children or []
        return out

    def _path_to_root(self, node: int) -> list[int]:
        """A node and its ancestors, the root last."""
        out = [node]
        while out[-1] in self.parents:
            out.append(self.parents[out[-1]])
        return out

    def _values(self, number: int) -> Float:
        """The values (N, width) of an accessor; integers that are marked as normalized as -1..1 or 0..1."""
        if number not in self._arrays:
            self._arrays[number] = self._read_values(number)
        return self._arrays[number]

    def _read_values(self, number: int) -> Float:
        accessor = self._row(self.gltf.accessors, number, "accessor")
        if accessor.sparse is not None or accessor.bufferView is None:
            raise self._error(f"accessor {number} is sparse or empty, which is not read")
        view = self._row(self.gltf.bufferViews, accessor.bufferView, "bufferView")
        kind, width = np.dtype(_COMPONENTS[accessor.componentType]), _WIDTHS[accessor.type]
        data = self._buffer(view.buffer)
        start = (view.byteOffset or 0) + (accessor.byteOffset or 0)
        stride = view.byteStride or width * kind.itemsize
        end = start + (accessor.count - 1) * stride + width * kind.itemsize
        limit = (view.byteOffset or 0) + view.byteLength
        if accessor.count * width > MAX_VALUES:
            raise self._error(f"accessor {number} holds {accessor.count} rows, more than a clip may")
        if accessor.count < 1 or start < 0 or stride < width * kind.itemsize or end > min(limit, len(data)):
            raise self._error(f"accessor {number} reaches beyond its {len(data)} bytes")
        rows = np.ndarray((accessor.count, width), kind.newbyteorder("<"), data, start, (stride, kind.itemsize))
        values = rows.astype(np.float64)
        if accessor.normalized and kind.kind in "iu":
            values = np.maximum(values / float(2 ** (8 * kind.itemsize - (kind.kind == "i")) - 1), -1.0)
        return values

    def _buffer(self, number: int) -> bytes:
        """The bytes of a buffer: the binary chunk, a data URI, or a file in the same folder."""
        if number not in self._buffers:
            uri = self._row(self.gltf.buffers, number, "buffer").uri
            if uri is None:
                if number != 0:
                    raise self._error(f"buffer {number} has no data")
                self._buffers[number] = self.blob
            elif uri.startswith("data:"):
                try:
                    self._buffers[number] = base64.b64decode(uri.partition(",")[2], validate=True)
                except binascii.Error as error:
                    raise self._error(f"buffer {number} is no base64 ({error})") from error
            else:
                name = unquote(uri)
                if self.folder is None:
                    raise self._error(f"buffer {number} lies in another file, {uri!r}, expected all in one")
                if not name or Path(name).name != name or "\\" in name or "\0" in name:
                    raise self._error(f"buffer {number} lies at {uri!r}, expected a file in the same folder")
                self._buffers[number] = read_bytes(self.folder / name)
        return self._buffers[number]

    def _error(self, what: str) -> FormatError:
        return FormatError(what, file=self.file)


def _binary(file: str, content: bytes) -> tuple[GLTF2, bytes]:
    """The document and the binary chunk of a .glb file."""
    if len(content) < 20:
        raise FormatError(f"{len(content)} bytes are no glTF file, expected 20 at least", file=file)
    version, length = struct.unpack_from("<II", content, 4)
    if version != 2:
        raise FormatError(f"is glTF {version}, expected 2", file=file)
    if length > len(content):
        raise FormatError(f"has {len(content)} of its {length} bytes; it is cut short", file=file)
    chunks: dict[bytes, bytes] = {}
    at = 12
    while at + 8 <= length:
        (size,), kind = struct.unpack_from("<I", content, at), content[at + 4 : at + 8]
        if at + 8 + size > length:
            raise FormatError(f"a chunk of {size} bytes at {at} reaches beyond the file's end", file=file)
        chunks.setdefault(kind, content[at + 8 : at + 8 + size])
        at += 8 + size
    if b"JSON" not in chunks:
        raise FormatError("has no JSON chunk, expected one", file=file)
    text = chunks[b"JSON"].decode("utf-8")
    if not isinstance(json.loads(text), dict):
        raise FormatError("its JSON is no object", file=file)
    return GLTF2.from_json(text, infer_missing=True), chunks.get(b"BIN\0", b"")
