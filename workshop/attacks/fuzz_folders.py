"""Mutates lexicons and bundles, stored as archives of their folder: rows, networks and descriptions, mostly with right
hashes, so that the readers behind them are reached.
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
from fuzz_clips import mutate_array, pack, unpack
from fuzz_mutators import (
    INTEGERS,
    draw_hostile_float,
    draw_hostile_value,
    draw_hostile_word,
    mutate_bytes,
    mutate_floats,
    mutate_json,
)


def mutate_folder(
    content: bytes, rng: random.Random, mutate_files: Callable[[dict[str, bytes], random.Random], None]
) -> bytes:
    """Returns a folder, stored as an archive, whose files (name -> bytes) ``mutate_files`` mutates in place; seldom
    with a file removed, emptied or swapped.
    """
    try:
        members = unpack(content)
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError, RuntimeError, EOFError):
        return content  # mutating the archive itself would test zipfile
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
        mutate_files(members, rng)
    return pack(members)


def mutate_lexicon(content: bytes, rng: random.Random) -> bytes:
    """Returns a lexicon with a row of its index, the index's declarations, or bytes of either file mutated."""

    def mutate_files(files: dict[str, bytes], rng: random.Random) -> None:
        index, frames = "index.sqlite", "frames.bin"
        if index not in files or frames not in files:
            return
        choice = rng.random()
        if choice < 0.25:
            files[frames] = _mutate_frames(files[frames], rng)
        elif choice < 0.45:
            files[index] = mutate_bytes(files[index], rng)
        else:
            files[index] = _mutate_index(files[index], rng)
            if rng.random() < 0.5:
                _update_hashes(files)

    return mutate_folder(content, rng, mutate_files)


def _mutate_frames(frames: bytes, rng: random.Random) -> bytes:
    """Returns frames mutated behind the head, mostly of the same length."""
    if rng.random() < 0.2:
        return mutate_bytes(frames, rng)
    changed = mutate_bytes(frames[64:], rng)
    return frames[:64] + changed[: len(frames) - 64].ljust(len(frames) - 64, b"\0")


_DECLARATIONS = (
    "CREATE TABLE {0} AS SELECT * FROM old",
    "CREATE VIEW {0} AS SELECT * FROM old",
    "CREATE VIEW {0} AS SELECT * FROM old UNION ALL SELECT * FROM {0}",
    "CREATE VIEW {0} AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT old.* FROM old, n",
    "CREATE VIEW {0} AS SELECT a.* FROM old a, word b, word c, word d, word e, word f, word g, word h, word i, word j",
)


def _open_index(index: bytes) -> sqlite3.Connection:
    """Returns an index in memory, in which a query without end, as of an injected view, fails."""
    file = sqlite3.connect(":memory:", isolation_level=None)
    file.deserialize(index)
    steps = itertools.count()
    file.set_progress_handler(lambda: next(steps) > 100, 1000)
    return file


def _mutate_index(index: bytes, rng: random.Random) -> bytes:
    """Returns an index with a value, a row or a table's declaration changed."""
    file = _open_index(index)
    try:
        tables = [name for (name,) in file.execute("SELECT name FROM sqlite_master WHERE type = 'table'")]
        table = rng.choice([*tables, *("word", "word", "word")[: 3 * ("word" in tables)]])  # a view may be endless
        choice = rng.randrange(10)
        if choice == 0:
            pragma = rng.choice(("user_version", "application_id"))
            file.execute(f"PRAGMA {pragma} = {rng.choice(INTEGERS[:18])}")
        elif choice in (1, 2):  # no types and constraints, or an endless view
            file.execute("PRAGMA legacy_alter_table = ON")
            file.execute(f"ALTER TABLE {table} RENAME TO old")
            file.execute(_DECLARATIONS[0 if choice == 1 else rng.randrange(1, len(_DECLARATIONS))].format(table))
        else:
            _change_rows(file, table, choice, rng)
        return file.serialize()
    except (sqlite3.Error, OverflowError, IndexError, ValueError):
        return mutate_bytes(index, rng)
    finally:
        file.close()


def _change_rows(file: sqlite3.Connection, table: str, choice: int, rng: random.Random) -> None:
    """Changes a value of a table, or removes or repeats a row."""
    rows = file.execute(f"SELECT * FROM {table}").fetchall()
    number = rng.randrange(len(rows))
    if choice == 3:
        del rows[number]
    else:
        row = list(rng.choice(rows))
        column = rng.randrange(len(row))
        row[column] = _draw_cell(row[column], rng)
        if choice == 4:
            rows.append(tuple(row))
        else:
            rows[number] = tuple(row)
    file.execute(f"DELETE FROM {table}")
    file.executemany(f"INSERT OR REPLACE INTO {table} VALUES ({', '.join('?' * len(rows[0]))})", rows)


def _draw_cell(old_value: Any, rng: random.Random) -> Any:
    """Returns a value for a cell of a table: JSON within text is mutated as JSON."""
    if isinstance(old_value, str) and old_value[:1] in ("[", "{") and rng.random() < 0.7:
        return mutate_json(old_value.encode("utf-8", "replace"), rng).decode("utf-8", "replace")
    value = draw_hostile_value(rng, old_value)
    if isinstance(value, (list, dict)):
        return json.dumps(value)
    if isinstance(value, int) and not -(2**63) <= value < 2**63:
        return float(value)
    if isinstance(value, str):
        value = value.encode("utf-8", "replace").decode()
        return value.encode() if rng.random() < 0.2 else value
    return value


def _update_hashes(files: dict[str, bytes]) -> None:
    """Updates the hashes of an index's skeletons."""
    file = _open_index(files["index.sqlite"])
    try:
        for number, text in file.execute("SELECT id, described FROM skeleton").fetchall():
            content = text if isinstance(text, bytes) else str(text).encode()
            file.execute("UPDATE skeleton SET sha256 = ? WHERE id = ?", (hashlib.sha256(content).hexdigest(), number))
        files["index.sqlite"] = file.serialize()
    except (sqlite3.Error, UnicodeError):
        return
    finally:
        file.close()


def mutate_shards(content: bytes, rng: random.Random) -> bytes:
    """Returns a folder of shards with its job, its recipes or its index mutated."""

    def mutate_files(files: dict[str, bytes], rng: random.Random) -> None:
        tables = [name for name in files if name.endswith(".parquet")]
        name = rng.choice([*files, "job.json", *tables])
        if name in files:
            mutate = (
                mutate_json
                if name.endswith(".json")
                else fuzz_recipes.mutate_recipes
                if name in tables
                else mutate_bytes
            )
            files[name] = mutate(files[name], rng)

    return mutate_folder(content, rng, mutate_files)


def mutate_pairs(content: bytes, rng: random.Random) -> bytes:
    """Returns a corpus of pairs with its description or an array mutated."""

    def mutate_files(files: dict[str, bytes], rng: random.Random) -> None:
        name = rng.choice([*files, *["corpus.json"] * 6])
        if name in files:
            files[name] = (mutate_json if name.endswith(".json") else mutate_array)(files[name], rng)

    return mutate_folder(content, rng, mutate_files)


def mutate_bundle(content: bytes, rng: random.Random) -> bytes:
    """Returns a bundle with its description or a network mutated; the hashes that it lists mostly stay right."""

    def mutate_files(files: dict[str, bytes], rng: random.Random) -> None:
        config_name = "bundle.json"
        if config_name not in files:
            return
        networks = sorted(name for name in files if name.endswith(".onnx"))
        if rng.random() < 0.35 or not networks:
            files[config_name] = mutate_json(files[config_name], rng)
            return
        name = rng.choice(networks)
        files[name] = mutate_onnx(files[name], rng)
        if rng.random() < 0.98:
            try:
                config = json.loads(files[config_name])
                config["files"][name] = hashlib.sha256(files[name]).hexdigest()
                files[config_name] = json.dumps(config).encode()
            except (ValueError, KeyError, TypeError):
                return

    return mutate_folder(content, rng, mutate_files)


def mutate_onnx(content: bytes, rng: random.Random) -> bytes:
    """Returns a network with one field of one of its messages changed, removed or repeated; seldom with single bytes
    mutated.
    """
    if rng.random() < 0.2:
        return mutate_bytes(content, rng)
    import onnx

    try:
        model = onnx.load_model_from_string(content)
    except Exception:  # protobuf raises its own kinds of errors
        return mutate_bytes(content, rng)
    message: Any = model.graph
    for _ in range(6):  # down to a random message
        messages = [value for field, value in message.ListFields() if field.type == field.TYPE_MESSAGE]
        messages = [rng.choice(value) if hasattr(value, "__len__") else value for value in messages]
        if not messages or rng.random() < 0.15:
            break
        message = rng.choice(messages)
    fields = message.ListFields()
    if not fields:
        return mutate_bytes(content, rng)
    field, value = rng.choice(fields)
    if hasattr(value, "__len__") and not isinstance(value, (str, bytes)):
        _mutate_repeated_field(message, field, value, rng)
    elif field.type == field.TYPE_MESSAGE:
        message.ClearField(field.name)
    else:
        _set_field(message, field, value, rng)
    return bytes(model.SerializeToString())


def _mutate_repeated_field(message: Any, field: Any, values: Any, rng: random.Random) -> None:
    """Changes, removes or repeats one of a field's values."""
    number = rng.randrange(len(values))
    if rng.random() < 0.4:
        del values[number]
    elif field.type == field.TYPE_MESSAGE:
        values.add().CopyFrom(values[number])
    else:
        changed_values = list(values)
        changed_values[number] = _draw_field_value(field, changed_values[number], rng)
        try:
            message.ClearField(field.name)
            values.extend(changed_values)
        except (ValueError, TypeError):
            return


def _set_field(message: Any, field: Any, old_value: Any, rng: random.Random) -> None:
    try:
        setattr(message, field.name, _draw_field_value(field, old_value, rng))
    except (ValueError, TypeError):
        message.ClearField(field.name)


def _draw_field_value(field: Any, old_value: Any, rng: random.Random) -> Any:
    if isinstance(old_value, bytes):
        return rng.choice((mutate_floats(old_value, rng), mutate_bytes(old_value, rng), b"")) if old_value else b"\0"
    if isinstance(old_value, str):
        operators = ("Loop", "Identity", "Reshape", "Gather", "ConstantOfShape", "Expand", "NonZero", "Cast", old_value)
        return rng.choice((*operators, draw_hostile_word(rng).encode("utf-8", "replace").decode()))
    if isinstance(old_value, float):
        return draw_hostile_float(rng)
    return rng.choice((old_value + 1, old_value - 1, -old_value, 0, 1, 2, 7, 2**31 - 1, 10_000, 2**40))
