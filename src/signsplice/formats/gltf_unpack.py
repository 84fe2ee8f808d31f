"""Packed content of glTF files, unpacked in place: buffer views of ``EXT_meshopt_compression``, and meshes of
``KHR_draco_mesh_compression``. Needs the packages of the extra ``compressed``.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from signsplice.errors import MissingExtraError

DRACO = "KHR_draco_mesh_compression"
MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
_KINDS: dict[int, str] = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
"""Component type -> type of numbers."""
_INDICES = {2: "<u2", 4: "<u4"}
"""Bytes of an index -> type of numbers."""

Fields = dict[str, Any]
View = Callable[[Fields], bytes]
"""Returns the bytes at the buffer, offset and length that an object names."""
Check = Callable[[str, int], None]
"""Raises ``LimitError`` if something, named in words, takes too many bytes of memory."""


def unpack_views(document: Fields, read: View, check: Check) -> bytes:
    """Unpack all buffer views of a document. They then lie in a further buffer, whose content is returned."""
    for buffer in document["buffers"]:
        if any((buffer.get("extensions") or {}).get(name) for name in MESHOPT):  # a place for what is unpacked
            buffer |= {"uri": "data:,", "byteLength": 0, "extensions": None}
    unpacked = _NewBuffer(document, check)
    for view in document.get("bufferViews") or ():
        packed = next(filter(None, map((view.get("extensions") or {}).get, MESHOPT)), None)
        if packed is None:
            continue
        count, size, mode = packed["count"], packed["byteStride"], packed["mode"]
        check(f"{count:,} rows of a packed buffer view", 2 * count * size)
        rows = _require("meshopt").decode_gltf_buffer(read(packed), count, size, mode, packed.get("filter"))
        view.pop("extensions")
        view |= unpacked.place(rows if mode == "ATTRIBUTES" else rows.astype(_INDICES[size]))
    return unpacked.finish(MESHOPT)


def unpack_meshes(document: Fields, read: View, check: Check) -> bytes:
    """Unpack all meshes of a document, as ``unpack_views`` does."""
    unpacked, views, accessors = _NewBuffer(document, check), document["bufferViews"], document["accessors"]
    for mesh in document.get("meshes") or ():
        for primitive in mesh["primitives"]:
            packed = (primitive.get("extensions") or {}).pop(DRACO, None)
            if packed is None:
                continue
            decoded = _require("DracoPy").decode(read(views[packed["bufferView"]]))
            arrays = {attribute["unique_id"]: attribute["data"] for attribute in decoded.attributes}
            parts = {primitive["attributes"][name]: arrays[number] for name, number in packed["attributes"].items()}
            for number, rows in {**parts, primitive["indices"]: decoded.faces.reshape(-1, 1)}.items():
                rows = rows.astype(_KINDS[accessors[number]["componentType"]])
                accessors[number] |= {"bufferView": len(views), "byteOffset": 0, "count": len(rows)}
                if "min" in accessors[number]:  # packing has rounded the values
                    accessors[number] |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
                views.append(unpacked.place(rows))
    return unpacked.finish((DRACO,))


class _NewBuffer:
    """A buffer that is added to a document."""

    def __init__(self, document: Fields, check: Check) -> None:
        self._document, self._check, self._content = document, check, bytearray()
        self._number = len(document["buffers"])

    def place(self, rows: NDArray[Any]) -> Fields:
        """Append an array; returns its place as a buffer view has it."""
        self._check("unpacked meshes", 2 * len(self._content) + rows.nbytes)
        where = {"buffer": self._number, "byteOffset": len(self._content), "byteLength": rows.nbytes}
        self._content += np.ascontiguousarray(rows).tobytes() + b"\0" * (-rows.nbytes % 4)
        return where

    def finish(self, extensions: tuple[str, ...]) -> bytes:
        """Add the buffer to the document, which then needs none of the ``extensions``; returns its content."""
        self._document["buffers"].append({"byteLength": len(self._content)})
        for name in ("extensionsUsed", "extensionsRequired"):
            left = [extension for extension in self._document.pop(name, ()) if extension not in extensions]
            self._document |= {name: left} if left else {}
        return bytes(self._content)


def _require(name: str) -> ModuleType:
    """Return a package by its name. Raises ``MissingExtraError`` if it is not installed."""
    try:
        return import_module(name)
    except ImportError as error:
        raise MissingExtraError(
            "packed meshes need pip install 'signsplice[compressed]'; or "
            "`npx @gltf-transform/cli copy IN.glb OUT.glb` unpacks them (VRM's extensions are lost)"
        ) from error
