"""A glTF 2.0 file as it lies on disk: its document, the tree of its nodes, and the numbers in its buffers."""

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

MAX_VALUES = 20_000_000
"""Rotations' numbers of a clip, frames times joints times four, and numbers of keys, above which a file is refused."""
_COMPONENTS = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


class Document:
    """A file that is being read; ``parents``: every node's parent. ``beside``: the folder of files that it may ask for,
    None where it may ask for none. Raises ``FormatError`` where it is no sound glTF.
    """

    def __init__(self, file: str, content: bytes, beside: Path | None) -> None:
        self.file, self.beside = file, beside
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about extensions that mean nothing here
            if content[:4] == b"glTF":
                self.gltf, self.blob = _binary(file, content)
            else:
                self.gltf, self.blob = GLTF2.from_json(content.decode("utf-8-sig"), infer_missing=True), b""
        self.buffers: dict[int, bytes] = {}
        self.known: dict[int, Float] = {}
        version = str(getattr(self.gltf.asset, "version", "") or "")
        if not version.startswith("2."):
            raise self._wrong(f"is glTF {version or 'of no version'}, expected 2.0")
        if "EXT_meshopt_compression" in (self.gltf.extensionsRequired or []):
            raise self._wrong("its buffers are compressed by EXT_meshopt_compression, which is not read")
        self.parents = self._parents()

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

    def _there(self, rows: Any, number: Any, what: str) -> Any:
        """A row by its number. Raises ``FormatError`` where there is none."""
        if not isinstance(number, int) or not 0 <= number < len(rows or []):
            raise self._wrong(f"{what} {number} is no {'node' if what == 'joint' else 'such'}, of {len(rows or [])}")
        return rows[number]

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
                if self.beside is None:
                    raise self._wrong(f"buffer {number} lies in another file, {uri!r}, expected all in one")
                if not name or Path(name).name != name or "\\" in name or "\0" in name:
                    raise self._wrong(f"buffer {number} lies at {uri!r}, expected a file beside this one")
                self.buffers[number] = read_bytes(self.beside / name)
        return self.buffers[number]

    def _wrong(self, what: str) -> FormatError:
        return FormatError(what, file=self.file)


def _binary(file: str, content: bytes) -> tuple[GLTF2, bytes]:
    """The document and the binary part of a .glb."""
    if len(content) < 20:
        raise FormatError(f"{len(content)} bytes are no glTF file, expected 20 at least", file=file)
    version, length = struct.unpack_from("<II", content, 4)
    if version != 2:
        raise FormatError(f"is glTF {version}, expected 2", file=file)
    if length > len(content):
        raise FormatError(f"has {len(content)} of its {length} bytes; it is cut short", file=file)
    parts: dict[bytes, bytes] = {}
    at = 12
    while at + 8 <= length:
        (size,), kind = struct.unpack_from("<I", content, at), content[at + 4 : at + 8]
        if at + 8 + size > length:
            raise FormatError(f"a chunk of {size} bytes at {at} reaches beyond the file's end", file=file)
        parts.setdefault(kind, content[at + 8 : at + 8 + size])
        at += 8 + size
    if b"JSON" not in parts:
        raise FormatError("has no JSON chunk, expected one", file=file)
    told = parts[b"JSON"].decode("utf-8")
    if not isinstance(json.loads(told), dict):
        raise FormatError("its JSON is no object", file=file)
    return GLTF2.from_json(told, infer_missing=True), parts.get(b"BIN\0", b"")
