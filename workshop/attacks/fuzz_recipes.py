"""Makes recipes to start from, in CSV and Parquet, and mutates them: other types, nulls, text that is no UTF-8, tables
of other shapes, long texts and lists, and broken files.
"""

from __future__ import annotations

import datetime
import decimal
import io
import random
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from fuzz_mutators import INTEGERS, draw_hostile_float, draw_hostile_word, mutate_bytes, mutate_text
from signsplice.bulk.recipes import SCHEMA, SentenceRecipe, batch_of

_ROWS = (
    SentenceRecipe(("HELLO", "I"), sign_speed=1.25, transition_time="0.3", seed=7, cutter="pose-velocity"),
    SentenceRecipe(("fs-AB", "SIGN"), fps=60.0, tempo="natural", cutter="ends", transition="hermite", spell=False),
    SentenceRecipe(("YES", "NO", "YES"), "standard", cutter="ends", transition="linear", avoid_collisions=False),
)
_CSV = b"""glosses,signer,seed,transition_time,sign_speed,tempo,fps,cutter,transition,free_hand,avoid_collisions,spell
HELLO I,,7,auto,1.25,citation,,pose-velocity,hermite,transition,,true
"fs-AB,  SIGN",standard,0,0.3,1,0.8,25,ends,linear,natural,false,false
YES,,,,,,,ends,,,,
"""
_MAGIC = b"PAR1"
_LARGEST = 1 << 20
"""Size of the largest file that is made, bytes: larger ones take long, and show no more."""


def make_seeds() -> list[bytes]:
    """Returns a CSV table, and Parquet tables of our columns, of other types of them, and of glosses alone."""
    batch = batch_of(_ROWS)
    other_columns = {
        "glosses": [" HELLO  I", "YES"],
        "sign_speed": pa.array([1, 2], pa.int8()),
        "cutter": ["ends", "ends"],
        "tempo": pa.array([0.8, None], pa.float32()),
        "signer": pa.array(["", ""]).dictionary_encode(),
    }
    return [
        _CSV,
        encode_table(pa.Table.from_batches([batch])),
        encode_table(pa.table(other_columns), compression="zstd"),
        encode_table(pa.table({"glosses": [["HELLO", "NO"]], "cutter": ["ends"]}), row_group_size=1),
    ]


def encode_table(table: pa.Table, **options: Any) -> bytes:
    """Returns the bytes of a Parquet file."""
    stream = io.BytesIO()
    pq.write_table(table, stream, **options)
    return stream.getvalue()


def mutate_recipes(content: bytes, rng: random.Random) -> bytes:
    """Returns a table with a column, a value, its rows or its names changed; a CSV file as text; seldom single
    bytes.
    """
    if not content.startswith(_MAGIC):
        return mutate_text(content, rng)
    if rng.random() < 0.15:
        start = len(content) // 2 if rng.random() < 0.5 else 0  # the second half of a small file is its description
        return content[:start] + mutate_bytes(content[start:], rng)
    try:
        table = pq.read_table(io.BytesIO(content))
        table = _mutate_table(table, rng)
        file_bytes = encode_table(
            table,
            compression=rng.choice(("none", "snappy", "zstd", "gzip")),
            use_dictionary=rng.random() < 0.5,
            row_group_size=rng.choice((1, 2, 1000, 1 << 20)) if len(table) else None,
            data_page_version=rng.choice(("1.0", "2.0")),
            store_schema=rng.random() < 0.8,
        )
        return file_bytes if len(file_bytes) <= _LARGEST else content
    except Exception:  # Arrow raises its own kinds of errors for a broken file or a type that Parquet lacks
        return mutate_bytes(content, rng)


def _mutate_table(table: pa.Table, rng: random.Random) -> pa.Table:
    names, columns = list(map(_encode_field_name, table.schema)), list(table.columns)
    number = rng.randrange(len(columns)) if columns else 0
    if rng.random() < 0.3 and b"glosses" in names:
        number = names.index(b"glosses")
    match rng.randrange(12):
        case 0 if columns:
            del names[number], columns[number]
        case 1 if columns:
            other_names = (*SCHEMA.names, draw_hostile_word(rng), names[number] + b"\xff", names[number] + b"\n")
            names[number] = _encode_name(rng.choice(other_names))
        case 2 if columns:
            names.append(names[number])
            columns.append(columns[number])
        case 3:
            return table[: rng.randrange(len(table) + 1)]
        case 4 if 0 < table.nbytes < 1000:  # Arrow unpacks repetitions without a limit
            return pa.concat_tables([table] * rng.choice((2, 50, 1000)))
        case 5 | 6 if columns:
            values = columns[number].to_pylist()
            if values:
                values[rng.randrange(len(values))] = _draw_value(columns[number].type, rng)
            columns[number] = pa.array(values, columns[number].type, from_pandas=False)
        case 7:
            names.append(_encode_name(rng.choice(SCHEMA.names)))
            columns.append(_draw_column(len(table), rng))
        case _ if columns:
            columns[number] = _draw_column(len(table), rng)
    return pa.Table.from_arrays(columns, schema=pa.schema([
        pa.field(name, column.type) for name, column in zip(names, columns, strict=True)
    ]))  # fmt: skip


def _encode_field_name(field: Any) -> bytes:
    return bytes(field.name.encode("utf-8", "surrogateescape"))


def _encode_name(name: str | bytes) -> bytes:
    return name if isinstance(name, bytes) else name.encode("utf-8", "replace")


def _draw_value(kind: Any, rng: random.Random) -> Any:
    """Returns a value of a column's type, or null."""
    if rng.random() < 0.2:
        return None
    if pa.types.is_list(kind):
        return [_draw_value(kind.value_type, rng) for _ in range(rng.choice((0, 1, 2, 30)))]
    if pa.types.is_boolean(kind):
        return rng.random() < 0.5
    if pa.types.is_integer(kind):
        return rng.choice([n for n in INTEGERS if -128 <= n < 128])
    if pa.types.is_floating(kind):
        return draw_hostile_float(rng)
    return draw_hostile_word(rng).encode("utf-8", "replace").decode()


def _draw_column(n: int, rng: random.Random) -> Any:
    """Returns an array of ``n`` rows of any type: types that other programs write, invalid ones, and ones that grow in
    memory.
    """
    word, number = draw_hostile_word(rng).encode("utf-8", "replace").decode(), draw_hostile_float(rng)
    integer = rng.choice([i for i in INTEGERS if -(2**63) <= i < 2**63])
    makers: tuple[Any, ...] = (
        lambda: pa.array([integer] * n, pa.int64()),
        lambda: pa.array([integer % 2**64] * n, pa.uint64()),
        lambda: pa.array([number] * n, rng.choice((pa.float64(), pa.float32()))),
        lambda: pa.array([word] * n, rng.choice((pa.string(), pa.large_string(), pa.string_view()))),
        lambda: pa.array([rng.random() < 0.5] * n),
        lambda: pa.nulls(n, rng.choice((pa.null(), pa.string(), pa.float64(), pa.list_(pa.string())))),
        lambda: pa.array([rng.randbytes(3)] * n, pa.binary()),
        lambda: _draw_invalid_text(n, rng),
        lambda: pa.array([[_draw_value(pa.string(), rng)] * rng.randrange(4)] * n, pa.list_(pa.string())),
        lambda: pa.array([[word]] * n, rng.choice((pa.large_list(pa.string()), pa.list_(pa.string(), 1)))),
        lambda: pa.array([[[word]]] * n),
        lambda: pa.array([[integer]] * n),
        lambda: pa.array([{"a": word}] * n),
        lambda: pa.array([[("a", 1)]] * n, pa.map_(pa.string(), pa.int64())),
        lambda: pa.array([integer] * n, rng.choice((pa.timestamp("ns"), pa.timestamp("s"), pa.duration("us")))),
        lambda: pa.array([datetime.date(2024, 1, 1)] * n),
        lambda: pa.array([integer % 2**31] * n, pa.date32()),
        lambda: pa.array([decimal.Decimal("1.25")] * n, pa.decimal128(38, 2)),
        lambda: pa.array([word] * n).dictionary_encode(),
        lambda: _draw_invalid_text(n, rng).dictionary_encode(),
        lambda: pa.array(["HELLO " * rng.choice((10, 10_000))] * min(n, 8) + [""] * max(n - 8, 0)),
        lambda: pa.array([["HELLO"] * rng.choice((10, 3_000))] * n),
        lambda: pa.array([[None] * rng.choice((10, 100_000))] + [["HELLO"]] * (n - 1), pa.list_(pa.string())),
    )
    return rng.choice(makers)()


def _draw_invalid_text(n: int, rng: random.Random) -> Any:
    """Returns texts, or lists of one text, of bytes that are no UTF-8."""
    text = rng.choice((b"\xff", b"HELLO\xc3", b"\xed\xa0\x80", b"\x80I"))
    raw = pa.array([text] * n, pa.binary())
    texts = pa.Array.from_buffers(pa.string(), n, raw.buffers())
    if rng.random() < 0.5:
        return texts
    return pa.ListArray.from_arrays(pa.array(range(n + 1), pa.int32()), texts)
