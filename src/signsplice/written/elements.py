"""XML that strangers wrote, as plain elements with their lines: no entities, no deep nesting, no unbounded size."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NoReturn
from xml.parsers import expat

from signsplice.errors import FormatError, LimitError

_MOST_ELEMENTS, _MOST_DEPTH = 500_000, 40


@dataclass(frozen=True)
class Element:
    """An element of XML.

    tag: in small letters, without its namespace
    attributes, children: as written
    line: of its start, from 1
    text: what stands in it before, between and after its children
    """

    tag: str
    attributes: dict[str, str]
    children: tuple[Element, ...]
    line: int
    text: str = ""

    def named(self, *tags: str) -> Iterator[Element]:
        """The elements of some names within this one, itself included, in their order."""
        if self.tag in tags:
            yield self
        else:
            for child in self.children:
                yield from child.named(*tags)


def below(element: Element) -> Iterator[Element]:
    """All elements within one, in their order."""
    for child in element.children:
        yield child
        yield from below(child)


def parse(content: bytes, file: str) -> Element:
    """The root of an XML document, with bare ampersands, several roots and Windows' letters mended. Raises
    ``FormatError`` with the line for what is not well formed or declares an entity, and ``LimitError`` beyond 500,000
    elements or 40 levels.
    """
    try:
        return _parsed(content, file)
    except FormatError as error:
        if not isinstance(error.__cause__, expat.ExpatError):
            raise
        try:
            return _parsed(_mended(content), file)
        except FormatError:
            raise error from None


def _mended(content: bytes) -> bytes:
    """XML without declarations, with ampersands written out, within one root."""
    encoding = "utf-16" if content[:2] in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"
    try:
        text = content.decode(encoding)
    except UnicodeDecodeError:
        text = content.decode("cp1252", "replace")
    text = re.sub(r"<\?xml[^>]*\?>", "", text)
    text = re.sub(r"&(?!(?:amp|lt|gt|quot|apos|#\d+|#x[0-9a-fA-F]+);)", "&amp;", text)
    return f"<sigml>{text}</sigml>".encode()


def _parsed(content: bytes, file: str) -> Element:
    open_elements = list[tuple[str, dict[str, str], list[Element], int, list[str]]]()
    roots = list[Element]()
    count = 0
    parser = expat.ParserCreate()

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal count
        count += 1
        if count > _MOST_ELEMENTS or len(open_elements) >= _MOST_DEPTH:
            raise LimitError(
                f"expected at most {_MOST_ELEMENTS:,} elements, {_MOST_DEPTH} levels deep",
                file=file,
                line=parser.CurrentLineNumber,
            )
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
        raise FormatError(
            f"is no well-formed XML ({expat.ErrorString(error.code)})", file=file, line=error.lineno
        ) from error
    except (LookupError, ValueError) as error:  # an encoding that nobody knows
        raise FormatError(f"is no XML that can be read ({error})", file=file, line=_line(parser)) from error
    return roots[0]


def _line(parser: expat.XMLParserType) -> int:
    return parser.CurrentLineNumber
