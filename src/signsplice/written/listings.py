"""Tables, lists and JSON of HamNoSys as rows of gloss, notation and line, whatever their columns are called."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Literal

from signsplice.errors import FormatError
from signsplice.written import symbols

Row = tuple[str, str, int]
_GLOSSES = ("gloss", "type_name", "glosse", "word", "sign", "lemma", "name", "label", "w", "id")
_NOTATIONS = ("hamnosys", "hns", "notation", "transcription", "sigml", "hamnosys_text", "s")
"""Names of columns and keys, the one that is preferred first."""
_NAMES = "|".join(sorted(symbols.NAMES, key=len, reverse=True))
_NOTATION = re.compile(rf"[\ue000-\ue0f1]|\bham(?:{_NAMES})\b", re.IGNORECASE)
"""What only a notation holds."""
_NUMBER = re.compile(r"[\d\s.,:;+-]*")
_SAMPLE = 50


def decoded(content: bytes, name: str) -> str:
    """The text of a file in UTF-8, UTF-16 with its mark, or Windows' Western code page."""
    encoding = "utf-16" if content[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    for one in (encoding, "cp1252"):
        try:
            return content.decode(one)
        except UnicodeDecodeError as error:
            wrong = error
    raise FormatError(f"is no UTF-8 text ({wrong.reason} at byte {wrong.start})", file=name) from wrong


def json_rows(text: str, name: str) -> Iterator[Row]:
    """The rows of a JSON object of notations or of objects by gloss, or of a list of objects."""
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise FormatError(f"is no JSON ({str(error)[:100]})", file=name) from error
    while isinstance(content, dict) and len(content) == 1 and isinstance(next(iter(content.values())), list):
        (content,) = content.values()
    pairs: Iterable[tuple[str, object]] = content.items() if isinstance(content, dict) else ()
    if isinstance(content, list) and all(isinstance(item, dict) for item in content):
        pairs = ((f"{n}", item) for n, item in enumerate(content, 1))
    elif not isinstance(content, dict):
        raise FormatError("expected an object of glosses, or a list of objects with gloss and hamnosys", file=name)
    for key, item in pairs:
        values = {k.casefold(): v for k, v in item.items()} if isinstance(item, dict) else {"hamnosys": item}
        values = {k: " ".join(map(str, v)) if isinstance(v, list) else v for k, v in values.items()}
        gloss, notation = (next(_texts(values, names), "") for names in (_GLOSSES, _NOTATIONS))
        yield gloss or key, notation, 1


def _texts(values: dict[str, object], names: Sequence[str]) -> Iterator[str]:
    """The texts of some keys that are not blank."""
    for key in names:
        value = values.get(key)
        if isinstance(value, str) and value.strip() and value != "None":
            yield value


def table_rows(text: str, name: str, suffix: str) -> Iterator[Row]:
    """The rows of a CSV, of lines with tabs, or of lines in which characters of HamNoSys follow the gloss."""
    first = next((line for line in text.splitlines() if line.strip()), "")
    delimiter = next((mark for mark in "\t;," if mark in first), ",")
    if suffix != ".csv" and delimiter != "\t":
        yield from _lines(text, name)
        return
    quoting: Literal[0, 3] = csv.QUOTE_MINIMAL if suffix == ".csv" else csv.QUOTE_NONE
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter, quoting=quoting, strict=True)
    try:
        rows = [(cells, reader.line_num) for cells in reader if any(cell.strip() for cell in cells)]
    except csv.Error as error:
        raise FormatError(f"is no table ({error})", file=name, line=reader.line_num) from error
    headed = bool(rows) and not any(map(_NOTATION.search, rows[0][0]))
    head = [cell.strip().casefold() for cell in rows[0][0]] if headed else []
    sample = [cells for cells, _ in rows[:_SAMPLE]]
    notations = [head.index(key) for key in _NOTATIONS if key in head] or _columns(sample, _NOTATION.search)[:1]
    if not notations and suffix == ".csv":
        raise FormatError("expected a column hamnosys, or one that holds HamNoSys", file=name, line=1)
    glosses = [head.index(key) for key in _GLOSSES if key in head]
    named = [k for k in _columns(sample, lambda cell: not _NUMBER.fullmatch(cell)) if k not in notations]
    named.sort(key=lambda k: -len({cells[k] for cells in sample if k < len(cells)}))  # a tier's name is all the same
    glosses = glosses or named
    if not notations:
        headed, glosses, notations = False, [0], [1]
    if not glosses:
        raise FormatError("expected a column gloss beside the notation", file=name, line=1)
    for cells, line in rows[headed:]:
        gloss, notation = (next((cells[k] for k in at if k < len(cells) and cells[k].strip()), "") for at in (
            glosses[:1], notations))  # fmt: skip
        yield gloss, notation, line


def _columns(sample: Sequence[Sequence[str]], holds: Callable[[str], object]) -> list[int]:
    """The columns in most of whose cells something holds, the surest first."""
    width = max(map(len, sample), default=0)
    counts = [sum(bool(k < len(cells) and holds(cells[k].strip())) for cells in sample) for k in range(width)]
    most = max(counts, default=0)
    return [k for k in range(width) if counts[k] and 2 * counts[k] >= most]


def _lines(text: str, name: str) -> Iterator[Row]:
    """The rows of lines without columns: the last word before the first character of HamNoSys is the gloss."""
    for line, content in enumerate(text.splitlines(), 1):
        if content.strip():
            found = _NOTATION.search(content)
            gloss = content[: found.start()].split() if found else []
            if not found or not gloss:
                raise FormatError("has no tab, expected GLOSS, a tab and HamNoSys", file=name, line=line)
            yield gloss[-1], content[found.start() :], line
