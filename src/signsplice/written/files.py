"""Files and folders of written signs: SiGML, and HamNoSys in tables, lists and JSON with any column names."""

from __future__ import annotations

import csv
import io
import json
import re
import unicodedata
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from signsplice.errors import FormatError, InputError
from signsplice.formats.reading import read_bytes
from signsplice.written import gestural, hamnosys, symbols
from signsplice.written.reading import Element, Reading, below, parse_xml
from signsplice.written.tree import WrittenSign

Row = tuple[str, str, int]
_GLOSSES = ("gloss", "type_name", "glosse", "word", "sign", "lemma", "name", "label", "w", "id")
_NOTATIONS = ("hamnosys", "hns", "notation", "transcription", "sigml", "hamnosys_text", "s")
"""Names of columns and keys, in order of preference."""
_NAMES = "|".join(sorted(symbols.NAMES, key=len, reverse=True))
_NOTATION = re.compile(rf"[\ue000-\ue0f1]|\bham(?:{_NAMES})\b", re.IGNORECASE)
"""Matches text that only a notation contains."""
_NUMBER = re.compile(r"[\d\s.,:;+-]*")
_SAMPLE = 50
"""Number of rows that decide which column is which."""


def decode_text(content: bytes, name: str) -> str:
    """Decodes a file as UTF-8, UTF-16 with a byte order mark, or Windows-1252."""
    encoding = "utf-16" if content[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    for codec in (encoding, "cp1252"):
        try:
            return content.decode(codec)
        except UnicodeDecodeError as error:
            wrong = error
    raise FormatError(f"is no UTF-8 text ({wrong.reason} at byte {wrong.start})", file=name) from wrong


def json_rows(text: str, name: str) -> Iterator[Row]:
    """Yields the rows of a JSON object (gloss -> notation or object), or of a list of objects."""
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
    """Yields the nonblank texts of some keys."""
    for key in names:
        value = values.get(key)
        if isinstance(value, str) and value.strip() and value != "None":
            yield value


def table_rows(text: str, name: str, suffix: str) -> Iterator[Row]:
    """Yields the rows of a CSV, of lines with tabs, or of lines in which HamNoSys characters follow the gloss."""
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
    text_columns = [k for k in _columns(sample, lambda cell: not _NUMBER.fullmatch(cell)) if k not in notations]
    # The column with the most different texts comes first: a tier's name is the same in every row.
    text_columns.sort(key=lambda k: -len({cells[k] for cells in sample if k < len(cells)}))
    glosses = glosses or text_columns
    if not notations:
        headed, glosses, notations = False, [0], [1]
    if not glosses:
        raise FormatError("expected a column gloss beside the notation", file=name, line=1)
    for cells, line in rows[headed:]:
        gloss, notation = (next((cells[k] for k in columns if k < len(cells) and cells[k].strip()), "") for columns in (
            glosses[:1], notations))  # fmt: skip
        yield gloss, notation, line


def _columns(sample: Sequence[Sequence[str]], holds: Callable[[str], object]) -> list[int]:
    """Returns the columns with at least half as many matching cells as the best column."""
    width = max(map(len, sample), default=0)
    counts = [sum(bool(k < len(cells) and holds(cells[k].strip())) for cells in sample) for k in range(width)]
    largest = max(counts, default=0)
    return [k for k in range(width) if counts[k] and 2 * counts[k] >= largest]


def _lines(text: str, name: str) -> Iterator[Row]:
    """Yields the rows of lines without columns: the gloss is the last word before the first HamNoSys character."""
    for line, content in enumerate(text.splitlines(), 1):
        if content.strip():
            match = _NOTATION.search(content)
            gloss = content[: match.start()].split() if match else []
            if not match or not gloss:
                raise FormatError("has no tab, expected GLOSS, a tab and HamNoSys", file=name, line=line)
            yield gloss[-1], content[match.start() :], line


SUFFIXES = (".sigml", ".xml", ".csv", ".json", ".txt", ".tsv")
"""Suffixes of the files of written signs."""
_MOST_BYTES = 64 << 20
"""Largest file, bytes."""
_MOST_SIGNS = 200_000
"""Largest number of signs in a file."""
_SIGNS = ("hamgestural_sign", "hns_sign", "sigmlsign")
"""Elements that hold a sign; ``sigmlsign`` is a ``hamgestural_sign`` in older files."""


@dataclass(frozen=True)
class WrittenSigns:
    """The signs read from files.

    signs: gloss -> sign, in file order; a repeated gloss becomes GLOSS#2, then GLOSS#3
    refused: one error for each sign that could not be read
    """

    signs: dict[str, WrittenSign]
    refused: tuple[InputError, ...] = ()


def read(paths: str | Path | Sequence[str | Path], lenient: bool = False) -> WrittenSigns:
    """Reads the signs of a file, of all ``.sigml`` files below a folder in order of their names, or of several paths.

    lenient: leave out unknown parts, with a note in the sign. Raises ``InputError`` if a file does not exist, if there
    is no sign, or if the only file is broken.
    """
    roots = [Path(paths)] if isinstance(paths, (str, Path)) else [Path(path) for path in paths]
    files = [file for path in roots for file in (_below(path) if path.is_dir() else [path])]
    items = list[WrittenSign | InputError]()
    for file in files:
        try:
            items += _signs(read_bytes(file, _MOST_BYTES), str(file), lenient)  # up to an error
        except InputError as error:
            if len(files) == 1:
                raise
            items.append(error)
    return _number_glosses(items, str(roots[0]))


def _below(folder: Path) -> list[Path]:
    """The SiGML files below a folder, shortest names first, so that NAME.sigml precedes NAME-CL{THING}.sigml."""
    paths = [path for path in folder.rglob("*.sigml") if path.is_file()]
    paths.sort(key=lambda path: (len(path.name), path))
    if not paths:
        raise InputError(f"{folder}: no .sigml files in it; name tables of HamNoSys themselves")
    return paths


def parse(content: bytes, name: str, lenient: bool = False) -> WrittenSigns:
    """Reads the signs from a file's content; the suffix of ``name`` gives the format. Raises as ``read`` does."""
    return _number_glosses([*_signs(content, name, lenient)], name)


def one(text: str, gloss: str = "SIGN", lenient: bool = False) -> WrittenSign:
    """Reads one sign from HamNoSys text. Raises ``InputError`` with the symbol and its number."""
    return _of_text(text, Reading("<text>", gloss, lenient, by_line=False))


def _number_glosses(items: Sequence[WrittenSign | InputError], name: str) -> WrittenSigns:
    """Numbers repeated glosses. Raises ``FormatError`` if there are no items."""
    if not items:
        raise FormatError("holds no sign, expected hamgestural_sign, hns_sign or HamNoSys", file=name)
    written_signs = [item for item in items if isinstance(item, WrittenSign)]
    counts, signs, taken = Counter[str](), dict[str, WrittenSign](), {_fold(sign.gloss) for sign in written_signs}
    for sign in written_signs:
        folded = _fold(sign.gloss)
        counts[folded] += 1
        gloss = sign.gloss
        while counts[folded] > 1 and _fold(gloss := f"{sign.gloss}#{counts[folded]}") in taken:
            counts[folded] += 1
        taken.add(_fold(gloss))
        signs[gloss] = replace(sign, gloss=gloss)
    return WrittenSigns(signs, tuple(item for item in items if isinstance(item, InputError)))


def _fold(gloss: str) -> str:
    return unicodedata.normalize("NFC", gloss).casefold()


def _signs(content: bytes, name: str, lenient: bool) -> Iterator[WrittenSign | InputError]:
    """Yields each sign of a file, or the error that rejects it."""
    suffix = Path(name).suffix.lower()
    if suffix in (".sigml", ".xml") or content.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<"):
        yield from _of_xml(content, name, lenient)
        return
    text = decode_text(content, name)
    rows = json_rows(text, name) if suffix == ".json" else table_rows(text, name, suffix)
    for n, (gloss, notation, line) in enumerate(rows):
        if n >= _MOST_SIGNS:
            raise FormatError(f"holds more than {_MOST_SIGNS:,} signs", file=name)
        try:
            gloss = gloss if gloss.strip() else f"{Path(name).stem}-{line}"
            reading = Reading(name, _gloss(gloss, name, line), lenient, by_line=False)
            yield _of_text(notation, reading)
        except InputError as error:
            yield error


def _of_text(text: str, reading: Reading) -> WrittenSign:
    if text.lstrip().startswith("<"):
        root = parse_xml(f"<hns_sign>{text}</hns_sign>".encode(), reading.file)
        elements = [e for e in root.find_elements(*_SIGNS) if e is not root] or [
            *root.children[0].find_elements(*_SIGNS),
            root,
        ][:1]
        return _reader(elements[0])(elements[0], reading)
    return hamnosys.sign(symbols.tokens(text, reading), reading)


def _of_xml(content: bytes, name: str, lenient: bool) -> Iterator[WrittenSign | InputError]:
    root = parse_xml(content, name)
    for child in root.children if root.tag == "sigml" else ():
        if not any(child.find_elements(*_SIGNS)):
            what = f"<{child.tag[:60]}> is no sign that is read, and is left out"
            yield FormatError(what, file=name, line=child.line)
    for n, element in enumerate(root.find_elements(*_SIGNS)):
        if n >= _MOST_SIGNS:
            raise FormatError(f"holds more than {_MOST_SIGNS:,} signs", file=name)
        try:
            gloss = element.attributes.get("gloss", "") or f"{Path(name).stem}"
            yield _reader(element)(element, Reading(name, _gloss(gloss, name, element.line), lenient))
        except InputError as error:
            yield error


def _reader(element: Element) -> Callable[[Element, Reading], WrittenSign]:
    """Returns the reader of a sign, chosen by its content and not by its tag."""
    tags = {e.tag for e in below(element)}
    of_symbols = any(tag.startswith("ham") for tag in tags) or (element.tag == "hns_sign" and "sign_manual" not in tags)
    return hamnosys.sign_of_element if of_symbols else gestural.sign


def _gloss(text: str, name: str, line: int) -> str:
    """Returns a gloss with hyphens for blanks. Raises ``FormatError`` if it is empty or too long."""
    gloss = "".join(c for c in "-".join(text.split()) if c.isprintable())
    if not gloss or len(gloss) > 200:
        raise FormatError(f"gloss {text[:40]!r}, expected up to 200 printable characters", file=name, line=line)
    return gloss
