"""Files of written signs: SiGML, tables and lists of HamNoSys, and folders of them."""

from __future__ import annotations

import unicodedata
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from signsplice.errors import FormatError, InputError
from signsplice.formats.reading import read_bytes
from signsplice.written import elements, gestural, hamnosys, hamnosys_tokens, hns, listings
from signsplice.written.reading import Reading
from signsplice.written.tree import WrittenSign

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
    found, refused = list[WrittenSign](), list[InputError]()
    for file in named:
        try:
            _sort(_signs(read_bytes(file, _MOST_BYTES), str(file), lenient), found, refused)
        except InputError as error:
            if len(named) == 1:
                raise
            refused.append(error)
    return _numbered(found, refused, str(given[0]))


def _below(folder: Path) -> list[Path]:
    """The files of SiGML below a folder, the shortest names first: of two signs of a gloss, NAME.sigml comes before
    NAME-CL{THING}.sigml.
    """
    found = [path for path in folder.rglob("*.sigml") if path.is_file()]
    found.sort(key=lambda path: (len(path.name), path))
    if not found:
        raise InputError(f"{folder}: no .sigml files in it; name tables of HamNoSys themselves")
    return found


def _sort(read: Iterable[WrittenSign | InputError], found: list[WrittenSign], refused: list[InputError]) -> None:
    """Add what is read to signs and errors."""
    for item in read:
        if isinstance(item, InputError):
            refused.append(item)
        else:
            found.append(item)


def parse(content: bytes, name: str, lenient: bool = False) -> WrittenSigns:
    """The signs of a file's content; its suffix says what it is. Raises as ``read`` does."""
    found, refused = list[WrittenSign](), list[InputError]()
    _sort(_signs(content, name, lenient), found, refused)
    return _numbered(found, refused, name)


def one(text: str, gloss: str = "SIGN", lenient: bool = False) -> WrittenSign:
    """The sign of a text of HamNoSys symbols. Raises ``InputError`` that names the symbol and its number."""
    return _of_text(text, Reading("<text>", gloss, lenient, by_line=False))


def _numbered(found: list[WrittenSign], refused: list[InputError], name: str) -> WrittenSigns:
    if not found and not refused:
        raise FormatError("holds no sign, expected hamgestural_sign, hns_sign or HamNoSys", file=name)
    counts = Counter[str]()
    signs: dict[str, WrittenSign] = {}
    taken = {_fold(sign.gloss) for sign in found}
    for sign in found:
        folded = _fold(sign.gloss)
        counts[folded] += 1
        gloss = sign.gloss
        while counts[folded] > 1 and _fold(gloss := f"{sign.gloss}#{counts[folded]}") in taken:
            counts[folded] += 1
        taken.add(_fold(gloss))
        signs[gloss] = replace(sign, gloss=gloss)
    return WrittenSigns(signs, tuple(refused))


def _fold(gloss: str) -> str:
    return unicodedata.normalize("NFC", gloss).casefold()


def _signs(content: bytes, name: str, lenient: bool) -> Iterator[WrittenSign | InputError]:
    """Each sign of a file, or the error that refuses it."""
    suffix = Path(name).suffix.lower()
    if suffix in (".sigml", ".xml") or content.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<"):
        yield from _of_xml(content, name, lenient)
        return
    text = listings.decoded(content, name)
    rows = listings.json_rows(text, name) if suffix == ".json" else listings.table_rows(text, name, suffix)
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
        root = elements.parse(f"<hns_sign>{text}</hns_sign>".encode(), reading.file)
        found = [e for e in root.named(*_SIGNS) if e is not root] or [*root.children[0].named(*_SIGNS), root][:1]
        return _reader(found[0])(found[0], reading)
    return hamnosys.sign(hamnosys_tokens.tokens(text, reading), reading)


def _of_xml(content: bytes, name: str, lenient: bool) -> Iterator[WrittenSign | InputError]:
    root = elements.parse(content, name)
    for child in root.children if root.tag == "sigml" else ():
        if not any(child.named(*_SIGNS)):
            yield FormatError(
                f"<{child.tag[:60]}> is no sign that is read, and is left out", file=name, line=child.line
            )
    for n, element in enumerate(root.named(*_SIGNS)):
        if n >= _MOST_SIGNS:
            raise FormatError(f"holds more than {_MOST_SIGNS:,} signs", file=name)
        try:
            gloss = element.attributes.get("gloss", "") or f"{Path(name).stem}"
            yield _reader(element)(element, Reading(name, _gloss(gloss, name, element.line), lenient))
        except InputError as error:
            yield error


def _reader(element: elements.Element) -> Callable[[elements.Element, Reading], WrittenSign]:
    """What reads a sign: by what it holds, whatever it is called."""
    held = {e.tag for e in elements.below(element)}
    symbols = any(tag.startswith("ham") for tag in held)
    return hns.sign if symbols or (element.tag == "hns_sign" and "sign_manual" not in held) else gestural.sign


def _gloss(text: str, name: str, line: int) -> str:
    """A gloss with hyphens for blanks. Raises ``FormatError`` where none is left or a character is not printable."""
    gloss = "".join(c for c in "-".join(text.split()) if c.isprintable())
    if not gloss or len(gloss) > 200:
        raise FormatError(f"gloss {text[:40]!r}, expected up to 200 printable characters", file=name, line=line)
    return gloss
