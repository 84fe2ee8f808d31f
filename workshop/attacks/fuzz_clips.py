"""Mutates glTF files and NumPy archives, and puts them together again with right lengths and checksums, so that the
readers behind them are reached.
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

from fuzz_mutators import (
    INTEGERS,
    draw_hostile_float,
    draw_hostile_value,
    draw_hostile_word,
    mutate_bytes,
    mutate_floats,
    mutate_json,
    mutate_text,
)


def mutate_glb(content: bytes, rng: random.Random) -> bytes:
    """Returns a .glb file with its JSON or binary chunk mutated and right lengths; seldom single bytes mutated."""
    chunks = _split_chunks(content)
    if not chunks or rng.random() < 0.1:
        return mutate_bytes(content, rng)
    chunk = 0 if rng.random() < 0.7 else rng.randrange(len(chunks))
    kind, chunk_content = chunks[chunk]
    if kind == b"JSON":
        chunk_content = mutate_gltf(chunk_content, rng)
    elif len(chunk_content) >= 4 and rng.random() < 0.7:
        chunk_content = mutate_floats(chunk_content, rng)
    else:
        chunk_content = mutate_bytes(chunk_content, rng)
    chunks[chunk] = (kind, chunk_content)
    return join_chunks(chunks)


def _split_chunks(content: bytes) -> list[tuple[bytes, bytes]]:
    if content[:4] != b"glTF" or len(content) < 20:
        return []
    chunks, offset = [], 12
    while offset + 8 <= len(content):
        (size,) = struct.unpack_from("<I", content, offset)
        chunks.append((content[offset + 4 : offset + 8], content[offset + 8 : offset + 8 + size]))
        offset += 8 + size
    return chunks


def join_chunks(chunks: list[tuple[bytes, bytes]]) -> bytes:
    """Returns a binary glTF file of chunks (kind, content), padded to multiples of four bytes."""
    body = b""
    for kind, chunk_content in chunks:
        chunk_content += (b" " if kind == b"JSON" else b"\0") * (-len(chunk_content) % 4)
        body += struct.pack("<I", len(chunk_content)) + kind + chunk_content
    return b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body


def mutate_fbx(content: bytes, rng: random.Random) -> bytes:
    """Returns an FBX file with a word of its text, or bytes of its records, mutated; mostly such that records end as
    before.
    """
    if content[:7] != b"Kaydara":
        return mutate_text(content, rng)
    mutated = mutate_bytes(content, rng)
    if len(mutated) != len(content) and rng.random() < 0.8:
        position = rng.randrange(len(content) - 8)
        mutated = content[:position] + struct.pack("<i", rng.choice(INTEGERS) % 2**31) + content[position + 4 :]
    return mutated


def mutate_gltf(content: bytes, rng: random.Random) -> bytes:
    """Returns a glTF document with a number of an accessor or node, any value, or an embedded buffer mutated."""
    try:
        document = json.loads(content)
        tables = [name for name in ("accessors", "bufferViews", "nodes", "skins", "animations") if document.get(name)]
    except (ValueError, AttributeError, RecursionError):
        return mutate_json(content, rng)
    if rng.random() < 0.5 or not tables:
        return mutate_json(content, rng)
    try:
        buffer = document["buffers"][0]
        if buffer.get("uri", "").startswith("data:") and rng.random() < 0.3:
            head, _, text = buffer["uri"].partition(",")
            mutate = rng.choice((mutate_floats, mutate_bytes))
            buffer["uri"] = f"{head},{base64.b64encode(mutate(base64.b64decode(text), rng)).decode()}"
        else:
            row = rng.choice(document[rng.choice(tables)])
            name = rng.choice(list(row) or ["name"])
            options = ("count", "byteOffset", "byteStride", "byteLength", "componentType", "type",
                       "normalized", "sparse", "children", "matrix", "scale", "rotation", "joints", "skeleton",
                       "inverseBindMatrices")  # fmt: skip
            name = name if rng.random() < 0.7 else rng.choice(options)
            row[name] = draw_hostile_value(rng, row.get(name, 0))
    except (KeyError, IndexError, AttributeError, TypeError, ValueError):
        return mutate_json(content, rng)
    return json.dumps(document).encode("utf-8", "replace")


def mutate_npz(content: bytes, rng: random.Random) -> bytes:
    """Returns a NumPy archive with a member's JSON, numbers, shape, type, header or bytes mutated, or members added or
    removed.
    """
    if rng.random() < 0.1:
        return mutate_bytes(content, rng)
    try:
        members = unpack(content)
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError, RuntimeError, EOFError):
        return mutate_bytes(content, rng)
    if not members:
        return mutate_bytes(content, rng)
    name = rng.choice(sorted(members))
    if "head.npy" in members and rng.random() < 0.3:
        name = "head.npy"
    match rng.randrange(8):
        case 0:
            del members[name]
        case 1:
            members[rng.choice(("extra.npy", "head.npy", "../a.npy", "x", name + "x"))] = members[name]
        case 2:
            members[name] = mutate_bytes(members[name], rng)
        case 3:
            members[name] = _mutate_array_header(members[name], rng)
        case _:
            members[name] = _mutate_array_content(members[name], rng)
    return pack(members, compress=rng.random() < 0.9)


def mutate_array(content: bytes, rng: random.Random) -> bytes:
    """Returns the bytes of an array with its header or its numbers mutated."""
    return (_mutate_array_header if rng.random() < 0.3 else _mutate_array_content)(content, rng)


def _encode_array(array: Any) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array, allow_pickle=True)
    return stream.getvalue()


def _mutate_array_content(content: bytes, rng: random.Random) -> bytes:
    """Returns an array with other numbers, shape or type; JSON within text is mutated as JSON."""
    try:
        array = np.load(io.BytesIO(content), allow_pickle=False)
    except (ValueError, OSError, EOFError):
        return mutate_bytes(content, rng)
    if array.dtype.kind == "U" and rng.random() < 0.9:
        text = mutate_json(str(array).encode("utf-8", "replace"), rng).decode("utf-8", "replace").replace("\0", "")
        return _encode_array(np.array(text))
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
                value = rng.choice(INTEGERS[1:16]) if array.dtype.kind in "iu" else draw_hostile_float(rng)
                array.flat[rng.randrange(array.size)] = np.array(value).astype(array.dtype)
        case _:
            array = np.array(draw_hostile_word(rng).replace("\0", ""))
    return _encode_array(array)


def _mutate_array_header(content: bytes, rng: random.Random) -> bytes:
    """Returns the bytes of an array with another text in its header and that text's right length."""
    if not content.startswith(b"\x93NUMPY") or len(content) < 12:
        return mutate_bytes(content, rng)
    size = 10 + int.from_bytes(content[8:10], "little")
    head = mutate_text(content[10:size].rstrip(), rng)
    if rng.random() < 0.5:
        shape = rng.choice((b"(999999999999,)", b"(-1,)", b"(2**9,)", b"(0,)", b"(1e9,)", b"(65536, 65536, 4)", b"[1]"))
        before, _, after = content[10:size].rstrip().partition(b"(")
        head = before + shape + after.partition(b")")[2]
    return content[:8] + struct.pack("<H", min(len(head), 65535)) + head[:65535] + content[size:]


def unpack(archive: bytes) -> dict[str, bytes]:
    """Returns name -> bytes of an archive's members."""
    with zipfile.ZipFile(io.BytesIO(archive)) as file:
        return {member.filename: file.read(member) for member in file.infolist()}


def pack(members: Mapping[str, bytes], compress: bool = True) -> bytes:
    """Returns an archive of members, the same bytes for the same members."""
    stream = io.BytesIO()
    with zipfile.ZipFile(
        stream, "w", zipfile.ZIP_DEFLATED if compress else zipfile.ZIP_STORED, compresslevel=1
    ) as archive:
        for name, content in members.items():
            info = zipfile.ZipInfo(name)
            info.compress_type = archive.compression
            archive.writestr(info, content)
    return stream.getvalue()
