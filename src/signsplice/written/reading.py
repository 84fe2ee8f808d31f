"""Shared by the readers of written signs: untrusted XML as plain elements with line numbers (no entities, limited depth
and size), and the errors and notes of a sign.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NoReturn
from xml.parsers import expat

from signsplice.errors import FormatError, LimitError
from signsplice.written.tree import Where

_MOST_ELEMENTS = 500_000
"""Largest number of elements in a document."""
_MOST_DEPTH = 40
"""Largest number of nested levels."""


@dataclass(frozen=True)
class Element:
    """An XML element.

    tag: lower case, without its namespace
    attributes, children: as written
    line: line of its start tag, from 1
    text: its text before, between and after its children
    """

    tag: str
    attributes: dict[str, str]
    children: tuple[Element, ...]
    line: int
    text: str = ""

    def find_elements(self, *tags: str) -> Iterator[Element]:
        """Yields the outermost elements with one of the tags, in document order; may yield this element itself."""
        if self.tag in tags:
            yield self
        else:
            for child in self.children:
                yield from child.find_elements(*tags)


def below(element: Element) -> Iterator[Element]:
    """Yields all elements within one, in document order."""
    for child in element.children:
        yield child
        yield from below(child)


def parse_xml(content: bytes, file: str) -> Element:
    """Parses an XML document and returns its root; repairs bare ampersands, several roots and Windows-1252 text. Raises
    ``FormatError`` with the line if it is not well formed or declares an entity, ``LimitError`` beyond 500,000 elements
    or 40 levels.
    """
    try:
        return _parse_strict(content, file)
    except FormatError as error:
        if not isinstance(error.__cause__, expat.ExpatError):
            raise
        try:
            return _parse_strict(_repair_xml(content), file)
        except FormatError:
            raise error from None


def _repair_xml(content: bytes) -> bytes:
    """Removes XML declarations, escapes bare ampersands, and adds one root."""
    encoding = "utf-16" if content[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    try:
        text = content.decode(encoding)
    except UnicodeDecodeError:
        text = content.decode("cp1252", "replace")
    text = re.sub(r"<\?xml[^>]*\?>", "", text)
    text = re.sub(r"&(?!(?:amp|lt|gt|quot|apos|#\d+|#x[0-9a-fA-F]+);)", "&amp;", text)
    return f"<sigml>{text}</sigml>".encode()


def _parse_strict(content: bytes, file: str) -> Element:
    open_elements = list[tuple[str, dict[str, str], list[Element], int, list[str]]]()
    roots = list[Element]()
    count = 0
    parser = expat.ParserCreate()

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal count
        count += 1
        if count > _MOST_ELEMENTS or len(open_elements) >= _MOST_DEPTH:
            limits = f"{_MOST_ELEMENTS:,} elements, {_MOST_DEPTH} levels deep"
            raise LimitError(f"expected at most {limits}", file=file, line=_line(parser))
        tag = tag.rpartition(":")[2].lower()
        open_elements.append((tag, attributes, [], parser.CurrentLineNumber, []))

    def end(_: str) -> None:
        tag, attributes, children, line, texts = open_elements.pop()
        within = open_elements[-1][2] if open_elements else roots
        within.append(Element(tag, attributes, tuple(children), line, "".join(texts)))

    def text(data: str) -> None:
        open_elements[-1][4].append(data)

    def entity(*_: object) -> NoReturn:
        raise FormatError("declares an entity, expected none; write its text out", file=file, line=_line(parser))

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.EntityDeclHandler, parser.CharacterDataHandler = entity, text
    try:
        parser.Parse(content, True)
    except expat.ExpatError as error:
        what = f"is no well-formed XML ({expat.ErrorString(error.code)})"
        raise FormatError(what, file=file, line=error.lineno) from error
    except (LookupError, ValueError) as error:  # an unknown encoding
        raise FormatError(f"is no XML that can be read ({error})", file=file, line=_line(parser)) from error
    return roots[0]


def _line(parser: expat.XMLParserType) -> int:
    return parser.CurrentLineNumber


def factor(e: Element, key: str, reading: Reading) -> float:
    """Parses a factor from 0.1 to 10; 1 if the attribute is absent."""
    text = e.attributes.get(key, "1")
    if re.fullmatch(r"\d{0,3}\.?\d{1,4}", text) and 0.1 <= float(text) <= 10.0:
        return float(text)
    reading.refuse(f"{key}={text[:40]!r}, expected a number from 0.1 to 10", f"<{e.tag}>", e.line)
    return 1.0


@dataclass(frozen=True)
class Reading:
    """The errors and notes of one sign during reading.

    file, gloss: for errors
    lenient: leave out unknown parts with a note, and do not raise
    by_line: positions are lines of a file; otherwise numbers of symbols
    notes: repairs and omissions so far
    """

    file: str
    gloss: str
    lenient: bool = False
    by_line: bool = True
    notes: list[str] = field(default_factory=list)

    def where(self, symbol: str = "", position: int = 0) -> Where:
        """Returns the position of a symbol, for later errors."""
        return Where(self.file, self.gloss, symbol, position)

    def error(self, what: str, symbol: str, position: int) -> FormatError:
        """Returns an error with file, gloss, symbol and position."""
        number = f"symbol {position} " if not self.by_line and position else ""
        named = f"{symbol[:60]}: " if symbol else f"{number.rstrip()}: " if number else ""
        text = f"{self.gloss[:80]}: {number if symbol else ''}{named}{what}"
        return FormatError(text[:700], file=self.file, line=position if self.by_line and position else None)

    def refuse(self, what: str, symbol: str, position: int) -> None:
        """Raise ``FormatError``, or note that the symbol is left out."""
        if not self.lenient:
            raise self.error(what, symbol, position)
        self.note(f"{symbol} is left out: {what}", position)

    def note(self, what: str, position: int) -> None:
        """Add a note of a repair or an omission."""
        prefix = f"{'line' if self.by_line else 'symbol'} {position}: "
        self.notes.append(prefix + what)
