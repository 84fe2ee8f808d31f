"""Files of written signs: SiGML, tables, lists and JSON of HamNoSys, whatever their columns are called, and folders of
them.
"""

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
"""Names of columns and keys, the one that is preferred first."""
_NAMES = "|".join(sorted(symbols.NAMES, key=len, reverse=True))
_NOTATION = re.compile(rf"[\ue000-\ue0f1]|\bham(?:{_NAMES})\b", re.IGNORECASE)
"""What only a notation holds."""
_NUMBER = re.compile(r"[\d\s.,:;+-]*")
_SAMPLE = 50


def decode_text(content: bytes, name: str) -> str:
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


SUFFIXES = (".sigml", ".xml", ".csv", ".json", ".txt", ".tsv")
"""Suffixes of the files of written signs."""
_MOST_BYTES, _MOST_SIGNS = 64 << 20, 200_000
_SIGNS = ("hamgestural_sign", "hns_sign", "sigmlsign")
"""Elements that hold a sign; ``sigmlsign`` is a ``hamgestural_sign`` in older files."""


@dataclass(frozen=True)
class WrittenSigns:
    """What is read of files.

    signs: gloss -> sign, in the order of the files; a gloss that comes again is GLOSS#2, then GLOSS#3
    refused: an error for each sign that is not understood
    """

    signs: dict[str, WrittenSign]
    refused: tuple[InputError, ...] = ()


def read(paths: str | Path | Sequence[str | Path], lenient: bool = False) -> WrittenSigns:
    """The signs of a file, of all ``.sigml`` files below a folder in the order of their names, or of several.

    lenient: leave out what is not understood, with a note in the sign. Raises ``InputError`` where there is no such
    file, no sign, or a file is broken as a whole and no other is read.
    """
    given = [Path(paths)] if isinstance(paths, (str, Path)) else [Path(path) for path in paths]
    named = [file for path in given for file in (_below(path) if path.is_dir() else [path])]
    items = list[WrittenSign | InputError]()
    for file in named:
        try:
            items += _signs(read_bytes(file, _MOST_BYTES), str(file), lenient)  # up to an error
        except InputError as error:
            if len(named) == 1:
                raise
            items.append(error)
    return _number_glosses(items, str(given[0]))


def _below(folder: Path) -> list[Path]:
    """The files of SiGML below a folder, the shortest names first: of two signs of a gloss, NAME.sigml comes before
    NAME-CL{THING}.sigml.
    """
    found = [path for path in folder.rglob("*.sigml") if path.is_file()]
    found.sort(key=lambda path: (len(path.name), path))
    if not found:
        raise InputError(f"{folder}: no .sigml files in it; name tables of HamNoSys themselves")
    return found


def parse(content: bytes, name: str, lenient: bool = False) -> WrittenSigns:
    """The signs of a file's content; its suffix says what it is. Raises as ``read`` does."""
    return _number_glosses([*_signs(content, name, lenient)], name)


def one(text: str, gloss: str = "SIGN", lenient: bool = False) -> WrittenSign:
    """The sign of a text of HamNoSys symbols. Raises ``InputError`` that names the symbol and its number."""
    return _of_text(text, Reading("<text>", gloss, lenient, by_line=False))


def _number_glosses(items: Sequence[WrittenSign | InputError], name: str) -> WrittenSigns:
    """What is read, with a number at a gloss that comes again. Raises ``FormatError`` where it is nothing."""
    if not items:
        raise FormatError("holds no sign, expected hamgestural_sign, hns_sign or HamNoSys", file=name)
    found = [item for item in items if isinstance(item, WrittenSign)]
    counts, signs, taken = Counter[str](), dict[str, WrittenSign](), {_fold(sign.gloss) for sign in found}
    for sign in found:
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
    """Each sign of a file, or the error that refuses it."""
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
        found = [e for e in root.find_elements(*_SIGNS) if e is not root] or [
            *root.children[0].find_elements(*_SIGNS),
            root,
        ][:1]
        return _reader(found[0])(found[0], reading)
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
    """What reads a sign: by what it holds, whatever it is called."""
    held = {e.tag for e in below(element)}
    of_symbols = any(tag.startswith("ham") for tag in held) or (element.tag == "hns_sign" and "sign_manual" not in held)
    return hamnosys.sign_of_element if of_symbols else gestural.sign


def _gloss(text: str, name: str, line: int) -> str:
    """A gloss with hyphens for blanks. Raises ``FormatError`` where none is left or a character is not printable."""
    gloss = "".join(c for c in "-".join(text.split()) if c.isprintable())
    if not gloss or len(gloss) > 200:
        raise FormatError(f"gloss {text[:40]!r}, expected up to 200 printable characters", file=name, line=line)
    return gloss
