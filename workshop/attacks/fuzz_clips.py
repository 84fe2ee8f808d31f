"""Mutations of glTF files and NumPy archives, put together again with lengths and checksums that are right, so that
the readers behind them are reached.
"""

from __future__ import annotations

import base64
import io
import json
import random
import struct
import zipfile
from collections.abc import Mapping
from typing import Any

import numpy as np

from fuzz_mutators import INTEGERS, hostile_float, hostile_value, hostile_word, of_bytes, of_json, of_text, with_a_float


def of_glb(content: bytes, rng: random.Random) -> bytes:
    """A binary glTF file with its JSON or its binary chunk mutated and right lengths; seldom single bytes."""
    chunks = _chunks(content)
    if not chunks or rng.random() < 0.1:
        return of_bytes(content, rng)
    at = 0 if rng.random() < 0.7 else rng.randrange(len(chunks))
    kind, inner = chunks[at]
    if kind == b"JSON":
        inner = of_gltf(inner, rng)
    elif len(inner) >= 4 and rng.random() < 0.7:
        inner = with_a_float(inner, rng)
    else:
        inner = of_bytes(inner, rng)
    chunks[at] = (kind, inner)
    return joined_chunks(chunks)


def _chunks(content: bytes) -> list[tuple[bytes, bytes]]:
    if content[:4] != b"glTF" or len(content) < 20:
        return []
    chunks, at = [], 12
    while at + 8 <= len(content):
        (size,) = struct.unpack_from("<I", content, at)
        chunks.append((content[at + 4 : at + 8], content[at + 8 : at + 8 + size]))
        at += 8 + size
    return chunks


def joined_chunks(chunks: list[tuple[bytes, bytes]]) -> bytes:
    """A binary glTF file of chunks (kind, content), filled up to multiples of four bytes."""
    body = b""
    for kind, inner in chunks:
        inner += (b" " if kind == b"JSON" else b"\0") * (-len(inner) % 4)
        body += struct.pack("<I", len(inner)) + kind + inner
    return b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body


def of_fbx(content: bytes, rng: random.Random) -> bytes:
    """An FBX file with a word of its text, or bytes of its records, mutated; mostly such that records end as before."""
    if content[:7] != b"Kaydara":
        return of_text(content, rng)
    other = of_bytes(content, rng)
    if len(other) != len(content) and rng.random() < 0.8:
        at = rng.randrange(len(content) - 8)
        other = content[:at] + struct.pack("<i", rng.choice(INTEGERS) % 2**31) + content[at + 4 :]
    return other


def of_gltf(content: bytes, rng: random.Random) -> bytes:
    """A glTF document with a number of an accessor or node, any value, or an embedded buffer mutated."""
    try:
        document = json.loads(content)
        tables = [name for name in ("accessors", "bufferViews", "nodes", "skins", "animations") if document.get(name)]
    except (ValueError, AttributeError, RecursionError):
        return of_json(content, rng)
    if rng.random() < 0.5 or not tables:
        return of_json(content, rng)
    try:
        buffer = document["buffers"][0]
        if buffer.get("uri", "").startswith("data:") and rng.random() < 0.3:
            head, _, text = buffer["uri"].partition(",")
            mutate = rng.choice((with_a_float, of_bytes))
            buffer["uri"] = f"{head},{base64.b64encode(mutate(base64.b64decode(text), rng)).decode()}"
        else:
            row = rng.choice(document[rng.choice(tables)])
            name = rng.choice(list(row) or ["name"])
            options = ("count", "byteOffset", "byteStride", "byteLength", "componentType", "type",
                       "normalized", "sparse", "children", "matrix", "scale", "rotation", "joints", "skeleton",
                       "inverseBindMatrices")  # fmt: skip
            name = name if rng.random() < 0.7 else rng.choice(options)
            row[name] = hostile_value(rng, row.get(name, 0))
    except (KeyError, IndexError, AttributeError, TypeError, ValueError):
        return of_json(content, rng)
    return json.dumps(document).encode("utf-8", "replace")


def of_npz(content: bytes, rng: random.Random) -> bytes:
    """A NumPy archive with a member's JSON, numbers, shape, type, header or bytes mutated, or members added or lost."""
    if rng.random() < 0.1:
        return of_bytes(content, rng)
    try:
        members = unpacked(content)
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError, RuntimeError, EOFError):
        return of_bytes(content, rng)
    if not members:
        return of_bytes(content, rng)
    name = rng.choice(sorted(members))
    if "head.npy" in members and rng.random() < 0.3:
        name = "head.npy"
    match rng.randrange(8):
        case 0:
            del members[name]
        case 1:
            members[rng.choice(("extra.npy", "head.npy", "../a.npy", "x", name + "x"))] = members[name]
        case 2:
            members[name] = of_bytes(members[name], rng)
        case 3:
            members[name] = _other_header(members[name], rng)
        case _:
            members[name] = _other_array(members[name], rng)
    return packed(members, compress=rng.random() < 0.9)


def of_array(content: bytes, rng: random.Random) -> bytes:
    """The bytes of an array with its header or its numbers mutated."""
    return (_other_header if rng.random() < 0.3 else _other_array)(content, rng)


def _array_bytes(array: Any) -> bytes:
    made = io.BytesIO()
    np.save(made, array, allow_pickle=True)
    return made.getvalue()


def _other_array(content: bytes, rng: random.Random) -> bytes:
    """An array with other numbers, another shape or type; JSON within text is mutated as JSON."""
    try:
        array = np.load(io.BytesIO(content), allow_pickle=False)
    except (ValueError, OSError, EOFError):
        return of_bytes(content, rng)
    if array.dtype.kind == "U" and rng.random() < 0.9:
        text = of_json(str(array).encode("utf-8", "replace"), rng).decode("utf-8", "replace").replace("\0", "")
        return _array_bytes(np.array(text))
    match rng.randrange(6):
        case 0:
            kind = rng.choice(("f2", "f4", ">f8", "c16", "?", "i1", "u8", "U4", "S4", "O", "M8[s]", "i4,f4"))
            try:
                array = array.astype(kind)
            except (ValueError, TypeError):
                array = np.zeros(array.shape, kind)
        case 1:
            shapes = ((), (0,), (-1,), (1, -1), (-1, 1), (1,) * 32, (array.size, 1, 1), (0, 4), (0, 3))
            try:
                array = array.reshape(rng.choice(shapes))
            except ValueError:
                array = array.ravel()
        case 2 if array.ndim:
            array = array[: rng.randint(0, len(array))] if rng.random() < 0.5 else np.concatenate([array, array])
        case 3 if array.ndim:
            array = np.moveaxis(array, 0, -1) if rng.random() < 0.5 else np.repeat(array, 2, axis=-1)
        case _ if array.size and array.dtype.kind in "iuf":
            array = np.array(array)
            with np.errstate(all="ignore"):
                value = rng.choice(INTEGERS[1:16]) if array.dtype.kind in "iu" else hostile_float(rng)
                array.flat[rng.randrange(array.size)] = np.array(value).astype(array.dtype)
        case _:
            array = np.array(hostile_word(rng).replace("\0", ""))
    return _array_bytes(array)


def _other_header(content: bytes, rng: random.Random) -> bytes:
    """The bytes of an array with another text in its header and the right length of that."""
    if not content.startswith(b"\x93NUMPY") or len(content) < 12:
        return of_bytes(content, rng)
    size = 10 + int.from_bytes(content[8:10], "little")
    head = of_text(content[10:size].rstrip(), rng)
    if rng.random() < 0.5:
        shape = rng.choice((b"(999999999999,)", b"(-1,)", b"(2**9,)", b"(0,)", b"(1e9,)", b"(65536, 65536, 4)", b"[1]"))
        left, _, right = content[10:size].rstrip().partition(b"(")
        head = left + shape + right.partition(b")")[2]
    return content[:8] + struct.pack("<H", min(len(head), 65535)) + head[:65535] + content[size:]


def unpacked(archive: bytes) -> dict[str, bytes]:
    """Name -> bytes of an archive's members."""
    with zipfile.ZipFile(io.BytesIO(archive)) as opened:
        return {member.filename: opened.read(member) for member in opened.infolist()}


def packed(members: Mapping[str, bytes], compress: bool = True) -> bytes:
    """An archive of members, the same bytes for the same members."""
    made = io.BytesIO()
    with zipfile.ZipFile(
        made, "w", zipfile.ZIP_DEFLATED if compress else zipfile.ZIP_STORED, compresslevel=1
    ) as archive:
        for name, content in members.items():
            info = zipfile.ZipInfo(name)
            info.compress_type = archive.compression
            archive.writestr(info, content)
    return made.getvalue()
