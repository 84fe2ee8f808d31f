"""Mutations of lexicons and bundles, held as archives of their folder: of rows, networks and descriptions, with hashes
that are right for the most part, so that the readers behind them are reached.
"""

from __future__ import annotations

import hashlib
import itertools
import json
import random
import sqlite3
import zipfile
from collections.abc import Callable
from typing import Any

import fuzz_recipes
from fuzz_clips import of_array, packed, unpacked
from fuzz_mutators import INTEGERS, hostile_float, hostile_value, hostile_word, of_bytes, of_json, with_a_float


def of_folder(content: bytes, rng: random.Random, inner: Callable[[dict[str, bytes], random.Random], None]) -> bytes:
    """A folder, held as an archive, with its files (name -> bytes) mutated in place by ``inner``; seldom a file lost,
    emptied or swapped.
    """
    try:
        members = unpacked(content)
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError, RuntimeError, EOFError):
        return content  # a mutation of the archive itself would test zipfile
    if members and rng.random() < 0.04:
        name = rng.choice(sorted(members))
        match rng.randrange(3):
            case 0:
                del members[name]
            case 1:
                members[name] = b""
            case _:
                members[name] = members[rng.choice(sorted(members))]
    else:
        inner(members, rng)
    return packed(members)


def of_lexicon(content: bytes, rng: random.Random) -> bytes:
    """A lexicon with a row of its index, the index's declarations, or bytes of either file mutated."""

    def inner(files: dict[str, bytes], rng: random.Random) -> None:
        index, frames = "index.sqlite", "frames.bin"
        if index not in files or frames not in files:
            return
        choice = rng.random()
        if choice < 0.25:
            files[frames] = _other_frames(files[frames], rng)
        elif choice < 0.45:
            files[index] = of_bytes(files[index], rng)
        else:
            files[index] = _other_index(files[index], rng)
            if rng.random() < 0.5:
                _rehash(files)

    return of_folder(content, rng, inner)


def _other_frames(frames: bytes, rng: random.Random) -> bytes:
    """Mutated behind the head, of the same length for the most part."""
    if rng.random() < 0.2:
        return of_bytes(frames, rng)
    changed = of_bytes(frames[64:], rng)
    return frames[:64] + changed[: len(frames) - 64].ljust(len(frames) - 64, b"\0")


_DECLARED = (
    "CREATE TABLE {0} AS SELECT * FROM old",
    "CREATE VIEW {0} AS SELECT * FROM old",
    "CREATE VIEW {0} AS SELECT * FROM old UNION ALL SELECT * FROM {0}",
    "CREATE VIEW {0} AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT old.* FROM old, n",
    "CREATE VIEW {0} AS SELECT a.* FROM old a, word b, word c, word d, word e, word f, word g, word h, word i, word j",
)


def _opened(index: bytes) -> sqlite3.Connection:
    """An index in memory; a query that goes on without end, as of a view that was put there, fails."""
    file = sqlite3.connect(":memory:", isolation_level=None)
    file.deserialize(index)
    steps = itertools.count()
    file.set_progress_handler(lambda: next(steps) > 100, 1000)
    return file


def _other_index(index: bytes, rng: random.Random) -> bytes:
    """An index with a value, a row or a table's declaration changed."""
    file = _opened(index)
    try:
        tables = [name for (name,) in file.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
        table = rng.choice([*tables, *("word", "word", "word")[: 3 * ("word" in tables)]])  # a view may have no end
        choice = rng.randrange(10)
        if choice == 0:
            pragma = rng.choice(("user_version", "application_id"))
            file.execute(f"PRAGMA {pragma} = {rng.choice(INTEGERS[:18])}")
        elif choice in (1, 2):  # free of types and constraints, or what never ends
            file.execute("PRAGMA legacy_alter_table = ON")
            file.execute(f"ALTER TABLE {table} RENAME TO old")
            file.execute(_DECLARED[0 if choice == 1 else rng.randrange(1, len(_DECLARED))].format(table))
        else:
            _change_rows(file, table, choice, rng)
        return file.serialize()
    except (sqlite3.Error, OverflowError, IndexError, ValueError):
        return of_bytes(index, rng)
    finally:
        file.close()


def _change_rows(file: sqlite3.Connection, table: str, choice: int, rng: random.Random) -> None:
    """Change a value of a table, or remove or repeat a row."""
    rows = file.execute(f"SELECT * FROM {table}").fetchall()
    at = rng.randrange(len(rows))
    if choice == 3:
        del rows[at]
    else:
        row = list(rng.choice(rows))
        column = rng.randrange(len(row))
        row[column] = _hostile_cell(row[column], rng)
        if choice == 4:
            rows.append(tuple(row))
        else:
            rows[at] = tuple(row)
    file.execute(f"DELETE FROM {table}")
    file.executemany(f"INSERT OR REPLACE INTO {table} VALUES ({', '.join('?' * len(rows[0]))})", rows)


def _hostile_cell(old: Any, rng: random.Random) -> Any:
    """A value for a cell of a table: JSON within text is mutated as JSON."""
    if isinstance(old, str) and old[:1] in ("[", "{") and rng.random() < 0.7:
        return of_json(old.encode("utf-8", "replace"), rng).decode("utf-8", "replace")
    value = hostile_value(rng, old)
    if isinstance(value, (list, dict)):
        return json.dumps(value)
    if isinstance(value, int) and not -(2**63) <= value < 2**63:
        return float(value)
    if isinstance(value, str):
        value = value.encode("utf-8", "replace").decode()
        return value.encode() if rng.random() < 0.2 else value
    return value


def _rehash(files: dict[str, bytes]) -> None:
    """Give the skeletons of an index the hashes that they have now."""
    file = _opened(files["index.sqlite"])
    try:
        for number, text in file.execute("SELECT id, described FROM skeleton").fetchall():
            content = text if isinstance(text, bytes) else str(text).encode()
            file.execute("UPDATE skeleton SET sha256 = ? WHERE id = ?", (hashlib.sha256(content).hexdigest(), number))
        files["index.sqlite"] = file.serialize()
    except (sqlite3.Error, UnicodeError):
        return
    finally:
        file.close()


def of_shards(content: bytes, rng: random.Random) -> bytes:
    """A folder of shards with its job, its recipes or its index mutated."""

    def inner(files: dict[str, bytes], rng: random.Random) -> None:
        tables = [name for name in files if name.endswith(".parquet")]
        name = rng.choice([*files, "job.json", *tables])
        if name in files:
            mutate = of_json if name.endswith(".json") else fuzz_recipes.mutated if name in tables else of_bytes
            files[name] = mutate(files[name], rng)

    return of_folder(content, rng, inner)


def of_pairs(content: bytes, rng: random.Random) -> bytes:
    """A corpus of pairs with its description or an array mutated."""

    def inner(files: dict[str, bytes], rng: random.Random) -> None:
        name = rng.choice([*files, *["corpus.json"] * 6])
        if name in files:
            files[name] = (of_json if name.endswith(".json") else of_array)(files[name], rng)

    return of_folder(content, rng, inner)


def of_bundle(content: bytes, rng: random.Random) -> bytes:
    """A bundle with its description or a network mutated; the hashes that it lists stay right for the most part."""

    def inner(files: dict[str, bytes], rng: random.Random) -> None:
        described = "bundle.json"
        if described not in files:
            return
        networks = sorted(name for name in files if name.endswith(".onnx"))
        if rng.random() < 0.35 or not networks:
            files[described] = of_json(files[described], rng)
            return
        name = rng.choice(networks)
        files[name] = of_onnx(files[name], rng)
        if rng.random() < 0.98:
            try:
                stored = json.loads(files[described])
                stored["files"][name] = hashlib.sha256(files[name]).hexdigest()
                files[described] = json.dumps(stored).encode()
            except (ValueError, KeyError, TypeError):
                return

    return of_folder(content, rng, inner)


def of_onnx(content: bytes, rng: random.Random) -> bytes:
    """A network with one field of one of its messages changed, removed or repeated; seldom single bytes."""
    if rng.random() < 0.2:
        return of_bytes(content, rng)
    import onnx

    try:
        model = onnx.load_model_from_string(content)
    except Exception:  # protobuf's own kinds of errors
        return of_bytes(content, rng)
    message: Any = model.graph
    for _ in range(6):  # down into a random message
        inner = [value for field, value in message.ListFields() if field.type == field.TYPE_MESSAGE]
        inner = [rng.choice(value) if hasattr(value, "__len__") else value for value in inner]
        if not inner or rng.random() < 0.15:
            break
        message = rng.choice(inner)
    fields = message.ListFields()
    if not fields:
        return of_bytes(content, rng)
    field, value = rng.choice(fields)
    if hasattr(value, "__len__") and not isinstance(value, (str, bytes)):
        _other_repeated(message, field, value, rng)
    elif field.type == field.TYPE_MESSAGE:
        message.ClearField(field.name)
    else:
        _set(message, field, value, rng)
    return bytes(model.SerializeToString())


def _other_repeated(message: Any, field: Any, values: Any, rng: random.Random) -> None:
    """Change, remove or repeat one of a field's values."""
    at = rng.randrange(len(values))
    if rng.random() < 0.4:
        del values[at]
    elif field.type == field.TYPE_MESSAGE:
        values.add().CopyFrom(values[at])
    else:
        kept = list(values)
        kept[at] = _hostile_field(field, kept[at], rng)
        try:
            message.ClearField(field.name)
            values.extend(kept)
        except (ValueError, TypeError):
            return


def _set(message: Any, field: Any, old: Any, rng: random.Random) -> None:
    try:
        setattr(message, field.name, _hostile_field(field, old, rng))
    except (ValueError, TypeError):
        message.ClearField(field.name)


def _hostile_field(field: Any, old: Any, rng: random.Random) -> Any:
    if isinstance(old, bytes):
        return rng.choice((with_a_float(old, rng), of_bytes(old, rng), b"")) if old else b"\0"
    if isinstance(old, str):
        operators = ("Loop", "Identity", "Reshape", "Gather", "ConstantOfShape", "Expand", "NonZero", "Cast", old)
        return rng.choice((*operators, hostile_word(rng).encode("utf-8", "replace").decode()))
    if isinstance(old, float):
        return hostile_float(rng)
    return rng.choice((old + 1, old - 1, -old, 0, 1, 2, 7, 2**31 - 1, 10_000, 2**40))
