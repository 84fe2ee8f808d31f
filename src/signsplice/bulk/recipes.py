"""Recipes: rows in Parquet or CSV, each of which fully determines a sentence."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from decimal import Decimal
from itertools import chain
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.csv
import pyarrow.parquet as pq

from signsplice.errors import FormatError, InputError
from signsplice.formats.atomic import replacing
from signsplice.formats.reading import format_errors, open_file
from signsplice.splicing.faces import RULES
from signsplice.splicing.options import SpliceOptions
from signsplice.splicing.person import NATURAL

SUFFIXES = (".parquet", ".csv")
ROWS = 65_536
"""Number of recipes of a batch, and of a row group of a file."""
_ADDED_LATER = ("face_rules", "system", "person")
"""Fields that earlier versions did not have."""


@dataclass(frozen=True)
class SentenceRecipe:
    """Determines a sentence, together with the lexicon and the networks. Defaults are those of ``sentence``.

    glosses: words of the lexicon in order; others are spelled, see ``spell``. Compounds are not recognised.
    signer: one of the lexicon's signers, to whose body clips of other signers are retargeted. Empty: clips stay as
        they are, on the body of the first.
    seed: of the draw of the recipe, and ``SpliceOptions.seed`` of its sentence. Movements by it differ between
        sentences of one seed, since they depend on each word and its place too.
    transition_time: seconds, or the name of a rule.
    sign_speed, tempo, fps, cutter, transition, free_hand, avoid_collisions, person: as in ``SpliceOptions``.
    system: name of a system that joins whole words, in place of cutter, transition and their options.
    spell: whether to spell words that the lexicon lacks; otherwise the row fails.
    pauses: whether to hold signs at the punctuation after their gloss: "HELLO,".
    face_rules: whether words without a face get one by rule: blinks, and brows up to a gloss with a ``?``.
    """

    glosses: tuple[str, ...]
    signer: str = ""
    seed: int = 0
    transition_time: str = "auto"
    sign_speed: float = 1.0
    tempo: str = "citation"
    fps: float | None = None
    cutter: str | None = None
    transition: str | None = None
    free_hand: str = NATURAL
    avoid_collisions: bool | None = None
    spell: bool = True
    pauses: bool = True
    face_rules: bool = False
    system: str | None = None
    person: float = 1.0

    @property
    def sha256(self) -> str:
        """Hash of all fields; includes those that were added later, ``_ADDED_LATER``, only if they are set."""
        values = {
            name: value for name, value in asdict(self).items() if name not in _ADDED_LATER or value != _DEFAULTS[name]
        }
        return hashlib.sha256(json.dumps(values, sort_keys=True, ensure_ascii=False).encode()).hexdigest()

    def options(self, bundle: str | None) -> SpliceOptions:
        """Return the engine's options with the networks of ``bundle``. Raises ``InputError`` for invalid numbers."""
        try:
            seconds, rule = float(self.transition_time), "auto"
        except ValueError:
            seconds, rule = None, self.transition_time
        names = ("cutter", "transition", "sign_speed", "tempo", "fps", "avoid_collisions", "free_hand", "person")
        same = {name: getattr(self, name) for name in (*names, "seed", "system")}
        rules = RULES if self.face_rules else ()
        return SpliceOptions(**same, duration=rule, bundle=bundle, transition_time=seconds, face_rules=rules)


_TYPES = {"glosses": pa.list_(pa.string()), "seed": pa.int64()}
_TYPES |= dict.fromkeys(("sign_speed", "fps", "person"), pa.float64())
_TYPES |= dict.fromkeys(("avoid_collisions", "spell", "pauses", "face_rules"), pa.bool_())
_DEFAULTS: Mapping[str, Any] = {row.name: row.default for row in fields(SentenceRecipe)} | {"glosses": None}
SCHEMA = pa.schema([(name, _TYPES.get(name, pa.string())) for name in _DEFAULTS])
"""Columns of recipes."""


def read(path: str | Path) -> Iterator[pa.RecordBatch]:
    """Read the recipes of a file by its suffix, ``.parquet`` or ``.csv``, as batches of ``ROWS`` rows of ``SCHEMA``.

    Only the column ``glosses`` is required: a list of texts, or a text with white space between glosses. Missing,
    empty and NaN values get the default. Raises ``InputError``, which names the file and the column, for anything
    else. Arrow decompresses a table, however small its file: no limit of this package bounds that memory.
    """
    path = Path(path)
    check_suffix(path)
    with open_file(path) as (file, _), format_errors(str(path), "table of recipes"):
        if path.suffix.lower() == ".csv":
            text = pyarrow.csv.ConvertOptions(
                column_types={name: pa.string() for name in SCHEMA.names}, null_values=[""], strings_can_be_null=True
            )
            with pyarrow.csv.open_csv(file, convert_options=text) as rows:
                yield from _batches(path, rows)
        else:
            with pq.ParquetFile(file) as table:
                yield from _batches(path, table.iter_batches(ROWS))


def check_suffix(path: str | Path) -> None:
    """Raise ``InputError`` if a file's name is not that of a file of recipes."""
    if Path(path).suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: expected recipes in a file whose name ends in {' or '.join(SUFFIXES)}")


def _batches(path: Path, stored: Iterable[pa.RecordBatch]) -> Iterator[pa.RecordBatch]:
    """Convert a file's batches to batches of ``SCHEMA``, each of ``ROWS`` rows except the last."""
    waiting: list[pa.RecordBatch] = []
    for batch in stored:
        waiting.append(_cast_to_schema(batch, path))
        while sum(map(len, waiting)) >= ROWS:
            joined = pa.concat_batches(waiting)
            yield joined[:ROWS]
            waiting = [joined[ROWS:]]
    if any(map(len, waiting)):
        yield pa.concat_batches(waiting)


def _cast_to_schema(batch: pa.RecordBatch, path: Path) -> pa.RecordBatch:
    names = batch.schema.names
    unknown = [name for name in names if name not in SCHEMA.names]
    if unknown or "glosses" not in names:
        what = f"column {unknown[0][:40]!r}" if unknown else "no column 'glosses'"
        raise FormatError(f"{what}, expected glosses and any other of {', '.join(SCHEMA.names[1:])}", file=str(path))
    for name in names:
        if names.count(name) > 1:
            raise FormatError(f"column {name} is there {names.count(name)} times, expected once", file=str(path))
    columns = []
    for name, kind in zip(SCHEMA.names, SCHEMA.types, strict=True):
        try:
            columns.append(_column(batch, name, kind))
        except Exception as error:  # from Arrow, or for a value that Python cannot represent
            raise FormatError(f"column {name}: {str(error)[:200]}, expected {kind}", file=str(path)) from error
    return pa.RecordBatch.from_arrays(columns, schema=SCHEMA)


def _column(batch: pa.RecordBatch, name: str, kind: pa.DataType) -> pa.Array:
    if name not in batch.schema.names:
        return pa.array([_DEFAULTS[name]] * len(batch), kind)
    column = batch.column(name)
    column.validate(full=True)  # otherwise text that is not UTF-8 fails only on use
    if isinstance(column, pa.DictionaryArray):
        column = column.dictionary_decode()
    if pa.types.is_large_string(column.type) or pa.types.is_string_view(column.type):
        column = column.cast(pa.string())
    if name == "glosses":
        if pa.types.is_string(column.type):
            column = pc.utf8_split_whitespace(pc.utf8_trim_whitespace(column))
        if column.null_count or pc.list_flatten(column).null_count:
            raise InputError("a row has no glosses, or null among them")
    elif pa.types.is_string(kind) and not pa.types.is_string(column.type):
        if pa.types.is_float32(column.type):
            column = column.cast(pa.string()).cast(pa.float64())  # 0.3 stays 0.3, unlike in a direct cast
        column = pa.array([None if value is None else _text(value) for value in _no_nan(column).to_pylist()], kind)
    column = _no_nan(_no_nan(column).cast(kind))  # before, since NaN is no integer; after, for the text "nan"
    return column if _DEFAULTS[name] is None else column.fill_null(pa.scalar(_DEFAULTS[name], kind))


def _no_nan(column: pa.Array) -> pa.Array:
    """Replace NaN by null in a column of floating-point numbers: NaN is not equal to itself."""
    if not pa.types.is_floating(column.type):
        return column
    return pc.if_else(pc.is_nan(column), pa.scalar(None, column.type), column)


def _text(value: object) -> str:
    """Return a number in a column of texts with all its digits: "2" for 2.0."""
    if isinstance(value, bool) or not isinstance(value, int | float | Decimal):
        raise InputError(f"{str(value)[:40]!r} is no text and no number")
    return repr(value).removesuffix(".0") if isinstance(value, float) else str(value)


def batch_of(rows: Iterable[SentenceRecipe]) -> pa.RecordBatch:
    """Return recipes as one batch of ``SCHEMA``."""
    return pa.RecordBatch.from_pylist([asdict(row) for row in rows], schema=SCHEMA)


def recipes_of(batch: pa.RecordBatch) -> list[SentenceRecipe]:
    """Return the rows of a batch of ``SCHEMA`` as recipes."""
    return [SentenceRecipe(**row | {"glosses": tuple(row["glosses"])}) for row in batch.to_pylist()]


def write(path: str | Path, batches: Iterable[pa.RecordBatch]) -> int:
    """Write batches of ``SCHEMA`` by suffix, atomically; returns the number of rows. In CSV, glosses are one text,
    separated by blanks.
    """
    n_rows = 0
    with replacing(path) as temporary:
        if Path(path).suffix.lower() == ".csv":
            schema = SCHEMA.set(0, pa.field("glosses", pa.string()))
            with pyarrow.csv.CSVWriter(temporary, schema) as table:
                for batch in batches:
                    joined = pc.binary_join(batch.column(0), " ")
                    table.write(pa.RecordBatch.from_arrays([joined, *batch.columns[1:]], schema=schema))
                    n_rows += len(batch)
        else:
            with pq.ParquetWriter(temporary, SCHEMA, compression="zstd") as file:
                for batch in batches:
                    file.write_batch(batch, row_group_size=ROWS)
                    n_rows += len(batch)
    return n_rows


def rows(path: str | Path, start: int, stop: int) -> list[SentenceRecipe]:
    """Read recipes start .. stop-1 of a Parquet file that ``write`` wrote; reads only their row groups.

    Raises ``FormatError`` if the file cannot be read or lacks some of them.
    """
    with _own(path) as file:
        groups = range(start // ROWS, min(file.num_row_groups, (stop - 1) // ROWS + 1))
        batches = chain.from_iterable(file.iter_batches(ROWS, row_groups=[group]) for group in groups)
        table = pa.Table.from_batches([_cast_to_schema(batch, Path(path)) for batch in batches], SCHEMA).slice(
            start - start // ROWS * ROWS, stop - start
        )
        if len(table) != stop - start:
            raise InputError(f"{file.metadata.num_rows} rows, expected row {stop - 1} too")
        return [row for batch in table.to_batches() for row in recipes_of(batch)]


def is_same(path: str | Path, batches: Iterable[pa.RecordBatch]) -> bool:
    """Return whether a file that ``write`` wrote holds exactly these rows. Raises ``FormatError`` if unreadable."""
    stored = _iter_stored_batches(path)
    return all(batch.equals(next(stored, None)) for batch in batches) and next(stored, None) is None


def _iter_stored_batches(path: str | Path) -> Iterator[pa.RecordBatch]:
    with _own(path) as file:
        is_older = {*file.schema_arrow.names} < {*SCHEMA.names}
        yield from (_cast_to_schema(batch, Path(path)) if is_older else batch for batch in file.iter_batches(ROWS))


@contextmanager
def _own(path: str | Path) -> Iterator[pq.ParquetFile]:
    """Open a file that ``write`` wrote. Raises ``FormatError`` if it cannot be read, on opening or in the block."""
    try:
        with open_file(path) as (file, _), format_errors(str(path), "table of recipes"), pq.ParquetFile(file) as table:
            yield table
    except InputError as error:
        reason = str(error).removeprefix(f"{path}: ")[:200]
        what = f"cannot be read as the recipes that the folder was begun with ({reason})"
        raise FormatError(f"{what}; put that file back, or name a new folder", file=str(path)) from error
