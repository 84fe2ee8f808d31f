"""Mutates files by their structure: takes a file apart into lists, dictionaries and leaves, changes some, and puts it
together again with right lengths and hashes. Values come from hypothesis, changes of bytes from libFuzzer.
"""

from __future__ import annotations

import ast
import hashlib
import io
import json
import pickle
import pickletools
import random
import re
import sqlite3
import struct
import zipfile
from collections.abc import Callable, Mapping
from contextlib import closing, suppress
from functools import cache
from pathlib import PurePath
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

Bytes = Callable[[bytes], bytes]
"""Mutates bytes, as ``atheris.Mutate``."""
_N_POOL = 3000
_LARGEST = 1 << 20
"""Size of the largest file that is made, bytes."""
_ARROW_TYPES = ("int8", "int64", "uint64", "float32", "float64", "string", "large_string", "string_view", "binary",
                "bool", "null", "date32", "timestamp[ns]", "duration[us]", "time64[us]")  # fmt: skip


@cache
def draw_pool() -> dict[type, list[Any]]:
    """Returns values that programs trip over by their type, the same in each run."""
    from hypothesis import HealthCheck, Phase, given, seed, settings
    from hypothesis import strategies as st

    numbers = st.integers() | st.integers(-3, 300) | st.floats()
    leaves = st.none() | st.booleans() | numbers | st.text() | numbers.map(str) | st.binary()
    columns = st.dates() | st.decimals(allow_nan=False, allow_infinity=False) | st.sampled_from(_ARROW_TYPES).map(
        lambda name: pa.type_for_alias(name) if name != "null" else pa.null()
    )  # fmt: skip
    trees = st.recursive(
        leaves, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3), max_leaves=6
    )
    pool: dict[type, list[Any]] = {}

    @seed(0)
    @settings(max_examples=_N_POOL, database=None, phases=[Phase.generate], suppress_health_check=list(HealthCheck))
    @given(leaves | trees | columns)
    def collect(value: Any) -> None:
        pool.setdefault(_kind(value), []).append(value)

    collect()
    return pool


def _kind(value: Any) -> type:
    return pa.DataType if isinstance(value, pa.DataType) else type(value)


# --- parts of files: name's suffix -> how its bytes become a tree, and a tree becomes bytes


def _split_text(content: bytes) -> list[str]:
    return re.findall(r"[\ue000-\uf8ff]|\s+|[^\s,;:=<>\"\ue000-\uf8ff]+|.", content.decode("utf-8", "surrogateescape"))


def _join_text(tokens: Any) -> bytes:
    text = "".join(token if isinstance(token, str) else _spell(token) for token in tokens)
    return text.encode("utf-8", "surrogateescape" if text.isprintable() else "replace")


def _spell(value: Any) -> str:
    return value.decode("latin-1") if isinstance(value, bytes) else str(value)


def _join_json(tree: Any) -> bytes:
    return json.dumps(tree, default=_spell, skipkeys=True).encode()


def split_glb(content: bytes) -> dict[str, bytes]:
    """Returns the chunks of a binary glTF file, named ``0.json`` and ``1.bin``."""
    chunks: dict[str, bytes] = {}
    offset = 12
    while offset + 8 <= len(content):
        size, kind = struct.unpack_from("<I4s", content, offset)
        name = f"{len(chunks)}.{kind.decode('latin-1').strip(chr(0)).lower()}"
        chunks[name] = content[offset + 8 : offset + 8 + size]
        offset += 8 + size
    return chunks


def join_glb(chunks: Mapping[str, bytes]) -> bytes:
    """Returns a binary glTF file of such chunks, padded to multiples of four bytes."""
    body = b""
    for name, content in chunks.items():
        kind = name.rpartition(".")[2].upper().encode("latin-1", "replace")[:4].ljust(4, b"\0")
        padded = content + (b" " if kind == b"JSON" else b"\0") * (-len(content) % 4)
        body += struct.pack("<I4s", len(padded), kind) + padded
    return b"glTF" + struct.pack("<II", 2, 12 + len(body)) + body


def _split_npy(content: bytes) -> dict[str, Any]:
    size = 10 + int.from_bytes(content[8:10], "little")
    head = ast.literal_eval(content[10:size].decode("latin-1"))
    if head["descr"][1:2] == "U" and head["shape"] == ():
        return {"text.json": str(np.load(io.BytesIO(content), allow_pickle=False)).encode()}
    return {"head": {name: repr(value) for name, value in head.items()}, "array": content[size:]}


def _join_npy(tree: Any) -> bytes:
    if "text.json" in tree:
        stream = io.BytesIO()
        np.save(stream, np.array(tree["text.json"].decode("utf-8", "replace").replace("\0", "")))
        return stream.getvalue()
    fields = "".join(f"'{name}': {_spell(value)}, " for name, value in tree.get("head", {}).items())
    head = f"{{{fields}}}".encode("latin-1", "replace")[:65000]
    head += b" " * (-(len(head) + 11) % 64) + b"\n"
    array: bytes = tree.get("array", b"")
    return b"\x93NUMPY\1\0" + struct.pack("<H", len(head)) + head + array


def _split_pickle(content: bytes) -> list[bytes]:
    starts = [position or 0 for *_, position in pickletools.genops(content)]
    return [content[start:stop] for start, stop in zip(starts, [*starts[1:], len(content)], strict=True)]


def _join_pickle(instructions: Any) -> bytes:
    return b"".join(part if isinstance(part, bytes) else pickle.dumps(part)[2:-1] for part in instructions)


def unpack(archive: bytes) -> dict[str, bytes]:
    """Returns name -> bytes of an archive's members."""
    with zipfile.ZipFile(io.BytesIO(archive)) as file:
        return {member.filename: file.read(member) for member in file.infolist()}


def _pack_folder(members: dict[str, bytes]) -> bytes:
    """Returns an archive of members; a description that lists hashes lists the right ones."""
    with suppress(ValueError, KeyError, TypeError, AttributeError):
        config = json.loads(members["bundle.json"])
        names = [name for name in config["files"] if name in members]
        config["files"] = {name: hashlib.sha256(members[name]).hexdigest() for name in names}
        members["bundle.json"] = json.dumps(config).encode()
    return pack(members)


def pack(members: Mapping[str, bytes], compress: bool = True) -> bytes:
    """Returns an archive of members, the same bytes for the same members."""
    stream = io.BytesIO()
    kind = zipfile.ZIP_DEFLATED if compress else zipfile.ZIP_STORED
    with zipfile.ZipFile(stream, "w", kind, compresslevel=1) as archive:
        for name, content in members.items():
            archive.writestr(zipfile.ZipInfo(name), content, kind)
    return stream.getvalue()


def _split_sqlite(content: bytes) -> dict[str, Any]:
    with _open_sqlite(content) as file:
        rows = file.execute("SELECT name, type, sql FROM sqlite_master WHERE sql NOT NULL").fetchall()
        tables = {}
        for name in (name for name, kind, _ in rows if kind == "table"):
            cursor = file.execute(f'SELECT * FROM "{name}"')
            tables[name] = [dict(zip([c[0] for c in cursor.description], row, strict=True)) for row in cursor]
        pragmas = {name: file.execute(f"PRAGMA {name}").fetchone()[0] for name in ("user_version", "application_id")}
    return {"sql": [sql for *_, sql in rows], "pragmas": pragmas, "tables": tables}


def _join_sqlite(tree: Any) -> bytes:
    with _open_sqlite() as file:
        for sql in tree["sql"]:
            file.execute(_spell(sql))
        for name, value in tree["pragmas"].items():
            file.execute(f"PRAGMA {name} = {int(value)}")
        for name, rows in tree["tables"].items():
            for row in rows:
                if name == "skeleton":
                    row["sha256"] = hashlib.sha256(_spell(row["described"]).encode()).hexdigest()
                columns, marks = ", ".join(f'"{column}"' for column in row), ", ".join("?" * len(row))
                query = f'INSERT OR REPLACE INTO "{name}" ({columns}) VALUES ({marks})'
                file.execute(query, [*map(_cell, row.values())])
        return bytes(file.serialize())


def _open_sqlite(content: bytes | None = None) -> Any:
    file = sqlite3.connect(":memory:", isolation_level=None)
    if content is not None:
        file.deserialize(content)
    steps = iter(range(100))
    file.set_progress_handler(lambda: next(steps, None) is None, 1000)  # a view may be endless
    return closing(file)


def _cell(value: Any) -> Any:
    if isinstance(value, int) and abs(value) >= 2**63:
        return float(value)
    if isinstance(value, str):
        return value.encode("utf-8", "replace").decode()
    return value if isinstance(value, (int, float, bytes, type(None))) else _join_json(value).decode()


def _split_onnx(content: bytes) -> Any:
    import onnx
    from google.protobuf.json_format import MessageToDict

    return MessageToDict(onnx.load_model_from_string(content))


def _join_onnx(tree: Any) -> bytes:
    import onnx
    from google.protobuf.json_format import Parse

    return bytes(Parse(_join_json(tree), onnx.ModelProto(), ignore_unknown_fields=True).SerializeToString())


def _split_parquet(content: bytes) -> Any:
    table = pq.read_table(io.BytesIO(content))
    pairs = zip(table.schema, table.columns, strict=True)
    columns = [[field.name, field.type, column.to_pylist()] for field, column in pairs]
    options = {"compression": "zstd", "data_page_version": "2.0", "row_group_size": 2, "use_dictionary": True,
               "store_schema": True}  # fmt: skip
    return {"columns": columns, "options": options}


def _join_parquet(tree: Any) -> bytes:
    names, columns = [], []
    for name, kind, values in tree["columns"]:
        is_text = kind in (pa.string(), pa.large_string())
        if is_text and any(isinstance(value, bytes) for value in values):  # no UTF-8
            texts = [value if isinstance(value, bytes) else str(value).encode("utf-8", "replace") for value in values]
            columns.append(pa.Array.from_buffers(pa.string(), len(texts), pa.array(texts, pa.binary()).buffers()))
        else:
            try:
                columns.append(pa.array(values, kind))
            except (pa.ArrowException, TypeError, ValueError, OverflowError):
                columns.append(pa.array(values))
        names.append(_spell(name))
    stream = io.BytesIO()
    pq.write_table(pa.Table.from_arrays(columns, names), stream, **tree["options"])
    return stream.getvalue()


Codec = tuple[Callable[[bytes], Any], Callable[[Any], bytes]]
CODECS: dict[str, Codec] = {
    ".txt": (_split_text, _join_text), ".json": (json.loads, _join_json), ".glb": (split_glb, join_glb),
    ".npy": (_split_npy, _join_npy), ".zip": (unpack, _pack_folder), ".sqlite": (_split_sqlite, _join_sqlite),
    ".onnx": (_split_onnx, _join_onnx), ".parquet": (_split_parquet, _join_parquet),
    ".pkl": (_split_pickle, _join_pickle),
}  # fmt: skip


_STARTS = {
    b"glTF": ".glb", b"PK": ".zip", b"PAR1": ".parquet", b"Kaydara": "", b"{": ".json", b"[": ".json",
    b"\x93NUMPY": ".npy", b"\x80": ".pkl", b"(": ".pkl", b"\xcd\xcc\xcc\x3d": "", b"\xcd\xcc\x4c\x3e": "",
}  # fmt: skip
"""First bytes of a file -> its kind; .pose files, whose first number is their version, have no structure here."""


def find_suffix(content: bytes) -> str:
    """Returns the kind of a file, of ``CODECS``, by its first bytes."""
    return next((suffix for start, suffix in _STARTS.items() if content.startswith(start)), ".txt")


# --- mutations


def mutate_file(content: bytes, suffix: str, rng: random.Random, mutate: Bytes) -> bytes:
    """Returns a file of the kind ``suffix`` of ``CODECS`` with some of its parts changed, seldom with bytes changed
    whatever they mean; ``mutate`` changes bytes.
    """
    split, join = CODECS.get(suffix, (None, None))
    if split is None or join is None or rng.random() < (0.02 if suffix == ".zip" else 0.1):
        return mutate_bytes(content, rng, mutate)
    try:
        tree = [split(content)]
        for _ in range(1 + min(int(rng.expovariate(2.0)), 4)):
            _mutate_tree(tree if suffix == ".json" else tree[0], rng, mutate)
        changed = join(tree[0])
    except Exception:  # libraries raise their own kinds of errors for what cannot be taken apart or put together
        return mutate_bytes(content, rng, mutate)
    return changed if len(changed) <= _LARGEST else content


def mutate_bytes(content: bytes, rng: random.Random, mutate: Bytes) -> bytes:
    """Returns bytes with one stretch or one number changed, mostly of the same length."""
    if len(content) < 8 or rng.random() < 0.1:
        return mutate(content)
    start, size = rng.randrange(len(content)), int(2 ** rng.uniform(0, 12))
    if rng.random() < 0.6:
        dtype = np.dtype(rng.choice(("<f4", "<f8", "<u4", "<u2")))
        start, size = min(start, len(content) - dtype.itemsize) // dtype.itemsize * dtype.itemsize, dtype.itemsize
        with np.errstate(all="ignore"):
            old = np.frombuffer(content, dtype, 1, start)
            drawn = np.float64(rng.choice(draw_pool()[float if dtype.kind == "f" else int]))
            changed = rng.choice((-old, 2 * old, old + 1, np.array([drawn]))).astype(dtype).tobytes()
    else:
        changed = mutate(content[start : start + size])
        if rng.random() < 0.7:
            changed = changed[:size].ljust(min(size, len(content) - start), b"\0")
    return content[:start] + changed + content[start + size :]


def _mutate_tree(root: Any, rng: random.Random, mutate: Bytes) -> None:
    """Changes one of the values within a tree, in place."""
    places: list[tuple[Any, Any]] = []
    stack: list[Any] = [root]
    while stack and len(places) < 5000:
        container = stack.pop()
        keys = list(container) if isinstance(container, dict) else range(len(container))
        places += [(container, key) for key in keys]
        stack += [container[key] for key in keys if isinstance(container[key], (dict, list))]
    holder, key = rng.choice(places)
    old = holder[key]
    pool = draw_pool()
    match rng.randrange(24):
        case 0 if holder is not root or len(root) > 1:
            del holder[key]
        case 1 if isinstance(holder, dict):
            holder[rng.choice((*holder, key + "x", rng.choice(pool[str])))] = holder.pop(key)
        case 1 | 2 if isinstance(holder, list):
            holder[key:key] = [old] * rng.choice((1, 1, 3, 200))
        case 3 | 4:
            source, name = rng.choice(places)
            value = source[name]
            holder[key] = json.loads(_join_json(value)) if isinstance(value, (dict, list)) else value
        case 5 if not isinstance(old, bytes):
            holder[key] = [old] if rng.random() < 0.5 else {"a": old}
        case _:
            holder[key] = _draw_value(old, PurePath(str(key)).suffix, rng, mutate)


def _draw_value(old: Any, suffix: str, rng: random.Random, mutate: Bytes) -> Any:
    """Returns another value, mostly of the same type; of files within files one that is mutated."""
    pool, choice = draw_pool(), rng.random()
    if isinstance(old, bytes):
        return mutate_file(old, suffix, rng, mutate)
    if isinstance(old, str) and old[:1] in ("{", "[") and choice < 0.8:
        return mutate_file(old.encode("utf-8", "replace"), ".json", rng, mutate).decode("utf-8", "replace")
    if isinstance(old, str) and choice < 0.5:
        number = _draw_number(old, rng)
        return number if number is not None else mutate(old.encode("utf-8", "replace")).decode("utf-8", "replace")
    if isinstance(old, (int, float)) and not isinstance(old, bool) and choice < 0.5:
        return rng.choice((old + 1, old - 1, -old, old * 1000, old * 1e-3))
    kind = _kind(old) if choice < 0.8 and _kind(old) in pool else rng.choice([*pool])
    return rng.choice(pool[kind])


def _draw_number(text: str, rng: random.Random) -> str | None:
    """Returns the spelling of another number for that of a number, None for other words."""
    try:
        number = float(text)
        values = (number * 1e3, number * 1e-3, -number, number + 1.0, rng.choice(draw_pool()[float]))
        return format(rng.choice(values), ".0f" if text.lstrip("-").isdecimal() else "")
    except (ValueError, OverflowError):
        return None
